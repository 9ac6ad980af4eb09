// Geometry of the dope sheet: frames to pixels, rows to joints. Pure, so that gestures, the
// drawing, the accessible grid and the browser tests all agree.

import type { Clip } from "../clip";
import type { Reach } from "../protocol";

/** Frames shown before frame 0: the pre-roll that the policy sees as its past. */
export const PRE_ROLL = 30;
/** Frames that the policy sees ahead. */
export const LOOK_AHEAD = 20;

export const RULER = 22;
export const MARKERS = 18;
export const ROW = 20;
export const STRIP = 22;
export const LABELS = 168;

/** Left edges of the two switches of a row's label: lock, mask. */
export const SWITCHES = { lock: LABELS - 42, mask: LABELS - 22 } as const;
export const SWITCH = 16;

/** The switch of a row's label under a pixel. */
export function switchAt(x: number): "lock" | "mask" | undefined {
  if (x >= SWITCHES.lock && x < SWITCHES.lock + SWITCH) return "lock";
  if (x >= SWITCHES.mask && x < SWITCHES.mask + SWITCH) return "mask";
  return undefined;
}

/** Joints that a row's switches act on; the row of all has none. */
export function jointsOf(row: RowKind | undefined): number[] {
  return row?.kind === "joint" ? [row.joint] : row?.kind === "group" ? row.group.joints : [];
}

export interface Group {
  name: string;
  title: string;
  joints: number[];
}

export type RowKind =
  | { kind: "all" }
  /** What is added to the keys. */
  | { kind: "offsets" }
  /** Keys with an end-effector goal for this point of the robot. */
  | { kind: "point"; name: string }
  | { kind: "group"; group: Group; open: boolean }
  | { kind: "joint"; joint: number };

export interface View {
  /** Pixels a frame. */
  zoom: number;
  /** Frame at the left edge of the sheet (right of the labels). */
  left: number;
  /** First visible row, in pixels. */
  top: number;
}

export interface Box {
  width: number;
  height: number;
}

/** The name of the point of an end-effector goal. */
export const pointOf = (r: Reach): string => r.site ?? r.body ?? "";

/** Rows of a clip; one for offsets if it has some, or is about to. */
export function rowsOf(clip: Clip, groups: Group[], closed: ReadonlySet<string>, shaping = false): RowKind[] {
  const rows: RowKind[] = [{ kind: "all" }];
  if (shaping || clip.offsets?.length) rows.push({ kind: "offsets" });
  const points = new Set(clip.keys.flatMap((k) => (k.reach ?? []).map(pointOf)));
  for (const name of [...points].sort()) rows.push({ kind: "point", name });
  const grouped = new Set(groups.flatMap((g) => g.joints));
  for (const group of groups) {
    const open = !closed.has(group.name);
    rows.push({ kind: "group", group, open });
    if (open) for (const joint of group.joints) rows.push({ kind: "joint", joint });
  }
  clip.robot.joints.forEach((_, joint) => {
    if (!grouped.has(joint)) rows.push({ kind: "joint", joint });
  });
  return rows;
}

export function frameToX(view: View, frame: number): number {
  return LABELS + (frame - view.left) * view.zoom;
}

export function xToFrame(view: View, x: number): number {
  return view.left + (x - LABELS) / view.zoom;
}

/** Top of a row, in pixels from the top of the sheet. */
export function rowToY(view: View, row: number): number {
  return RULER + MARKERS + row * ROW - view.top;
}

/** Row under a pixel; undefined over the ruler, the markers or below the last row. */
export function yToRow(view: View, y: number, rows: number): number | undefined {
  if (y < RULER + MARKERS) return undefined;
  const row = Math.floor((y - RULER - MARKERS + view.top) / ROW);
  return row >= 0 && row < rows ? row : undefined;
}

/** Zoom about a pixel, so that the frame under it stays there. */
export function zoomAt(view: View, x: number, factor: number): View {
  const frame = xToFrame(view, x);
  const zoom = Math.min(60, Math.max(0.15, view.zoom * factor));
  return { ...view, zoom, left: frame - (x - LABELS) / zoom };
}

/** Frames behind the end that the whole clip is shown with. */
const BEYOND = 4;

/** Moved sideways, if it must be, so that a frame of a clip of this length is in sight. */
export function withFrame(view: View, box: Box, frame: number, length: number): View {
  const x = frameToX(view, frame);
  const edge = Math.min(40, (box.width - LABELS) / 8);
  if (x >= LABELS + edge && x <= box.width - edge) return view;
  // A step further, so that the next ones are in sight, too.
  const at = x < LABELS + edge ? box.width - LABELS - 4 * edge : 4 * edge;
  const left = frame - at / view.zoom;
  // Behind the end there is nothing to see: what shows the end already stays where it is.
  const end = length + BEYOND - (box.width - LABELS) / view.zoom;
  if (left > view.left) return end <= view.left + 1e-9 ? view : { ...view, left: Math.min(left, end) };
  return { ...view, left: Math.max(left, Math.min(view.left, -PRE_ROLL)) };
}

/** Moved up or down, if it must be, so that a row is in sight. */
export function withRow(view: View, box: Box, row: number): View {
  const room = box.height - RULER - MARKERS - STRIP;
  const top = Math.min(row * ROW, Math.max(view.top, (row + 1) * ROW - room));
  return { ...view, top: Math.max(0, top) };
}

/** The whole clip with its pre-roll. */
export function fit(length: number, box: Box): View {
  const frames = length + PRE_ROLL + BEYOND;
  return { zoom: Math.max(0.15, (box.width - LABELS) / frames), left: -PRE_ROLL, top: 0 };
}

/** Distance between ruler ticks in frames, so that labels never touch. */
export function tick(zoom: number, fps: number): { minor: number; major: number } {
  const wanted = 62 / zoom;
  const steps = [1, 5, 10, fps, 2 * fps, 5 * fps, 10 * fps, 30 * fps, 60 * fps];
  const major = steps.find((s) => s >= wanted) ?? 120 * fps;
  const minor = zoom >= 6 ? 1 : zoom >= 1.6 ? 5 : Math.max(1, major / 5);
  return { minor, major };
}
