// How much a person has to do, counted in clicks and keys as the tests make them.

import assert from "node:assert/strict";
import { after, armTab, before, describe, Studio, type Tab, tab, test } from "./harness";

describe("editing effort", () => {
  let studio: Studio;
  before(async () => void (studio = await Studio.start()));
  after(() => studio.end());

  /** Types into a field: one click, one key a letter, Enter. */
  const type = async (
    t: Tab,
    effort: { clicks: number; keys: number },
    id: string,
    text: string,
  ): Promise<void> => {
    effort.clicks++;
    effort.keys += text.length + 1;
    const field = id === "frame" ? t.byId("frame") : t.byId(id).locator("input[type=text]");
    await field.click({ clickCount: 3 });
    await t.page.keyboard.type(text);
    await t.page.keyboard.press("Enter");
  };

  test("a clip of three keys with their times: at most 12 clicks and 40 keys", async () => {
    const t = await tab(studio);
    const effort = { clicks: 2, keys: 0 };
    await t.page.getByLabel("Robot").first().selectOption("ur5e");
    await t.byId("new-clip").click();
    await t.until((s) => s.page === "editor" && s.robot === "ur5e" && s.frames > 0, "a new clip");
    await t.byId("policy").selectOption("computed-torque"); // not part of the task
    // A new clip begins with its first key: where the robot rests.
    await t.until_keys([0]);
    for (const [at, value] of [
      ["20", "60"],
      ["40", "120"],
    ] as const) {
      await type(t, effort, "frame", at);
      await t.until((s) => s.playhead === Number(at), at);
      await type(t, effort, "joint-2", value);
    }
    await t.until_keys([0, 20, 40]);
    const s = await t.state();
    assert.deepEqual(
      s.clip?.keys.map((k) => Math.round(((k.q?.[2] ?? 0) * 180) / Math.PI)).slice(1),
      [60, 120],
    );
    console.log(`three keys: ${effort.clicks} clicks and ${effort.keys} keys`);
    assert.ok(effort.clicks <= 12 && effort.keys <= 40, JSON.stringify(effort));
    assert.equal(
      await t.page.locator('.right [data-testid^="joint-"]').count(),
      s.clip?.robot.joints.length,
      "a control for every joint",
    );
    await t.context.close();
  });

  test("move one key alone, copy, duplicate, undo five: at most three actions each", async () => {
    const t = await armTab(studio);
    const counted = async (what: string, most: number, run: () => Promise<void>): Promise<void> => {
      t.actions = 0;
      await run();
      console.log(`${what}: ${t.actions} actions`);
      assert.ok(t.actions <= most, `${what}: ${t.actions}`);
    };
    await counted("move the middle key alone", 3, async () => {
      await t.drag(30, 35);
      await t.until_keys([0, 35, 60]);
    });
    await counted("copy a pose elsewhere", 3, async () => {
      await t.drag(35, 45, { hold: "Alt" });
      await t.until_keys([0, 35, 45, 60]);
    });
    await counted("duplicate a key", 3, async () => {
      await t.clickKey(60);
      await t.press("Control+d");
      await t.until_keys([0, 35, 45, 60, 65]);
    });
    for (const df of [3, -3]) {
      await t.drag(65 + (df < 0 ? 3 : 0), 68 + (df < 0 ? -3 : 0));
      await t.until_keys([0, 35, 45, 60, df > 0 ? 68 : 65]);
    }
    await counted("undo five steps", 3, async () => {
      t.actions++;
      await t.page.getByRole("button", { name: "History" }).click();
      t.actions++;
      await t.byId("history").getByRole("button", { name: "The clip as it was opened" }).click();
      await t.until_keys([0, 30, 60]);
    });
    await t.context.close();
  });

  test("mirror a pose: at most three actions", async () => {
    await studio.api("POST", "/api/new", { robot: "ur5e" });
    const t = await tab(studio);
    const s = await t.until((x) => x.page === "editor" && x.robot === "ur5e", "open");
    const why = await t.page.getByRole("button", { name: "Mirror", exact: true }).getAttribute("title");
    await studio.api("POST", "/api/ops", {
      ops: [
        {
          op: "keys.add",
          args: { keys: [{ frame: 0, q: s.clip?.robot.joints.map((_, j) => 0.1 * (j + 1)) }], replace: true },
        },
      ],
    });
    await t.until_keys([0]);
    t.actions = 0;
    await t.clickKey(0);
    const button = t.page.getByRole("button", { name: "Mirror", exact: true });
    if (await button.isDisabled()) {
      assert.ok((why ?? "").length > 10, "a robot without mirror image says why");
      return;
    }
    t.actions++;
    await button.click();
    await t.until((x) => (x.history?.len ?? 0) === 2, "mirrored");
    assert.ok(t.actions <= 3);
    await t.context.close();
  });

  test("panels take at most 30 % of the width, at three sizes", async () => {
    const t = await armTab(studio);
    for (const [width, height] of [
      [1100, 700],
      [1280, 720],
      [1600, 900],
    ] as const) {
      await t.page.setViewportSize({ width, height });
      const view = await t.byId("viewport").boundingBox();
      assert.ok(view && view.width >= 0.7 * width - 1, `${view?.width} of ${width}`);
      assert.ok(view.height >= 300, `${view.height} px high`);
      await t.picture(`panels-${width}`);
    }
    await t.context.close();
  });
});
