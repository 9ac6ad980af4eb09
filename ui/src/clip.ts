// The document as the server sends it, and the few questions that drawing asks of it. All
// edits are made by the server; nothing here changes a clip.

export type Fill = "mask" | "linear" | "cubic" | "hold";

export interface Key {
  frame: number;
  pose?: string;
  q?: (number | null)[];
  hold?: number;
  fill?: Fill;
  note?: string;
}

export interface Mask {
  from: number;
  to: number;
  joints?: string[];
}

export interface Marker {
  frame: number;
  name: string;
}

export interface Clip {
  format: string;
  name?: string;
  notes?: string;
  robot: { id: string; joints: string[]; units?: ("rad" | "m")[] };
  fps: number;
  length: number;
  fill?: Fill;
  poses?: Record<string, (number | null)[]>;
  keys: Key[];
  masks?: Mask[];
  markers?: Marker[];
}

/** Frames that a key commands: its own and its hold. */
export function keyEnd(key: Key): number {
  return key.frame + Math.max(1, key.hold ?? 1);
}

/** What follows a key until the next one. */
export function fillAfter(clip: Clip, key: Key): Fill {
  return key.fill ?? clip.fill ?? "mask";
}

/** Values of a key, whether written out or by the name of a pose. */
export function values(clip: Clip, key: Key): (number | null)[] {
  if (key.q) return key.q;
  return (key.pose !== undefined && clip.poses?.[key.pose]) || [];
}

export function keyAt(clip: Clip, frame: number): Key | undefined {
  return clip.keys.find((k) => k.frame === frame);
}

export function prevKey(clip: Clip, frame: number): Key | undefined {
  return clip.keys.filter((k) => k.frame < frame).at(-1);
}

export function nextKey(clip: Clip, frame: number): Key | undefined {
  return clip.keys.find((k) => k.frame > frame);
}

/** Frames as `m:ss:ff`-like text for people: seconds and frames. */
export function clock(frame: number, fps: number): string {
  return `${(frame / fps).toFixed(2)} s`;
}

/**
 * Time as typed: `2:15` is 2 s and 15 frames, `55f` or `55` are frames, `2.75s` are seconds.
 * Always a whole frame; undefined when it is no time.
 */
export function parseTime(text: string, fps: number): number | undefined {
  const t = text.trim();
  const pair = /^(\d+):(\d+)$/.exec(t);
  if (pair) return Number(pair[1]) * fps + Number(pair[2]);
  const frames = /^(\d+)f?$/.exec(t);
  if (frames) return Number(frames[1]);
  const secs = /^(\d+(?:\.\d*)?|\.\d+)s$/.exec(t);
  if (secs) return Math.round(Number(secs[1]) * fps);
  return undefined;
}
