import assert from "node:assert/strict";
import { test } from "node:test";
import { ANGLES, digitsOf, fixed, inUnits, LENGTHS, parseNumber } from "./numbers";

test("numbers are read with commas and units; what is none is no zero", () => {
  assert.equal(parseNumber("60"), 60);
  assert.equal(parseNumber(" -1,5 "), -1.5);
  assert.equal(parseNumber(".5e1"), 5);
  assert.equal(parseNumber("180", ANGLES, Math.PI / 180), Math.PI);
  assert.equal(parseNumber("180°", ANGLES), Math.PI);
  assert.equal(parseNumber("1.5 rad", ANGLES, Math.PI / 180), 1.5);
  assert.equal(parseNumber("20 mm", LENGTHS), 0.02);
  for (const none of [
    "",
    " ",
    "banana",
    "NaN",
    "Infinity",
    "2+",
    "(2",
    "2)",
    "2**3",
    "2 m * 3 m",
    "1 / 2 m",
    "+=5",
    "1/0",
    "1e999",
    "--1",
    "1 2",
    "5 apples",
    "0x10",
    "m",
  ]) {
    assert.equal(parseNumber(none, LENGTHS), undefined, none);
  }
});

test("sums and products are read, with units and about the value that is there", () => {
  assert.equal(parseNumber("10+5"), 15);
  assert.equal(parseNumber("2 * (10 - -5) / 3 - 1"), 9);
  assert.equal(parseNumber("1e-3 + 1,5"), 1.501);
  assert.equal(parseNumber("10 mm + 2", LENGTHS, 1), 2.01);
  assert.equal(parseNumber("3*20 mm", LENGTHS), 0.06);
  assert.equal(parseNumber("90*2", ANGLES, Math.PI / 180), Math.PI);
  assert.equal(parseNumber("+=10 mm", LENGTHS, 1, 0.5), 0.51);
  assert.equal(parseNumber("-= 90", ANGLES, Math.PI / 180, Math.PI), Math.PI / 2);
  assert.equal(parseNumber("*=2", ANGLES, Math.PI / 180, 0.25), 0.5);
  assert.equal(parseNumber("/=-2", LENGTHS, 1, 0.5), -0.25);
  assert.equal(parseNumber("*=2 m", LENGTHS, 1, 0.5), undefined);
});

test("numbers are written without a minus zero, ticks with the digits that they need", () => {
  assert.deepEqual(
    [fixed(-0.04, 1), fixed(-0.06, 1), fixed(0, 3), fixed(-1e-9, 3)],
    ["0.0", "-0.1", "0.000", "0.000"],
  );
  assert.deepEqual([2.5, 10, 0.5, 0.25, 0.002, 1, 20].map(digitsOf), [1, 0, 1, 2, 3, 0, 0]);
  assert.deepEqual(
    [0, 0.1 + 0.2, 0.6].map((v) => fixed(v, digitsOf(0.1 + 0.2))),
    ["0.0", "0.3", "0.6"],
  );
});

test("sentences of the program have the page's unit", () => {
  const deg = (text: string): string => inUnits(text, true);
  assert.equal(
    deg("key at frame 10: J3 2.000000 is outside -1.570796..1.570796 rad"),
    "key at frame 10: J3 114.6° is outside -90.0..90.0°",
  );
  assert.equal(
    deg("too fast: FFJ4 3.14 of 1.57 rad/s and 2 more"),
    "too fast: FFJ4 179.9 of 90.0 °/s and 2 more",
  );
  assert.equal(
    deg("offset at frame 5: a goes 0.100 rad beyond its range"),
    "offset at frame 5: a goes 5.7° beyond its range",
  );
  assert.equal(deg("x 0.5 is outside -0.2..0.2 m"), "x 0.5 is outside -0.2..0.2 m");
  assert.equal(inUnits("a 1 rad", false), "a 1 rad");
});
