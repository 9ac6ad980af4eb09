// What who opens the studio for the first time meets: a calm clip, a tour that can be skipped, one
// search over everything, one's own clips first.

import assert from "node:assert/strict";
import { ARM, after, before, describe, Studio, stillBrowser, type Tab, tab, test } from "./harness";

describe("first run", () => {
  let studio: Studio;
  let t: Tab;

  before(async () => {
    studio = await Studio.start();
    t = await tab(studio, { width: 1440, height: 900 });
  });
  after(() => studio.end());
  const search = async (text: string): Promise<void> => {
    await t.press("Control+k");
    await t.page.getByLabel("Command", { exact: true }).fill(text);
  };

  test("a new clip is calm: one key, no problem, no tint, and what to do next", async () => {
    await t.page.getByLabel("Robot").first().selectOption("ur5e");
    await t.byId("new-clip").click();
    await t.until((s) => s.page === "editor" && s.robot === "ur5e" && s.frames > 0, "a new clip");
    await t.rolledOut();
    assert.match(await t.byId("problems").innerText(), /Next step.*second key/s);
    assert.equal(await t.page.locator(".problem").count(), 0);
    /** Pixels of the timeline between frames 10 and 50 that have the tint of a blind span. */
    const tinted = (): Promise<number> =>
      t.page.evaluate(() => {
        const style = getComputedStyle(document.documentElement);
        const colour = (name: string): number[] =>
          [1, 3, 5].map((i) =>
            parseInt(
              style
                .getPropertyValue(name)
                .trim()
                .slice(i, i + 2),
              16,
            ),
          );
        const [panel, blind] = [colour("--panel"), colour("--blind")];
        // As strong as draw.ts lays it on the panel.
        const tint = panel.map((p, i) => p + ((blind[i]! - p) * 0x26) / 0xff);
        const canvas = document.querySelector(".sheet canvas") as HTMLCanvasElement;
        const [from, to] = [10, 50].map((f) => Math.round(window.__studio.frameToX(f))) as [number, number];
        const { data } = canvas.getContext("2d")!.getImageData(from, 60, to - from, 100);
        let count = 0;
        for (let i = 0; i < data.length; i += 4)
          if (tint.every((v, c) => Math.abs(v - data[i + c]!) < 2)) count++;
        return count;
      });
    await t.painted();
    assert.equal(await tinted(), 0, "no tint before anything was done");
    await t.picture("new-clip");
    // A second key far away: now it is worth a hint.
    await t.goTo(80);
    await t.press("k");
    await t.until_keys([0, 80]);
    await t.until((s) => (s.findings?.blind.length ?? 0) > 0, "a blind span");
    await t.page.getByText(/^No problems, hints \(\d\)$/).waitFor();
    await t.painted();
    assert.ok((await tinted()) > 1000, "a tint where the policy sees no goal");
    await t.picture("blind-span");
  });

  test("one search finds joints, poses, policies, examples and commands", async () => {
    await search("elbow");
    await t.picture("search");
    const first = t.page.locator("#palette-list li").first();
    assert.match(await first.innerText(), /elbow.*Joint/s);
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.joint === 2, "the joint is chosen");
    await t.page.waitForFunction(() =>
      document.activeElement?.closest('[data-testid="joint-2"]')?.matches(".joint"),
    );
    await t.page.keyboard.press("Escape");
    await t.blur();
    await t.goTo(80);
    await t.blur();
    await search("pose folded");
    await t.page.keyboard.press("Enter");
    const posed = await t.until(
      (s) => s.clip?.keys.some((k) => k.frame === 80 && k.pose === "folded") ?? false,
      "the pose is applied",
    );
    assert.equal(posed.clip?.keys.length, 2);
    await search("inverse dynamics");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.settings.policy === "computed-torque", "the policy is chosen");
    await search("go to any edit");
    await t.page.keyboard.press("Enter");
    await t.byId("history").waitFor();
    await t.page.keyboard.press("Escape");
    await search("no such thing");
    await t.page.getByText("Nothing has this name.").waitFor();
    await t.page.getByLabel("Command", { exact: true }).fill("star pointmass");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.robot === "pointmass", "the example is open");
  });

  test("own clips stand before the examples, and open by a click", async () => {
    await t.blur();
    await studio.api("POST", "/api/save", { path: "mine.clip.json" });
    await t.until((s) => s.dirty === false, "saved");
    await t.turnTo("gallery");
    const mine = t.byId("own-files").getByRole("button", { name: "star", exact: true });
    await mine.waitFor();
    const above = async (): Promise<boolean> => {
      const [a, b] = await Promise.all([
        t.byId("own-files").boundingBox(),
        t.page.locator(".card").first().boundingBox(),
      ]);
      return a !== null && b !== null && a.y + a.height <= b.y;
    };
    assert.ok(await above());
    await t.picture("own-clips");
    await mine.click();
    await t.until((s) => s.page === "editor" && s.dirty === false, "open");
  });

  test("the tour has five steps, can be skipped, and never comes again by itself", async () => {
    await studio.api("POST", "/api/new", { text: ARM });
    const context = await (await stillBrowser()).newContext({ viewport: { width: 1280, height: 720 } });
    const page = await context.newPage();
    page.setDefaultTimeout(60_000);
    await page.goto(studio.url);
    const tour = page.getByTestId("tour");
    await tour.waitFor();
    await tour.getByText("1 of 5").waitFor();
    // It blocks nothing: the page is used beside it.
    await page.getByTestId("frame").fill("7");
    await page.getByTestId("frame").press("Enter");
    await page.waitForFunction(() => window.__studio.after("", 1).then((s) => s.state.playhead === 7));
    for (let n = 1; n <= 5; n++) {
      await tour.getByText(`${n} of 5`).waitFor();
      const inside = await tour.evaluate((e) => {
        const r = e.getBoundingClientRect();
        return r.left >= 0 && r.top >= 0 && r.right <= innerWidth && r.bottom <= innerHeight;
      });
      assert.ok(inside, `step ${n} is in sight`);
      if (process.env.ROBERT_SCREENSHOTS)
        await page.screenshot({ path: `${process.env.ROBERT_SCREENSHOTS}/tour-${n}.png` });
      await page.getByTestId("tour-next").click();
    }
    await tour.waitFor({ state: "detached" });
    await page.reload();
    await page.getByTestId("timeline").waitFor();
    assert.equal(await tour.count(), 0, "not again");
    // Asked for, it comes; skipped, it goes.
    await page.keyboard.press("Control+k");
    await page.getByLabel("Command", { exact: true }).fill("tour");
    await page.keyboard.press("Enter");
    await tour.waitFor();
    await page.getByTestId("tour-skip").click();
    await tour.waitFor({ state: "detached" });
    // By keys alone: Enter goes on, Esc ends it.
    const byKeys = async (): Promise<void> => {
      await page.keyboard.press("Control+k");
      await page.getByLabel("Command", { exact: true }).fill("tour");
      await page.keyboard.press("Enter");
      await page.waitForFunction(() => document.activeElement?.getAttribute("data-testid") === "tour-next");
    };
    await byKeys();
    for (let n = 1; n <= 5; n++) {
      await tour.getByText(`${n} of 5`).waitFor();
      await page.keyboard.press("Enter");
    }
    await tour.waitFor({ state: "detached" });
    assert.equal(await page.getByRole("dialog").count(), 0, "Enter opened nothing behind it");
    await byKeys();
    await page.keyboard.press("Escape");
    await tour.waitFor({ state: "detached" });
    await context.close();
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
