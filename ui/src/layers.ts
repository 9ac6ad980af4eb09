// Offsets over the keys of a clip, and blocks of frames: what src/clip/offset.rs says of them. Pure.

import type { Clip, Marker } from "./clip";
import type { Offset } from "./protocol";

/** A marker with an end. */
export type Block = Marker & { to: number };

const hold = (o: Offset): number => Math.max(1, o.hold ?? 1);
/** Frames over which an offset grows and fades where its file does not say so. */
export const FADE = 10;

/** The share of an offset that is there at a frame, 0 to 1: the minimum-jerk profile. */
export function weight(o: Offset, frame: number): number {
  const away = frame < o.frame ? o.frame - frame : Math.max(0, frame + 1 - o.frame - hold(o));
  const fade = (frame < o.frame ? o.in : o.out) ?? FADE;
  if (away === 0) return 1;
  if (away >= fade) return 0;
  const s = 1 - away / fade;
  return s * s * s * (10 - s * (15 - 6 * s));
}

/** The first frame that an offset changes, and the one after the last. */
export function spanOf(o: Offset, length: number): { from: number; to: number } {
  const from = o.frame + 1 - Math.max(1, o.in ?? FADE);
  const to = o.frame + hold(o) + Math.max(1, o.out ?? FADE) - 1;
  return { from: Math.max(0, from), to: Math.min(length, to) };
}

/** What all offsets add to a joint at a frame, rad or m. */
export function addedAt(clip: Clip, joint: number, frame: number): number {
  const name = clip.robot.joints[joint];
  let sum = 0;
  for (const o of clip.offsets ?? []) {
    const value = name === undefined ? undefined : o.add[name];
    if (value) sum += value * weight(o, frame);
  }
  return sum;
}

export function offsetAt(clip: Clip, frame: number): Offset | undefined {
  return clip.offsets?.find((o) => o.frame === frame);
}

export function blocksOf(clip: Clip): Block[] {
  return (clip.markers ?? []).filter((m): m is Block => m.to !== undefined);
}

export function blockAt(clip: Clip, frame: number): Block | undefined {
  return blocksOf(clip).find((b) => b.frame <= frame && frame < b.to);
}

/** The first frames of all blocks after one of them was moved to another place among them. */
export function reordered(blocks: Block[], frame: number, place: number): number[] {
  const others = blocks.map((b) => b.frame).filter((f) => f !== frame);
  others.splice(Math.max(0, Math.min(others.length, place)), 0, frame);
  return others;
}

/** Motion with a key at nearly every frame: it is shaped from above, not key by key. */
export function isDense(clip: Clip): boolean {
  const { keys } = clip;
  if (keys.length < 20) return false;
  const close = keys.filter((k, i) => i > 0 && k.frame - (keys[i - 1]?.frame ?? 0) <= 2).length;
  return close > 0.8 * (keys.length - 1);
}

/** The edit that makes the command of these joints at a frame what a hand wants, by what is added
 * to it there. A new offset grows and fades over so many frames. */
export function shapes(
  clip: Clip,
  frame: number,
  wanted: Record<string, number>,
  commanded: (joint: number) => number | undefined,
  fade: number,
): { frame: number; add: Record<string, number>; in?: number; out?: number } | undefined {
  const own = offsetAt(clip, frame);
  const add: Record<string, number> = {};
  for (const [name, value] of Object.entries(wanted)) {
    const joint = clip.robot.joints.indexOf(name);
    const now = joint < 0 ? undefined : commanded(joint);
    if (now === undefined || Math.abs(value - now) < 5e-7) continue;
    add[name] = Math.round(((own?.add[name] ?? 0) + value - now) * 1e6) / 1e6;
  }
  if (Object.keys(add).length === 0) return undefined;
  return own ? { frame, add } : { frame, add, in: fade, out: fade };
}
