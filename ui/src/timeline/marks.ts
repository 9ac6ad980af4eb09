// What of the keys is in sight, and where: laid out once for a redraw, not once for a row. Pure.
//
// A clip may have thousands of keys on two dozen rows. Only what is in sight is laid out; where
// keys stand closer than the eye parts them, one diamond stands for several.

import { type Clip, type Fill, fillAfter, keyEnd, values } from "../clip";
import { type Box, frameToX, LABELS, pointOf, type View } from "./layout";

/** How a shape is drawn. */
export type Ink = "masked" | "held" | "linear" | "cubic" | "hold" | "part" | "whole" | "selected";

export interface Mark {
  frame: number;
  /** Of the diamond, of the end of its hold and of the next key; pixels. */
  x: number;
  hold: number;
  until: number | undefined;
  fill: Fill;
  /** For more than one frame: a bar. */
  held: boolean;
  selected: boolean;
  /** Every joint has a goal. */
  full: boolean;
  /** The points that its end-effector goals place. */
  points: string[];
  /** Which joints have one. */
  row: (number | null)[];
  /** Whether the row that is drawn has a goal for all of its joints. */
  whole: boolean;
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
  const place = (frame: number): number => dragged.get(frame) ?? frame;
  // Without a drag keys are in order: begin at the first whose bar can reach into sight.
  let i = dragged.size ? 0 : Math.max(0, firstAt(keys, view.left) - 1);
  const last = view.left + (box.width - LABELS) / view.zoom + 8 / view.zoom;
  for (; i < keys.length; i++) {
    const key = keys[i];
    if (!key) break;
    const at = place(key.frame);
    if (at > last) {
      if (dragged.size) continue;
      break;
    }
    const next = keys[i + 1];
    const x = frameToX(view, at);
    const hold = frameToX(view, keyEnd(key) + at - key.frame);
    const until = next && frameToX(view, place(next.frame));
    if (Math.max(x + 8, hold, until ?? 0) < LABELS) continue;
    const row = values(clip, key);
    const full = row.length > 0 && !row.includes(null);
    list.push({
      frame: key.frame,
      x,
      hold,
      until,
      fill: fillAfter(clip, key),
      held: (key.hold ?? 1) > 1,
      selected: selection.has(key.frame),
      full,
      points: key.reach?.map(pointOf) ?? [],
      row,
      whole: full,
    });
  }
  return list;
}

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

/** Of keys with open joints those that have a goal in this row. */
export function ofRow(list: Mark[], joints: number[] | undefined): Mark[] {
  return list.flatMap((m) => {
    const there = joints ? joints.filter((j) => typeof m.row[j] === "number").length : 1;
    return there === 0 ? [] : [{ ...m, whole: joints !== undefined && there === joints.length }];
  });
}

/** Of keys with end-effector goals those that place this point. */
export function ofPoint(list: Mark[], name: string): Mark[] {
  return list.filter((m) => m.points.includes(name)).map((m) => ({ ...m, whole: true }));
}

export interface Bar {
  ink: Ink;
  from: number;
  to: number;
}

/** Holds and fills; those of one kind that touch are one. */
export function bars(list: Mark[]): Bar[] {
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
    if (m.held) add("hold", m.x, m.hold);
  }
  return made;
}

export interface Diamond {
  ink: "part" | "whole" | "selected";
  x: number;
}

/** Diamonds, as many as the eye can part. */
export function diamonds(list: Mark[]): Diamond[] {
  const last = new Map<string, number>();
  return list.flatMap((m) => {
    const ink = m.selected ? "selected" : m.whole ? "whole" : "part";
    const before = last.get(ink);
    if (before !== undefined && Math.abs(m.x - before) < APART) return [];
    last.set(ink, m.x);
    return [{ ink, x: m.x }];
  });
}
