// Dense motion below, sparse edits above; clips as blocks of a sequence; curves bent by their handles.

import assert from "node:assert/strict";
import { commandedAt } from "../src/graph/curve";
import { blocksOf } from "../src/layers";
import type { Clip } from "../src/protocol";
import { ARM, describe, eventually, onTheArm, type Studio, type Tab, test } from "./harness";

const JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"];

/** A motion with a value at every frame, as a recording is. */
function dense(frames: number): string {
  const rows = Array.from({ length: frames }, (_, t) =>
    [t, ...[-1.57, -1.4, 1.4, -1.5, -1.5].map((q, j) => (q + 0.2 * Math.sin(t * 0.05 + j)).toFixed(6))].join(
      ",",
    ),
  );
  return [`frame,${JOINTS.join(",")}`, ...rows].join("\n");
}

describe("layers", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });

  const clipNow = async (): Promise<Clip> => {
    const { clip } = await t.state();
    assert.ok(clip);
    return clip;
  };
  /** What the clip commands, by the program itself: a row for each frame. */
  const commanded = async (): Promise<number[][]> => {
    const csv = (await studio.api("GET", "/api/export?format=csv")).bytes.toString();
    const [head = "", ...rows] = csv.trim().split("\n");
    const at = JOINTS.map((name) => head.split(",").indexOf(name));
    return rows.map((r) => at.map((i) => (r.split(",")[i] === "" ? Number.NaN : Number(r.split(",")[i]))));
  };
  /** A file from the person's computer is opened. */
  const open = async (name: string, text: string): Promise<void> => {
    await t.blur();
    // A picker that opens before Playwright has taken it over is the browser's own: ask early.
    const chooser = t.page.waitForEvent("filechooser");
    await t.painted();
    await t.press("Control+Shift+o");
    await (await chooser).setFiles({ name, mimeType: "text/csv", buffer: Buffer.from(text) });
    const stem = name.split(".")[0];
    await t.until((s) => s.clip?.name === stem, `${name} is open`);
    await t.rolledOut();
  };
  const drag = async (
    from: { x: number; y: number },
    by: { x: number; y: number },
    during?: () => Promise<unknown>,
  ): Promise<void> => {
    await t.page.mouse.move(from.x, from.y);
    await t.page.mouse.down();
    for (let i = 1; i <= 6; i++) await t.page.mouse.move(from.x + (by.x * i) / 6, from.y + (by.y * i) / 6);
    await during?.();
    await t.page.mouse.up();
  };
  /** The elbow is turned by its slider, which stays 20 pixels further to the right. */
  const turnElbow = async (during?: () => Promise<unknown>): Promise<void> => {
    const box = await t.page.locator(".joint .slider").nth(2).boundingBox();
    assert.ok(box);
    await drag({ x: box.x + box.width / 2, y: box.y + box.height / 2 }, { x: 8, y: 0 }, during);
  };

  test("one drag shapes a recording over half a second on both sides; the rest stays as it was", async () => {
    await open("recorded.csv", dense(120));
    const before = await t.state();
    assert.equal(before.clip?.keys.length, 120, "a key at every frame");
    assert.ok(before.shaping, "dense motion is shaped from above");
    const was = await commanded();
    await t.goTo(60);
    await turnElbow(() => t.until((s) => s.demand !== undefined, "the rollout follows the hand"));
    const s = await t.until((x) => (x.clip?.offsets?.length ?? 0) === 1, "an offset");
    const own = s.clip?.offsets?.[0];
    assert.deepEqual([own?.frame, own?.in, own?.out, Object.keys(own?.add ?? {})], [60, 10, 10, ["elbow"]]);
    const added = own?.add.elbow ?? 0;
    assert.ok(Math.abs(added) > 0.05, `${added}`);
    assert.equal(s.history?.len, (before.history?.len ?? 0) + 1, "one entry in the history");
    assert.deepEqual(s.clip?.keys, before.clip?.keys, "the recording is untouched");
    const is = await commanded();
    for (let f = 0; f < 120; f++) {
      const by = (is[f]?.[2] ?? 0) - (was[f]?.[2] ?? 0);
      if (Math.abs(f - 60) >= 10) assert.ok(Math.abs(by) < 1.5e-6, `frame ${f} moved by ${by}`);
      assert.ok(Math.abs((commandedAt(s.clip as Clip, 2, f) ?? 9) - (is[f]?.[2] ?? 0)) < 2e-6, `drawn ${f}`);
    }
    assert.ok(Math.abs((is[60]?.[2] ?? 0) - (was[60]?.[2] ?? 0) - added) < 2e-6, "in full at its frame");
    await t.rolledOut();
    await t.painted();
    await t.picture("offset");
    // The same drag again changes the same offset.
    await turnElbow();
    await t.until((x) => Math.abs((x.clip?.offsets?.[0]?.add.elbow ?? 0) - added) > 0.05, "more of it");
    assert.equal((await clipNow()).offsets?.length, 1);
  });

  test("an offset is moved, widened and removed on its row, by hand and by keys, and baked", async () => {
    await open("again.csv", dense(120));
    await t.goTo(60);
    await turnElbow();
    await t.until((s) => s.clip?.offsets?.length === 1, "an offset");
    await t.painted();
    const from = await t.at(60, "Offsets");
    const to = await t.at(75, "Offsets");
    await drag(from, { x: to.x - from.x, y: 0 });
    await t.until((s) => s.clip?.offsets?.[0]?.frame === 75, "moved to 75");
    assert.equal((await t.state()).chosenOffset, 75);
    await t.press("Shift+j");
    await t.until((s) => s.clip?.offsets?.[0]?.in === 12 && s.clip.offsets[0].out === 12, "wider");
    await t.press("Alt+j", "Alt+j");
    await t.until((s) => s.clip?.offsets?.[0]?.in === 8, "narrower");
    await t.press("x");
    await t.until((s) => !s.clip?.offsets?.length, "removed");
    await t.press("Control+z");
    await t.until((s) => s.clip?.offsets?.length === 1, "back");
    const was = await commanded();
    const p = await t.at(75, "Offsets");
    await t.page.mouse.click(p.x, p.y, { button: "right" });
    await t.page.getByRole("menuitem", { name: /Bake/ }).click();
    await t.until((s) => !s.clip?.offsets?.length, "baked");
    assert.deepEqual(await commanded(), was, "the same motion, to the last digit");
    await t.press("j");
    await t.until((s) => !s.shaping, "keys again");
  });

  test("in the graph the offset's ring is raised by hand; one edit", async () => {
    await open("ring.csv", dense(100));
    await t.goTo(50);
    await turnElbow();
    await t.until((s) => s.clip?.offsets?.length === 1, "an offset");
    await t.page.getByRole("tab", { name: "Graph" }).click();
    await t.byId("graph").waitFor();
    await t.byId("curve-2").click();
    await t.rolledOut();
    await t.painted();
    const box = await t.box("graph");
    const ring = (await t.page.evaluate(() => window.__studio.graphHandles())).find(
      (h) => h.kind === "offset",
    );
    assert.ok(ring);
    await t.picture("graph-offset");
    const before = (await clipNow()).offsets?.[0]?.add.elbow ?? 0;
    const edits = (await t.state()).history?.len ?? 0;
    await drag({ x: box.x + ring.x, y: box.y + ring.y }, { x: 0, y: -18 });
    const s = await t.until((x) => (x.clip?.offsets?.[0]?.add.elbow ?? before) > before + 0.01, "raised");
    assert.equal(s.history?.len, edits + 1);
    await t.page.getByRole("tab", { name: "Timeline" }).click();
  });

  test("a curve is bent by the handle of its point; Alt bends one side, Esc gives up", async () => {
    const clip = JSON.parse(ARM);
    await t.afresh(JSON.stringify({ ...clip, fill: "cubic" }));
    await t.rolledOut();
    await t.page.getByRole("tab", { name: "Graph" }).click();
    await t.byId("graph").waitFor();
    await t.byId("curve-2").click();
    await t.until((s) => s.curves.join() === "2", "one curve");
    const box = await t.box("graph");
    const y = await t.page.evaluate(() => window.__studio.graphY(2, 1.4));
    const x = await t.page.evaluate(() => window.__studio.frameToX(30));
    await t.page.mouse.click(box.x + x, box.y + y);
    await t.until((s) => s.points.join() === "30:2", "the point is chosen");
    await t.painted();
    /** Where a handle stands, and how far it is from there to so many pixels from its point. */
    const handle = async (side: "in" | "out", x = 0, y = 0) => {
      const all = await t.page.evaluate(() => window.__studio.graphHandles());
      const own = all.find((h) => h.kind === "tangent" && h.side === side);
      assert.ok(own, `a handle for ${side}`);
      assert.ok(own.kind === "tangent");
      return { x: box.x + own.x, y: box.y + own.y, by: { x: own.px + x - own.x, y: own.py + y - own.y } };
    };
    const elbow = (c: Clip | undefined) => c?.keys.find((k) => k.frame === 30)?.tangents?.elbow;
    const rev = (await t.state()).rev;
    const rising = await handle("out", 40, -30);
    await drag(rising, rising.by, async () => {
      await t.until((s) => s.demand !== undefined, "the rollout follows the handle");
      await t.picture("graph-handle");
    });
    const bent = await t.until((s) => typeof elbow(s.clip) === "number", "one slope for both sides");
    assert.ok((elbow(bent.clip) as number) > 0.05);
    assert.equal(bent.rev, (rev ?? 0) + 1, "one edit");
    await t.painted();
    await t.page.keyboard.down("Alt");
    const falling = await handle("in", -40, -30);
    await drag(falling, falling.by);
    await t.page.keyboard.up("Alt");
    const corner = await t.until((s) => typeof elbow(s.clip) === "object", "a corner");
    const slopes = elbow(corner.clip) as { in: number; out: number };
    assert.ok(slopes.in < 0 && Math.abs(slopes.out - (elbow(bent.clip) as number)) < 1e-5);
    await t.painted();
    const out = await handle("out");
    await t.page.mouse.move(out.x, out.y);
    await t.page.mouse.down();
    await t.page.mouse.move(out.x, out.y + 40, { steps: 4 });
    await t.page.keyboard.press("Escape");
    await t.page.mouse.up();
    await t.painted();
    assert.deepEqual(elbow(await clipNow()), slopes, "given up");
    await t.page.getByRole("tab", { name: "Timeline" }).click();
  });

  test("another clip is inserted as a block with a blend; blocks change places, repeat and go", async () => {
    studio.file("nod.clip.json", JSON.stringify({ ...JSON.parse(ARM), name: "nod", length: 61 }));
    await t.afresh();
    await t.goTo(79);
    await t.press("Shift+i");
    await t.byId("at-nod.clip.json").click();
    await t.until(
      (s) => s.clip?.length === 80 + 10 + 61,
      "inserted after the last frame with 10 frames between",
    );
    const [block] = blocksOf(await clipNow());
    assert.deepEqual([block?.name, block?.frame, block?.to], ["nod", 90, 151]);
    assert.equal((await clipNow()).keys.find((k) => k.frame === 79)?.fill, "cubic", "a curve leads to it");
    await t.goTo(95);
    await t.press("Alt+d");
    await t.until((s) => blocksOf(s.clip as Clip).length === 2, "once more");
    const two = blocksOf(await clipNow());
    assert.deepEqual(
      two.map((b) => b.frame),
      [90, 161],
    );
    await studio.api("POST", "/api/ops", {
      ops: [{ op: "markers.set", args: { frame: 161, name: "again" } }],
    });
    await t.until((s) => blocksOf(s.clip as Clip)[1]?.name === "again", "named");
    await t.rolledOut();
    await t.press("Shift+f");
    await t.painted();
    await t.picture("blocks");
    // By hand: the first is carried behind the second.
    const sheet = await t.box("timeline");
    const px = await t.page.evaluate(() => [100, 215].map((f) => window.__studio.frameToX(f)));
    const y = sheet.y + 22 + 9;
    await drag({ x: sheet.x + (px[0] ?? 0), y }, { x: (px[1] ?? 0) - (px[0] ?? 0), y: 0 });
    await t.until((s) => blocksOf(s.clip as Clip)[0]?.name === "again", "changed places");
    // And back by a key.
    await t.goTo(170);
    await t.press("Alt+,");
    await t.until((s) => blocksOf(s.clip as Clip)[0]?.name === "nod", "back");
    const at = await t.page.evaluate(() => window.__studio.frameToX(200));
    await t.page.mouse.click(sheet.x + at, y, { button: "right" });
    await t.page.getByRole("menuitem", { name: /Delete the block/ }).click();
    await t.until(
      (s) => blocksOf(s.clip as Clip).length === 1 && s.clip?.length === 151,
      "gone with its frames",
    );
  });

  test("a key may say where the end effector shall be: it has a row of its own", async () => {
    await t.afresh();
    await t.rolledOut();
    await t.goTo(40);
    await t.press("g");
    const { site } = await t.until((s) => s.site !== undefined, "an end effector");
    await t.press("Shift+k");
    const s = await t.until((x) => x.clip?.keys.some((k) => k.frame === 40) ?? false, "a key");
    const key = s.clip?.keys.find((k) => k.frame === 40);
    assert.equal(key?.reach?.[0]?.site, site);
    assert.ok(!key?.q && !key?.pose, "no joint values");
    await eventually(
      () =>
        t.page.evaluate(() => window.__studio.rowToY("Attachment") ?? window.__studio.rowToY("End effector")),
      "a row for it",
    );
    const done = await t.rolledOut();
    assert.equal(done.rollout?.phase, "done");
    await t.painted();
    await t.picture("point-row");
    // A joint that is moved there makes joint values of it: the goal would overrule them.
    const before = done.q[40] ?? [];
    await t.page.locator("#joint-0").focus();
    await t.page.keyboard.press("ArrowRight");
    const baked = await t.until(
      (x) => x.clip?.keys.some((k) => k.frame === 40 && k.q) ?? false,
      "joint values",
    );
    const values = baked.clip?.keys.find((k) => k.frame === 40);
    assert.equal(values?.reach, undefined);
    assert.ok(values?.q?.slice(1).every((v, j) => Math.abs((v ?? 9) - (before[j + 1] ?? 0)) < 0.05));
  });

  /** A key at frame 40 that says where the end effector is. */
  const keyed = async (): Promise<void> => {
    await t.afresh();
    await t.rolledOut();
    await t.goTo(40);
    await t.press("g");
    await t.until((s) => s.site !== undefined, "an end effector");
    await t.press("Shift+k");
    await t.until((s) => s.clip?.keys.some((k) => k.frame === 40) ?? false, "a key");
    await t.press("Escape");
  };

  test("a pose that waits becomes the values of a key that said where the end effector is", async () => {
    await keyed();
    await t.page.getByRole("button", { name: "Auto-key" }).click();
    await t.goTo(50);
    const field = t.byId("joint-0").locator("input[type=text]");
    await field.fill("-60");
    await field.press("Enter");
    const floating = (await t.until((s) => s.floating !== undefined, "a pose that waits")).floating ?? [];
    await t.goTo(40);
    await t.page.getByRole("button", { name: "Make it a key (K)" }).click();
    const s = await t.until((x) => x.clip?.keys.some((k) => k.frame === 40 && k.q) ?? false, "joint values");
    const key = s.clip?.keys.find((k) => k.frame === 40);
    assert.equal(key?.reach, undefined);
    assert.ok(key?.q?.every((v, j) => Math.abs((v ?? 9) - (floating[j] ?? 0)) < 1e-5));
    await t.page.getByRole("button", { name: "Auto-key" }).click();
  });

  test("a key keeps its end-effector goal when the fields of its joints are emptied", async () => {
    await keyed();
    await t.press("Enter");
    const fields = t.page.locator(".typed input");
    await fields.first().waitFor();
    for (let j = 0; j < (await fields.count()); j++) await fields.nth(j).fill("");
    await fields.first().press("Enter");
    await fields.first().waitFor({ state: "detached" });
    const key = (await t.state()).clip?.keys.find((k) => k.frame === 40);
    assert.ok(key?.reach?.length && !key.q, JSON.stringify(key));
    assert.deepEqual(await t.page.getByRole("alert").allInnerTexts(), [], "nothing was refused");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
