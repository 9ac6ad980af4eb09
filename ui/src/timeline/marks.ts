// What of the keys is in sight, and where: laid out once for a redraw, not once for a row. Pure.
//
// A clip may have thousands of keys on two dozen rows. Only what is in sight is laid out; where
// keys stand closer than the eye parts them, one diamond stands for several.

import { type Clip, type Fill, fillAfter, keyEnd, values } from "../clip";
import { type Box, frameToX, LABELS, pointOf, type View } from "./layout";

/** How a shape is drawn. */
export type Ink = "masked" | "held" | "linear" | "cubic" | "hold" | "part" | "whole" | "selected";

/** A key as it is drawn in a row: a diamond, its hold and what follows. */
export interface Glyph {
  /** Of the diamond, of the end of its hold and of the next key; pixels. */
  x: number;
  hold: number;
  until: number | undefined;
  /** Of the end of the clip, where the value is kept until then; pixels. */
  kept: number | undefined;
  fill: Fill;
  /** For more than one frame: a bar. */
  held: boolean;
  selected: boolean;
  /** Whether the row that is drawn has a goal for all of its joints. */
  whole: boolean;
}

/** A key with what it has for all joints. */
export interface Mark extends Glyph {
  frame: number;
  /** Of the end of the clip, pixels. */
  end: number;
  /** Every joint has a goal. */
  full: boolean;
  /** The points that its end-effector goals place. */
  points: string[];
  /** Which joints have one. */
  row: (number | null)[];
  /** Of the next key of a joint, and of the next one that may move the points; pixels. */
  next: (joint: number) => number | undefined;
  nextPlaced: () => number | undefined;
}

/** Diamonds nearer than this, pixels, are one. */
const APART = 1.25;

/** The keys that are in sight, or whose bars are. */
export function marks(
  clip: Clip,
  view: View,
  box: Box,
  dragged: ReadonlyMap<number, number>,
  selection: ReadonlySet<number>,
): Mark[] {
  const list: Mark[] = [];
  const { keys } = clip;
  const order = orderOf(clip);
  const place = (frame: number): number => dragged.get(frame) ?? frame;
  const placed = (i: number): number | undefined => {
    const key = keys[i];
    return key && place(key.frame);
  };
  const atX = (i: number): number | undefined => {
    const frame = placed(i);
    return frame === undefined ? undefined : frameToX(view, frame);
  };
  /** Whether a bar ends in sight or to the right of it; after the last key it does not end. */
  const into = (next: number | undefined): boolean => (placed(next ?? -1) ?? Infinity) >= view.left;
  /** Whether a bar of a key reaches into sight, of some joint or of a point. */
  const reaches = (i: number, row: (number | null)[]): boolean =>
    row.some((v, j) => v !== null && into(order.next[j]?.[i])) ||
    ((keys[i]?.reach?.length ?? 0) > 0 && into(order.placed[i]));
  // Without a drag keys are in order: begin at the first whose bar can reach into sight.
  let i = dragged.size || order.partial ? 0 : Math.max(0, firstAt(keys, view.left) - 1);
  const last = view.left + (box.width - LABELS) / view.zoom + 8 / view.zoom;
  const end = frameToX(view, clip.length);
  for (; i < keys.length; i++) {
    const [key, index] = [keys[i], i];
    if (!key) break;
    const at = place(key.frame);
    if (at > last) {
      if (dragged.size) continue;
      break;
    }
    const row = values(clip, key);
    // Laying a key out takes longer than seeing that it is far away.
    const hold = keyEnd(key) + at - key.frame;
    if (order.partial && at < view.left - 8 / view.zoom && hold < view.left && !reaches(i, row)) continue;
    const next = keys[i + 1];
    const fill = fillAfter(clip, key);
    const full = isFull(row);
    const mark: Mark = {
      frame: key.frame,
      x: frameToX(view, at),
      hold: frameToX(view, hold),
      until: next && frameToX(view, place(next.frame)),
      end,
      kept: !next && fill !== "mask" ? end : undefined,
      fill,
      held: (key.hold ?? 1) > 1,
      selected: selection.has(key.frame),
      full,
      points: key.reach?.map(pointOf) ?? [],
      row,
      whole: full,
      next: (joint) => atX(order.next[joint]?.[index] ?? -1),
      nextPlaced: () => atX(order.placed[index] ?? -1),
    };
    if (order.partial || isSeen(mark)) list.push(mark);
  }
  return list;
}

const isFull = (row: (number | null)[]): boolean => row.length > 0 && !row.includes(null);

/** Whether a key or its bars reach to the right of the names. */
const isSeen = (m: Glyph): boolean => Math.max(m.x + 8, m.hold, m.until ?? 0, m.kept ?? 0) >= LABELS;

/** Which key comes after which; -1 after the last. */
interface Order {
  /** Some key is for some joints only. */
  partial: boolean;
  /** By joint and key: the next key of the joint. */
  next: Int32Array[];
  /** By key: the next one that may move points, with end-effector goals or a value for every joint. */
  placed: Int32Array;
}

const orders = new WeakMap<Clip, Order>();

