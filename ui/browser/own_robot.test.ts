// A robot that is not the program's own: it is imported, evaluated, trained.

import assert from "node:assert/strict";
import { rmSync } from "node:fs";
import { describe, eventually, onTheArm, type Studio, type Tab, test } from "./harness";

const ONE = `<robot name="one"><link name="base"/><link name="arm"><inertial><mass value="1"/><origin xyz="0 0 .2"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0 0 .2"/><geometry><box size=".05 .05 .4"/></geometry></visual></link>
<joint name="lift" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="20" velocity="3"/></joint></robot>`;

describe("a robot of one's own", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  /** The robot; it is imported by whichever test comes first. */
  const imported = async (): Promise<{ id: string; source: string }> => {
    const known = async () =>
      ((await studio.api("GET", "/api/robots")).json() as { id: string; source: string }[]).find(
        (r) => r.id === "one_joint",
      );
    const before = await known();
    if (before) return before;
    studio.file("one.urdf", ONE);
    const made = (await studio.api("POST", "/api/import", { file: "one.urdf", id: "one_joint" })).json();
    assert.equal((await studio.ended(made.id)).phase, "done");
    const robot = await known();
    assert.ok(robot);
    return robot;
  };

  test("after an import Training is about the robot that was imported", async () => {
    await t.afresh();
    await t.rolledOut();
    studio.file("one.urdf", ONE);
    await t.turnTo("runs");
    const robot = (): Promise<string> => t.byId("runs-robot").inputValue();
    await t.page.waitForFunction(
      () => (document.querySelector('[data-testid="runs-robot"]') as HTMLSelectElement).value === "ur5e",
    );
    // What a job says of its time, from the first moment on.
    await t.page.evaluate(() => {
      const said: string[] = [];
      Object.assign(window, { __said: said });
      new MutationObserver(() => {
        for (const e of document.querySelectorAll(".job")) said.push(e.textContent ?? "");
      }).observe(document.body, { childList: true, subtree: true, characterData: true });
    });
    await t.byId("import").locator("summary").click();
    await t.byId("import-path").fill("one.urdf");
    await t.byId("import-id").fill("one_joint");
    await t.byId("import-start").click();
    await eventually(async () => /one_joint/.test(await robot()), "the new robot is chosen");
    assert.match(await t.byId("suite").inputValue(), /trial/, "and measured on what it has");
    const said = await t.page.evaluate(() => (window as unknown as { __said: string[] }).__said);
    assert.ok(
      said.some((text) => /import/i.test(text)),
      "the job was seen",
    );
    assert.deepEqual(
      said.filter((text) => /\b0:00\b(?! left)/.test(text)),
      [],
      "no time is claimed before any has passed",
    );
    await t.picture("imported");
    await t.turnTo("editor");
  });

  test("what was trained for it is offered after a kill, and a run of one step is in the singular", async () => {
    const robot = (await imported()).source;
    const trained = ["--preset", "pm-tiny", "--set", "steps=1", "--out", "runs/one"];
    for (const args of [
      ["collect", "--robot", robot, "--transitions", "4000", "--out", "data/one"],
      ["train", "--robot", robot, "--data", "data/one", ...trained],
    ]) {
      const ran = studio.shell(...args);
      assert.equal(ran.code, 0, `${args.join(" ")}: ${ran.err}`);
    }
    const port = Number(new URL(studio.url).port);
    await studio.kill();
    await studio.run(port);
    const made = await studio.api("POST", "/api/new", { robot, length: 40 });
    assert.equal(made.status, 200, made.bytes.toString());
    await t.page.goto(studio.url);
    await t.page.reload();
    await t.until((s) => s.link === "open" && s.robot === "one_joint", "the robot is open");
    const note = t.byId("no-model");
    await note.getByRole("button", { name: "Use runs/one" }).waitFor();
    assert.equal(await note.getByText("No policy is trained").count(), 0);
    await t.turnTo("runs");
    await t.byId("run-runs/one").getByText("1 of 1 step", { exact: true }).waitFor();
    await t.turnTo("editor");
    await note.getByRole("button", { name: "Use runs/one" }).click();
    await t.until(
      (s) => /runs.one/.test(s.settings.model_path ?? "") && s.rollout?.phase === "done",
      "performs",
    );
  });

  test("a robot of one's own is evaluated on what it has, and its runs show what they reached", async () => {
    const robot = await imported();
    await t.afresh();
    // A collection that was killed, as it lies on disk.
    const begun = (
      await studio.api("POST", "/api/jobs", {
        kind: "collect",
        args: ["--robot", robot.source, "--transitions", "4000", "--out", "data/half"],
      })
    ).json();
    assert.equal((await studio.ended(begun.id)).phase, "done");
    rmSync(studio.file("data/half/manifest.json"));
    await t.turnTo("runs");
    // First that of the open clip, then the chosen one.
    const field = (id: string, value: string) =>
      t.page.waitForFunction(
        ([i, v]) => document.querySelector<HTMLInputElement>(`[data-testid="${i}"]`)?.value === v,
        [id, value],
      );
    await field("runs-robot", "ur5e");
    await t.byId("runs-robot").selectOption(robot.source);
    await field("suite", "trial");
    assert.equal(await t.byId("this-clip").isDisabled(), true);
    await t.page.getByLabel("policies").fill("pd");
    await t.byId("evaluate").click();
    await t.page.locator('[data-testid="eval-table"]').first().waitFor();
    // Unfinished data goes on.
    await t.byId("begun-data/half").waitFor();
    await t.picture("runs-own");
    // By key: a message may lie over it.
    await t.byId("go-on-data/half").press("Enter");
    await t.byId("begun-data/half").waitFor({ state: "detached" });
    const shelf = (await studio.api("GET", "/api/shelf")).json();
    assert.ok(shelf.begun.length === 0 || shelf.data.length >= 1);
    await t.turnTo("editor");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
