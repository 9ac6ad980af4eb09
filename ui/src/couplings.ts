// Joints that follow others. A tendon shares a force, but does not fix where each joint is.

import type { Coupling } from "./generated/protocol";
import * as store from "./store";

/** The couplings of joints that follow others. */
export function followers(): Coupling[] {
  const all = store.doc.value?.table.couplings ?? [];
  return all.filter((c) => c.kind === "mimic");
}

/** All joints that move with this one, with their values when it is at `value`. */
export function together(name: string, value: number): Record<string, number> {
  const changes: Record<string, number> = { [name]: value };
  for (const c of followers()) {
    const members = c.members ?? [];
    const own = members.find((m) => m.joint === name);
    if (!own) continue;
    const shared = (value - (own.offset ?? 0)) / (own.coef || 1);
    for (const m of members) changes[m.joint] = (m.coef ?? 1) * shared + (m.offset ?? 0);
  }
  return changes;
}
