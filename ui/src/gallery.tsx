// The first page: examples that play at once, recent files, a new clip.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { act } from "./actions/index";
import { opening, refreshGallery } from "./documents";
import { refreshWorkspace } from "./jobs";
import { parseNumber, TIMES } from "./numbers";
import type { GalleryItem } from "./protocol";
import * as store from "./store";
import { addressOf, complain, http } from "./wire";

const ROBOTS: Record<string, string> = {
  pointmass: "Pointmass",
  ur5e: "UR5e arm",
  ur5e_light: "UR5e arm, light damping",
  shadow_hand: "Shadow Hand",
};

/** Pictures that are asked for at once: each is rendered when it is asked for, and a browser has six connections. */
const AT_ONCE = 2;

function Cards({ items, open }: { items: GalleryItem[]; open: boolean }) {
  const done = useSignal(0);
  return (
    <div class="cards">
      {items.map((g, i) => (
        <Card key={g.id} item={g} pictured={open && i < done.value + AT_ONCE} onDone={() => done.value++} />
      ))}
    </div>
  );
}

function Card({ item, pictured, onDone }: { item: GalleryItem; pictured: boolean; onDone: () => void }) {
  const error = useSignal("");
  // Known as soon as the picture is: both are of one performance.
  const measure = (): void => {
    void http("GET /api/gallery-error", { query: { id: item.id } })
      .then((e) => {
        if (e) error.value = `mean error ${store.shownError(e.value, e.unit)}`;
      })
      .catch(() => undefined);
  };
  return (
    <button
      class="card"
      onClick={() => void opening(http("POST /api/gallery/{id}", { at: { id: item.id } }))}
      data-testid={`example-${item.id}`}
    >
      <span class="picture">
        {pictured ? (
          <img
            src={addressOf("GET /api/gallery-picture.jpg", { query: { id: item.id } })}
            alt=""
            onLoad={() => {
              onDone();
              measure();
            }}
            onError={(e) => {
              onDone();
              e.currentTarget.style.visibility = "hidden";
            }}
          />
        ) : null}
      </span>
      <span class="body">
        <span class="title">{item.name}</span>
        <br />
        <span class="sub">
          {ROBOTS[item.robot] ?? item.robot} · {(item.length / 20).toFixed(0)} s · {item.keys} key
          {item.keys === 1 ? "" : "s"}
        </span>
        <br />
        <span
          class="sub"
          title="Mean error of the robot's default policy over all frames with a goal"
          data-testid={`error-${item.id}`}
        >
          {error.value || "\u00a0"}
        </span>
      </span>
    </button>
  );
}

export function Gallery() {
  const chosen = useSignal("shadow_hand");
  const opened = useSignal(false);
  const name = useSignal("");
  const secs = useSignal("5");
  const create = (): void => {
    const length = Math.round((parseNumber(secs.value, TIMES) ?? 0) * 20);
    if (length < 2) return store.toast(`"${secs.value}" is not a number of seconds`, "error");
    void opening(http("POST /api/new", { body: { robot: chosen.value, length, name: name.value.trim() } }));
  };
  useEffect(() => {
    if (store.link.value !== "open") return;
    void refreshWorkspace();
    void refreshGallery();
  }, [store.link.value]);
  const all = store.gallery.value;
  const featured = all.filter((g) => g.featured);
  const more = all.filter((g) => !g.featured);
  return (
    <div class="gallery" data-testid="gallery">
      <h1>Start from an example</h1>
      <p class="lead">
        Place a few poses on a timeline. A policy that was trained by unsupervised exploration performs them
        in simulation, and you see its error while you edit.
      </p>
      <Cards items={featured} open />
      <h2>New clip</h2>
      <div class="row" style="margin-bottom: 22px">
        <select
          aria-label="Robot"
          value={chosen.value}
          onChange={(e) => (chosen.value = e.currentTarget.value)}
        >
          {store.robots.value.map((r) => (
            <option key={r.source} value={r.source}>
              {ROBOTS[r.id] ?? r.id}
            </option>
          ))}
        </select>
        <input
          type="text"
          placeholder="name"
          aria-label="Name of the new clip"
          style="width: 150px"
          value={name.value}
          onInput={(e) => (name.value = e.currentTarget.value)}
          onKeyDown={(e) => e.key === "Enter" && create()}
        />
        <label>
          <input
            type="text"
            inputMode="decimal"
            aria-label="Length of the new clip, seconds"
            style="width: 48px; text-align: right"
            value={secs.value}
            onInput={(e) => (secs.value = e.currentTarget.value)}
            onKeyDown={(e) => e.key === "Enter" && create()}
          />{" "}
          s
        </label>
        <button class="main" onClick={create} data-testid="new-clip">
          New clip
        </button>
        <button onClick={() => act("open")}>Open a file…</button>
        <button onClick={() => act("runs")}>Import your own robot…</button>
      </div>
      <details
        style="margin-bottom: 22px"
        open={opened.value}
        onToggle={(e) => (opened.value = e.currentTarget.open)}
      >
        <summary style="cursor: pointer">
          <b>{more.length} more examples</b>
        </summary>
        <Cards items={more} open={opened.value} />
      </details>
      {store.drafts.value.length ? <h2>Unsaved</h2> : null}
      {store.drafts.value.map((d) => (
        <div class="take" key={d.number} style="max-width: 760px" data-testid={`draft-${d.number}`}>
          <button
            class="quiet"
            onClick={() => void opening(http("POST /api/drafts/{number}", { at: { number: d.number } }))}
          >
            <b>{d.name || "untitled"}</b>
          </button>
          <span class="grow" style="color: var(--dim)">
            {d.keys} key{d.keys === 1 ? "" : "s"} · {new Date(d.changed_secs * 1000).toLocaleString()}
            {d.abandoned ? " · was open when the studio was killed" : ""}
          </span>
          <span>{ROBOTS[d.robot] ?? d.robot}</span>
          <button
            class="quiet"
            aria-label={`Discard ${d.name || "untitled"}`}
            title="Discard"
            onClick={() =>
              void http("POST /api/drafts/{number}/discard", { at: { number: d.number } }).then(
                refreshGallery,
                complain,
              )
            }
          >
            ×
          </button>
        </div>
      ))}
      {store.recent.value.length ? <h2>Recent</h2> : null}
      {store.recent.value.map((r) => (
        <div class="take" key={r.path} style="max-width: 760px">
          <button
            class="quiet"
            disabled={!r.exists}
            onClick={() => void opening(http("POST /api/open", { body: { path: r.path } }))}
          >
            <b>{r.name || r.path}</b>
          </button>
          <span class="grow" style="color: var(--dim)">
            {r.path}
            {r.exists ? "" : " (gone)"}
          </span>
          <span>{ROBOTS[r.robot] ?? r.robot}</span>
        </div>
      ))}
    </div>
  );
}
