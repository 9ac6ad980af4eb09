// What was exported, as whoever gets it sees it: the page that plays a take, the film.

import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import { ARM, describe, eventually, inView, type Studio, type Tab, test } from "./harness";
import { meshesIn } from "./scene";

/** The arm rests: a goal at first, the next one ahead, and none any more. Only words could change. */
const REST = [-1.57, -1.57, 1.57, -1.57, -1.57];
const QUIET = JSON.stringify({
  ...JSON.parse(ARM),
  name: "at rest",
  length: 24,
  fill: "mask",
  keys: [
    { frame: 0, q: REST, hold: 4 },
    { frame: 12, q: REST },
  ],
});

describe("what was exported", () => {
  let studio: Studio;
  let t: Tab;

  inView(
    (with_, page) => {
      [studio, t] = [with_, page];
    },
    { width: 900, height: 640 },
  );
  const file = async (format: string, name: string): Promise<void> => {
    const asked = { format, path: name, size: [320, 200], overlay: "ghost,error,caption" };
    const job = (await studio.api("POST", "/api/exports", asked)).json() as { id: number };
    const done = await studio.ended(job.id);
    assert.equal(done.phase, "done", JSON.stringify(done.log));
  };

  test("the page has the clip's title, both figures, the error, and nothing over its player", async () => {
    // Without torque the arm sinks: a command where the robot is would be hidden in it.
    await t.byId("policy").selectOption("zero");
    await t.until((s) => s.rollout?.policy === "zero" && s.rollout.phase === "done", "it sinks");
    await file("html", "arm.html");
    await t.byId("policy").selectOption("computed-torque");
    const page = await t.context.newPage();
    const asked: string[] = [];
    page.on("request", (r) => {
      if (/^https?:/.test(r.url())) asked.push(r.url());
    });
    await page.goto(pathToFileURL(studio.file("arm.html")).href);
    await page.waitForFunction(() => document.title === "arm");
    const caption = page.getByText(/^zero; mean error [\d.]+°, solid: reached, translucent: commanded$/);
    await caption.waitFor();
    for (const figure of ["/robot", "/command"])
      await eventually(async () => (await meshesIn(page.mainFrame(), figure)) > 4, `${figure} is drawn`);
    const player = page.locator(".mantine-Slider-root").first();
    await player.waitFor();
    const [said, plays] = [await caption.boundingBox(), await player.boundingBox()];
    assert.ok(said && plays && said.y + said.height < plays.y, JSON.stringify([said, plays]));
    assert.deepEqual(asked, [], "it needs no network");
    await page.close();
  });

  test("the legend of a film is the same from the first frame to the last", async () => {
    await t.afresh(QUIET);
    await t.rolledOut();
    await file("apng", "quiet.apng");
    const film = studio.read("quiet.apng").toString("base64");
    const changed = await t.page.evaluate(async (data) => {
      const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
      const decoder = new ImageDecoder({ data: bytes, type: "image/png" });
      await decoder.tracks.ready;
      const frames = decoder.tracks.selectedTrack?.frameCount ?? 0;
      const of = async (frameIndex: number) => {
        const { image } = await decoder.decode({ frameIndex });
        const canvas = new OffscreenCanvas(image.displayWidth, image.displayHeight);
        const ctx = canvas.getContext("2d") as OffscreenCanvasRenderingContext2D;
        ctx.drawImage(image, 0, 0);
        // The legend is at the upper right, over the empty background.
        const half = canvas.width >> 1;
        return ctx.getImageData(half, 0, canvas.width - half, Math.round(canvas.height * 0.3)).data;
      };
      const first = await of(0);
      const counts: number[] = [];
      for (let f = 1; f < frames; f++) {
        const now = await of(f);
        let count = 0;
        for (let i = 0; i < first.length; i += 4) if (Math.abs((first[i] ?? 0) - (now[i] ?? 0)) > 40) count++;
        counts.push(count);
      }
      return counts;
    }, film);
    assert.equal(changed.length, 23, "all frames");
    assert.ok(Math.max(...changed) < 12, `pixels that differ from the first frame: ${changed}`);
  });

  test("a file of an earlier session is replaced only if that is said", async () => {
    await t.press("Control+e");
    await t.byId("format-csv").check();
    const name = await t.byId("export-path").inputValue();
    writeFileSync(studio.file(name), "of an earlier session");
    await t.click("export-folder");
    const question = t.page.getByRole("dialog", { name: `Replace ${name}?` });
    await question.getByRole("button", { name: "Cancel" }).click();
    // Back where the export was chosen.
    assert.ok(await t.byId("format-csv").isChecked());
    assert.equal(await t.byId("export-path").inputValue(), name);
    assert.equal(studio.read(name).toString(), "of an earlier session");
    await t.click("export-folder");
    await t.click("replace");
    await t.byId("export-said").getByText(`${name}`).waitFor();
    assert.match(studio.read(name).toString(), /^frame,/);
    await t.press("Escape");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
