// A pose under a hand: by a slider, a typed value, a drag in the viewport, inverse kinematics.
// While it moves the rollout follows as a preview; when it is let go there is one edit.

import { type Clip, changedBy, isOf, type Key, keyAt, type Mask, newKey, prevKey, values } from "./clip";
import { commandedAt } from "./graph/curve";
import { addedAt } from "./layers";
import { unlocked } from "./locks";
import { shapingEdit } from "./offsets";
import type { Args, Op } from "./protocol";
import { inRobotOrder } from "./sites";
import * as store from "./store";
import { applyOp, ask, asOne, edit, tell } from "./wire";

/** The pose at the playhead: what is commanded there; for joints that are left to the policy what is achieved,
 * within their ranges. */
export function poseAt(clip: Clip, frame: number): number[] {
  return clip.robot.joints.map((_, j) => valueAt(clip, j, frame));
}

/** The value of one joint of [`poseAt`]. */
export function valueAt(clip: Clip, joint: number, frame: number): number {
  const name = clip.robot.joints[joint] ?? "";
  const commanded = isMasked(clip, name, frame) ? undefined : commandedAt(clip, joint, frame);
  if (commanded !== undefined) return commanded;
  const table = store.doc.value?.table;
  const achieved = store.frames.value.q[frame]?.[joint];
  const before = prevKey(clip, frame + 1) ?? clip.keys[0];
  const v = achieved ?? (before && values(clip, before)[joint]) ?? table?.rest[joint] ?? 0;
  const [lo, hi] = table?.joints[joint]?.range ?? [v, v];
  return Math.min(Math.max(v, lo), hi);
}

/** Whether a mask hides a joint at a frame. */
function isMasked(clip: Clip, joint: string, frame: number): boolean {
  const hides = (m: Mask): boolean => m.from <= frame && frame < m.to && (m.joints?.includes(joint) ?? true);
  const key = keyAt(clip, frame);
  const own = key && isOf(clip, key, clip.robot.joints.indexOf(joint));
  return !own && (clip.masks?.some(hides) ?? false);
}

/** The pose that a key there would have. */
export function barePose(clip: Clip, frame: number): number[] {
  return poseAt(clip, frame).map((v, j) => v - addedAt(clip, j, frame));
}

/** The pose that a drag began from: what its previews reach must not pull the other joints along. */
let base: { frame: number; rev: number; q: number[] } | undefined;

/** What was under a hand in one document means nothing in the next. */
export function forgetPose(): void {
  if (store.floating.value) dropFloating();
  base = undefined;
  endPreview();
}

/** What the keys must say for joints to have these values: without what offsets add. */
function bare(clip: Clip, frame: number, changes: Record<string, number>): Record<string, number> {
  if (!clip.offsets?.length) return changes;
  const under = ([name, v]: [string, number]): [string, number] => {
    const added = addedAt(clip, clip.robot.joints.indexOf(name), frame);
    return [name, added === 0 ? v : Math.round((v - added) * 1e6) / 1e6];
  };
  return Object.fromEntries(Object.entries(changes).map(under));
}

/** The edits that change a key's joint values. End-effector goals would overrule the values, so they become values
 * first. */
export function valueEdits(key: Key, args: Args<"keys.set">): Op[] {
  const set: Op = { op: "keys.set", args };
  return key.reach?.length ? [{ op: "keys.bake", args: { frames: [key.frame] } }, set] : [set];
}

/** The edit that gives the joints of a key these values. */
function keyEdit(key: Key, values: Record<string, number>): Op | undefined {
  return asOne(valueEdits(key, { frame: key.frame, values }), `Pose the key at ${key.frame}`);
}

/** Makes the edit of a pose, and says what becomes of end-effector goals. */
async function applyPose(op: Op | undefined): Promise<boolean> {
  if (!op) return false;
  const done = await applyOp(op);
  if (done && op.op === "batch")
    store.toast("the end-effector goals of this key are joint values now; Shift+K keys a point again");
  return done;
}

/** The edit that gives joints these values at a frame. */
function poseEdit(wanted: Record<string, number>, frame: number): Op | undefined {
  const d = store.doc.value;
  if (!d) return undefined;
  if (store.shaping.value) return shapingEdit(wanted, frame);
  const changes = bare(d.clip, frame, wanted);
  const key = keyAt(d.clip, frame);
  if (key) return keyEdit(key, changes);
  if (base?.frame !== frame || base.rev !== d.rev) base = { frame, rev: d.rev, q: barePose(d.clip, frame) };
  const q = [...base.q];
  d.clip.robot.joints.forEach((name, j) => {
    const v = changes[name];
    if (v !== undefined) q[j] = v;
  });
  return { op: "keys.add", args: { keys: [newKey(d.clip, frame, unlocked(q))] } };
}

/**
 * A joint is being moved by a slider or in the viewport. While it moves the rollout follows as
 * a preview; when it is let go there is one edit. With auto-key off, and off a key, it is a
 * floating pose: shown, kept, and no key until the person says so. What was asked for at another frame than the
 * playhead's goes there.
 */
