import assert from "node:assert/strict";
import { test } from "node:test";
import { fixAll, kindsOf } from "./kinds";
import type { Lint, Op } from "./protocol";

test("problems of one kind have one fix: from the end to the beginning, shared ones once", () => {
  const lint = (frame: number, rule: string, mend?: Op): Lint =>
    ({
      rule,
      level: "error",
      frames: [frame, frame + 1],
      mends: mend ? [{ title: "Clamp", op: mend }] : [],
    }) as unknown as Lint;
  const clamp = (frame: number): Op => ({ op: "keys.set", args: { frame, hold: 1 } });
  const kinds = kindsOf([
    lint(5, "limits", clamp(5)),
    lint(3, "blind"),
    lint(9, "limits", clamp(9)),
    lint(10, "limits", clamp(9)),
  ]);
  assert.deepEqual(
    kinds.map((k) => [k.rule, k.lints.length, k.fixable]),
    [
      ["limits", 3, 3],
      ["blind", 1, 0],
    ],
  );
  const [limits, blind] = kinds;
  assert.ok(limits && blind);
  const op = fixAll(limits);
  assert.deepEqual(op?.op === "batch" && op.args.ops, [clamp(9), clamp(5)]);
  assert.equal(fixAll(blind), undefined);
});
