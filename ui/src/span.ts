// Spans of frames: what the loop plays, what M and U act on. Pure.

import { type Clip, keyAt, keyEnd, nextKey, prevKey } from "./clip";
import type { Lint } from "./protocol";

/** Frames from `from` up to, not with, `to`. */
export interface Span {
  from: number;
  to: number;
}

/** What is left of a span in a clip of this length; undefined when that is nothing. */
export function within(span: Span | undefined, length: number): Span | undefined {
  if (!span || span.to <= length) return span;
  return span.from < length - 1 ? { from: span.from, to: length } : undefined;
}

export type Why =
  | "the selected keys"
  | "after the selected key"
  | "the loop range"
  | "the interval at the playhead";

/** The frames that M and U act on: the nearest thing that a person has pointed out. An interval is one between keys
 * of a joint, if there is one. */
export function acted(
  clip: Clip,
  selected: ReadonlySet<number>,
  range: Span | undefined,
  at: number,
  joint?: number,
): (Span & { why: Why }) | undefined {
  const frames = clip.keys.map((k) => k.frame).filter((f) => selected.has(f));
  const [first, last] = [frames[0], frames.at(-1)];
  let span: Span & { why: Why };
  if (first !== undefined && last !== undefined && first !== last)
    span = { from: first + 1, to: last, why: "the selected keys" };
  else {
    if (first === undefined && range) return { ...range, why: "the loop range" };
    const before = first !== undefined ? keyAt(clip, first) : prevKey(clip, at + 1, joint);
    const after = nextKey(clip, first ?? at, joint);
    span = {
      from: before ? keyEnd(before) : 0,
      to: after?.frame ?? clip.length,
      why: first !== undefined ? "after the selected key" : "the interval at the playhead",
    };
  }
  return span.to > span.from ? span : undefined;
}

/**
 * Where a clock stands after `frames` more of them, in a loop whose every frame, the last too,
 * stands for one period: the 3D view runs by the same rule on the server. Undefined = at the end.
 */
export function ahead(at: number, frames: number, span: Span, loop: boolean): number | undefined {
  const next = at + frames;
  if (loop)
    return next < span.to ? next : span.from + ((next - span.from) % Math.max(1, span.to - span.from));
  return next < span.to - 1 ? next : undefined;
}

/** What is said of the pose that is commanded at a frame: it, or the place of a point, is not reached. */
export function unreachedAt(lints: readonly Lint[], frame: number): Lint | undefined {
  const held = ([from, to]: [number, number]): boolean => frame >= from && frame < to;
  return lints.find(
    (l) => l.rule === "unreachable" && (l.settled?.held ?? (l.frames ? [l.frames] : [])).some(held),
  );
}
