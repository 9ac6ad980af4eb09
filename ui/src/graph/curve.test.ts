import assert from "node:assert/strict";
import { test } from "node:test";
import type { Clip } from "../clip";
import { clip, layered } from "../sample";
import { commandedAt, stretches } from "./curve";

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
