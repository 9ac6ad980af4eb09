// Where values stand in the graph, which points are there, and what a drag makes of them. Pure.

import { type Clip, type Key, keyAt, values } from "../clip";
import type { JointFacts } from "../protocol";
import { type Box, frameToX, LABELS, RULER, type View } from "../timeline/layout";

/** Values at the lower and the upper edge; of normalised curves parts of the joint's range. */
export interface Span {
  lo: number;
  hi: number;
}

/** The least that the span covers: rad, m, or parts of a range. */
const LEAST = 0.1;

/** Room above and below the curves, pixels. */
const EDGE = 12;

export interface Space {
  view: View;
  box: Box;
  span: Span;
  /** Each curve by the range of its own joint. */
  normal: boolean;
  facts: JointFacts[];
}

/** A key's value for one joint. */
export interface Point {
  frame: number;
  joint: number;
  value: number;
}

/** The range by which a joint is normalised. */
function range(f: JointFacts | undefined): [number, number] {
  return f?.range ?? f?.band ?? (f?.unit === "m" ? [-1, 1] : [-Math.PI, Math.PI]);
}

export function seen(s: Space, joint: number, value: number): number {
  if (!s.normal) return value;
  const [lo, hi] = range(s.facts[joint]);
  return (value - lo) / (hi - lo);
}

/** Values that so much height stands for. */
export function perPixel(s: Space, joint: number): number {
  const [lo, hi] = s.normal ? range(s.facts[joint]) : [0, 1];
  return ((s.span.hi - s.span.lo) / (s.box.height - RULER - 2 * EDGE)) * (hi - lo);
}

export function valueToY(s: Space, joint: number, value: number): number {
  const share = (seen(s, joint, value) - s.span.lo) / (s.span.hi - s.span.lo);
  return s.box.height - EDGE - share * (s.box.height - RULER - 2 * EDGE);
}

/** What stands at a height, as it is seen. */
export function yToSeen(s: Space, y: number): number {
  return (
    s.span.lo + ((s.box.height - EDGE - y) / (s.box.height - RULER - 2 * EDGE)) * (s.span.hi - s.span.lo)
  );
}

export function yToValue(s: Space, joint: number, y: number): number {
  const [lo, hi] = s.normal ? range(s.facts[joint]) : [0, 1];
  return lo + yToSeen(s, y) * (hi - lo);
}

/** All values of these joints in sight, with some room. */
export function fitSpan(s: Space, clip: Clip, joints: number[], reached: number[][]): Span {
  let [lo, hi] = [Infinity, -Infinity];
  const meet = (joint: number, v: number | null | undefined): void => {
    if (typeof v !== "number") return;
    const at = seen(s, joint, v);
    lo = Math.min(lo, at);
    hi = Math.max(hi, at);
  };
  for (const j of joints) {
    for (const key of clip.keys) meet(j, values(clip, key)[j]);
    for (const q of reached) meet(j, q[j]);
  }
  if (lo > hi) return { lo: -1, hi: 1 };
  const pad = Math.max((hi - lo) * 0.12, (LEAST - (hi - lo)) / 2);
  return { lo: lo - pad, hi: hi + pad };
}

/** The points of these joints. */
export function points(clip: Clip, joints: number[]): Point[] {
  return clip.keys.flatMap((key) => {
    const row = values(clip, key);
    return joints.flatMap((joint) => {
      const value = row[joint];
      return typeof value === "number" ? [{ frame: key.frame, joint, value }] : [];
    });
  });
}

export const nameOf = (p: Pick<Point, "frame" | "joint">): string => `${p.frame}:${p.joint}`;

/** The point under a pixel; the first joint wins where several meet. */
export function pointAt(s: Space, all: Point[], x: number, y: number): Point | undefined {
  let best: Point | undefined;
  let near = 9;
  for (const p of all) {
    const d = Math.hypot(frameToX(s.view, p.frame) - x, valueToY(s, p.joint, p.value) - y);
    if (d < near) [near, best] = [d, p];
  }
  return x < LABELS ? undefined : best;
}

/** Values that a drag gives to points: frame, then joint, to value; inside the ranges of the joints. */
export type Changes = Map<number, Map<number, number>>;

export function raised(s: Space, chosen: Point[], pixels: number): Changes {
  const made: Changes = new Map();
  for (const p of chosen) {
    const wanted = p.value + pixels * perPixel(s, p.joint);
    const r = s.facts[p.joint]?.range;
    const value = r ? Math.min(r[1], Math.max(r[0], wanted)) : wanted;
    const row = made.get(p.frame) ?? new Map<number, number>();
    row.set(p.joint, Math.round(value * 1e6) / 1e6);
    made.set(p.frame, row);
  }
  return made;
}

/** The clip as a drag would leave it, to be drawn until it is one. As with `keys.move`, a key that lands on another
 * one takes over the joints that it says nothing about. */
export function dragged(clip: Clip, changes: Changes, to: ReadonlyMap<number, number>): Clip {
  const landing = new Set(to.values());
  const keys = clip.keys
    .filter((k) => to.has(k.frame) || !landing.has(k.frame))
    .map((k): Key => {
      const frame = to.get(k.frame) ?? k.frame;
      const row = changes.get(k.frame);
      const own = clip.robot.joints.map((_, j) => row?.get(j) ?? values(clip, k)[j] ?? null);
      const open = own.includes(null) && !k.reach?.length && frame !== k.frame && !to.has(frame);
      const under = open ? keyAt(clip, frame) : undefined;
      if (!row && !under) return { ...k, frame };
      const { pose: _, ...rest } = k;
      return under ? joined(clip, { ...rest, q: own, frame }, under) : { ...rest, q: own, frame };
    });
  return { ...clip, keys: keys.sort((a, b) => a.frame - b.frame) };
}

/** A key that has taken the place of another one: joints that it says nothing about keep their values and slopes. */
function joined(clip: Clip, key: Key, under: Key): Key {
  const below = values(clip, under);
  const kept = clip.robot.joints.filter((_, j) => key.q?.[j] === null);
  const slopes = Object.entries(under.tangents ?? {}).filter(([name]) => kept.includes(name));
  return {
    ...key,
    q: clip.robot.joints.map((_, j) => key.q?.[j] ?? below[j] ?? null),
    tangents: { ...key.tangents, ...Object.fromEntries(slopes) },
  };
}
