import assert from "node:assert/strict";
import { test } from "node:test";
import { clip, layered } from "./sample";
import { acted, ahead, unreachedAt, within } from "./span";

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

test("what M masks of one joint lies between its own keys", () => {
  const of = (joint?: number) => acted(layered, new Set(), undefined, 25, joint);
  assert.deepEqual([of(1)?.from, of(1)?.to], [20, 40]);
  assert.deepEqual([of(0)?.from, of(0)?.to], [15, 40]);
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
