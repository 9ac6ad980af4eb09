// Reaching: inverse kinematics from the inspector, by buttons and keys.

import { effect, signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { fixed, LENGTHS, parseNumber } from "./numbers";
import { jointMoved, shownPose } from "./posing";
import * as store from "./store";
import { complain, http, tell } from "./wire";

type V3 = [number, number, number];

/** Metres that an arrow key moves a target; with Shift a fifth. */
const NUDGE_M = 0.005;

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
  if (names.length === 0)
    return store.toast("the model of this robot defines no end effector; Alt-drag a link in the 3D view");
  const at = store.site.value === undefined ? -1 : names.indexOf(store.site.value);
  const next = names[at + 1];
  chooseSite(next);
  store.announcement.value = next ? `${siteTitle(next)} selected` : "no end effector selected";
}

export function siteTitle(name: string): string {
  const words: Record<string, string> = {
    fftip: "Index",
    mftip: "Middle",
    rftip: "Ring",
    lftip: "Little",
    thtip: "Thumb",
  };
  return words[name] ?? name.replaceAll("_", " ").replace(/^./, (c) => c.toUpperCase());
}

/** Where the chosen site is in the pose that is shown, m. */
const target = signal<V3 | undefined>(undefined);

function rotate([w, x, y, z]: [number, number, number, number], [a, b, c]: V3): V3 {
  const t: V3 = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [
    a + w * t[0] + y * t[2] - z * t[1],
    b + w * t[1] + z * t[0] - x * t[2],
    c + w * t[2] + x * t[1] - y * t[0],
  ];
}

async function sitePlace(q: number[]): Promise<V3 | undefined> {
  const site = store.robot.value?.ik_sites.find((s) => s.name === store.site.value);
  if (!site) return undefined;
  const [row] = await http("POST /api/kinematics", { body: { q: [inRobotOrder(q)] } });
  const p = row?.slice(7 * site.body, 7 * site.body + 7) ?? [];
  const [x = 0, y = 0, z = 0, w = 1, a = 0, b = 0, c = 0] = p;
  const own = rotate([w, a, b, c], site.pos);
  return [x + own[0], y + own[1], z + own[2]];
}

let measuring = 0;
let timer = 0;

/** What is being measured is of a pose that is no more. */
function forget(): void {
  measuring++;
  clearTimeout(timer);
}

/** Finds out where the chosen site is, once the pose has rested for a moment. */
function measure(): void {
  forget();
  const own = measuring;
  timer = window.setTimeout(async () => {
    const q = shownPose();
    if (!q || pulling) return;
    try {
      const place = await sitePlace(q);
      if (place && own === measuring) target.value = place;
    } catch (e) {
      complain(e);
    }
  }, 40);
}

let wanted: V3 | undefined;
let pulling = false;

/** Brings the chosen site there, as near as limits and locks allow; the newest target wins. */
export async function pullTo(pos: V3): Promise<void> {
  wanted = pos;
  target.value = pos;
  forget();
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
      const found = await http("POST /api/ik", { body: { q: inRobotOrder(q), site, pos: to, locked } });
      const changes: Record<string, number> = {};
      (store.robot.value?.table.joints ?? []).forEach((j, i) => {
        const at = d.clip.robot.joints.indexOf(j.name);
        const v = found.q[i];
        if (at >= 0 && v !== undefined && Math.abs(v - (q[at] ?? 0)) > 1e-6)
          changes[j.name] = Math.round(v * 1e6) / 1e6;
      });
      if (!found.reached && found.distance_m > 1e-3)
        store.toast(
          `${siteTitle(site)} stops ${(found.distance_m * 1000).toFixed(0)} mm short of the target: joint limits or locks prevent more`,
          "info",
          false,
          "reach",
        );
      if (Object.keys(changes).length > 0) await jointMoved(changes, true);
    }
  } catch (e) {
    complain(e);
  } finally {
    pulling = false;
    measure();
  }
}

function Target() {
  useEffect(() => {
    // Where another site was, or this one long ago, is no place to start from.
    target.value = undefined;
    let shown = "";
    // What the pose is made of; the frames of a rollout come many times a second.
    const stop = effect(() => {
      const now = `${store.site.value} ${shownPose()
        ?.map((v) => v.toFixed(5))
        .join()}`;
      if (now === shown) return;
      shown = now;
      measure();
    });
    return () => {
      stop();
      forget();
    };
  }, []);
  const at = target.value;
  if (!at) return <span class="target" aria-busy="true" />;
  return (
    <span class="target">
      {(["x", "y", "z"] as const).map((axis, k) => (
        <Coordinate
          key={axis}
          axis={axis}
          value={at[k] ?? 0}
          onChange={(v) => void pullTo(at.with(k, v) as V3)}
        />
      ))}
      <span class="unit">m</span>
    </span>
  );
}

/** What is typed stays as it is typed until Enter, whatever the robot does meanwhile. */
function Coordinate(props: { axis: string; value: number; onChange: (value: number) => void }) {
  const text = useSignal<string | undefined>(undefined);
  const typed = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined) return;
    const value = parseNumber(t, LENGTHS);
    if (value === undefined) store.toast(`"${t}" is not a length in metres`, "error");
    else props.onChange(value);
  };
  return (
    <label>
      {props.axis}
      <input
        type="text"
        inputMode="decimal"
        aria-label={`${props.axis} of ${siteTitle(store.site.value ?? "")}, m`}
        data-testid={`reach-${props.axis}`}
        title="Metres in the world. Arrow keys: 5 mm, with Shift 1 mm"
        value={text.value ?? fixed(props.value, 3)}
        onInput={(e) => (text.value = e.currentTarget.value)}
        onBlur={typed}
        onKeyDown={(e) => {
          if (e.key === "Enter") typed();
          if (e.key === "Escape") text.value = undefined;
          if (e.key !== "ArrowUp" && e.key !== "ArrowDown") return;
          e.preventDefault();
          text.value = undefined;
          props.onChange(props.value + NUDGE_M * (e.shiftKey ? 0.2 : 1) * (e.key === "ArrowUp" ? 1 : -1));
        }}
      />
    </label>
  );
}

/** Buttons of the fingertips or the end effector, and where the chosen one is. */
export function Reach() {
  const sites = store.robot.value?.ik_sites ?? [];
  if (sites.length === 0) return null;
  return (
    <div class="reach" role="group" aria-label="Reach" data-testid="reach">
      <span
        class="what"
        title="The other joints follow (inverse kinematics). In the 3D view: Alt-drag. Lock a joint to hold it still"
      >
        Reach
      </span>
      {sites.map((s) => (
        <button
          key={s.name}
          aria-pressed={store.site.value === s.name}
          title={`Pull ${siteTitle(s.name)}; G selects the next one`}
          onClick={() => chooseSite(store.site.value === s.name ? undefined : s.name)}
          data-testid={`site-${s.name}`}
        >
          {siteTitle(s.name)}
        </button>
      ))}
      {store.site.value === undefined ? null : <Target />}
    </div>
  );
}
