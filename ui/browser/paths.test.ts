// The path of what is selected, in the 3D view: its diamonds are keys, its line takes new ones; a
// line that is drawn becomes keys.

import assert from "node:assert/strict";
import { isDeepStrictEqual } from "node:util";
import { ARM, before, describe, eventually, inView, type Studio, type Tab, test } from "./harness";
import { drawn, nodes, type Spot, seen, sites, type V3 } from "./scene";

const PUCK = JSON.stringify({
  format: "robert-clip/1",
  name: "puck",
  robot: { id: "pointmass", joints: ["x", "y"] },
  fps: 20,
  length: 40,
  fill: "linear",
  keys: [
    { frame: 0, q: [0, 0] },
    { frame: 15, q: [0.4, 0.5] },
    { frame: 30, q: [-0.1, -0.1] },
  ],
});

/** The arm sweeps far enough that the keys of its tool are apart on the page. */
const SWEEP = JSON.stringify({
  ...JSON.parse(ARM),
  name: "sweep",
  keys: [
    { frame: 0, q: [-1.9, -1.57, 1.57, -1.57, -1.57] },
    { frame: 30, q: [-1.2, -1.2, 1.2, -1.5, -1.5] },
    { frame: 60, q: [-0.5, -1.5, 1.3, -1.4, -1.6] },
  ],
});

/** Distance of a point from a line. */
function away(p: V3, line: V3[]): number {
  let best = Number.POSITIVE_INFINITY;
  for (let i = 1; i < line.length; i++) {
    const [a, b] = [line[i - 1] as V3, line[i] as V3];
    const along = b.map((v, k) => v - (a[k] ?? 0));
    const to = p.map((v, k) => v - (a[k] ?? 0));
    const long = along.reduce((s, v) => s + v * v, 0);
    const share = long
      ? Math.min(1, Math.max(0, to.reduce((s, v, k) => s + v * (along[k] ?? 0), 0) / long))
      : 0;
    best = Math.min(best, Math.hypot(...to.map((v, k) => v - share * (along[k] ?? 0))));
  }
  return best;
}

/** Goes through points of the page with the button down. */
async function stroke(t: Tab, points: Spot[], steps: number): Promise<void> {
  const [first] = points;
  assert.ok(first);
  await t.page.mouse.move(first.x, first.y);
  await t.page.mouse.down();
  for (const p of points.slice(1)) await t.page.mouse.move(p.x, p.y, { steps });
  await t.page.mouse.up();
}

