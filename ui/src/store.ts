// What the page knows. The server owns the document; signals hold the last word from it.

import { computed, signal } from "@preact/signals";
import type { Clip } from "./clip";
import type { Group, View } from "./timeline/layout";
import { fit } from "./timeline/layout";

export interface JointInfo {
  name: string;
  title: string;
  unit: "rad" | "m";
  range: [number, number] | null;
  speed_limit: number;
  /** Joints that move with this one (a tendon, a mimic); sets are edited together. */
  coupled: number[];
}

export interface RobotInfo {
  id: string;
  title: string;
  joints: JointInfo[];
  groups: Group[];
  poses: Record<string, number[]>;
  mirror: string | null;
  ik_sites: string[];
  joint_masks: boolean;
}

export interface Lint {
  level: "error" | "warning" | "info";
  rule: string;
  message: string;
  frames: [number, number] | null;
  joints: string[];
  mends: { title: string; op: unknown }[];
}

export interface Take {
  id: string;
  label: string;
  policy: string;
  precision: number | null;
  pinned: boolean;
}

export interface Document {
  rev: number;
  clip: Clip;
  path: string | null;
  dirty: boolean;
  saved: string | null;
  history: string[];
  /** Entries of the history that are done; the rest can be redone. */
  done: number;
  lints: Lint[];
  blind: { from: number; to: number }[];
  /** Command compiled to rows, for curves and ghosts: (length, joints), NaN where masked. */
  command: Float32Array;
}

export interface Rollout {
  /** Of which revision. */
  rev: number;
  policy: string;
  /** Achieved states, (frames, joints); NaN where not simulated yet. */
  achieved: Float32Array;
  /** Mean error by frame. */
  errors: Float32Array;
  cachedTo: number;
  precision: number | null;
  msPerFrame: number;
  failed: string | null;
  done: boolean;
}

export type Page = "gallery" | "editor" | "runs";
export type Link = "connecting" | "open" | "lost" | "refused";

export const page = signal<Page>("gallery");
export const link = signal<Link>("connecting");
export const robot = signal<RobotInfo | undefined>(undefined);
export const doc = signal<Document | undefined>(undefined);
export const rollout = signal<Rollout | undefined>(undefined);
export const takes = signal<Take[]>([]);
export const policies = signal<{ name: string; label: string; available: boolean; why: string }[]>([]);
export const policy = signal("");
export const refine = signal(false);
export const autoRollout = signal(true);

export const playhead = signal(0);
export const playing = signal(false);
export const speed = signal(1);
export const loop = signal(true);
export const range = signal<{ from: number; to: number } | undefined>(undefined);

export const selection = signal<ReadonlySet<number>>(new Set());
export const joint = signal<number | undefined>(undefined);
export const closed = signal<ReadonlySet<string>>(new Set());
export const view = signal<View>(fit(200, { width: 1200, height: 300 }));
export const autoKey = signal(true);
/** A pose that is edited but is no key yet (auto-key off). */
export const floating = signal<(number | null)[] | undefined>(undefined);
export const degrees = signal(localStorage.getItem("unit") !== "rad");
export const show = signal({ command: true, achieved: true, ghosts: true });

export interface Toast {
  id: number;
  text: string;
  kind: "info" | "error";
  undo?: boolean;
}
export const toasts = signal<Toast[]>([]);
export const announcement = signal("");

let nextToast = 1;

export function toast(text: string, kind: Toast["kind"] = "info", undo = false): void {
  const id = nextToast++;
  toasts.value = [...toasts.value.slice(-3), { id, text, kind, undo }];
  announcement.value = text;
  setTimeout(() => {
    toasts.value = toasts.value.filter((t) => t.id !== id);
  }, kind === "error" ? 12_000 : 5_000);
}

export const frames = computed(() => doc.value?.clip.length ?? 0);

/** Shown value of an angle or a length. */
export function shown(value: number, unit: "rad" | "m"): string {
  if (unit === "m") return `${value.toFixed(3)} m`;
  return degrees.value ? `${((value * 180) / Math.PI).toFixed(1)}°` : `${value.toFixed(3)} rad`;
}
