// Keys on the clipboard: a fragment of the clip format, so that they can be pasted into another clip. Pure.

import { type Clip, type Key, values } from "./clip";
import type { Reach } from "./protocol";

export interface Fragment {
  format: string;
  robot: Clip["robot"];
  keys: Key[];
  poses: NonNullable<Clip["poses"]>;
}

const pointOf = (r: Reach): string => r.site ?? r.body ?? "";

/** These keys, with the poses that they name. */
export function fragmentOf(clip: Clip, keys: Key[]): Fragment {
  const named = keys.flatMap((k) => (k.pose && clip.poses?.[k.pose] ? [[k.pose, clip.poses[k.pose]]] : []));
  return { format: clip.format, robot: clip.robot, keys, poses: Object.fromEntries(named) };
}

/** The keys in a text, which may also be a whole clip; undefined where there are none. */
export function parseFragment(text: string): Fragment | undefined {
  if (!text.startsWith("{")) return undefined;
  const found = JSON.parse(text) as Partial<Fragment>;
  const { format, robot, keys, poses = {} } = found;
  if (!format?.startsWith("robert-clip/") || !robot || !Array.isArray(robot.joints)) return undefined;
  return keys?.length ? { format, robot, keys, poses } : undefined;
}

/**
 * The keys as keys of this clip, joint by joint. A named pose stays one where the clip has the same under this name.
 * Joints that the clip does not have are left out, goals for points that another robot does not have among `points`,
 * and keys that say nothing then.
 */
export function fitted(
  from: Fragment,
  clip: Clip,
  points: readonly string[],
): { keys: Key[]; left: string[] } {
  const names = clip.robot.joints;
  const places = names.map((name) => from.robot.joints.indexOf(name));
  const sameRobot = from.robot.id === clip.robot.id;
  const left = new Set<string>();
  const keys = from.keys.flatMap((key): Key[] => {
    const { q: _, pose, reach, tangents, ...rest } = key;
    const row = key.q ?? (pose !== undefined ? from.poses[pose] : undefined) ?? [];
    from.robot.joints.forEach((name, i) => {
      if (typeof row[i] === "number" && !names.includes(name)) left.add(name);
    });
    const own = places.map((i) => row[i] ?? null);
    const goals = reach?.filter((r) => sameRobot || points.includes(pointOf(r))) ?? [];
    for (const r of reach ?? []) if (!goals.includes(r)) left.add(pointOf(r));
    const stated = own.some((v) => v !== null);
    if (!stated && goals.length === 0) return [];
    const isSame = pose !== undefined && values(clip, { frame: 0, pose }).join() === own.join();
    const slopes = Object.entries(tangents ?? {}).filter(([name]) => names.includes(name));
    return [
      {
        ...rest,
        ...(isSame ? { pose } : stated ? { q: own } : {}),
        ...(goals.length ? { reach: goals } : {}),
        ...(slopes.length ? { tangents: Object.fromEntries(slopes) } : {}),
      },
    ];
  });
  // A goal of a robot that has nothing in common with this one would be no motion of this one.
  return { keys: places.some((i) => i >= 0) ? keys : [], left: [...left] };
}
