// Small pictures: of takes, and of the files opened last.

import assert from "node:assert/strict";
import { ARM, describe, onTheArm, type Studio, type Tab, test } from "./harness";

describe("thumbnails", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  /** The pixels of a picture on the page, once it is there: its size, and a hash of it. */
  const pixels = async (selector: string): Promise<{ width: number; spread: number; hash: string }> => {
    const picture = t.page.locator(selector);
    await picture.scrollIntoViewIfNeeded();
    return picture.evaluate(async (img: HTMLImageElement) => {
      if (!img.complete) await new Promise((done) => img.addEventListener("load", done, { once: true }));
      await img.decode();
      const { naturalWidth: w, naturalHeight: h } = img;
      const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h });
      const ctx = canvas.getContext("2d") as CanvasRenderingContext2D;
      ctx.drawImage(img, 0, 0);
      const { data } = ctx.getImageData(0, 0, w, h);
      const grey = Array.from({ length: w * h }, (_, i) => data[4 * i] ?? 0);
      const bytes = await crypto.subtle.digest("SHA-1", new Uint8Array(data));
      return {
        width: w,
        spread: Math.max(...grey) - Math.min(...grey),
        hash: [...new Uint8Array(bytes)].join(),
      };
    });
  };

  test("each take has a picture of its own motion", async () => {
    await t.afresh();
    await t.rolledOut();
    await t.byId("policy").selectOption("zero");
    await t.until(
      (s) => s.takes.some((k) => k.policy === "zero") && s.rollout?.phase === "done",
      "two takes",
    );
    const { takes } = await t.state();
    const [zero, torque] = ["zero", "computed-torque"].map((p) => takes.find((k) => k.policy === p)?.id);
    await t.panel("takes");
    const a = await pixels(`[data-testid="take-${zero}"] img.thumb`);
    const b = await pixels(`[data-testid="take-${torque}"] img.thumb`);
    for (const p of [a, b]) assert.ok(p.width >= 32 && p.spread > 60, JSON.stringify(p));
    assert.notEqual(a.hash, b.hash, "other motions, other pictures");
    await t.picture("thumbnails-takes");
    await t.byId("policy").selectOption("computed-torque");
    await t.rolledOut();
  });

  test("files opened last have pictures; one that is gone has a sign", async () => {
    await t.afresh();
    await studio.api("POST", "/api/save", { path: "seen.clip.json" });
    await t.until((s) => s.dirty === false, "saved");
    const folded = { ...JSON.parse(ARM), name: "folded" };
    folded.keys[1].q = [0.5, -0.6, 2.4, -1.5, -0.5];
    studio.file("folded.clip.json", JSON.stringify(folded));
    await studio.api("POST", "/api/open", { path: "folded.clip.json" });
    await t.until((s) => s.clip?.name === "folded", "another file");
    await t.turnTo("gallery");
    const own = t.byId("own-files");
    for (const name of ["folded", "arm"]) await own.getByRole("button", { name, exact: true }).waitFor();
    const a = await pixels('[data-testid="own-files"] button[aria-label="folded"] img.thumb');
    const b = await pixels('[data-testid="own-files"] button[aria-label="arm"] img.thumb');
    for (const p of [a, b]) assert.ok(p.width >= 32 && p.spread > 60, JSON.stringify(p));
    assert.notEqual(a.hash, b.hash, "each its own pose");
    await t.picture("thumbnails-files");
    // A file that is no clip any more has no picture, and no broken one.
    studio.file("seen.clip.json", "{}");
    await t.turnTo("editor");
    await t.page.reload();
    await t.until((s) => s.link === "open", "again");
    await t.turnTo("gallery");
    await own.locator('button[aria-label="arm"] span.thumb').waitFor();
    assert.equal(await own.locator('button[aria-label="arm"] img').count(), 0);
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
