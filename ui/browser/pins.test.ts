// Pins: several sites are held or brought together while one edit poses the rest.

import assert from "node:assert/strict";
import { after, before, describe, eventually, Studio, type Tab, tab, test } from "./harness";
import { apart, sites, type V3 } from "./scene";

describe("pins", () => {
  // Pins stay from test to test, as they do for a user.
  describe.configure({ mode: "serial" });
  let studio: Studio;
  let t: Tab;

  before(async () => {
    studio = await Studio.start(["--robot", "shadow_hand"]);
    t = await tab(studio, { width: 1440, height: 900 });
    await t.until((s) => s.page === "editor" && s.robot === "shadow_hand", "the hand open");
    await t.rolledOut();
  });
  after(() => studio.end());

  /** Where a fingertip is in a pose. */
  const tipOf = async (name: string, q: number[]): Promise<V3> => {
    const [at] = await sites(studio, "shadow_hand", name, [q]);
    assert.ok(at);
    return at;
  };
  /** The gap between the surfaces of thumb and index tip; below 0 they press into each other. */
  const gap = async (q: number[]): Promise<number> => {
    const facts = (await studio.api("GET", "/api/robot/shadow_hand")).json();
    const [row] = (await studio.api("POST", "/api/kinematics", { q: [q] })).json() as number[][];
    // Capsules of assets/robots/shadow_hand/robot.xml: middle, half length, radius, m.
    const axis = (name: string, middle: number, half: number): V3[] => {
      const body = facts.bodies.findIndex((b: { name: string }) => b.name === name);
      const [px = 0, py = 0, pz = 0, w = 1, x = 0, y = 0, z = 0] = row?.slice(7 * body) ?? [];
      const up: V3 = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
      return Array.from({ length: 101 }, (_, k) => {
        const s = middle + half * (k / 50 - 1);
        return [px + s * up[0], py + s * up[1], pz + s * up[2]];
      });
    };
    const [index, thumb] = [axis("ffdistal", 0.0125, 0.01), axis("thdistal", 0.014, 0.01)];
    return Math.min(...index.flatMap((a) => thumb.map((b) => apart(a, b)))) - 0.0085 - 0.01;
  };

  test("a new user's OK sign: thumb touches index, 2 mm apart in the take, at most 40 actions", async () => {
    t.actions = 0;
    await t.goTo(30);
    t.actions += 2;
    await t.click("site-thtip");
    await t.until((s) => s.site === "thtip", "the thumb is selected");
    await t.byId("touch").selectOption("fftip");
    t.actions++;
    const s = await t.until(
      (x) => x.pins.length === 1 && (x.clip?.keys.some((k) => k.frame === 30) ?? false),
      "pinned, and the pose is a key",
    );
    assert.deepEqual(s.pins, [{ site: "thtip", to: "fftip" }]);
    assert.equal(s.history?.len, 1, "one edit");
    await t.until((x) => x.pinsOff.length === 1 && (x.pinsOff[0] ?? 1) < 5e-4, "they meet in the command");
    const done = await t.rolledOut();
    const [thumb, index] = [await tipOf("thtip", done.q[30] ?? []), await tipOf("fftip", done.q[30] ?? [])];
    const between = 1000 * (await gap(done.q[30] ?? []));
    console.log(
      `    OK sign: ${t.actions} actions; in the take the tips' surfaces are ${between.toFixed(2)} mm apart, their ends ${(1000 * apart(thumb, index)).toFixed(2)} mm`,
    );
    await t.picture("pins-ok");
    assert.ok(between <= 2 && between > -2, `${between} mm`);
    assert.ok(t.actions <= 40);
  });

  test("several pins are solved together, and one that cannot hold says how far it is off", async () => {
    // The middle fingertip stays where it is while the ring finger is pulled.
    await t.click("site-mftip");
    await t.until((s) => s.site === "mftip", "the middle finger is selected");
    await t.press("Shift+G");
    const held = await t.until((s) => s.pins.length === 2, "two pins");
    const before = await tipOf("mftip", held.clip?.keys.find((k) => k.frame === 30)?.q as number[]);
    await t.click("site-rftip");
    await t.byId("reach-x").waitFor();
    const rev = (await t.state()).rev ?? 0;
    // x, y and z are one edit.
    const fields = await Promise.all(
      ["x", "y", "z"].map(async (a) => Number(await t.byId(`reach-${a}`).inputValue())),
    );
    await t.byId("reach-y").fill(String((fields[1] ?? 0) - 0.02));
    await t.byId("reach-z").fill(String((fields[2] ?? 0) - 0.015));
    assert.equal((await t.state()).rev, rev, "nothing is sent before Enter");
    await t.byId("reach-z").press("Enter");
    const moved = await t.until((s) => s.rev === rev + 1, "one edit");
    const after = await tipOf("mftip", moved.clip?.keys.find((k) => k.frame === 30)?.q as number[]);
    assert.ok(apart(before, after) < 5e-4, "the middle fingertip stays");
    await t.until((s) => s.pinsOff.length === 2 && Math.max(...s.pinsOff) < 1e-3, "both pins hold");
    // The index goes where the thumb cannot follow.
    await t.click("site-fftip");
    await t.until((s) => s.site === "fftip", "the index is selected");
    await t.byId("reach-x").waitFor();
    await t.byId("reach-z").fill("0.6");
    await t.byId("reach-z").press("Enter");
    await t.until((s) => (s.pinsOff[0] ?? 0) > 0.005, "too far for the thumb");
    assert.match(await t.byId("pin-thtip").innerText(), /mm off/);
    await t.picture("pins-off");
  });

  test("a pose in which links press into each other says so", async () => {
    const clip = (await t.state()).clip;
    const joints = clip?.robot.joints ?? [];
    const key = clip?.keys.find((k) => k.frame === 30) ?? clip?.keys[0];
    assert.ok(key?.q);
    // The index bends across the middle finger.
    const q = key.q.map((v, j) =>
      joints[j] === "FFJ4" ? -0.34 : joints[j] === "MFJ4" ? 0.34 : joints[j] === "RFJ4" ? 0.34 : v,
    );
    const text = JSON.stringify({ ...clip, keys: [{ frame: 0, q }] });
    await studio.api("POST", "/api/new", { text });
    const s = await t.until(
      (x) => x.touching.length > 0 && x.clip?.keys.length === 1,
      "it is seen that they touch",
    );
    assert.ok((s.touching[0]?.[2] ?? 0) > 5e-4);
    await eventually(
      async () => /presses [\d.]+ mm into/.test(await t.byId("contact").innerText()),
      "and said how deep",
    );
    await t.picture("pins-contact");
    await t.until((x) => x.pins.length === 0, "another document has no pins");
  });

  test("a newcomer counts from one to five and makes the OK sign: at most 40 actions, 4 minutes", async () => {
    const began = Date.now();
    await studio.api("POST", "/api/new", { robot: "shadow_hand", length: 180, name: "counting" });
    await t.until((s) => s.clip?.name === "counting", "a new clip of the hand");
    await t.rolledOut();
    await t.press("Escape");
    await t.panel("poses");
    t.actions = 1; // New clip
    // Each number is a click on the timeline and one on its pose; a second's rest after it is typed once.
    const times = new Map<string, number>();
    for (const [n, name] of ["one", "two", "three", "four", "five"].entries()) {
      const frame = 20 + 28 * n;
      times.set(name, frame);
      const p = await t.at(frame, "Index finger");
      await t.page.mouse.click(p.x, p.y);
      t.actions++;
      await t.until((s) => Math.abs(s.playhead - frame) <= 1, `at ${frame}`);
      await t.click(`pose-${name}`);
      const at = (await t.state()).playhead;
      times.set(name, at);
      await t.until((s) => s.clip?.keys.some((k) => k.frame === at) ?? false, `${name} is a key`);
    }
    await t.press("Control+a", "h");
    await t.page.keyboard.type("12");
    await t.page.keyboard.press("Enter");
    t.actions += 3;
    await t.until((s) => s.clip?.keys.every((k) => k.hold === 12) ?? false, "each number is held");
    const p = await t.at(162, "Index finger");
    await t.page.mouse.click(p.x, p.y);
    t.actions++;
    const ok = (await t.until((s) => Math.abs(s.playhead - 162) <= 1, "near the end")).playhead;
    await t.click("site-thtip");
    await t.until((s) => s.site === "thtip", "the thumb is selected");
    await t.byId("touch").selectOption("fftip");
    t.actions += 2;
    await t.until((s) => s.clip?.keys.some((k) => k.frame === ok) ?? false, "the sign is a key");
    await t.press("h");
    await t.page.keyboard.type("12");
    await t.page.keyboard.press("Enter");
    t.actions += 3;
    const done = await t.rolledOut();
    const secs = (Date.now() - began) / 1000;
    assert.equal(done.rollout?.phase, "done");
    // In the take, at the end of each hold: the numbers are there, and the tips touch.
    const joints = done.clip?.robot.joints ?? [];
    for (const [name, frame] of times) {
      const want = (done.clip?.poses?.[name] ?? []) as (number | null)[];
      const q = done.q[frame + 11] ?? [];
      const worst = Math.max(...want.map((v, j) => Math.abs((v ?? q[j] ?? 0) - (q[j] ?? 0))));
      assert.ok(worst < 0.1, `${name}: ${worst} rad off in ${joints.length} joints`);
    }
    const between = 1000 * (await gap(done.q[Math.min(179, ok + 8)] ?? []));
    console.log(
      `    one to five and OK: ${t.actions} actions, ${secs.toFixed(0)} s, tips ${between.toFixed(2)} mm apart`,
    );
    await t.picture("counting");
    assert.ok(Math.abs(between) <= 2, `${between} mm`);
    assert.ok(t.actions <= 40 && secs < 240, `${t.actions} actions, ${secs} s`);
  });

  test("no script broke", () => {
    assert.deepEqual(t.errors, []);
    assert.deepEqual(t.foreign, []);
  });
});
