// The document as the server sends it, and the few questions that drawing asks of it. All
// edits are made by the server; nothing here changes a clip.

import type { Clip, Fill, Key } from "./protocol";

export type { Clip, Fill, Key, Marker, Mask } from "./protocol";

/** Frames a second; a clip of another rate is refused. */
export const FPS = 20;

/** Frames that a key commands: its own and its hold. */
export function keyEnd(key: Key): number {
  return key.frame + Math.max(1, key.hold ?? 1);
}

/** What follows a key until the next one of each joint. */
export function fillAfter(clip: Clip, key: Key): Fill {
  return key.fill ?? clip.fill ?? "mask";
}

/** Values of a key, whether written out or by the name of a pose. */
export function values(clip: Clip, key: Key): (number | null)[] {
  if (key.q) return key.q;
  return (key.pose !== undefined && clip.poses?.[key.pose]) || [];
}

/** Whether a key is one of a joint: it has a value for it, or its end-effector goals may lead to one. */
export function isOf(clip: Clip, key: Key, joint: number): boolean {
  return typeof values(clip, key)[joint] === "number" || (key.reach?.length ?? 0) > 0;
}

/** Joints of a key that a pose would change. Those that the key leaves open stay open. Where end-effector goals
 * decide, only the program knows their values, so the pose sets all that it has. */
export function changedBy(clip: Clip, key: Key, pose: (number | null)[]): Record<string, number> {
  const held = values(clip, key);
  const solved = (key.reach?.length ?? 0) > 0;
  return Object.fromEntries(
    clip.robot.joints.flatMap((name, j) => {
      const [was, now] = [held[j], pose[j]];
      if (typeof now !== "number") return [];
      // Values live on a grid of 1e-6.
      const changes = solved || (typeof was === "number" && Math.abs(now - was) > 5e-7);
      return changes ? [[name, now]] : [];
    }),
  );
}

/** Mean distance of the robot from a key at frame 0 when the motion begins; undefined without one. */
export function startsAway(clip: Clip, first: number[] | undefined): number | undefined {
  const key = keyAt(clip, 0);
  if (!key || !first || clip.masks?.some((m) => m.from === 0 && !m.joints)) return undefined;
  const off = values(clip, key).flatMap((v, j) =>
    typeof v === "number" ? [Math.abs(v - (first[j] ?? v))] : [],
  );
  return off.length ? off.reduce((a, b) => a + b, 0) / off.length : undefined;
}

/** How many keys would lose their place to these: keys that stand where others land. */
export function replaced(clip: Clip, landing: Iterable<number>, leaving: Iterable<number> = []): number {
  const gone = new Set(leaving);
  const to = new Set(landing);
  return clip.keys.filter((k) => to.has(k.frame) && !gone.has(k.frame)).length;
}

export function keyAt(clip: Pick<Clip, "keys">, frame: number): Key | undefined {
  return clip.keys.find((k) => k.frame === frame);
}

/** The last key before a frame, of all joints or of one. */
export function prevKey(clip: Clip, frame: number, joint?: number): Key | undefined {
  return clip.keys.findLast((k) => k.frame < frame && (joint === undefined || isOf(clip, k, joint)));
}

/** The first key after a frame, of all joints or of one. */
export function nextKey(clip: Clip, frame: number, joint?: number): Key | undefined {
  return clip.keys.find((k) => k.frame > frame && (joint === undefined || isOf(clip, k, joint)));
}

/** A new key. Between two keys the fill of the first goes on after it: of one joint, or of the last whole key. */
export function newKey(clip: Clip, frame: number, q: (number | null)[], joint?: number): Key {
  const isWhole = (k: Key): boolean => values(clip, k).every((v) => typeof v === "number");
  const whole = clip.keys.findLast((k) => k.frame < frame && isWhole(k));
  const before = joint === undefined ? whole : prevKey(clip, frame, joint);
  const fill = nextKey(clip, frame, joint) && before?.fill;
  return { frame, q, ...(fill && { fill }) };
}

/** A frame as seconds for people, such as `2.75 s`. */
export function clock(frame: number, fps: number): string {
  return `${(frame / fps).toFixed(2)} s`;
}

/**
 * Time as typed: `2:15` is 2 s and 15 frames, `55f` or `55` are frames, `2.75s` are seconds.
 * Always a whole frame; undefined when it is no time.
 */
export function parseTime(text: string, fps: number): number | undefined {
  const t = text.trim();
  const pair = /^(\d+):(\d+)$/.exec(t);
  if (pair) return Number(pair[1]) * fps + Number(pair[2]);
  const frames = /^(\d+)f?$/.exec(t);
  if (frames) return Number(frames[1]);
  const secs = /^(\d+(?:\.\d*)?|\.\d+)s$/.exec(t);
  if (secs) return Math.round(Number(secs[1]) * fps);
  return undefined;
}
