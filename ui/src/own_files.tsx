// One's own clips on the first page: those that were never saved, then the files opened last.

import { CircleDashed, FileText, X } from "lucide";
import { opening, refreshGallery } from "./documents";
import { Icon } from "./icon";
import * as store from "./store";
import { Thumbnail } from "./thumbnail";
import { complain, http } from "./wire";

export function OwnFiles({ titles }: { titles: Record<string, string> }) {
  const drafts = store.drafts.value;
  const files = store.recent.value;
  if (drafts.length + files.length === 0) return null;
  return (
    <section class="own" aria-label="Your clips" data-testid="own-files">
      <h2>Your clips</h2>
      <ul>
        {drafts.map((d) => (
          <li key={`draft-${d.number}`} data-testid={`draft-${d.number}`}>
            <button
              class="quiet file"
              aria-label={d.name || "untitled"}
              onClick={() => void opening(http("POST /api/drafts/{number}", { at: { number: d.number } }))}
            >
              <Icon of={CircleDashed} size={16} />
              <b>{d.name || "untitled"}</b>
              <span class="of">
                Unsaved, {d.keys} key{d.keys === 1 ? "" : "s"},{" "}
                {new Date(d.changed_secs * 1000).toLocaleString()}
                {d.abandoned ? ", was open when the studio was killed" : ""}
              </span>
              <span class="robot">{titles[d.robot] ?? d.robot}</span>
            </button>
            <button
              class="icon quiet"
              aria-label={`Discard ${d.name || "untitled"}`}
              title="Discard"
              onClick={() =>
                void http("POST /api/drafts/{number}/discard", { at: { number: d.number } }).then(
                  refreshGallery,
                  complain,
                )
              }
            >
              <Icon of={X} size={14} />
            </button>
          </li>
        ))}
        {files.map((r) => (
          <li key={r.path}>
            <button
              class="quiet file"
              aria-label={r.name || r.path}
              disabled={!r.exists}
              onClick={() => void opening(http("POST /api/open", { body: { path: r.path } }))}
            >
              {r.exists ? <Thumbnail of={{ path: r.path }} /> : <Icon of={FileText} size={16} />}
              <b>{r.name || r.path}</b>
              <span class="of">
                {r.path}
                {r.exists ? "" : " (gone)"}
              </span>
              <span class="robot">{titles[r.robot] ?? r.robot}</span>
            </button>
          </li>
        ))}
      </ul>
    </section>
  );
}
