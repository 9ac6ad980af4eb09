import assert from "node:assert/strict";
import { test } from "node:test";
import { type Clip, changedBy, clock, type Key, newKey, parseTime, replaced, startsAway } from "./clip";
import { clip } from "./sample";

test("typed time is always a whole frame", () => {
  assert.equal(parseTime("2:15", 20), 55);
  assert.equal(parseTime("55f", 20), 55);
  assert.equal(parseTime("55", 20), 55);
  assert.equal(parseTime("2.75s", 20), 55);
  assert.equal(parseTime("later", 20), undefined);
  assert.equal(clock(55, 20), "2.75 s");
});

test("a pose on a key changes its values only: open joints stay open, equal ones stay out", () => {
  const key: Key = { frame: 20, q: [1, null, 3], hold: 5, note: "wait" };
  const open = { ...clip, keys: [key] };
  assert.deepEqual(changedBy(open, key, [1.5, 9, 3]), { a: 1.5 });
  assert.deepEqual(changedBy(open, key, [1, 0, 3]), {});
  const posed = { ...clip, poses: { p: [7, 7, 7] }, keys: [{ frame: 0, pose: "p" }] };
  assert.deepEqual(changedBy(posed, posed.keys[0]!, [7, 8, 7]), { b: 8 });
});

test("a pose on a key whose goals decide sets all that it has", () => {
  const key: Key = { frame: 20, reach: [{ site: "tip", pos: [0, 0, 0] }] };
  assert.deepEqual(changedBy(clip, key, [1, null, 3]), { a: 1, c: 3 });
});

test("keys that others would land on are counted", () => {
  assert.equal(replaced(clip, [20]), 1);
  assert.equal(replaced(clip, [21, 41]), 0);
  assert.equal(replaced(clip, [20, 40], [0, 20]), 1, "20 leaves, 40 stays and is lost");
  assert.equal(replaced(clip, [40], []), 1, "a copy leaves nothing");
});

test("a key between two keys leaves the fill after it as it was", () => {
  const at = (frame: number, q: (number | null)[], fill?: "linear"): Key => ({
    frame,
    q,
    ...(fill && { fill }),
  });
  const c: Clip = {
    ...clip,
    fill: "mask",
    keys: [at(0, [1, 1, 1], "linear"), at(10, [1, 2, null], "linear")],
  };
  assert.equal(newKey(c, 5, [1, null, null]).fill, "linear");
  assert.equal(newKey(c, 20, [1, null, null]).fill, undefined, "nothing follows");
  assert.equal(newKey(c, 5, [null, null, 3], 2).fill, undefined, "no key of this joint follows");
});

test("how far the robot begins from the first key is said of the joints that have a goal", () => {
  const c: Clip = { ...clip, keys: [{ frame: 0, q: [1, null, 3] }] };
  assert.equal(startsAway(c, [0.5, 9, 3.5]), 0.5);
  assert.equal(startsAway(c, undefined), undefined);
  assert.equal(startsAway({ ...c, masks: [{ from: 0, to: 5 }] }, [0, 0, 0]), undefined);
  assert.equal(
    startsAway({ ...c, keys: [{ frame: 3, q: [1, 2, 3] }] }, [0, 0, 0]),
    undefined,
    "no goal at frame 0",
  );
});
