import assert from "node:assert/strict";
import { test } from "node:test";
import type { Clip } from "./clip";
import { endsOf, grown, pivotOf } from "./grow";
import type { Op } from "./protocol";

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
