// How soon a page that was never loaded shows an example with its take: printed, not asserted.
// `npm run measure -- load`

import { describe, Studio, type Tab, tab, test, webgl } from "./harness";

const EXAMPLES = ["ur5e/hang", "shadow_hand/fire", "pointmass/star"];
const TURNS = 3;

/** Milliseconds since the page was asked for. */
const since = (t: Tab): Promise<number> => t.page.evaluate(() => performance.now());

const still = async (studio: Studio): Promise<{ tab: Tab; close: () => Promise<void> }> => {
  const made = await tab(studio);
  return { tab: made, close: () => made.context.close() };
};

describe("measure", () => {
  for (const how of ["still pictures", "the 3D view, drawn in software"] as const) {
    test(`a first load to an example with its take, ${how}`, async () => {
      for (const id of EXAMPLES) {
        const [gallery, editor, motion, take]: [number[], number[], number[], number[]] = [[], [], [], []];
        for (let turn = 0; turn < TURNS; turn++) {
          const studio = await Studio.start();
          const { tab: t, close } = how === "still pictures" ? await still(studio) : await webgl(studio);
          const example = t.byId(`example-${id}`);
          await example.waitFor();
          gallery.push(await since(t));
          await example.click();
          await t.until((s) => s.page === "editor", "open");
          editor.push(await since(t));
          // Automatic shows the motion of the first policy at once, and compares the others afterwards.
          await t.until((s) => !!s.rollout?.frames && s.rollout.cached_to === s.rollout.frames, "performed");
          motion.push(await since(t));
          await t.rolledOut();
          await t.page.locator(".curves canvas").first().waitFor();
          await t.painted();
          take.push(await since(t));
          await close();
          await studio.end();
        }
        const middle = (of: number[]) => Math.round([...of].sort((a, b) => a - b)[TURNS >> 1] ?? 0);
        console.log(
          `${id}: gallery after ${middle(gallery)} ms, editor ${middle(editor)}, its whole motion ${middle(motion)}, ` +
            `all policies compared and the take kept ${middle(take)}`,
        );
      }
    });
  }
});
