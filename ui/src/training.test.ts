import assert from "node:assert/strict";
import { test } from "node:test";
import type { RobotCard, RunCard, Shelf } from "./protocol";
import { resumeArgs, usualPolicies, usualSuite } from "./training";

const robots: RobotCard[] = [
  { id: "ur5e", source: "ur5e", builtin: true, models: ["adaptive", "robert"] },
  { id: "mine", source: "/w/robots/mine", builtin: false, models: [] },
];

test("an imported robot is measured on its clip or on clips of its limits: it has no tasks", () => {
  assert.equal(usualSuite("ur5e", robots, "/w/a.clip.json"), "manual");
  assert.equal(usualSuite("mine", robots, "/w/a.clip.json"), "/w/a.clip.json");
  assert.equal(usualSuite("mine", robots, null), "trial");
  assert.equal(usualPolicies([]), "pd,computed-torque");
  assert.equal(usualPolicies(["adaptive", "robert"]), "pd,ridge,robert,computed-torque");
});

test("a run goes on with its own data, not with the first of its robot", () => {
  const data = (path: string, sha256: string) => ({ path, robot: "mine", frames: 1, episodes: 1, sha256 });
  const shelf: Shelf = {
    runs: [],
    begun: [],
    presets: [],
    data: [data("data/a", "aa"), data("data/b", "bb")],
  };
  const run: RunCard = {
    path: "runs/r",
    robot: "mine",
    preset: "quick",
    step: 1,
    steps: 2,
    precision: null,
    model: "runs/r/m",
    dataset_sha256: "bb",
    changed_secs: 0,
  };
  assert.deepEqual(resumeArgs(run, shelf, robots), [
    "--robot",
    "/w/robots/mine",
    "--data",
    "data/b",
    "--resume",
    "runs/r",
  ]);
  assert.equal(resumeArgs({ ...run, dataset_sha256: "cc" }, shelf, robots), undefined);
});
