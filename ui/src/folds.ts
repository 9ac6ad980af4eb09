// Which groups of joints are folded: in the timeline and among the sliders alike, kept for each
// robot. Of a robot with many joints only the first group begins open; the group of the chosen joint opens.

import { effect } from "@preact/signals";
import * as store from "./store";

/** More joints than this do not fit at once. */
const MANY = 12;

const key = (robot: string): string => `folded-${robot}`;

function put(folded: ReadonlySet<string>): void {
  store.closed.value = folded;
  const robot = store.robot.peek()?.id;
  if (robot) localStorage.setItem(key(robot), JSON.stringify([...folded]));
}

export function toggleGroup(name: string): void {
  const next = new Set(store.closed.value);
  if (!next.delete(name)) next.add(name);
  put(next);
}

/** What was folded for this robot; undefined when nobody folded anything yet. */
function kept(robot: string): string[] | undefined {
  try {
    const names: unknown = JSON.parse(localStorage.getItem(key(robot)) ?? "null");
    return Array.isArray(names) ? names.filter((n) => typeof n === "string") : undefined;
  } catch {
    return undefined;
  }
}

export function startFolds(): void {
  let of: string | undefined;
  effect(() => {
    const robot = store.robot.value;
    if (!robot || robot.id === of) return;
    of = robot.id;
    const later = robot.groups.slice(1).map((g) => g.name);
    store.closed.value = new Set(kept(robot.id) ?? (robot.table.joints.length > MANY ? later : []));
  });
  effect(() => {
    const joint = store.joint.value;
    const own = store.groups.value.filter((g) => joint !== undefined && g.joints.includes(joint));
    const closed = store.closed.peek();
    if (own.length === 0 || own.some((g) => !closed.has(g.name))) return;
    put(new Set([...closed].filter((name) => name !== own[0]?.name)));
  });
}
