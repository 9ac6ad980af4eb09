// What was wrong once and has no better place: each test is named after what was seen.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { ARM, describe, onTheArm, type Studio, type Tab, test } from "./harness";

describe("defects that were mended", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  const afresh = async (text?: string): Promise<void> => {
    await t.afresh(text);
    await t.rolledOut();
  };
  /** Texts that a canvas of the page draws when it draws again. */
  const written = async (canvas: string, again: () => Promise<void>): Promise<string[][]> => {
    await t.page.evaluate(() => {
      const own = CanvasRenderingContext2D.prototype as unknown as { plain?: typeof fillText };
      const fillText = CanvasRenderingContext2D.prototype.fillText;
      own.plain ??= fillText;
      const seen: [HTMLCanvasElement, string][] = [];
      Object.assign(window, { __written: seen });
      CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
        seen.push([this.canvas, text]);
        own.plain?.call(this, text, ...rest);
      };
    });
    await again();
    await t.painted();
    return t.page.evaluate((of) => {
      const seen = (window as unknown as { __written: [HTMLCanvasElement, string][] }).__written;
      const own = CanvasRenderingContext2D.prototype as unknown as { plain: CanvasText["fillText"] };
      CanvasRenderingContext2D.prototype.fillText = own.plain;
      return [...document.querySelectorAll(of)].map((c) => [
        ...new Set(seen.filter(([canvas]) => canvas === c).map(([, text]) => text)),
      ]);
    }, canvas);
  };

  test("after an undo the current take is not struck out", async () => {
    await afresh();
    const first = await t.state();
    await studio.api("POST", "/api/ops", {
      ops: [{ op: "keys.set", args: { frame: 30, values: { elbow: 1.2 } } }],
    });
    await t.until((s) => s.clip?.keys[1]?.q?.[2] === 1.2, "edited");
    await t.rolledOut();
    await t.press("Control+z");
    await t.until((s) => s.clip?.keys[1]?.q?.[2] === 1.4, "undone");
    const s = await t.rolledOut();
    assert.deepEqual(s.q, first.q, "the motion is that from before");
    await t.panel("takes");
    const now = t.page.locator(".takes .take", { has: t.page.getByRole("img", { name: "current" }) });
    await now.waitFor();
    assert.equal(await now.count(), 1);
    assert.doesNotMatch((await now.getAttribute("class")) ?? "", /stale/);
  });

  test("a download has the name of the File field", async () => {
    await afresh();
    await t.press("Control+e");
    await t.byId("format-mcap").check();
    assert.equal(await t.byId("export-path").inputValue(), "arm.mcap");
    await t.byId("export-path").fill("films/of today.mcap");
    const download = t.page.waitForEvent("download");
    await t.byId("export-download").click();
    assert.equal((await download).suggestedFilename(), "of today.mcap");
    // A clip is made by the page itself.
    await t.byId("format-json").check();
    const clip = t.page.waitForEvent("download");
    await t.byId("export-download").click();
    const text = readFileSync(await (await clip).path(), "utf8");
    assert.equal(JSON.parse(text).name, "arm");
    await t.press("Escape");
  });

  test("a clip that is called clip is no clip.clip.json", async () => {
    await afresh(ARM.replace('"arm"', '"clip"'));
    await t.press("Control+Shift+s");
    assert.equal(await t.page.getByLabel("File", { exact: true }).inputValue(), "untitled.clip.json");
    await t.press("Escape");
    await afresh(ARM.replace('"arm"', '"wave.clip.json"'));
    await t.press("Control+Shift+s");
    assert.equal(await t.page.getByLabel("File", { exact: true }).inputValue(), "wave.clip.json");
    await t.press("Escape");
  });

  test("ticks of the curves are what stands there: the same from one to the next", async () => {
    for (const [low, high] of [
      [1.45, 1.57],
      [1.0, 1.57],
      [-1.2, 1.6],
    ] as const) {
      await afresh(
        JSON.stringify({
          ...JSON.parse(ARM),
          keys: [
            { frame: 0, q: [-1.57, -1.57, high, -1.57, -1.57] },
            { frame: 40, q: [-1.57, -1.57, low, -1.57, -1.57] },
          ],
        }),
      );
      await t.byId("joint-2").locator("input[type=range]").focus();
      await t.until((s) => s.joint === 2, "the elbow");
      await t.blur();
      await t.painted();
      const plots = await written(".plots canvas", () => t.goTo(7));
      assert.equal(plots.length, 2);
      for (const texts of plots) {
        const ticks = texts.filter((x) => /^-?[\d.]+$/.test(x)).map(Number);
        ticks.sort((a, b) => a - b);
        assert.ok(ticks.length >= 2, texts.join(" "));
        const steps = ticks.slice(1).map((v, i) => v - (ticks[i] ?? 0));
        const first = steps[0] ?? 0;
        assert.ok(
          steps.every((v) => Math.abs(v - first) < 1e-6 * Math.max(1, first)),
          ticks.join(" "),
        );
        assert.ok(!texts.some((x) => /^-0(\.0*)?$/.test(x)), `no minus zero: ${texts}`);
      }
    }
  });

  test("the ruler is in seconds, not in frames here and seconds there", async () => {
    await afresh();
    const [sheet = []] = await written(".sheet canvas", async () => {
      await t.page.evaluate(() => window.__studio.redraw());
    });
    const ruler = sheet.filter((x) => /\d/.test(x) && !/wrist/.test(x));
    assert.ok(ruler.length >= 4, sheet.join(" "));
    assert.deepEqual(
      ruler.filter((x) => !/^-?\d+(\.\d+)? s$/.test(x)),
      [],
    );
  });

  test("a key that another page deletes under a hand is told, without a script's words", async () => {
    await afresh();
    const [from, to] = [await t.at(30), await t.at(40)];
    await t.page.mouse.move(from.x, from.y);
    await t.page.mouse.down();
    await t.page.mouse.move(to.x, to.y, { steps: 4 });
    await studio.api("POST", "/api/ops", { ops: [{ op: "keys.delete", args: { frames: [30] } }] });
    await t.until_keys([0, 60]);
    await t.page.mouse.up();
    await t.page.locator(".hint").getByText("another page deleted them").waitFor();
    assert.deepEqual(await t.page.getByRole("alert").allInnerTexts(), []);
    assert.deepEqual(await t.keys(), [0, 60]);
    await t.rolledOut();
  });

  test("a length that no clip can have is refused in words", async () => {
    await afresh();
    await t.byId("length").fill("100000s");
    await t.page.keyboard.press("Enter");
    await t.page
      .getByRole("alert")
      .filter({ hasText: /100000/ })
      .first()
      .waitFor();
    assert.equal((await t.state()).clip?.length, 80);
    await t.page.evaluate(() => window.__studio.dismissAll());
    await t.turnTo("gallery");
    await t.page.getByLabel("Length of the new clip, seconds").fill("100000");
    await t.byId("new-clip").click();
    await t.page
      .getByRole("alert")
      .filter({ hasText: /2 to 100000 frames/ })
      .waitFor();
    assert.equal((await t.state()).clip?.name, "arm", "nothing was opened");
    await t.page.getByLabel("Length of the new clip, seconds").fill("5");
    await t.turnTo("editor");
  });

  test("speeds and angles are told in the unit of the fields, in the problems as in a drag", async () => {
    await afresh(
      JSON.stringify({
        ...JSON.parse(ARM),
        keys: [
          { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57] },
          { frame: 6, q: [1.2, -1.4, 1.4, -1.5, -1.5] },
          { frame: 60, q: [1.2, -1.5, 1.3, -1.4, -1.6] },
        ],
      }),
    );
    const said = (): Promise<string> => t.byId("problems").innerText();
    await t.byId("problems").getByText("too fast").first().waitFor();
    assert.match(await said(), /too fast: .*[\d.]+ of [\d.]+ °\/s/);
    assert.doesNotMatch(await said(), /\d rad/);
    const demand = async (unit: RegExp): Promise<void> => {
      const [from, to] = [await t.at(60), await t.at(52)];
      await t.page.mouse.move(from.x, from.y);
      await t.page.mouse.down();
      await t.page.mouse.move(to.x, to.y, { steps: 4 });
      await t.byId("demand").filter({ hasText: unit }).waitFor();
      await t.page.keyboard.press("Escape");
      await t.page.mouse.up();
      await t.until((s) => s.demand === undefined, "given up");
    };
    await demand(/°\/s/);
    const unit = t.byId("inspector").getByRole("button", { name: "Switch between degrees and radians" });
    await unit.click();
    await t.byId("problems").getByText("rad/s").first().waitFor();
    assert.doesNotMatch(await said(), /°/);
    await demand(/rad\/s/);
    await unit.click();
    await t.byId("problems").getByText("°/s").first().waitFor();
  });

  test("a long clip's frames stand whole in their fields; nothing is minus zero", async () => {
    await afresh(JSON.stringify({ ...JSON.parse(ARM), length: 12_000 }));
    await t.goTo(11_999);
    for (const id of ["frame", "length"]) {
      const cut = await t
        .byId(id)
        .evaluate((e: HTMLInputElement) => ({ value: e.value, room: e.clientWidth - e.scrollWidth }));
      assert.ok(cut.room >= 0, `${id}: ${cut.value} is cut by ${-cut.room} px`);
    }
    await afresh();
    await t.goTo(30);
    const number = t.byId("joint-2").locator("input[type=text]");
    await number.fill("-0.001");
    await number.press("Enter");
    await t.until((s) => Math.abs(s.clip?.keys[1]?.q?.[2] ?? 9) < 1e-4, "nearly zero");
    await t.page.waitForFunction(
      () =>
        (document.querySelector('[data-testid="joint-2"] input[type=text]') as HTMLInputElement).value ===
        "0.0",
    );
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
