// The server's messages, as src/studio/protocol.rs writes them. Values are rad, m and frames.

import type { Clip, Fill, Key, Marker, Mask } from "./clip";

export interface Delta {
  keys_removed?: number[];
  keys_put?: Key[];
  poses_removed?: string[];
  poses_put?: [string, (number | null)[]][];
  masks?: Mask[];
  markers?: Marker[];
  name?: string;
  notes?: string;
  length?: number;
  fill?: Fill;
  start?: Clip["start"];
}

export interface ErrorBody {
  code: string;
  message: string;
  place?: { line: number; col: number };
  mend?: string;
}

export interface History {
  labels: string[];
  first: number;
  done: number;
  len: number;
}

export interface JointFacts {
  name: string;
  unit: "rad" | "m";
  range: [number, number] | null;
  speed_max: number | null;
  /** Where 98 of 100 frames of its policy's data lie. */
  band?: [number, number] | null;
  speed_usual?: number | null;
}

export interface JointTable {
  robot: string;
  joints: JointFacts[];
  rest: number[];
  mirror: { table: unknown[] } | { none: string };
  couplings: { members?: { joint: string; coef?: number; offset?: number }[]; [key: string]: unknown }[];
  granularity: "state" | "joint";
}

export interface Lint {
  level: "error" | "warning" | "info";
  rule: string;
  message: string;
  frames: [number, number] | null;
  joints: string[];
  mends: { title: string; op: { op: string; args: object } }[];
}

export interface Findings {
  rev: number;
  lints: Lint[];
  spans: { from: number; to: number; kind: string }[];
  blind: { after: number | null; before: number | null; from: number; to: number }[];
  simulated: boolean;
  granularity: "state" | "joint";
}

/** How fast a previewed edit makes the joint go that it asks most of; rad/s or m/s. */
export interface Demand {
  joint: string;
  unit: "rad" | "m";
  frames: [number, number];
  needed: number;
  usual: number | null;
  max: number | null;
}

export interface DocumentView {
  /** Rises with every document that is opened. */
  opened: number;
  rev: number;
  clip: Clip;
  path: string | null;
  dirty: boolean;
  history: History;
  table: JointTable;
  restored: { edits: number } | null;
  findings: Findings;
  policies: PolicyCard[];
}

/** A clip that was never saved and is not open. */
export interface Draft {
  number: number;
  name: string;
  robot: string;
  keys: number;
  changed_secs: number;
  /** The studio was killed with it open. */
  abandoned: boolean;
}

/** What fills masked frames before a policy sees them. */
export type Guide = "none" | "linear";

export interface RolloutSettings {
  policy: string;
  refine: boolean;
  guide: Guide;
  seed: number;
  auto: boolean;
  model_path?: string;
}

export interface RolloutState {
  gen: number;
  rev: number;
  phase: "off" | "waiting" | "running" | "done" | "failed";
  cached_to: number;
  frames: number;
  resumed_at: number;
  mae: number | null;
  ms_per_frame: number | null;
  policy: string;
  error?: string;
}

export interface PolicyCard {
  name: string;
  model?: string;
  suits: string;
  /** What should fill masked frames for it. */
  guide: Guide;
  knows_model: boolean;
  slow: boolean;
  available: boolean;
  why?: string;
  learned: boolean;
  default: boolean;
}

export interface WorkerState {
  phase: "starting" | "ready" | "restarting" | "stopped";
  pid: number | null;
  deaths: number;
  reason: string | null;
}

export type JobKind = "collect" | "train" | "eval" | "render" | "export" | "import";

export interface Progress {
  what: string;
  unit: string;
  done: number;
  total: number;
  secs: number;
  note: string;
}

export interface JobEvent {
  event: string;
  figures?: Record<string, unknown>;
  line?: string;
  result?: unknown;
}

export interface JobView {
  id: number;
  kind: JobKind;
  args: string[];
  title: string;
  phase: "running" | "cancelling" | "done" | "interrupted" | "failed";
  exit: number | null;
  progress: Progress | null;
  last: JobEvent | null;
  file: string | null;
  events: number;
  first: number;
  lines: JobEvent[];
  log: string[];
  secs: number;
}

export interface RunCard {
  path: string;
  robot: string | null;
  preset: string;
  step: number;
  steps: number;
  precision: Record<string, number> | null;
  model: string | null;
  dataset_sha256: string | null;
  changed_secs: number;
}

export interface DataCard {
  path: string;
  robot: string;
  frames: number;
  episodes: number;
  sha256: string;
}

