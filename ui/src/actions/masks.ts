// Frames that are left to the policy, and what lies between keys.

import { type Fill, fillAfter, keyAt, prevKey } from "../clip";
import { acted, type Span, type Why } from "../span";
import * as store from "../store";
import { edit } from "../wire";
import { type Action, clip, selected } from "./action";

/** The frames that M and U act on now, for all joints or for one. */
export function span(joint?: string): (Span & { why: Why }) | undefined {
  const c = clip();
  const own = joint === undefined ? undefined : c?.robot.joints.indexOf(joint);
  return c && acted(c, store.selection.value, store.range.value, store.playhead.value, own);
}

export function setFill(fill: Fill): void {
  const c = clip();
  if (!c) return;
  const frames = selected();
  const at = store.playhead.value;
  const before = keyAt(c, at) ?? prevKey(c, at);
  const targets = frames.length ? frames : before ? [before.frame] : [];
  if (targets.length) void edit("fill.set", { frames: targets, fill });
}

/** What follows the chosen keys becomes the next of its kinds. */
function cycleFill(): void {
  const c = clip();
  if (!c) return;
  const kinds: Fill[] = ["mask", "linear", "cubic", "hold"];
  const at = store.playhead.value;
  const [first] = selected();
  const own = first === undefined ? (keyAt(c, at) ?? prevKey(c, at)) : keyAt(c, first);
  if (!own) return store.toast("there is no key at the playhead or before it");
  const next = kinds[(kinds.indexOf(fillAfter(c, own)) + 1) % kinds.length] ?? "mask";
  setFill(next);
  store.announcement.value = `interval: ${next}`;
}

/** The joint that is chosen on the timeline, in the viewport or among the sliders. */
export function chosenJoint(): string | undefined {
  const at = store.joint.value;
  return at === undefined ? undefined : clip()?.robot.joints[at];
}

export function needsJoint(): string | undefined {
  return chosenJoint() ? undefined : "select a joint first: click its name on the timeline";
}

/** Why a single joint cannot be masked now; undefined when it can. */
export function noJointMask(): string | undefined {
  return store.doc.value?.findings.granularity === "state"
    ? `${store.settings.value.policy} was trained with whole frames masked, not single joints; select another policy to mask one joint`
    : undefined;
}

export function needsJointMask(): string | undefined {
  return needsJoint() ?? noJointMask();
}

/** Masks or unmasks joints of a row about the playhead, as M and U do. */
export function toggleMask(joints: string[]): void {
  const s = span(joints.length === 1 ? joints[0] : undefined);
  const c = clip();
  if (!s || !c || s.to <= s.from) return;
  const hidden = (j: string): boolean =>
    (c.masks ?? []).some((m) => m.from <= s.from && s.to <= m.to && (!m.joints || m.joints.includes(j)));
  const masked = !joints.every(hidden);
  const why = noJointMask();
  if (masked && why) return store.toast(why);
  const names = joints.length > 1 ? `${joints.length} joints` : (joints[0] ?? "");
  void edit("mask.set", { from: s.from, to: s.to, joints, masked }).then((ok) => {
    if (ok) store.toast(`frames ${s.from} to ${s.to - 1}, ${names}: ${masked ? "masked" : "unmasked"}`);
  });
}

export function maskSpan(masked: boolean, joint?: string): void {
  const s = span(joint);
  if (!s) return store.toast("there are no frames between keys at the playhead");
  void edit("mask.set", { from: s.from, to: s.to, ...(joint ? { joints: [joint] } : {}), masked }).then(
    (ok) => {
      if (ok)
        store.toast(
          `frames ${s.from} to ${s.to - 1}, ${joint ?? "all joints"}: ${masked ? "masked" : "unmasked"}`,
        );
    },
  );
}

export const MASKS: Action[] = [
  {
    id: "mask",
    title: "Mask: leave these frames to the policy",
    group: "Masks",
    keys: ["M"],
    run: () => maskSpan(true),
  },
  { id: "unmask", title: "Unmask", group: "Masks", keys: ["U"], run: () => maskSpan(false) },
  {
    id: "mask-joint",
    title: "Mask the selected joint only",
    group: "Masks",
    keys: ["Alt+M"],
    not: needsJointMask,
    run: () => maskSpan(true, chosenJoint()),
  },
  {
    id: "unmask-joint",
    title: "Unmask the selected joint only",
    group: "Masks",
    keys: ["Alt+U"],
    not: needsJoint,
    run: () => maskSpan(false, chosenJoint()),
  },
  { id: "fill-mask", title: "Interval: leave it to the policy", group: "Masks", run: () => setFill("mask") },
  { id: "fill-linear", title: "Interval: straight line", group: "Masks", run: () => setFill("linear") },
  { id: "fill-cubic", title: "Interval: smooth curve", group: "Masks", run: () => setFill("cubic") },
  {
    id: "fill-next",
    title: "Interval: the next of policy, line, curve, hold",
    group: "Masks",
    keys: ["C"],
    run: cycleFill,
  },
  { id: "fill-hold", title: "Interval: hold", group: "Masks", run: () => setFill("hold") },
];
