// Sites of the robot, its fingertips and end effectors: their names, and where they are.

import * as store from "./store";
import { http } from "./wire";

export type V3 = [number, number, number];
export type Quat = [number, number, number, number];

/** Values of the clip's joints in the robot's own order, which a clip need not have. */
export function inRobotOrder(q: number[]): number[] {
  const places = store.order.value;
  return places ? (store.robot.value?.table.joints ?? []).map((_, i) => q[places.indexOf(i)] ?? 0) : q;
}

/** Values in the robot's own order of joints in that of the clip. */
export function inClipOrder(q: number[]): number[] {
  return store.order.value?.map((i) => q[i] ?? 0) ?? q;
}

export function siteTitle(name: string): string {
  const words: Record<string, string> = {
    fftip: "Index",
    mftip: "Middle",
    rftip: "Ring",
    lftip: "Little",
    thtip: "Thumb",
  };
  return words[name] ?? name.replaceAll("_", " ").replace(/^./, (c) => c.toUpperCase());
}

function turned([aw, ax, ay, az]: Quat, [bw, bx, by, bz]: Quat): Quat {
  return [
    aw * bw - ax * bx - ay * by - az * bz,
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
  ];
}

function rotate([w, x, y, z]: Quat, [a, b, c]: V3): V3 {
  const t: V3 = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [
    a + w * t[0] + y * t[2] - z * t[1],
    b + w * t[1] + z * t[0] - x * t[2],
    c + w * t[2] + x * t[1] - y * t[0],
  ];
}

/** Where a site is in a pose, m, and how it is turned. */
export async function sitePlace(
  name: string | undefined,
  q: number[],
): Promise<{ pos: V3; quat: Quat } | undefined> {
  const site = store.robot.value?.ik_sites.find((s) => s.name === name);
  if (!site) return undefined;
  const [row] = await http("POST /api/kinematics", { body: { q: [inRobotOrder(q)] } });
  const p = row?.slice(7 * site.body, 7 * site.body + 7) ?? [];
  const [x = 0, y = 0, z = 0, w = 1, a = 0, b = 0, c = 0] = p;
  const own = rotate([w, a, b, c], site.pos);
  return { pos: [x + own[0], y + own[1], z + own[2]], quat: turned([w, a, b, c], site.quat) };
}
