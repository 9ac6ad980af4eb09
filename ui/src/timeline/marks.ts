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
  /** Of the end of the clip, and the same where the value is kept until then; pixels. */
  end: number;
  kept: number | undefined;
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

/** The keys that are in sight, or whose bars are. If some are for some joints only, all keys: each joint has its
 * own next key. */
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
  const every = dragged.size > 0 || isPartial(clip);
  // Without a drag keys are in order: begin at the first whose bar can reach into sight.
  let i = every ? 0 : Math.max(0, firstAt(keys, view.left) - 1);
  const last = view.left + (box.width - LABELS) / view.zoom + 8 / view.zoom;
  const end = frameToX(view, clip.length);
  for (; i < keys.length; i++) {
    const key = keys[i];
    if (!key) break;
    const at = place(key.frame);
    if (at > last && !isPartial(clip)) {
      if (dragged.size) continue;
      break;
    }
    const next = keys[i + 1];
    const fill = fillAfter(clip, key);
    const row = values(clip, key);
    const full = isFull(row);
    const mark: Mark = {
      frame: key.frame,
      x: frameToX(view, at),
      hold: frameToX(view, keyEnd(key) + at - key.frame),
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
    };
    if (isPartial(clip) || isSeen(mark)) list.push(mark);
  }
  return list;
}

const isFull = (row: (number | null)[]): boolean => row.length > 0 && !row.includes(null);

/** Whether a key or its bars reach to the right of the names. */
const isSeen = (m: Mark): boolean => Math.max(m.x + 8, m.hold, m.until ?? 0, m.kept ?? 0) >= LABELS;

const partial = new WeakMap<Clip, boolean>();

/** Whether some key is for some joints only. A clip is never changed, so it is looked through once. */
export function isPartial(clip: Clip): boolean {
  const known = partial.get(clip);
  if (known !== undefined) return known;
  const is = clip.keys.some((key) => !isFull(values(clip, key)));
  partial.set(clip, is);
  return is;
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

/** The keys that have a goal in this row, as far as `right`, pixels. Holds and fills go as far as the row's joints
 * go that have no key of their own before. `list` has all keys. */
export function ofRow(list: Mark[], joints: number[] | undefined, right = Infinity): Mark[] {
  const dim = list.reduce((most, m) => Math.max(most, m.row.length), 0);
  const row = joints ?? Array.from({ length: dim }, (_, j) => j);
  /** Where the next key of each joint is. */
  const next = new Map<number, number>();
  const made: Mark[] = [];
  for (const m of [...list].reverse()) {
    const own = row.filter((j) => typeof m.row[j] === "number");
    const ends = own.map((j) => next.get(j));
    // What end-effector goals lead to is a value, too.
    for (const j of m.points.length ? row : own) next.set(j, m.x);
    if (m.x > right || (own.length === 0 && joints)) continue;
    const after = ends.filter((x) => x !== undefined);
    const mark: Mark = own.length
      ? {
          ...m,
          hold: Math.max(m.x, ...ends.map((x) => Math.min(m.hold, x ?? m.hold))),
          until: after.length ? Math.max(...after) : undefined,
          kept: after.length < ends.length && m.fill !== "mask" ? m.end : undefined,
          whole: joints !== undefined && own.length === joints.length,
        }
      : { ...m, whole: false };
    if (isSeen(mark)) made.push(mark);
  }
  return made.reverse();
}

/** The keys that place this point; a key for some joints only is taken for one that does not move it. */
export function ofPoint(list: Mark[], name: string): Mark[] {
  let next: Mark | undefined;
  const made: Mark[] = [];
  for (const m of [...list].reverse()) {
    if (m.points.includes(name)) made.push({ ...m, until: next?.x, whole: true });
    if (m.points.length || m.full) next = m;
  }
  return made.reverse();
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
    if (m.kept !== undefined && m.kept > m.hold) add("held", m.hold, m.kept);
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
