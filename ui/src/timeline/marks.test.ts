import assert from "node:assert/strict";
import { test } from "node:test";
import type { Clip, Key } from "../clip";
import { clip, layered } from "../sample";
import { fit, frameToX, LABELS } from "./layout";
import { bands, bars, diamonds, type Glyph, marks, ofPoint, ofRow } from "./marks";

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
