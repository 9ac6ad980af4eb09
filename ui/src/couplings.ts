// Joints that follow others. A tendon shares a force, but does not fix where each joint is.

import type { Coupling } from "./generated/protocol";
import * as store from "./store";

/** The couplings of joints that follow others. */
export function followers(): Coupling[] {
  const all = store.doc.value?.table.couplings ?? [];
  return all.filter((c) => c.kind === "mimic");
}

/** Joints that move with this one: how far each goes when it goes by one, and where each is when it is at 0. A joint
 * with a coefficient of 0 stands still, whatever the others do: it takes none along. */
function bonds(name: string): { joint: string; share: number; offset: number }[] {
  return followers().flatMap(({ members }) => {
    const own = members.find((m) => m.joint === name);
    if (!own?.coef) return [];
    return members
      .filter((m) => m !== own)
      .map((m) => {
        const share = m.coef / own.coef;
        return { joint: m.joint, share, offset: m.offset - share * own.offset };
      });
  });
}

/** All joints that move with this one, with their values when it is at `value`. */
export function together(name: string, value: number): Record<string, number> {
  const others = bonds(name).map((b) => [b.joint, b.share * value + b.offset]);
  return { [name]: value, ...Object.fromEntries(others) };
}

/** All joints that move with this one, with how far each goes when it goes by one. */
export function shares(name: string): Record<string, number> {
  return { [name]: 1, ...Object.fromEntries(bonds(name).map((b) => [b.joint, b.share])) };
}
