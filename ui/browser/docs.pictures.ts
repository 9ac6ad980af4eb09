// The pictures of the page in the documentation: its main states, dark and light, as they are today.
// `npm run pictures` writes them to docs/media; look at each of them afterwards.

import assert from "node:assert/strict";
import { mkdirSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { ARM, after, before, describe, eventually, Studio, type Tab, test, webgl } from "./harness";
import { drawn } from "./scene";

const MEDIA = join(process.cwd(), "../docs/media");
const SIZE = { width: 1440, height: 900 };

/** A motion with a value at every frame, as a recording is. */
const RECORDED = [
  "frame,shoulder_pan,shoulder_lift,elbow,wrist_1,wrist_2",
  ...Array.from({ length: 120 }, (_, t) =>
    [
      t,
      ...[-1.57, -1.4, 1.4, -1.5, -1.5].map((q, j) => (q + 0.2 * Math.sin(t * 0.05 + j)).toFixed(6)),
    ].join(),
  ),
].join("\n");

for (const theme of ["dark", "light"] as const)
  describe(`pictures, ${theme}`, () => {
    let studio: Studio;
    let t: Tab;
    let close: () => Promise<void>;
    before(async () => {
      // Its name is in the picture of the first page.
      const folder = join(tmpdir(), "motions");
      mkdirSync(folder, { recursive: true });
      studio = await Studio.start([], folder);
      ({ tab: t, close } = await webgl(studio, SIZE, { theme, shadows: "on" }));
    });
    after(async () => {
      await close?.();
      await studio?.end();
    });

    /** When nothing moves any more. */
    const take = async (name: string): Promise<void> => {
      await t.page.evaluate(() => window.__studio.dismissAll());
      await t.blur();
      await t.page.mouse.move(720, 4);
      await t.painted();
      if (t.page.frames().some((f) => f.url().includes("/viser/"))) await drawn(t);
      const png = (await t.page.screenshot()).toString("base64");
      // A quarter of the size, and as good to the eye.
      const webp = await t.page.evaluate(async (data) => {
        const picture = Object.assign(new Image(), { src: `data:image/png;base64,${data}` });
        await picture.decode();
        const { naturalWidth: width, naturalHeight: height } = picture;
        const canvas = Object.assign(document.createElement("canvas"), { width, height });
        canvas.getContext("2d")?.drawImage(picture, 0, 0);
        return canvas.toDataURL("image/webp", 0.92).split(",")[1] ?? "";
      }, png);
      const file = theme === "dark" ? `${name}.webp` : `${name}_light.webp`;
      writeFileSync(join(MEDIA, file), Buffer.from(webp, "base64"));
      // What eyes look at afterwards, where a viewer has no WebP.
      await t.picture(file.replace(".webp", ""));
    };
    const example = async (id: string, policy: string): Promise<void> => {
      await studio.api("POST", `/api/gallery/${encodeURIComponent(id)}`);
      await t.until((s) => s.page === "editor" && s.robot === id.split("/")[0], id);
      await t.byId("policy").selectOption(policy);
      await t.until((s) => s.settings.policy === policy && s.rollout?.phase === "done", policy);
    };

    test("the first page", async () => {
      await studio.api("POST", "/api/new", { text: ARM.replace('"arm"', '"reach around"') });
      await studio.api("POST", "/api/save", { path: "reach.clip.json" });
      await studio.api("POST", "/api/close");
      await t.until((s) => s.page === "gallery", "the first page");
      await t.byId("own-files").locator("img.thumb").first().waitFor();
      await eventually(
        () =>
          t.page.evaluate(() =>
            [...document.querySelectorAll<HTMLImageElement>(".gallery img")].every(
              (i) => i.getBoundingClientRect().top > innerHeight || (i.complete && i.naturalWidth > 0),
            ),
          ),
        "all pictures",
      );
      await t
        .byId("error-shadow_hand/fire")
        .filter({ hasText: /mean error/ })
        .waitFor();
      await take("studio_first");
    });

    test("a robot of one's own", async () => {
      const robert = (...args: string[]): void => {
        const ran = studio.shell(...args);
        assert.equal(ran.code, 0, ran.err);
      };
      const arm = join(process.cwd(), "../examples/arm.urdf");
      robert("new", arm, "--out", "robots/my_arm", "--minutes", "0");
      robert("tasks", "trial", "--robot", "robots/my_arm", "--out", "clips", "--seed", "1");
      // While those ran nothing was asked, and the studio may have closed a connection that was kept.
      const made = await eventually(
        () => studio.api("POST", "/api/open", { path: "clips/reach.clip.json" }),
        "opened",
      );
      assert.equal(made.status, 200, made.bytes.toString());
      await t.until((s) => s.page === "editor" && s.clip?.name === "reach", "the arm");
      await t.byId("policy").selectOption("ridge");
      await t.rolledOut();
      await t.goTo(22);
      await take("my_arm_studio");
    });

    test("the editor", async () => {
      await example("shadow_hand/rsp", "robert");
      await t.goTo(72);
      await take("studio");
    });

    test("the graph", async () => {
      await t.page.getByRole("tab", { name: "Graph" }).click();
      await t.page.locator(".curve-list").getByRole("button", { name: "Middle finger" }).click();
      await t.goTo(72);
      await take("studio_graph");
      await t.page.getByRole("tab", { name: "Timeline" }).click();
    });

    test("takes compared", async () => {
      await t.press("Shift+B");
      await t.until((s) => s.takes.some((k) => k.pinned), "pinned");
      for (const policy of ["pd", "ridge"]) {
        await t.byId("policy").selectOption(policy);
        await t.until((s) => s.takes.some((k) => k.policy === policy) && s.rollout?.phase === "done", policy);
      }
      await t.panel("takes");
      await t.page.getByRole("tab", { name: "Compare" }).click();
      await t.press("b");
      await t.until((s) => s.compared.length === 1 && s.takeFrames.length === 1, "beside");
      await t.goTo(44);
      await take("studio_takes");
      await t.press("b");
      await t.page.getByRole("tab", { name: "Curves" }).click();
      await t.panel("poses");
    });

    test("a path with its keys", async () => {
      await example("ur5e/hang", "robert");
      await t.press("g");
      await t.until((s) => s.site === "end_effector", "the tool");
      await t.goTo(60);
      await take("studio_path");
      await t.press("Escape");
    });

    test("a pose out of reach", async () => {
      await studio.api("POST", "/api/new", {
        text: JSON.stringify({
          ...JSON.parse(ARM),
          name: "fold",
          keys: [
            { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57] },
            // Folded back onto itself.
            { frame: 40, q: [-1.57, -1.57, 3.1, 1.5, -1.57], hold: 10 },
          ],
        }),
      });
      await t.until((s) => s.clip?.name === "fold", "the arm");
      await t.byId("policy").selectOption("robert");
      await t.rolledOut();
      await t.until((s) => s.findings?.lints.some((l) => l.settled) ?? false, "the pose was simulated");
      await t.press("2");
      await t.goTo(42);
      await t.press("Alt+2");
      await take("studio_reachable");
      await t.press("2", "Alt+0");
    });

    test("a recording with an offset", async () => {
      const made = await fetch(new URL("/api/clips?name=recorded.csv&robot=ur5e", studio.url), {
        method: "POST",
        headers: { authorization: `Bearer ${studio.token}`, "content-type": "text/plain" },
        body: RECORDED,
      });
      assert.equal(made.status, 200, await made.text());
      await t.until((s) => s.clip?.name === "recorded", "recorded");
      await t.byId("policy").selectOption("computed-torque");
      await studio.api("POST", "/api/ops", {
        ops: [{ op: "offsets.set", args: { frame: 60, add: { elbow: 0.35 }, in: 10, hold: 1, out: 10 } }],
      });
      await t.until((s) => (s.clip?.offsets ?? []).length === 1, "an offset");
      await t.rolledOut();
      await t.byId("joint-2").locator("input[type=range]").focus();
      await t.goTo(60);
      await take("studio_offset");
    });
  });
