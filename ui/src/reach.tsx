// Reaching: inverse kinematics from the inspector, by buttons and keys.

import { effect, signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { fixed, LENGTHS, parseNumber } from "./numbers";
import { Pins, type Pull, solve } from "./pins";
import { shownPose } from "./posing";
import { sitePlace, siteTitle, type V3 } from "./sites";
import * as store from "./store";
import { complain, tell } from "./wire";

/** Metres that an arrow key moves a target; with Shift a fifth. */
const NUDGE_M = 0.005;

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

/** Where a site is in the pose that is shown, m. */
const target = signal<{ site: string | undefined; pos: V3 } | undefined>(undefined);

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
    const site = store.site.value;
    try {
      const place = await sitePlace(site, q);
      if (place && own === measuring) target.value = { site, pos: place.pos };
    } catch (e) {
      complain(e);
    }
  }, 40);
}

/** Where a site is to go: each with its own place, because another site may be chosen before its turn comes. */
let wanted: Pull | undefined;
let pulling = false;

/** Brings the chosen site there, as near as limits and locks allow; the newest target wins. */
export async function pullTo(pos: V3): Promise<void> {
  const site = store.site.value;
  if (site === undefined) return;
  wanted = { site, pos };
  target.value = wanted;
  forget();
  if (pulling) return;
  pulling = true;
  try {
    for (let to: Pull | undefined = wanted; to; to = wanted) {
      wanted = undefined;
      const found = await solve(to);
      if (found && found.distance_m > 1e-3)
        store.toast(
          `${siteTitle(to.site)} stops ${(found.distance_m * 1000).toFixed(0)} mm short of the target: joint limits, locks or pins prevent more`,
          "info",
          false,
          "reach",
        );
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
  /** What is typed and not yet sent, by axis: all three become one edit. */
  const typed = useSignal<(string | undefined)[]>([]);
  // Where the site that was chosen before is, is no place of this one.
  const at = target.value?.site === store.site.value ? target.value?.pos : undefined;
  if (!at) return <span class="target" aria-busy="true" />;
  const send = (): void => {
    const texts = typed.value;
    typed.value = [];
    if (!texts.some((t) => t !== undefined)) return;
    const values = at.map((v, k) => {
      const text = texts[k];
      return text === undefined ? v : parseNumber(text, LENGTHS, 1, v);
    });
    const wrong = values.indexOf(undefined);
    if (wrong >= 0) store.toast(`"${texts[wrong]}" is not a length in metres`, "error");
    else void pullTo(values as V3);
  };
  return (
    <span
      class="target"
      // From one field to the next nothing is sent: x, y and z are one edit.
      onFocusOut={(e) => {
        if (!(e.relatedTarget instanceof Node && e.currentTarget.contains(e.relatedTarget))) send();
      }}
    >
      {(["x", "y", "z"] as const).map((axis, k) => (
        <label key={axis}>
          {axis}
          <input
            type="text"
            inputMode="decimal"
            aria-label={`${axis} of ${siteTitle(store.site.value ?? "")}, m`}
            data-testid={`reach-${axis}`}
            title="Metres in the world; Enter moves all three. Arrow keys: 5 mm, with Shift 1 mm"
            value={typed.value[k] ?? fixed(at[k] ?? 0, 3)}
            onInput={(e) => {
              const texts = [...typed.value];
              texts[k] = e.currentTarget.value;
              typed.value = texts;
            }}
            onKeyDown={(e) => {
              if (e.key === "Escape") typed.value = [];
              // Leaving the three fields sends them.
              if (e.key === "Enter" || e.key === "Escape") e.currentTarget.blur();
              if (e.key !== "ArrowUp" && e.key !== "ArrowDown") return;
              e.preventDefault();
              typed.value = [];
              const by = NUDGE_M * (e.shiftKey ? 0.2 : 1) * (e.key === "ArrowUp" ? 1 : -1);
              void pullTo(at.with(k, (at[k] ?? 0) + by) as V3);
            }}
          />
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
      {store.site.value === undefined ? null : <Target key={store.site.value} />}
      <Pins />
    </div>
  );
}
