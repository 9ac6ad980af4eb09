// What is seen: nothing covered, nothing out of reach, words that say what is the case.

import assert from "node:assert/strict";
import { describe, eventually, onTheArm, type Studio, type Tab, test } from "./harness";

describe("look", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  const afresh = (text?: string): Promise<void> => t.afresh(text);

  test("no message lies over a button, at three sizes", async () => {
    await afresh();
    for (const [width, height] of [
      [1100, 640],
      [1280, 720],
      [1600, 900],
    ] as const) {
      await t.page.setViewportSize({ width, height });
      for (const text of ["nothing", "whatever"]) {
        await t.byId("frame").fill(`a time that is none, ${text}, and a message of some length about it`);
        await t.page.keyboard.press("Enter");
      }
      await t.page.locator(".toast").nth(1).waitFor();
      const covered = await t.page.evaluate(() => {
        const toasts = [...document.querySelectorAll(".toast")].map((e) => e.getBoundingClientRect());
        const own = document.querySelector(".toasts");
        return [...document.querySelectorAll("button, input, select, canvas, [role=separator]")]
          .filter((e) => !own?.contains(e))
          .filter((e) => {
            const r = e.getBoundingClientRect();
            return (
              r.width > 0 &&
              toasts.some((b) => r.left < b.right && r.right > b.left && r.top < b.bottom && r.bottom > b.top)
            );
          })
          .map((e) => e.outerHTML.slice(0, 90));
      });
      assert.deepEqual(covered, [], `${width} x ${height}`);
      await t.picture(`toasts-${width}`);
      await t.page.evaluate(() =>
        document.querySelectorAll<HTMLElement>(".toast [aria-label=Dismiss]").forEach((b) => b.click()),
      );
      await t.page.waitForFunction(() => document.querySelectorAll(".toast").length === 0);
    }
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("what concerns the whole page stands above it; one matter has one message", async () => {
    await afresh();
    for (const [width, height] of [
      [820, 700],
      [1280, 720],
    ] as const) {
      await t.page.setViewportSize({ width, height });
      await studio.api("POST", "/api/ops", {
        ops: [{ op: "keys.set", args: { frame: 30, values: { elbow: 1 + width / 1e5 } } }],
      });
      await t.until((s) => s.dirty === true, "edited");
      await studio.kill();
      const banner = t.byId("gone");
      await banner.waitFor();
      const covered = await banner.evaluate((e) => {
        const b = e.getBoundingClientRect();
        return [...document.querySelectorAll(".editor button, .editor input, .editor select")]
          .map((x) => x.getBoundingClientRect())
          .filter((r) => r.width > 0 && r.top < b.bottom - 1 && r.bottom > b.top + 1).length;
      });
      assert.equal(covered, 0, "no control lies under it");
      await t.picture(`banner-${width}`);
      await studio.run();
      await t.page.goto(studio.url);
      await t.until((s) => s.link === "open" && s.page === "editor", "again");
    }
    await t.byId("restored").waitFor();
    await t.picture("restored");
    await t.byId("restored").getByRole("button", { name: "Keep" }).click();
    for (const text of ["soon", "later", "soon"]) {
      await t.byId("frame").fill(text);
      await t.page.keyboard.press("Enter");
    }
    await t.page.locator(".toast").filter({ hasText: '"later" is not a time' }).waitFor();
    assert.equal(await t.page.locator(".toast").filter({ hasText: '"soon"' }).count(), 1);
    const short = t.page.locator(".toast").filter({ hasText: /stops \d+ mm short/ });
    for (const axis of ["x", "y", "z"]) {
      if ((await t.state()).site === undefined) await t.byId("site-end_effector").click();
      await t.byId(`reach-${axis}`).fill("9");
      await t.byId(`reach-${axis}`).press("Enter");
      await short.first().waitFor();
    }
    assert.equal(await short.count(), 1, "one message for x, y, z");
  });

  test("at 1100 x 700 several poses and joints are in sight", async () => {
    await studio.api("POST", `/api/gallery/${encodeURIComponent("shadow_hand/fire")}`);
    await t.until((s) => s.robot === "shadow_hand", "the hand");
    await t.page.setViewportSize({ width: 1100, height: 700 });
    const seen = (what: string, within: string): Promise<number> =>
      t.page.evaluate(
        ([w, i]) => {
          const box = document.querySelector(i as string)?.getBoundingClientRect();
          return [...document.querySelectorAll(w as string)].filter((e) => {
            const r = e.getBoundingClientRect();
            return box && r.height > 0 && r.top >= box.top - 1 && r.bottom <= box.bottom + 1;
          }).length;
        },
        [what, within],
      );
    await t.panel("poses");
    const poses = await seen(".pose", "[data-testid=poses] .scroll");
    const joints = await seen(".joint", "[data-testid=inspector] .scroll");
    assert.ok(poses >= 2, `${poses} poses`);
    assert.ok(joints >= 5, `${joints} joints`);
    await t.picture("small-hand");
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("at 200 % zoom every control is reached and can be pressed", async () => {
    await afresh();
    // 1600 x 900 at 200 % is 800 x 450 for the page.
    await t.page.setViewportSize({ width: 800, height: 450 });
    await t.panel("poses");
    for (const area of [
      ".bar",
      ".transport",
      ".legend",
      "[data-testid=inspector]",
      "[data-testid=poses]",
      ".tabs",
    ]) {
      for (const b of await t.page
        .locator(
          `${area} button:enabled, ${area} input:enabled:not(.slider input), ${area} .slider, ${area} select:enabled`,
        )
        .all()) {
        await b.click({ trial: true });
      }
    }
    await t.byId("timeline").scrollIntoViewIfNeeded();
    await t.picture("zoomed");
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("from 820 to 2,560 px and at 200 % zoom nothing lies beyond the edge, and no word is cut", async () => {
    await afresh();
    for (const [width, height] of [
      [2560, 1440],
      [1440, 900],
      [1280, 720],
      [1099, 700],
      [820, 700],
      [800, 450],
    ] as const) {
      await t.page.setViewportSize({ width, height });
      await t.painted();
      await t.picture(`narrow-${width}`);
      const beyond = await t.page.evaluate(() =>
        [...document.querySelectorAll(".editor button, .editor input, .editor select")]
          .filter((e) => {
            const r = e.getBoundingClientRect();
            return r.width > 0 && (r.right > innerWidth + 1 || r.left < -1);
          })
          .map((e) => e.outerHTML.slice(0, 90)),
      );
      assert.deepEqual(beyond, [], `${width} x ${height}`);
      const cut = await t.page.evaluate(() =>
        [
          ...document.querySelectorAll<HTMLElement>(
            ".bar button:not(.name), .transport button, .tabs button, .legend button, .tools-row button, .right h2",
          ),
        ]
          .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth + 1)
          .map((e) => `${e.textContent}: ${e.scrollWidth} in ${e.clientWidth}`),
      );
      assert.deepEqual(cut, [], `${width} x ${height}`);
      for (const control of [
        t.byId("save"),
        t.page.getByRole("button", { name: "Export" }),
        t.byId("joint-0"),
      ])
        await control.click({ trial: true });
    }
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("at 820 px and at 200 % zoom bar, legend, transport and hints are one row each", async () => {
    await afresh();
    const rows = (within: string): Promise<number> =>
      t.page.evaluate((of) => {
        const boxes = [...document.querySelectorAll<HTMLElement>(of)]
          .filter((e) => e.offsetParent)
          .map((e) => e.getBoundingClientRect());
        const lowest = Math.max(...boxes.map((b) => b.top));
        // In one row every box begins above the end of every other.
        return boxes.every((b) => b.bottom > lowest) ? boxes.length : -boxes.length;
      }, within);
    for (const [width, height] of [
      [820, 720],
      [800, 450],
    ] as const) {
      await t.page.setViewportSize({ width, height });
      await t.painted();
      assert.ok((await rows(".bar button, .bar select")) > 8, "the bar");
      assert.ok((await rows(".legend button, .legend select")) === 7, "what is shown");
      assert.ok(
        (await rows(".transport button, .transport input, .transport select")) >= 13,
        "the transport",
      );
      await t.byId("shaping").click();
      await t.byId("fade").waitFor();
      assert.ok((await rows(".transport button, .transport input")) >= 13, "with the fade of offsets");
      await t.picture(`rows-${width}`);
      await t.page.getByRole("button", { name: "Keys", exact: true }).click();
      const title = t.byId("inspector").locator("h2");
      assert.ok(((await title.boundingBox())?.height ?? 99) < 36, "the inspector's title");
      const hint = t.page.locator(".hint");
      await hint.scrollIntoViewIfNeeded();
      assert.ok(((await hint.boundingBox())?.height ?? 99) < 30, "the hints");
      // A hint is there whole or not at all.
      const cut = await hint.evaluate((e) => {
        const box = (e.querySelector(".hints") as HTMLElement).getBoundingClientRect();
        return [...e.querySelectorAll<HTMLElement>(".hints > span")]
          .map((s) => s.getBoundingClientRect())
          .filter((r) => r.top < box.bottom - 1 && (r.right > box.right + 1 || r.bottom > box.bottom + 1))
          .length;
      });
      assert.equal(cut, 0, "a hint is cut");
      await t.picture(`hints-${width}`);
    }
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("at 820 px the joints and problems of a hand do not push the timeline out of sight", async () => {
    await studio.api("POST", `/api/gallery/${encodeURIComponent("shadow_hand/six")}`);
    await t.until(
      (s) => s.robot === "shadow_hand" && (s.findings?.lints.length ?? 0) > 2,
      "a hand with problems",
    );
    await t.page.setViewportSize({ width: 820, height: 720 });
    await t.painted();
    await t.picture("hand-820");
    const [sheet, view] = [await t.box("timeline"), await t.box("viewport")];
    assert.ok(sheet.y < 720 - 150, `the timeline begins at ${sheet.y}`);
    assert.ok(view.height >= 240 && view.height < 320, `the viewport is ${view.height} high`);
    const inside = await t.byId("inspector").evaluate((e) => {
      const r = (e.closest(".right") as HTMLElement).getBoundingClientRect();
      return r.bottom - e.ownerDocument.querySelector(".transport")!.getBoundingClientRect().top;
    });
    assert.ok(inside <= 1, "the right panel ends above the transport");
    const last = t.byId("problems").locator(".problem").last();
    await last.scrollIntoViewIfNeeded();
    await last.locator("button").last().click({ trial: true });
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("at 1440 x 900 poses, policies and takes each have the left side to themselves", async () => {
    await studio.api("POST", `/api/gallery/${encodeURIComponent("shadow_hand/fire")}`);
    await t.until((s) => s.robot === "shadow_hand", "the hand");
    await t.page.setViewportSize({ width: 1440, height: 900 });
    await t.byId("policy").selectOption("computed-torque");
    await t.until((s) => s.rollout?.policy === "computed-torque" && s.rollout.phase === "done", "rolled out");
    const inSight = (what: string): Promise<DOMRect[]> =>
      t.page.evaluate((w) => {
        const box = document.querySelector(".left .scroll")?.getBoundingClientRect();
        return [...document.querySelectorAll(w)]
          .map((e) => e.getBoundingClientRect())
          .filter((r) => box && r.height > 0 && r.top >= box.top - 1 && r.bottom <= box.bottom + 1);
      }, what);
    const poses = async (): Promise<number> => new Set((await inSight(".pose")).map((r) => r.top)).size;
    await t.panel("poses");
    assert.ok((await poses()) >= 3, `${await poses()} rows of poses`);
    await t.panel("policies");
    assert.ok((await inSight(".policy")).length >= 4, "policies with their words");
    await t.byId("try-all").click();
    await t.byId("tries").waitFor();
    await t.picture("left-1440-tried");
    await t.panel("takes");
    assert.ok((await inSight(".takes li")).length >= 3, "takes");
    await t.picture("left-1440-takes");
    await t.panel("poses");
    assert.ok((await poses()) >= 3, "what was tried takes no room from the poses");
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("a key of one frame is a cross in the curves", async () => {
    await afresh();
    await t.rolledOut();
    await t.byId("joint-2").locator("input[type=range]").focus();
    await t.until((s) => s.joint === 2, "chosen");
    /** Pixels of the curve's colour near a key, off the line of what was reached. */
    const ink = (frame: number): Promise<number> =>
      t.page.evaluate((f) => {
        const u = document.querySelector(".plots .uplot canvas") as HTMLCanvasElement;
        const over = document.querySelector(".plots .u-over") as HTMLElement;
        const k = devicePixelRatio;
        const [c, o] = [u.getBoundingClientRect(), over.getBoundingClientRect()];
        const x = o.left - c.left + (f / 79) * o.width;
        const [r, g, b] = (
          getComputedStyle(document.documentElement).getPropertyValue("--series").trim().split(/\s+/)[2] ??
          "#000000"
        )
          .match(/\w\w/g)!
          .map((h) => parseInt(h, 16)) as [number, number, number];
        const data = u
          .getContext("2d")!
          .getImageData((x - 6) * k, (o.top - c.top) * k, 12 * k, o.height * k).data;
        let count = 0;
        for (let i = 0; i < data.length; i += 4)
          if (Math.abs(data[i]! - r) + Math.abs(data[i + 1]! - g) + Math.abs(data[i + 2]! - b) < 60) count++;
        return count;
      }, frame);
    await t.goTo(79);
    await eventually(async () => (await ink(30)) > (await ink(45)) + 8, "more ink at the key than beside it");
    assert.equal(await t.page.locator(".curve-legend li").count(), 2);
    const marks = await t.page
      .locator(".curve-legend path")
      .evaluateAll((all) => all.map((p) => p.getAttribute("d")));
    assert.equal(new Set(marks).size, 2, "the shapes differ, not the colour alone");
  });

  test("a studio that was started again with another token is named as such", async () => {
    await afresh();
    const port = Number(new URL(studio.url).port);
    await studio.kill();
    await t.page.getByText("The studio has stopped").waitFor();
    await studio.run(port);
    await t.page.getByText("Another studio is running").waitFor();
    await t.page.goto(studio.url);
    await t.page.reload();
    await t.until((s) => s.link === "open", "in again by the new address");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
