// What a hand does besides turning one joint: locks joints, pulls fingertips and end effectors,
// gives a drag up, and sees what it is over.

import { computed, effect, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { complain, endPreview, http, jointMoved, poseAt, tell } from "./api";
import * as store from "./store";

type V3 = [number, number, number];

/** Metres that an arrow key moves a target; with Shift a fifth. */
const NUDGE_M = 0.005;

/** Joints that one actuator moves along with this one. */
function bound(name: string): string[] {
  const couplings = store.doc.value?.table.couplings ?? [];
  return couplings.flatMap((c) => (c.members?.some((m) => m.joint === name) ? c.members.map((m) => m.joint) : []));
}

/** Whether a joint must stay, itself or with one that it is bound to. */
export function isLocked(name: string): boolean {
  return store.locked.value.has(name) || bound(name).some((j) => store.locked.value.has(j));
}

/** `joints` for an edit that must leave locked ones alone; nothing where none is locked. */
export function unlockedOnly(): { joints?: string[] } {
  const all = store.doc.value?.clip.robot.joints ?? [];
  const free = all.filter((j) => !isLocked(j));
  return free.length < all.length ? { joints: free } : {};
}

/** Locks these joints, or frees them when all of them are locked. */
export function toggleLock(names: readonly string[]): void {
  const next = new Set(store.locked.value);
  const free = names.every((n) => next.has(n));
  for (const n of names) free ? next.delete(n) : next.add(n);
  store.locked.value = next;
  store.announcement.value = `${names.join(", ")} ${free ? "unlocked" : "locked"}`;
  tell("view.lock", { joints: [...next] });
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
  store.announcement.value = "given up";
}

// Reaching: inverse kinematics from the inspector, by buttons and keys.

/** The pose that the sliders show. */
function shownPose(): number[] | undefined {
  const d = store.doc.value;
  if (!d) return undefined;
  const q = store.floating.value ?? poseAt(d.clip, store.playhead.value);
  const moving = store.moving.value;
  return d.clip.robot.joints.map((name, j) => moving?.[name] ?? q[j] ?? 0);
}

/** Values in the robot's own order of joints, which a clip need not have. */
export function inRobotOrder(q: number[]): number[] {
  const names = store.doc.value?.clip.robot.joints ?? [];
  return (store.robot.value?.table.joints ?? []).map((j) => q[names.indexOf(j.name)] ?? 0);
}

export function chooseSite(name: string | undefined): void {
  tell("view.select", name === undefined ? {} : { site: name });
}

/** The next fingertip or end effector; after the last one none. */
export function nextSite(): void {
  const names = (store.robot.value?.ik_sites ?? []).map((s) => s.name);
  if (names.length === 0) return store.toast("this robot's file names no site to pull; Alt-drag a link of it in the 3D view");
  const at = store.site.value === undefined ? -1 : names.indexOf(store.site.value);
  const next = names[at + 1];
  chooseSite(next);
  store.announcement.value = next ? `${siteTitle(next)} chosen` : "no site chosen";
}

export function siteTitle(name: string): string {
  const words: Record<string, string> = { fftip: "Index", mftip: "Middle", rftip: "Ring", lftip: "Little", thtip: "Thumb" };
  return words[name] ?? name.replaceAll("_", " ").replace(/^./, (c) => c.toUpperCase());
}

/** Where the chosen site is in the pose that is shown, m. */
const target = signal<V3 | undefined>(undefined);

function rotate([w, x, y, z]: [number, number, number, number], [a, b, c]: V3): V3 {
  const t: V3 = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]];
}

async function sitePlace(q: number[]): Promise<V3 | undefined> {
  const site = store.robot.value?.ik_sites.find((s) => s.name === store.site.value);
  if (!site) return undefined;
  const [row] = await http<number[][]>("POST", "/api/kinematics", { q: [inRobotOrder(q)] });
  const p = row?.slice(7 * site.body, 7 * site.body + 7) ?? [];
  const [x = 0, y = 0, z = 0, w = 1, a = 0, b = 0, c = 0] = p;
  const own = rotate([w, a, b, c], site.pos);
  return [x + own[0], y + own[1], z + own[2]];
}

let wanted: V3 | undefined;
let pulling = false;

/** Brings the chosen site there, as near as limits and locks allow; the newest target wins. */
export async function pullTo(pos: V3): Promise<void> {
  wanted = pos;
  target.value = pos;
  if (pulling) return;
  pulling = true;
  try {
    for (let to: V3 | undefined = wanted; to; to = wanted) {
      wanted = undefined;
      const site = store.site.value;
      const d = store.doc.value;
      const q = shownPose();
      if (site === undefined || !d || !q) return;
      const locked = [...store.locked.value];
      const found = await http<{ q: number[]; distance_m: number; reached: boolean }>("POST", "/api/ik", { q: inRobotOrder(q), site, pos: to, locked });
      const changes: Record<string, number> = {};
      (store.robot.value?.table.joints ?? []).forEach((j, i) => {
        const at = d.clip.robot.joints.indexOf(j.name);
        const v = found.q[i];
        if (at >= 0 && v !== undefined && Math.abs(v - (q[at] ?? 0)) > 1e-6) changes[j.name] = Math.round(v * 1e6) / 1e6;
      });
      if (!found.reached && found.distance_m > 1e-3) store.toast(`${siteTitle(site)} stops ${(found.distance_m * 1000).toFixed(0)} mm short: limits or locks hold it`);
      if (Object.keys(changes).length > 0) await jointMoved(changes, true);
    }
  } catch (e) {
    complain(e);
  } finally {
    pulling = false;
  }
}

