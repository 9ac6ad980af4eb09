// The first page: a new clip, one's own files, examples that play at once.

import { useSignal } from "@preact/signals";
import { Bot, ChevronRight, FolderOpen, Plus } from "lucide";
import { useEffect } from "preact/hooks";
import { act } from "./actions/index";
import { FPS } from "./clip";
import { opening, refreshGallery } from "./documents";
import { Icon } from "./icon";
import { refreshWorkspace } from "./jobs";
import { parseNumber, TIMES } from "./numbers";
import { OwnFiles } from "./own_files";
import type { GalleryItem } from "./protocol";
import * as store from "./store";
import { addressOf, http } from "./wire";

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
          {ROBOTS[item.robot] ?? item.robot} · {(item.length / FPS).toFixed(0)} s · {item.keys} key
          {item.keys === 1 ? "" : "s"}
        </span>
        <br />
        <span
          class="sub"
          title="Mean error of the robot's trained policy over all frames with a goal; an opened clip chooses the nearest of several"
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
    const length = Math.round((parseNumber(secs.value, TIMES) ?? 0) * FPS);
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
      <section class="start" aria-label="New clip">
        <div>
          <h1>Place a few poses. A policy performs them.</h1>
          <p class="lead">
            It was trained on random motion, runs in simulation, and shows its error while you edit.
          </p>
        </div>
        <div class="row">
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
            <Icon of={Plus} size={14} /> New clip
          </button>
          <button onClick={() => act("open")}>
            <Icon of={FolderOpen} size={14} /> Open a file…
          </button>
          <button onClick={() => act("runs")}>
            <Icon of={Bot} size={14} /> Import your own robot…
          </button>
        </div>
      </section>
      <OwnFiles titles={ROBOTS} />
      <h2>Examples</h2>
      <Cards items={featured} open />
      <details open={opened.value} onToggle={(e) => (opened.value = e.currentTarget.open)}>
        <summary>
          <Icon of={ChevronRight} size={14} /> {more.length} more examples
        </summary>
        <Cards items={more} open={opened.value} />
      </details>
    </div>
  );
}
