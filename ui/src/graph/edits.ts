// What is chosen in the graph, and the edits that change it. Points are the keys of the timeline
// seen joint by joint: both choose the same keys.

import { effect, signal } from "@preact/signals";
import { type Clip, keyAt, newKey, values } from "../clip";
import { shares, together } from "../couplings";
import { addedAt } from "../layers";
import { isLocked } from "../locks";
import { endPreview, preview } from "../posing";
import type { Op, Tangent } from "../protocol";
import * as store from "../store";
import { applyOp, asOne, tell } from "../wire";
import { commandedAt, passing } from "./curve";
import type { Handle, Top } from "./handles";
import { type Changes, nameOf, type Point, points } from "./space";

/** Joints whose curves are drawn, in the order of the clip. */
export const curves = signal<ReadonlySet<number>>(new Set());
/** Chosen points, by name. */
export const chosen = signal<ReadonlySet<string>>(new Set());

export const shownJoints = (): number[] => [...curves.value].sort((a, b) => a - b);

/** How many curves can still be told apart by their colours. */
const SEVERAL = 8;

/** Values live on a grid of 1e-6. */
const grid = (v: number): number => Math.round(v * 1e6) / 1e6;

const frameOf = (name: string): number => Number(name.split(":")[0]);

export function choosePoints(names: ReadonlySet<string>): void {
  chosen.value = names;
  store.selection.value = new Set([...names].map(frameOf));
}

/** Follows what is chosen elsewhere; the returned function stops it. */
export function followSelection(): () => void {
  const stops = [
    effect(() => {
      const frames = store.selection.value;
      const joints = shownJoints();
      const clip = store.doc.value?.clip;
      const now = [...chosen.peek()].filter(
        (n) => frames.has(frameOf(n)) && joints.includes(Number(n.split(":")[1])),
      );
      const covered = new Set(now.map(frameOf));
      const missing = [...frames].filter((f) => !covered.has(f));
      if (!clip || (missing.length === 0 && now.length === chosen.peek().size)) return;
      const more = points(clip, joints).filter((p) => missing.includes(p.frame));
      chosen.value = new Set([...now, ...more.map(nameOf)]);
    }),
    effect(() => {
      const joint = store.joint.value;
      const robot = store.doc.value?.clip.robot.joints.length ?? 0;
      const now = [...curves.peek()].filter((j) => j < robot);
      if (joint !== undefined && now.includes(joint)) return;
      const group = store.groups.value.find((g) => g.joints.includes(joint ?? 0))?.joints ?? [];
      if (joint !== undefined) curves.value = new Set([joint]);
      else if (now.length === 0 || now.length !== curves.peek().size)
        curves.value = new Set((group.length ? group : [0]).slice(0, SEVERAL));
    }),
  ];
  return () => stops.forEach((stop) => stop());
}

/** The edit that gives points these values and moves their keys by a number of frames. */
function shaping(changes: Changes, frames: number[], df: number): Op | undefined {
  const clip = store.doc.value?.clip;
  if (!clip) return undefined;
  const ops: Op[] = [];
  for (const [frame, row] of changes) {
    const key = keyAt(clip, frame);
    const set: Record<string, number> = {};
    for (const [j, value] of row) {
      const name = clip.robot.joints[j];
      if (!key || name === undefined || isLocked(name) || values(clip, key)[j] === value) continue;
      for (const [other, v] of Object.entries(together(name, value)))
        if (!isLocked(other)) set[other] = Math.round(v * 1e6) / 1e6;
    }
    if (Object.keys(set).length) ops.push({ op: "keys.set", args: { frame, values: set } });
  }
  if (df !== 0 && frames.length) ops.push({ op: "keys.move", args: { frames, df, replace: true } });
  return asOne(ops, `Shape ${frames.length} key${frames.length === 1 ? "" : "s"}`);
}

/** The rollout follows the hand. */
export function previewShape(changes: Changes, frames: number[], df: number): void {
  const op = shaping(changes, frames, df);
  if (op) preview(op);
}

export function endShape(): void {
  endPreview();
  tell("preview.end");
}

/** One edit, and one entry in the history. True when it was made. */
export async function shape(changes: Changes, frames: number[], df: number): Promise<boolean> {
  const op = shaping(changes, frames, df);
  endPreview();
  if (!op) {
    tell("preview.end");
    return false;
  }
  const names = [...chosen.value];
  const done = await applyOp(op);
  tell("preview.end");
  if (done && df !== 0) choosePoints(new Set(names.map((n) => `${frameOf(n) + df}:${n.split(":")[1]}`)));
  return done;
}

