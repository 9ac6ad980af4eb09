import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import {
  type Clip,
  changedBy,
  clock,
  type Key,
  keyEnd,
  newKey,
  parseTime,
  replaced,
  startsAway,
} from "./clip";
import { fitted, fragmentOf, parseFragment } from "./clipboard";
import { commandedAt, stretches } from "./graph/curve";
import { type Changes, dragged } from "./graph/space";
import { endsOf, grown, pivotOf } from "./grow";
import { fixAll, kindsOf } from "./kinds";
import { reordered, spanOf, weight } from "./layers";
import { ANGLES, digitsOf, fixed, inUnits, LENGTHS, parseNumber } from "./numbers";
import { patched } from "./patch";
import { nearest, shown, type Tried, variant, withPolicy } from "./policy";
import type { Guide, Lint, Op, PolicyCard, RobotCard, RolloutSettings, RunCard, Shelf } from "./protocol";
import { acted, ahead, unreachedAt, within } from "./span";
import {
  fit,
  frameToX,
  LABELS,
  MARKERS,
  PRE_ROLL,
  ROW,
  RULER,
  rowsOf,
  rowToY,
  STRIP,
  tick,
  withFrame,
  withRow,
  xToFrame,
  yToRow,
  zoomAt,
} from "./timeline/layout";
import { bands, bars, diamonds, type Glyph, marks, ofPoint, ofRow } from "./timeline/marks";
import { resumeArgs, usualPolicies, usualSuite } from "./training";

const clip: Clip = {
  format: "robert-clip/1",
  robot: { id: "r", joints: ["a", "b", "c"] },
  fps: 20,
  length: 100,
  keys: [
    { frame: 0, q: [0, 0, 0] },
    { frame: 20, q: [1, 2, 3], hold: 5 },
    { frame: 40, q: [0, 0, 0] },
  ],
};

test("typed time is always a whole frame", () => {
  assert.equal(parseTime("2:15", 20), 55);
  assert.equal(parseTime("55f", 20), 55);
  assert.equal(parseTime("55", 20), 55);
  assert.equal(parseTime("2.75s", 20), 55);
  assert.equal(parseTime("later", 20), undefined);
  assert.equal(clock(55, 20), "2.75 s");
});

test("frames and pixels are inverse, and zoom keeps the frame under the pointer", () => {
  const view = fit(100, { width: 900, height: 200 });
  assert.ok(Math.abs(xToFrame(view, frameToX(view, 37)) - 37) < 1e-9);
  const near = zoomAt(view, 400, 1.7);
  assert.ok(Math.abs(xToFrame(near, 400) - xToFrame(view, 400)) < 1e-9);
  assert.ok(frameToX(view, -30) >= LABELS - 1e-9);
});

test("rows fold with their group and can be hit", () => {
  const groups = [{ name: "g", title: "G", joints: [0, 1] }];
  const open = rowsOf(clip, groups, new Set());
  assert.deepEqual(
    open.map((r) => r.kind),
    ["all", "group", "joint", "joint", "joint"],
  );
  const shut = rowsOf(clip, groups, new Set(["g"]));
  assert.deepEqual(
    shut.map((r) => r.kind),
    ["all", "group", "joint"],
  );
  const view = fit(100, { width: 900, height: 200 });
  assert.equal(yToRow(view, rowToY(view, 3) + ROW / 2, open.length), 3);
  assert.equal(yToRow(view, 3, open.length), undefined);
});

test("ruler labels never touch", () => {
  for (let zoom = 0.15; zoom < 60; zoom *= 1.3) assert.ok(tick(zoom, 20).major * zoom >= 55, `${zoom}`);
});

test("a patch replaces, removes and keeps order", () => {
  const next = patched(clip, {
    keys_removed: [40],
    keys_put: [
      { frame: 10, q: [9, 9, 9] },
      { frame: 20, q: [5, 5, 5] },
    ],
    length: 120,
  });
  assert.deepEqual(
    next.keys.map((k) => k.frame),
    [0, 10, 20],
  );
  assert.deepEqual(next.keys[2]?.q, [5, 5, 5]);
  assert.equal(next.length, 120);
  assert.equal(clip.length, 100, "the old document is untouched");
  assert.equal(keyEnd(clip.keys[1]!), 25);
});

test("a pose on a key changes its values only: open joints stay open, equal ones stay out", () => {
  const key: Key = { frame: 20, q: [1, null, 3], hold: 5, note: "wait" };
  const open = { ...clip, keys: [key] };
  assert.deepEqual(changedBy(open, key, [1.5, 9, 3]), { a: 1.5 });
  assert.deepEqual(changedBy(open, key, [1, 0, 3]), {});
  const posed = { ...clip, poses: { p: [7, 7, 7] }, keys: [{ frame: 0, pose: "p" }] };
  assert.deepEqual(changedBy(posed, posed.keys[0]!, [7, 8, 7]), { b: 8 });
});

