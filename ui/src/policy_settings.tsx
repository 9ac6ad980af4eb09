// How the rollout is made beyond the policy: guide, seed; and what to do without a policy.

import { useSignal } from "@preact/signals";
import { trainedFor, withRun } from "./policy";
import type { Guide } from "./protocol";
import * as store from "./store";
import { trying } from "./tryall";
import { tell } from "./wire";

const GUIDES: [Guide, string, string][] = [
  ["none", "the policy decides", "It sees that these frames are free"],
  ["linear", "straight line", "From the reached pose to the next goal, drawn anew in every frame"],
  ["smooth", "smooth curve", "From goal to goal, planned before the rollout"],
];

/** Refinement, guide and seed of the rollout. */
export function Settings() {
  const s = store.settings.value;
  const text = useSignal<string | undefined>(undefined);
  const seed = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined || t === String(s.seed)) return;
    const n = Number(t);
    if (!/^\d+$/.test(t.trim()) || !Number.isSafeInteger(n))
      return store.toast(`"${t}" is not a seed: type a whole number, 0 or more`, "error");
    tell("rollout.set", { ...s, seed: n });
  };
  return (
    <fieldset class="settings" disabled={trying.value !== undefined}>
      <legend>Settings</legend>
      <label title="Improves each action of the policy by one planning step on the robot model; slower">
        <input
          type="checkbox"
          checked={s.refine}
          onChange={(e) => tell("rollout.set", { ...s, refine: e.currentTarget.checked })}
        />{" "}
        refine each action
      </label>
      <label title="What the policy sees in frames without a goal">
        in gaps{" "}
        <select
          data-testid="guide"
          value={s.guide}
          onChange={(e) => tell("rollout.set", { ...s, guide: e.currentTarget.value as Guide })}
        >
          {GUIDES.map(([guide, label, about]) => (
            <option key={guide} value={guide} title={about}>
              {label}
            </option>
          ))}
        </select>
      </label>
      <label title="Policies that use random numbers give the same motion for the same seed">
        seed{" "}
        <input
          type="text"
          inputMode="numeric"
          style="width: 56px"
          data-testid="seed"
          value={text.value ?? String(s.seed)}
          onInput={(e) => (text.value = e.currentTarget.value)}
          onBlur={seed}
          onKeyDown={(e) => {
            if (e.key === "Enter") e.currentTarget.blur();
          }}
        />
      </label>
    </fieldset>
  );
}

/** For a robot that no policy has learned yet. */
export function NoModel() {
  const cards = store.policies.value;
  if (cards.length === 0 || store.settings.value.model_path || cards.some((p) => p.learned && p.available))
    return null;
  const trained = trainedFor(store.doc.value?.clip.robot.id, store.workspace.value.runs);
  const kinematic = !store.settings.value.auto;
  const preview = (): void => {
    store.show.value = { ...store.show.value, command: true, achieved: kinematic };
    tell("view.show", { command: true, achieved: kinematic });
    tell("rollout.set", { ...store.settings.value, auto: kinematic });
    if (!kinematic) tell("rollout.cancel");
  };
  return (
    <div class="no-model" role="note" data-testid="no-model">
      {trained.length ? (
        <>
          <p>A policy that was trained here can perform:</p>
          {trained.map((run) => (
            <button
              key={run.path}
              class="main"
              onClick={() => tell("rollout.set", withRun(store.settings.value, run, cards))}
            >
              Use {run.path}
            </button>
          ))}
        </>
      ) : (
        <p title="Policies that use the robot model need no training">
          No policy is trained for this robot yet.
        </p>
      )}
      <button
        onClick={() => (store.page.value = "runs")}
        title="Collect motion and train on it; takes minutes"
      >
        Train a small one
      </button>
      <button
        onClick={preview}
        aria-pressed={kinematic}
        title="Show the commanded motion without simulating it"
      >
        Preview kinematically
      </button>
    </div>
  );
}
