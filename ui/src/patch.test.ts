import assert from "node:assert/strict";
import { test } from "node:test";
import { keyEnd } from "./clip";
import { patched } from "./patch";
import { clip } from "./sample";

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

test("a patch can change where the clip starts, and take that back", () => {
  const started = patched(clip, { start: { q: [1, 2, 3] } });
  assert.deepEqual(started.start, { q: [1, 2, 3] });
  assert.equal(patched(started, { start: null }).start, undefined);
});
