import assert from "node:assert/strict";
import { test } from "node:test";
import type { Clip } from "../clip";
import { clip } from "../sample";
import { type Changes, dragged } from "./space";

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
