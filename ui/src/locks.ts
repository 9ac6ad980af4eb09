// Joints that no hand moves.

import { followers } from "./couplings";
import * as store from "./store";
import { tell } from "./wire";

/** Joints that follow this one, or that it follows. */
function bound(name: string): string[] {
  return followers().flatMap((c) =>
    c.members?.some((m) => m.joint === name) ? c.members.map((m) => m.joint) : [],
  );
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

/** The values of a new key: it says nothing about locked joints, so their holds and fills go on. */
export function unlocked(q: readonly (number | null)[]): (number | null)[] {
  const all = store.doc.value?.clip.robot.joints ?? [];
  return q.map((v, j) => (isLocked(all[j] ?? "") ? null : v));
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