test("a pose on a key whose goals decide sets all that it has", () => {
  const key: Key = { frame: 20, reach: [{ site: "tip", pos: [0, 0, 0] }] };
  assert.deepEqual(changedBy(clip, key, [1, null, 3]), { a: 1, c: 3 });
});

test("a dragged key takes over what it says nothing about from the key on which it lands", () => {
  const c: Clip = {
    ...clip,
    keys: [
      { frame: 0, q: [1, null, null], tangents: { a: 1, b: 1 } },
      { frame: 20, q: [4, 5, null], tangents: { a: 2, b: 2 }, hold: 5 },
    ],
  };
  const to = new Map([[0, 20]]);
  const landed = (changes: Changes) => dragged(c, changes, to).keys;
  assert.deepEqual(landed(new Map()), [{ frame: 20, q: [1, 5, null], tangents: { a: 1, b: 2 } }]);
  assert.deepEqual(landed(new Map([[0, new Map([[0, 9]])]]))[0]?.q, [9, 5, null]);
  assert.deepEqual(
    dragged(c, new Map(), new Map([[0, 10]])).keys.map((k) => k.frame),
    [10, 20],
    "nothing is there",
  );
});

test("keys are pasted joint by joint into a clip of another order and another robot", () => {
  const from: Clip = {
    ...clip,
    robot: { id: "s", joints: ["c", "x", "a"] },
    poses: { p: [3, 9, 1], own: [3, 9, 2] },
    keys: [
      { frame: 0, q: [3, 9, null], tangents: { c: 1, x: 2 } },
      { frame: 5, pose: "p" },
      { frame: 6, pose: "own" },
      { frame: 7, q: [null, 9, null] },
      { frame: 8, reach: [{ site: "tip", pos: [0, 0, 0] }] },
      { frame: 9, reach: [{ body: "hand", pos: [0, 0, 0] }] },
    ],
  };
  const into: Clip = { ...clip, poses: { p: [1, null, 3], own: [0, 0, 0] } };
  const text = JSON.stringify(fragmentOf(from, from.keys));
  const pasted = fitted(parseFragment(text)!, into, ["tip"]);
  assert.deepEqual(pasted.keys, [
    { frame: 0, q: [null, null, 3], tangents: { c: 1 } },
    { frame: 5, pose: "p" },
    { frame: 6, q: [2, null, 3] },
    { frame: 8, reach: [{ site: "tip", pos: [0, 0, 0] }] },
  ]);
  assert.deepEqual(pasted.left, ["x", "hand"]);
  const stranger = { ...into, robot: { id: "r", joints: ["d"] } };
  assert.deepEqual(fitted(parseFragment(text)!, stranger, ["tip"]).keys, []);
  assert.equal(parseFragment('{"format": "robert-command/1"}'), undefined);
  assert.equal(parseFragment("frame,a"), undefined);
});

test("keys that others would land on are counted", () => {
  assert.equal(replaced(clip, [20]), 1);
  assert.equal(replaced(clip, [21, 41]), 0);
  assert.equal(replaced(clip, [20, 40], [0, 20]), 1, "20 leaves, 40 stays and is lost");
  assert.equal(replaced(clip, [40], []), 1, "a copy leaves nothing");
});

test("M and U mean the selection, then the loop, then the interval", () => {
  const range = { from: 3, to: 90 };
  const at = (selected: number[], r: typeof range | undefined, playhead: number) => {
    const s = acted(clip, new Set(selected), r, playhead);
    return s && [s.from, s.to];
  };
  assert.deepEqual(at([0, 40], range, 70), [1, 40], "what is selected goes before the loop");
  assert.deepEqual(at([20], range, 70), [25, 40], "one key: what follows its hold");
  assert.deepEqual(at([], range, 70), [3, 90], "the loop");
  assert.deepEqual(at([], undefined, 10), [1, 20], "the interval");
  assert.deepEqual(at([], undefined, 70), [41, 100], "to the end of the clip");
  const close = {
    ...clip,
    keys: [
      { frame: 4, q: [0, 0, 0] },
      { frame: 5, q: [0, 0, 0] },
    ],
  };
  assert.equal(acted(close, new Set([4, 5]), undefined, 4), undefined, "nothing between neighbours");
  assert.equal(
    acted(
      {
        ...clip,
        keys: [
          { frame: 4, hold: 2, q: [] },
          { frame: 6, q: [] },
        ],
      },
      new Set(),
      undefined,
      4,
    ),
    undefined,
    "no frames between",
  );
});

