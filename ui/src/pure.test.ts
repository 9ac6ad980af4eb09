import assert from "node:assert/strict";
import { test } from "node:test";
import { clock, keyEnd, parseTime, type Clip } from "./clip";
import { patched } from "./protocol";
import { fit, frameToX, rowsOf, tick, xToFrame, yToRow, rowToY, zoomAt, LABELS, ROW } from "./timeline/layout";

const clip: Clip = {
  format: "robert-clip/1", robot: { id: "r", joints: ["a", "b", "c"] }, fps: 20, length: 100,
  keys: [{ frame: 0, q: [0, 0, 0] }, { frame: 20, q: [1, 2, 3], hold: 5 }, { frame: 40, q: [0, 0, 0] }],
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
  assert.deepEqual(open.map((r) => r.kind), ["all", "group", "joint", "joint", "joint"]);
  const shut = rowsOf(clip, groups, new Set(["g"]));
  assert.deepEqual(shut.map((r) => r.kind), ["all", "group", "joint"]);
  const view = fit(100, { width: 900, height: 200 });
  assert.equal(yToRow(view, rowToY(view, 3) + ROW / 2, open.length), 3);
  assert.equal(yToRow(view, 3, open.length), undefined);
});

test("ruler labels never touch", () => {
  for (let zoom = 0.15; zoom < 60; zoom *= 1.3) assert.ok(tick(zoom, 20).major * zoom >= 55, `${zoom}`);
});

test("a patch replaces, removes and keeps order", () => {
  const next = patched(clip, { keys_removed: [40], keys_put: [{ frame: 10, q: [9, 9, 9] }, { frame: 20, q: [5, 5, 5] }], length: 120 });
  assert.deepEqual(next.keys.map((k) => k.frame), [0, 10, 20]);
  assert.deepEqual(next.keys[2]?.q, [5, 5, 5]);
  assert.equal(next.length, 120);
  assert.equal(clip.length, 100, "the old document is untouched");
  assert.equal(keyEnd(clip.keys[1]!), 25);
});