function Target() {
  useEffect(() => {
    let timer = 0;
    let shown = "";
    // What the pose is made of; the frames of a rollout come many times a second.
    const stop = effect(() => {
      const q = shownPose();
      const now = `${store.site.value} ${q?.map((v) => v.toFixed(5)).join()}`;
      if (!q || now === shown) return;
      shown = now;
      clearTimeout(timer);
      timer = window.setTimeout(() => void sitePlace(q).then((p) => {
        if (p && !pulling) target.value = p;
      }).catch(complain), 40);
    });
    return () => {
      clearTimeout(timer);
      stop();
    };
  }, []);
  const at = target.value;
  return (
    <span class="target">
      {(["x", "y", "z"] as const).map((axis, k) => (
        <label key={axis}>{axis}
          <input type="text" inputMode="decimal" aria-label={`${axis} of ${siteTitle(store.site.value ?? "")}, m`} data-testid={`reach-${axis}`}
            title="Metres in the world. Arrow keys: 5 mm, with Shift 1 mm" disabled={!at} value={at ? (at[k] ?? 0).toFixed(3) : ""}
            onChange={(e) => {
              const v = Number(e.currentTarget.value.replace(",", ".").replace(/ *m$/, ""));
              if (!at || !Number.isFinite(v)) return store.toast(`"${e.currentTarget.value}" is no length in metres`, "error");
              const to: V3 = [...at];
              to[k] = v;
              void pullTo(to);
            }}
            onKeyDown={(e) => {
              if ((e.key !== "ArrowUp" && e.key !== "ArrowDown") || !at) return;
              e.preventDefault();
              const to: V3 = [...at];
              to[k] = (at[k] ?? 0) + NUDGE_M * (e.shiftKey ? 0.2 : 1) * (e.key === "ArrowUp" ? 1 : -1);
              void pullTo(to);
            }} />
        </label>
      ))}
      <span class="unit">m</span>
    </span>
  );
}

/** Buttons of the fingertips or the end effector, and where the chosen one is. */
export function Reach() {
  const sites = store.robot.value?.ik_sites ?? [];
  if (sites.length === 0) return null;
  return (
    <div class="reach" role="group" aria-label="Reach" data-testid="reach">
      <span class="what" title="The other joints follow (inverse kinematics). In the 3D view: Alt-drag. Lock a joint to keep it">Reach</span>
      {sites.map((s) => (
        <button key={s.name} aria-pressed={store.site.value === s.name} title={`Pull ${siteTitle(s.name)}; G takes the next one`}
          onClick={() => chooseSite(store.site.value === s.name ? undefined : s.name)} data-testid={`site-${s.name}`}>{siteTitle(s.name)}</button>
      ))}
      {store.site.value === undefined ? null : <Target />}
    </div>
  );
}

// What the pointer is over.

/** The joint that moves a body of this name: its own, else that of the nearest one it hangs on. */
function jointOf(body: string): string | undefined {
  const robot = store.robot.value;
  let at = robot?.bodies.findIndex((b) => b.name === body) ?? -1;
  for (let steps = 0; robot && at >= 0 && steps < robot.bodies.length; steps++) {
    const fact = robot.bodies[at];
    const joint = fact?.joints.at(-1);
    if (joint !== undefined) return robot.table.joints[joint]?.name;
    if (!fact || at === 0) return undefined;
    at = fact.parent;
  }
  return undefined;
}

const over = signal<{ x: number; y: number; body: string } | undefined>(undefined);
let asking = false;
let next: (() => Promise<void>) | undefined;

/** The pointer is there, in pixels of the viewport; `ask` finds out what is under it. */
export function hover(x: number, y: number, ask: () => Promise<string | null>): void {
  next = async () => {
    const body = await ask();
    over.value = body === null ? undefined : { x, y, body };
  };
  if (asking) return;
  asking = true;
  void (async () => {
    try {
      for (let step: (() => Promise<void>) | undefined = next; step; step = next) {
        next = undefined;
        await step();
        // Sixteen a second are as good as sixty.
        await new Promise((resolve) => setTimeout(resolve, 60));
      }
    } catch {
      over.value = undefined;
    }
    asking = false;
  })();
}

export function hoverEnds(): void {
  next = undefined;
  over.value = undefined;
}

/** Whether the pointer is over a link. */
export const overLink = computed(() => over.value !== undefined);

/** Joint and value beside the pointer. */
export function Tip() {
  const at = over.value;
  const d = store.doc.value;
  if (!at || !d) return null;
  const moving = store.moving.value;
  const pulled = moving ? Object.keys(moving) : [];
  const joint = pulled.length === 1 ? pulled[0] : jointOf(at.body);
  const index = joint === undefined ? -1 : d.clip.robot.joints.indexOf(joint);
  const fact = d.table.joints[index];
  const frame = Math.round(store.playhead.value);
  const value = moving?.[joint ?? ""] ?? store.floating.value?.[index] ?? store.frames.value.q[frame]?.[index] ?? poseAt(d.clip, frame)[index];
  return (
    <div class="tip" style={`left: ${at.x + 14}px; top: ${at.y + 10}px`} data-testid="tip">
      {pulled.length > 1 && store.site.value ? siteTitle(store.site.value)
        : index < 0 ? at.body
        : <>{store.titles.value[index]} <b class="num">{store.shown(value ?? 0, fact?.unit ?? "rad")}</b>{isLocked(joint ?? "") ? " · locked" : ""}</>}
    </div>
  );
}