/** A key of one joint, and of those that are bound to it; the curves of all others go on. */
export function addPoint(frame: number, joint: number, value: number): void {
  const clip = store.doc.value?.clip;
  const name = clip?.robot.joints[joint];
  if (!clip || name === undefined || frame < 0 || frame >= clip.length) return;
  if (isLocked(name)) return store.toast(`${name} is locked`);
  const set = together(name, grid(value - addedAt(clip, joint, frame)));
  const q = clip.robot.joints.map((n) => set[n] ?? null);
  const op: Op = keyAt(clip, frame)
    ? { op: "keys.set", args: { frame, values: set } }
    : { op: "keys.add", args: { keys: [newKey(clip, frame, q, joint)] } };
  void applyOp(op).then((ok) => {
    if (ok) choosePoints(new Set([nameOf({ frame, joint })]));
  });
}

/** Takes the chosen joints out of their keys; a key that has no value left goes. */
export async function deletePoints(): Promise<void> {
  const clip = store.doc.value?.clip;
  if (!clip) return;
  const names = clip.robot.joints;
  const ops: Op[] = [];
  const gone: number[] = [];
  const own = points(clip, shownJoints()).filter((p) => chosen.value.has(nameOf(p)));
  for (const frame of new Set(own.map((p) => p.frame))) {
    const key = keyAt(clip, frame);
    const joints = own.filter((p) => p.frame === frame).flatMap((p) => names[p.joint] ?? []);
    const free = joints.flatMap((n) => Object.keys(together(n, 0))).filter((n) => !isLocked(n));
    if (!key || free.length === 0) continue;
    const kept = values(clip, key).some((v, j) => typeof v === "number" && !free.includes(names[j] ?? ""));
    if (!kept && !key.reach?.length) gone.push(frame);
    else
      ops.push({
        op: "keys.set",
        args: { frame, values: Object.fromEntries(free.map((n) => [n, null])) },
      });
  }
  if (gone.length) ops.push({ op: "keys.delete", args: { frames: gone } });
  const op = asOne(ops, `Delete ${own.length === 1 ? "a point" : `${own.length} points`}`);
  if (!op) return store.toast("select points of joints that are not locked first");
  if (await applyOp(op)) choosePoints(new Set());
}

/** Points that keys act on: those chosen in the graph, else the chosen joint at the chosen keys. */
export function actedOn(): Point[] {
  const clip = store.doc.value?.clip;
  if (!clip) return [];
  const joint = store.joint.value ?? 0;
  const frames = store.selection.value.size ? store.selection.value : new Set([store.playhead.value]);
  const own = points(clip, shownJoints()).filter((p) => chosen.value.has(nameOf(p)));
  return own.length ? own : points(clip, [joint]).filter((p) => frames.has(p.frame));
}

/** Why no value can be changed by a key now. */
export const needsPoint = (): string | undefined =>
  actedOn().length ? undefined : "select a key and a joint first";

/** Sets how curves pass the chosen points; null is automatic. Where no curve begins or ends, one does
 * then: a tangent of a straight line would change nothing. */
export async function setTangent(tangent: Tangent | null): Promise<void> {
  const clip = store.doc.value?.clip;
  if (!clip) return;
  const ops: Op[] = [];
  const acted = actedOn();
  for (const joint of new Set(acted.map((p) => p.joint))) {
    const name = clip.robot.joints[joint];
    if (name === undefined || isLocked(name)) continue;
    const frames = acted.filter((p) => p.joint === joint).map((p) => p.frame);
    ops.push({ op: "tangent.set", args: { frames, joints: [name], tangent } });
  }
  const curved = (p: Point): boolean => {
    const way = passing(clip, p.joint, p.frame);
    return way?.in !== undefined || way?.out !== undefined;
  };
  const at = [...new Set(acted.map((p) => p.frame))];
  const frames = [...new Set(acted.filter((p) => !curved(p)).map((p) => p.frame))];
  if (ops.length && tangent !== null && frames.length)
    ops.push({ op: "fill.set", args: { frames, fill: "cubic" } });
  const op = asOne(ops, `Shape the curve at ${at.length} key${at.length === 1 ? "" : "s"}`);
  if (op) await applyOp(op);
  else store.toast("select points of joints that are not locked first");
}

/** What a clip becomes, and the edit that makes it so; undefined for a locked joint. */
export interface Bent {
  clip: Clip;
  op: Op;
}

