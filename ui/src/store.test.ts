// What the page makes of what it knows: modules that read the signals of store.ts.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import type { Clip } from "./clip";
import type { Coupling, JobView, RobotFacts } from "./protocol";

// What modules ask of a browser when they are loaded, and when another document is opened.
const none = () => undefined;
Object.assign(globalThis, {
  localStorage: { getItem: () => null, setItem: none },
  window: { __timers: [] },
  document: { createElement: () => ({ pause: none, removeAttribute: none, load: none }) },
});
const store = await import("./store");
const { inClipOrder, inRobotOrder } = await import("./sites");
const { shares, together } = await import("./couplings");
const { bent, lifted } = await import("./graph/edits");
const { unlocked } = await import("./locks");
const { loadJob, onJob, refreshJobs } = await import("./jobs");
const { adopt } = await import("./documents");
const { tryAll, trying } = await import("./tryall");

const fact = (name: string) => ({ name, unit: "rad", range: null, speed_max: null, band: null });

function robotOf(id: string, joints: string[]): RobotFacts {
  return { id, table: { joints: joints.map(fact) } } as unknown as RobotFacts;
}

function open(joints: string[], couplings: Coupling[] = [], more: Partial<Clip> = {}): Clip {
  const clip: Clip = {
    format: "robert-clip/1",
    robot: { id: "r", joints },
    fps: 20,
    length: 100,
    keys: [],
    ...more,
  };
  const table = { joints: joints.map(fact), rest: joints.map(() => 0), couplings };
  store.doc.value = { opened: 1, rev: 0, clip, table } as unknown as NonNullable<typeof store.doc.value>;
  return clip;
}

beforeEach(() => {
  store.robot.value = robotOf("r", ["a", "b", "c"]);
  store.locked.value = new Set();
  store.jobs.value = new Map();
});

test("states come in the robot's order of joints and are shown in the clip's", () => {
  open(["c", "a", "b"]);
  store.performed.value = { q: [[1, 2, 3]], error: [null] };
  store.performedTakes.value = new Map([[7, { q: [[4, 5, 6]], error: [0] }]]);
  assert.deepEqual(store.frames.value, { q: [[3, 1, 2]], error: [null] });
  assert.deepEqual(store.takeFrames.value.get(7)?.q, [[6, 4, 5]]);
  assert.deepEqual(inClipOrder([1, 2, 3]), [3, 1, 2]);
  assert.deepEqual(inRobotOrder([3, 1, 2]), [1, 2, 3]);
});

test("states that come before the robot is known are shown in the clip's order once it is", () => {
  store.robot.value = robotOf("another", ["c", "a", "b"]);
  open(["c", "a", "b"]);
  store.performed.value = { q: [[1, 2, 3]], error: [null] };
  assert.deepEqual(store.frames.value.q, [[1, 2, 3]]);
  store.robot.value = robotOf("r", ["a", "b", "c"]);
  assert.deepEqual(store.frames.value.q, [[3, 1, 2]]);
});

test("where both orders are one, nothing is copied", () => {
  open(["a", "b", "c"]);
  store.performed.value = { q: [[1, 2, 3]], error: [null] };
  assert.equal(store.frames.value, store.performed.value);
  assert.equal(store.takeFrames.value, store.performedTakes.value);
});

const member = (joint: string, coef: number, offset = 0) => ({ joint, coef, offset });
const mimic = (...members: Coupling["members"]): Coupling => ({
  kind: "mimic",
  name: "m",
  members,
  tolerance: 0,
});

test("coupled joints move by their shares, with their signs", () => {
  open(["a", "b", "c"], [mimic(member("a", 1), member("b", -2, 0.5))]);
  assert.deepEqual(together("a", 1), { a: 1, b: -1.5 });
  assert.deepEqual(together("b", -1.5), { b: -1.5, a: 1 });
  assert.deepEqual(shares("a"), { a: 1, b: -2 });
  assert.deepEqual(shares("b"), { b: 1, a: -0.5 });
  assert.deepEqual(shares("c"), { c: 1 });
});

test("a joint that stands still whatever the others do takes none along", () => {
  open(["a", "b", "c"], [mimic(member("a", 1), member("b", 0, 0.5))]);
  assert.deepEqual(together("b", 0.7), { b: 0.7 });
  assert.deepEqual(together("a", 2), { a: 2, b: 0.5 });
});

