// The graph editor: the curves are those that the clip commands, and their keys are the timeline's.

import assert from "node:assert/strict";
import { isDeepStrictEqual } from "node:util";
import type { Clip } from "../src/clip";
import { commandedAt } from "../src/graph/curve";
import { describe, eventually, onTheArm, type Studio, type Tab, test } from "./harness";

/** All fills, tangents, a hold, an open joint, and a stretch that is too fast. */
const SHAPES = JSON.stringify({
  format: "robert-clip/1",
  name: "shapes",
  robot: { id: "ur5e", joints: ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"] },
  fps: 20,
  length: 90,
  fill: "cubic",
  keys: [
    { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57] },
    {
      frame: 14,
      q: [-1.3, -1.45, 1.5, -1.55, -1.5],
      tangents: { shoulder_pan: "flat", wrist_1: 0.2, wrist_2: { in: 0.1, out: -0.3 } },
    },
    { frame: 30, q: [-1.2, -1.4, 1.4, -1.5, -1.5], hold: 6 },
    { frame: 45, q: [-1.0, -1.2, 1.6, null, -1.8], fill: "linear" },
    { frame: 60, q: [-1.4, -1.5, 1.2, -1.4, -1.6], fill: "hold" },
    { frame: 70, q: [-1.2, -1.4, 1.0, -1.4, -1.6], fill: "mask" },
    { frame: 80, q: [-1.2, -1.4, 1.1, -1.4, -1.6] },
  ],
});

/** Keys for some joints only, with holds and every fill past them. */
const LAYERS = JSON.stringify({
  ...JSON.parse(SHAPES),
  name: "layers",
  keys: [
    { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57], hold: 20 },
    { frame: 10, q: [-1.4, null, null, null, -1.5], tangents: { wrist_2: 0.3 } },
    { frame: 25, q: [null, null, 1.4, null, -1.4], hold: 30, fill: "mask" },
    { frame: 35, q: [-1.2, -1.4, null, null, null], fill: "linear" },
    { frame: 45, q: [null, null, null, -1.4, -1.6], fill: "hold" },
    { frame: 60, q: [-1.4, null, 1.2, null, null] },
    { frame: 70, q: [-1.3, -1.5, null, -1.5, null], fill: "mask" },
    { frame: 80, q: [null, null, 1.3, null, -1.5] },
  ],
});

