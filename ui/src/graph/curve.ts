// One joint over time as the clip commands it: what `src/clip/compile.rs` makes of keys, fills and
// offsets, for drawing. Masks are left out: a curve shows what would be commanded. Pure.

import { type Clip, fillAfter, isOf, keyAt, keyEnd, values } from "../clip";
import { addedAt } from "../layers";
import type { Tangent } from "../protocol";

export interface Stretch {
  /** What leads from one key of the joint to the next. */
  kind: "masked" | "linear" | "cubic" | "hold" | "key";
  from: number;
  /** By frame from `from` on; a masked stretch has its two ends only. */
  values: number[];
  /** The last frame. */
  to: number;
}

interface Node {
  frame: number;
  /** The last frame that it is held. */
  last: number;
  /** Undefined where only the program knows what end-effector goals lead to. */
  value: number | undefined;
  fill: "mask" | "linear" | "cubic" | "hold";
  tangent: Tangent | undefined;
}

/** What is drawn many times in a second, by clip and joint. */
const known = new WeakMap<Clip, Map<number, Node[]>>();

/** The keys of this joint: a key says nothing about joints that it has no value for. */
function nodes(clip: Clip, joint: number): Node[] {
  const of = known.get(clip) ?? new Map<number, Node[]>();
  known.set(clip, of);
  const made = of.get(joint) ?? nodesOf(clip, joint);
  of.set(joint, made);
  return made;
}

function nodesOf(clip: Clip, joint: number): Node[] {
  const own = clip.keys.filter((key) => isOf(clip, key, joint));
  const name = clip.robot.joints[joint] ?? "";
  return own.map((key, i) => {
    const value = values(clip, key)[joint];
    return {
      frame: key.frame,
      last: Math.min(keyEnd(key), own[i + 1]?.frame ?? clip.length) - 1,
      value: typeof value === "number" && !key.reach?.length ? value : undefined,
      fill: fillAfter(clip, key),
      tangent: key.tangents?.[name],
    };
  });
}

/** Automatic slope at node `i` per frame: Fritsch and Butland's between two cubics, else none. */
function slope(all: Node[], i: number): number {
  const [before, here, after] = [all[i - 1], all[i], all[i + 1]];
  if (before?.value === undefined || here?.value === undefined || after?.value === undefined) return 0;
  if (before.fill !== "cubic" || here.fill !== "cubic" || here.last !== here.frame) return 0;
  const [h0, h1] = [here.frame - before.last, after.frame - here.frame];
  const [d0, d1] = [(here.value - before.value) / h0, (after.value - here.value) / h1];
  if (d0 * d1 <= 0) return 0;
  const [w0, w1] = [2 * h1 + h0, h1 + 2 * h0];
  return (w0 + w1) / (w0 / d0 + w1 / d1);
}

/** Slope per frame on one side of node `i`; `line` is that of the straight line there. */
function side(clip: Clip, all: Node[], i: number, at: "in" | "out", line: number): number {
  const set = all[i]?.tangent;
  if (set === undefined) return slope(all, i);
  if (set === "flat") return 0;
  if (set === "linear") return line;
  return (typeof set === "number" ? set : set[at]) / clip.fps;
}

function hermite(s: number, a: number, b: number, da: number, db: number): number {
  const [s2, s3] = [s * s, s * s * s];
  return (2 * s3 - 3 * s2 + 1) * a + (s3 - 2 * s2 + s) * da + (3 * s2 - 2 * s3) * b + (s3 - s2) * db;
}

/** How a curve passes a key. */
interface Passing {
  /** On the sides where a curve ends or begins: its slope there, units a frame, and its frames. */
  in?: { slope: number; width: number };
  out?: { slope: number; width: number };
  /** The last frame that the key is held. */
  last: number;
  set: boolean;
  smooth: boolean;
}