test("a bent curve and a lifted offset take coupled joints along by their shares", () => {
  const clip = open(["a", "b", "c"], [mimic(member("a", 1), member("b", -2))], {
    fill: "cubic",
    keys: [0, 10, 20].map((frame) => ({ frame, q: [frame / 10, -frame / 5, 0] })),
    offsets: [{ frame: 10, add: { a: 0.1, b: -0.2 } }],
  });
  const handle = { kind: "tangent" as const, frame: 10, joint: 0, side: "out" as const };
  const at = { px: 0, py: 0, x: 0, y: 0, slope: 0, set: false, smooth: true };
  const curve = bent(clip, { ...handle, ...at }, 0.1, true);
  assert.deepEqual(curve?.clip.keys[1]?.tangents, { a: 2, b: -4 });
  const top = lifted(clip, { kind: "offset", frame: 10, joint: 0, x: 0, y: 0, added: 0.1 }, 0.05, 0);
  assert.deepEqual(top?.clip.offsets?.[0]?.add, { a: 0.15, b: -0.3 });
});

test("a new key says nothing about locked joints, also when all are locked", () => {
  open(["a", "b", "c"]);
  store.locked.value = new Set(["b"]);
  assert.deepEqual(unlocked([1, 2, null]), [1, null, null]);
  store.locked.value = new Set(["a", "b", "c"]);
  assert.deepEqual(unlocked([1, 2, 3]), [null, null, null]);
});

/** Requests are answered when the test says so. */
function answers(): { give: (body: unknown) => Promise<void> } {
  const open: ((a: Response) => void)[] = [];
  Object.assign(globalThis, { fetch: () => new Promise<Response>((done) => open.push(done)) });
  const headers = { "content-type": "application/json" };
  return {
    give: async (body) => {
      open.shift()?.(new Response(JSON.stringify(body), { headers }));
      await new Promise((next) => setTimeout(next));
    },
  };
}

const job = (phase: string, events: number, lines: unknown[] = []): JobView =>
  ({ id: 3, kind: "render", phase, events, last: null, lines, log: [], title: "t" }) as unknown as JobView;

test("an answer about a job does not undo what was heard while it was on its way", async () => {
  const { give } = answers();
  store.jobs.value = new Map([[3, job("running", 1, ["one"])]]);
  const whole = loadJob(3);
  onJob({ ...job("done", 2), last: "two" as never });
  await give(job("running", 1, ["one"]));
  await whole;
  const now = store.jobs.value.get(3);
  assert.equal(now?.phase, "done");
  assert.deepEqual(now?.lines, ["one", "two"]);
  store.jobs.value = new Map([[3, job("running", 1)]]);
  const list = refreshJobs();
  onJob(job("done", 1));
  await give([job("running", 1)]);
  await list;
  assert.equal(store.jobs.value.get(3)?.phase, "done");
});

test("an answer about a job stands where nothing newer was heard", async () => {
  const { give } = answers();
  store.jobs.value = new Map([[3, job("running", 1)]]);
  const whole = loadJob(3);
  await give(job("done", 2, ["one", "two"]));
  await whole;
  assert.equal(store.jobs.value.get(3)?.phase, "done");
});

test("the facts of a robot that is no longer open are dropped", async () => {
  const { give } = answers();
  const view = (opened: number, id: string) =>
    ({
      opened,
      rev: 0,
      clip: { ...open(["a"]), robot: { id, joints: ["a"] } },
      history: { done: 0 },
      policies: [],
    }) as unknown as Parameters<typeof adopt>[0];
  adopt(view(2, "second"));
  adopt(view(3, "third"));
  await give(robotOf("second", ["a"]));
  assert.equal(store.robot.peek(), undefined, "nothing is asked of a robot that is not the clip's");
  await give(robotOf("third", ["a"]));
  assert.equal(store.robot.value?.id, "third");
});

test("trying all policies ends when the studio does not take the settings", async () => {
  open(["a", "b", "c"]);
  store.doc.value = { ...store.doc.value, findings: { spans: [], lints: [] } } as never;
  store.link.value = "open";
  store.policies.value = [{ name: "pd", available: true, slow: false, guide: "none" }] as never;
  const ended = tryAll();
  assert.equal(trying.value, "pd");
  await ended;
  assert.equal(trying.value, undefined);
});

test("errors have two or three figures, and what nobody can see has no digits", () => {
  store.degrees.value = true;
  const turns = [0, 1e-9, 0.0123, 0.5, 2.2].map((v) => store.shownError((v * Math.PI) / 180, "rad"));
  assert.deepEqual(turns, ["0°", "< 0.0001°", "0.012°", "0.50°", "2.2°"]);
  const lengths = [9e-9, 4.2e-6, 0.0123, 0.3].map((v) => store.shownError(v, "m"));
  assert.deepEqual(lengths, ["< 0.001 mm", "0.0042 mm", "12.3 mm", "300 mm"]);
});
