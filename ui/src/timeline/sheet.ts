// What gestures of the dope sheet see of it, and what they do to it.

import type { Clip } from "../clip";
import type { Block } from "../layers";
import type { Op } from "../protocol";
import type { Box, RowKind, View } from "./layout";

export interface Sheet {
  clip(): Clip | undefined;
  rows(): RowKind[];
  view(): View;
  box(): Box;
  playhead(): number;
  selection(): ReadonlySet<number>;
  setView(view: View): void;
  setPlayhead(frame: number): void;
  setSelection(frames: ReadonlySet<number>): void;
  setJoint(joint: number | undefined): void;
  toggleGroup(name: string): void;
  /** The switches of rows. */
  toggleLock(joints: number[]): void;
  toggleMask(joints: number[]): void;
  preview(dragged: ReadonlyMap<number, number>, box: BoxSelect | undefined): void;
  /** Resolves when it is made (true) or refused. The clip grows for `ends`, the frames where keys end then. */
  edit(op: Op, ends?: readonly number[]): Promise<boolean>;
  /** Keys that stood where others have landed are gone. */
  overwrote(count: number): void;
  /** The end of the clip as a drag would leave it. */
  previewEnd(length: number | undefined): void;
  /** The rollout follows a drag; without an operation it goes back to the document. */
  follow(op?: Op): void;
  openKey(frame: number): void;
  menu(target: Target, x: number, y: number): void;
  hint(text: string): void;
  /** The row under the pointer, if any. */
  over(row: number | undefined): void;
  /** The chosen offset, and one under a hand. */
  chooseOffset(frame: number | undefined): void;
  previewOffset(of: { frame: number; at: number } | undefined): void;
  /** A block under a hand, and where it was let go among the others. */
  carry(of: { frame: number; dx: number } | undefined): void;
  order(block: Block, place: number): void;
  /** What is drawn at a frame, in words; the empty text where it explains itself. */
  about(frame: number): string;
}

/** What a menu is about; `frames` and `past` at the playhead. */
export type Target =
  | { kind: "key"; frame: number }
  | { kind: "marker"; frame: number }
  | { kind: "offset"; frame: number }
  | { kind: "block"; frame: number }
  | { kind: "frames" }
  | { kind: "past" };

export interface BoxSelect {
  x0: number;
  y0: number;
  x1: number;
  y1: number;
}
