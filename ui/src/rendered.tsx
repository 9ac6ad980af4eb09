// The picture as it will be exported: the playhead, and the whole take as a film.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { act } from "./actions/index";
import { JobBar } from "./job_bar";
import { ended, fetchFile, isRunning, saveUrl, startExport } from "./jobs";
import * as store from "./store";
import { addressOf, http } from "./wire";

/** Asks for stills one at a time, the newest wanted last. */
export function useStill(
  size: () => {
    w: number;
    h: number;
    draft: boolean;
    shown?: { achieved: boolean; command: boolean; ghosts: boolean; pose?: string };
  },
  host?: { current: HTMLElement | null },
) {
  const url = useSignal("");
  const error = useSignal("");
  /** The picture is of what was the case a moment ago: another one is on its way. */
  const waiting = useSignal(true);
  const state = useRef({ busy: false, again: false, timer: 0, shown: "", alive: true });
  useEffect(() => {
    const s = state.current;
    s.alive = true;
    const load = async (): Promise<void> => {
      const d = store.doc.value;
      if (!d || !s.alive) return;
      if (s.busy) {
        s.again = true;
        return;
      }
      const { w, h, draft, shown } = size();
      const r = store.rollout.value;
      const frame = Math.round(store.playhead.value);
      const version = `${r?.gen ?? 0}.${r?.cached_to ?? 0}.${r?.phase ?? ""}`;
      const query = { frame, w, h, draft, v: version, ...shown };
      const address = addressOf("GET /api/still.jpg", { query });
      if (address === s.shown) return void (waiting.value = false);
      s.busy = true;
      try {
        const next = URL.createObjectURL(await http("GET /api/still.jpg", { query }));
        if (url.value) URL.revokeObjectURL(url.value);
        url.value = next;
        error.value = "";
        s.shown = address;
      } catch (e) {
        error.value = e instanceof Error ? e.message : String(e);
      }
      s.busy = false;
      if (s.again) {
        s.again = false;
        ask();
      } else waiting.value = s.timer !== 0;
    };
    const ask = (): void => {
      // While a rollout runs every batch would be a picture: wait until it rests for a moment.
      const phase = store.rollout.value?.phase;
      clearTimeout(s.timer);
      waiting.value = true;
      s.timer = window.setTimeout(
        () => {
          s.timer = 0;
          void load();
        },
        phase === "running" || phase === "waiting" ? 120 : 0,
      );
    };
    // Another size is another picture.
    const observer = new ResizeObserver(ask);
    if (host?.current) observer.observe(host.current);
    const stops = [
      () => observer.disconnect(),
      store.playhead.subscribe(ask),
      store.rollout.subscribe(ask),
      store.doc.subscribe(ask),
      store.show.subscribe(ask),
      store.floating.subscribe(ask),
    ];
    return () => {
      s.alive = false;
      clearTimeout(s.timer);
      stops.forEach((stop) => stop());
    };
  }, []);
  return { url, error, waiting };
}

const FORMATS: [string, string][] = [
  ["mp4", "MP4"],
  ["gif", "GIF"],
  ["strip", "Strip"],
  ["png", "Picture"],
];

export function Rendered() {
  const { url, error } = useStill(() => ({ w: 640, h: 400, draft: false }));
  const job = useSignal<number | undefined>(undefined);
  const film = useSignal<{ url: string; of: string } | undefined>(undefined);
  const current = job.value === undefined ? undefined : store.jobs.value.get(job.value);
  const r = store.rollout.value;
  const version = `${store.doc.value?.rev}:${r?.policy}:${store.settings.value.model_path ?? ""}:${store.settings.value.seed}`;
  const stale = film.value !== undefined && film.value.of !== version;

  const make = async (format: string, keep: boolean): Promise<void> => {
    const of = version;
    const frame = store.playhead.value;
    const started = await startExport({
      format,
      size: [640, 400],
      ...(format === "png" ? { frames: [frame, frame + 1] } : {}),
    });
    if (!started || started === "exists") return;
    job.value = started.id;
    const done = await ended(started.id);
    if (done.phase !== "done") return;
    try {
      const made = await fetchFile(done);
      if (keep) saveUrl(made, done.file ?? `take.${format}`);
      else {
        if (film.value) URL.revokeObjectURL(film.value.url);
        film.value = { url: made, of };
      }
    } catch (e) {
      store.toast(e instanceof Error ? e.message : String(e), "error");
    }
  };
  // Who asked the system for less motion starts the film by hand.
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const busy = isRunning(current);
  return (
    <section class="rendered" aria-label="Rendered" data-testid="rendered">
      {film.value && !stale ? (
        <video src={film.value.url} controls autoplay={!still} loop data-testid="film" />
      ) : error.value ? (
        <p class="problem error" role="alert" data-testid="still-error">
          {error.value}
        </p>
      ) : url.value ? (
        <img
          src={url.value}
          alt={`The robot at frame ${store.playhead.value}, as it is exported`}
          data-testid="still"
        />
      ) : (
        <p class="empty">rendering…</p>
      )}
      <div class="row tools">
        {film.value && !stale ? (
          <button onClick={() => (film.value = undefined)}>Playhead</button>
        ) : (
          <button
            class="main"
            disabled={busy}
            onClick={() => void make("mp4", false)}
            data-testid="play-film"
          >
            Play the take
          </button>
        )}
        {FORMATS.map(([format, title]) => (
          <button
            key={format}
            disabled={busy}
            onClick={() => void make(format, true)}
            title={`Save as ${title}`}
            data-testid={`save-${format}`}
          >
            {title}
          </button>
        ))}
        <button class="quiet" onClick={() => act("export")}>
          More…
        </button>
      </div>
      {current && busy ? <JobBar job={current} /> : null}
    </section>
  );
}
