// Every policy that answers at once performs the clip as it stands, and the nearest is proposed.

import { effect, signal } from "@preact/signals";
import {
  asCandidate,
  type Candidate,
  isAimless,
  type Tried,
  trainedFor,
  variant,
  withPolicy,
} from "./policy";
import type { Guide, RolloutSettings } from "./protocol";
import * as store from "./store";
import { tell } from "./wire";

export const trying = signal<string | undefined>(undefined);
export const tried = signal<{ rev: number; rows: Tried[] } | undefined>(undefined);

/** The mean error of the rollout that follows these settings; null when it fails, is stopped, or the clip changes. */
function performed(settings: RolloutSettings): Promise<number | null> {
  const before = store.rollout.value?.gen ?? -1;
  const rev = store.doc.value?.rev;
  return new Promise((resolve) => {
    let stop = (): void => undefined;
    const end = (mae: number | null): void => {
      queueMicrotask(() => stop());
      resolve(mae);
    };
    stop = effect(() => {
      const r = store.rollout.value;
      if (store.doc.value?.rev !== rev || store.link.value !== "open") end(null);
      else if (r && r.gen > before && r.phase === "done") end(r.mae);
      else if (r && r.gen > before && (r.phase === "failed" || r.phase === "off")) end(null);
    });
    tell("rollout.set", { ...settings });
  });
}

/** Tries all of them and goes back to the one in use. */
export async function tryAll(): Promise<void> {
  const own = store.settings.value;
  const rev = store.doc.value?.rev ?? 0;
  const rows: Tried[] = [];
  const robot = store.doc.value?.clip.robot.id;
  const cards: Candidate[] = [
    ...store.policies.value.filter((p) => p.available && !isAimless(p) && p.name !== "auto" && !p.slow),
    ...trainedFor(robot, store.workspace.value.runs).map(asCandidate),
  ];
  const masked = store.doc.value?.findings.spans.some((s) => s.kind === "masked" || s.kind === "open");
  // Where every frame is commanded there is nothing for a guide to fill. A straight line to the next goal is where the
  // others go by themselves.
  const guides = (card: Candidate): Guide[] =>
    !masked
      ? [withPolicy(own, card, cards).guide]
      : card.learned
        ? ["none", "linear", "smooth"]
        : ["none", "smooth"];
  for (const card of cards) {
    for (const guide of guides(card)) {
      if (store.doc.value?.rev !== rev) break;
      trying.value = variant(card, guide);
      const mae = await performed({ ...withPolicy(own, card, cards), guide });
      if (mae !== null) rows.push({ card, guide, mae });
    }
  }
  trying.value = undefined;
  tell("rollout.set", { ...own });
  if (store.doc.value?.rev !== rev) return store.toast("the clip was changed: try again");
  if (rows.length === 0)
    store.toast("no policy could be measured: the clip has no goals after its first frame");
  rows.sort((a, b) => a.mae - b.mae);
  tried.value = { rev, rows };
}
