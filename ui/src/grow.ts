// Keys beyond the end of a clip: it grows for them in the same edit. Pure.

import { type Clip, type Key, keyEnd } from "./clip";
import type { Op } from "./protocol";

/** An edit after which keys end at these frames, and the new length of the clip if it has to grow for them. */
export function grown(
  clip: Clip,
  op: Op,
  ends: readonly number[],
  label: string,
): { op: Op; length?: number } {
  const length = Math.max(...ends, clip.length);
  if (length === clip.length) return { op };
  return { op: { op: "batch", args: { label, ops: [{ op: "clip.length", args: { length } }, op] } }, length };
}

/** The frames after keys that go to other frames. A key of one frame stays one; a longer hold ends where its end goes. */
export function endsOf(keys: readonly Key[], to: (frame: number) => number): number[] {
  return keys.map((k) => {
    const least = to(k.frame) + 1;
    return (k.hold ?? 1) > 1 ? Math.max(least, to(keyEnd(k))) : least;
  });
}

/** The frame that stays where it is when keys are retimed: the playhead if it is among them, else the first of them.
 * One key alone has only its distance to the playhead. */
export function pivotOf(frames: readonly number[], playhead: number): number {
  const [first, last] = [Math.min(...frames), Math.max(...frames)];
  return frames.length < 2 || (first <= playhead && playhead <= last) ? playhead : first;
}
