// What a hand does on the robot: pulls fingertips and end effectors, locks joints, sees what it
// is over; with still pictures, and in the real 3D view.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { ARM, before, describe, eventually, inView, onTheArm, type Studio, type Tab, test } from "./harness";
import { apart, camera, drawn, meshesOf, type Spot, under, viser } from "./scene";

const LEG = `<mujoco><worldbody><body name="hip" pos="0 0 2"><joint name="swing" axis="0 1 0" range="-60 60" limited="true"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.8" size=".06"/><body name="shin" pos="0 0 -.8"><joint name="knee" axis="0 1 0" range="0 120" limited="true"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.7" size=".05"/></body></body></worldbody></mujoco>`;
const CART = `<mujoco><worldbody><body name="cart" pos="5 -3 .05"><joint name="x" type="slide" axis="1 0 0" range="-.1 .1" limited="true"/>
  <geom type="box" size=".02 .01 .01"/></body></worldbody></mujoco>`;

function importRobot(studio: Studio, id: string, xml: string): void {
  studio.file(`${id}.xml`, xml);
  const ran = studio.shell("import", `${id}.xml`, "--out", `robots/${id}`, "--id", id);
  assert.equal(ran.code, 0, ran.err);
}

describe("a hand, with still pictures", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  const afresh = async (): Promise<void> => {
    await t.afresh();
    await t.until((s) => s.locked.length === 0, "nothing locked");
    await t.press("Shift+F", "Home", "Escape");
    await t.rolledOut();
  };
  /** Of the picture that is on the page. */
  const picture = (): Promise<string> =>
    t
      .byId("still-view")
      .evaluate(async (img: HTMLImageElement) => {
        await img.decode();
        const canvas = Object.assign(document.createElement("canvas"), {
          width: img.naturalWidth,
          height: img.naturalHeight,
        });
        canvas.getContext("2d")?.drawImage(img, 0, 0);
        return canvas.toDataURL();
      })
      .then((pixels) => createHash("sha1").update(pixels).digest("hex"));
  /** When nothing newer is on its way. */
  const settled = async (): Promise<string> => {
    await t.page.locator('[data-testid="still-view"][aria-busy="false"]').waitFor();
    return picture();
  };
  const another = (than: string, what: string): Promise<string> =>
    eventually(async () => {
      const now = await settled();
      return now !== than && now;
    }, `another picture: ${what}`);
  const tip = async (): Promise<number[]> =>
    Promise.all(["x", "y", "z"].map(async (a) => Number(await t.byId(`reach-${a}`).inputValue())));

  test("the end effector is chosen by key or button, and arrow keys pull it", async () => {
    await afresh();
    await t.goTo(15);
    await t.press("g");
    await t.until((s) => s.site === "end_effector", "chosen by G");
    const [x0, y0, z0] = await tip();
    const key = (await t.state()).clip?.keys.length ?? 0;
    for (let i = 0; i < 4; i++) await t.byId("reach-z").press("ArrowUp");
    await t.byId("reach-y").press("Shift+ArrowDown");
    const s = await t.until((q) => (q.clip?.keys.length ?? 0) === key + 1, "a key where there was none");
    assert.ok(s.clip?.keys.some((k) => k.frame === 15));
    await t.page.waitForFunction(
      (z) =>
        Math.abs(Number((document.querySelector('[data-testid="reach-z"]') as HTMLInputElement).value) - z) <
        0.0015,
      (z0 ?? 0) + 0.02,
    );
    const [x1, y1] = await tip();
    assert.ok(
      Math.abs((x1 ?? 9) - (x0 ?? 0)) < 0.002 && Math.abs((y1 ?? 9) - ((y0 ?? 0) - 0.001)) < 0.002,
      "only as far as it was told",
    );
    await t.byId("reach-z").fill("9");
    await t.byId("reach-z").press("Enter");
    await t.page
      .getByText(/stops \d+ mm short/)
      .first()
      .waitFor();
    await t.picture("reach");
    await t.byId("site-end_effector").click();
    await t.until((q) => q.site === undefined, "given back");
  });

  test("a locked joint is moved by no slider, reach, pose or paste", async () => {
    await afresh();
    const elbow = async (frame: number): Promise<number | null | undefined> =>
      (await t.state()).clip?.keys.find((k) => k.frame === frame)?.q?.[2];
    const p = await t.at(0, "elbow");
    const box = await t.box("timeline");
    // The switch in the row's label.
    await t.page.mouse.click(box.x + 168 - 34, p.y);
    await t.until((s) => s.locked.join() === "elbow", "locked by its switch");
    const slider = t.page.locator("#joint-2");
    assert.ok(await slider.isDisabled());
    await t.picture("locked");
    await t.goTo(30);
    const held = await elbow(30);
    await t.byId("site-end_effector").click();
    await t.until((s) => s.site === "end_effector", "chosen");
    await t.byId("reach-z").press("ArrowUp");
    await t.until((s) => s.rev === 1, "reached");
    assert.equal(await elbow(30), held);
    await t.page.keyboard.press("Escape");
    await t.panel("poses");
    await t.byId("pose-home").click();
    await t.until((s) => (s.rev ?? 0) >= 2, "the pose applied");
    assert.equal(await elbow(30), held, "the pose leaves it");
    await t.clickKey(60);
    await t.press("Control+c");
    await t.goTo(30);
    await t.press("Control+v");
    await t.until((s) => (s.rev ?? 0) >= 3, "pasted");
    assert.equal(await elbow(30), held, "so does the paste");
    assert.notEqual(held, await elbow(60));
    await t.goTo(45);
    await t.press("k");
    const made = (await t.until((s) => s.clip?.keys.some((k) => k.frame === 45) === true, "a key")).clip
      ?.keys;
    const q = made?.find((k) => k.frame === 45)?.q;
    assert.ok(q?.[2] === null && q[0] !== null, "a new key says nothing about it");
    await t.page.mouse.click(box.x + 40, p.y);
    await t.press("Alt+l");
    await t.until((s) => s.locked.length === 0, "free again by its key");
    assert.ok(!(await slider.isDisabled()));
  });

  test("one joint is masked by its switch, unless the policy knows whole frames only", async () => {
    await afresh();
    await t.goTo(40);
    const box = await t.byId("timeline").boundingBox();
    const p = await t.at(0, "elbow");
    assert.ok(box);
    await t.page.mouse.click(box.x + 168 - 14, p.y);
    await t.until((s) => s.clip?.masks?.[0]?.joints?.join() === "elbow", "masked");
    await t.page.mouse.click(box.x + 168 - 14, p.y);
    await t.until((s) => (s.clip?.masks ?? []).length === 0, "and back");
    await t.byId("policy").selectOption("robert:faithful");
    await t.until((s) => s.findings?.granularity === "state", "a policy that was trained on whole frames");
    await t.page.mouse.click(box.x + 168 - 14, p.y);
    await t.page
      .getByText(/whole frames masked/)
      .first()
      .waitFor();
    await t.byId("joint-2").locator(".slider").click();
    assert.equal((await t.state()).rev, 2, "a press alone moves nothing");
    await t.press("Alt+m");
    assert.deepEqual((await t.state()).clip?.masks ?? [], []);
    await t.byId("policy").selectOption("computed-torque");
    await t.until((s) => s.findings?.granularity === "joint", "everything again");
    await t.rolledOut();
  });

  test("sliders show where the policy's data lie, drags of keys how fast joints must go", async () => {
    await afresh();
    for (let j = 0; j < 5; j++) {
      const [from = 0, to = 0] = ((await t.page.locator(`#joint-${j}`).getAttribute("data-band")) ?? "")
        .split(" ")
        .map(Number);
      assert.ok(from >= 0 && to <= 1 && to - from > 0.02, `joint ${j}: ${from} to ${to}`);
    }
    let slow = "";
    let fast = "";
    await t.drag(30, 40, {
      before: async () => {
        await t.byId("demand").waitFor();
        await t.until(
          (s) => s.demand !== undefined && s.demand.needed < (s.demand.usual ?? 0),
          "slow enough",
        );
        slow = await t.byId("demand").innerText();
      },
    });
    await t.until_keys([0, 40, 60]);
    await t.drag(40, 59, {
      steps: 12,
      before: async () => {
        await t.page
          .getByText(/too fast:/)
          .first()
          .waitFor();
        fast = await t.byId("demand").innerText();
        await t.picture("demand");
      },
    });
    assert.match(slow, /needs \d+ °\/s, the policy was trained up to \d+/);
    assert.match(fast, /^too fast: /);
    await t.until((s) => s.demand === undefined, "gone with the drag");
  });

  test("command, achieved and ghosts can be shown or not, and a floating pose is", async () => {
    await afresh();
    await t.goTo(40);
    await t.byId("still-view").waitFor();
    let now = await settled();
    for (const name of ["Achieved", "Ghosts"] as const) {
      await t.toggle(name);
      now = await another(now, name);
      await t.picture(`still-${name}`);
      await t.toggle(name);
      now = await another(now, `${name} again`);
    }
    // Without the solid robot the whole command is to be seen, or nothing.
    await t.toggle("Achieved");
    const command = await another(now, "only the command");
    await t.press("1");
    await another(command, "nothing");
    await t.press("1", "2");
    await t.page.getByRole("button", { name: "Auto-key" }).click();
    const before = await settled();
    await t.byId("joint-0").locator("input[type=text]").fill("-50");
    await t.byId("joint-0").locator("input[type=text]").press("Enter");
    await t.until((s) => s.floating !== undefined, "a floating pose");
    await another(before, "the floating pose");
    await t.picture("still-floating");
    await t.page.getByRole("button", { name: "Discard" }).click();
    await t.page.getByRole("button", { name: "Auto-key" }).click();
  });

  test("the pointer names the link and its value", async () => {
    await afresh();
    const view = await t.box("still-view");
    const [w, h] = [Math.round(view.width), Math.round(view.height)];
    for (let j = 2; j < 16; j++)
      for (let i = 4; i < 20; i++) {
        const [x, y] = [(i + 0.5) / 24, (j + 0.5) / 18];
        const body = (
          await studio.api("GET", `/api/still-body?frame=0&w=${w}&h=${h}&x=${x}&y=${y}`)
        ).json() as string | null;
        if (!/forearm/.test(body ?? "")) continue;
        await t.page.mouse.move(view.x + x * view.width, view.y + y * view.height);
        await t
          .byId("tip")
          .filter({ hasText: /elbow 9\d\.\d°/ })
          .waitFor();
        await t.page.mouse.move(view.x + 4, view.y + view.height - 4);
        await t.byId("tip").waitFor({ state: "detached" });
        return;
      }
    assert.fail("no forearm in the picture");
  });

  test("guide and seed are set, a long rollout is stopped", async () => {
    await afresh();
    await t.panel("policies");
    for (const guide of ["linear", "smooth", "none"]) {
      await t.byId("guide").selectOption(guide);
      await t.until((s) => s.settings.guide === guide, guide);
    }
    await t.byId("seed").fill("7");
    await t.byId("seed").press("Enter");
    await t.until((s) => s.settings.seed === 7 && s.settings.guide === "none", "another seed");
    await t.byId("policy").selectOption("predictive-sampling");
    await t.byId("stop-rollout").waitFor();
    await t.byId("stop-rollout").click();
    const s = await t.until((q) => q.rollout?.phase === "off", "stopped");
    assert.ok((s.rollout?.cached_to ?? 0) < (s.clip?.length ?? 0), "before its end");
    await t.byId("policy").selectOption("computed-torque");
    await t.rolledOut();
  });

  test("a robot that no policy has learned says so, and where to go", async () => {
    importRobot(studio, "leg", LEG);
    const made = await studio.api("POST", "/api/new", { robot: studio.file("robots/leg"), length: 40 });
    assert.equal(made.status, 200, made.bytes.toString());
    await t.until((s) => s.robot === "leg", "the leg");
    await t.byId("no-model").waitFor();
    await t.picture("no-model");
    await t
      .byId("no-model")
      .getByRole("button", { name: /kinematically/ })
      .click();
    await t.until((s) => !s.settings.auto, "nothing is simulated");
    await t
      .byId("no-model")
      .getByRole("button", { name: /kinematically/ })
      .click();
    await t.until((s) => s.settings.auto, "and again");
    await t.byId("no-model").getByRole("button", { name: "Train a small one" }).click();
    await t.byId("runs-robot").waitFor();
    await t.page.waitForFunction(() =>
      /leg/.test((document.querySelector('[data-testid="runs-robot"]') as HTMLSelectElement).value),
    );
    await t.turnTo("editor");
    await afresh();
    assert.equal(await t.byId("no-model").count(), 0, "the arm has one");
  });

  test("no script broke", () => assert.deepEqual(t.errors, []));
});

