// The timeline's promises: nothing is lost without a word, nothing leaks from one document into
// the next, every gesture has a key. Still pictures for a viewport.

import assert from "node:assert/strict";
import { isDeepStrictEqual } from "node:util";
import { ARM, describe, eventually, onTheArm, type Studio, type Tab, test } from "./harness";

describe("timeline", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  const afresh = async (text = ARM): Promise<void> => {
    await t.afresh(text);
    await t.press("Shift+F");
  };
  const ops = async (...list: { op: string; args: object }[]): Promise<void> => {
    assert.equal((await studio.api("POST", "/api/ops", { ops: list })).status, 200);
  };
  const key = async (frame: number) => (await t.state()).clip?.keys.find((k) => k.frame === frame);
  const sorted = (frames: number[]): string => JSON.stringify([...frames].sort((a, b) => a - b));

  test("K on a key selects it and changes nothing of it", async () => {
    await afresh();
    const rich = { frame: 30, q: [-1.2, null, 1.4, -1.5, -1.5], hold: 4, fill: "cubic", note: "wait here" };
    await ops({ op: "keys.add", args: { keys: [rich], replace: true } });
    await t.until((s) => s.rev === 1, "a key with all that a key can have");
    await t.goTo(30);
    await t.press("k");
    const s = await t.until((x) => sorted(x.selection) === "[30]", "selected");
    assert.deepEqual(
      s.clip?.keys.find((k) => k.frame === 30),
      rich,
    );
    assert.equal(s.rev, 1, "no edit");
    // A pose that floats, taken to the key: its values change, the rest stays.
    await t.page.getByRole("button", { name: "Auto-key" }).click();
    await t.goTo(45);
    await t.byId("joint-0").locator("input[type=text]").fill("-80");
    await t.byId("joint-0").locator("input[type=text]").press("Enter");
    await t.page.getByText("This pose is not a key yet").waitFor();
    await t.goTo(30);
    await t.press("k");
    await t.until((x) => x.rev === 2, "keyed");
    const now = await key(30);
    assert.ok(Math.abs((now?.q?.[0] ?? 0) + (80 * Math.PI) / 180) < 1e-4, JSON.stringify(now));
    assert.deepEqual([now?.q?.[1], now?.hold, now?.fill, now?.note], [null, 4, "cubic", "wait here"]);
    await t.page.getByRole("button", { name: "Auto-key" }).click();
  });

  test("what a drop, a paste or a copy takes the place of is told, and comes back", async () => {
    await afresh();
    const before = await key(60);
    const back = async (): Promise<void> => {
      const told = t.page.locator(".toast", { hasText: "replaced a key" }).last();
      await told.getByRole("button", { name: "Undo" }).click();
      // The key that was replaced is in the same frame: only its pose tells that it is back.
      await t.until(
        (s) =>
          s.clip?.keys.length === 3 &&
          isDeepStrictEqual(
            s.clip.keys.find((k) => k.frame === 60),
            before,
          ),
        "the replaced key is back",
      );
      await told.getByRole("button", { name: "Dismiss" }).click();
    };
    await t.drag(30, 60);
    await t.until_keys([0, 60]);
    await back();
    await t.drag(30, 60, { hold: "Alt" });
    await t.until((s) => s.clip?.keys.find((k) => k.frame === 60)?.q?.[0] === -1.2, "copied onto it");
    await back();
    await t.clickKey(30);
    await t.press("Control+c");
    await t.goTo(60);
    await t.press("Control+v");
    await t.until((s) => s.clip?.keys.find((k) => k.frame === 60)?.q?.[0] === -1.2, "pasted onto it");
    await back();
    await t.clickKey(30);
    await t.drag(30, 40, { hold: "Alt" });
    await t.until_keys([0, 30, 40, 60]);
    assert.equal(
      await t.page.locator(".toast", { hasText: "replaced" }).count(),
      0,
      "nothing was in the way: nothing is said",
    );
  });

  test("a refused drop leaves selection and playhead; with Alt, Shift does not count", async () => {
    await afresh();
    await t.clickKey(30);
    await t.goTo(10);
    const p = await t.at(30);
    const far = await t.at(60);
    // Beyond the end of the clip: refused.
    await t.page.mouse.move(far.x, far.y);
    await t.page.mouse.down();
    await t.page.mouse.move(far.x + 400, far.y, { steps: 5 });
    await t.page.mouse.up();
    await t.page.getByText("outside the clip").first().waitFor();
    const s = await t.state();
    assert.deepEqual([sorted(s.selection), s.playhead, s.rev], ["[60]", 10, 0], "as before the drag");
    await t.press("Alt+ArrowLeft");
    await t.until_keys([0, 30, 59]);
    // Onto a neighbour by keys: refused in words that are no script's.
    await ops({ op: "keys.move", args: { frames: [59], df: -28 } });
    await t.until_keys([0, 30, 31]);
    await t.clickKey(30);
    await t.press("Alt+ArrowRight");
    const told = t.page.locator(".toast", { hasText: "would overwrite another key" }).last();
    await told.waitFor();
    assert.doesNotMatch(await told.innerText(), /replace/);
    assert.equal(sorted((await t.state()).selection), "[30]");
    await t.page.keyboard.down("Shift");
    await t.drag(30, 45, { hold: "Alt" });
    await t.page.keyboard.up("Shift");
    await t.until_keys([0, 30, 31, 45]);
    assert.ok(p.x > 0);
  });

  test("the error strip is a ruler, not a row; poses keep their order when they are used", async () => {
    await afresh();
    const box = await t.box("timeline");
    const p = await t.at(40);
    await t.page.mouse.click(p.x, box.y + box.height - 10);
    const s = await t.until((x) => x.playhead === 40, "the playhead goes there");
    assert.deepEqual([s.joint, s.selection], [undefined, []]);
    const order = (): Promise<string[]> => t.page.locator(".poses .pose").allInnerTexts();
    const before = await order();
    assert.ok(before.length > 3);
    await t.panel("poses");
    await t.byId("pose-folded").click();
    await t.until((x) => "folded" in (x.clip?.poses ?? {}), "the clip has a copy");
    assert.deepEqual(await order(), before);
  });

  test("M means the selection before the loop, and the hint says which frames", async () => {
    await afresh();
    await t.goTo(5);
    await t.press("[");
    await t.goTo(70);
    await t.press("]");
    await t.until((s) => s.range?.from === 5 && s.range.to === 71, "a loop");
    const hint = t.page.locator(".hint");
    assert.match(await hint.innerText(), /mask 5 to 70 \(the loop range\)/);
    await t.clickKey(0);
    await t.clickKey(30, ["Control"]);
    await t.until((s) => s.selection.length === 2, "two keys");
    assert.match(await hint.innerText(), /mask 1 to 29 \(the selected keys\)/);
    await t.press("m");
    const s = await t.until((x) => (x.clip?.masks ?? []).length === 1, "masked");
    assert.deepEqual(s.clip?.masks, [{ from: 1, to: 30 }]);
  });

  test("speed, loop and range reach the 3D view while it plays", async () => {
    await afresh();
    await t.page.evaluate(() => {
      const sent: unknown[] = [];
      const send = WebSocket.prototype.send;
      WebSocket.prototype.send = function (data) {
        const m = JSON.parse(String(data)) as { op: string; args: object };
        if (m.op === "view.play") sent.push(m.args);
        send.call(this, data);
      };
      Object.assign(window, { __played: sent });
    });
    type Played = { frame: number; speed: number; range?: [number, number] };
    const last = (): Promise<Played | undefined> =>
      t.page.evaluate(() => (window as unknown as { __played: Played[] }).__played.at(-1));
    const plays = async (ok: (a: Played) => boolean, what: string): Promise<void> => {
      await eventually(async () => {
        const a = await last();
        return a && ok(a);
      }, what);
    };
    await t.goTo(20);
    await t.press("[");
    await t.goTo(29);
    await t.press("]");
    await t.goTo(50);
    await t.press("Space");
    await plays(
      (a) => a.frame === 20 && a.speed === 1 && a.range?.[0] === 20 && a.range[1] === 30,
      "from the start of the loop",
    );
    await t.press("-");
    await plays((a) => a.speed === 0.5 && a.frame >= 20 && a.frame < 30, "half as fast, from where it is");
    await t.press("l");
    await plays((a) => a.range === undefined && a.speed === 0.5, "once");
    await t.press("l");
    await t.page.keyboard.press("Control+k");
    await t.page.getByLabel("Command", { exact: true }).fill("clear loop");
    await t.page.keyboard.press("Enter");
    await plays((a) => a.range?.[0] === 0 && a.range[1] === 80, "the whole clip");
    await t.press("Space", "0");
    await plays((a) => a.speed === 0, "paused");
  });

  test("nothing of one document is left in the next; a shorter clip shortens the loop", async () => {
    await afresh();
    await t.rolledOut();
    await t.goTo(20);
    await t.press("[");
    await t.goTo(70);
    await t.press("]", "Control+a");
    await t.page.locator(".joint input[type=range]").nth(1).focus();
    await t.press("Alt+l");
    await t.until((x) => x.locked?.length === 1, "a joint locked");
    await t.page.getByRole("button", { name: "Auto-key" }).click();
    await t.goTo(45);
    await t.byId("joint-0").locator("input[type=text]").fill("-80");
    await t.byId("joint-0").locator("input[type=text]").press("Enter");
    await t.page.getByText("This pose is not a key yet").waitFor();
    // A document of the same name, without a file, with no edit: as like as can be.
    await afresh();
    const s = await t.state();
    // Takes stay until the studio ends; none of them is compared with another document's.
    assert.deepEqual(
      [s.range, s.selection, s.playhead, s.joint, s.compared, s.locked],
      [undefined, [], 0, undefined, [], []],
    );
    assert.equal(await t.page.getByText("This pose is not a key yet").count(), 0, "nothing floats");
    await t.page.getByRole("button", { name: "Auto-key" }).click();
    await t.goTo(30);
    await t.press("[");
    await t.goTo(75);
    await t.press("]");
    await ops({ op: "clip.length", args: { length: 65 } });
    await t.until((x) => x.range?.from === 30 && x.range.to === 65 && x.playhead === 64, "inside the clip");
  });

  test("name, length and start of a clip", async () => {
    await afresh();
    await t.press("F2");
    await t.byId("name").fill("reach out");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.clip?.name === "reach out", "renamed");
    assert.match(await t.byId("title").innerText(), /reach out/);
    await t.byId("length").fill("5s");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.clip?.length === 100, "5 s");
    await t.byId("length").fill("40");
    await t.page.keyboard.press("Enter");
    await t.page.getByText("is at frame 40 or later").first().waitFor();
    assert.equal((await t.state()).clip?.length, 100, "no key falls out unasked");
    await t.press("Shift+F");
    const box = await t.byId("timeline").boundingBox();
    const [end, to] = [await t.at(100), await t.at(90)];
    assert.ok(box);
    await t.page.mouse.move(end.x, box.y + 10);
    await t.page.mouse.down();
    await t.page.mouse.move(to.x, box.y + 10, { steps: 4 });
    await t.page.mouse.up();
    await t.until((s) => s.clip?.length === 90, "its end is dragged");
    await t.rolledOut();
    const past = await t.at(-10);
    await t.page.mouse.click(past.x, past.y, { button: "right" });
    assert.equal(await t.page.getByRole("menuitem").count(), 4);
    await t.page.keyboard.press("Escape");
    await t.goTo(30);
    await t.page.mouse.click(past.x, past.y, { button: "right" });
    await t.page.getByRole("menuitem", { name: "Start from the pose at the playhead" }).click();
    const rest = [-1.2, -1.4, 1.4, -1.5, -1.5];
    const s = await t.until((x) => x.clip?.start != null, "started elsewhere");
    const start = s.clip?.start;
    assert.ok(start && "q" in start && start.q.every((v, j) => Math.abs(v - (rest[j] ?? 0)) < 1e-6));
    const done = await t.rolledOut();
    assert.ok(
      done.q[0]?.every((v, j) => Math.abs(v - (rest[j] ?? 0)) < 1e-3),
      "and the motion begins there",
    );
    assert.match(
      await t.byId("badge").innerText(),
      /starts .* away/,
      "the first frame's error is said, which the mean leaves out",
    );
    await t.press("Control+z");
    await t.until((x) => x.clip?.start == null, "as before");
  });

  test("a new clip has the name and the length that were asked for", async () => {
    await t.turnTo("gallery");
    await t.page.getByLabel("Robot").first().selectOption("ur5e");
    await t.page.getByLabel("Name of the new clip").fill("wave");
    await t.page.getByLabel("Length of the new clip, seconds").fill("2,5");
    await t.byId("new-clip").click();
    await t.until((s) => s.page === "editor" && s.clip?.name === "wave" && s.clip.length === 50, "wave");
  });

  test("poses and markers are renamed and deleted", async () => {
    await afresh();
    await ops(
      { op: "pose.save", args: { name: "reach", q: [-1, -1, 1, -1, -1] } },
      { op: "pose.apply", args: { name: "reach", frames: [45] } },
      { op: "markers.add", args: { frame: 20, name: "shot" } },
    );
    await t.until_keys([0, 30, 45, 60]);
    await t.panel("poses");
    await t.byId("pose-reach").click({ button: "right" });
    await t.page.getByRole("menuitem", { name: "Rename" }).click();
    await t.page.getByLabel("Name", { exact: true }).fill("far");
    await t.page.keyboard.press("Enter");
    await t.until(
      (s) => "far" in (s.clip?.poses ?? {}) && s.clip?.keys.find((k) => k.frame === 45)?.pose === "far",
      "its key follows",
    );
    // By keys: the menu of what has the focus.
    await t.byId("pose-far").focus();
    await t.press("Shift+F10", "d", "Enter");
    await t.until((s) => !("far" in (s.clip?.poses ?? {})), "deleted");
    assert.deepEqual((await key(45))?.q, [-1, -1, 1, -1, -1], "its key keeps the values");
    const p = await t.at(20);
    const box = await t.box("timeline");
    await t.page.mouse.click(p.x, box.y + 31, { button: "right" });
    await t.page.getByRole("menuitem", { name: "Rename marker" }).click();
    await t.page.getByLabel("Name", { exact: true }).fill("aim");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.clip?.markers?.[0]?.name === "aim", "renamed");
    await t.page.mouse.click(p.x, box.y + 31, { button: "right" });
    await t.page.getByRole("menuitem", { name: "Delete marker" }).click();
    await t.until((s) => (s.clip?.markers ?? []).length === 0, "deleted");
  });

  test("a take becomes keys, and keys are thinned out to the extremes", async () => {
    await afresh();
    const take = (await t.rolledOut()).q;
    await t.press("Shift+T");
    await t.page.getByLabel("Frames from key to key").fill("2");
    await t.page.keyboard.press("Enter");
    const dense = await t.until((s) => s.clip?.keys.length === 40, "a key at every second frame");
    for (const k of dense.clip?.keys ?? [])
      k.q?.forEach((v, j) => assert.ok(Math.abs((v ?? 9) - (take[k.frame]?.[j] ?? 0)) < 2e-6, `${k.frame}`));
    await t.press("Escape", "t");
    await t.page.getByLabel(/Remove keys nearer than/).fill("3");
    await t.page.keyboard.press("Enter");
    const thin = await t.until((s) => (s.clip?.keys.length ?? 99) < 30, "thinned out");
    const stays = thin.clip?.keys ?? [];
    assert.ok(
      stays.length >= 3 && stays[0]?.frame === 0 && stays.at(-1)?.frame === 78,
      stays.map((k) => k.frame).join(),
    );
    for (const old of dense.clip?.keys ?? []) {
      const b = stays.findIndex((k) => k.frame >= old.frame);
      const [p, n] = [stays[Math.max(0, b - 1)], stays[b]];
      assert.ok(p && n);
      const share = n.frame === p.frame ? 0 : (old.frame - p.frame) / (n.frame - p.frame);
      old.q?.forEach((v, j) =>
        assert.ok(
          Math.abs((p.q?.[j] ?? 0) + share * ((n.q?.[j] ?? 0) - (p.q?.[j] ?? 0)) - (v ?? 0)) <=
            (3 * Math.PI) / 180 + 1e-6,
          `frame ${old.frame}, joint ${j}`,
        ),
      );
    }
    await t.press("Control+z", "Control+z");
    await t.until_keys([0, 30, 60]);
  });

  test("every gesture has a key, no mouse, and the grid speaks", async () => {
    await afresh();
    const mouse = t.page.mouse as unknown as Record<string, unknown>;
    const used: string[] = [];
    const kept = { ...mouse };
    for (const name of ["click", "move", "down", "up", "wheel", "dblclick"])
      mouse[name] = () => {
        used.push(name);
        throw new Error("the mouse was used");
      };
    try {
      // Select: one key, another beside it, on to the next, all, none.
      await t.press("ArrowDown", "k");
      await t.until((s) => s.playhead === 30 && sorted(s.selection) === "[30]", "one key");
      await t.press("ArrowDown", "Control+Space");
      await t.until((s) => sorted(s.selection) === "[30,60]", "one more");
      await t.press("Control+Space");
      await t.until((s) => sorted(s.selection) === "[30]", "one less");
      await t.press("Escape", "Home", "Control+Shift+ArrowRight", "Control+Shift+ArrowRight");
      await t.until((s) => sorted(s.selection) === "[0,30,60]", "a range");
      await t.press("Control+Shift+ArrowLeft");
      await t.until((s) => sorted(s.selection) === "[0,30]", "back by one");
      await t.press("Escape");
      // Move and ripple.
      await t.press(
        "Home",
        "ArrowDown",
        "k",
        "Alt+ArrowRight",
        "Alt+ArrowRight",
        "Alt+ArrowRight",
        "Alt+ArrowLeft",
        "Alt+ArrowLeft",
      );
      await t.until_keys([0, 31, 60]);
      await t.press("Alt+Shift+ArrowRight");
      await t.until_keys([0, 32, 61]);
      // Copy, paste, cut, duplicate, delete.
      await t.press("Control+c", "Home", "Shift+ArrowRight", "Control+v");
      await t.until_keys([0, 10, 32, 61]);
      await t.press("Control+x");
      await t.until_keys([0, 32, 61]);
      await t.press("ArrowDown", "k", "Control+d");
      await t.until_keys([0, 32, 37, 61]);
      await t.press("Delete");
      await t.until_keys([0, 32, 61]);
      // Retime and time by number.
      await t.press("Home", "Control+a", "s");
      await t.page.getByLabel("Factor on the distance to the playhead").fill("0.5");
      await t.page.keyboard.press("Enter");
      await t.until_keys([0, 16, 31]);
      await t.press("Escape", "e");
      await t.page.getByLabel("Frames (negative removes)").fill("4");
      await t.page.keyboard.press("Enter");
      await t.until_keys([4, 20, 35]);
      // Masks, and a menu: Shift+F10, arrows, Enter.
      await t.press("ArrowDown", "ArrowRight", "m");
      await t.until((s) => (s.clip?.masks ?? []).length === 1, "masked");
      await t.press("Shift+F10", "ArrowDown", "ArrowDown", "ArrowDown");
      assert.equal(await t.page.evaluate(() => document.activeElement?.textContent), "UnmaskU");
      await t.press("Enter");
      await t.until((s) => (s.clip?.masks ?? []).length === 0, "unmasked by the menu");
      assert.equal(await t.page.getByRole("menu").count(), 0);
      // Exact values.
      await t.press("ArrowDown", "Enter");
      await t.page.getByRole("dialog", { name: /^Key at frame/ }).waitFor();
      await t.press("Escape");
      // Markers.
      await t.press("Shift+M");
      await t.page.getByLabel("Name", { exact: true }).fill("shot");
      await t.page.keyboard.press("Enter");
      const marked = await t.until((s) => s.clip?.markers?.[0]?.name === "shot", "marked");
      const at = marked.clip?.markers?.[0]?.frame ?? 0;
      await t.press("Home", "Control+.");
      await t.until((s) => s.playhead === at, "at the marker");
      await t.press(">", ">", "<");
      await t.until((s) => s.clip?.markers?.[0]?.frame === at + 1 && s.playhead === at + 1, "moved");
      // Zoom, pan, fit, and the playhead stays in sight.
      const whole = (await t.state()).view;
      await t.press("Home", "z", "z", "z", "z");
      await t.until((s) => s.view.zoom > whole.zoom * 4, "zoomed in");
      const before = (await t.state()).view.left;
      await t.press("PageDown");
      await t.until((s) => s.view.left > before, "panned");
      await t.press("PageUp", "End");
      const far = await t.state();
      const width = await t.page.locator(".sheet").evaluate((e) => e.clientWidth);
      assert.ok(
        far.view.left <= far.playhead && far.view.left + (width - 168) / far.view.zoom >= far.playhead,
        "the end is in sight",
      );
      await t.press("Shift+Z");
      await t.until((s) => s.view.zoom < far.view.zoom, "zoomed out");
      await t.press("Shift+F");
      await t.until((s) => s.view.zoom < whole.zoom * 1.1, "the whole clip");
      // Rows.
      const grid = t.byId("timeline");
      await grid.focus();
      await t.press("Control+ArrowDown", "Control+ArrowDown");
      await t.until((s) => s.joint !== undefined, "a joint's row");
      assert.equal(await grid.getAttribute("role"), "grid");
      assert.equal(await grid.getAttribute("aria-colcount"), String((await t.state()).clip?.length));
      await t.goTo(20);
      await grid.focus();
      assert.match(await t.page.locator("#sheet-cell").innerText(), /frame 20, key/);
    } finally {
      Object.assign(mouse, kept);
    }
    assert.deepEqual(used, []);
  });

  test("what a key does stands in the sheet, and the palette shows what is chosen", async () => {
    await afresh();
    await t.press("?");
    const sheet = t.page.getByRole("dialog", { name: "Shortcuts" });
    const text = await sheet.innerText();
    for (const k of ["Ctrl+↓", "Enter", "Ctrl+Space", "Ctrl+Shift+→", "Shift+F10", "PageDown"])
      assert.ok(text.includes(k), k);
    await t.press("Escape", "Control+k");
    const field = t.page.getByLabel("Command", { exact: true });
    const count = await t.page.getByRole("option").count();
    assert.ok(count > 40, "all of them");
    for (let i = 0; i < 30; i++) await t.page.keyboard.press("ArrowDown");
    const active = await field.getAttribute("aria-activedescendant");
    const chosen = t.page.locator(`#${active}`);
    assert.equal(await chosen.getAttribute("aria-selected"), "true");
    const inside = await chosen.evaluate((e) => {
      const [a, b] = [e.getBoundingClientRect(), e.parentElement?.getBoundingClientRect()];
      return b !== undefined && a.top >= b.top - 1 && a.bottom <= b.bottom + 1;
    });
    assert.ok(inside, "what Enter would run is in sight");
    await t.press("Escape");
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
