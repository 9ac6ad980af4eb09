// What an animator meets in an ordinary hour: a crowded panel, a hand that changes its mind, keys at the end of the
// clip, many problems at once.

import assert from "node:assert/strict";
import { describe, eventually, onTheArm, type Tab, test } from "./harness";

const FINGERS = ["FF", "MF", "RF", "LF"];
const HAND = [
  ...FINGERS.flatMap((f) => [...(f === "LF" ? ["LFJ5"] : []), `${f}J4`, `${f}J3`, `${f}J2`, `${f}J1`]),
  ...[5, 4, 3, 2, 1].map((n) => `THJ${n}`),
];
/** Fingers inside one another, and joints beyond their stops. */
const KNOT = HAND.map((name) =>
  /J4$/.test(name) ? (/FF|MF/.test(name) ? -0.35 : 0.4) : /J3$/.test(name) ? 0.6 : -0.02,
);

/** Keys of a hand that no hand can hold. */
const knots = (count: number): string =>
  JSON.stringify({
    format: "robert-clip/1",
    name: "fingers in a knot",
    robot: { id: "shadow_hand", joints: HAND },
    fps: 20,
    length: 20 * count,
    fill: "linear",
    keys: Array.from({ length: count }, (_, i) => ({
      frame: 20 * i,
      q: KNOT.map((v) => v * (1 + 0.01 * i)),
    })),
  });