export async function jointMoved(
  changes: Record<string, number>,
  done: boolean,
  frame = store.playhead.value,
): Promise<void> {
  const d = store.doc.value;
  if (!d) return;
  if (done && Object.keys(changes).length === 0) {
    // Taken and let go again.
    endPreview();
    return tell("preview.end");
  }
  if (!keyAt(d.clip, frame) && !store.autoKey.value && !store.shaping.value) {
    // A floating pose is the playhead's.
    if (frame !== store.playhead.value) return;
    const q = store.floating.value ?? poseAt(d.clip, frame);
    store.floating.value = d.clip.robot.joints.map((name, j) => changes[name] ?? q[j] ?? 0);
    tell("view.pose", { q: inRobotOrder(store.floating.value) });
    return;
  }
  const e = poseEdit(changes, frame);
  if (!e) return;
  if (done) {
    base = undefined;
    endPreview();
    await applyPose(e);
    tell("preview.end");
  } else preview(e);
}

let previewing = false;
let newest: Op | undefined;
/** Rises when a drag ends: what its previews are answered with is no longer of interest. */
let asked = 0;

/** The longest that a newer preview waits for the one before it. */
const LONGEST_MS = 400;

/** Ends the wait for the last preview. */
let release = (): void => {};

/** When the rollout that began after this one has come to its end, or has taken too long. */
function performed(since: number): Promise<void> {
  return new Promise((done) => {
    const end = (): void => {
      clearTimeout(timer);
      stop();
      done();
    };
    const timer = setTimeout(end, LONGEST_MS);
    release = end;
    const stop = store.rollout.subscribe((r) => {
      const over = r && r.gen > since && r.phase !== "waiting" && r.phase !== "running";
      if (over) queueMicrotask(end);
    });
  });
}

/** Sends a preview when the last one has been performed, so that a hand that moves on and on sees whole
 * motions and not their first frames. The newest wins. */
export function preview(op: Op): void {
  newest = op;
  if (previewing) return;
  previewing = true;
  const step = (): void => {
    const next = newest;
    newest = undefined;
    if (!next) {
      previewing = false;
      return;
    }
    const of = asked;
    const before = store.rollout.value?.gen ?? 0;
    void ask("preview", { op: next }).then(async (r) => {
      const answer = r.result;
      if (of === asked) store.demand.value = (answer && "demand" in answer && answer.demand) || undefined;
      if (of === asked && r.ok && store.settings.value.auto) await performed(before);
      step();
    });
  };
  step();
}

/** What waits to be previewed is out of date: an edit or its end follows. */
export function endPreview(): void {
  newest = undefined;
  asked++;
  release();
  store.demand.value = undefined;
}

export async function keyFloating(): Promise<void> {
  const d = store.doc.value;
  const q = store.floating.value;
  if (!d || !q) return;
  const frame = store.playhead.value;
  const key = keyAt(d.clip, frame);
  const own = q.map((v, j) => v - addedAt(d.clip, j, frame));
  const changes = key && changedBy(d.clip, key, unlocked(own));
  const done = !changes
    ? await addPose(frame, own)
    : Object.keys(changes).length === 0 || (await applyPose(keyEdit(key, changes)));
  if (!done) return;
  dropFloating();
  store.selection.value = new Set([frame]);
}

/** Makes a key of the joints that are not locked, and selects it. */
export async function addPose(frame: number, q: readonly (number | null)[]): Promise<boolean> {
  const clip = store.doc.value?.clip;
  if (!clip) return false;
  const row = unlocked(q);
  if (row.every((v) => v === null)) {
    store.toast("all joints are locked: unlock one first");
    return false;
  }
  const done = await edit("keys.add", { keys: [newKey(clip, frame, row)] });
  if (done) store.selection.value = new Set([frame]);
  return done;
}

export function dropFloating(): void {
  store.floating.value = undefined;
  tell("view.pose", { q: null });
}

/** Whether a drag in the viewport was under way; it is given up. */
export function cancelDrag(): boolean {
  if (!store.moving.value) return false;
  tell("view.cancel");
  return true;
}

/** The floating pose that a drag began with. */
let before: number[] | undefined;

/** A hand in the 3D view has joints there, or has let go. */
export function dragged(values: Record<string, number>, done: boolean): void {
  if (!store.moving.value) before = store.floating.value;
  store.moving.value = done ? undefined : values;
}

/** The drag is over and nothing is to be edited. */
export function dragCancelled(): void {
  if (store.moving.value) store.floating.value = before;
  store.moving.value = undefined;
  endPreview();
  tell("preview.end");
  store.announcement.value = "cancelled";
}

/** The pose that the sliders show. */
export function shownPose(): number[] | undefined {
  const d = store.doc.value;
  if (!d) return undefined;
  const q = store.floating.value ?? poseAt(d.clip, store.playhead.value);
  const moving = store.moving.value;
  return d.clip.robot.joints.map((name, j) => moving?.[name] ?? q[j] ?? 0);
}
