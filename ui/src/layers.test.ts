import assert from "node:assert/strict";
import { test } from "node:test";
import { reordered, spanOf, weight } from "./layers";

test("offsets grow, stay and fade; those that meet lead into each other", () => {
  const o = { frame: 20, add: { a: 1 }, in: 12, out: 12, hold: 1 };
  const next = { ...o, frame: 32 };
  for (let f = 20; f <= 32; f++) assert.ok(Math.abs(weight(o, f) + weight(next, f) - 1) < 1e-12);
  assert.deepEqual([weight(o, 8), weight(o, 20), weight(o, 32)], [0, 1, 0]);
  assert.deepEqual(spanOf(o, 100), { from: 9, to: 32 });
});

test("a block goes to another place among the blocks", () => {
  const blocks = [0, 50, 90].map((frame) => ({ frame, to: frame + 20, name: "b" }));
  assert.deepEqual(reordered(blocks, 0, 2), [50, 90, 0]);
  assert.deepEqual(reordered(blocks, 90, 0), [90, 0, 50]);
  assert.deepEqual(reordered(blocks, 50, 1), [0, 50, 90]);
});