/** A tangent with this slope, units a frame, on one side or on both. */
export function bent(clip: Clip, h: Handle, slope: number, both: boolean): Bent | undefined {
  const name = clip.robot.joints[h.joint];
  const own = passing(clip, h.joint, h.frame);
  if (name === undefined || !own || isLocked(name)) return undefined;
  const other = own[h.side === "in" ? "out" : "in"]?.slope ?? slope;
  /** Of a joint that goes so far when this one goes by one. */
  const tangentOf = (share: number): Tangent => {
    const secs = (v: number): number => grid(v * share * clip.fps);
    if (both) return slope === 0 ? "flat" : secs(slope);
    return h.side === "in" ? { in: secs(slope), out: secs(other) } : { in: secs(other), out: secs(slope) };
  };
  const set = Object.entries(shares(name)).flatMap(([joint, share]): [string, Tangent][] =>
    isLocked(joint) ? [] : [[joint, tangentOf(share)]],
  );
  const keys = clip.keys.map((k) =>
    k.frame === h.frame ? { ...k, tangents: { ...k.tangents, ...Object.fromEntries(set) } } : k,
  );
  const ops = set.map(
    ([joint, tangent]): Op => ({ op: "tangent.set", args: { frames: [h.frame], joints: [joint], tangent } }),
  );
  const op = asOne(ops, `Shape the curve at ${h.frame}`);
  return op && { clip: { ...clip, keys }, op };
}

/** The offset with a larger value for a joint, moved by a number of frames. */
export function lifted(clip: Clip, t: Top, by: number, df: number): Bent | undefined {
  const name = clip.robot.joints[t.joint];
  const now = commandedAt(clip, t.joint, t.frame);
  const old = clip.offsets?.find((o) => o.frame === t.frame);
  if (name === undefined || now === undefined || !old || isLocked(name)) return undefined;
  const range = store.doc.value?.table.joints[t.joint]?.range;
  const room = range ? Math.min(range[1] - now, Math.max(range[0] - now, by)) : by;
  const to = Math.min(clip.length - 1, t.frame + df);
  const free = df !== 0 && !clip.offsets?.some((o) => o.frame === to);
  const add: Record<string, number> = {};
  for (const [n, share] of Object.entries(shares(name)))
    if (!isLocked(n)) add[n] = grid((old.add[n] ?? 0) + share * room);
  const ops: Op[] = by === 0 ? [] : [{ op: "offsets.set", args: { frame: t.frame, add } }];
  if (free) ops.push({ op: "offsets.move", args: { frames: [t.frame], df: to - t.frame } });
  const op = asOne(ops, `Shape the motion around ${to}`);
  if (!op) return undefined;
  const offsets = (clip.offsets ?? []).map((o) =>
    o === old ? { ...o, frame: free ? to : o.frame, add: { ...o.add, ...(by === 0 ? {} : add) } } : o,
  );
  return { clip: { ...clip, offsets }, op };
}

/** Values for points, inside the ranges of their joints. */
function moved(list: Point[], to: (p: Point) => number): Changes {
  const facts = store.doc.value?.table.joints ?? [];
  const changes: Changes = new Map();
  for (const p of list) {
    const range = facts[p.joint]?.range;
    const value = range ? Math.min(range[1], Math.max(range[0], to(p))) : to(p);
    const row = changes.get(p.frame) ?? new Map<number, number>();
    changes.set(p.frame, row.set(p.joint, grid(value)));
  }
  return changes;
}

/** Raises the chosen points by a degree or a millimetre, `share` of it. */
export async function nudgeValue(share: number): Promise<void> {
  const facts = store.doc.value?.table.joints ?? [];
  const list = actedOn();
  const step = (joint: number): number => (facts[joint]?.unit === "m" ? 0.001 : Math.PI / 180);
  const changes = moved(list, (p) => p.value + share * step(p.joint));
  const first = list[0];
  const value = first && changes.get(first.frame)?.get(first.joint);
  if (first && value !== undefined)
    store.announcement.value = `${store.titles.value[first.joint]} ${store.shown(value, facts[first.joint]?.unit ?? "rad")}`;
  await shape(changes, [...changes.keys()], 0);
}

/** Scales the chosen points about the command at the playhead, joint by joint; where nothing is commanded
 * there, about their mean. */
export async function scaleValues(factor: number): Promise<void> {
  const clip = store.doc.value?.clip;
  if (!clip) return;
  const at = store.playhead.value;
  const list = actedOn();
  const middle = (joint: number): number => {
    const now = commandedAt(clip, joint, at);
    if (now !== undefined) return now - addedAt(clip, joint, at);
    const own = list.filter((p) => p.joint === joint);
    return own.reduce((sum, p) => sum + p.value, 0) / own.length;
  };
  const pivots = new Map([...new Set(list.map((p) => p.joint))].map((j) => [j, middle(j)]));
  const changes = moved(list, (p) => {
    const pivot = pivots.get(p.joint) ?? p.value;
    return pivot + factor * (p.value - pivot);
  });
  await shape(changes, [...changes.keys()], 0);
}