/** Bounds of the solid robot in the view, -1 to 1. */
const bounds = (v: any): { x0: number; x1: number; y0: number; y1: number; meshes: number } => {
  const b = { x0: 9, x1: -9, y0: 9, y1: -9, meshes: 0 };
  v.camera.updateMatrixWorld();
  v.nodeRefFromName["/robot"]?.traverse((o: any) => {
    const at = o.geometry?.attributes?.position;
    // Outlines hang below their mesh and are hidden; what is drawn has a parent that is shown.
    for (let up = o; up; up = up.parent) if (!up.visible) return;
    if (!o.isMesh || !at || at.count < 4) return;
    o.updateWorldMatrix(true, false);
    b.meshes++;
    const p = v.camera.position.clone();
    const step = Math.max(1, Math.floor(at.count / 400));
    for (let i = 0; i < at.count; i += step) {
      p.fromBufferAttribute(at, i).applyMatrix4(o.matrixWorld).project(v.camera);
      b.x0 = Math.min(b.x0, p.x);
      b.x1 = Math.max(b.x1, p.x);
      b.y0 = Math.min(b.y0, p.y);
      b.y1 = Math.max(b.y1, p.y);
    }
  });
  return b;
};

describe("a hand, in the 3D view", () => {
  let studio: Studio;
  let g: Tab;

  inView((with_, page) => {
    [studio, g] = [with_, page];
  });
  before(async () => {
    await g.toggle("Ghosts", "Command");
    await g.goTo(15);
    await g.rolledOut();
  });
  const forearm = async (): Promise<string> => {
    const facts = (await studio.api("GET", "/api/robot/ur5e")).json() as { bodies: { name: string }[] };
    const name = facts.bodies.find((b) => /forearm/.test(b.name))?.name;
    assert.ok(name);
    return `/robot/${name}`;
  };
  /** A body with the pointer on it, and its name beside it. */
  const named = async (node: string): Promise<Spot> => {
    const p = await under(g, node);
    await g.byId("tip").waitFor();
    return p;
  };

  test("the pointer names the link; views and F move the camera; the selected link is outlined", async () => {
    const node = await forearm();
    await named(node);
    await g
      .byId("tip")
      .filter({ hasText: /elbow \d+\.\d°/ })
      .waitFor();
    await g.picture("hover");
    const home = await camera(g);
    await g.byId("view").selectOption("view-top");
    const above = await eventually(async () => {
      const now = await camera(g);
      return apart(now, home) > 0.3 && now;
    }, "seen from above");
    await g.page.locator("#joint-2").focus();
    await eventually(() => viser(g, (v) => !!v.nodeRefFromName["/selected/shell"]), "outlined");
    await g.page.locator("body").press("f");
    await eventually(async () => apart(await camera(g), above) > 0.1, "F frames the link");
    await g.picture("selected");
    await g.page.locator("body").press("Alt+0");
    await eventually(async () => apart(await camera(g), home) < 0.05, "the whole motion again");
  });

  test("Alt-drag pulls the end effector, Esc gives a drag up", async () => {
    const node = await forearm();
    let p = await named(node);
    await g.page.mouse.down();
    for (let i = 1; i <= 5; i++) {
      await g.page.mouse.move(p.x, p.y + 8 * i);
      await drawn(g);
    }
    await g.until((s) => s.moving !== undefined, "the link follows");
    await g.page.keyboard.press("Escape");
    await g.until((s) => s.moving === undefined, "given up");
    await g.page.mouse.up();
    await drawn(g);
    assert.equal((await g.state()).rev, 0, "nothing was edited");

    p = await named(node);
    await g.page.keyboard.down("Alt");
    await g.page.mouse.down();
    for (let i = 1; i <= 6; i++) {
      await g.page.mouse.move(p.x, p.y - 7 * i);
      await drawn(g);
    }
    await g.until(
      (s) => s.site === "end_effector" && Object.keys(s.moving ?? {}).length >= 2,
      "several joints follow the end effector",
    );
    await g.picture("alt-drag");
    await g.page.mouse.up();
    await g.page.keyboard.up("Alt");
    const s = await g.until((q) => q.clip?.keys.some((k) => k.frame === 15) ?? false, "a key");
    assert.ok((s.history?.len ?? 0) >= 1);
  });

  test("ghosts of neighbouring keys show what is elsewhere, and do not tint what stands there", async () => {
    await g.afresh(
      JSON.stringify({
        ...JSON.parse(ARM),
        keys: [
          { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57], hold: 20 },
          { frame: 40, q: [-1.57, -1.57, 0.9, -1.57, -1.57], hold: 20 },
        ],
      }),
    );
    await g.toggle("Ghosts");
    await g.rolledOut();
    await g.goTo(8);
    await eventually(async () => (await meshesOf(g, "/future")) > 0, "the next key's forearm is elsewhere");
    await eventually(
      async () => (await meshesOf(g, "/past")) === 0,
      "the last key is where the robot holds it: nothing of it is drawn",
    );
    await g.picture("ghosts-held");
    await g.goTo(30);
    await eventually(async () => (await meshesOf(g, "/past")) > 0, "on the way both are elsewhere");
    await g.toggle("Ghosts");
  });

  test("where a key cannot be reached the reachable pose is shown, its distance said, and one click asks for it", async () => {
    await g.afresh(
      JSON.stringify({
        ...JSON.parse(ARM),
        keys: [
          { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57] },
          // Folded back onto itself.
          { frame: 40, q: [-1.57, -1.57, 3.1, 1.5, -1.57], hold: 6 },
        ],
      }),
    );
    await g.rolledOut();
    await g.goTo(42);
    const found = await g.until(
      (s) => s.findings?.lints.some((l) => l.settled) ?? false,
      "the pose was simulated",
    );
    const settled = found.findings?.lints.find((l) => l.settled)?.settled;
    assert.deepEqual(settled?.held, [[40, 46]]);
    const degrees = ((settled?.distance ?? 0) * 180) / Math.PI;
    const said = await g.byId("settled").innerText();
    const figure = Number(/within ([\d.]+)°/.exec(said)?.[1]);
    assert.ok(Math.abs(figure - degrees) < 0.06 * degrees, `${said}: ${degrees}°`);
    assert.ok(said.includes(settled?.joint ?? "?"), said);
    await g.picture("reachable-with-the-robot");
    // The solid robot may be in that very pose.
    await g.press("2");
    await eventually(async () => (await meshesOf(g, "/reachable")) > 0, "the reachable pose");
    await drawn(g);
    await g.picture("reachable");
    await g.press("6");
    await eventually(async () => (await meshesOf(g, "/reachable")) === 0, "not wanted");
    await g.press("6");
    await eventually(async () => (await meshesOf(g, "/reachable")) > 0, "wanted again");
    // On the way there the robot follows.
    await g.goTo(20);
    await eventually(async () => (await meshesOf(g, "/reachable")) === 0, "of the key alone");
    await g.byId("settled").waitFor({ state: "detached" });
    await g.goTo(40);
    await g.byId("use-reachable").click();
    const now = await g.until((s) => s.rev === 1, "one edit");
    const joints = now.clip?.robot.joints ?? [];
    const q = now.clip?.keys.find((k) => k.frame === 40)?.q ?? [];
    for (const [j] of joints.entries())
      assert.ok(Math.abs((q[j] ?? 9) - (settled?.q[j] ?? 0)) < 1e-5, `${joints[j]} as it settles`);
    await g.byId("settled").waitFor({ state: "detached" });
    await eventually(async () => (await meshesOf(g, "/reachable")) === 0, "the command is reachable now");
    await g.press("2");
  });

  test("every robot is in view and wholly posable at three window sizes", async () => {
    importRobot(studio, "leg", LEG);
    importRobot(studio, "cart", CART);
    const rows: string[] = [];
    for (const robot of [
      "pointmass",
      "ur5e",
      "shadow_hand",
      studio.file("robots/leg"),
      studio.file("robots/cart"),
    ]) {
      const made = await studio.api("POST", "/api/new", { robot, length: 40 });
      assert.equal(made.status, 200, made.bytes.toString());
      const id = robot.split("/").at(-1);
      const s = await g.until((q) => q.robot === id && q.page === "editor", robot);
      for (const [width, height] of [
        [1100, 700],
        [1280, 720],
        [1600, 900],
      ] as const) {
        await g.page.setViewportSize({ width, height });
        // The scene comes, the camera is set, the view takes its new shape.
        let last = "";
        const seen = await eventually(async () => {
          const b = await viser(g, bounds);
          const size = await viser(g, (v) => [v.canvas.clientWidth, v.canvas.clientHeight] as number[]);
          const aspect = await viser(g, (v) => v.camera.aspect as number);
          const box = await g.page.locator("iframe").boundingBox();
          const now = JSON.stringify([b, size]);
          const still =
            now === last &&
            b.meshes > 0 &&
            Math.abs((size[0] ?? 0) - (box?.width ?? 0)) < 2 &&
            Math.abs(aspect - (size[0] ?? 1) / (size[1] ?? 1)) < 0.02;
          last = now;
          await drawn(g);
          return still && { b, size };
        }, `${robot} at ${width}x${height}`);
        const { b } = seen;
        const share = ((b.x1 - b.x0) / 2) * ((b.y1 - b.y0) / 2);
        rows.push(`${id} ${width}x${height}: ${(100 * share).toFixed(1)} %`);
        assert.ok(b.x0 >= -1 && b.x1 <= 1 && b.y0 >= -1 && b.y1 <= 1, `${rows.at(-1)} ${JSON.stringify(b)}`);
        assert.ok(share >= 0.1 && share < 0.35, `${rows.at(-1)}: neither lost in the view nor filling it`);
        // A joint that stands in two groups has two, and no two of the same id.
        const ids = await g.page
          .locator('.joint input[type="range"]')
          .evaluateAll((all) => all.map((e) => e.id));
        assert.equal(new Set(ids).size, ids.length);
        assert.equal(
          ids.filter((i) => /^joint-\d+$/.test(i)).length,
          s.clip?.robot.joints.length,
          `${robot}: a control for each joint`,
        );
        const [left, right] = [
          await g.page.locator(".left").boundingBox(),
          await g.page.locator(".right").boundingBox(),
        ];
        assert.ok(
          ((left?.width ?? 0) + (right?.width ?? 0)) / width <= 0.3,
          `panels take ${((left?.width ?? 0) + (right?.width ?? 0)) / width}`,
        );
      }
      await g.picture(`in-view-${id}`);
    }
    console.log(rows.join("\n"));
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(g.foreign, []);
    assert.deepEqual(g.errors, []);
  });
});
