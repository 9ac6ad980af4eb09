// What one clip has left behind when another one is opened: nothing.

import assert from "node:assert/strict";
import { ARM, describe, eventually, inView, type Tab, test } from "./harness";
import { apart, camera, drawn, meshesOf, viser } from "./scene";

/** The arm rests at its first key. */
const STILL = JSON.stringify({
  ...JSON.parse(ARM),
  name: "still",
  keys: [{ frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57] }],
});

describe("another clip, in the 3D view", () => {
  let g: Tab;

  inView((_, page) => {
    g = page;
  });

  test("no ghosts of the last clip stand in a new one", async () => {
    await g.goTo(40);
    const both = async (): Promise<boolean> =>
      (await meshesOf(g, "/past")) > 0 && (await meshesOf(g, "/future")) > 0;
    await eventually(both, "ghosts");
    await g.toggle("Ghosts");
    await eventually(async () => !(await both()), "switched off");
    await g.toggle("Ghosts");
    await eventually(both, "and on again, at the same frame");
    await g.afresh(STILL);
    await g.rolledOut();
    await eventually(async () => (await meshesOf(g, "/robot")) > 0, "the robot is there");
    await eventually(
      async () => (await meshesOf(g, "/past")) === 0 && (await meshesOf(g, "/future")) === 0,
      "a clip of one key at frame 0 has no neighbours",
    );
    await g.picture("no-ghosts");
  });

  /** The camera moves for a moment; where it comes to rest. */
  const stands = async () => {
    let last = await camera(g);
    await eventually(async () => {
      await drawn(g);
      const now = await camera(g);
      const still = apart(now, last) < 1e-3;
      last = now;
      return still;
    }, "the camera stands");
    return last;
  };

  test("the camera shows the new clip, from wherever it was", async () => {
    await g.afresh(STILL);
    await g.rolledOut();
    await g.press("Alt+0");
    const home = await stands();
    await g.press("Alt+3");
    await eventually(async () => apart(await camera(g), home) > 0.3, "seen from above");
    await stands();
    await g.afresh(STILL);
    await g.rolledOut();
    await eventually(async () => apart(await camera(g), home) < 0.05, "as at first");
  });

  test("a guide that was set for one clip is not set for the next", async () => {
    await g.afresh();
    await g.panel("policies");
    await g.byId("guide").selectOption("linear");
    await g.until((s) => s.settings.guide === "linear", "guided");
    await g.afresh(STILL);
    const s = await g.until((x) => x.clip?.name === "still", "another clip");
    assert.equal(s.settings.guide, "none");
    assert.equal(await g.byId("guide").inputValue(), "none");
    assert.equal(s.settings.policy, "computed-torque", "the policy stays");
  });

  test("the robot casts a shadow on the ground, and none when that is switched off", async () => {
    await g.afresh();
    await g.rolledOut();
    const floor = (): Promise<{ shadow: number; casts: number; lights: number }> =>
      viser(g, (v) => {
        const seen = { shadow: 0, casts: 0, lights: 0 };
        v.scene.traverse((o: any) => {
          if (o.isMesh && o.castShadow) seen.casts++;
          if (o.isLight && o.castShadow) seen.lights++;
          const ground = o.material?.uniforms?.shadowOpacity;
          if (ground) seen.shadow = Math.max(seen.shadow, ground.value);
        });
        return seen;
      });
    // Software draws here: no shadow unless it is asked for.
    const none = await floor();
    assert.deepEqual([none.shadow, none.lights], [0, 0]);
    const toggle = async (): Promise<void> => {
      await g.press("Control+k");
      await g.page.getByLabel("Command", { exact: true }).fill("shadow of the robot");
      await g.page.keyboard.press("Enter");
    };
    await toggle();
    const some = await eventually(async () => {
      const f = await floor();
      return f.shadow > 0 && f.lights > 0 && f;
    }, "a shadow");
    assert.ok(some.casts > 5, `${some.casts} meshes cast it`);
    await drawn(g);
    await g.picture("shadow-dark");
    await toggle();
    await eventually(async () => (await floor()).shadow === 0, "none again");
  });

  test("nothing left the origin, no script broke, no policy of the page was violated", () => {
    assert.deepEqual(g.foreign, []);
    assert.deepEqual(g.errors, []);
  });
});
