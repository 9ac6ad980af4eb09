// A newcomer without a mouse, in a narrow window and in a wide one: from the first page to a saved and
// exported motion.

import assert from "node:assert/strict";
import { existsSync, rmSync } from "node:fs";
import { after, before, describe, Studio, type Tab, tab, test } from "./harness";

describe("by keys alone", () => {
  let studio: Studio;
  before(async () => {
    studio = await Studio.start();
  });
  after(() => studio.end());

  /** Goes on with Tab until what has the focus is called so. */
  const tabTo = async (t: Tab, name: RegExp): Promise<void> => {
    for (let i = 0; i < 80; i++) {
      const now = await t.page.evaluate(() => {
        const e = document.activeElement;
        return e?.getAttribute("aria-label") || e?.textContent || "";
      });
      if (name.test(now)) return;
      await t.page.keyboard.press("Tab");
    }
    assert.fail(`${name} is not reached by Tab`);
  };
  const search = async (t: Tab, text: string): Promise<void> => {
    await t.page.keyboard.press("Control+k");
    await t.page.getByLabel("Command", { exact: true }).waitFor();
    await t.page.keyboard.type(text);
    await t.page.locator("#palette-list [aria-selected=true]").waitFor();
    await t.page.keyboard.press("Enter");
    await t.page.getByLabel("Command", { exact: true }).waitFor({ state: "detached" });
  };

  for (const [width, height] of [
    [820, 720],
    [1440, 900],
  ] as const) {
    test(`open, pose, pin, shape, offset, save and export at ${width} px`, async () => {
      const t = await tab(studio, { width, height });
      // An example, and its motion.
      await search(t, "six shadow");
      await t.until((s) => s.page === "editor" && s.clip?.name === "six", "an example is open");
      await t.rolledOut();
      // A pose of a library at a time that is typed nowhere: arrows go there.
      await t.press("Home", "ArrowDown", "ArrowDown", "Shift+ArrowRight");
      const at = (await t.state()).playhead;
      await search(t, "pose rock");
      await t.until((s) => s.clip?.keys.some((k) => k.frame === at) ?? false, "a key with a pose");
      // One joint of it.
      await search(t, "MFJ3");
      const joint = (await t.state()).clip?.robot.joints.indexOf("MFJ3") ?? -1;
      await t.until((s) => s.joint === joint, "the joint's field has the focus");
      const value = async () => (await t.state()).clip?.keys.find((k) => k.frame === at)?.q?.[joint];
      const first = await value();
      await t.press("ArrowDown", "ArrowDown");
      await t.until(
        (s) => Math.abs((s.clip?.keys.find((k) => k.frame === at)?.q?.[joint] ?? 0) - (first ?? 0)) > 0.03,
        "two degrees less",
      );
      await t.press("Escape");
      // A fingertip is chosen, pinned, and released.
      await t.press("g");
      await t.until((s) => s.site !== undefined, "a fingertip is chosen");
      await t.press("Shift+G");
      await t.until((s) => s.pins.length === 1, "pinned");
      await t.press("Shift+G");
      await t.until((s) => s.pins.length === 0, "released");
      // In the graph: the key's values.
      await t.press("v");
      await t.byId("graph").waitFor();
      await t.press("Control+Space");
      await t.until((s) => s.points.length > 0, "the key's points are chosen");
      const raised = (await t.state()).rev ?? 0;
      await t.press("Alt+ArrowUp");
      await t.until((s) => (s.rev ?? 0) > raised, "raised by a degree");
      await t.press("v");
      await t.byId("timeline").waitFor();
      // An offset at another time.
      await t.painted();
      const { view } = await t.state();
      await t.press("End");
      const end = await t.until((s) => s.playhead === (s.clip?.length ?? 0) - 1, "at the end");
      assert.deepEqual(end.view, view, "the whole clip was in sight, and is");
      await t.press("Shift+ArrowLeft", "j");
      await t.until((s) => s.shaping, "moving a joint makes an offset");
      await search(t, "THJ4");
      await t.press("ArrowUp");
      await t.until((s) => s.clip?.offsets?.length === 1, "an offset");
      await t.press("Escape");
      await t.press("j");
      await t.picture(`by-keys-${width}`);
      // Saved under a name, and exported into the folder.
      await t.page.keyboard.press("Control+Shift+s");
      await t.page.getByLabel("File", { exact: true }).waitFor();
      await t.page.keyboard.press("Control+a");
      await t.page.keyboard.type(`keys-${width}.clip.json`);
      await t.page.keyboard.press("Enter");
      await t.until((s) => s.dirty === false, "saved");
      await t.page.keyboard.press("Control+e");
      await t.byId("format-mp4").waitFor();
      // The formats are one stop; arrows choose among them.
      for (let n = 0; !(await t.byId("format-csv").isChecked()); n++) {
        assert.ok(n < 40, "the table of the motion is reached by arrows");
        await t.page.keyboard.press("ArrowDown");
      }
      const table = studio.file(await t.byId("export-path").inputValue());
      rmSync(table, { force: true });
      await tabTo(t, /Save to folder/);
      await t.page.keyboard.press("Enter");
      await t.byId("export-said").filter({ hasText: ".csv" }).waitFor();
      await t.page.keyboard.press("Escape");
      assert.ok(existsSync(studio.file(`keys-${width}.clip.json`)));
      assert.ok(existsSync(table), table);
      assert.deepEqual(await t.page.getByRole("alert").allInnerTexts(), [], "nothing was refused");
      assert.deepEqual([t.errors, t.foreign], [[], []]);
      await t.context.close();
    });
  }
});
