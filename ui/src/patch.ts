// What an edit changes of a clip.

import type { Clip, Delta } from "./protocol";

/** Applies a difference to a copy of the clip. */
export function patched(clip: Clip, d: Delta): Clip {
  const next: Clip = { ...clip };
  if (d.keys_removed || d.keys_put) {
    const gone = new Set([...(d.keys_removed ?? []), ...(d.keys_put ?? []).map((k) => k.frame)]);
    next.keys = [...clip.keys.filter((k) => !gone.has(k.frame)), ...(d.keys_put ?? [])];
    next.keys.sort((a, b) => a.frame - b.frame);
  }
  if (d.poses_removed || d.poses_put) {
    const poses = { ...clip.poses };
    for (const name of d.poses_removed ?? []) delete poses[name];
    for (const [name, q] of d.poses_put ?? []) poses[name] = q;
    next.poses = poses;
  }
  if (d.offsets) next.offsets = d.offsets;
  if (d.masks) next.masks = d.masks;
  if (d.markers) next.markers = d.markers;
  if (d.name !== undefined) next.name = d.name;
  if (d.notes !== undefined) next.notes = d.notes;
  if (d.length !== undefined) next.length = d.length;
  if (d.fill !== undefined) next.fill = d.fill;
  if (d.start === null) delete next.start;
  else if (d.start !== undefined) next.start = d.start;
  return next;
}
