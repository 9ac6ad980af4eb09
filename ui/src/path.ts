// The path of what is selected, in the 3D view: what a hand on it does to the clip.

import { keyAt } from "./clip";
import { addedAt } from "./layers";
import { addPose } from "./posing";
import * as store from "./store";

/**
 * A diamond was taken or clicked: its key is the one that is edited. With values, the line was
 * clicked where it has no key: it gets one that leaves the path as it is.
 */
export function pathTouched(frame: number, values: Record<string, number> | null): void {
  const clip = store.doc.value?.clip;
  if (!clip || frame >= clip.length) return;
  store.playhead.value = frame;
  // Where a hand adds to the motion, the line needs no key.
  if (!values || keyAt(clip, frame) || store.shaping.value) {
    store.selection.value = keyAt(clip, frame) ? new Set([frame]) : new Set();
    return;
  }
  const q = clip.robot.joints.map((name, j) => {
    const value = values[name];
    return value === undefined ? null : value - addedAt(clip, j, frame);
  });
  void addPose(frame, q);
}