test("a loop lasts as many frames as it has, on the page as in the 3D view", () => {
  const span = { from: 20, to: 30 };
  const shown: number[] = [];
  let at: number | undefined = 20;
  for (let i = 0; i < 40 && at !== undefined; i++) {
    shown.push(Math.floor(at));
    at = ahead(at, 1, span, true);
  }
  assert.deepEqual(
    shown.slice(0, 11),
    [20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 20],
    "the last frame stands, too",
  );
  // The rule of the server: from + (at - from) mod (to - from).
  for (let n = 0; n < 300; n += 0.37) {
    let stepped: number | undefined = 22.5;
    for (const part of [0.3, 0.7]) stepped = ahead(stepped ?? 0, n * part, span, true);
    const whole = 20 + ((2.5 + n) % 10);
    const apart = Math.abs((stepped ?? 0) - whole);
    assert.ok(Math.min(apart, 10 - apart) < 1e-9, `${n}: ${stepped} ${whole}`);
  }
  assert.equal(ahead(28.5, 1, span, false), undefined, "once: it ends at the last frame");
  assert.equal(ahead(5, 1, span, true), 6, "before the loop it runs into it");
});

test("a loop does not outlast the clip", () => {
  assert.deepEqual(within({ from: 10, to: 60 }, 40), { from: 10, to: 40 });
  assert.deepEqual(within({ from: 10, to: 60 }, 100), { from: 10, to: 60 });
  assert.equal(within({ from: 50, to: 60 }, 40), undefined);
  assert.equal(within(undefined, 40), undefined);
});

test("the timeline follows the playhead and the row of the keys", () => {
  const box = { width: 900, height: 200 };
  const near = zoomAt(fit(1000, box), 400, 20);
  for (const frame of [0, 3, 500, 999]) {
    const x = frameToX(withFrame(near, box, frame, 1000), frame);
    assert.ok(x >= LABELS && x <= box.width, `frame ${frame} at ${x}`);
  }
  const whole = fit(100, box);
  assert.equal(withFrame(whole, box, 50, 100), whole, "what is in sight stays where it is");
  assert.equal(withFrame(whole, box, 99, 100), whole, "the end of a clip that is whole in sight, too");
  const last = withFrame(near, box, 999, 1000);
  assert.ok(xToFrame(last, box.width) <= 1004 + 1e-9, "nothing behind the end is shown");
  assert.ok(withFrame(near, box, 0, 1000).left >= -PRE_ROLL - 1e-9);
  for (const r of [0, 7, 22]) {
    const y = rowToY(withRow({ ...whole, top: 100 }, box, r), r);
    assert.ok(y >= RULER + MARKERS && y + ROW <= box.height - STRIP, `row ${r} at ${y}`);
  }
});

test("a patch can change where the clip starts, and take that back", () => {
  const started = patched(clip, { start: { q: [1, 2, 3] } });
  assert.deepEqual(started.start, { q: [1, 2, 3] });
  assert.equal(patched(started, { start: null }).start, undefined);
});

test("only keys in sight are laid out, with the one whose bar reaches in", () => {
  const many: Clip = {
    ...clip,
    length: 2000,
    keys: Array.from({ length: 2000 }, (_, f) => ({ frame: f, q: [f, 0, 0] })),
  };
  const box = { width: 900, height: 200 };
  const none = new Map<number, number>();
  const near = { zoom: 20, left: 1000, top: 0 };
  const shown = marks(many, near, box, none, new Set()).map((m) => m.frame);
  assert.ok(
    shown.length < 45 && shown.includes(999) && shown.includes(1000) && shown.includes(1036),
    shown.join(),
  );
  const sparse: Clip = {
    ...clip,
    length: 2000,
    fill: "linear",
    keys: [
      { frame: 0, q: [0, 0, 0] },
      { frame: 1999, q: [0, 0, 0] },
    ],
  };
  assert.deepEqual(
    marks(sparse, near, box, none, new Set()).map((m) => m.frame),
    [0],
    "its line crosses what is in sight",
  );
  assert.equal(bars(marks(sparse, near, box, none, new Set())).length, 1);
  const dragged = marks(many, near, box, new Map([[5, 1010]]), new Set([5]));
  assert.ok(
    dragged.some((m) => m.frame === 5 && m.selected),
    "a key dragged into sight",
  );
});

test("of keys for some joints only, those are laid out whose bars reach into sight", () => {
  // The first joint has a key at frame 0 and at the end, the second one at every frame between.
  const many: Clip = {
    ...clip,
    length: 2000,
    fill: "linear",
    keys: Array.from({ length: 2000 }, (_, f) => ({
      frame: f,
      q: f === 0 || f === 1999 ? [f, null, null] : [null, f, null],
    })),
  };
  const box = { width: 900, height: 200 };
  const near = { zoom: 20, left: 1000, top: 0 };
  const list = marks(many, near, box, new Map(), new Set());
  const shown = list.map((m) => m.frame);
  assert.ok(shown.length < 45 && shown.includes(0) && shown.includes(999), shown.join());
  const bar = (joint: number) =>
    bars(ofRow(list, [joint])).map((b) => [b.ink, near.left + (b.from - LABELS) / near.zoom, b.to]);
  assert.deepEqual(bar(0), [["linear", 1, frameToX(near, 1999)]]);
  assert.deepEqual(bar(2), []);
  // A key that is dragged away lets the bar of the key before it reach into sight.
  const from = { ...near, left: 0 };
  const away = marks(many, from, box, new Map([[2, 1500]]), new Set([2]));
  assert.equal(bars(ofRow(away, [1])).length, 1);
  assert.ok(!away.some((m) => m.frame === 2));
});

