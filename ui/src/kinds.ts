// Problems by kind, and the one edit that mends all of a kind. Pure.

import type { Lint, Op } from "./protocol";

/** Problems of one rule whose first fix is the same. */
export interface Kind {
  name: string;
  rule: string;
  level: Lint["level"];
  /** Of the fix; empty without one. */
  title: string;
  fixable: number;
  lints: Lint[];
}

/** Kinds in the order of their worst problems. */
export function kindsOf(lints: readonly Lint[]): Kind[] {
  const kinds = new Map<string, Kind>();
  for (const lint of lints) {
    const { rule, level } = lint;
    const title = lint.mends[0]?.title ?? "";
    const name = `${rule}:${level}:${title}`;
    const kind = kinds.get(name) ?? { name, rule, level, title, fixable: 0, lints: [] };
    kind.lints.push(lint);
    if (title) kind.fixable++;
    kinds.set(name, kind);
  }
  return [...kinds.values()];
}

/** The first fix of each problem as one edit, from the end of the clip to its beginning: a fix that moves what
 * follows leaves the others' frames as they are. Keys that share a pose share its fix. */
export function fixAll(kind: Kind): Op | undefined {
  const from = (l: Lint): number => l.frames?.[0] ?? 0;
  const ops = new Map<string, Op>();
  for (const lint of [...kind.lints].sort((a, b) => from(b) - from(a))) {
    const op = lint.mends[0]?.op;
    if (op) ops.set(JSON.stringify(op), op);
  }
  const all = [...ops.values()];
  return all.length < 2
    ? all[0]
    : { op: "batch", args: { label: `${kind.title}: ${kind.fixable} problems`, ops: all } };
}
