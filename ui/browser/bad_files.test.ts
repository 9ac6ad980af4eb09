// Files that are no clips: the page says of each what the command line says, with its place.

import assert from "node:assert/strict";
import { ARM, after, armTab, before, describe, Studio, test } from "./harness";

const swap = (from: string | RegExp, to: string): string => {
  const text = JSON.stringify(JSON.parse(ARM), null, 1);
  const changed = text.replace(from, to);
  assert.notEqual(changed, text, String(from));
  return changed;
};

const BAD: string[] = [
  "",
  "{",
  "null",
  "[]",
  "7",
  '"clip"',
  "clip",
  "\u{feff}{}",
  "[".repeat(5000),
  "{}",
  swap("robert-clip/1", "robert-clip/9"),
  swap("robert-clip/1", "bvh"),
  swap(/"format": "[^"]*",/, ""),
  swap('"fps": 20', '"fps": 30'),
  swap('"fps": 20', '"fps": -1'),
  swap('"fps": 20', '"fps": "20"'),
  swap('"length": 80', '"length": 0'),
  swap('"length": 80', '"length": 1e9'),
  swap('"length": 80', '"length": 20'),
  swap('"length": 80', '"length": 2.5'),
  swap('"linear"', '"spline"'),
  swap('"linear"', "3"),
  swap(/-1\.57,/, "NaN,"),
  swap(/-1\.57,/, "1e999,"),
  swap(/-1\.57,/, "1e300,"),
  swap(/-1\.57,/, "Infinity,"),
  swap(/-1\.57,/, '"x",'),
  swap(/-1\.57,\s+/, ""),
  swap('"frame": 30', '"frame": 0'),
  swap('"frame": 30', '"frame": -3'),
  swap('"frame": 30', '"frame": 2.5'),
  swap('"frame": 30', '"fram": 30'),
  swap('"frame": 30', '"frame": 80'),
  swap('"frame": 30,', '"frame": 30, "pose": "x",'),
  swap('"frame": 30,', '"frame": 30, "hold": 0,'),
  swap('"frame": 30,', '"frame": 30, "fill": 3,'),
  swap('"frame": 30,', '"frame": 30, "frame": 31,'),
  swap('"elbow"', '"shoulder_pan"'),
  swap('"elbow"', "7"),
  swap('"id": "ur5e",', ""),
  swap('"keys"', '"kyes"'),
  swap('"keys"', '"masks": [{"from": 9, "to": 3}], "keys"'),
  swap('"keys"', '"masks": [{"from": 1, "to": 3, "joints": ["nose"]}], "keys"'),
  swap('"keys"', '"markers": [{"frame": 900, "name": "x"}], "keys"'),
  swap('"keys"', '"poses": {"a": [1]}, "keys"'),
  swap('"keys"', '"start": {"pose": "no"}, "keys"'),
  swap('"keys"', '"keys": [], "keys"'),
  `${JSON.stringify(JSON.parse(ARM))} trailing`,
];

describe("bad files", () => {
  let studio: Studio;
  before(async () => void (studio = await Studio.start()));
  after(() => studio.end());

  test("each is a banner with the text of the command line", async () => {
    assert.ok(BAD.length >= 40, String(BAD.length));
    const t = await armTab(studio);
    for (const [i, text] of BAD.entries()) {
      const name = `bad${i}.clip.json`;
      const path = studio.file(name, text);
      const shell = studio.shell("clip", "check", path);
      assert.equal(shell.code, 3, `${i}: ${shell.err}`);
      const said = shell.err.trim().replace(/^error: /, "");
      assert.match(said, new RegExp(`bad${i}\\.clip\\.json:\\d+:\\d+: `), `${i}`);
      await t.press("Control+o");
      await t.page.getByLabel("File", { exact: true }).fill(name);
      await t.page.keyboard.press("Enter");
      const banner = t.page.getByRole("alert").filter({ hasText: name });
      await banner.waitFor();
      assert.ok(
        (await banner.innerText()).includes(said),
        `${i}:\n shell ${said}\n page  ${await banner.innerText()}`,
      );
      if (i === 11) await t.picture("bad-file");
      await banner.getByRole("button", { name: "Dismiss" }).click();
    }
    assert.equal((await t.state()).clip?.name, "arm", "the clip before is still open");
    assert.deepEqual(t.errors, []);
  });
});
