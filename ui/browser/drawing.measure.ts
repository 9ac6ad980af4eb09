// How fast the page draws: printed, not asserted, because it is the machine's figure as much as
// the page's. `npm run browser -- measure`

import assert from "node:assert/strict";
import { after, before, describe, Studio, type Tab, tab, test } from "./harness";

const FRAMES = 2000;

describe("measure", () => {
  let studio: Studio;
  let t: Tab;
  before(async () => {
    studio = await Studio.start();
    t = await tab(studio, { width: 1600, height: 1400 });
  });
  after(() => studio.end());

  for (const [every, partial, what] of [
    [10, false, "a key at every tenth frame"],
    [1, false, "a key at every frame"],
    [1, true, "a key at every frame, of one joint in four"],
  ] as const) {
    test(`a key is dragged: all rows of the hand, ${FRAMES} frames, ${what}`, async () => {
      const facts = (await studio.api("GET", "/api/robot/shadow_hand")).json() as {
        table: { joints: { name: string }[]; rest: number[] };
      };
      const keys = Array.from({ length: FRAMES / every }, (_, i) => ({
        frame: i * every,
        q: facts.table.rest.map((v, j) =>
          partial && i > 0 && (i + j) % 4 > 0
            ? null
            : Number((v + 0.1 * Math.sin(0.05 * i * every + j)).toFixed(6)),
        ),
        ...(every > 2 ? { hold: 3 } : {}),
      }));
      const text = JSON.stringify({
        format: "robert-clip/1",
        name: "long",
        robot: { id: "shadow_hand", joints: facts.table.joints.map((j) => j.name) },
        fps: 20,
        length: FRAMES,
        keys,
      });
      assert.equal((await studio.api("POST", "/api/new", { text })).status, 200);
      await t.until((s) => s.clip?.keys.length === keys.length && s.page === "editor", "open");
      await t.page.evaluate(() => document.documentElement.style.setProperty("--sheet", "62vh"));
      if ((await t.state()).settings.auto) await t.press("Shift+R");
      await t.until((s) => !s.settings.auto, "no rollout beside it");
      await t.painted();
      const rows = await t.page.locator("[role=grid] [role=row]").count();
      const middle = Math.round(FRAMES / 2 / every) * every;
      await t.clickKey(middle);
      const p = await t.at(middle);
      for (const [size, how] of [
        [1, "one key"],
        [keys.length, "all keys"],
      ] as const) {
        if (size > 1) await t.press("Control+a");
        await t.page.mouse.move(p.x, p.y);
        await t.page.mouse.down();
        await t.page.mouse.move(p.x + 20, p.y, { steps: 3 });
        const times = await t.page.evaluate(
          async ([x, y]) => {
            const canvas = document.querySelector(".sheet canvas") as HTMLCanvasElement;
            const { redraw } = window.__studio;
            const all: number[] = [];
            for (let i = 0; i < 60; i++) {
              await new Promise((r) => requestAnimationFrame(() => setTimeout(r)));
              const began = performance.now();
              canvas.dispatchEvent(
                new PointerEvent("pointermove", {
                  clientX: (x as number) + 20 + (i % 7),
                  clientY: y as number,
                  pointerId: 1,
                  bubbles: true,
                }),
              );
              redraw();
              all.push(performance.now() - began);
            }
            return all.slice(5);
          },
          [p.x, p.y],
        );
        await t.page.keyboard.press("Escape");
        await t.page.mouse.up();
        times.sort((a, b) => a - b);
        const at = (q: number): string => (times[Math.floor(q * (times.length - 1))] ?? 0).toFixed(1);
        console.log(
          `${rows} rows x ${FRAMES} frames, ${keys.length} keys, ${how} dragged: handler, redraw and readback ${at(0.5)} ms, 95 of 100 within ${at(0.95)} ms`,
        );
        assert.equal(times.length, 55);
      }
    });
  }
});
