import assert from "node:assert/strict";
import { test } from "node:test";
import { clip } from "../sample";
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
} from "./layout";

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
