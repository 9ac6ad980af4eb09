// Policies side by side: their names, what settings ask for one, and which of those tried is nearest.

import type { Guide, PolicyCard, RolloutSettings, RunCard } from "./protocol";

/** Nearer by less than this share is not worth a change. */
const WORTH = 0.1;

/** A policy of the program, or one that a run of this folder has trained. */
export type Candidate = PolicyCard & { run?: string };

export interface Tried {
  card: Candidate;
  guide: Guide;
  mae: number;
}

export const policyId = (p: { name: string; model?: string }): string =>
  p.model ? `${p.name}:${p.model}` : p.name;
/** The policy that settings name, as `policyId` does. */
const idOf = (s: RolloutSettings): string =>
  policyId({ name: s.policy, ...(s.model_path ? { model: s.model_path } : {}) });
/** What was tried, as tables show it. */
export const variant = (card: Candidate, guide: Guide): string =>
  (card.run ?? policyId(card)) + { none: "", linear: "+guide", smooth: "+smooth" }[guide];

/** Whether a policy ignores the goals. */
export const isAimless = (p: PolicyCard): boolean => p.name === "zero" || p.name === "random";

/** Settings without a model, and without the guide where the policy in use wanted it. */
export function leaving(settings: RolloutSettings, cards: PolicyCard[]): RolloutSettings {
  const { model_path: _, ...rest } = settings;
  const wanted = cards.find((c) => policyId(c) === idOf(settings))?.guide ?? "none";
  return wanted === "none" ? rest : { ...rest, guide: "none" };
}

/** Settings with this policy and the guide it wants, and all else as it is. */
export function withPolicy(
  settings: RolloutSettings,
  card: PolicyCard,
  cards: PolicyCard[],
): RolloutSettings {
  const rest = leaving(settings, cards);
  const guide = card.guide === "none" ? rest.guide : card.guide;
  return { ...rest, guide, policy: card.name, ...(card.model ? { model_path: card.model } : {}) };
}

/** Settings with the policy that a run of this folder has trained. */
export function withRun(settings: RolloutSettings, run: RunCard, cards: PolicyCard[]): RolloutSettings {
  return { ...leaving(settings, cards), policy: "robert", ...(run.model ? { model_path: run.model } : {}) };
}

/** The policy of a run, to be tried beside the others. */
export function asCandidate(run: RunCard): Candidate {
  return {
    name: "robert",
    ...(run.model ? { model: run.model } : {}),
    run: run.path,
    suits: "what it was trained for here",
    guide: "none",
    knows_model: false,
    slow: false,
    available: true,
    learned: true,
    default: false,
  };
}

/** Runs that can perform with this robot. */
export function trainedFor(robot: string | undefined, runs: RunCard[]): RunCard[] {
  return runs.filter((r) => r.model !== null && r.robot === robot);
}

/** The best of each policy, nearest first, and the one in use. */
export function shown(rows: Tried[], settings: RolloutSettings): Tried[] {
  const first = (t: Tried): boolean => rows.find((r) => r.card === t.card) === t;
  return rows.filter((t) => first(t) || inUse(t, settings));
}

const inUse = (t: Tried, settings: RolloutSettings): boolean =>
  policyId(t.card) === idOf(settings) && t.guide === settings.guide;

/** The nearest of those that know as much as the one in use, where the change is worth it; nothing where that one was not tried. */
export function nearest(rows: Tried[], settings: RolloutSettings): Tried | undefined {
  const own = rows.find((r) => inUse(r, settings));
  const best = own && rows.find((r) => r.card.knows_model === own.card.knows_model);
  return best && best.mae < own.mae * (1 - WORTH) ? best : undefined;
}
