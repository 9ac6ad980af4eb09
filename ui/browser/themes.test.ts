// Both palettes: which one is shown, whether all words can be read on what they stand on, and that
// letters come from the program itself. The palettes themselves are tested in src/styles/palette.test.ts.

import assert from "node:assert/strict";
import {
  after,
  armTab,
  before,
  describe,
  eventually,
  Studio,
  stillBrowser,
  type Tab,
  test,
  webgl,
} from "./harness";
import { drawn, viser } from "./scene";

describe("themes", () => {
  let studio: Studio;
  let t: Tab;

  before(async () => {
    studio = await Studio.start();
    t = await armTab(studio);
  });
  after(() => studio.end());

  const theme = () => t.page.evaluate(() => document.documentElement.dataset.theme);
  const choose = async (name: string): Promise<void> => {
    await t.page.keyboard.press("Control+k");
    await t.page.getByLabel("Command", { exact: true }).fill("dark or light");
    await t.page.keyboard.press("Enter");
    await t.page.getByRole("dialog").getByRole("button", { name, exact: true }).click();
  };
  test("dark until something else is chosen, whatever the system says; the choice stays", async () => {
    const context = await (await stillBrowser()).newContext({ colorScheme: "light" });
    const page = await context.newPage();
    const shown = () => page.evaluate(() => document.documentElement.dataset.theme);
    await page.goto(studio.url);
    assert.equal(await shown(), "dark");
    await page.evaluate(() => localStorage.setItem("theme", "auto"));
    await page.reload();
    assert.equal(await shown(), "light", "as the system");
    await page.emulateMedia({ colorScheme: "dark" });
    await page.waitForFunction(() => document.documentElement.dataset.theme === "dark");
    await context.close();
    await choose("light");
    assert.equal(await theme(), "light");
    await t.page.reload();
    await t.until((s) => s.link === "open", "again");
    assert.equal(await theme(), "light");
    await choose("dark");
    assert.equal(await theme(), "dark");
  });

  test("the console stays empty of errors while the editor and its 3D view load, dark and light", async () => {
    for (const kept of ["dark", "light"]) {
      const { tab: g, close } = await webgl(studio, { width: 1100, height: 640 }, { theme: kept });
      await g.until((s) => s.page === "editor" && s.clip?.name === "arm", "the arm open");
      assert.equal(await g.page.evaluate(() => document.documentElement.dataset.theme), kept);
      await drawn(g);
      await eventually(() => viser(g, (v) => !!v.nodeRefFromName["/robot"]), "the robot");
      assert.deepEqual([...g.console, ...g.errors], [], kept);
      await close();
    }
  });

  /** Words that cannot be read on what they stand on. */
  const faint = (): Promise<string[]> =>
    t.page.evaluate(() => {
      /** `rgb(…)`, or `color(srgb …)` with parts of 1, as mixed colours are given. */
      const parse = (c: string): number[] => {
        const parts = (c.replace("srgb", "").match(/[\d.]+/g) ?? []).map(Number);
        return c.startsWith("color") ? parts.map((v, i) => (i < 3 ? 255 * v : v)) : parts;
      };
      const over = (top: number[], under: number[]): number[] => {
        const a = top[3] ?? 1;
        return [0, 1, 2].map((i) => (top[i] ?? 0) * a + (under[i] ?? 0) * (1 - a));
      };
      const luminance = (c: number[]): number => {
        const [r = 0, g = 0, b = 0] = c
          .map((v) => v / 255)
          .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
      };
      /** What shines through from below, where every ground is a plain colour. */
      const ground = (e: Element): number[] => {
        const c = parse(getComputedStyle(e).backgroundColor);
        if ((c[3] ?? 1) === 1) return c;
        return e.parentElement ? over(c, ground(e.parentElement)) : [0, 0, 0];
      };
      const low: string[] = [];
      for (const e of document.querySelectorAll(
        ".bar *, .left *, .right *, .transport *, .side *, .hint *",
      )) {
        const said = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent?.trim());
        if (!said || e.closest(":disabled") || !(e as HTMLElement).offsetParent) continue;
        const under = ground(e);
        const ink = over(parse(getComputedStyle(e).color), under);
        const [p, q] = [luminance(ink), luminance(under)];
        const found = (Math.max(p, q) + 0.05) / (Math.min(p, q) + 0.05);
        if (found < 4.5) low.push(`${found.toFixed(2)} ${e.outerHTML.slice(0, 80)}`);
      }
      return low;
    });

  for (const name of ["dark", "light"] as const)
    test(`every word in ${name} has a contrast of 4.5 to 1 on its ground, from 820 to 2,560 px`, async () => {
      await choose(name);
      assert.equal(await theme(), name);
      for (const [width, height] of [
        [820, 700],
        [1440, 900],
        [2560, 1440],
        [1280, 720],
      ] as const) {
        await t.page.setViewportSize({ width, height });
        await t.painted();
        assert.deepEqual(await faint(), [], `${width} x ${height}`);
        await t.picture(`theme-${name}-${width}`);
      }
    });

  test("one typeface in three sizes, its figures of one width, from the program itself", async () => {
    const found = await t.page.evaluate(async () => {
      await document.fonts.ready;
      const sizes = new Set<string>();
      const families = new Set<string>();
      for (const e of document.querySelectorAll("#app *")) {
        if (![...e.childNodes].some((n) => n.nodeType === 3 && n.textContent?.trim())) continue;
        const s = getComputedStyle(e);
        sizes.add(s.fontSize);
        families.add(s.fontFamily.split(",")[0]?.replaceAll('"', "") ?? "");
      }
      const ctx = document.createElement("canvas").getContext("2d");
      const width = (text: string): number => {
        const span = Object.assign(document.createElement("span"), { textContent: text });
        span.style.position = "absolute";
        document.body.append(span);
        const w = span.getBoundingClientRect().width;
        span.remove();
        return w;
      };
      return {
        sizes: [...sizes].sort(),
        families: [...families],
        loaded: document.fonts.check('13px "Inter Variable"'),
        ones: width("1111"),
        eights: width("8888"),
        canvas: ctx !== null,
      };
    });
    assert.deepEqual(found.families, ["Inter Variable"]);
    assert.ok(
      found.sizes.every((s) => ["11px", "13px", "16px"].includes(s)),
      found.sizes.join(" "),
    );
    assert.ok(found.loaded);
    assert.ok(Math.abs(found.ones - found.eights) < 0.01, `${found.ones} and ${found.eights}`);
    for (const file of ["licence-inter.txt", "licence-lucide.txt"]) {
      const terms = await studio.api("GET", `/ui/${file}`);
      assert.ok(terms.status === 200 && /Copyright|License/.test(terms.bytes.toString()), file);
    }
  });

  test("panels are hidden by a key, groups fold, and both stay so", async () => {
    const width = async (): Promise<number> => (await t.byId("viewport").boundingBox())?.width ?? 0;
    const whole = await width();
    await t.press("Control+b");
    await t.page.locator(".left").waitFor({ state: "detached" });
    await t.press("Control+Shift+B");
    await t.page.locator(".right").waitFor({ state: "detached" });
    assert.ok((await width()) > whole + 300);
    await t.page.reload();
    await t.until((s) => s.link === "open" && s.page === "editor", "again");
    assert.equal(await t.page.locator(".left, .right").count(), 0);
    await t.press("Control+b", "Control+Shift+B");
    await t.page.locator(".right").waitFor();
    assert.ok(await t.byId("joint-0").isVisible(), "few joints are all in sight");
    const rows = () => t.page.locator("[role=grid] [role=row]").count();
    await studio.api("POST", `/api/gallery/${encodeURIComponent("shadow_hand/fire")}`);
    await t.until((s) => s.robot === "shadow_hand", "the hand");
    await t.page.locator("[role=grid]").getByText("Index finger").waitFor();
    const folded = await rows();
    assert.ok(folded < 16, `${folded} rows of 22 joints`);
    await t.page.locator(".group summary").filter({ hasText: "Thumb" }).click();
    await t.page.waitForFunction(
      (n) => document.querySelectorAll("[role=grid] [role=row]").length === n + 5,
      folded,
    );
    await t.page.reload();
    await t.until((s) => s.link === "open" && s.robot === "shadow_hand", "again");
    await t.page.locator("[role=grid]").getByText("Index finger").waitFor();
    assert.equal(await rows(), folded + 5, "as it was left");
  });

  test("a joint's row is 20 px high, with its name and its value in it", async () => {
    await t.afresh();
    // Both rows in one measurement: the panel of the document before may still be on the page.
    const apart = await t.page.waitForFunction(() => {
      const top = (n: number) =>
        document.querySelector(`[data-testid="joint-${n}"]`)?.getBoundingClientRect().top ?? Number.NaN;
      return top(1) - top(0) > 0 && top(1) - top(0);
    });
    const px = Number(await apart.jsonValue());
    assert.ok(px <= 22, `${px} px from row to row`);
    const clipped = await t.page
      .locator(".joint label > span:first-child")
      .evaluateAll((all) => all.filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.textContent));
    assert.deepEqual(clipped, [], "no name is cut off");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
