// What the page knows. The server owns the document; signals hold the last word from it.

import { computed, signal } from "@preact/signals";
import { type Clip, FPS } from "./clip";
import { afterMs } from "./clock";
import { fixed } from "./numbers";
import type {
  Demand,
  Draft,
  Findings,
  GalleryItem,
  History,
  JobView,
  JointTable,
  Pin,
  PolicyCard,
  RecentFile,
  RobotCard,
  RobotFacts,
  RolloutSettings,
  RolloutState,
  Shelf,
  TakeCard,
  WorkerState,
} from "./protocol";
import type { Box, Group, View } from "./timeline/layout";
import { fit } from "./timeline/layout";

export interface Document {
  opened: number;
  rev: number;
  clip: Clip;
  path: string | null;
  dirty: boolean;
  history: History;
  table: JointTable;
  /** Edits that came back and are done. */
  restored: number;
  /** Edits that came back when the document was opened. */
  recovered: number;
  /** Whether another program has changed the file since these edits were made. */
  superseded: boolean;
  findings: Findings;
}

export interface Frames {
  /** Achieved states by frame. */
  q: number[][];
  /** Mean error by frame, null where masked. */
  error: (number | null)[];
}

export type Page = "gallery" | "editor" | "runs";
/** `gone`: no answer for a while; `moved`: a studio answers here that does not know this page. */
export type Link = "connecting" | "open" | "lost" | "gone" | "moved" | "refused";

export const page = signal<Page>("gallery");
export const link = signal<Link>("connecting");
export const version = signal("");
export const folder = signal("");
export const viser = signal(true);
export const robot = signal<RobotFacts | undefined>(undefined);
export const doc = signal<Document | undefined>(undefined);
export const gallery = signal<GalleryItem[]>([]);
export const recent = signal<RecentFile[]>([]);
export const drafts = signal<Draft[]>([]);
export const settings = signal<RolloutSettings>({
  policy: "computed-torque",
  refine: false,
  guide: "none",
  seed: 0,
  auto: true,
});
export const policies = signal<PolicyCard[]>([]);
export const rollout = signal<RolloutState | undefined>(undefined);
/** The rollout as the server sends it: states in the robot's own order of joints. */
export const performed = signal<Frames>({ q: [], error: [] });
export const worker = signal<WorkerState | undefined>(undefined);
/** Jobs by number, as the last event told. */
export const jobs = signal<ReadonlyMap<number, JobView>>(new Map());
/** Runs, data and presets in the folder. */
export const workspace = signal<Shelf>({ runs: [], data: [], begun: [], presets: [] });
export const robots = signal<RobotCard[]>([]);
/** Kept by the studio, for all pages; the newest first. */
export const takes = signal<TakeCard[]>([]);
/** Takes drawn beside what is performed now; the last one also in the viewport and the strip. */
export const compared = signal<number[]>([]);
/** Their motions, in the robot's own order of joints. */
export const performedTakes = signal<ReadonlyMap<number, Frames>>(new Map());

/** What stands beside the timeline. */
export const side = signal<"curves" | "rendered" | "compare" | "reference">("curves");

export const playhead = signal(0);
export const playing = signal(false);
export const speed = signal(1);
export const loop = signal(true);
export const range = signal<{ from: number; to: number } | undefined>(undefined);

export const selection = signal<ReadonlySet<number>>(new Set());
export const joint = signal<number | undefined>(undefined);
export const site = signal<string | undefined>(undefined);
/** Names this page to the server: its 3D view says it, too, so that drags there are its own. */
export const TAB = [...crypto.getRandomValues(new Uint8Array(8))]
  .map((b) => b.toString(16).padStart(2, "0"))
  .join("");
/** Joints under a hand in the viewport, with their values, until it lets go. */
export const moving = signal<Record<string, number> | undefined>(undefined);
/** What the edit that is previewed asks of the joints. */
export const demand = signal<Demand | undefined>(undefined);
/** The name of the clip is being typed. */
export const renaming = signal(false);
/** Groups of joints that are folded. */
export const closed = signal<ReadonlySet<string>>(new Set());
/** Names of joints that no hand moves. */
export const locked = signal<ReadonlySet<string>>(new Set());
/** Sites that inverse kinematics holds, for all pages. */
export const pins = signal<Pin[]>([]);
/** The row of the timeline that the keys of the grid are about. */
export const row = signal(0);
/** Size of the timeline, pixels. */
export const sheet = signal<Box>({ width: 800, height: 240 });
export const view = signal<View>(fit(200, { width: 1200, height: 300 }));
export const autoKey = signal(true);
/** Moving a joint adds to the motion around the playhead instead of making keys. */
export const shaping = signal(false);
/** Frames over which a new offset grows and fades. */
export const fade = signal(10);
/** The frame of the chosen offset. */
export const chosenOffset = signal<number | undefined>(undefined);
/** A pose that is edited but is no key yet (auto-key off). */
export const floating = signal<number[] | undefined>(undefined);
export const degrees = signal(localStorage.getItem("unit") !== "rad");
/** The viewport is made of still pictures. */
export const stills = signal(false);
export const show = signal({ command: true, achieved: true, ghosts: true, path: true, reachable: true });

