// How many whole previews a second follow a hand on a key of the timeline, on a tangent in the graph, and
// on a diamond of the path in the 3D view, whose client is played by a script. Printed, not asserted, because it is the machine's figure as much
// as the program's. `npm run measure -- dragging`

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import type { Page } from "@playwright/test";
import { describe, Studio, type Tab, tab, test } from "./harness";
import { type Spot, sites, type V3 } from "./scene";

/** A preview simulates this many frames: from 20 before the first changed frame to the clip's end. */
const FRAMES = 100;
const AHEAD = 20;
const SECS = 5;
/** Between two events of a mouse. */
const MOVE_MS = 8;

const SUBJECTS = [
  { example: "ur5e/hang", site: "end_effector", joint: 0, radius: 0.05 },
  { example: "shadow_hand/fire", site: "thtip", joint: 1, radius: 0.01 },
];

/** The example with smooth curves between its keys, cut so that editing one key simulates so many frames. */
function clipOf(example: string): { text: string; key: number } {
  const file = join(process.cwd(), `../assets/clips/${example}.clip.json`);
  const clip = JSON.parse(readFileSync(file, "utf8"));
  const [at, before] = [4, 3];
  const first = clip.keys[before].frame + 1;
  clip.length = first - AHEAD + FRAMES;
  clip.fill = "cubic";
  clip.keys = clip.keys
    .filter((k: { frame: number }) => k.frame < clip.length)
    .map(({ frame, pose, q }: { frame: number; pose?: string; q?: number[] }) => ({
      frame,
      ...(q ? { q } : { q: clip.poses[pose ?? ""] }),
    }));
  return { text: JSON.stringify(clip), key: clip.keys[at].frame };
}

interface Counts {
  previews: number;
  frames: number;
}

/** Counts previews that came to their end, and the frames that were simulated for them. */
function count(page: Page): Counts {
  const seen: Counts = { previews: 0, frames: 0 };
  let preview = false;
  page.on("websocket", (socket) => {
    if (!socket.url().includes("/api/ws")) return;
    socket.on("framereceived", ({ payload }) => {
      const event = JSON.parse(payload.toString());
      if (event.event === "rollout.state") {
        preview = event.rev === 0;
        if (preview && event.phase === "done") seen.previews++;
      } else if (event.event === "rollout.frames" && preview) seen.frames += event.q.length;
    });
  });
  return seen;
}

type Move = (x: number, y: number) => Promise<unknown>;

/** A hand goes round on a circle of radius 1 for a few seconds. */
async function circle(t: Tab, counts: Counts, move: Move): Promise<string> {
  await move(1, 0);
  await move(1, 0.1);
  await t.until((s) => s.rollout?.rev === 0, "previewed");
  Object.assign(counts, { previews: 0, frames: 0 });
  const began = performance.now();
  for (let now = began; now < began + 1000 * SECS; now = performance.now()) {
    const turn = ((now - began) / 1000) * 2 * Math.PI;
    await move(Math.cos(turn), Math.sin(turn));
    await new Promise((later) => setTimeout(later, MOVE_MS));
  }
  const secs = (performance.now() - began) / 1000;
  const { previews, frames } = counts;
  return `${(previews / secs).toFixed(1)} whole previews a second, ${(frames / secs / FRAMES).toFixed(1)} times ${FRAMES} frames a second`;
}

/** The same with the mouse pressed at a place of the page. */
async function byMouse(t: Tab, counts: Counts, at: Spot): Promise<string> {
  await t.page.mouse.move(at.x, at.y);
  await t.page.mouse.down();
  const said = await circle(t, counts, (x, y) => t.page.mouse.move(at.x + 20 * x, at.y + 20 * y));
  await t.page.keyboard.press("Escape");
  await t.page.mouse.up();
  await t.rolledOut();
  return said;
}

