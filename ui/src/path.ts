// The path of what is selected, in the 3D view: what a hand on it does to the clip.

import { keyAt, newKey } from "./clip";
import { addedAt } from "./layers";
import { unlocked } from "./locks";
import * as store from "./store";
import { edit } from "./wire";

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
  const q = clip.robot.joints.map((name, j) => (values[name] ?? 0) - addedAt(clip, j, frame));
  void edit("keys.add", { keys: [newKey(clip, frame, unlocked(q))] }).then((ok) => {
    if (ok) store.selection.value = new Set([frame]);
  });
}