test("a band of dense motion has all of its keys, also while one is dragged past others", () => {
  const glyph = (x: number) => ({ x }) as Glyph;
  const xs = Array.from({ length: 100 }, (_, i) => 200 + 2 * i);
  const of = (moved: number) => bands(xs.map((x, i) => glyph(i === 50 ? moved : x)));
  assert.deepEqual(of(300), [{ from: 200, to: 398 }]);
  assert.deepEqual(of(250), [{ from: 200, to: 398 }], "among others");
  assert.deepEqual(of(500), [
    { from: 200, to: 398 },
    { from: 500, to: 500 },
  ]);
  assert.deepEqual(bands([]), []);
});

test("a key between two keys leaves the fill after it as it was", () => {
  const at = (frame: number, q: (number | null)[], fill?: "linear"): Key => ({
    frame,
    q,
    ...(fill && { fill }),
  });
  const c: Clip = {
    ...clip,
    fill: "mask",
    keys: [at(0, [1, 1, 1], "linear"), at(10, [1, 2, null], "linear")],
  };
  assert.equal(newKey(c, 5, [1, null, null]).fill, "linear");
  assert.equal(newKey(c, 20, [1, null, null]).fill, undefined, "nothing follows");
  assert.equal(newKey(c, 5, [null, null, 3], 2).fill, undefined, "no key of this joint follows");
});

test("the bar of a point reaches to a key that is out of sight", () => {
  const at = (frame: number): Key => ({
    frame,
    q: [0, 0, 0],
    reach: [{ site: "tip", pos: [0, 0, 0] }],
  });
  const sparse: Clip = { ...clip, length: 2000, fill: "linear", keys: [at(0), at(1999)] };
  const view = { zoom: 20, left: 0, top: 0 };
  const list = marks(sparse, view, { width: 900, height: 200 }, new Map(), new Set());
  assert.equal(list.length, 1);
  const [bar] = bars(ofPoint(list, "tip"));
  assert.equal(bar?.to, frameToX(view, 1999));
});

test("keys closer than the eye parts them are one diamond, but a selected one shows", () => {
  const many: Clip = {
    ...clip,
    length: 2000,
    keys: Array.from({ length: 2000 }, (_, f) => ({ frame: f, q: [f, 0, 0] })),
  };
  const box = { width: 1168, height: 200 };
  const list = marks(many, fit(2000, box), box, new Map(), new Set([777]));
  assert.equal(list.length, 2000);
  const drawn = diamonds(list);
  assert.ok(drawn.length < 1000, `${drawn.length}`);
  assert.equal(drawn.filter((d) => d.ink === "selected").length, 1);
  const gaps = drawn.filter((d) => d.ink === "whole").map((d) => d.x);
  assert.ok(
    gaps.every((x, i) => i === 0 || x - (gaps[i - 1] ?? 0) < 3),
    "no gap in the row of diamonds",
  );
});

test("a joint without a goal has no diamond in its row and half a one in its group's", () => {
  const open: Clip = {
    ...clip,
    keys: [
      { frame: 10, q: [1, null, 3] },
      { frame: 20, q: [1, 2, 3], hold: 4 },
    ],
  };
  const list = marks(
    open,
    fit(100, { width: 900, height: 200 }),
    { width: 900, height: 200 },
    new Map(),
    new Set(),
  );
  const part = list.filter((m) => !m.full);
  assert.deepEqual(
    part.map((m) => m.frame),
    [10],
  );
  assert.deepEqual(ofRow(part, [1]), []);
  assert.deepEqual(
    diamonds(ofRow(part, [0])).map((d) => d.ink),
    ["whole"],
  );
  assert.deepEqual(
    diamonds(ofRow(part, [0, 1])).map((d) => d.ink),
    ["part"],
  );
  assert.deepEqual(
    diamonds(ofRow(part, undefined)).map((d) => d.ink),
    ["part"],
  );
  assert.deepEqual(
    bars(list).map((b) => b.ink),
    ["masked", "hold"],
  );
});

