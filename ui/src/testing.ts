// What browser tests see of the page: its state, the next change of it, and where things are on
// the canvas.

import { effect } from "@preact/signals";
import { drawing, drawn } from "./draw";
import { chosen, curves } from "./graph/edits";
import { graphPoints } from "./graph/graph";
import { pinsOff, touching } from "./pins";
import { media, reference, sound } from "./reference";
import * as store from "./store";
import { measured, testPoints } from "./timeline/timeline";

export type Snapshot = ReturnType<typeof snapshot>;

function snapshot() {
  const d = store.doc.value;
  return {
    page: store.page.value,
    link: store.link.value,
    opened: d?.opened,
    rev: d?.rev,
    clip: d?.clip,
    dirty: d?.dirty,
    history: d?.history,
    findings: d?.findings,
    robot: store.robot.value?.id,
    settings: store.settings.value,
    rollout: store.rollout.value,
    frames: store.frames.value.q.length,
    q: store.frames.value.q,
    error: store.frames.value.error,
    worker: store.worker.value,
    takes: store.takes.value,
    compared: store.compared.value,
    takeFrames: [...store.takeFrames.value.keys()],
    playhead: store.playhead.value,
    playing: store.playing.value,
    range: store.range.value,
    view: store.view.value,
    points: [...chosen.value],
    curves: [...curves.value],
    selection: [...store.selection.value],
    joint: store.joint.value,
    site: store.site.value,
    locked: [...store.locked.value],
    pins: store.pins.value,
    pinsOff: pinsOff.value,
    touching: touching.value,
    drawing: drawing.value,
    drawn: drawn.value,
    moving: store.moving.value,
    floating: store.floating.value,
    shaping: store.shaping.value,
    chosenOffset: store.chosenOffset.value,
    demand: store.demand.value,
    reference: reference.value,
    heard: sound.value?.peaks.length,
  };
}

let changes = 0;
let watching = false;
const waiting = new Set<() => void>();

/** Marks a state: other loads of the page have other marks. */
const mark = (): string => `${store.TAB}.${changes}`;

function watch(): void {
  if (watching) return;
  watching = true;
  effect(() => {
    snapshot();
    changes++;
    for (const wake of waiting) wake();
    waiting.clear();
  });
}

const hooks = {
  /** The state as soon as it is not the one of this mark any more, at the latest after so long. */
  after: async (seen: string, ms: number): Promise<{ mark: string; state: Snapshot }> => {
    watch();
    if (mark() === seen) {
      await new Promise<void>((wake) => {
        waiting.add(wake);
        setTimeout(wake, ms);
      });
      // What the page does about the change at once, such as selecting a key that has moved, comes first.
      await new Promise((next) => setTimeout(next));
    }
    return { mark: mark(), state: snapshot() };
  },
  /** The second of the reference that is shown, and whether it plays. */
  reference: () => ({ at: media.currentTime, paused: media.paused, rate: media.playbackRate }),
  dismissAll: () => void (store.toasts.value = []),
  redraw: () => measured.paint(),
  frameToX: (frame: number) => testPoints().frameToX(frame),
  graphY: (joint: number, value: number) => graphPoints.yOf(joint, value),
  graphHandles: () => graphPoints.handles(),
  rowToY: (name: string) => testPoints().rowToY(name),
};

declare global {
  interface Window {
    __studio: typeof hooks;
  }
}

export function publish(): void {
  window.__studio = hooks;
}
