// Pins: sites that inverse kinematics holds, at a place or at one another, while others are moved.

import { effect, signal } from "@preact/signals";
import { Pin as PinSign, RotateCcw, X } from "lucide";
import { useEffect } from "preact/hooks";
import { Icon } from "./icon";
import { jointMoved, shownPose } from "./posing";
import type { IkAnswer, Pin } from "./protocol";
import { inClipOrder, inRobotOrder, sitePlace, siteTitle, type V3 } from "./sites";
import * as store from "./store";
import { complain, http, tell } from "./wire";

/** How far each pin is off in the pose that is shown, m. */
export const pinsOff = signal<number[]>([]);
/** Bodies that touch in that pose, and the depth, m; the deepest first. */
export const touching = signal<[string, string, number][]>([]);

/** A pin that is farther off than this is said to be, m. */
const OFF_M = 5e-4;

export function needsSite(): string | undefined {
  return store.site.value === undefined ? "select a fingertip or an end effector first (G)" : undefined;
}

export function setPins(pins: Pin[]): void {
  store.pins.value = pins;
  tell("view.pins", { pins });
}

const without = (site: string): Pin[] => store.pins.value.filter((p) => p.site !== site);

/** Holds the chosen site where it is, or lets it go. */
export async function togglePin(): Promise<void> {
  const site = store.site.value;
  if (site === undefined) return;
  if (store.pins.value.some((p) => p.site === site)) return setPins(without(site));
  await place(site, false);
}

async function place(site: string, turned: boolean): Promise<void> {
  const q = shownPose();
  if (!q) return;
  try {
    const at = await sitePlace(site, q);
    if (!at) return;
    setPins([...without(site), { site, pos: at.pos, ...(turned ? { quat: at.quat } : {}) }]);
    store.announcement.value = `${siteTitle(site)} stays where it is`;
  } catch (e) {
    complain(e);
  }
}

/** The chosen site touches another one from now on. */
async function touch(site: string, to: string): Promise<void> {
  setPins([...without(site), { site, to }]);
  await solve();
}

/** A site and the place that it is to come to, m. */
export interface Pull {
  site: string;
  pos: V3;
}

/**
 * Brings a site to a place and holds the pins meanwhile, as near as limits and locks allow; without
 * a site only the pins count. One edit.
 */
export async function solve(pull?: Pull): Promise<IkAnswer | undefined> {
  const d = store.doc.value;
  const q = shownPose();
  if (!d || !q) return undefined;
  const frame = store.playhead.value;
  const pins = store.pins.value.filter((p) => p.site !== pull?.site);
  try {
    const found = await http("POST /api/ik", {
      body: { q: inRobotOrder(q), locked: [...store.locked.value], pins, ...(pull ?? {}) },
    });
    const now = store.doc.value;
    // What was found belongs to the pose as it was then.
    if (now?.opened !== d.opened) return undefined;
    if (now.rev !== d.rev) {
      store.toast("the clip was changed meanwhile: try again");
      return undefined;
    }
    const changes: Record<string, number> = {};
    inClipOrder(found.q).forEach((v, j) => {
      const name = d.clip.robot.joints[j];
      if (name !== undefined && Math.abs(v - (q[j] ?? 0)) > 1e-6) changes[name] = Math.round(v * 1e6) / 1e6;
    });
    if (Object.keys(changes).length > 0) await jointMoved(changes, true, frame);
    return found;
  } catch (e) {
    complain(e);
    return undefined;
  }
}

let judging = false;
let next: (() => Promise<void>) | undefined;

/** Finds out how the pose that is shown is: what touches, which pins are off; the newest wins. */
function judge(): void {
  next = async () => {
    const q = shownPose();
    const pins = store.pins.value;
    const joints = (store.robot.value?.table.joints ?? []).map((j) => j.name);
    if (!q || joints.length === 0) return;
    // With every joint locked nothing moves: what is answered is about the pose as it is.
    const found = await http("POST /api/ik", { body: { q: inRobotOrder(q), locked: joints, pins } });
    if (pins === store.pins.value) pinsOff.value = found.pins_m;
    touching.value = found.contacts;
  };
  if (judging) return;
  judging = true;
  void (async () => {
    for (let step: (() => Promise<void>) | undefined = next; step; step = next) {
      next = undefined;
      // Between two documents a pose may fit neither; the next one is judged anew.
      await step().catch(() => undefined);
    }
    judging = false;
  })();
}

const words = (body: string): string => body.replaceAll("_", " ");

function touchInWords([deepest, ...more]: [string, string, number][]): string {
  if (!deepest) return "";
  const [one, other, depth] = deepest;
  const rest = more.length ? ` (and ${more.length} more)` : "";
  return `${words(one)} presses ${(depth * 1000).toFixed(1)} mm into ${words(other)}${rest}`;
}

/** What is held, and what of it cannot be. */
export function Pins() {
  useEffect(() => {
    let shown = "";
    return effect(() => {
      const pose = shownPose();
      const now = `${store.robot.value?.source} ${JSON.stringify(store.pins.value)} ${pose?.map((v) => v.toFixed(4)).join()}`;
      if (now === shown || !pose) return;
      shown = now;
      judge();
    });
  }, []);
  const site = store.site.value;
  const sites = store.robot.value?.ik_sites ?? [];
  const held = store.pins.value.some((p) => p.site === site);
  return (
    <span class="pins">
      {site === undefined ? null : (
        <span class="pin-tools">
          <button
            aria-pressed={held}
            onClick={() => void togglePin()}
            title="Keep it in place while other links move (Shift+G)"
            data-testid="pin"
          >
            <Icon of={PinSign} size={13} /> {held ? "Release" : "Pin"}
          </button>
          {sites.length > 1 ? (
            <select
              aria-label={`${siteTitle(site)} touches`}
              data-testid="touch"
              value=""
              title="Bring it and another one to the same place, tip to tip"
              onChange={(e) => {
                void touch(site, e.currentTarget.value);
                e.currentTarget.value = "";
              }}
            >
              <option value="">Touch…</option>
              {sites
                .filter((s) => s.name !== site)
                .map((s) => (
                  <option key={s.name} value={s.name}>
                    {siteTitle(s.name)}
                  </option>
                ))}
            </select>
          ) : null}
        </span>
      )}
      {store.pins.value.map((p, i) => {
        const off = pinsOff.value[i] ?? 0;
        return (
          <span class={`pin ${off > OFF_M ? "is-off" : ""}`} key={p.site} data-testid={`pin-${p.site}`}>
            <Icon of={PinSign} size={12} />
            {siteTitle(p.site)}
            {p.to ? ` touches ${siteTitle(p.to)}` : ""}
            {off > OFF_M ? (
              <b title="Joint limits, locks or other pins prevent more">{(off * 1000).toFixed(1)} mm off</b>
            ) : null}
            {p.to ? null : (
              <button
                class="quiet"
                aria-pressed={!!p.quat}
                aria-label={`Keep the orientation of ${siteTitle(p.site)}, too`}
                title="Keep its orientation, too"
                onClick={() => void place(p.site, !p.quat)}
              >
                <Icon of={RotateCcw} size={12} />
              </button>
            )}
            <button
              class="quiet"
              aria-label={`Release ${siteTitle(p.site)}`}
              onClick={() => setPins(without(p.site))}
            >
              <Icon of={X} size={12} />
            </button>
          </span>
        );
      })}
      {touching.value.length ? (
        <span class="contact" role="status" data-testid="contact" title={touchInWords(touching.value)}>
          {touchInWords(touching.value)}
        </span>
      ) : null}
    </span>
  );
}
