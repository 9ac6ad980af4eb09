// The handles of tangents and of offsets: where they stand in the graph, and what a drag of one means.
// Pure.

import type { Clip } from "../clip";
import { frameToX, LABELS } from "../timeline/layout";
import { commandedAt, passing } from "./curve";
import { nameOf, type Point, perPixel, points, type Space, valueToY } from "./space";

/** A tangent's handle: on the line that touches the curve at its point. */
export interface Handle {
  kind: "tangent";
  frame: number;
  joint: number;
  side: "in" | "out";
  /** Of the point. */
  px: number;
  py: number;
  /** Of the handle. */
  x: number;
  y: number;
  /** Units a frame. */
  slope: number;
  /** Typed, or by a name; else automatic. */
  set: boolean;
  /** Both sides have one slope. */
  smooth: boolean;
}

/** The top of an offset. */
export interface Top {
  kind: "offset";
  frame: number;
  joint: number;
  x: number;
  y: number;
  added: number;
}

/** How far a handle stands from its point, pixels. */
const NEAR = 30;
const FAR = 84;

/** Handles of the chosen points, on the sides where a curve begins or ends. */
export function handles(s: Space, clip: Clip, joints: number[], chosen: ReadonlySet<string>): Handle[] {
  const own = points(clip, joints).filter((p) => chosen.has(nameOf(p)));
  // Of very many nobody could tell whose is whose.
  if (own.length > 12) return [];
  return own.flatMap((p) => both(s, clip, p));
}

function both(s: Space, clip: Clip, p: Point): Handle[] {
  const at = passing(clip, p.joint, p.frame);
  return (["in", "out"] as const).flatMap((side) => {
    const one = at?.[side];
    if (!one || !at) return [];
    const way = side === "in" ? -1 : 1;
    const from = side === "in" ? p.frame : at.last;
    const [px, py] = [frameToX(s.view, from), valueToY(s, p.joint, p.value)];
    // As on the screen: a third of the way is where a Bezier curve of this shape has its handle.
    const dx = (one.width / 3) * s.view.zoom;
    const dy = -((one.slope * one.width) / 3) / perPixel(s, p.joint);
    const long = Math.hypot(dx, dy) || 1;
    const share = Math.min(FAR, Math.max(NEAR, long)) / long;
    const { frame, joint } = p;
    const [x, y] = [px + way * dx * share, py + way * dy * share];
    const { slope } = one;
    return [{ kind: "tangent", frame, joint, side, px, py, x, y, slope, set: at.set, smooth: at.smooth }];
  });
}

/** The slope, units a frame, that a hand at this place gives a handle. */
export function slopeAt(s: Space, h: Handle, x: number, y: number): number {
  const way = h.side === "in" ? -1 : 1;
  // Never over its point: a curve has one value at a time.
  const dx = Math.max(3, way * (x - h.px)) / s.view.zoom;
  return (way * (h.py - y) * perPixel(s, h.joint)) / dx;
}

/** The offsets of these joints, on the motion that they shape. */
export function tops(s: Space, clip: Clip, joints: number[]): Top[] {
  return (clip.offsets ?? []).flatMap((o) =>
    joints.flatMap((joint): Top[] => {
      const added = o.add[clip.robot.joints[joint] ?? ""];
      const value = added === undefined ? undefined : commandedAt(clip, joint, o.frame);
      if (added === undefined || value === undefined) return [];
      const { frame } = o;
      return [
        { kind: "offset", frame, joint, added, x: frameToX(s.view, frame), y: valueToY(s, joint, value) },
      ];
    }),
  );
}

/** The handle under a pixel. */
export function under<T extends { x: number; y: number }>(all: T[], x: number, y: number): T | undefined {
  if (x < LABELS) return undefined;
  return all.find((h) => Math.hypot(h.x - x, h.y - y) < 8);
}
