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
import { ask, complain, Refusal, tell } from "./wire";

export const trying = signal<string | undefined>(undefined);
export const tried = signal<{ rev: number; rows: Tried[] } | undefined>(undefined);

function same(a: RolloutSettings, b: RolloutSettings): boolean {
  const parts = ["policy", "model_path", "guide", "refine", "seed", "auto"] as const;
  return parts.every((part) => a[part] === b[part]);
}

/** The mean error of the rollout that follows these settings; null when they are refused, it fails or is stopped, or
 * the clip changes; `taken` when somebody else has chosen other settings. */
function performed(settings: RolloutSettings): Promise<number | null | "taken"> {
  const before = store.rollout.value?.gen ?? -1;
  const { opened, rev } = store.doc.value ?? {};
  return new Promise((resolve) => {
    let stop = (): void => undefined;
    const end = (mae: number | null | "taken"): void => {
      queueMicrotask(() => stop());
      resolve(mae);
    };
    /** The studio has said that it performs so. */
    let settled = false;
    stop = effect(() => {
      const r = store.rollout.value;
      const d = store.doc.value;
      const own = same(store.settings.value, settings);
      settled ||= own;
      if (d?.opened !== opened || d?.rev !== rev || store.link.value !== "open") end(null);
      else if (settled && !own) end("taken");
      else if (own && r && r.gen > before && r.phase === "done") end(r.mae);
      else if (own && r && r.gen > before && (r.phase === "failed" || r.phase === "off")) end(null);
    });
    void ask("rollout.set", settings).then((reply) => {
      if (!reply.error) return;
      if (reply.error.code !== "lost") complain(new Refusal(reply.error, 422));
      end(null);
    });
  });
}

/** Tries all of them and goes back to the one in use. */
export async function tryAll(): Promise<void> {
  const own = store.settings.value;
  const { opened, rev = 0 } = store.doc.value ?? {};
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
  const unchanged = (): boolean => store.doc.value?.opened === opened && store.doc.value?.rev === rev;
  let taken = false;
  try {
    for (const card of cards) {
      for (const guide of guides(card)) {
        if (taken || !unchanged() || store.link.value !== "open") break;
        trying.value = variant(card, guide);
        // Where rollouts are started by hand, these are started all the same.
        const mae = await performed({ ...withPolicy(own, card, cards), guide, auto: true });
        taken = mae === "taken";
        if (typeof mae === "number") rows.push({ card, guide, mae });
      }
    }
  } finally {
    trying.value = undefined;
  }
  // What another page has chosen stays, and so does the policy that another document has got.
  const ours = !taken && store.doc.value?.opened === opened;
  tell("rollout.set", ours ? { ...own } : { ...store.settings.value, auto: own.auto });
  if (taken) return store.toast("another page has chosen a policy: try again");
  if (!unchanged()) return store.toast("the clip was changed: try again");
  if (rows.length === 0)
    store.toast("no policy could be measured: the clip has no goals after its first frame");
  rows.sort((a, b) => a.mae - b.mae);
  tried.value = { rev, rows };
}