describe("an animator's hour", () => {
  let t: Tab;
  onTheArm((_, page) => {
    t = page;
  });

  test("joints keep some rows beside many problems, and nothing of the reachable pose is cut", async () => {
    await t.afresh(knots(6));
    await t.goTo(0);
    await t.until((s) => s.findings?.lints.some((l) => l.settled) ?? false, "the poses were simulated");
    // A picture without its file has no height.
    await t.page.waitForFunction(
      () => (document.querySelector<HTMLImageElement>(".pose img")?.naturalHeight ?? 0) > 0,
    );
    for (const [width, height] of [
      [1440, 900],
      [1366, 768],
      [1099, 700],
    ] as const) {
      await t.page.setViewportSize({ width, height });
      await t.painted();
      await t.picture(`crowded-${width}`);
      const at = `${width} x ${height}`;
      const seen = await t.page.evaluate(() => {
        const box = (e: Element | null) => e?.getBoundingClientRect();
        const panel = box(document.querySelector(".right"));
        const list = box(document.querySelector("[data-testid=inspector] .scroll"));
        const button = box(document.querySelector("[data-testid=use-reachable]"));
        const picture = box(document.querySelector(".pose img"));
        const poses = box(document.querySelector(".pose-list .scroll"));
        const name = document.querySelector("[data-testid=title] span");
        return {
          joints: Math.min(list?.bottom ?? 0, panel?.bottom ?? 0) - (list?.top ?? 0),
          whole: button && list && button.height > 16 && button.bottom <= list.top,
          picture: Math.min(picture?.bottom ?? 0, poses?.bottom ?? 0) - (picture?.top ?? 0),
          cut: (name?.scrollWidth ?? 1) > (name?.clientWidth ?? 0),
        };
      });
      assert.ok(seen.joints >= 80, `${at}: ${seen.joints} px for the joints`);
      assert.ok(seen.whole, `${at}: the button is whole`);
      assert.ok(seen.picture >= 30, `${at}: ${seen.picture} px of a pose`);
      assert.ok(!seen.cut, `${at}: the name is whole`);
    }
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("undo while something is held gives it up and undoes nothing else; other edits wait", async () => {
    await t.afresh();
    await t.rolledOut();
    await t.drag(30, 40);
    await t.until_keys([0, 40, 60]);
    const held = async (keys: string[], rev: number): Promise<void> => {
      for (const key of keys) await t.page.keyboard.press(key);
      assert.equal((await t.state()).rev, rev);
    };
    await t.drag(40, 50, { before: () => held(["Delete", "k", "Control+d", "Control+z"], 1) });
    await t.painted();
    assert.deepEqual([(await t.state()).rev, await t.keys()], [1, [0, 40, 60]]);
    // A slider.
    const slider = await t.byId("joint-0").locator(".slider").boundingBox();
    assert.ok(slider);
    const y = slider.y + slider.height / 2;
    await t.page.mouse.move(slider.x + 40, y);
    await t.page.mouse.down();
    await t.page.mouse.move(slider.x + 60, y, { steps: 4 });
    await held(["x", "Control+z"], 1);
    await t.page.mouse.up();
    // The graph.
    await t.press("v");
    await t.byId("graph").waitFor();
    await t.click("curve-0");
    await t.until((s) => s.curves.join() === "0", "its curve");
    await t.painted();
    const q = (await t.state()).clip?.keys.find((k) => k.frame === 40)?.q?.[0] ?? 0;
    const p = await t.graphAt(40, 0, q);
    await t.page.mouse.move(p.x, p.y);
    await t.page.mouse.down();
    await t.page.mouse.move(p.x + 20, p.y - 20, { steps: 4 });
    await held(["Control+z"], 1);
    assert.deepEqual((await t.state()).points, ["40:0"], "a point is held");
    await t.page.mouse.up();
    await t.press("v");
    await t.byId("timeline").waitFor();
    await t.painted();
    assert.deepEqual([(await t.state()).rev, await t.keys()], [1, [0, 40, 60]]);
    // Let go, it undoes.
    await t.press("Control+z");
    await t.until_keys([0, 30, 60]);
  });

  test("Enter in a number's field gives the keys back to the page, and sums are worked out", async () => {
    await t.afresh();
    await t.goTo(30);
    const field = t.byId("joint-0").locator("input[type=text]");
    const degrees = async (): Promise<number> =>
      (((await t.state()).clip?.keys.find((k) => k.frame === 30)?.q?.[0] ?? 0) * 180) / Math.PI;
    await field.fill("10+5");
    await field.press("Enter");
    await t.until((s) => s.rev === 1, "one edit");
    assert.ok(Math.abs((await degrees()) - 15) < 1e-3);
    await t.press("Control+a");
    await t.until((s) => s.selection.length === 3, "the keys are the page's");
    await field.fill("*=2");
    await field.press("Enter");
    await t.until((s) => s.rev === 2, "another edit");
    assert.ok(Math.abs((await degrees()) - 30) < 1e-3);
  });

  test("duplicates, pasted and retimed keys make room for themselves, as one edit", async () => {
    await t.afresh();
    const length = async (): Promise<number> => (await t.state()).clip?.length ?? 0;
    const before = await length();
    await t.clickKey(60);
    await t.goTo(before - 1);
    await t.press("Control+c", "Control+v");
    await t.until((s) => s.clip?.keys.at(-1)?.frame === before - 1, "pasted onto the last frame");
    await t.press("Control+d");
    await t.until((s) => s.clip?.keys.length === 5, "duplicated");
    assert.ok((await length()) > before);
    await t.page.getByText("the clip is longer now").first().waitFor();
    assert.equal((await t.state()).history?.done, 2);
    await t.press("Control+z");
    await t.until((s) => s.clip?.keys.length === 4 && s.clip.length === before, "one step back");
    // The playhead is not among these keys: the first of them stays.
    await t.clickKey(30);
    await t.clickKey(60, ["Control"]);
    await t.goTo(0);
    await t.press("s");
    await t.page.getByLabel("Factor on the distance to the first of the keys").fill("3");
    await t.page.keyboard.press("Enter");
    await t.until(
      (s) => JSON.stringify(s.clip?.keys.map((k) => k.frame)) === `[0,30,${before - 1},120]`,
      "retimed",
    );
    // What stands beyond a new end is cut when the person says so.
    await t.byId("length").fill("70");
    await t.byId("length").press("Enter");
    await t.page.getByRole("button", { name: "Cut the clip there" }).click();
    await t.until((s) => s.clip?.length === 70, "cut");
  });

  test("all problems of a kind are mended by one click, as one edit", async () => {
    await t.afresh(knots(40));
    const many = await t.until((s) => (s.findings?.lints.length ?? 0) >= 40, "many problems");
    const all = t.byId("fix-all").first();
    await all.waitFor();
    await t.picture("many-problems");
    assert.ok((await t.page.locator(".problem:visible").count()) < 20, "they are folded by kind");
    await all.click();
    const s = await t.until((x) => x.rev === 1, "one edit");
    assert.equal(s.history?.done, 1);
    await t.until(
      (x) => (x.findings?.rev === 1 && x.findings.lints.length < (many.findings?.lints.length ?? 0)) ?? false,
      "fewer",
    );
  });

  test("no robot is asked about another one's poses while clips of two are changed", async () => {
    const hand = new Set<string>();
    const arm = new Set<string>();
    t.page.on("request", (r) => {
      const url = new URL(r.url());
      const pose = url.searchParams.get("pose") ?? "";
      if (url.pathname.endsWith("/pose.jpg"))
        (url.searchParams.get("v")?.startsWith("shadow") ? hand : arm).add(pose);
      if (!url.pathname.endsWith("/ik")) return;
      const { q, locked } = r.postDataJSON() as { q: number[]; locked: string[] };
      (locked.includes("FFJ1") ? hand : arm).add(`${q.length} joints`);
    });
    for (let i = 0; i < 3; i++) {
      await t.afresh(knots(2));
      await t.until((s) => s.robot === "shadow_hand", "the hand");
      await eventually(async () => hand.size > 0, "the hand is asked about");
      await t.afresh();
      await t.until((s) => s.robot === "ur5e", "the arm");
      await eventually(async () => arm.size > 0, "the arm is asked about");
    }
    assert.deepEqual(
      [...hand].filter((what) => arm.has(what)),
      [],
    );
  });

  test("each kind of export has a name of its own, and none that was made before", async () => {
    await t.afresh();
    await t.rolledOut();
    await t.press("Control+e");
    const path = async (format: string): Promise<string> => {
      await t.byId(`format-${format}`).check();
      return t.byId("export-path").inputValue();
    };
    const picture = await path("png");
    assert.notEqual(picture, await path("strip"));
    assert.equal(await path("png"), picture);
    await t.click("export-folder");
    await t.byId("export-said").getByText("saved").waitFor();
    assert.match(await path("strip"), /-strip\.png$/);
    assert.match(await path("png"), /-2\.png$/);
    assert.ok(await t.byId("format-ur").isEnabled());
    await t.press("Escape");
    await t.afresh(knots(2));
    await t.press("Control+e");
    assert.ok(await t.byId("format-ur").isDisabled(), "a hand has no program for an arm");
    await t.press("Escape");
  });
});