describe("graph", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });

  const start = async (text = SHAPES): Promise<void> => {
    await t.afresh(text);
    await t.page.getByRole("tab", { name: "Graph" }).click();
    await t.byId("graph").waitFor();
    await t.byId("curve-2").click();
    await t.until((s) => s.curves.join() === "2", "one curve");
    await t.rolledOut();
    await t.painted();
  };
  const at = (frame: number, joint: number, value: number) => t.graphAt(frame, joint, value);
  const key = async (frame: number) => (await t.state()).clip?.keys.find((k) => k.frame === frame);
  const pull = async (
    from: { x: number; y: number },
    by: { x: number; y: number },
    release = true,
  ): Promise<void> => {
    await t.page.mouse.move(from.x, from.y);
    await t.page.mouse.down();
    for (let i = 1; i <= 6; i++) await t.page.mouse.move(from.x + (by.x * i) / 6, from.y + (by.y * i) / 6);
    if (release) await t.page.mouse.up();
  };

  const curvesAreCommanded = async (least: number): Promise<void> => {
    const csv = (await studio.api("GET", "/api/export?format=csv")).bytes.toString();
    const [head = "", ...rows] = csv.trim().split("\n");
    const names = head.split(",");
    const clip = (await t.state()).clip as Clip;
    let compared = 0;
    for (const row of rows) {
      const cells = row.split(",");
      const frame = Number(cells[names.indexOf("frame")]);
      for (const [j, name] of clip.robot.joints.entries()) {
        const cell = cells[names.indexOf(name)] ?? "";
        const drawn = commandedAt(clip, j, frame);
        if (cell === "") {
          assert.equal(drawn, undefined, `${name} at ${frame}`);
          continue;
        }
        assert.ok(
          drawn !== undefined && Math.abs(drawn - Number(cell)) < 2e-6,
          `${name} at ${frame}: ${drawn} drawn, ${cell} commanded`,
        );
        compared++;
      }
    }
    assert.ok(compared > least, `${compared} values`);
  };

  test("curves are what the clip commands, frame by frame", async () => {
    await start();
    await curvesAreCommanded(300);
    await start(LAYERS);
    await curvesAreCommanded(300);
  });

  test("a key is dragged in time and in value; it is one edit, and the rollout follows", async () => {
    await start();
    const before = await t.state();
    const from = await at(45, 2, 1.6);
    const to = await at(49, 2, 1.3);
    await pull(from, { x: to.x - from.x, y: to.y - from.y }, false);
    await t.until((s) => s.demand !== undefined, "a preview of the drag");
    assert.equal((await t.state()).rev, before.rev, "nothing is edited yet");
    await t.picture("graph-drag");
    await t.page.mouse.up();
    const s = await t.until((x) => x.clip?.keys.some((k) => k.frame === 49) ?? false, "dropped");
    assert.deepEqual(
      s.clip?.keys.map((k) => k.frame),
      [0, 14, 30, 49, 60, 70, 80],
    );
    const moved = await key(49);
    assert.ok(Math.abs((moved?.q?.[2] ?? 0) - 1.3) < 0.02, `${moved?.q?.[2]}`);
    assert.deepEqual([moved?.q?.[0], moved?.q?.[3]], [-1, null], "the other joints keep their values");
    assert.equal(s.history?.len, 1, "one entry in the history");
    assert.deepEqual([s.points, s.selection], [["49:2"], [49]], "and it stays chosen");
    await t.press("Control+z");
    await t.until((x) => isDeepStrictEqual(x.clip, before.clip), "as before");
    // Esc gives a drag up; Shift holds it to one direction.
    await pull(from, { x: 40, y: 30 }, false);
    await t.page.keyboard.press("Escape");
    await t.page.mouse.up();
    assert.equal((await t.state()).clip?.keys[3]?.frame, 45);
    await t.page.keyboard.down("Shift");
    await pull(from, { x: 6, y: 25 });
    await t.page.keyboard.up("Shift");
    const raised = await t.until((x) => x.clip?.keys[3]?.q?.[2] !== 1.6, "lowered");
    assert.equal(raised.clip?.keys[3]?.frame, 45, "in value only");
    await t.press("Control+z");
    await t.until((x) => x.clip?.keys[3]?.q?.[2] === 1.6, "as before");
  });

  test("a hand that moves on and on sees whole motions: the next preview waits for the last", async () => {
    await start();
    await t.page.evaluate(() => {
      const log: { what: "preview" | "whole"; at: number }[] = [];
      const note = (what: "preview" | "whole"): void => void log.push({ what, at: performance.now() });
      const [{ send }, { parse }] = [WebSocket.prototype, JSON];
      WebSocket.prototype.send = function (data) {
        if (parse(String(data)).op === "preview") note("preview");
        send.call(this, data);
      };
      JSON.parse = (text) => {
        const e = parse(text);
        if (e?.event === "rollout.state" && e.rev === 0 && /done|failed/.test(e.phase)) note("whole");
        return e;
      };
      const __unhook = (): void => {
        WebSocket.prototype.send = send;
        JSON.parse = parse;
      };
      Object.assign(window, { __log: log, __unhook });
    });
    type Logged = { __log: { what: string; at: number }[]; __unhook: () => void };
    const log = () => t.page.evaluate(() => (window as unknown as Logged).__log);
    const p = await at(30, 2, 1.4);
    await t.page.mouse.move(p.x, p.y);
    await t.page.mouse.down();
    const enough = async (): Promise<boolean> => {
      const seen = (await log()).map((e) => e.what);
      return seen.includes("whole") && seen.filter((what) => what === "preview").length >= 6;
    };
    for (let i = 0; !(await enough()); i++)
      for (let k = 1; k <= 8; k++) await t.page.mouse.move(p.x, p.y - 4 - ((8 * i + k) % 23));
    await t.page.keyboard.press("Escape");
    await t.page.mouse.up();
    const seen = await log();
    await t.page.evaluate(() => (window as unknown as Logged).__unhook());
    for (const [i, e] of seen.entries()) {
      const next = seen[i + 1];
      if (e.what === "preview" && next?.what === "preview")
        assert.ok(next.at - e.at > 390, `after ${next.at - e.at} ms, before the last was performed`);
    }
    await t.rolledOut();
  });

  test("a box chooses keys of several curves; the timeline has the same keys chosen", async () => {
    await start();
    await t.byId("curve-0").click({ modifiers: ["Control"] });
    await t.until((s) => s.curves.length === 2, "two curves");
    await t.painted();
    const [a, b] = [await at(12, 2, 1.75), await at(32, 2, 1.2)];
    await pull(a, { x: b.x - a.x, y: b.y - a.y });
    const s = await t.until((x) => x.points.length > 0, "chosen");
    assert.deepEqual([...s.points].sort(), ["14:2", "30:2"], "only what is inside");
    await t.page.keyboard.down("Control");
    const [c, d] = [await at(12, 0, -1.1), await at(16, 0, -1.4)];
    await pull(c, { x: d.x - c.x, y: d.y - c.y });
    await t.page.keyboard.up("Control");
    await t.until((x) => x.points.length === 3 && x.points.includes("14:0"), "one more");
    await t.picture("graph-box");
    const before = await t.state();
    const from = await at(30, 2, 1.4);
    await pull(from, { x: 0, y: -20 });
    const up = await t.until((x) => x.rev !== before.rev, "raised together");
    const rise = (f: number, j: number): number =>
      (up.clip?.keys.find((k) => k.frame === f)?.q?.[j] ?? 0) -
      (before.clip?.keys.find((k) => k.frame === f)?.q?.[j] ?? 0);
    assert.ok(rise(30, 2) > 0.02);
    assert.ok(Math.abs(rise(14, 2) - rise(30, 2)) < 1e-5 && Math.abs(rise(14, 0) - rise(30, 2)) < 1e-5);
    assert.equal(rise(30, 0), 0, "what was not chosen stays");
    assert.equal(up.history?.len, (before.history?.len ?? 0) + 1, "one entry for all of them");
    await t.blur();
    await t.press("v");
    await t.byId("timeline").waitFor();
    assert.deepEqual([...(await t.state()).selection].sort(), [14, 30]);
    await t.painted();
    await t.clickKey(60);
    await t.until((x) => x.selection.join() === "60", "another key chosen");
    await t.press("v");
    await t.byId("graph").waitFor();
    await t.until((x) => [...x.points].sort().join() === "60:0,60:2", "and back");
  });

  test("a curve's tangent is chosen in the menu of its point", async () => {
    await start();
    const choose = async (frame: number, value: number, tangent: string): Promise<void> => {
      const p = await at(frame, 2, value);
      await t.page.mouse.click(p.x, p.y, { button: "right" });
      await t.page.getByRole("menuitem", { name: `Tangent: ${tangent}` }).click();
    };
    const elbow = (clip: Clip | undefined, i: number) => clip?.keys[i]?.tangents?.elbow;
    await choose(14, 1.5, "flat");
    const flat = await t.until((s) => elbow(s.clip, 1) === "flat", "a flat tangent");
    assert.equal(flat.clip?.keys[1]?.tangents?.shoulder_pan, "flat", "those of the other joints stay");
    await t.painted();
    await t.picture("graph-tangent");
    await choose(14, 1.5, "automatic");
    await t.until((s) => elbow(s.clip, 1) === undefined, "automatic again");
    // Where no curve begins or ends a tangent would change nothing, so the key gets one.
    await choose(70, 1.0, "along the lines");
    const bent = await t.until((s) => elbow(s.clip, 5) === "linear", "a tangent along the lines");
    assert.equal(bent.clip?.keys[5]?.fill, "cubic");
    await t.press("Control+z");
    await t.until((s) => elbow(s.clip, 5) === undefined && s.clip?.keys[5]?.fill === "mask", "one edit");
  });

  test("what follows the chosen keys is set beside the curves", async () => {
    await start();
    const p = await at(45, 2, 1.6);
    await t.page.mouse.click(p.x, p.y);
    await t.until((s) => s.points.join() === "45:2", "chosen");
    assert.equal(await t.byId("fill-linear").getAttribute("aria-pressed"), "true");
    for (const fill of ["cubic", "hold", "mask", "linear"]) {
      await t.byId(`fill-${fill}`).click();
      await t.until(
        (s) =>
          s.clip?.keys[3]?.fill === (fill === "cubic" ? undefined : fill) || s.clip?.keys[3]?.fill === fill,
        fill,
      );
    }
  });

  test("a double click makes a key of one joint, keys raise values, locked joints stay", async () => {
    await start();
    const p = await at(52, 2, 1.45);
    await t.page.mouse.dblclick(p.x, p.y);
    await t.until_keys([0, 14, 30, 45, 52, 60, 70, 80]);
    const made = await key(52);
    assert.ok(Math.abs((made?.q?.[2] ?? 0) - 1.45) < 0.02, "at the hand's height");
    assert.ok(
      made?.q?.every((v, j) => j === 2 || v === null),
      "the curves of the other joints go on",
    );
    const was = made?.q?.[2] ?? 0;
    await t.until((s) => s.points.join() === "52:2", "chosen");
    await t.press("Alt+ArrowUp", "Alt+ArrowUp", "Alt+Shift+ArrowDown");
    const wanted = was + (1.9 * Math.PI) / 180;
    await eventually(
      async () => Math.abs(((await key(52))?.q?.[2] ?? 0) - wanted) < 1e-5,
      "two degrees up, a tenth down",
    );
    await t.press("Alt+l");
    await t.until((s) => s.locked.join() === "elbow", "locked");
    const rev = (await t.state()).rev;
    await pull(await at(52, 2, wanted), { x: 0, y: 30 });
    await t.painted();
    assert.equal((await t.state()).rev, rev);
    await t.press("Alt+l");
  });

  test("a point is deleted alone, a click on one of several selects it, values are typed as they are shown", async () => {
    await start();
    const p = await at(45, 2, 1.6);
    await t.page.mouse.click(p.x, p.y);
    await t.until((s) => s.points.join() === "45:2", "chosen");
    await t.press("x");
    const s = await t.until((x) => x.clip?.keys[3]?.q?.[2] === null, "taken out");
    assert.deepEqual(s.clip?.keys[3]?.q, [-1.0, -1.2, null, null, -1.8], "the others stay");
    const way = commandedAt(s.clip as Clip, 2, 45);
    assert.ok(way !== undefined && way < 1.4, "the curve goes on without it");
    // In the timeline all keys are chosen, and then one of them.
    await t.page.getByRole("tab", { name: "Timeline" }).click();
    await t.press("Control+a");
    await t.until((x) => x.selection.length === 7, "all");
    const one = await t.at(30);
    await t.page.mouse.click(one.x, one.y);
    await t.until((x) => x.selection.join() === "30", "one");
    // A key for some joints is held longer and says as little as before.
    await t.goTo(45);
    await t.press("Enter");
    const dialog = t.page.getByRole("dialog", { name: /^Key at frame 45/ });
    assert.equal(await dialog.getByLabel(/elbow/i).inputValue(), "");
    await dialog.getByLabel(/hold/).fill("4");
    await dialog.getByRole("button", { name: "OK" }).click();
    const held = await t.until((x) => x.clip?.keys[3]?.hold === 4, "held");
    assert.deepEqual(held.clip?.keys[3]?.q, [-1.0, -1.2, null, null, -1.8]);
  });

  test("values are scaled about the playhead, and slopes are typed, by keys alone", async () => {
    await start();
    const [first, second] = [await at(30, 2, 1.4), await at(45, 2, 1.6)];
    await t.page.mouse.click(first.x, first.y);
    await t.page.keyboard.down("Control");
    await t.page.mouse.click(second.x, second.y);
    await t.page.keyboard.up("Control");
    await t.until((x) => [...x.points].sort().join() === "30:2,45:2", "two points");
    await t.goTo(60);
    await t.blur();
    await t.press("Shift+S");
    await t.page.getByLabel("Factor on the distance to the pose at the playhead").fill("0.5");
    await t.page.keyboard.press("Enter");
    // The command at frame 60 is 1.2.
    const s = await t.until((x) => x.clip?.keys[3]?.q?.[2] === 1.4, "halfway");
    assert.deepEqual(
      s.clip?.keys.map((k) => k.q?.[2]),
      [1.57, 1.5, 1.3, 1.4, 1.2, 1.0, 1.1],
    );
    assert.equal(s.history?.len, 1, "one edit");
    await t.press("Control+z");
    await t.until((x) => x.clip?.keys[3]?.q?.[2] === 1.6, "as before");
    await t.press("Shift+V");
    const field = t.page.getByLabel(/^°\/s, or two numbers/);
    await field.fill("steep");
    await t.page.keyboard.press("Enter");
    await t.page.getByRole("alert").getByText('"steep" is neither a slope').waitFor();
    await field.fill("30 -60");
    await t.page.keyboard.press("Enter");
    const bent = await t.until((x) => x.clip?.keys[2]?.tangents?.elbow !== undefined, "bent");
    const corner = bent.clip?.keys[2]?.tangents?.elbow as { in: number; out: number };
    assert.ok(Math.abs(corner.in - Math.PI / 6) < 1e-5 && Math.abs(corner.out + Math.PI / 3) < 1e-5);
    await t.press("Shift+V");
    await field.fill("flat");
    await t.page.keyboard.press("Enter");
    await t.until((x) => x.clip?.keys[2]?.tangents?.elbow === "flat", "flat");
    await t.press("Shift+V");
    await field.fill("auto");
    await t.page.keyboard.press("Enter");
    await t.until((x) => x.clip?.keys[2]?.tangents?.elbow === undefined, "automatic");
    // What follows the chosen keys goes round.
    for (const fill of ["hold", "mask", "linear", "cubic"]) {
      await t.press("c");
      await t.until((x) => (x.clip?.keys[2]?.fill ?? x.clip?.fill) === fill, fill);
    }
  });

  test("what is too fast is drawn as such, and where the next key may lie", async () => {
    const slow = JSON.parse(SHAPES);
    await start(JSON.stringify({ ...slow, keys: slow.keys.slice(0, 2), fill: "linear" }));
    /** Pixels like a colour of the palette, or lighter, in the graph. */
    const ink = (name: string): Promise<number> =>
      t.page.evaluate((n) => {
        const canvas = document.querySelector(".graph canvas") as HTMLCanvasElement;
        const hex = getComputedStyle(document.documentElement).getPropertyValue(`--${n}`);
        const [r, g, b] = hex.match(/[0-9a-f]{2}/gi)!.map((h) => parseInt(h, 16)) as [number, number, number];
        const { data } = canvas
          .getContext("2d")!
          .getImageData(190, 50, canvas.width - 200, canvas.height - 50);
        let count = 0;
        for (let i = 0; i < data.length; i += 4)
          if (Math.abs(data[i]! - r) + Math.abs(data[i + 1]! - g) + Math.abs(data[i + 2]! - b) < 40) count++;
        return count;
      }, name);
    await t.goTo(60);
    await t.painted();
    const calm = await ink("error");
    const all = (): Promise<string> =>
      t.page.evaluate(() => (document.querySelector(".graph canvas") as HTMLCanvasElement).toDataURL());
    const plain = await all();
    const p = await at(0, 2, 1.57);
    await t.page.mouse.click(p.x, p.y);
    await t.until((s) => s.points.join() === "0:2", "chosen");
    await t.painted();
    assert.notEqual(await all(), plain, "cones beside the chosen key");
    await studio.api("POST", "/api/ops", {
      ops: [{ op: "keys.set", args: { frame: 14, values: { elbow: -1.5 } } }],
    });
    await t.goTo(60);
    await eventually(async () => (await ink("error")) > calm + 60, "a stretch that the joint cannot follow");
    await t.picture("graph-too-fast");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
