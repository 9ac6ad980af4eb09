// What the training page makes of robots, runs and data on disk; plain functions.

import type { RobotCard, RunCard, Shelf } from "./protocol";

/** Where a robot is loaded from. */
export function sourceOf(id: string, robots: RobotCard[]): string {
  return robots.find((r) => r.id === id)?.source ?? id;
}

/** Whether it comes with the program, and so has tasks of its own. */
export function isBuiltin(id: string, robots: RobotCard[]): boolean {
  return robots.find((r) => r.id === id)?.builtin ?? true;
}

/** What a policy of this robot can be measured on: the program's tasks, the open clip, clips made of its limits. */
export function usualSuite(id: string, robots: RobotCard[], path: string | null | undefined): string {
  return isBuiltin(id, robots) ? "manual" : (path ?? "trial");
}

/** Whom to compare at first: the learned beside what needs no learning. */
export function usualPolicies(models: string[]): string {
  return models.includes("robert") ? "pd,ridge,robert,computed-torque" : "pd,computed-torque";
}

/** What makes a run go on: its own data, wherever that lies now; undefined when that is gone. */
export function resumeArgs(run: RunCard, shelf: Shelf, robots: RobotCard[]): string[] | undefined {
  const data = shelf.data.find((d) => d.sha256 === run.dataset_sha256);
  return data && run.robot
    ? ["--robot", sourceOf(run.robot, robots), "--data", data.path, "--resume", run.path]
    : undefined;
}