/** A clip is never changed, so it is looked through once. */
function orderOf(clip: Clip): Order {
  const known = orders.get(clip);
  if (known) return known;
  const after = (is: (i: number) => boolean): Int32Array => {
    const all = new Int32Array(clip.keys.length);
    for (let i = all.length - 1, next = -1; i >= 0; i--) {
      all[i] = next;
      if (is(i)) next = i;
    }
    return all;
  };
  const rows = clip.keys.map((key) => values(clip, key));
  const reach = clip.keys.map((key) => (key.reach?.length ?? 0) > 0);
  const full = rows.map(isFull);
  const partial = full.includes(false);
  const placed = after((i) => reach[i] || full[i] === true);
  // What end-effector goals lead to is a value, too.
  const ofJoint = (j: number): Int32Array => after((i) => reach[i] || typeof rows[i]?.[j] === "number");
  const order = { partial, placed, next: clip.robot.joints.map((_, j) => (partial ? ofJoint(j) : placed)) };
  orders.set(clip, order);
  return order;
}

/** Whether some key is for some joints only. */
export const isPartial = (clip: Clip): boolean => orderOf(clip).partial;

/** Index of the first key at or after a frame. */
function firstAt(keys: { frame: number }[], frame: number): number {
  let [lo, hi] = [0, keys.length];
  while (lo < hi) {
    const mid = (lo + hi) >> 1;
    if ((keys[mid]?.frame ?? 0) < frame) lo = mid + 1;
    else hi = mid;
  }
  return lo;
}

/** The keys that have a goal in this row. Holds and fills go as far as the row's joints go that have no key of their
 * own before. Without `joints` it is the row of all, which shows every key. */
export function ofRow(list: Mark[], joints: number[] | undefined): Glyph[] {
  const made: Glyph[] = [];
  for (const m of list) {
    let [own, hold, until, last] = [0, m.x, Number.NEGATIVE_INFINITY, false];
    for (let k = 0; k < (joints ?? m.row).length; k++) {
      const j = joints ? (joints[k] ?? -1) : k;
      if (typeof m.row[j] !== "number") continue;
      own++;
      const next = m.next(j);
      hold = Math.max(hold, Math.min(m.hold, next ?? m.hold));
      if (next === undefined) last = true;
      else until = Math.max(until, next);
    }
    if (own === 0 && joints) continue;
    const shape: Glyph = {
      x: m.x,
      hold: own ? hold : m.hold,
      until: own === 0 ? m.until : until === Number.NEGATIVE_INFINITY ? undefined : until,
      kept: own === 0 ? m.kept : last && m.fill !== "mask" ? m.end : undefined,
      fill: m.fill,
      held: m.held,
      selected: m.selected,
      whole: joints ? own === joints.length : m.full,
    };
    if (isSeen(shape)) made.push(shape);
  }
  return made;
}

/** The keys that place this point; a key for some joints only is taken for one that does not move it. */
export function ofPoint(list: Mark[], name: string): Glyph[] {
  return list
    .filter((m) => m.points.includes(name))
    .map((m) => ({ ...m, until: m.nextPlaced(), whole: true }));
}

export interface Bar {
  ink: Ink;
  from: number;
  to: number;
}

/** Holds and fills; those of one kind that touch are one. */
export function bars(list: Glyph[]): Bar[] {
  const made: Bar[] = [];
  const open = new Map<Ink, Bar>();
  const add = (ink: Ink, from: number, to: number): void => {
    const before = open.get(ink);
    if (before && from >= before.from && from - before.to < APART) before.to = Math.max(before.to, to);
    else {
      const b = { ink, from, to };
      open.set(ink, b);
      made.push(b);
    }
  };
  for (const m of list) {
    if (m.until !== undefined && m.until > m.hold) {
      add(m.fill === "hold" ? "held" : m.fill === "mask" ? "masked" : m.fill, m.hold, m.until);
    }
    if (m.kept !== undefined && m.kept > m.hold) add("held", m.hold, m.kept);
    if (m.held) add("hold", m.x, m.hold);
  }
  return made;
}

/** Keys of dense motion that stand no further apart are one band, pixels. */
const DENSE = 14;

/** Bands from the first to the last key of dense motion. A dragged key may stand anywhere among the others. */
export function bands(list: Glyph[]): { from: number; to: number }[] {
  const made: { from: number; to: number }[] = [];
  for (const x of list.map((m) => m.x).sort((a, b) => a - b)) {
    const last = made.at(-1);
    if (last && x - last.to <= DENSE) last.to = x;
    else made.push({ from: x, to: x });
  }
  return made;
}

export interface Diamond {
  ink: "part" | "whole" | "selected";
  x: number;
}

/** Diamonds, as many as the eye can part. */
export function diamonds(list: Glyph[]): Diamond[] {
  const last = new Map<string, number>();
  return list.flatMap((m) => {
    const ink = m.selected ? "selected" : m.whole ? "whole" : "part";
    const before = last.get(ink);
    if (before !== undefined && Math.abs(m.x - before) < APART) return [];
    last.set(ink, m.x);
    return [{ ink, x: m.x }];
  });
}
