// Play, step, time, loop, speed, and the switches that decide what an edit does.

import { useEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import { act, seek } from "./actions";
import { tell } from "./api";
import { clock, parseTime } from "./clip";
import { Splitter } from "./splitter";
import * as store from "./store";

/** Moves the playhead by the wall clock; frames are dropped, never slowed. */
function usePlayback(): void {
  useEffect(() => {
    let last = 0;
    let at = 0;
    let handle = 0;
    const step = (now: number): void => {
      if (!store.playing.value) return;
      const r = store.range.value ?? { from: 0, to: store.length.value };
      // The time of a picture is of its beginning, which may lie before the start.
      at += (Math.max(0, now - last) / 1000) * store.fps.value * store.speed.value;
      last = Math.max(last, now);
      if (at >= r.to - 1) {
        if (store.loop.value) at = r.from + ((at - r.from) % Math.max(1, r.to - r.from - 1));
        else {
          store.playhead.value = r.to - 1;
          store.playing.value = false;
          return;
        }
      }
      store.playhead.value = Math.floor(at);
      handle = requestAnimationFrame(step);
    };
    const stop = store.playing.subscribe((on) => {
      cancelAnimationFrame(handle);
      if (!on) return;
      const r = store.range.value ?? { from: 0, to: store.length.value };
      if (store.playhead.value < r.from || store.playhead.value >= r.to - 1) store.playhead.value = r.from;
      last = performance.now();
      at = store.playhead.value;
      handle = requestAnimationFrame(step);
    });
    return () => {
      stop();
      cancelAnimationFrame(handle);
    };
  }, []);
}

/** Drawn, because no font is sure to have these signs. */
const SHAPES: Record<string, string> = {
  start: "M3 2h2v10H3z M13 2v10L6 7z",
  back: "M11 2v10L4 7z",
  play: "M4 2l9 5-9 5z",
  pause: "M4 2h3v10H4z M9 2h3v10H9z",
  forward: "M5 2l7 5-7 5z",
  end: "M11 2h2v10h-2z M3 2l7 5-7 5z",
};

function Icon({ name }: { name: keyof typeof SHAPES }) {
  return <svg width="15" height="14" viewBox="0 0 15 14" aria-hidden="true" style="display: block"><path d={SHAPES[name]} fill="currentColor" /></svg>;
}

/** A rollout that takes longer than a moment. */
function stoppable(): boolean {
  const r = store.rollout.value;
  if (r?.phase !== "running" && r?.phase !== "waiting") return false;
  const slow = store.policies.value.some((p) => p.slow && p.name === store.settings.value.policy);
  return slow || store.settings.value.refine || (r.ms_per_frame ?? 0) * (r.frames - r.cached_to) > 1500;
}

export function Transport() {
  usePlayback();
  const text = useSignal<string | undefined>(undefined);
  const frame = store.playhead.value;
  const commit = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined) return;
    const f = parseTime(t, store.fps.value);
    if (f === undefined) store.toast(`"${t}" is no time; write 55, 55f, 2:15 or 2.75s`, "error");
    else seek(f);
  };
  return (
    <div class="transport" role="toolbar" aria-label="Playback">
      <Splitter of="sheet" />
      <button onClick={() => act("home")} aria-label="To the start" title="Home"><Icon name="start" /></button>
      <button onClick={() => act("prev-frame")} aria-label="Previous frame" title="Left"><Icon name="back" /></button>
      <button class="main" onClick={() => act("play")} aria-label={store.playing.value ? "Pause" : "Play"} title="Space" data-testid="play"><Icon name={store.playing.value ? "pause" : "play"} /></button>
      <button onClick={() => act("next-frame")} aria-label="Next frame" title="Right"><Icon name="forward" /></button>
      <button onClick={() => act("end")} aria-label="To the end" title="End"><Icon name="end" /></button>
      <button aria-pressed={store.loop.value} onClick={() => act("loop")} title="L">Loop</button>
      <select aria-label="Speed" value={String(store.speed.value)} onChange={(e) => (store.speed.value = Number(e.currentTarget.value))}>
        {[0.1, 0.25, 0.5, 1, 2, 4].map((s) => <option key={s} value={String(s)}>{s}×</option>)}
      </select>
      <label>frame{" "}
        <input class="time" type="text" aria-label="Frame or time" data-testid="frame" value={text.value ?? String(frame)}
          onFocus={(e) => e.currentTarget.select()}
          onInput={(e) => (text.value = e.currentTarget.value)} onBlur={commit}
          onKeyDown={(e) => { if (e.key === "Enter") { commit(); e.currentTarget.blur(); } }} />
      </label>
      <span class="num" style="color: var(--dim)">{clock(frame, store.fps.value)} of {clock(store.length.value - 1, store.fps.value)}</span>
      <span class="grow" />
      <button aria-pressed={store.autoKey.value} onClick={() => act("auto-key")} title="A moved joint becomes a key at once">Auto-key</button>
      <button aria-pressed={store.settings.value.auto} onClick={() => act("auto")} title="Roll out after every edit (Shift+R)">Auto-rollout</button>
      {stoppable() ? <button onClick={() => act("stop-rollout")} title="Frames so far stay (Shift+Esc)" data-testid="stop-rollout">Stop</button>
        : <button onClick={() => act("rollout")} title="R">Roll out</button>}
      <button class="main" onClick={() => act("export")} title="Ctrl+E">Export</button>
    </div>
  );
}

export function stopPlaying(): void {
  if (store.playing.value) store.playing.value = false;
  tell("view.play", { frame: store.playhead.value, speed: 0 });
}
