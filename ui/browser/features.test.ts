// One test for each feature without which a first release fails, and the promises that only a
// browser can check. The viewport is made of stills here: no WebGL, the same everything else.

import assert from "node:assert/strict";
import { describe, onTheArm, type Studio, type Tab, tab, test } from "./harness";

describe("features", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  /** The arm as it was, by the named history. */
  const afresh = async (): Promise<void> => {
    await t.afresh();
    await t.press("Shift+F", "Home", "Escape");
    await t.rolledOut();
  };

  test("scrub on the ruler, zoom at the pointer, pan", async () => {
    await afresh();
    const box = await t.box("timeline");
    const [a, b] = [await t.at(10), await t.at(50)];
    await t.page.mouse.move(a.x, box.y + 10);
    await t.page.mouse.down();
    await t.page.mouse.move(b.x, box.y + 10, { steps: 5 });
    assert.equal((await t.state()).playhead, 50, "the playhead follows the mouse");
    await t.page.mouse.up();
    const before = await t.state();
    await t.page.mouse.move(b.x, box.y + 80);
    await t.page.mouse.wheel(0, -400);
    const near = await t.until((s) => s.view.zoom > before.view.zoom * 1.5, "zoomed in");
    const there = await t.at(50);
    assert.ok(Math.abs(there.x - b.x) < 2, "the frame under the pointer stays there");
    await t.page.keyboard.down("Shift");
    await t.page.mouse.wheel(0, 200);
    await t.page.keyboard.up("Shift");
    await t.until((s) => s.view.left > near.view.left, "panned");
    await t.press("Shift+F");
    await t.until((s) => s.view.zoom < near.view.zoom, "the whole clip again");
  });

  test("typed time is a whole frame", async () => {
    await afresh();
    const field = t.byId("frame");
    for (const [text, frame] of [
      ["2:15", 55],
      ["30f", 30],
      ["1.25s", 25],
      ["7", 7],
    ] as const) {
      await field.fill(text);
      await field.press("Enter");
      await t.until((s) => s.playhead === frame, text);
    }
    await field.fill("later");
    await field.press("Enter");
    await t.page.getByText('"later" is not a time').first().waitFor();
  });

  test("box, Ctrl, Shift and all", async () => {
    await afresh();
    await t.clickKey(30);
    assert.deepEqual((await t.state()).selection, [30]);
    await t.clickKey(60, ["Control"]);
    await t.until((s) => s.selection.length === 2, "two by Ctrl");
    await t.clickKey(0);
    await t.clickKey(60, ["Shift"]);
    await t.until((s) => s.selection.length === 3, "a range by Shift");
    await t.press("Escape");
    await t.until((s) => s.selection.length === 0, "none");
    const [a, b] = [await t.at(20), await t.at(70)];
    await t.page.mouse.move(a.x, a.y - 5);
    await t.page.mouse.down();
    await t.page.mouse.move(b.x, b.y + 5, { steps: 4 });
    await t.page.mouse.up();
    await t.until(
      (s) => JSON.stringify([...s.selection].sort((x, y) => x - y)) === "[30,60]",
      "two by the box",
    );
    await t.page.keyboard.press("Control+a");
    await t.until((s) => s.selection.length === 3, "all");
  });

  test("copy, cut, paste, duplicate, Alt-drag", async () => {
    await afresh();
    await t.clickKey(30);
    await t.press("Control+c");
    await t.goTo(45);
    await t.press("Control+v");
    await t.until_keys([0, 30, 45, 60]);
    const [a, b] = ((await t.state()).clip?.keys ?? []).filter((k) => k.frame === 30 || k.frame === 45);
    assert.deepEqual(a?.q, b?.q);
    const clipboard = JSON.parse(await t.page.evaluate(() => navigator.clipboard.readText()));
    assert.equal(clipboard.format, "robert-clip/1", "the clipboard is a clip fragment");
    await t.clickKey(45);
    await t.press("Control+x");
    await t.until_keys([0, 30, 60]);
    await t.clickKey(60);
    await t.press("Control+d");
    await t.until_keys([0, 30, 60, 65]);
    await t.drag(30, 40, { hold: "Alt" });
    await t.until_keys([0, 30, 40, 60, 65]);
  });

  test("move, ripple, insert and delete time", async () => {
    await afresh();
    await t.drag(30, 36);
    await t.until_keys([0, 36, 60]);
    await t.drag(36, 40, { hold: "Shift" });
    await t.until_keys([0, 40, 64]);
    await t.goTo(50);
    await t.press("e");
    await t.page.getByLabel("Frames (negative removes)").fill("5");
    await t.page.keyboard.press("Enter");
    await t.until_keys([0, 40, 69]);
    await t.press("e");
    await t.page.getByLabel("Frames (negative removes)").fill("-5");
    await t.page.keyboard.press("Enter");
    await t.until_keys([0, 40, 64]);
  });

  test("retime about the playhead, by S-drag and by number", async () => {
    await afresh();
    await t.goTo(0);
    await t.page.keyboard.press("Control+a");
    await t.press("s");
    await t.page.getByLabel("Factor on the distance to the playhead").fill("0.5");
    await t.page.keyboard.press("Enter");
    await t.until_keys([0, 15, 30]);
    await t.until((s) => s.selection.length === 3, "they stay selected where they are now");
    await t.press("Escape");
    await t.clickKey(30);
    await t.goTo(0);
    await t.drag(30, 60, { hold: "s" });
    await t.until_keys([0, 15, 60]);
    assert.equal(await t.page.getByRole("dialog").count(), 0, "a drag asks for no number");
  });

  test("mask spans and fills, blind spans and their mend", async () => {
    await afresh();
    await t.goTo(10);
    await t.press("m");
    const masked = await t.until((s) => (s.clip?.masks ?? []).length === 1, "masked");
    assert.deepEqual(masked.clip?.masks?.[0], { from: 1, to: 30 });
    await t.until((s) => (s.findings?.blind ?? []).length > 0, "blind");
    await t.press("u");
    await t.until((s) => (s.clip?.masks ?? []).length === 0, "unmasked");
    await t.until((s) => s.findings?.blind.length === 0, "no blind span");
    // One joint alone: its name is clicked, the menu of the empty frames has it.
    const name = await t.at(10, "shoulder_lift");
    const left = await t.box("timeline");
    await t.page.mouse.click(left.x + 60, name.y);
    await t.page.mouse.click(name.x, name.y, { button: "right" });
    await t.page.getByRole("menuitem", { name: /^Mask shoulder_lift/ }).click();
    const one = await t.until((s) => (s.clip?.masks ?? []).length === 1, "one joint masked");
    assert.deepEqual(one.clip?.masks?.[0], { from: 1, to: 30, joints: ["shoulder_lift"] });
    await t.press("Control+z");
    await t.until((s) => (s.clip?.masks ?? []).length === 0, "as before");
    for (const fill of ["mask", "cubic", "hold", "linear"]) {
      const p = await t.at(30);
      await t.page.mouse.click(p.x, p.y, { button: "right" });
      await t.page.getByRole("menuitem").first().waitFor();
      const item = {
        mask: "Leave to the policy until the next key",
        linear: "Straight line to the next key",
        cubic: "Smooth curve to the next key",
        hold: "",
      }[fill];
      if (item) await t.page.getByRole("menuitem", { name: item }).click();
      else {
        await t.page.keyboard.press("Escape");
        await t.clickKey(30);
        await t.page.keyboard.press("Control+k");
        await t.page.getByLabel("Command", { exact: true }).fill("interval hold");
        await t.page.keyboard.press("Enter");
      }
      await t.until((s) => (s.clip?.keys.find((k) => k.frame === 30)?.fill ?? s.clip?.fill) === fill, fill);
    }
    await studio.api("POST", "/api/ops", { ops: [{ op: "fill.set", args: { frames: [0], fill: "mask" } }] });
    await t.until((s) => (s.findings?.blind ?? []).length === 1, "a blind span");
    const mend = t.byId("problems").locator(".mends button").first();
    await mend.click();
    await t.until((s) => s.findings?.blind.length === 0, "mended by one click");
  });

  test("look-ahead, pre-roll and blind shading are on the timeline", async () => {
    await afresh();
    await t.goTo(30);
    /** Mean colour of a piece of the canvas, 8 frames wide, below the rows. */
    const colour = (frame: number): Promise<number[]> =>
      t.page.evaluate((f) => {
        const canvas = document.querySelector(".sheet canvas") as HTMLCanvasElement;
        const hook = window.__studio;
        hook.redraw();
        const k = devicePixelRatio;
        const x = hook.frameToX(f) * k;
        const data =
          canvas
            .getContext("2d")
            ?.getImageData(x, ((hook.rowToY("wrist_2") ?? 0) + 14) * k, hook.frameToX(f + 8) * k - x, 16 * k)
            .data ?? [];
        const sum = [0, 0, 0];
        data.forEach((v, i) => {
          if (i % 4 < 3) sum[i % 4] = (sum[i % 4] ?? 0) + v;
        });
        return sum.map((v) => v / (data.length / 4));
      }, frame);
    const far = (a: number[], b: number[]): number => Math.max(...a.map((v, i) => Math.abs(v - (b[i] ?? 0))));
    const plain = await colour(65);
    assert.ok(far(await colour(66), plain) < 0.5, "the same ground");
    assert.ok(far(await colour(36), plain) > 4, "20 frames from the playhead are marked");
    assert.ok(far(await colour(-15), plain) > 1, "the past that the policy is told is hatched");
    await studio.api("POST", "/api/ops", { ops: [{ op: "fill.set", args: { frames: [30], fill: "mask" } }] });
    await t.until((s) => (s.findings?.blind ?? []).length === 1, "a blind span");
    await t.goTo(70);
    assert.ok(far(await colour(31), await colour(12)) > 2, "where the policy sees no goal");
  });

  test("joint sliders, typed values, limits, auto-key off", async () => {
    await afresh();
    await t.goTo(30);
    const joint = t.byId("joint-2");
    const number = joint.locator("input[type=text]");
    await number.fill("60");
    await number.press("Enter");
    await t.until(
      (s) => Math.abs((s.clip?.keys.find((k) => k.frame === 30)?.q?.[2] ?? 0) - Math.PI / 3) < 1e-3,
      "60 degrees",
    );
    const slider = joint.locator("input[type=range]");
    await slider.focus();
    await t.page.keyboard.press("ArrowRight");
    await t.until(
      (s) => (s.clip?.keys.find((k) => k.frame === 30)?.q?.[2] ?? 0) > Math.PI / 3,
      "one step of the slider",
    );
    await number.fill("9999");
    await number.press("Enter");
    await t.page.getByText("elbow goes from").first().waitFor();
    // Off a key a moved joint makes one; with auto-key off it floats until somebody says so.
    await t.goTo(45);
    await t.byId("joint-0").locator("input[type=text]").fill("-80");
    await t.byId("joint-0").locator("input[type=text]").press("Enter");
    await t.until_keys([0, 30, 45, 60]);
    await t.page.getByRole("button", { name: "Auto-key" }).click();
    await t.goTo(50);
    await t.byId("joint-0").locator("input[type=text]").fill("-70");
    await t.byId("joint-0").locator("input[type=text]").press("Enter");
    await t.page.getByText("This pose is not a key yet").waitFor();
    assert.deepEqual(await t.keys(), [0, 30, 45, 60]);
    await t.page.getByRole("button", { name: "Make it a key (K)" }).click();
    await t.until_keys([0, 30, 45, 50, 60]);
    await t.page.getByRole("button", { name: "Auto-key" }).click();
  });

  test("what is not a number moves no joint, and is named", async () => {
    await afresh();
    await t.goTo(30);
    const number = t.byId("joint-2").locator("input[type=text]");
    const shown = await number.inputValue();
    for (const text of ["banana", "NaN", "", " ", "2+", "1e999", "deg"]) {
      await number.fill(text);
      await number.press("Enter");
      await t.page.getByText(`"${text}" is not a number of degrees`).last().waitFor();
      assert.equal(await number.inputValue(), shown, `the field shows the joint again after "${text}"`);
    }
    assert.equal((await t.state()).rev, 0, "nothing was edited");
    await number.fill("1 rad");
    await number.press("Enter");
    await t.until(
      (s) => Math.abs((s.clip?.keys.find((k) => k.frame === 30)?.q?.[2] ?? 0) - 1) < 1e-3,
      "a unit may stand behind it",
    );
    await t.clickKey(30);
    await t.press("h");
    await t.page.getByLabel("Frames, or a time such as 0.5s").fill("0.5s");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.clip?.keys.find((k) => k.frame === 30)?.hold === 10, "held for half a second");
  });

  test("undo and redo, one entry a drag, history by name", async () => {
    await afresh();
    await t.drag(30, 36, { steps: 12 });
    await t.until_keys([0, 36, 60]);
    assert.equal((await t.state()).history?.len, 1, "one drag is one edit");
    await t.clickKey(36);
    await t.press("Delete");
    await t.until_keys([0, 60]);
    await t.press("Control+z", "Control+z");
    await t.until_keys([0, 30, 60]);
    await t.press("Control+Shift+z");
    await t.until_keys([0, 36, 60]);
    await t.page.getByRole("button", { name: "History" }).click();
    await t.byId("history").getByRole("button", { name: "The clip as it was opened" }).click();
    await t.until((s) => s.history?.done === 0, "back to the start");
    await t.until_keys([0, 30, 60]);
    await t.page.keyboard.press("Escape");
  });

  test("shortcut sheet and palette", async () => {
    await afresh();
    await t.press("?");
    await t.page.getByRole("dialog", { name: "Shortcuts" }).waitFor();
    await t.picture("shortcuts");
    await t.page.keyboard.press("Escape");
    await t.press("Control+k");
    await t.page.getByLabel("Command", { exact: true }).fill("to the end");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.playhead === 79, "the command ran");
  });

  test("play, loop, in and out, step, speed", async () => {
    await afresh();
    await t.press("Space");
    await t.until((s) => s.playing && s.playhead > 3, "playing");
    await t.press("Space");
    const rest = (await t.until((s) => !s.playing, "paused")).playhead;
    await t.press("ArrowRight");
    await t.until((s) => s.playhead === rest + 1, "a frame on");
    await t.press("Shift+ArrowLeft");
    await t.until((s) => s.playhead === Math.max(0, rest - 9), "ten back");
    await t.goTo(20);
    await t.press("[");
    await t.goTo(26);
    await t.press("]");
    await t.until((s) => s.range?.from === 20 && s.range.to === 27, "a loop");
    await t.press("-", "Space");
    const seen: number[] = [];
    await t.until((s) => {
      seen.push(s.playhead);
      return new Set(seen).size > 2 && seen.some((f, i) => i > 0 && f < (seen[i - 1] ?? 0));
    }, "going round in the loop");
    await t.press("Space", "0");
    // The first may be from before it began.
    assert.ok(
      seen.slice(1).every((f) => f >= 20 && f <= 26),
      seen.join(),
    );
    await t.press("ArrowUp");
    await t.press("ArrowDown");
    await t.until((s) => s.playhead === 30, "to the next key");
  });

  test("error by frame and mean error, equal to their definition", async () => {
    await afresh();
    const s = await t.rolledOut();
    const known = s.error.slice(1).filter((e): e is number => e !== null);
    assert.ok(known.length > 40);
    const mean = known.reduce((a, b) => a + b, 0) / known.length;
    assert.ok(Math.abs(mean - (s.rollout?.mae ?? 0)) < 1e-6, `${mean} ${s.rollout?.mae}`);
    const badge = await t.byId("badge").innerText();
    assert.match(badge, /mean error/);
    assert.ok((await t.page.locator(".curves canvas").count()) >= 2, "curves are drawn");
  });

  test("the rollout follows a drag and ends where the edit is", async () => {
    await afresh();
    const before = (await t.rolledOut()).rollout?.gen ?? 0;
    let during = 0;
    await t.drag(30, 45, {
      steps: 15,
      before: async () => {
        await t.until(
          (s) => (s.rollout?.gen ?? 0) >= before + 2 && s.rollout?.rev === 0,
          "rolled out while dragging",
        );
        during = (await t.state()).rollout?.gen ?? 0;
      },
    });
    await t.until_keys([0, 45, 60]);
    const done = await t.rolledOut();
    assert.ok(during > before && (done.rollout?.gen ?? 0) > during);
    assert.equal(done.rollout?.rev, 1);
    await t.drag(45, 50, { before: async () => void (await t.page.keyboard.press("Escape")) });
    await t.until_keys([0, 45, 60]);
  });

  test("an edit rolls out only what it can change", async () => {
    await afresh();
    const before = await t.rolledOut();
    await studio.api("POST", "/api/ops", { ops: [{ op: "keys.move", args: { frames: [60], df: 10 } }] });
    await t.until_keys([0, 30, 70]);
    const s = await t.rolledOut();
    const resumed = s.rollout?.resumed_at ?? 0;
    assert.equal(resumed, 11, "20 frames before the first that differs");
    assert.deepEqual(s.q.slice(0, resumed + 1), before.q.slice(0, resumed + 1), "bit for bit");
    assert.notDeepEqual(s.error, before.error);
  });

  test("problems are listed, found by N, and explained", async () => {
    await afresh();
    await studio.api("POST", "/api/ops", {
      ops: [{ op: "keys.add", args: { keys: [{ frame: 32, q: [2.5, -1.5, 1.5, -1.5, -1.5] }] } }],
    });
    const s = await t.until((x) => (x.findings?.lints ?? []).some((l) => l.level !== "info"), "a problem");
    await t.goTo(0);
    await t.press("n");
    const first = (s.findings?.lints ?? [])
      .flatMap((l) => (l.frames ? [l.frames[0]] : []))
      .sort((a, b) => a - b)
      .find((f) => f > 0);
    await t.until((x) => x.playhead === first, "at the problem");
    assert.match(await t.byId("problems").innerText(), /too fast: .* °\/s/);
  });

  test("poses: save, apply, blend", async () => {
    await afresh();
    await t.goTo(30);
    await t.press("p");
    await t.page.getByLabel("Name", { exact: true }).fill("reach");
    await t.page.keyboard.press("Enter");
    const saved = await t.until((s) => "reach" in (s.clip?.poses ?? {}), "saved");
    await t.panel("poses");
    await t
      .byId("pose-reach")
      .locator("img")
      .evaluate(async (img: HTMLImageElement) => img.decode());
    await t.goTo(45);
    await t.byId("pose-reach").click();
    await t.until_keys([0, 30, 45, 60]);
    // 40 % of the pose, 60 % of the key that is there.
    const pose = saved.clip?.poses?.reach ?? [];
    const was = saved.clip?.keys.find((k) => k.frame === 60)?.q ?? [];
    await t.page.getByLabel("blend").fill("40");
    await t.goTo(60);
    await t.byId("pose-reach").click();
    const mixed = await t.until((s) => s.clip?.keys.find((k) => k.frame === 60)?.q?.[0] !== was[0], "mixed");
    mixed.clip?.keys
      .find((k) => k.frame === 60)
      ?.q?.forEach((v, j) => {
        assert.ok(Math.abs((v ?? 9) - (0.6 * (was[j] ?? 0) + 0.4 * (pose[j] ?? 0))) < 2e-6, `joint ${j}`);
      });
    await t.page.getByLabel("blend").fill("100");
  });

  test("a pose applied mirrored and a key pasted mirrored are the mirror images", async () => {
    await studio.api("POST", "/api/new", { robot: "pointmass", length: 60 });
    await t.until((s) => s.robot === "pointmass" && s.rev === 0, "pointmass");
    const { mirror, joints } = (await studio.api("GET", "/api/robot/pointmass")).json().table;
    assert.ok("table" in mirror, "it has a mirror image");
    const q = [0.1, 0.05];
    assert.equal(joints.length, q.length);
    await studio.api("POST", "/api/ops", {
      ops: [
        { op: "keys.add", args: { keys: [{ frame: 10, q }] } },
        { op: "pose.save", args: { name: "aside", q } },
      ],
    });
    await t.until_keys([0, 10]);
    // The server's own mirror image, by another road.
    await studio.api("POST", "/api/ops", { ops: [{ op: "keys.mirror", args: { frames: [10] } }] });
    const image =
      (await t.until((s) => s.rev === 2, "mirrored")).clip?.keys.find((k) => k.frame === 10)?.q ?? [];
    assert.notDeepEqual(image, q);
    assert.deepEqual(
      image.map((v) => Math.abs(v ?? 9)).sort(),
      q.map(Math.abs).sort(),
      "up to sign and order",
    );
    await studio.api("POST", "/api/undo", {});
    await t.until((s) => s.clip?.keys.find((k) => k.frame === 10)?.q?.[0] === q[0], "as before");
    await t.clickKey(10);
    await t.press("Control+c");
    await t.goTo(30);
    await t.press("Control+Shift+v");
    const pasted = await t.until((s) => s.clip?.keys.some((k) => k.frame === 30) === true, "pasted");
    assert.deepEqual(pasted.clip?.keys.find((k) => k.frame === 30)?.q, image);
    await t.press("Escape");
    await t.goTo(40);
    await t.page.getByLabel("mirrored").check();
    await t.panel("poses");
    await t.byId("pose-aside").click();
    const applied = await t.until((s) => s.clip?.keys.some((k) => k.frame === 40) === true, "applied");
    assert.deepEqual(applied.clip?.keys.find((k) => k.frame === 40)?.q, image);
    await t.page.getByLabel("mirrored").uncheck();
    // A hand has none, and says so.
    await studio.api("POST", "/api/new", { robot: "shadow_hand" });
    await t.until((s) => s.robot === "shadow_hand", "the hand");
    const { none } = (await studio.api("GET", "/api/robot/shadow_hand")).json().table.mirror as {
      none: string;
    };
    const box = t.page.getByLabel("mirrored");
    assert.ok(await box.isDisabled());
    assert.equal(await box.locator("xpath=..").getAttribute("title"), none);
    await t.press("Control+Shift+v");
    await t.page.getByText(none).first().waitFor();
  });

  test("a policy is chosen, and another, and refined, whatever was opened meanwhile", async () => {
    await afresh();
    for (const policy of ["pd", "computed-torque", "zero", "computed-torque"]) {
      await t.byId("policy").selectOption(policy);
      await t.until((s) => s.settings.policy === policy, `${policy} chosen`);
      const s = await t.until(
        (x) => x.rollout?.policy === policy && x.rollout.phase === "done",
        `${policy} performs`,
      );
      assert.equal(s.frames, s.clip?.length);
    }
    await t.panel("policies");
    const refine = t.page.getByLabel("refine");
    await refine.check();
    await t.until((s) => s.settings.refine && s.rollout?.phase === "done", "refined");
    await refine.uncheck();
    await t.until((s) => !s.settings.refine, "plain again");
    assert.deepEqual(await t.page.getByRole("alert").allInnerTexts(), [], "nothing was refused");
  });

  test("every policy is tried on the clip, and the nearest of its kind proposed", async () => {
    await afresh();
    await t.byId("policy").selectOption("pd");
    await t.until((s) => s.rollout?.policy === "pd" && s.rollout.phase === "done", "pd performs");
    await t.panel("policies");
    await t.byId("try-all").click();
    const use = t.byId("tries").getByRole("button", { name: "Use it" });
    await use.waitFor();
    const names = await t.byId("tries").locator(".take button").allInnerTexts();
    for (const name of ["Spring and damper", "Linear fit", "Learned"])
      assert.ok(
        names.some((n) => n.startsWith(name)),
        `${name} was tried`,
      );
    await use.click();
    const s = await t.until(
      (x) => x.settings.policy !== "pd" && x.rollout?.phase === "done",
      "the proposal performs",
    );
    assert.ok(
      ["robert", "ridge"].includes(s.settings.policy),
      `${s.settings.policy} knows no model, as pd does not`,
    );
    assert.equal(await use.count(), 0, "nothing nearer is left to propose");
  });

  test("policies are tried where rollouts are started by hand, and are started by hand again after that", async () => {
    await afresh();
    await t.byId("policy").selectOption("computed-torque");
    await t.until((s) => s.rollout?.policy === "computed-torque" && s.rollout.phase === "done", "performed");
    await t.press("Shift+R");
    await t.until((s) => !s.settings.auto, "by hand");
    await t.panel("policies");
    await t.byId("try-all").click();
    const busy = t.page.getByText(/^Trying /);
    await busy.waitFor();
    await busy.waitFor({ state: "detached" });
    await t.byId("tries").waitFor();
    await t.until((s) => !s.settings.auto && s.settings.policy === "computed-torque", "as before");
    await t.press("Shift+R");
    await t.until((s) => s.settings.auto, "by themselves");
  });

  test("the automatic choice says what it compared, and shows the best", async () => {
    await afresh();
    await t.byId("policy").selectOption("auto");
    const s = await t.until(
      (x) => x.rollout?.policy.startsWith("auto: ") === true && x.rollout.phase === "done",
      "auto has chosen",
    );
    assert.equal(s.frames, s.clip?.length, "all frames of the chosen one are there");
    await t.panel("policies");
    const rows = t.byId("compared").locator(".take");
    const names = await rows.allInnerTexts();
    for (const name of ["Learned, corrected by repetition", "Linear fit", "Spring and damper"])
      assert.ok(
        names.some((n) => n.includes(name)),
        `${name} was compared: ${names}`,
      );
    const first = rows.first().locator(".name");
    assert.equal(await first.getAttribute("aria-current"), "true", "the best stands first");
    assert.ok(s.settings.policy === "auto", "the choice is made anew for each clip");
  });

  test("a search for a better motion is named, and Stop ends it with the best one", async () => {
    await afresh();
    // Two radians in a tenth of a second: no policy arrives in time.
    const key = (frame: number, pan: number) => ({ frame, q: [pan, -1.57, 1.57, -1.57, -1.57], hold: 5 });
    const keys = [key(0, -1.57), key(20, -1.57), key(26, 0.4), key(50, -1.57), key(56, 0.4)];
    await studio.api("POST", "/api/ops", { ops: [{ op: "keys.add", args: { keys, replace: true } }] });
    await t.byId("policy").selectOption("auto");
    const found = await t.until((s) => s.rollout?.stage === "search", "searching");
    assert.equal(found.frames, found.clip?.length, "the motion from before is shown");
    await t.page.getByText("searching for a better motion").waitFor();
    await t.byId("stop-rollout").click();
    const s = await t.rolledOut();
    assert.equal(s.rollout?.phase, "done");
    assert.match(s.rollout?.policy ?? "", /^auto: /);
    assert.equal(await t.byId("stop-rollout").count(), 0, "there is nothing left to stop");
  });

  test("markers are kept in the file", async () => {
    await afresh();
    await t.goTo(25);
    await t.press("Shift+M");
    await t.page.getByLabel("Name", { exact: true }).fill("shot");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.clip?.markers?.[0]?.name === "shot", "marked");
    assert.match((await studio.api("GET", "/api/clip")).bytes.toString(), /"shot"/);
  });

  test("two tabs on one document stay in step", async () => {
    await afresh();
    const other = await tab(studio);
    await other.until((s) => s.clip?.name === "arm", "the same clip");
    await other.drag(30, 34);
    await t.until_keys([0, 34, 60]);
    await t.press("Control+z");
    await other.until_keys([0, 30, 60]);
    await other.context.close();
  });

  test("a drag ends with the page that makes it", async () => {
    await afresh();
    await t.drag(30, 34);
    await t.until_keys([0, 34, 60]);
    const before = await t.rolledOut();
    const other = await tab(studio);
    await other.until((s) => s.clip?.name === "arm", "the same clip");
    const [from, to] = [await other.at(34), await other.at(45)];
    await other.page.mouse.move(from.x, from.y);
    await other.page.mouse.down();
    await other.page.mouse.move(to.x, to.y, { steps: 4 });
    await t.until((s) => s.rollout?.rev === 0 && s.rollout.phase === "done", "everybody sees the drag");
    await other.context.close();
    const after = await t.rolledOut();
    assert.equal(after.rev, before.rev, "nothing was edited");
    assert.deepEqual(after.q, before.q, "the motion is that of the clip again");
  });

  test("an unsaved clip waits under Examples until it is opened or discarded", async () => {
    await afresh();
    await t.goTo(10);
    await t.press("m");
    const edited = await t.until((s) => (s.clip?.masks ?? []).length === 1, "edited");
    await t.turnTo("gallery");
    await t.byId("example-pointmass/star").click();
    await t.until((s) => s.page === "editor" && s.robot === "pointmass", "another clip");
    await t.turnTo("gallery");
    // Other tests have left unsaved clips, too: the newest is on top.
    const [newest] = (await studio.api("GET", "/api/drafts")).json() as { number: number }[];
    const row = t.byId(`draft-${newest?.number}`);
    assert.match(await row.innerText(), /arm/);
    await row.getByRole("button", { name: "arm", exact: true }).click();
    const back = await t.until((s) => s.page === "editor" && s.clip?.name === "arm", "back");
    assert.deepEqual(back.clip?.masks, edited.clip?.masks);
    await t.turnTo("gallery");
    await t.byId("example-pointmass/star").click();
    await t.until((s) => s.robot === "pointmass", "another clip");
    await t.turnTo("gallery");
    // The page asks for the list when it is opened.
    const count = ((await studio.api("GET", "/api/drafts")).json() as unknown[]).length;
    await t.page.waitForFunction(
      (n) => document.querySelectorAll('[data-testid^="draft-"]').length === n,
      count,
    );
    await t.page.getByRole("button", { name: "Discard arm" }).first().click();
    await t.page.waitForFunction(
      (n) => document.querySelectorAll('[data-testid^="draft-"]').length === n - 1,
      count,
    );
  });

  test("a bad file is a banner with its place, as on the command line", async () => {
    studio.file("bad.clip.json", '{\n  "format": "robert-clip/1",\n  "robot": 7\n}\n');
    await t.press("Control+o");
    await t.page.getByLabel("File", { exact: true }).fill("bad.clip.json");
    await t.page.keyboard.press("Enter");
    await t.page
      .getByText(/bad\.clip\.json:3:\d+/)
      .first()
      .waitFor();
  });

  test("the still viewport and the rendered panel show the playhead; a film plays", async () => {
    await afresh();
    await t.byId("still-view").waitFor();
    await t.byId("tab-rendered").click();
    await t.byId("still").waitFor();
    const first = await t.byId("still").getAttribute("src");
    await t.goTo(60);
    await t.page.waitForFunction(
      (src) => document.querySelector('[data-testid="still"]')?.getAttribute("src") !== src,
      first,
    );
    await t.picture("rendered");
    // A shorter one, for the film.
    await studio.api("POST", "/api/ops", {
      ops: [
        { op: "keys.delete", args: { frames: [30, 60] } },
        { op: "clip.length", args: { length: 20 } },
      ],
    });
    await t.rolledOut();
    // Who asked for less motion starts the film by hand.
    await t.page.emulateMedia({ reducedMotion: "reduce" });
    await t.byId("play-film").click();
    await t.byId("film").waitFor();
    const film0 = await t
      .byId("film")
      .evaluate((v: HTMLVideoElement) => ({ auto: v.autoplay, paused: v.paused }));
    assert.deepEqual(film0, { auto: false, paused: true });
    await t.page.emulateMedia({ reducedMotion: null });
    const film = await t.byId("film").evaluate(async (v: HTMLVideoElement) => {
      if (!(v.duration > 0))
        await new Promise((resolve) => v.addEventListener("loadedmetadata", resolve, { once: true }));
      Object.assign(v, { muted: true, loop: false });
      // It may have begun by itself.
      v.pause();
      // Every frame, one after the other: a busy machine leaves some out while it plays.
      const shown = new Set<number>();
      for (let frame = 19; frame >= 0; frame--) {
        const drawn = new Promise<number>((resolve) =>
          v.requestVideoFrameCallback((_, at) => resolve(at.mediaTime)),
        );
        v.currentTime = (frame + 0.5) / 20;
        shown.add(Math.round((await drawn) * 1000));
      }
      const ended = new Promise((resolve) => v.addEventListener("ended", resolve, { once: true }));
      await v.play();
      await ended;
      return { secs: v.duration, width: v.videoWidth, height: v.videoHeight, frames: shown.size };
    });
    assert.deepEqual([film.width, film.height], [640, 400]);
    assert.equal(film.frames, 20, "each frame is another moment of the film");
    const secs = film.secs;
    assert.ok(Math.abs(secs - 1) < 0.06, `${secs} s`);
    await t.byId("tab-curves").click();
  });

  test("a click on the still selects the link under the mouse", async () => {
    await afresh();
    const view = await t.box("still-view");
    const [w, h] = [Math.round(view.width), Math.round(view.height)];
    const at = async (x: number, y: number): Promise<string | null> =>
      (await studio.api("GET", `/api/still-body?frame=0&w=${w}&h=${h}&x=${x}&y=${y}`)).json() as
        | string
        | null;
    const found: { x: number; y: number }[] = [];
    for (let i = 0; i < 24; i++)
      for (let j = 0; j < 18; j++) {
        const p = { x: (i + 0.5) / 24, y: (j + 0.5) / 18 };
        if (/forearm/.test((await at(p.x, p.y)) ?? "")) found.push(p);
      }
    const middle = found[Math.floor(found.length / 2)];
    assert.ok(middle, "the forearm is in the picture");
    await t.page.mouse.click(view.x + middle.x * view.width, view.y + middle.y * view.height);
    await t.until((s) => s.clip?.robot.joints[s.joint ?? -1] === "elbow", "the elbow is selected");
    await t.page.locator(".joint.on").first().waitFor();
    assert.equal(await at(0.01, 0.01), null, "nothing in the sky");
    await t.page.mouse.click(view.x + 0.01 * view.width, view.y + 0.5 * view.height);
    await t.until((s) => s.joint === undefined, "nothing selected");
  });

  test("the edges of panels move by mouse and keys, stay for the next visit, and go back", async () => {
    await afresh();
    const width = async (): Promise<number> => (await t.page.locator(".left").boundingBox())?.width ?? 0;
    const before = await width();
    const edge = await t.box("splitter-left");
    const y = edge.y + edge.height / 2;
    await t.page.mouse.move(edge.x + 3, y);
    await t.page.mouse.down();
    await t.page.mouse.move(edge.x + 63, y, { steps: 4 });
    await t.page.mouse.up();
    const wide = await width();
    assert.ok(Math.abs(wide - before - 60) < 4, `${before} to ${wide}`);
    await t.page.reload();
    await t.until((s) => s.link === "open" && s.page === "editor", "here again");
    assert.ok(Math.abs((await width()) - wide) < 2, "kept");
    await t.byId("splitter-left").focus();
    await t.press("ArrowLeft");
    const narrow = await width();
    assert.ok(narrow < wide - 10, `${wide} to ${narrow} by a key`);
    assert.equal((await t.state()).playhead, 0, "and the playhead stays");
    await t.byId("splitter-left").dblclick();
    assert.ok(Math.abs((await width()) - before) < 2, "as it was");
    for (const of of ["right", "curves", "sheet"]) {
      const box = await t.byId(`splitter-${of}`).boundingBox();
      assert.ok(box && box.width >= 5 && box.height >= 5, of);
    }
  });

  test("a dead simulation is told, and edits go on", async () => {
    await afresh();
    const pid = (await studio.api("GET", "/api/state")).json().worker.pid as number;
    process.kill(pid, "SIGKILL");
    await t.page.getByText("The simulation stopped unexpectedly").first().waitFor();
    await t.drag(30, 33);
    await t.until_keys([0, 33, 60]);
    const s = await t.rolledOut();
    assert.equal(s.rollout?.phase, "done");
  });

  test("works at 1100 x 640, dark and light", async () => {
    await afresh();
    await t.page.setViewportSize({ width: 1100, height: 640 });
    for (const scheme of ["light", "dark"] as const) {
      await t.page.emulateMedia({ colorScheme: scheme, reducedMotion: "reduce" });
      await t.painted();
      await t.picture(`small-${scheme}`);
      const over = await t.page.evaluate(() =>
        [...document.querySelectorAll(".editor > *, .side > *, .transport > *, .bar > *")]
          .filter((e) => {
            const r = e.getBoundingClientRect();
            return r.width > 0 && (r.right > innerWidth + 1 || r.bottom > innerHeight + 1 || r.left < -1);
          })
          .map((e) => `${e.className} ${e.textContent?.slice(0, 20)}`),
      );
      assert.deepEqual(over, [], "nothing sticks out");
    }
    await t.page.setViewportSize({ width: 1280, height: 720 });
  });

  test("nothing left the origin, and no script broke", async () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
