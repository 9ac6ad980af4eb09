// Joints that move together: the two joints of a finger that one tendon turns.

import * as store from "./store";

/** All joints that move with this one, with their values when it is at `value`. */
export function together(name: string, value: number): Record<string, number> {
  const changes: Record<string, number> = { [name]: value };
  for (const c of store.doc.value?.table.couplings ?? []) {
    const members = c.members ?? [];
    const own = members.find((m) => m.joint === name);
    if (!own) continue;
    const shared = (value - (own.offset ?? 0)) / (own.coef || 1);
    for (const m of members) changes[m.joint] = (m.coef ?? 1) * shared + (m.offset ?? 0);
  }
  return changes;
}
