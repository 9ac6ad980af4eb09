// What goes in and out: takes that are kept and compared, files that are opened from anywhere,
// exports with all their options, a server that was started anew.

import assert from "node:assert/strict";
import { existsSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { ARM, armTab, describe, eventually, onTheArm, Studio, type Tab, tab, test } from "./harness";

/** Colours of the takes that are compared, as src/store.ts has them. */
const MAGENTA = [0xc9, 0x4f, 0xa8] as const;

/** How many pixels of the error strip have about this colour. */
function inStrip(t: Tab, color: readonly [number, number, number]): Promise<number> {
  return t.page.evaluate(
    ([r, g, b]) => {
      const canvas = document.querySelector<HTMLCanvasElement>(
        '[data-testid="timeline"] canvas, canvas[data-testid="timeline"]',
      );
      const ctx = canvas?.getContext("2d");
      if (!canvas || !ctx) return -1;
      const high = Math.round(30 * devicePixelRatio);
      const { data } = ctx.getImageData(0, canvas.height - high, canvas.width, high);
      let found = 0;
      for (let i = 0; i < data.length; i += 4) {
        if (
          Math.abs((data[i] ?? 0) - r!) +
            Math.abs((data[i + 1] ?? 0) - g!) +
            Math.abs((data[i + 2] ?? 0) - b!) <
          60
        )
          found++;
      }
      return found;
    },
    [...color],
  );
}

const CSV = `${[
  "frame,time,mask,shoulder_pan,shoulder_lift,elbow,wrist_1,wrist_2",
  ...Array.from(
    { length: 30 },
    (_, f) => `${f},${f / 20},${f % 10 ? 1 : 0},${f % 10 ? ",,,," : `${-1.5 + f / 100},-1.5,1.5,-1.5,-1.5`}`,
  ),
].join("\n")}\n`;

const MJCF = `<mujoco><keyframe><key name="home" time="0" qpos="-1.57 -1.57 1.57 -1.57 -1.57"/><key name="away" time="1" qpos="-1.2 -1.4 1.4 -1.5 -1.5"/></keyframe></mujoco>`;

describe("takes and files", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  const afresh = async (): Promise<void> => {
    await t.afresh();
    await t.rolledOut();
  };

  test("a file that another program has changed is overwritten only when that is said", async () => {
    await afresh();
    await studio.api("POST", "/api/save", { path: "shared.clip.json", replace: true });
    await t.until((s) => s.dirty === false, "saved");
    const theirs = studio.read("shared.clip.json").toString().replace('"length": 80', '"length": 90');
    studio.file("shared.clip.json", theirs);
    await studio.api("POST", "/api/ops", { ops: [{ op: "clip.rename", args: { name: "ours" } }] });
    await t.until((s) => s.clip?.name === "ours" && s.dirty === true, "renamed");
    await t.press("Control+s");
    await t.byId("reload").click();
    await t.until((s) => s.clip?.length === 90 && !s.dirty, "read again");
    assert.equal(studio.read("shared.clip.json").toString(), theirs);
    await t.press("Control+z");
    await t.until((s) => s.clip?.length === 80 && s.clip.name === "ours", "brought back");
    studio.file("shared.clip.json", theirs.replace('"length": 90', '"length": 95'));
    await t.press("Control+s");
    await t.byId("overwrite").click();
    await t.until((s) => !s.dirty, "overwritten");
    assert.match(studio.read("shared.clip.json").toString(), /"length": 80/);
  });

  test("takes: pin, name, compare, by keyboard and in every page", async () => {
    await afresh();
    await t.until(
      (s) => s.takes.some((k) => k.rev === 0 && k.policy === "computed-torque"),
      "the rollout is a take",
    );
    await t.press("Shift+B");
    const pinned = (await t.until((s) => s.takes.some((k) => k.pinned), "pinned")).takes.find(
      (k) => k.pinned,
    );
    assert.ok(pinned);
    await t.panel("takes");
    await t.page.getByRole("button", { name: `Rename ${pinned.name}` }).click();
    await t.page.getByLabel(`Name of ${pinned.name}`).fill("by the book");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.takes.some((k) => k.name === "by the book"), "named");
    // Another policy on the same goals: another take, and an error to compare with.
    await t.byId("policy").selectOption("zero");
    await t.until(
      (s) =>
        s.takes.some((k) => k.policy === "zero") &&
        s.rollout?.policy === "zero" &&
        s.rollout.phase === "done",
      "performed otherwise",
    );
    assert.equal(await inStrip(t, MAGENTA), 0, "nothing stands beside yet");
    await t.press("b");
    const both = await t.until((s) => s.compared.length === 1 && s.takeFrames.length === 1, "compared");
    assert.equal(
      both.takes.find((k) => k.id === both.compared[0])?.name,
      "by the book",
      "the pinned one goes first",
    );
    await t.page.waitForFunction(() =>
      document.querySelector('[data-testid="curves"]')?.textContent?.includes("by the book"),
    );
    await eventually(async () => (await inStrip(t, MAGENTA)) >= 20, "its error is drawn over the strip");
    await t.picture("takes-compared");
    // Several at once, as curves.
    const other = both.takes.find((k) => k.policy === "zero");
    await t.page.getByRole("button", { name: `A/B ${other?.name}` }).click({ modifiers: ["Control"] });
    await t.until((s) => s.compared.length === 2 && s.takeFrames.length === 2, "two beside");
    await t.page.waitForFunction(
      (name) => document.querySelector('[data-testid="curves"]')?.textContent?.includes(name),
      other?.name ?? "",
    );
    // Another page knows them, and so does this one when it comes back.
    const second = await tab(studio, { width: 1100, height: 700 });
    const seen = await second.until((s) => s.compared.length === 2, "the same there");
    assert.deepEqual(seen.takes, (await t.state()).takes);
    await second.panel("takes");
    await second.page.getByRole("button", { name: "Stop comparing" }).click();
    await t.until((s) => s.compared.length === 0, "heard of it");
    await t.page.reload();
    const back = await t.until(
      (s) => s.link === "open" && s.takes.length === seen.takes.length,
      "after a reload",
    );
    assert.ok(back.takes.some((k) => k.name === "by the book" && k.pinned));
    await second.page.getByRole("button", { name: `Remove by the book` }).click();
    await t.until((s) => !s.takes.some((k) => k.name === "by the book"), "removed in both");
    await second.context.close();
    assert.deepEqual(t.errors, []);
  });

  test("the name of a take is typed while the clip is performed again", async () => {
    await afresh();
    await t.press("Shift+B");
    const { takes } = await t.until((s) => s.takes.some((k) => k.pinned && k.rev === s.rev), "pinned");
    const own = takes.find((k) => k.pinned && k.rev === 0);
    assert.ok(own);
    await t.panel("takes");
    const row = t.byId(`take-${own.id}`);
    await row.getByRole("button", { name: /^Rename/ }).click();
    const field = row.getByRole("textbox");
    await field.fill("half a na");
    await studio.api("POST", "/api/ops", {
      ops: [{ op: "keys.set", args: { frame: 30, values: { elbow: 1.3 } } }],
    });
    await t.until((s) => s.rev === 1, "edited");
    await t.rolledOut();
    assert.equal(await field.inputValue(), "half a na");
    await field.press("End");
    await t.page.keyboard.type("me");
    await t.page.keyboard.press("Enter");
    await t.until((s) => s.takes.some((k) => k.name === "half a name"), "named");
    await row.getByRole("button", { name: /^Remove/ }).click();
    await t.until((s) => !s.takes.some((k) => k.id === own.id), "removed");
  });

  test("a take of other goals says so", async () => {
    await afresh();
    await t.byId("policy").selectOption("computed-torque");
    await t.until(
      (s) => s.takes.some((k) => k.same_goals && k.policy === "computed-torque" && k.rev === s.rev),
      "performed",
    );
    await t.goTo(40);
    await t.press("k");
    const s = await t.until((x) => x.rev === 1 && x.takes.some((k) => k.rev === 1), "edited and performed");
    assert.ok(s.takes.some((k) => !k.same_goals));
    assert.match(
      (await t.page.locator(".takes .stale").first().getAttribute("title")) ?? "",
      /cannot be compared/,
    );
  });

  test("ten edits leave two takes; the table says which is best, and the rest go by one press", async () => {
    await afresh();
    await t.byId("policy").selectOption("computed-torque");
    await t.until(
      (s) => s.takes.some((k) => k.same_goals && k.policy === "computed-torque" && k.rev === s.rev),
      "performed",
    );
    const first = (await t.state()).takes.length;
    for (let i = 1; i <= 10; i++) {
      await studio.api("POST", "/api/ops", {
        ops: [{ op: "keys.set", args: { frame: 30, values: { elbow: 1.4 + 0.01 * i } } }],
      });
      await t.until((s) => s.takes.some((k) => k.rev === i && k.same_goals), `edit ${i} performed`);
    }
    const edited = await t.state();
    assert.equal(edited.takes.length, first + 1, "what was before, and what is now");
    for (const policy of ["zero", "pd"]) {
      await t.byId("policy").selectOption(policy);
      await t.until((s) => s.takes.some((k) => k.policy === policy && k.rev === s.rev), policy);
    }
    await t.page.getByRole("tab", { name: "Compare" }).click();
    const table = t.byId("take-table");
    const { takes } = await t.state();
    const alike = takes.filter((k) => k.same_goals);
    const by = (of: (k: (typeof takes)[number]) => number | null): number[] =>
      [...alike].sort((a, b) => (of(a) ?? 9) - (of(b) ?? 9)).map((k) => k.id);
    const order = async (): Promise<number[]> =>
      (
        await table
          .locator("tbody tr:not(.stale)")
          .evaluateAll((all) => all.map((e) => e.getAttribute("data-testid") ?? ""))
      ).map((id) => Number(id.slice(4)));
    assert.ok(alike.length >= 3);
    assert.deepEqual(
      await order(),
      by((k) => k.mae),
      "by error first",
    );
    const jolts = table.getByRole("button", { name: /^Jerk/ });
    await jolts.click();
    await eventually(
      async () => JSON.stringify(await order()) === JSON.stringify(by((k) => k.jerk)),
      "by smoothness",
    );
    const torque = alike.find((k) => k.policy === "computed-torque");
    const row = t.byId(`row-${torque?.id}`);
    assert.match(await row.innerText(), new RegExp(torque?.worst_joint ?? "no joint"));
    assert.equal(await table.locator(".best").count(), 3, "the best of each column");
    await t.picture("take-table");
    await row.getByRole("button").click();
    await t.until((s) => s.compared.join() === String(torque?.id), "drawn beside");
    await table.getByRole("button", { name: /Remove the others/ }).click();
    const left = await t.until((s) => s.takes.length < takes.length, "fewer");
    assert.ok(
      left.takes.some((k) => k.id === by((x) => x.jerk)[0]) && left.takes.some((k) => k.policy === "pd"),
      "the best and the current one stay",
    );
    await t.page.getByRole("tab", { name: "Curves" }).click();
    await t.press("b");
    await t.until((s) => s.compared.length === 0, "nothing beside");
  });

  test("Open walks through folders by keyboard and shows what lies there", async () => {
    studio.file("walks/north/a.clip.json", ARM.replace('"arm"', '"north wind"'));
    studio.file("walks/notes.txt", "nothing");
    studio.file("log.csv", CSV);
    await t.press("Control+o");
    await t.byId("dir-walks").waitFor();
    assert.equal(await t.byId("dir-state").count(), 1, "a folder like any other");
    await t.picture("open");
    const field = t.page.getByLabel("File", { exact: true });
    await field.fill("wal");
    await t.page.keyboard.press("ArrowDown");
    await t.page.keyboard.press("Enter");
    await t.byId("dir-north").waitFor();
    await t.page.getByText("1 other file is not shown").waitFor();
    await field.fill("");
    await t.press("ArrowDown", "ArrowDown", "Enter");
    await t
      .byId("at-a.clip.json")
      .getByText(/north wind · ur5e · 4 s · 3 keys/)
      .waitFor();
    await t.press("ArrowDown", "ArrowDown", "Enter");
    const s = await t.until((x) => x.clip?.name === "north wind", "opened");
    assert.equal(s.dirty, false);
    assert.equal(
      (await studio.api("GET", "/api/state")).json().document.path,
      studio.file("walks/north/a.clip.json"),
    );
    // What leads out of the folder is refused, in words.
    const out = await studio.api("GET", "/api/files?dir=..");
    assert.equal(out.status, 400);
  });

  test("a command in a folder becomes a clip, as one that is dropped does", async () => {
    const { joints } = JSON.parse(ARM).robot;
    const rows = Array.from({ length: 30 }, (_, f) => [-1.5 + f / 100, -1.5, 1.5, -1.5, -1.5]);
    const command = { format: "robert-command/1", robot: "ur5e", fps: 20, joints, start: rows[0], q: rows };
    studio.file("told.json", JSON.stringify(command));
    await t.press("Control+o");
    await t.byId("at-told.json").click();
    const s = await t.until((x) => x.clip?.name === "told", "opened");
    assert.equal(s.clip?.length, 30);
    assert.deepEqual(await t.page.getByRole("alert").allInnerTexts(), [], "nothing was refused");
  });

  test("a CSV and MJCF keys come in by the picker, a drop and a folder", async () => {
    // By the picker, from the File menu, with the keyboard; asked for early, as a picker that opens
    // before Playwright has taken it over is the browser's own.
    const chooser = t.page.waitForEvent("filechooser");
    await t.byId("file-menu").focus();
    await t.press("ArrowDown");
    await t.byId("menu-open").waitFor();
    await t.picture("file-menu");
    await t.press("ArrowDown", "ArrowDown");
    await t.press("Enter");
    await (await chooser).setFiles({ name: "table.csv", mimeType: "text/csv", buffer: Buffer.from(CSV) });
    const csv = await t.until((s) => s.clip?.name === "table", "the table is a clip");
    assert.deepEqual(
      csv.clip?.keys.map((k) => k.frame),
      [0, 10, 20],
    );
    assert.equal(csv.clip?.robot.id, "ur5e", "of the robot that was open");
    // Dropped.
    const drop = (name: string, text: string, type: "dragenter" | "drop"): Promise<void> =>
      t.page.evaluate(
        ([n, x, kind]) => {
          const data = new DataTransfer();
          data.items.add(new File([x as string], n as string));
          document.body.dispatchEvent(
            new DragEvent(kind as string, { dataTransfer: data, bubbles: true, cancelable: true }),
          );
        },
        [name, text, type],
      );
    await drop("poses.xml", MJCF, "dragenter");
    await t.byId("drop").waitFor();
    await t.picture("drop");
    await drop("poses.xml", MJCF, "drop");
    await t.byId("drop").waitFor({ state: "detached" });
    const keys = await t.until((s) => s.clip?.name === "poses", "keys of an MJCF");
    assert.deepEqual(
      keys.clip?.keys.map((k) => k.frame),
      [0, 20],
    );
    // Bad ones say where, as the shell does; the clip that is open stays.
    await drop("bad.csv", "frame,nose\n0,1\n", "drop");
    await t.page
      .getByRole("alert")
      .filter({ hasText: /bad\.csv:1:\d+/ })
      .waitFor();
    await drop("words.docx", "x", "drop");
    await t.page.getByRole("alert").filter({ hasText: "words.docx: only .clip.json" }).waitFor();
    assert.equal((await t.state()).clip?.name, "poses");
    // Without a clip nobody knows whose it is: the page asks.
    await studio.api("POST", "/api/close");
    await t.until((s) => s.page === "gallery", "nothing is open");
    await drop("table.csv", CSV, "drop");
    await t.byId("whose").selectOption("ur5e");
    await t.page.getByRole("button", { name: "Open", exact: true }).click();
    await t.until((s) => s.page === "editor" && s.clip?.name === "table", "opened for the arm");
    assert.deepEqual(t.errors, []);
  });

  test("export: laid over, camera, moments, side by side with a take", async () => {
    await afresh();
    await t.byId("policy").selectOption("zero");
    await t.until(
      (s) => s.takes.some((k) => k.rev === 0 && k.policy === "zero") && s.rollout?.phase === "done",
      "a take",
    );
    await t.byId("policy").selectOption("computed-torque");
    await t.until(
      (s) =>
        s.takes.some((k) => k.rev === 0 && k.policy === "computed-torque") &&
        s.rollout?.policy === "computed-torque" &&
        s.rollout.phase === "done",
      "another",
    );
    const zero = (await t.state()).takes.find((k) => k.policy === "zero" && k.rev === 0);
    await t.press("Control+e");
    await t.byId("format-strip").check();
    await t.byId("overlay-trail").uncheck();
    await t.byId("overlay-axes").check();
    await t.byId("export-camera").fill("top");
    await t.byId("export-moments").fill("2");
    await t.byId("export-beside").selectOption(String(zero?.id));
    await t.byId("export-path").fill("both.png");
    await t.picture("export-options");
    await t.byId("export-folder").click();
    await t.byId("export-said").filter({ hasText: "both.png" }).waitFor();
    const jobs = (await studio.api("GET", "/api/jobs")).json() as { args: string[] }[];
    const line = jobs.at(-1)?.args.join(" ") ?? "";
    for (const part of [
      "--strip 2",
      "--overlay ghost,error,caption,axes",
      "--camera top",
      "--compare-policy zero",
    ])
      assert.ok(line.includes(part), `${part} in ${line}`);
    const png = studio.read("both.png");
    // Two moments, each of two pictures of 640 beside each other.
    assert.ok(png.readUInt32BE(16) >= 2 * 2 * 640, `${png.readUInt32BE(16)} wide`);
    await t.byId("format-apng").check();
    await t.byId("export-path").fill("film.apng");
    await t.byId("export-camera").fill("nowhere");
    await t.byId("export-folder").click();
    await t.byId("export-said").filter({ hasText: "nowhere" }).waitFor();
    await t.press("Escape");
  });

  test("pinned takes outlive the studio until they are removed; a damaged one is named", async () => {
    const first = await Studio.start();
    const p = await armTab(first);
    const files = (): string[] => {
      const dir = first.file("state/takes");
      return existsSync(dir) ? readdirSync(dir).sort() : [];
    };
    try {
      await p.panel("policies");
      await p.press("Shift+B");
      await p.until((s) => s.takes.some((k) => k.pinned), "one is pinned");
      for (const seed of [7, 8]) {
        const pinned = (await p.state()).takes.filter((k) => k.pinned).length;
        await p.byId("seed").fill(String(seed));
        await p.byId("seed").press("Enter");
        await p.until((s) => s.settings.seed === seed, "another seed");
        await p.blur();
        await p.rolledOut();
        await p.until((s) => s.takes.some((k) => k.seed === seed), "another take");
        await p.press("Shift+B");
        await p.until((s) => s.takes.filter((k) => k.pinned).length > pinned, "and pinned");
      }
      const before = (await p.state()).takes.filter((k) => k.pinned);
      assert.equal(files().length, 3);
      const motion = (await first.api("GET", `/api/takes/${before[0]?.id}`)).json();
      // As a power cut would, with one file that the disk has damaged.
      await first.kill();
      const [oldest = ""] = files();
      const damaged = first.file(`state/takes/${oldest}`);
      const bytes = readFileSync(damaged);
      bytes[bytes.length >> 1] = (bytes[bytes.length >> 1] ?? 0) ^ 1;
      writeFileSync(damaged, bytes);
      await first.run();
      await first.api("POST", "/api/new", { text: ARM });
      await p.open();
      const back = await p.until((s) => s.takes.filter((k) => k.pinned).length === 2, "they are back");
      await p.page.getByRole("alert").getByText("a pinned take cannot be read and is left out").waitFor();
      await p.picture("takes-kept");
      const known = back.takes.find((k) => k.id === before[0]?.id);
      assert.deepEqual(
        { ...known, rev: 0, same_goals: true },
        { ...before[0], rev: 0, same_goals: true },
        "name, policy, seed and figures are those from before",
      );
      assert.deepEqual((await first.api("GET", `/api/takes/${known?.id}`)).json(), motion);
      assert.ok(existsSync(damaged), "what cannot be read is not thrown away");
      await p.panel("takes");
      await p.page.getByRole("button", { name: `Remove ${known?.name}` }).click();
      await p.until((s) => s.takes.filter((k) => k.pinned).length === 1, "removed");
      assert.equal(files().length, 2, "its file is gone, too");
      assert.deepEqual(p.errors, []);
    } finally {
      await p.context.close();
      await first.end();
    }
  });

  test("a studio that was started anew is told from one that is gone", async () => {
    const first = await Studio.start();
    const port = Number(new URL(first.url).port);
    const p = await tab(first);
    await first.kill();
    await p.page.getByText("The studio has stopped").waitFor();
    await p.page.getByText("Nothing answers at this address").waitFor();
    await p.picture("gone");
    try {
      await first.run(port);
      await p.byId("moved").waitFor();
      assert.match(
        (await p.byId("moved").innerText()).replace(/\s+/g, " "),
        /Open the address that robert studio printed last/,
      );
      await p.picture("moved");
      // Its address differs in the token only: the same page, let in again.
      await p.page.evaluate((token) => (location.hash = `token=${token}`), first.token);
      await p.until((s) => s.link === "open", "let in again");
      await p.byId("moved").waitFor({ state: "detached" });
      assert.equal(new URL(p.page.url()).hash, "", "the token does not stay in the address");
    } finally {
      await p.context.close();
      await first.end();
    }
  });
});
