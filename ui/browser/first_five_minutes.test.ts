// A newcomer's first five minutes, as ten tests on one story: real server, real browser, the
// robots and policies as they come. WebGL, in software here, for the step that needs it; the
// others see the same page with still pictures.

import assert from "node:assert/strict";
import { mkdtempSync, readFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, describe, Studio, type Tab, tab, test, webgl } from "./harness";
import { drawn, under } from "./scene";

describe("the first five minutes", () => {
  // One story: what failed is told again from its beginning.
  describe.configure({ mode: "serial" });
  let studio: Studio;
  let t: Tab;

  before(async () => {
    studio = await Studio.start();
    t = await tab(studio, { width: 1280, height: 720 });
  });
  after(() => studio.end());

  test("0:00 the first screen of the README, and a doctor who names the mend", () => {
    const readme = readFileSync(join(process.cwd(), "../README.md"), "utf8");
    const first = readme.split("\n## ")[0] ?? "";
    assert.match(first, /!\[.+\]\(docs\/media\/.+\.png\)/, "a picture");
    assert.match(first, /script\/studio/, "a command");
    const doctor = studio.shell("doctor");
    assert.ok(
      doctor.code === 0 || /apt|mend|install/i.test(doctor.out + doctor.err),
      doctor.out + doctor.err,
    );
  });

  test("0:30 one address, usable at once, robots and policies in the program", async () => {
    assert.match(studio.url, /^http:\/\/127\.0\.0\.1:\d+\/#token=[0-9a-f]{64}$/);
    await t.byId("gallery").waitFor();
    assert.equal(new URL(t.page.url()).hash, "", "the token is out of sight");
    const robots = (await studio.api("GET", "/api/robots")).json() as { id: string }[];
    assert.deepEqual(
      robots.map((r) => r.id),
      ["pointmass", "ur5e", "ur5e_light", "shadow_hand"],
    );
    await t.byId("new-clip").waitFor();
  });

  test("1:00 an example opens with keys, take and error", async () => {
    for (const id of [
      "shadow_hand/fire",
      "shadow_hand/rsp",
      "shadow_hand/six",
      "ur5e/hang",
      "ur5e/front_back",
      "pointmass/star",
    ]) {
      await t.byId(`example-${id}`).waitFor();
    }
    await t
      .byId("example-pointmass/star")
      .locator("img")
      .evaluate(async (img: HTMLImageElement) => {
        if (!img.complete)
          await new Promise((resolve) => {
            img.onload = resolve;
            img.onerror = resolve;
          });
        if (img.naturalWidth === 0) throw new Error("no picture");
      });
    await t
      .byId("error-shadow_hand/fire")
      .filter({ hasText: /mean error 0\.\d+°/ })
      .waitFor();
    await t.picture("gallery");
    await t.byId("example-shadow_hand/rsp").click();
    const s = await t.until((x) => x.page === "editor" && x.robot === "shadow_hand", "open");
    assert.ok((s.clip?.keys.length ?? 0) >= 5);
    // Planners and networks alike; the fast one for what follows.
    await t.byId("policy").selectOption("computed-torque");
    await t.until(
      (x) =>
        x.rollout?.policy === "computed-torque" && x.rollout.phase === "done" && x.frames === x.clip?.length,
      "performed by it",
    );
    const done = await t.rolledOut();
    assert.equal(done.rollout?.phase, "done");
    assert.equal(done.frames, done.clip?.length);
    assert.match(await t.byId("badge").innerText(), /mean error/);
    await t.page.locator(".curves canvas").first().waitFor();
  });

  test("1:15 Space plays, scrubbing follows the mouse, the legend explains", async () => {
    await t.page.locator("body").press("Space");
    await t.until((s) => s.playing && s.playhead >= 2, "playing");
    await t.page.locator("body").press("Space");
    const box = await t.box("timeline");
    const [a, b] = [await t.at(40), await t.at(90)];
    await t.page.mouse.move(a.x, box.y + 8);
    await t.page.mouse.down();
    await t.page.mouse.move(b.x, box.y + 8, { steps: 6 });
    await t.page.mouse.up();
    await t.until((s) => s.playhead === 90, "where the mouse is");
    const legend = t.page.getByRole("group", { name: "Shown" });
    assert.match(
      (await legend.getByRole("button", { name: "Command" }).getAttribute("title")) ?? "",
      /translucent/,
    );
    assert.match(
      (await legend.getByRole("button", { name: "Achieved" }).getAttribute("title")) ?? "",
      /solid/,
    );
    await t.picture("editor");
    await t.goTo(0);
  });

  test("1:45 drag a finger: it turns, its joint is named, a key appears, Ctrl+Z takes it back", async () => {
    const free = 15;
    await t.goTo(free);
    assert.ok(!(await t.state()).clip?.keys.some((k) => k.frame === free));
    const facts = (await studio.api("GET", "/api/robot/shadow_hand")).json() as {
      bodies: { name: string; joints: number[] }[];
      table: { joints: { name: string }[] };
    };
    const body = facts.bodies.find((x) =>
      x.joints.some((j) => facts.table.joints[j]?.name.endsWith("FFJ3")),
    )?.name;
    assert.ok(body, "the index finger has a body");
    const { tab: g, close } = await webgl(studio, { width: 1100, height: 640 });
    try {
      // Software draws: one robot is enough.
      await g.until((s) => s.robot === "shadow_hand", "the hand");
      await g.toggle("Ghosts", "Command");
      await g.goTo(free);
      const p = await under(g, `/robot/${body}`);
      await g.page.mouse.down();
      for (let i = 1; i <= 6; i++) {
        await g.page.mouse.move(p.x, p.y + 8 * i);
        await drawn(g);
      }
      await g.page.mouse.up();
      const s = await g.until(
        (x) => x.clip?.keys.some((k) => k.frame === free) ?? false,
        "a key where there was none",
      );
      assert.ok(s.joint !== undefined);
      assert.match(s.clip?.robot.joints[s.joint] ?? "", /FFJ/, "a joint of the finger");
      await g.page.locator(".joint.on").first().waitFor();
      assert.deepEqual(g.foreign, []);
    } finally {
      await close();
    }
    await t.until((x) => x.clip?.keys.some((k) => k.frame === free) ?? false, "the other tab has it, too");
    await t.page.locator("body").press("Control+z");
    await t.until((x) => !x.clip?.keys.some((k) => k.frame === free), "taken back");
  });

  test("2:30 drag a key: the rollout runs again, the error changes, what cannot be reached is explained", async () => {
    const before = await t.rolledOut();
    const keys = await t.keys();
    const [moved, to] = [keys[2] ?? 0, (keys[1] ?? 0) + 3];
    assert.ok(to < moved);
    await t.drag(moved, to);
    const s = await t.until(
      (x) => (x.rev ?? 0) > (before.rev ?? 0) && x.rollout?.rev === x.rev && x.rollout?.phase === "done",
      "rolled out",
    );
    assert.notDeepEqual(s.error, before.error);
    assert.deepEqual(
      s.q.slice(0, Math.max(1, to - 20)),
      before.q.slice(0, Math.max(1, to - 20)),
      "what came before stands",
    );
    await t.page.locator("body").press("Control+z");
    await t.until_keys(keys);
  });

  test("3:15 mask an interval and see the difference; a blind span is mended by a click", async () => {
    const s = await t.rolledOut();
    const keys = s.clip?.keys ?? [];
    const [a, b] = [keys[1], keys.find((k) => k.frame > (keys[1]?.frame ?? 0) + 22)];
    assert.ok(a && b);
    await studio.api("POST", "/api/ops", {
      ops: [{ op: "mask.set", args: { from: a.frame + 1, to: b.frame, masked: true } }],
    });
    const masked = await t.until(
      (x) => (x.findings?.blind.length ?? 0) > (s.findings?.blind.length ?? 0),
      "blind",
    );
    const rolled = await t.rolledOut();
    assert.notDeepEqual(rolled.error, s.error, "fewer goals, another error strip");
    await t.picture("blind");
    const mends = t
      .byId("problems")
      .locator(".problem", { hasText: /blind|no goal|sight/i })
      .locator(".mends button");
    await mends.first().click();
    const mended = await t.until(
      (x) => (x.findings?.blind.length ?? 9) < (masked.findings?.blind.length ?? 0),
      "mended",
    );
    await t.page.locator("body").press("Control+z");
    await t.until((x) => (x.rev ?? 0) > (mended.rev ?? 0), "as before");
  });

  test("4:00 exports, and the command line agrees to 1e-6", async () => {
    const s = await t.rolledOut();
    await studio.api("POST", "/api/save", { path: "mine.clip.json" });
    await t.until((x) => x.dirty === false, "saved");
    await t.page.locator("body").press("Control+e");
    for (const format of ["mcap", "csv"]) {
      await t.byId(`format-${format}`).check();
      await t.byId("export-path").fill(`out.${format}`);
      await t.byId("export-folder").click();
      await t
        .byId("export-said")
        .filter({ hasText: `out.${format}` })
        .waitFor();
      assert.ok(studio.read(`out.${format}`).length > 1000, format);
    }
    assert.equal(studio.read("out.mcap").subarray(1, 5).toString(), "MCAP");
    assert.match(studio.read("out.csv").toString(), /^frame,time,mask,/);
    await t.picture("export");
    await t.page.keyboard.press("Escape");
    await t.page.getByRole("dialog").waitFor({ state: "hidden" });
    const ran = studio.shell("rollout", "mine.clip.json", "--policy", "computed-torque", "--json");
    assert.equal(ran.code, 0, ran.err);
    const precision = (JSON.parse(ran.out) as { precision: number | { precision: number } }).precision;
    const mae = typeof precision === "number" ? precision : precision.precision;
    assert.ok(
      Math.abs(mae - (s.rollout?.mae ?? 0)) < 1e-6,
      `${mae} in the shell, ${s.rollout?.mae} on the page`,
    );
  });

  test("4:30 kill the server, open it again: nothing acknowledged is lost", async () => {
    const keys = await t.keys();
    await t.drag(keys[1] ?? 0, (keys[1] ?? 0) + 2);
    const s = await t.until(
      (x) => x.dirty === true && x.clip?.keys[1]?.frame === (keys[1] ?? 0) + 2,
      "edited",
    );
    await studio.kill();
    await t.page.getByText("The studio has stopped").waitFor();
    const again = await Studio.start(["mine.clip.json"], studio.dir);
    try {
      const other = await tab(again, { width: 1100, height: 700 });
      await other.byId("restored").waitFor();
      assert.match(await other.byId("restored").innerText(), /Restored \d+ unsaved edit/);
      await other.picture("restored");
      assert.deepEqual((await other.state()).clip, s.clip);
      await other.context.close();
    } finally {
      await again.kill();
    }
  });

  test("5:00 collect and train from the page: progress, curve, stop, go on, perform", async () => {
    const dir = mkdtempSync(join(tmpdir(), "robert-browser-"));
    const fresh = await Studio.start([], dir);
    try {
      const p = await tab(fresh, { width: 1280, height: 800 });
      await p.turnTo("runs");
      await p.byId("runs-robot").selectOption("pointmass");
      await p.page.getByLabel("transitions").fill("20000");
      await p.byId("collect").click();
      await p.page.locator('[data-testid="job-1"][data-phase="done"]').waitFor();
      await p.page.getByLabel("preset").selectOption("pm-tiny");
      await p.page.getByLabel("run", { exact: true }).fill("runs/mine");
      await p.byId("train").click();
      await p.page.locator('[data-testid="job-2"] .job-curves canvas').first().waitFor();
      await p.page.locator('[data-testid="job-2"] .job-bar').filter({ hasText: "left" }).waitFor();
      await p.picture("training");
      await p.byId("cancel-2").click();
      await p.page.locator('[data-testid="job-2"][data-phase="interrupted"]').waitFor();
      await p.byId("resume-2").click();
      await p.page
        .locator('[data-testid="job-3"]')
        .getByText(/--resume runs\/mine/)
        .waitFor();
      await p.page.locator('[data-testid="job-3"] progress').waitFor();
      await p.byId("cancel-3").click();
      await p.page.locator('[data-testid="job-3"][data-phase="interrupted"]').waitFor();
      await p.byId("perform-runs/mine").click();
      const s = await p.until(
        (x) => x.page === "editor" && x.robot === "pointmass" && x.settings.policy === "robert",
        "the model performs",
      );
      assert.match(s.settings.model_path ?? "", /runs\/mine/);
      // After a power cut what was trained here can be chosen again.
      const port = Number(new URL(fresh.url).port);
      await fresh.kill();
      await fresh.run(port);
      await fresh.api("POST", `/api/gallery/${encodeURIComponent("pointmass/star")}`);
      await p.page.goto(fresh.url);
      await p.page.reload();
      await p.until((x) => x.link === "open" && x.robot === "pointmass", "started again");
      await p.byId("policy").selectOption("run:runs/mine");
      await p.until(
        (x) => x.settings.model_path?.includes("runs/mine") === true && x.rollout?.phase === "done",
        "it performs",
      );
      await p.panel("policies");
      await p.byId("try-all").click();
      await p.byId("tries").getByText("runs/mine").first().waitFor();
      await p.context.close();
    } finally {
      await fresh.end();
    }
  });
});