/** A collection that was begun and is not whole. */
export interface BegunCard {
  path: string;
  robot: string;
  agents: string[];
  transitions: number;
}

export interface Shelf {
  runs: RunCard[];
  data: DataCard[];
  begun: BegunCard[];
  presets: [string, string][];
}

export interface RobotCard {
  id: string;
  source: string;
  builtin: boolean;
  models: string[];
}

/** A take: a rollout that is kept. */
export interface TakeCard {
  id: number;
  name: string;
  clip: string;
  rev: number;
  policy: string;
  seed: number;
  mae: number | null;
  frames: number;
  pinned: boolean;
  /** Its goals are those of now: the errors can be compared. */
  same_goals: boolean;
}

export interface TakesView {
  takes: TakeCard[];
  compared: number[];
}

/** A file that could be opened. */
export interface FileCard {
  name: string;
  kind: "clip" | "csv" | "mjcf" | "ros";
  bytes: number;
  changed_secs: number;
  clip?: { name: string; robot: string; length: number; keys: number };
  why?: string;
}

export interface Listing {
  root: string;
  dir: string;
  folders: string[];
  files: FileCard[];
  left_out: number;
  more: boolean;
}

export interface State {
  version: string;
  document: DocumentView | null;
  rollout: RolloutSettings;
  policies: PolicyCard[];
  worker: WorkerState;
  viser: boolean;
  clients: number;
  folder: string;
  locked: string[];
  takes: TakesView;
}

export interface Selection {
  joint?: string;
  body?: string;
  site?: string;
}

export interface RobotFacts {
  id: string;
  title: string;
  about: string;
  table: JointTable;
  groups: { name: string; title: string; joints: string[] }[];
  actuators: string[];
  poses: { name: string; q: number[] }[];
  ik_sites: { name: string; body: number; pos: [number, number, number] }[];
  bodies: { name: string; parent: number; joints: number[] }[];
  settle_tolerance: number;
}

export interface GalleryItem {
  id: string;
  name: string;
  robot: string;
  length: number;
  keys: number;
}

export interface RecentFile {
  path: string;
  name: string;
  robot: string;
  opened_secs: number;
  exists: boolean;
}

export type Event =
  | { event: "hello"; client: number; state: State }
  | { event: "edit"; by: number; id?: number; rev: number; label: string; patch: Delta; dirty: boolean; history: History }
  | { event: "reply"; id: number; result?: unknown; error?: ErrorBody }
  | { event: "document"; document: DocumentView | null }
  | { event: "saved"; path: string; rev: number }
  | ({ event: "findings" } & Findings)
  | ({ event: "rollout.settings" } & RolloutSettings)
  | { event: "rollout.frames"; gen: number; from: number; q: number[][]; error: (number | null)[] }
  | ({ event: "rollout.state" } & RolloutState)
  | ({ event: "takes" } & TakesView)
  | ({ event: "worker" } & WorkerState)
  | ({ event: "job" } & JobView)
  | ({ event: "select" } & Selection)
  | { event: "joint"; values: Record<string, number>; done: boolean; tab?: string }
  | { event: "joint.cancelled"; tab?: string }
  | { event: "locked"; joints: string[] }
  | { event: "notice"; level: "info" | "warning" | "error"; message: string };

/** Applies a difference to a copy of the clip. */
export function patched(clip: Clip, d: Delta): Clip {
  const next: Clip = { ...clip };
  if (d.keys_removed || d.keys_put) {
    const gone = new Set([...(d.keys_removed ?? []), ...(d.keys_put ?? []).map((k) => k.frame)]);
    next.keys = [...clip.keys.filter((k) => !gone.has(k.frame)), ...(d.keys_put ?? [])];
    next.keys.sort((a, b) => a.frame - b.frame);
  }
  if (d.poses_removed || d.poses_put) {
    const poses = { ...clip.poses };
    for (const name of d.poses_removed ?? []) delete poses[name];
    for (const [name, q] of d.poses_put ?? []) poses[name] = q;
    next.poses = poses;
  }
  if (d.masks) next.masks = d.masks;
  if (d.markers) next.markers = d.markers;
  if (d.name !== undefined) next.name = d.name;
  if (d.notes !== undefined) next.notes = d.notes;
  if (d.length !== undefined) next.length = d.length;
  if (d.fill !== undefined) next.fill = d.fill;
  if (d.start !== undefined) next.start = d.start;
  return next;
}