describe("paths in the 3D view", () => {
  let studio: Studio;
  let g: Tab;

  inView(
    (with_, page) => {
      [studio, g] = [with_, page];
    },
    { width: 1280, height: 800 },
    SWEEP,
  );
  before(() => g.toggle("Ghosts", "Command"));

  /** The commanded tip at frames of keys. */
  const tips = async (): Promise<V3[]> => {
    const q = (await g.state()).clip?.keys.map((k) => k.q as number[]) ?? [];
    return sites(studio, "ur5e", "end_effector", q);
  };

  test("the selected end effector has a path with a diamond for each key; a diamond moves its key", async () => {
    await g.goTo(70);
    await g.press("g");
    await g.until((s) => s.site === "end_effector", "selected");
    await eventually(
      async () =>
        (await nodes(g, "/path/key/")).length === 3 && (await nodes(g, "/path/reached")).length === 1,
      "a path with three diamonds",
    );
    await drawn(g);
    await g.picture("path");
    const before = await g.state();
    const [, at] = await tips();
    assert.ok(at);
    const from = await seen(g, at);
    await g.page.mouse.move(from.x, from.y);
    await drawn(g);
    await g.page.mouse.down();
    for (let i = 1; i <= 6; i++) {
      await g.page.mouse.move(from.x + 2 * i, from.y - 7 * i);
      await drawn(g);
    }
    const held = await g.until((s) => s.moving !== undefined && s.playhead === 30, "the key's pose follows");
    assert.equal(held.rev, before.rev, "nothing is edited yet");
    await g.until((s) => s.rollout?.rev === 0, "the rollout follows as a preview");
    await g.picture("path-drag");
    await g.page.mouse.up();
    const s = await g.until((x) => x.rev === (before.rev ?? 0) + 1, "one edit");
    assert.deepEqual(
      s.clip?.keys.map((k) => k.frame),
      [0, 30, 60],
      "no key but this one",
    );
    assert.deepEqual(s.clip?.keys[0], before.clip?.keys[0]);
    const [, now] = await tips();
    const moved = now && (await seen(g, now));
    assert.ok(
      moved && Math.hypot(moved.x - from.x - 12, moved.y - from.y + 42) < 12,
      `the diamond is where the hand let go: ${JSON.stringify([from, moved])}`,
    );
    assert.equal(s.history?.len, (before.history?.len ?? 0) + 1);
    await g.press("Control+z");
    await g.until((x) => isDeepStrictEqual(x.clip, before.clip), "as before");
  });

  test("a click on the line makes a key that leaves the path as it is; 5 hides the path", async () => {
    await g.rolledOut();
    await g.goTo(70);
    const before = await g.state();
    const q = (await studio.api("GET", "/api/export?format=csv")).bytes.toString().trim().split("\n");
    const head = q[0]?.split(",") ?? [];
    const row = q[16]?.split(",") ?? [];
    const joints = before.clip?.robot.joints ?? [];
    const pose = joints.map((n) => Number(row[head.indexOf(n)]));
    const [at] = await sites(studio, "ur5e", "end_effector", [pose]);
    assert.ok(at);
    const p = await seen(g, at);
    await eventually(async () => {
      await g.page.mouse.move(p.x, p.y);
      await drawn(g);
      await g.page.mouse.click(p.x, p.y);
      await drawn(g);
      return (await g.keys()).length === 4;
    }, "a fourth key");
    const s = await g.until((x) => x.clip?.keys.length === 4, "it is there");
    const key = s.clip?.keys[1];
    assert.ok(key && key.frame >= 12 && key.frame <= 18, `at frame ${key?.frame}`);
    assert.deepEqual([s.playhead, s.selection], [key.frame, [key.frame]]);
    const line = await tips();
    const [tip] = await sites(studio, "ur5e", "end_effector", [key.q as number[]]);
    assert.ok(tip && line.length === 4);
    const mean = (a: number, b: number, f: number): number => a + ((b - a) * f) / 30;
    const expected = joints.map((_, j) =>
      mean(before.clip?.keys[0]?.q?.[j] ?? 0, before.clip?.keys[1]?.q?.[j] ?? 0, key.frame),
    );
    for (const [j, v] of expected.entries()) assert.ok(Math.abs(v - (key.q?.[j] ?? 0)) < 2e-6, joints[j]);
    await g.press("Control+z");
    await g.until((x) => x.clip?.keys.length === 3, "as before");
    await g.press("5");
    await eventually(async () => (await nodes(g, "/path")).length === 0, "no path");
    await g.press("5");
    await eventually(async () => (await nodes(g, "/path/key/")).length === 3, "the path again");
  });

  test("a letter drawn with the point mass is performed within 3 mm, and is one edit", async () => {
    await g.afresh(PUCK);
    await g.rolledOut();
    await g.page.locator("body").press("Alt+3");
    await drawn(g);
    const before = await g.state();
    await g.press("d");
    await g.byId("draw-canvas").waitFor();
    await g.until((s) => s.site === "puck" && s.drawing, "ready to draw");
    await g.byId("draw-secs").fill("14");
    await g.picture("draw-tools");
    // R: the stem up, the bowl, the leg.
    const bowl: V3[] = Array.from({ length: 13 }, (_, k) => {
      const a = Math.PI / 2 - (Math.PI * k) / 12;
      return [0.15 + 0.12 * Math.cos(a), 0.28 + 0.12 * Math.sin(a), 0.01];
    });
    const letter: V3[] = [
      [0, 0, 0.01],
      [0, 0.4, 0.01],
      [0.15, 0.4, 0.01],
      ...bowl,
      [0, 0.16, 0.01],
      [0.1, 0.16, 0.01],
      [0.3, 0, 0.01],
    ];
    await stroke(g, await Promise.all(letter.map((p) => seen(g, p))), 8);
    const s = await g.until((x) => x.drawn !== undefined && x.rev === (before.rev ?? 0) + 1, "drawn");
    assert.equal(s.history?.len, (before.history?.len ?? 0) + 1, "one entry in the history");
    assert.equal(s.drawing, false);
    const done = await g.rolledOut();
    const line = s.drawn?.line as V3[];
    for (const p of letter) assert.ok(away(p, line) < 0.01, `the line goes through ${p}`);
    const begin = s.drawn?.keys[0]?.frame ?? 0;
    const end = s.drawn?.frames ?? 0;
    const off = done.q.slice(begin, end).map(([x = 0, y = 0]) => away([x, y, 0.01], line));
    const mean = off.reduce((a, b) => a + b, 0) / off.length;
    console.log(
      `    letter R: ${s.drawn?.keys.length} keys, ${((end - begin) / 20).toFixed(1)} s, mean distance ${(1000 * mean).toFixed(2)} mm, farthest ${(1000 * Math.max(...off)).toFixed(1)} mm`,
    );
    assert.ok(mean <= 0.003, `mean distance ${mean}`);
    assert.ok((end - begin) / 20 <= 20, "at most 20 s");
    await drawn(g);
    await g.picture("draw-letter");
    await g.press("Control+z");
    await g.until((x) => isDeepStrictEqual(x.clip, before.clip), "as before");
  });

  test("a square drawn with the arm's tool has its corners within 3 mm", async () => {
    await g.afresh();
    await g.rolledOut();
    await g.page.locator("body").press("Alt+3");
    await drawn(g);
    await g.press("d");
    await g.until((s) => s.site === "end_effector" && s.drawing, "ready to draw");
    await g.byId("draw-secs").fill("12");
    const [tip] = await tips();
    assert.ok(tip);
    const corners: V3[] = (
      [
        [0, 0],
        [0.16, 0],
        [0.16, 0.16],
        [0, 0.16],
        [0, 0],
      ] as const
    ).map(([dx, dy]) => [tip[0] - 0.08 + dx, tip[1] - 0.04 + dy, tip[2]]);
    const rev = (await g.state()).rev ?? 0;
    await stroke(g, await Promise.all(corners.map((p) => seen(g, p))), 10);
    const s = await g.until((x) => x.drawn !== undefined && x.rev === rev + 1, "drawn");
    assert.ok((s.drawn?.off_m ?? 1) < 5e-4, "within reach");
    const done = await g.rolledOut();
    const way = await sites(studio, "ur5e", "end_effector", done.q);
    const misses = corners.map((c) =>
      Math.min(...way.map((p) => Math.hypot(...p.map((v, k) => v - (c[k] ?? 0))))),
    );
    const line = s.drawn?.line as V3[];
    const drawnOff = corners.map((c) => away(c, line));
    console.log(
      `    square: ${s.drawn?.keys.length} keys, ${((s.drawn?.frames ?? 0) / 20).toFixed(1)} s, corners ${misses.map((m) => (1000 * m).toFixed(2)).join(", ")} mm (of the drawn line itself ${drawnOff.map((m) => (1000 * m).toFixed(2)).join(", ")})`,
    );
    assert.ok(Math.max(...misses) <= 0.003, `corners ${misses}`);
    await drawn(g);
    await g.picture("draw-square");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(g.foreign, []);
    assert.deepEqual(g.errors, []);
  });
});
