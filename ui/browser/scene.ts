// What is in the 3D view, asked of its client: where things are on the page, and what is drawn.

import assert from "node:assert/strict";
import type { Frame } from "@playwright/test";
import { eventually, type Studio, type Tab } from "./harness";

export type V3 = [number, number, number];
export interface Spot {
  x: number;
  y: number;
}

function frameOf(t: Tab): Frame {
  const frame = t.page.frames().find((f) => f.url().includes("/viser/"));
  assert.ok(frame, "the 3D view is there");
  return frame;
}

/** Waits until the 3D view has drawn three more pictures: two may have been under way. A view that rests draws one a second,
 * so it is asked for each. */
export async function drawn(t: Tab): Promise<void> {
  const frame = frameOf(t);
  const count = (): Promise<number> =>
    frame.evaluate(() => {
      (window as any).__viserMutable?.requestRender();
      return (window as any).__viserTestpoints?.rendererInfo?.render?.frame ?? 0;
    });
  const from = await count();
  await eventually(async () => (await count()) >= from + 3, "the 3D view draws");
}

/** What the client of the 3D view knows. */
export function viser<T, A = string>(t: Tab, ask: (viser: any, arg: A) => T, arg: A = "" as A): Promise<T> {
  return frameOf(t).evaluate(
    `(${ask.toString()})(window.__viserMutable, ${JSON.stringify(arg)})`,
  ) as Promise<T>;
}

/** Where the camera is. */
export const camera = (t: Tab): Promise<number[]> => viser(t, (v) => v.camera.position.toArray() as number[]);

export const apart = (a: number[], b: number[]): number => Math.hypot(...a.map((v, k) => v - (b[k] ?? 0)));

/** Nodes of the scene whose names begin so. */
export const nodes = (t: Tab, root: string): Promise<string[]> =>
  viser(
    t,
    (v, name) => Object.keys(v.nodeRefFromName).filter((n) => n.startsWith(name) && v.nodeRefFromName[n]),
    root,
  );

/** The number of meshes of a figure that are drawn. */
export const meshesOf = (t: Tab, root: string): Promise<number> => meshesIn(frameOf(t), root);

/** The same in any page of the client. */
export const meshesIn = (frame: Frame, root: string): Promise<number> =>
  frame.evaluate((name) => {
    let count = 0;
    (window as any).__viserMutable?.nodeRefFromName[name]?.traverse((o: any) => {
      if (!o.isMesh) return;
      for (let up = o; up; up = up.parent) if (!up.visible) return;
      count++;
    });
    return count;
  }, root);

/** A place of the frame as one of the page. */
async function onPage(t: Tab, p: Spot): Promise<Spot> {
  const box = await t.page.locator("iframe").boundingBox();
  assert.ok(box);
  return { x: box.x + p.x, y: box.y + p.y };
}

/** Where a point of the world is on the page. */
export async function seen(t: Tab, at: V3): Promise<Spot> {
  const p = await viser(
    t,
    (v, [x, y, z]) => {
      // Viser turns its scene so that y is up; the robot's root stands where the world's does.
      const root = v.nodeRefFromName["/robot"];
      root.updateWorldMatrix(true, false);
      const point = v.camera.position.clone().set(x, y, z).applyMatrix4(root.matrixWorld);
      v.camera.updateMatrixWorld();
      point.project(v.camera);
      const r = v.canvas.getBoundingClientRect();
      return { x: r.left + ((point.x + 1) / 2) * r.width, y: r.top + ((1 - point.y) / 2) * r.height };
    },
    at,
  );
  return onPage(t, p);
}

/** Where the middle of a node's mesh is on the page, as soon as it is in view. */
export function middleOf(t: Tab, node: string): Promise<Spot> {
  return eventually(async () => {
    const p = await viser(
      t,
      (v, name) => {
        let mesh: any;
        v.nodeRefFromName[name]?.traverse((o: any) => {
          if (!mesh && o.isMesh && o.geometry?.attributes?.position?.count > 8) mesh = o;
        });
        if (!mesh) return undefined;
        mesh.geometry.computeBoundingSphere();
        mesh.updateWorldMatrix(true, false);
        v.camera.updateMatrixWorld();
        const at = mesh.geometry.boundingSphere.center
          .clone()
          .applyMatrix4(mesh.matrixWorld)
          .project(v.camera);
        if (Math.abs(at.x) > 1 || Math.abs(at.y) > 1) return undefined;
        const r = v.canvas.getBoundingClientRect();
        return { x: r.left + ((at.x + 1) / 2) * r.width, y: r.top + ((1 - at.y) / 2) * r.height };
      },
      node,
    );
    return p && onPage(t, p);
  }, `${node} is in view`);
}

/** The middle of a node's mesh when the view stands still, with the pointer on it. */
export async function under(t: Tab, node: string): Promise<Spot> {
  for (let p = await middleOf(t, node); ; ) {
    await t.page.mouse.move(p.x - 3, p.y);
    await t.page.mouse.move(p.x, p.y);
    // What is under the pointer is found when a frame is drawn.
    await drawn(t);
    const now = await middleOf(t, node);
    if (Math.hypot(now.x - p.x, now.y - p.y) < 0.5) return p;
    p = now;
  }
}

/** Where a site is in poses, in the world. */
export async function sites(studio: Studio, robot: string, name: string, q: number[][]): Promise<V3[]> {
  const facts = (await studio.api("GET", `/api/robot/${robot}`)).json();
  const site = facts.ik_sites.find((s: { name: string }) => s.name === name);
  assert.ok(site, name);
  const rows = (await studio.api("POST", "/api/kinematics", { q })).json() as number[][];
  return rows.map((row) => {
    const [px = 0, py = 0, pz = 0, w = 1, x = 0, y = 0, z = 0] = row.slice(7 * site.body, 7 * site.body + 7);
    const [a, b, c] = site.pos as V3;
    const t: V3 = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
    return [
      px + a + w * t[0] + y * t[2] - z * t[1],
      py + b + w * t[1] + z * t[0] - x * t[2],
      pz + c + w * t[2] + x * t[1] - y * t[0],
    ];
  });
}
