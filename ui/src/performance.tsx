// How the rollout is made beyond the policy: guide, seed; and what to do without a policy.

import { useSignal } from "@preact/signals";
import { tell } from "./api";
import * as store from "./store";

/** Guide and seed of the rollout. */
export function Settings() {
  const s = store.settings.value;
  const text = useSignal<string | undefined>(undefined);
  const seed = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined || t === String(s.seed)) return;
    const n = Number(t);
    if (!/^\d+$/.test(t.trim()) || !Number.isSafeInteger(n)) return store.toast(`"${t}" is no seed: a whole number from 0`, "error");
    tell("rollout.set", { ...s, seed: n });
  };
  return (
    <>
      <label title="Where no goal is commanded the policy is given the straight line from what it has reached to the next goal">
        <input type="checkbox" data-testid="guide" checked={s.guide === "linear"} onChange={(e) => tell("rollout.set", { ...s, guide: e.currentTarget.checked ? "linear" : "none" })} /> guide
      </label>
      <label title="Policies that draw numbers draw the same ones with the same seed">seed{" "}
        <input type="text" inputMode="numeric" style="width: 44px" data-testid="seed" value={text.value ?? String(s.seed)}
          onInput={(e) => (text.value = e.currentTarget.value)} onBlur={seed} onKeyDown={(e) => { if (e.key === "Enter") seed(); }} />
      </label>
    </>
  );
}

/** For a robot that no policy has learned yet. */
export function NoModel() {
  const cards = store.policies.value;
  if (cards.length === 0 || store.settings.value.model_path || cards.some((p) => p.learned && p.available)) return null;
  const kinematic = !store.settings.value.auto;
  const preview = (): void => {
    store.show.value = { ...store.show.value, command: true, achieved: kinematic };
    tell("view.show", { command: true, achieved: kinematic });
    tell("rollout.set", { ...store.settings.value, auto: kinematic });
    if (!kinematic) tell("rollout.cancel");
  };
  return (
    <div class="no-model" role="note" data-testid="no-model">
      <p title="Policies that know the robot's model perform it meanwhile">No policy has learned this robot yet.</p>
      <button onClick={() => (store.page.value = "runs")} title="Collect motion and train on it: minutes, on this page">Train a small one</button>
      <button onClick={preview} aria-pressed={kinematic} title="Only the command as it is drawn, nothing simulated">Preview kinematically</button>
    </div>
  );
}