export interface Toast {
  id: number;
  text: string;
  kind: "info" | "error";
  undo: boolean;
  /** What can be done about it, by a button. */
  answer?: { title: string; run: () => void } | undefined;
  /** What it is about: a newer message about the same takes its place. */
  about: string;
}
export const toasts = signal<Toast[]>([]);
export const announcement = signal("");

/** How long a message stays when nobody dismisses it. */
const MESSAGE_STAYS_MS = 5_000;
const ERROR_STAYS_MS = 15_000;

let nextToast = 1;

export function toast(
  text: string,
  kind: Toast["kind"] = "info",
  undo = false,
  about = text,
  answer?: Toast["answer"],
): void {
  const id = nextToast++;
  const others = toasts.value.filter((t) => t.about !== about);
  toasts.value = [...others.slice(-3), { id, text, kind, undo, about, answer }];
  announcement.value = text;
  afterMs(kind === "error" ? ERROR_STAYS_MS : MESSAGE_STAYS_MS, () => dismiss(id));
}

export function dismiss(id: number): void {
  toasts.value = toasts.value.filter((t) => t.id !== id);
}

const robotOfClip = computed(() => doc.value?.clip.robot);

/** Where the joints of the clip stand in the robot's own order; undefined where both orders are one, and until
 * the robot is known. A clip may name the joints in any order. */
export const order = computed<number[] | undefined>(() => {
  const own = robotOfClip.value;
  const names = robot.value?.id === own?.id ? robot.value?.table.joints.map((j) => j.name) : undefined;
  const places = names && own?.joints.map((name) => names.indexOf(name));
  const same = places?.length === names?.length && places?.every((place, j) => place === j);
  return same ? undefined : places;
});

function inOrder(f: Frames, places: number[] | undefined): Frames {
  return places ? { ...f, q: f.q.map((q) => places.map((i) => q[i] ?? 0)) } : f;
}

/** The rollout, with states in the clip's order of joints. It may come before the robot is known, so it is turned
 * here and not when it comes. */
export const frames = computed(() => inOrder(performed.value, order.value));
/** The motions of the takes that are compared, in the clip's order of joints. */
export const takeFrames = computed<ReadonlyMap<number, Frames>>(() => {
  const places = order.value;
  if (!places) return performedTakes.value;
  return new Map([...performedTakes.value].map(([id, f]) => [id, inOrder(f, places)]));
});

export const length = computed(() => doc.value?.clip.length ?? 0);
export const fps = computed(() => doc.value?.clip.fps ?? FPS);

/** Groups with joint numbers of the clip. */
export const groups = computed<Group[]>(() => {
  const names = doc.value?.clip.robot.joints ?? [];
  return (robot.value?.groups ?? [])
    .map((g) => ({
      name: g.name,
      title: g.title,
      joints: g.joints.map((j) => names.indexOf(j)).filter((j) => j >= 0),
    }))
    .filter((g) => g.joints.length > 0 && g.joints.length < names.length);
});

/** Joint names without the prefix that all of them share. */
export const titles = computed<string[]>(() => {
  const names = doc.value?.clip.robot.joints ?? [];
  const shared = /^[a-z]+_/.exec(names[0] ?? "")?.[0] ?? "";
  const cut = names.length > 1 && names.every((n) => n.startsWith(shared)) ? shared.length : 0;
  return names.map((n) => n.slice(cut));
});

/** Why there is no mirror image, or null when there is one. */
export const noMirror = computed<string | null>(() => {
  const mirror = doc.value?.table.mirror;
  return !mirror ? "no clip is open" : "none" in mirror ? mirror.none : null;
});

/** A value as people read it. */
export function shown(value: number, unit: "rad" | "m"): string {
  if (unit === "m") return `${fixed(value, 3)} m`;
  return degrees.value ? `${fixed((value * 180) / Math.PI, 1)}°` : `${fixed(value, 3)} rad`;
}

/** An error: two or three figures that count. What is smaller than anybody can see has no digits of its own. */
export function shownError(value: number, unit: "rad" | "m"): string {
  const figures = (v: number, least: number): string => {
    const size = Math.abs(v);
    if (size === 0) return "0";
    if (size < least) return `< ${least.toFixed(Math.round(-Math.log10(least)))}`;
    return size >= 100 ? v.toFixed(0) : size >= 10 ? v.toFixed(1) : v.toPrecision(2);
  };
  if (unit === "m") return `${figures(value * 1000, 1e-3)} mm`;
  return degrees.value ? `${figures((value * 180) / Math.PI, 1e-4)}°` : `${figures(value, 1e-5)} rad`;
}

export const unit = computed<"rad" | "m">(() => doc.value?.table.joints[0]?.unit ?? "rad");
