// Shaping from above: while it is on, a hand on the pose makes offsets instead of keys.

import { effect } from "@preact/signals";
import { commandedAt } from "./graph/curve";
import { isDense, offsetAt, shapes } from "./layers";
import type { Op } from "./protocol";
import * as store from "./store";
import { edit } from "./wire";

/** Dense motion is shaped from above as soon as it is opened; everything else begins with keys. */
export function followDocument(): () => void {
  let opened: number | undefined;
  return effect(() => {
    const d = store.doc.value;
    if (d?.opened === opened) return;
    opened = d?.opened;
    store.chosenOffset.value = undefined;
    store.shaping.value = !!d && isDense(d.clip);
    if (store.shaping.value)
      store.toast("Dense motion: what you move is added to it over half a second. J edits its keys instead.");
  });
}

/** The edit that a pose under a hand means at a frame. */
export function shapingEdit(wanted: Record<string, number>, frame: number): Op | undefined {
  const clip = store.doc.value?.clip;
  if (!clip) return undefined;
  const args = shapes(clip, frame, wanted, (j) => commandedAt(clip, j, frame), store.fade.value);
  return args && { op: "offsets.set", args };
}

/** Why nothing can be added at the playhead. */
export function needsBase(): string | undefined {
  const clip = store.doc.value?.clip;
  if (!clip) return "open a clip first";
  const there = clip.robot.joints.some((_, j) => commandedAt(clip, j, store.playhead.value) !== undefined);
  return there ? undefined : "no motion is commanded here that something could be added to";
}

export const needsOffset = (): string | undefined =>
  chosen() ? undefined : "select an offset on the timeline first";

/** The chosen offset, else the one at the playhead. */
export function chosen() {
  const clip = store.doc.value?.clip;
  return clip && offsetAt(clip, store.chosenOffset.value ?? store.playhead.value);
}

export function toggleShaping(): void {
  store.shaping.value = !store.shaping.value;
  store.announcement.value = store.shaping.value ? "moving adds to the motion" : "moving makes keys";
}

export async function moveOffset(df: number): Promise<void> {
  const own = chosen();
  if (!own || own.frame + df < 0) return;
  if (!(await edit("offsets.move", { frames: [own.frame], df }))) return;
  store.chosenOffset.value = own.frame + df;
  store.playhead.value = own.frame + df;
}

/** Lets the chosen offset grow and fade over more frames, or fewer. */
export async function widen(by: number): Promise<void> {
  const own = chosen();
  if (!own) return;
  const wider = (frames: number | undefined): number => Math.max(0, (frames ?? 10) + by);
  await edit("offsets.set", { frame: own.frame, in: wider(own.in), out: wider(own.out) });
}

export async function deleteOffset(): Promise<void> {
  const own = chosen();
  if (own && (await edit("offsets.delete", { frames: [own.frame] }))) store.chosenOffset.value = undefined;
}

/** Adds all offsets to the keys for good; the motion stays as it is. */
export function bakeOffsets(): void {
  const frames = store.doc.value?.clip.offsets?.map((o) => o.frame) ?? [];
  if (frames.length) void edit("offsets.bake", { frames });
}
