// Clips for the tests of this folder.

import type { Clip } from "./clip";

export const clip: Clip = {
  format: "robert-clip/1",
  robot: { id: "r", joints: ["a", "b", "c"] },
  fps: 20,
  length: 100,
  keys: [
    { frame: 0, q: [0, 0, 0] },
    { frame: 20, q: [1, 2, 3], hold: 5 },
    { frame: 40, q: [0, 0, 0] },
  ],
};

/** Joint a is keyed three times; b is held, led past a's key and left at its value. */
export const layered: Clip = {
  ...clip,
  fill: "linear",
  length: 60,
  masks: [],
  keys: [
    { frame: 0, q: [0, 1, null], hold: 20 },
    { frame: 10, q: [1, null, null], hold: 5, fill: "mask" },
    { frame: 40, q: [2, 3, null] },
    { frame: 50, q: [3, null, null] },
  ],
};
