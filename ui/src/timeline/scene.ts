// What the dope sheet draws, and in which colours.

import type { Clip } from "../clip";
import type { Box, RowKind, View } from "./layout";

export type Ctx = CanvasRenderingContext2D;

export interface Theme {
  back: string;
  panel: string;
  rule: string;
  faint: string;
  text: string;
  dim: string;
  key: string;
  keyEdge: string;
  selected: string;
  fill: string;
  hatch: string;
  blind: string;
  playhead: string;
  look: string;
  error: string;
  marker: string;
  cached: string;
  focus: string;
  /** Names of the letters' families. */
  font: string;
}

export interface Span {
  from: number;
  to: number;
}

/** Loudness over time. */
export interface Sound {
  /** The loudest sample of each piece, 0 to 1. */
  peaks: Float32Array;
  /** Pieces a second. */
  perSec: number;
}

export interface Scene {
  clip: Clip;
  rows: RowKind[];
  view: View;
  box: Box;
  theme: Theme;
  playhead: number;
  selection: ReadonlySet<number>;
  /** The chosen offset, and where a drag has it. */
  offset: { frame: number; at: number } | undefined;
  /** A block under a hand: the one that begins there, and how far it was moved, pixels. */
  carried: { frame: number; dx: number } | undefined;
  /** There is a key at nearly every frame: the dots between stand for motion, not for keys. */
  dense: boolean;
  selectedJoint: number | undefined;
  blind: Span[];
  lints: { frame: number; level: "error" | "warning" }[];
  /** The sound of the reference, and its second at frame 0. */
  heard: { sound: Sound; begins: number } | undefined;
  /** Mean error by frame, null where masked. */
  errors: (number | null)[];
  /** The same of the take that is compared, and its colour. */
  beside: { errors: (number | null)[]; color: string } | undefined;
  /** Error that fills the strip, rad or m. */
  errorTop: number;
  cachedTo: number;
  loop: Span | undefined;
  /** The length that a drag of the clip's end would give it. */
  end: number | undefined;
  /** Keys as a drag in progress would leave them: frame -> frame. */
  dragged: ReadonlyMap<number, number>;
  boxSelect: { x0: number; y0: number; x1: number; y1: number } | undefined;
  names: (joint: number) => string;
  /** An end effector as people call it. */
  pointName: (name: string) => string;
  locked: (joint: number) => boolean;
  /** Whether the policy can leave single joints open. */
  maskable: boolean;
  stale: boolean;
  focusRow: number;
  focused: boolean;
  /** The row under the pointer: its switches are shown. */
  hoverRow: number | undefined;
}

/** What the ruler and the playhead are drawn from; the graph has them, too. */
export type Times = Pick<
  Scene,
  "clip" | "view" | "box" | "theme" | "playhead" | "end" | "stale" | "cachedTo" | "loop" | "blind" | "heard"
>;
