// A clip may name the joints of its robot in another order than the robot: what stands in a row is about one joint.

import assert from "node:assert/strict";
import type { RobotFacts } from "../src/protocol";
import { ARM, after, before, describe, Studio, type Tab, tab, test } from "./harness";

const arm = JSON.parse(ARM) as {
  robot: { id: string; joints: string[] };
  keys: { frame: number; q: number[] }[];
};
const PLACES = [3, 2, 4, 1, 0];
const JOINTS = PLACES.map((i) => arm.robot.joints[i] ?? "");
const TURNED = JSON.stringify({
  ...arm,
  name: "turned",
  robot: { ...arm.robot, joints: JOINTS },
  keys: arm.keys.map((k) => ({ ...k, q: PLACES.map((i) => k.q[i]) })),
});

describe("a clip whose joints have another order than the robot's", () => {
  let studio: Studio;
  let t: Tab;
  let facts: RobotFacts;

  before(async () => {
    studio = await Studio.start();
    facts = (await studio.api("GET", "/api/robot/ur5e")).json();
    await studio.api("POST", "/api/new", { text: TURNED });
    t = await tab(studio);
    await t.until((s) => s.clip?.name === "turned" && s.robot === "ur5e", "the clip open");
    await t.byId("policy").selectOption("computed-torque");
    await t.until((s) => s.settings.policy === "computed-torque", "the policy chosen");
    await t.rolledOut();
  });
  after(() => studio.end());

  const degrees = (rad: number): number => (rad * 180) / Math.PI;

  test("label, range, value and what was reached are of one joint", async () => {
    assert.notDeepEqual(
      facts.table.joints.map((j) => j.name),
      JOINTS,
    );
    await t.goTo(30);
    const s = await t.state();
    const key = s.clip?.keys.find((k) => k.frame === 30)?.q ?? [];
    for (const [j, name] of JOINTS.entries()) {
      const row = t.byId(`joint-${j}`);
      assert.match(await row.locator("label").innerText(), new RegExp(name));
      const shown = Number(await row.locator("input[type=text]").inputValue());
      assert.ok(Math.abs(shown - degrees(key[j] ?? 0)) < 0.1, `${name}: ${shown}`);
      const range = facts.table.joints.find((f) => f.name === name)?.range;
      assert.ok(range, name);
      const slider = row.locator("input[type=range]");
      assert.ok(Math.abs(Number(await slider.getAttribute("min")) - range[0]) < 1e-6, name);
      assert.ok(Math.abs((s.q[30]?.[j] ?? 9) - (key[j] ?? 0)) < 0.1, `${name} reached ${s.q[30]?.[j]}`);
    }
  });

  test("a typed value moves the joint of its row", async () => {
    await t.goTo(60);
    const at = JOINTS.indexOf("wrist_1");
    const field = t.byId(`joint-${at}`).locator("input[type=text]");
    const was = (await t.state()).clip?.keys.find((k) => k.frame === 60)?.q ?? [];
    await field.fill("-70");
    await field.press("Enter");
    const now = await t.until(
      (s) => Math.abs((s.clip?.keys.find((k) => k.frame === 60)?.q?.[at] ?? 0) + 1.2217) < 1e-3,
      "the joint at -70 degrees",
    );
    const q = now.clip?.keys.find((k) => k.frame === 60)?.q ?? [];
    assert.deepEqual(q.toSpliced(at, 1), was.toSpliced(at, 1), "no other joint");
  });

  test("a pose of the robot gives each joint its own value", async () => {
    const pose = facts.poses.find((p) => new Set(p.q).size > 1);
    assert.ok(pose, "values that can be told apart");
    await t.goTo(70);
    await t.panel("poses");
    await t.click(`pose-${pose.name}`);
    const s = await t.until((x) => x.clip?.keys.some((k) => k.frame === 70) ?? false, "a key");
    const key = s.clip?.keys.find((k) => k.frame === 70);
    const q = key?.q ?? s.clip?.poses?.[key?.pose ?? ""] ?? [];
    const names = facts.table.joints.map((j) => j.name);
    for (const [j, name] of JOINTS.entries())
      assert.ok(Math.abs((q[j] ?? 9) - (pose.q[names.indexOf(name)] ?? 0)) < 1e-5, name);
  });

  test("the arm reaches by the joints that it has", async () => {
    await t.goTo(30);
    await t.press("g");
    await t.until((s) => s.site !== undefined, "an end effector");
    const field = t.byId("reach-z");
    const z = Number(await field.inputValue());
    await field.fill(String(z - 0.05));
    await field.press("Enter");
    await t.page.waitForFunction(
      (want) =>
        Math.abs(Number(document.querySelector<HTMLInputElement>("[data-testid=reach-z]")?.value) - want) <
        0.002,
      z - 0.05,
    );
    assert.deepEqual(t.errors, []);
  });
});
