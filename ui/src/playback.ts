// One clock for the playhead here and the 3D view on the server: whatever changes it (play,
// speed, loop, range, length) is told there at once, with the place where it stands.

import { effect } from "@preact/signals";
import { keepInView } from "./actions/playback";
import { ahead, type Span } from "./span";
import * as store from "./store";
import { tell } from "./wire";

/** Runs until the returned function is called. */
export function startPlayback(): () => void {
  let handle = 0;
  let last = 0;
  let at = 0;
  let running = false;
  const span = (): Span => store.range.value ?? { from: 0, to: store.length.value };
  const show = (frame: number): void => {
    if (store.playhead.value === frame) return;
    store.playhead.value = frame;
    keepInView(frame);
  };
  const step = (now: number): void => {
    if (!running) return;
    // The time of a picture is of its beginning, which may lie before the start. Frames are
    // dropped, never slowed.
    const frames = (Math.max(0, now - last) / 1000) * store.fps.value * store.speed.value;
    last = Math.max(last, now);
    const next = ahead(at, frames, span(), store.loop.value);
    if (next === undefined) {
      show(span().to - 1);
      store.playing.value = false;
      return;
    }
    at = next;
    show(Math.floor(at));
    handle = requestAnimationFrame(step);
  };
  const stop = effect(() => {
    const [on, speed, loop, s] = [store.playing.value, store.speed.value, store.loop.value, span()];
    const playhead = store.playhead.peek();
    if (!on || s.to - s.from < 1) {
      cancelAnimationFrame(handle);
      if (running) tell("view.play", { frame: playhead, speed: 0 });
      running = false;
      return;
    }
    if (!running) at = playhead;
    // Where there is nothing left to play it begins again.
    if (at < s.from || at >= (loop ? s.to : s.to - 1)) at = s.from;
    tell("view.play", { frame: at, speed, ...(loop ? { range: [s.from, s.to] } : {}) });
    last = performance.now();
    if (running) return;
    running = true;
    handle = requestAnimationFrame(step);
  });
  return () => {
    stop();
    running = false;
    cancelAnimationFrame(handle);
  };
}