/** Contrast of two colours, WCAG 2.2. */
function contrast(a: string, b: string): number {
  const light = (hex: string): number => {
    const [r, g, bl] = [1, 3, 5].map((i) => {
      const c = parseInt(hex.slice(i, i + 2), 16) / 255;
      return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
    }) as [number, number, number];
    return 0.2126 * r + 0.7152 * g + 0.0722 * bl;
  };
  const [hi, lo] = [light(a), light(b)].sort((x, y) => y - x) as [number, number];
  return (hi + 0.05) / (lo + 0.05);
}

test("words have a contrast of 4.5 to 1, shapes and curves of 3 to 1, dark and light", () => {
  assert.ok(Math.abs(contrast("#000000", "#ffffff") - 21) < 1e-6);
  const css = readFileSync("src/styles/palette.css", "utf8");
  const themes = [...css.matchAll(/:root[^{]*\{([^{}]*--back:[^{}]*)\}/g)].map(
    (m) =>
      new Map(
        [...(m[1] ?? "").matchAll(/--([\w-]+):\s*([^;]+);/g)].map(
          (v) => [v[1] ?? "", (v[2] ?? "").trim()] as const,
        ),
      ),
  );
  assert.equal(themes.length, 2, "each palette once");
  for (const theme of themes) {
    const color = (name: string): string => {
      const v = theme.get(name);
      assert.match(v ?? "", /^#[0-9a-f]{6}$/, name);
      return v ?? "";
    };
    const least = (front: string, backs: string[], ratio: number, name = front): void => {
      for (const b of backs) {
        const c = contrast(front.startsWith("#") ? front : color(front), color(b));
        assert.ok(c >= ratio, `${name} on ${b}: ${c.toFixed(2)}`);
      }
    };
    for (const word of ["text", "dim", "ok", "warn", "bad", "accent", "marker"])
      least(word, ["back", "panel", "raise"], 4.5);
    least("accent-text", ["accent"], 4.5);
    for (const shape of [
      "key",
      "selected",
      "playhead",
      "look",
      "error",
      "cached",
      "focus",
      "blind",
      "fill",
      "hatch",
    ])
      least(shape, ["back", "panel"], 3);
    const series = (theme.get("series") ?? "").split(" ");
    assert.equal(new Set(series).size, 8);
    for (const c of series) least(c, ["panel"], 3, `curve ${c}`);
  }
});

test("how far the robot begins from the first key is said of the joints that have a goal", () => {
  const c: Clip = { ...clip, keys: [{ frame: 0, q: [1, null, 3] }] };
  assert.equal(startsAway(c, [0.5, 9, 3.5]), 0.5);
  assert.equal(startsAway(c, undefined), undefined);
  assert.equal(startsAway({ ...c, masks: [{ from: 0, to: 5 }] }, [0, 0, 0]), undefined);
  assert.equal(
    startsAway({ ...c, keys: [{ frame: 3, q: [1, 2, 3] }] }, [0, 0, 0]),
    undefined,
    "no goal at frame 0",
  );
});

const robots: RobotCard[] = [
  { id: "ur5e", source: "ur5e", builtin: true, models: ["adaptive", "robert"] },
  { id: "mine", source: "/w/robots/mine", builtin: false, models: [] },
];

test("an imported robot is measured on its clip or on clips of its limits: it has no tasks", () => {
  assert.equal(usualSuite("ur5e", robots, "/w/a.clip.json"), "manual");
  assert.equal(usualSuite("mine", robots, "/w/a.clip.json"), "/w/a.clip.json");
  assert.equal(usualSuite("mine", robots, null), "trial");
  assert.equal(usualPolicies([]), "pd,computed-torque");
  assert.equal(usualPolicies(["adaptive", "robert"]), "pd,ridge,robert,computed-torque");
});

test("a policy brings the guide that it wants and takes it away again; between others one set by hand stays", () => {
  const card = (name: PolicyCard["name"], more: Partial<PolicyCard> = {}): PolicyCard => ({
    name,
    suits: "",
    guide: "none",
    knows_model: false,
    slow: false,
    available: true,
    learned: true,
    default: false,
    ...more,
  });
  const [pd, robert, adaptive] = [
    card("pd"),
    card("robert"),
    card("robert", { model: "adaptive", guide: "linear" }),
  ];
  const model = card("computed-torque", { knows_model: true });
  const cards = [pd, robert, adaptive, model];
  const plain: RolloutSettings = { policy: "pd", refine: false, guide: "none", seed: 0, auto: true };
  const guided = withPolicy(plain, adaptive, cards);
  assert.deepEqual(guided, { ...plain, policy: "robert", model_path: "adaptive", guide: "linear" });
  assert.deepEqual(withPolicy(guided, robert, cards), { ...plain, policy: "robert" });
  assert.equal(withPolicy({ ...plain, guide: "linear" }, robert, cards).guide, "linear");
  assert.equal(withPolicy({ ...guided, guide: "none" }, adaptive, cards).guide, "linear");

  const tried = (card: PolicyCard, guide: Guide, mae: number): Tried => ({ card, guide, mae });
  const rows = [
    tried(model, "none", 1),
    tried(adaptive, "linear", 2),
    tried(adaptive, "none", 3),
    tried(robert, "none", 4),
    tried(pd, "linear", 5),
    tried(pd, "none", 6),
  ];
  assert.deepEqual(
    shown(rows, plain).map((t) => variant(t.card, t.guide)),
    ["computed-torque", "robert:adaptive+guide", "robert", "pd+guide", "pd"],
  );
  assert.equal(variant(pd, "smooth"), "pd+smooth");
  assert.equal(nearest(rows, plain), rows[1], "the nearest that knows as little of the model");
  assert.equal(nearest(rows, guided), undefined, "nothing is nearer than the one in use");
  assert.equal(nearest(rows, { ...guided, guide: "none" }), rows[1]);
  assert.equal(
    nearest(rows, { ...plain, guide: "linear", policy: "ilqr" }),
    undefined,
    "the one in use was not tried",
  );
  assert.equal(
    nearest([tried(robert, "none", 0.95), tried(pd, "none", 1)], plain),
    undefined,
    "not worth the change",
  );
});

test("a run goes on with its own data, not with the first of its robot", () => {
  const data = (path: string, sha256: string) => ({ path, robot: "mine", frames: 1, episodes: 1, sha256 });
  const shelf: Shelf = {
    runs: [],
    begun: [],
    presets: [],
    data: [data("data/a", "aa"), data("data/b", "bb")],
  };
  const run: RunCard = {
    path: "runs/r",
    robot: "mine",
    preset: "quick",
    step: 1,
    steps: 2,
    precision: null,
    model: "runs/r/m",
    dataset_sha256: "bb",
    changed_secs: 0,
  };
  assert.deepEqual(resumeArgs(run, shelf, robots), [
    "--robot",
    "/w/robots/mine",
    "--data",
    "data/b",
    "--resume",
    "runs/r",
  ]);
  assert.equal(resumeArgs({ ...run, dataset_sha256: "cc" }, shelf, robots), undefined);
});

test("numbers are read with commas and units; what is none is no zero", () => {
  assert.equal(parseNumber("60"), 60);
  assert.equal(parseNumber(" -1,5 "), -1.5);
  assert.equal(parseNumber(".5e1"), 5);
  assert.equal(parseNumber("180", ANGLES, Math.PI / 180), Math.PI);
  assert.equal(parseNumber("180°", ANGLES), Math.PI);
  assert.equal(parseNumber("1.5 rad", ANGLES, Math.PI / 180), 1.5);
  assert.equal(parseNumber("20 mm", LENGTHS), 0.02);
  for (const none of [
    "",
    " ",
    "banana",
    "NaN",
    "Infinity",
    "2+",
    "(2",
    "2)",
    "2**3",
    "2 m * 3 m",
    "1 / 2 m",
    "+=5",
    "1/0",
    "1e999",
    "--1",
    "1 2",
    "5 apples",
    "0x10",
    "m",
  ]) {
    assert.equal(parseNumber(none, LENGTHS), undefined, none);
  }
});

test("sums and products are read, with units and about the value that is there", () => {
  assert.equal(parseNumber("10+5"), 15);
  assert.equal(parseNumber("2 * (10 - -5) / 3 - 1"), 9);
  assert.equal(parseNumber("1e-3 + 1,5"), 1.501);
  assert.equal(parseNumber("10 mm + 2", LENGTHS, 1), 2.01);
  assert.equal(parseNumber("3*20 mm", LENGTHS), 0.06);
  assert.equal(parseNumber("90*2", ANGLES, Math.PI / 180), Math.PI);
  assert.equal(parseNumber("+=10 mm", LENGTHS, 1, 0.5), 0.51);
  assert.equal(parseNumber("-= 90", ANGLES, Math.PI / 180, Math.PI), Math.PI / 2);
  assert.equal(parseNumber("*=2", ANGLES, Math.PI / 180, 0.25), 0.5);
  assert.equal(parseNumber("/=-2", LENGTHS, 1, 0.5), -0.25);
  assert.equal(parseNumber("*=2 m", LENGTHS, 1, 0.5), undefined);
});

test("numbers are written without a minus zero, ticks with the digits that they need", () => {
  assert.deepEqual(
    [fixed(-0.04, 1), fixed(-0.06, 1), fixed(0, 3), fixed(-1e-9, 3)],
    ["0.0", "-0.1", "0.000", "0.000"],
  );
  assert.deepEqual([2.5, 10, 0.5, 0.25, 0.002, 1, 20].map(digitsOf), [1, 0, 1, 2, 3, 0, 0]);
  assert.deepEqual(
    [0, 0.1 + 0.2, 0.6].map((v) => fixed(v, digitsOf(0.1 + 0.2))),
    ["0.0", "0.3", "0.6"],
  );
});

test("a curve is drawn with the tangents that the compiler takes", () => {
  const bent: Clip = {
    ...clip,
    fill: "cubic",
    length: 41,
    keys: [
      { frame: 0, q: [0, 0, 0] },
      { frame: 20, q: [1, 1, 1], tangents: { a: "flat", b: { in: -3, out: 2 } } },
      { frame: 40, q: [2, 2, 2], tangents: { b: "linear" } },
    ],
  };
  const after = (joint: number) => stretches(bent, joint)[1]?.values ?? [];
  const step = (joint: number) => ((after(joint)[1] ?? 0) - (after(joint)[0] ?? 0)) * bent.fps;
  assert.ok(step(2) > 0.9, "automatic: through the key");
  assert.ok(step(0) < 0.2, "flat");
  assert.ok(Math.abs(step(1) - 2) < 0.3, "leaves with its own slope");
  // As src/clip/compile.rs: 5 of 20 frames after the key; it arrives with the slope of the line.
  const [s, rise] = [0.25, 1];
  const expected = 1 + 2 * (s ** 3 - 2 * s * s + s) + (3 * s * s - 2 * s ** 3) * rise + (s ** 3 - s * s) * 1;
  assert.ok(Math.abs((after(1)[5] ?? 0) - expected) < 1e-9);
});

/** Joint a is keyed three times; b is held, led past a's key and left at its value. */
const layered: Clip = {
  ...clip,
  fill: "linear",
  length: 60,
  masks: [],
  keys: [
    { frame: 0, q: [0, 1, null], hold: 20 },
    { frame: 10, q: [1, null, null], hold: 5, fill: "mask" },
    { frame: 40, q: [2, 3, null] },
    { frame: 50, q: [3, null, null] },
  ],
};

test("a curve goes from a key of its joint to the next, past keys for other joints", () => {
  const of = (joint: number) => stretches(layered, joint).map((s) => [s.kind, s.from, s.to]);
  assert.deepEqual(of(0), [
    ["key", 0, 9],
    ["linear", 9, 10],
    ["key", 10, 14],
    ["masked", 14, 40],
    ["linear", 40, 50],
    ["hold", 50, 59],
  ]);
  assert.deepEqual(of(1), [
    ["key", 0, 19],
    ["linear", 19, 40],
    ["hold", 40, 59],
  ]);
  assert.deepEqual(of(2), []);
  const at = (joint: number) => [10, 29.5, 40, 50].map((f) => commandedAt(layered, joint, Math.ceil(f)));
  assert.deepEqual(at(0), [1, undefined, 2, 3]);
  assert.deepEqual(at(1), [1, 1 + (2 * 11) / 21, 3, 3]);
});

test("an automatic slope is that between the keys of the joint", () => {
  const keys = [
    { frame: 0, q: [0, 0, 0] },
    { frame: 10, q: [5, null, 0] },
    { frame: 20, q: [1, 1, 0] },
    { frame: 30, q: [5, null, 0] },
    { frame: 40, q: [2, 2, 0] },
  ];
  const smooth: Clip = { ...clip, fill: "cubic", length: 41, masks: [], keys };
  const alone: Clip = { ...smooth, keys: keys.filter((k) => k.q[1] !== null) };
  assert.deepEqual(stretches(smooth, 1), stretches(alone, 1));
});

test("a row shows what is commanded of its joint", () => {
  const box = { width: 900, height: 200 };
  const view = { zoom: 10, left: 0, top: 0 };
  const row = (joints: number[] | undefined, left = 0) =>
    bars(ofRow(marks(layered, { ...view, left }, box, new Map(), new Set()), joints)).map((b) => [
      b.ink,
      ...[b.from, b.to].map((x) => Math.round(left + (x - LABELS) / view.zoom)),
    ]);
  assert.deepEqual(row([1]), [
    ["linear", 20, 40],
    ["hold", 0, 20],
    ["held", 41, 60],
  ]);
  assert.deepEqual(row([0]), [
    ["hold", 0, 15],
    ["masked", 15, 40],
    ["linear", 41, 50],
    ["held", 51, 60],
  ]);
  assert.deepEqual(row([2]), []);
  // The bar of a key far to the left reaches in.
  assert.deepEqual(row([1], 30), row([1]));
});

test("what M masks of one joint lies between its own keys", () => {
  const of = (joint?: number) => acted(layered, new Set(), undefined, 25, joint);
  assert.deepEqual([of(1)?.from, of(1)?.to], [20, 40]);
  assert.deepEqual([of(0)?.from, of(0)?.to], [15, 40]);
});

test("sentences of the program have the page's unit", () => {
  const deg = (text: string): string => inUnits(text, true);
  assert.equal(
    deg("key at frame 10: J3 2.000000 is outside -1.570796..1.570796 rad"),
    "key at frame 10: J3 114.6° is outside -90.0..90.0°",
  );
  assert.equal(
    deg("too fast: FFJ4 3.14 of 1.57 rad/s and 2 more"),
    "too fast: FFJ4 179.9 of 90.0 °/s and 2 more",
  );
  assert.equal(
    deg("offset at frame 5: a goes 0.100 rad beyond its range"),
    "offset at frame 5: a goes 5.7° beyond its range",
  );
  assert.equal(deg("x 0.5 is outside -0.2..0.2 m"), "x 0.5 is outside -0.2..0.2 m");
  assert.equal(inUnits("a 1 rad", false), "a 1 rad");
});

test("offsets grow, stay and fade; those that meet lead into each other", () => {
  const o = { frame: 20, add: { a: 1 }, in: 12, out: 12, hold: 1 };
  const next = { ...o, frame: 32 };
  for (let f = 20; f <= 32; f++) assert.ok(Math.abs(weight(o, f) + weight(next, f) - 1) < 1e-12);
  assert.deepEqual([weight(o, 8), weight(o, 20), weight(o, 32)], [0, 1, 0]);
  assert.deepEqual(spanOf(o, 100), { from: 9, to: 32 });
});

test("what cannot be reached is said at every frame that asks for it, and at no other", () => {
  const lint = {
    frames: [10, 11] as [number, number],
    joints: ["a"],
    level: "warning" as const,
    mends: [],
    message: "",
    pointer: "",
    rule: "unreachable" as const,
  };
  const settled = {
    asked: [1],
    q: [0],
    joint: "a",
    distance: 1,
    held: [
      [10, 15],
      [30, 31],
    ] as [number, number][],
  };
  const at = (frame: number) =>
    unreachedAt(
      [
        { ...lint, rule: "hidden" },
        { ...lint, settled },
      ],
      frame,
    );
  assert.deepEqual(
    [9, 10, 14, 15, 30, 31].map((f) => at(f) !== undefined),
    [false, true, true, false, true, false],
  );
  // A place that an end effector does not reach has no pose of its own.
  assert.deepEqual(
    [10, 11].map((f) => unreachedAt([lint], f) === lint),
    [true, false],
  );
});

test("a block goes to another place among the blocks", () => {
  const blocks = [0, 50, 90].map((frame) => ({ frame, to: frame + 20, name: "b" }));
  assert.deepEqual(reordered(blocks, 0, 2), [50, 90, 0]);
  assert.deepEqual(reordered(blocks, 90, 0), [90, 0, 50]);
  assert.deepEqual(reordered(blocks, 50, 1), [0, 50, 90]);
});

test("a clip grows for keys that land beyond its end, with their holds", () => {
  const clip = {
    length: 40,
    keys: [
      { frame: 10, q: [0] },
      { frame: 30, q: [1], hold: 5 },
    ],
  } as unknown as Clip;
  const op: Op = { op: "keys.move", args: { frames: [10, 30], df: 8, copy: true } };
  const ends = (df: number): number[] => endsOf(clip.keys, (f) => f + df);
  assert.deepEqual(grown(clip, op, ends(5), "Copy"), { op });
  assert.deepEqual(grown(clip, op, ends(8), "Copy"), {
    op: { op: "batch", args: { label: "Copy", ops: [{ op: "clip.length", args: { length: 43 } }, op] } },
    length: 43,
  });
  assert.deepEqual(
    endsOf(clip.keys, (f) => 2 * f),
    [21, 70],
  );
  assert.deepEqual(
    [0, 10, 20, 30, 31].map((at) => pivotOf([10, 30], at)),
    [10, 10, 20, 30, 10],
  );
  assert.equal(pivotOf([30], 5), 5);
});

test("problems of one kind have one fix: from the end to the beginning, shared ones once", () => {
  const lint = (frame: number, rule: string, mend?: Op): Lint =>
    ({
      rule,
      level: "error",
      frames: [frame, frame + 1],
      mends: mend ? [{ title: "Clamp", op: mend }] : [],
    }) as unknown as Lint;
  const clamp = (frame: number): Op => ({ op: "keys.set", args: { frame, hold: 1 } });
  const kinds = kindsOf([
    lint(5, "limits", clamp(5)),
    lint(3, "blind"),
    lint(9, "limits", clamp(9)),
    lint(10, "limits", clamp(9)),
  ]);
  assert.deepEqual(
    kinds.map((k) => [k.rule, k.lints.length, k.fixable]),
    [
      ["limits", 3, 3],
      ["blind", 1, 0],
    ],
  );
  const [limits, blind] = kinds;
  assert.ok(limits && blind);
  const op = fixAll(limits);
  assert.deepEqual(op?.op === "batch" && op.args.ops, [clamp(9), clamp(5)]);
  assert.equal(fixAll(blind), undefined);
});
