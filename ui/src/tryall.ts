// Every policy that answers at once performs the clip as it stands, and the nearest is proposed.

import { effect, signal } from "@preact/signals";
import { tell } from "./api";
import type { PolicyCard, RolloutSettings } from "./protocol";
import * as store from "./store";

/** Nearer by less than this share is not worth a change. */
const WORTH = 0.1;

export interface Tried {
  card: PolicyCard;
  mae: number;
}

export const trying = signal<string | undefined>(undefined);
export const tried = signal<{ rev: number; rows: Tried[] } | undefined>(undefined);

export const policyId = (p: { name: string; model?: string }): string => (p.model ? `${p.name}:${p.model}` : p.name);

/** Settings with this policy and all else as it is. */
export function withPolicy(settings: RolloutSettings, card: PolicyCard): RolloutSettings {
  const { model_path: _, ...rest } = settings;
  return { ...rest, policy: card.name, ...(card.model ? { model_path: card.model } : {}) };
}

/** The mean error of the rollout that follows these settings; null when it fails or the clip changes. */
function performed(settings: RolloutSettings): Promise<number | null> {
  const before = store.rollout.value?.gen ?? -1;
  const rev = store.doc.value?.rev;
  return new Promise((resolve) => {
    let stop = (): void => undefined;
    const end = (mae: number | null): void => {
      clearTimeout(late);
      queueMicrotask(() => stop());
      resolve(mae);
    };
    const late = setTimeout(() => end(null), 30_000);
    stop = effect(() => {
      const r = store.rollout.value;
      if (store.doc.value?.rev !== rev) end(null);
      else if (r && r.gen > before && r.phase === "done") end(r.mae);
      else if (r && r.gen > before && r.phase === "failed") end(null);
    });
    tell("rollout.set", { ...settings });
  });
}

/** Tries all of them and goes back to the one in use. */
export async function tryAll(): Promise<void> {
  const own = store.settings.value;
  const rev = store.doc.value?.rev ?? 0;
  const rows: Tried[] = [];
  const cards = store.policies.value.filter((p) => p.available && p.name !== "zero" && !p.slow);
  for (const card of cards) {
    if (store.doc.value?.rev !== rev) break;
    trying.value = policyId(card);
    const mae = await performed(withPolicy(own, card));
    if (mae !== null) rows.push({ card, mae });
  }
  trying.value = undefined;
  tell("rollout.set", { ...own });
  if (store.doc.value?.rev !== rev) return store.toast("the clip changed: try again when it rests");
  rows.sort((a, b) => a.mae - b.mae);
  tried.value = { rev, rows };
}

/** The nearest of those that know as much as the one in use, where the change is worth it. */
export function proposal(): Tried | undefined {
  const now = policyId({ name: store.settings.value.policy, ...(store.settings.value.model_path ? { model: store.settings.value.model_path } : {}) });
  const rows = tried.value?.rev === store.doc.value?.rev ? (tried.value?.rows ?? []) : [];
  const own = rows.find((r) => policyId(r.card) === now);
  const best = rows.find((r) => !own || r.card.knows_model === own.card.knows_model);
  return best && best !== own && (!own || best.mae < own.mae * (1 - WORTH)) ? best : undefined;
}