/** How curves pass the key at a frame; undefined where it has no goal for the joint. */
export function passing(clip: Clip, joint: number, frame: number): Passing | undefined {
  const all = nodes(clip, joint);
  const i = all.findIndex((n) => n.frame === frame);
  const here = all[i];
  if (here?.value === undefined) return undefined;
  const { tangent } = here;
  const made: Passing = {
    last: here.last,
    set: tangent !== undefined,
    smooth: tangent === undefined || tangent === "flat" || typeof tangent === "number",
  };
  const before = all[i - 1];
  if (before?.value !== undefined && before.fill === "cubic" && here.frame > before.last) {
    const width = here.frame - before.last;
    made.in = { width, slope: side(clip, all, i, "in", (here.value - before.value) / width) };
  }
  const next = all[i + 1];
  if (here.fill === "cubic" && next?.value !== undefined && next.frame > here.last) {
    const width = next.frame - here.last;
    made.out = { width, slope: side(clip, all, i, "out", (next.value - here.value) / width) };
  }
  return made;
}

/** The stretches of a joint's curve with what offsets add to it, in order. */
export function stretches(clip: Clip, joint: number): Stretch[] {
  const bare = bareStretches(clip, joint);
  const name = clip.robot.joints[joint] ?? "";
  if (!clip.offsets?.some((o) => o.add[name])) return bare;
  return bare.map((s) => ({
    ...s,
    values: s.values.map((v, i) => {
      const frame = s.kind === "masked" ? (i === 0 ? s.from : s.to) : s.from + i;
      return v + addedAt(clip, joint, frame);
    }),
  }));
}

/** The stretches of the keys alone. */
export function bareStretches(clip: Clip, joint: number): Stretch[] {
  const all = nodes(clip, joint);
  return all.flatMap((_, i) => after(clip, all, i));
}

/** The stretches from node `i` to the next one. */
function after(clip: Clip, all: Node[], i: number): Stretch[] {
  const n = all[i];
  const value = n?.value;
  if (!n || value === undefined) return [];
  const flat = (frames: number): number[] => new Array(frames + 1).fill(value);
  const made: Stretch[] = [];
  if (n.last > n.frame) made.push({ kind: "key", from: n.frame, to: n.last, values: flat(n.last - n.frame) });
  const next = all[i + 1];
  const until = next?.frame ?? clip.length - 1;
  if (until <= n.last) return made;
  const width = until - n.last;
  if (n.fill === "hold" || (!next && n.fill !== "mask"))
    return [...made, { kind: "hold", from: n.last, to: until, values: flat(width) }];
  const to = next?.value;
  if (to === undefined) return made;
  if (n.fill === "mask") return [...made, { kind: "masked", from: n.last, to: until, values: [value, to] }];
  const line = (to - value) / width;
  const ends = (): [number, number] => [
    side(clip, all, i, "out", line) * width,
    side(clip, all, i + 1, "in", line) * width,
  ];
  const [da, db] = n.fill === "cubic" ? ends() : [0, 0];
  const row = Array.from({ length: width + 1 }, (_, k) => {
    const s = k / width;
    return n.fill === "cubic" ? hermite(s, value, to, da, db) : value + s * (to - value);
  });
  return [...made, { kind: n.fill, from: n.last, to: until, values: row }];
}

/** The highest speed that a stretch asks for, units per frame. */
export function steepest(s: Stretch): number {
  if (s.kind === "masked") return Math.abs((s.values[1] ?? 0) - (s.values[0] ?? 0)) / (s.to - s.from);
  let most = 0;
  for (let i = 1; i < s.values.length; i++)
    most = Math.max(most, Math.abs((s.values[i] ?? 0) - (s.values[i - 1] ?? 0)));
  return most;
}

/** What the clip commands at a frame; undefined where it leaves the joint to the policy. */
export function commandedAt(clip: Clip, joint: number, frame: number): number | undefined {
  const key = keyAt(clip, frame);
  if (key && isOf(clip, key, joint)) {
    const value = key.reach?.length ? undefined : values(clip, key)[joint];
    return typeof value === "number" ? value + addedAt(clip, joint, frame) : undefined;
  }
  const all = nodes(clip, joint);
  const i = all.findLastIndex((n) => n.frame <= frame);
  for (const s of after(clip, all, i))
    if (s.kind !== "masked" && s.from <= frame && frame <= s.to) {
      const value = s.values[frame - s.from];
      return value === undefined ? undefined : value + addedAt(clip, joint, frame);
    }
  return undefined;
}