/** The same by the messages of the 3D view's client, in the name of this page: nothing is drawn for it. */
async function byDiamond(t: Tab, counts: Counts, key: number, at: V3, radius: number): Promise<string> {
  await t.page.evaluate(async (name) => {
    const [tab] = (await window.__studio.after("", 0)).mark.split(".");
    const socket = new WebSocket(`ws://${location.host}/viser?tab=${tab}`, "viser-v1.1.1");
    await new Promise((open) => socket.addEventListener("open", open));
    // MessagePack of text, numbers, lists and maps of up to 15 entries.
    const packed = (v: unknown): number[] => {
      if (typeof v === "number") return [0xcb, ...new Uint8Array(new Float64Array([v]).buffer).reverse()];
      if (typeof v === "string") return [0xd9, v.length, ...new TextEncoder().encode(v)];
      if (Array.isArray(v)) return [0x90 + v.length, ...v.flatMap(packed)];
      const all = Object.entries(v as object);
      return [0x80 + all.length, ...all.flat().flatMap(packed)];
    };
    const start = { type: "SceneNodeDragMessage", name };
    Object.assign(window, {
      __drag: (phase: string, start_position: number[], end_position: number[]) =>
        socket.send(new Uint8Array(packed({ ...start, phase, start_position, end_position }))),
    });
  }, `/path/key/${key}`);
  type Hand = { __drag: (phase: string, from: V3, to: V3) => void };
  const drag = (phase: string, to: V3): Promise<void> =>
    t.page.evaluate(([p, a, b]) => (window as unknown as Hand).__drag(p, a, b), [phase, at, to] as const);
  await drag("start", at);
  const said = await circle(t, counts, (x, y) =>
    drag("update", [at[0] + radius * x - radius, at[1], at[2] + radius * y]),
  );
  await drag("end", at);
  return said;
}

describe("measure", () => {
  for (const { example, site, joint, radius } of SUBJECTS) {
    const { text, key } = clipOf(example);
    const robot = example.split("/")[0] ?? "";

    test(`${example}: a key, a tangent and a diamond are dragged`, async () => {
      const studio = await Studio.start();
      const t = await tab(studio);
      // A graphics card would draw the robot; here nobody does.
      await t.page.route("**/api/still?*", (route) => route.abort());
      const counts = count(t.page);
      await t.page.reload();
      await studio.api("POST", "/api/new", { text });
      await t.until((s) => s.page === "editor" && s.robot === robot, "open");
      await t.byId("policy").selectOption("robert");
      await t.until((s) => s.settings.policy === "robert", "the policy chosen");
      await t.rolledOut();
      console.log(`${example}, a key: ${await byMouse(t, counts, await t.at(key))}`);

      await t.page.getByRole("tab", { name: "Graph" }).click();
      await t.byId("graph").waitFor();
      await t.byId(`curve-${joint}`).click();
      await t.until((s) => s.curves.join() === String(joint), "one curve");
      await t.painted();
      const q = (await t.state()).clip?.keys.find((k) => k.frame === key)?.q as number[];
      const point = await t.graphAt(key, joint, q[joint] ?? 0);
      await t.page.mouse.click(point.x, point.y);
      await t.until((s) => s.points.join() === `${key}:${joint}`, "the point is chosen");
      await t.painted();
      const handles = await t.page.evaluate(() => window.__studio.graphHandles());
      const handle = handles.find((h) => h.kind === "tangent" && h.side === "out");
      const graph = await t.box("graph");
      assert.ok(handle, "a handle");
      const tangent = { x: graph.x + handle.x, y: graph.y + handle.y };
      console.log(`${example}, a tangent: ${await byMouse(t, counts, tangent)}`);

      await t.blur();
      await t.press("v", "g");
      for (let now = (await t.state()).site; now !== site; now = (await t.state()).site) {
        await t.press("g");
        await t.until((s) => s.site !== now, "the next end effector");
      }
      const [tip] = await sites(studio, robot, site, [q]);
      assert.ok(tip);
      console.log(`${example}, a diamond: ${await byDiamond(t, counts, key, tip, radius)}`);
      await studio.end();
    });
  }
});
