// Where the playhead is, and how it moves.

import { nextKey, prevKey } from "../clip";
import * as store from "../store";
import { withFrame } from "../timeline/layout";
import { type Action, clip } from "./action";

export function seek(frame: number): void {
  const last = Math.max(0, store.length.value - 1);
  store.playing.value = false;
  store.playhead.value = Math.min(last, Math.max(0, Math.round(frame)));
  keepInView(store.playhead.value);
}

/** A timeline that somebody has zoomed in follows the playhead. */
export function keepInView(frame: number): void {
  store.view.value = withFrame(store.view.value, store.sheet.value, frame, store.length.value);
}

export const markerHere = () => clip()?.markers?.find((m) => m.frame === store.playhead.value);
export const needsMarker = (): string | undefined =>
  markerHere() ? undefined : "there is no marker at the playhead: Ctrl+. goes to the next";

export function toMarker(direction: 1 | -1): void {
  const all = (clip()?.markers ?? []).map((m) => m.frame).sort((a, b) => a - b);
  const at = store.playhead.value;
  const to = direction === 1 ? all.find((f) => f > at) : all.filter((f) => f < at).at(-1);
  if (to === undefined)
    store.toast(
      all.length
        ? "there are no more markers in this direction"
        : "there are no markers yet; Shift+M adds one",
    );
  else seek(to);
}

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

export function changeSpeed(step: 1 | -1): void {
  const i = SPEEDS.indexOf(store.speed.value);
  store.speed.value = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, i + step))] ?? 1;
}

export const PLAYBACK: Action[] = [
  {
    id: "play",
    title: "Play or pause",
    group: "Playback",
    keys: ["Space"],
    run: () => (store.playing.value = !store.playing.value),
  },
  {
    id: "next-frame",
    title: "Next frame",
    group: "Playback",
    keys: ["ArrowRight"],
    run: () => seek(store.playhead.value + 1),
  },
  {
    id: "prev-frame",
    title: "Previous frame",
    group: "Playback",
    keys: ["ArrowLeft"],
    run: () => seek(store.playhead.value - 1),
  },
  {
    id: "next-ten",
    title: "Forward 10 frames",
    group: "Playback",
    keys: ["Shift+ArrowRight"],
    run: () => seek(store.playhead.value + 10),
  },
  {
    id: "prev-ten",
    title: "Back 10 frames",
    group: "Playback",
    keys: ["Shift+ArrowLeft"],
    run: () => seek(store.playhead.value - 10),
  },
  {
    id: "next-key",
    title: "Next key",
    group: "Playback",
    keys: ["ArrowDown", "."],
    run: () => {
      const c = clip();
      const k = c && nextKey(c, store.playhead.value);
      if (k) seek(k.frame);
    },
  },
  {
    id: "prev-key",
    title: "Previous key",
    group: "Playback",
    keys: ["ArrowUp", ","],
    run: () => {
      const c = clip();
      const k = c && prevKey(c, store.playhead.value);
      if (k) seek(k.frame);
    },
  },
  { id: "home", title: "To the start", group: "Playback", keys: ["Home"], run: () => seek(0) },
  { id: "end", title: "To the end", group: "Playback", keys: ["End"], run: () => seek(store.length.value) },
  {
    id: "in",
    title: "Start the loop here",
    group: "Playback",
    keys: ["["],
    run: () =>
      (store.range.value = {
        from: store.playhead.value,
        to: Math.max(store.playhead.value + 1, store.range.value?.to ?? store.length.value),
      }),
  },
  {
    id: "out",
    title: "End the loop here",
    group: "Playback",
    keys: ["]"],
    run: () =>
      (store.range.value = {
        from: Math.min(store.range.value?.from ?? 0, store.playhead.value),
        to: store.playhead.value + 1,
      }),
  },
  {
    id: "no-range",
    title: "Clear loop range",
    group: "Playback",
    run: () => (store.range.value = undefined),
  },
  {
    id: "loop",
    title: "Loop on or off",
    group: "Playback",
    keys: ["L"],
    run: () => (store.loop.value = !store.loop.value),
  },
  { id: "slower", title: "Slower", group: "Playback", keys: ["-"], run: () => changeSpeed(-1) },
  { id: "faster", title: "Faster", group: "Playback", keys: ["+"], run: () => changeSpeed(1) },
  { id: "speed-1", title: "Real speed", group: "Playback", keys: ["0"], run: () => (store.speed.value = 1) },
  { id: "next-marker", title: "Next marker", group: "Playback", keys: ["Ctrl+."], run: () => toMarker(1) },
  {
    id: "prev-marker",
    title: "Previous marker",
    group: "Playback",
    keys: ["Ctrl+,"],
    run: () => toMarker(-1),
  },
];
