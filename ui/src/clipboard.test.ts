import assert from "node:assert/strict";
import { test } from "node:test";
import type { Clip } from "./clip";
import { fitted, fragmentOf, parseFragment } from "./clipboard";
import { clip } from "./sample";

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
