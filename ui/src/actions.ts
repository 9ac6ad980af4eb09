// Everything a person can do, once: shortcuts, palette, menus and buttons all come here.

import { dropFloating, edit, keyFloating, poseAt, save, tell } from "./api";
import { keyAt, keyEnd, nextKey, prevKey, type Fill, type Key } from "./clip";
import { cancelDrag, nextSite, toggleLock, unlockedOnly } from "./hand";
import * as store from "./store";

export interface Action {
  id: string;
  title: string;
  group: "Playback" | "Keys" | "Masks" | "View" | "Document" | "Rollout";
  keys?: string[];
  run: () => void;
  /** Why it cannot be done now; undefined when it can. */
  not?: () => string | undefined;
}

const clip = () => store.doc.value?.clip;
const needsKeys = (): string | undefined => (store.selection.value.size ? undefined : "select keys first");
const selected = (): number[] => [...store.selection.value].sort((a, b) => a - b);

export function seek(frame: number): void {
  const last = Math.max(0, store.length.value - 1);
  store.playing.value = false;
  store.playhead.value = Math.min(last, Math.max(0, Math.round(frame)));
}

export function copyKeys(): Key[] {
  const c = clip();
  const chosen = c?.keys.filter((k) => store.selection.value.has(k.frame)) ?? [];
  if (!c || chosen.length === 0) return [];
  const poses = Object.fromEntries(chosen.flatMap((k) => (k.pose && c.poses?.[k.pose] ? [[k.pose, c.poses[k.pose]]] : [])));
  // The clipboard holds a fragment of the clip format, so that it can be pasted anywhere.
  const fragment = { format: c.format, robot: c.robot, keys: chosen, poses };
  void navigator.clipboard?.writeText(JSON.stringify(fragment)).catch(() => undefined);
  clipboard = chosen.map((k) => ({ ...k }));
  store.toast(`${chosen.length === 1 ? "key" : `${chosen.length} keys`} copied`);
  return chosen;
}

let clipboard: Key[] = [];

export async function paste(mirrored: boolean): Promise<void> {
  let keys = clipboard;
  try {
    const text = await navigator.clipboard?.readText();
    const fragment = text?.startsWith("{") ? (JSON.parse(text) as { format?: string; keys?: Key[] }) : undefined;
    if (fragment?.format?.startsWith("robert-clip/") && fragment.keys?.length) keys = fragment.keys;
  } catch {
    // Without permission the page's own clipboard serves.
  }
  if (keys.length === 0) return store.toast("nothing to paste");
  const at = store.playhead.value;
  const first = Math.min(...keys.map((k) => k.frame));
  if (await edit("keys.paste", { at, keys, replace: true, mirrored, ...unlockedOnly() })) {
    store.selection.value = new Set(keys.map((k) => k.frame - first + at));
  }
}

/** The frames that M and U act on: in/out, else the span of the selection, else the interval. */
function span(): { from: number; to: number } | undefined {
  if (store.range.value) return store.range.value;
  const c = clip();
  if (!c) return undefined;
  const frames = selected();
  const a = frames[0];
  const b = frames.at(-1);
  if (a !== undefined && b !== undefined && a !== b) return { from: a + 1, to: b };
  const at = store.playhead.value;
  const before = keyAt(c, at) ?? prevKey(c, at);
  const after = nextKey(c, at);
  return { from: before ? keyEnd(before) : 0, to: after?.frame ?? c.length };
}

export function setFill(fill: Fill): void {
  const c = clip();
  if (!c) return;
  const frames = selected();
  const at = store.playhead.value;
  const before = keyAt(c, at) ?? prevKey(c, at);
  const targets = frames.length ? frames : before ? [before.frame] : [];
  if (targets.length) void edit("fill.set", { frames: targets, fill });
}

export function addKey(): void {
  const c = clip();
  if (!c) return;
  if (store.floating.value) return void keyFloating();
  const frame = store.playhead.value;
  void edit("keys.add", { keys: [{ frame, q: poseAt(c, frame) }], replace: true }).then((ok) => {
    if (ok) store.selection.value = new Set([frame]);
  });
}

function problem(direction: 1 | -1): void {
  const places = (store.doc.value?.findings.lints ?? [])
    .flatMap((l) => (l.frames ? [l.frames[0]] : []))
    .sort((a, b) => a - b);
  const at = store.playhead.value;
  const next = direction === 1 ? places.find((f) => f > at) ?? places[0] : places.filter((f) => f < at).at(-1) ?? places.at(-1);
  if (next === undefined) store.toast("no problems");
  else seek(next);
}

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

function changeSpeed(step: 1 | -1): void {
  const i = SPEEDS.indexOf(store.speed.value);
  store.speed.value = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, i + step))] ?? 1;
}

export function toggleShow(what: "command" | "achieved" | "ghosts"): void {
  store.show.value = { ...store.show.value, [what]: !store.show.value[what] };
  tell("view.show", { [what]: store.show.value[what] });
}

const dialog = (name: string) => () => document.dispatchEvent(new CustomEvent("robert-dialog", { detail: name }));

export const ACTIONS: Action[] = [
  { id: "play", title: "Play or pause", group: "Playback", keys: ["Space"], run: () => (store.playing.value = !store.playing.value) },
  { id: "next-frame", title: "Next frame", group: "Playback", keys: ["ArrowRight"], run: () => seek(store.playhead.value + 1) },
  { id: "prev-frame", title: "Previous frame", group: "Playback", keys: ["ArrowLeft"], run: () => seek(store.playhead.value - 1) },
  { id: "next-ten", title: "Forward 10 frames", group: "Playback", keys: ["Shift+ArrowRight"], run: () => seek(store.playhead.value + 10) },
  { id: "prev-ten", title: "Back 10 frames", group: "Playback", keys: ["Shift+ArrowLeft"], run: () => seek(store.playhead.value - 10) },
  { id: "next-key", title: "Next key", group: "Playback", keys: ["ArrowDown", "."], run: () => { const c = clip(); const k = c && nextKey(c, store.playhead.value); if (k) seek(k.frame); } },
  { id: "prev-key", title: "Previous key", group: "Playback", keys: ["ArrowUp", ","], run: () => { const c = clip(); const k = c && prevKey(c, store.playhead.value); if (k) seek(k.frame); } },
  { id: "home", title: "To the start", group: "Playback", keys: ["Home"], run: () => seek(0) },
  { id: "end", title: "To the end", group: "Playback", keys: ["End"], run: () => seek(store.length.value) },
  { id: "in", title: "Set loop in", group: "Playback", keys: ["["], run: () => (store.range.value = { from: store.playhead.value, to: Math.max(store.playhead.value + 1, store.range.value?.to ?? store.length.value) }) },
  { id: "out", title: "Set loop out", group: "Playback", keys: ["]"], run: () => (store.range.value = { from: Math.min(store.range.value?.from ?? 0, store.playhead.value), to: store.playhead.value + 1 }) },
  { id: "no-range", title: "Clear loop range", group: "Playback", run: () => (store.range.value = undefined) },
  { id: "loop", title: "Loop on or off", group: "Playback", keys: ["L"], run: () => (store.loop.value = !store.loop.value) },
  { id: "slower", title: "Slower", group: "Playback", keys: ["-"], run: () => changeSpeed(-1) },
  { id: "faster", title: "Faster", group: "Playback", keys: ["+"], run: () => changeSpeed(1) },
  { id: "speed-1", title: "Real speed", group: "Playback", keys: ["0"], run: () => (store.speed.value = 1) },

  { id: "key", title: "Key the pose at the playhead", group: "Keys", keys: ["K", "I"], run: addKey },
  { id: "delete", title: "Delete keys", group: "Keys", keys: ["Delete", "X"], not: needsKeys, run: () => void edit("keys.delete", { frames: selected() }).then((ok) => ok && (store.selection.value = new Set())) },
  { id: "copy", title: "Copy keys", group: "Keys", keys: ["Ctrl+C"], not: needsKeys, run: () => void copyKeys() },
  { id: "cut", title: "Cut keys", group: "Keys", keys: ["Ctrl+X"], not: needsKeys, run: () => { const k = copyKeys(); if (k.length) void edit("keys.delete", { frames: k.map((x) => x.frame) }); } },
  { id: "paste", title: "Paste keys at the playhead", group: "Keys", keys: ["Ctrl+V"], run: () => void paste(false) },
  { id: "paste-mirrored", title: "Paste mirrored", group: "Keys", keys: ["Ctrl+Shift+V"], not: () => store.noMirror.value ?? undefined, run: () => void paste(true) },
  { id: "duplicate", title: "Duplicate keys after the last", group: "Keys", keys: ["Ctrl+D"], not: needsKeys, run: () => { const f = selected(); const a = f[0] ?? 0; const b = f.at(-1) ?? a; const last = clip()?.keys.find((k) => k.frame === b); const df = (last ? keyEnd(last) : b + 1) - a + 4; void edit("keys.move", { frames: f, df, copy: true, replace: true }).then((ok) => ok && (store.selection.value = new Set(f.map((x) => x + df)))); } },
  { id: "mirror", title: "Mirror keys", group: "Keys", not: () => needsKeys() ?? store.noMirror.value ?? undefined, run: () => void edit("keys.mirror", { frames: selected() }) },
  { id: "select-all", title: "Select all keys", group: "Keys", keys: ["Ctrl+A"], run: () => (store.selection.value = new Set(clip()?.keys.map((k) => k.frame))) },
  { id: "clear", title: "Clear selection", group: "Keys", keys: ["Escape"], run: () => { if (cancelDrag()) return; if (store.site.value) tell("view.select", {}); if (store.floating.value) dropFloating(); store.selection.value = new Set(); } },
  { id: "earlier", title: "Move keys one frame earlier", group: "Keys", keys: ["Alt+ArrowLeft"], not: needsKeys, run: () => nudge(-1, false) },
  { id: "later", title: "Move keys one frame later", group: "Keys", keys: ["Alt+ArrowRight"], not: needsKeys, run: () => nudge(1, false) },
  { id: "ripple-earlier", title: "Ripple one frame earlier", group: "Keys", keys: ["Alt+Shift+ArrowLeft"], not: needsKeys, run: () => nudge(-1, true) },
  { id: "ripple-later", title: "Ripple one frame later", group: "Keys", keys: ["Alt+Shift+ArrowRight"], not: needsKeys, run: () => nudge(1, true) },
  { id: "retime", title: "Retime keys about the playhead…", group: "Keys", keys: ["S"], not: needsKeys, run: dialog("retime") },
  { id: "ripple-right", title: "Insert or remove time at the playhead…", group: "Keys", keys: ["E"], run: dialog("time") },
  { id: "hold", title: "Hold keys…", group: "Keys", keys: ["H"], not: needsKeys, run: dialog("hold") },
  { id: "save-pose", title: "Save the pose at the playhead", group: "Keys", keys: ["P"], run: dialog("pose") },
  { id: "marker", title: "Add a marker at the playhead", group: "Keys", keys: ["Shift+M"], run: dialog("marker") },

  { id: "mask", title: "Mask: no goal here", group: "Masks", keys: ["M"], run: () => maskSpan(true) },
  { id: "unmask", title: "Unmask", group: "Masks", keys: ["U"], run: () => maskSpan(false) },
  { id: "mask-joint", title: "Mask the chosen joint only", group: "Masks", keys: ["Alt+M"], not: needsJointMask, run: () => maskSpan(true, chosenJoint()) },
  { id: "unmask-joint", title: "Unmask the chosen joint only", group: "Masks", keys: ["Alt+U"], not: needsJoint, run: () => maskSpan(false, chosenJoint()) },
  { id: "fill-mask", title: "Interval: leave it to the policy", group: "Masks", run: () => setFill("mask") },
  { id: "fill-linear", title: "Interval: straight line", group: "Masks", run: () => setFill("linear") },
  { id: "fill-cubic", title: "Interval: smooth curve", group: "Masks", run: () => setFill("cubic") },
  { id: "fill-hold", title: "Interval: hold", group: "Masks", run: () => setFill("hold") },

  { id: "show-command", title: "Show the command", group: "View", keys: ["1"], run: () => toggleShow("command") },
  { id: "show-achieved", title: "Show the achieved motion", group: "View", keys: ["2"], run: () => toggleShow("achieved") },
  { id: "show-both", title: "Show both", group: "View", keys: ["3"], run: () => { store.show.value = { ...store.show.value, command: true, achieved: true }; tell("view.show", { command: true, achieved: true }); } },
  { id: "ghosts", title: "Ghosts of the neighbouring keys", group: "View", keys: ["4", "O"], run: () => toggleShow("ghosts") },
  { id: "frame", title: "Frame the selected link, or the whole motion", group: "View", keys: ["F"], not: needsSpace, run: () => tell("view.camera", { preset: "selection" }) },
  { id: "view-home", title: "View: the whole motion", group: "View", keys: ["Alt+0"], not: needsSpace, run: () => tell("view.camera", { preset: "fit" }) },
  { id: "view-front", title: "View: from the front", group: "View", keys: ["Alt+1"], not: needsSpace, run: () => tell("view.camera", { preset: "front" }) },
  { id: "view-side", title: "View: from the side", group: "View", keys: ["Alt+2"], not: needsSpace, run: () => tell("view.camera", { preset: "side" }) },
  { id: "view-top", title: "View: from above", group: "View", keys: ["Alt+3"], not: needsSpace, run: () => tell("view.camera", { preset: "top" }) },
  { id: "reach", title: "Reach: the next fingertip or end effector", group: "Keys", keys: ["G"], run: nextSite },
  { id: "lock-joint", title: "Lock or free the chosen joint", group: "Keys", keys: ["Alt+L"], not: needsJoint, run: () => toggleLock([chosenJoint() ?? ""]) },
  { id: "unlock-all", title: "Free all joints", group: "Keys", not: () => (store.locked.value.size ? undefined : "no joint is locked"), run: () => toggleLock([...store.locked.value]) },
  { id: "fit", title: "Fit the timeline", group: "View", keys: ["Shift+F"], run: () => document.dispatchEvent(new Event("robert-fit")) },
  { id: "next-problem", title: "Next problem", group: "View", keys: ["N"], run: () => problem(1) },
  { id: "prev-problem", title: "Previous problem", group: "View", keys: ["Shift+N"], run: () => problem(-1) },
  { id: "unit", title: "Degrees or radians", group: "View", run: () => { store.degrees.value = !store.degrees.value; localStorage.setItem("unit", store.degrees.value ? "deg" : "rad"); } },
  { id: "theme", title: "Dark or light", group: "View", run: dialog("theme") },
  { id: "help", title: "All shortcuts", group: "View", keys: ["?", "F1"], run: dialog("keys") },
  { id: "palette", title: "Find a command", group: "View", keys: ["Ctrl+K"], run: dialog("palette") },

  { id: "rollout", title: "Roll out now", group: "Rollout", keys: ["R"], run: () => tell("rollout.run") },
  { id: "stop-rollout", title: "Stop the rollout", group: "Rollout", keys: ["Shift+Escape"], not: () => (/running|waiting/.test(store.rollout.value?.phase ?? "") ? undefined : "no rollout is under way"), run: () => tell("rollout.cancel") },
  { id: "auto", title: "Automatic rollout on or off", group: "Rollout", keys: ["Shift+R"], run: () => tell("rollout.set", { ...store.settings.value, auto: !store.settings.value.auto }) },
  { id: "auto-key", title: "Automatic keys on or off", group: "Keys", run: () => (store.autoKey.value = !store.autoKey.value) },

  { id: "undo", title: "Undo", group: "Document", keys: ["Ctrl+Z"], run: () => tell("undo") },
  { id: "redo", title: "Redo", group: "Document", keys: ["Ctrl+Shift+Z", "Ctrl+Y"], run: () => tell("redo") },
  { id: "history", title: "History: go to any edit…", group: "Document", keys: ["Ctrl+H"], run: dialog("history") },
  { id: "save", title: "Save", group: "Document", keys: ["Ctrl+S"], run: () => void save() },
  { id: "save-as", title: "Save as…", group: "Document", keys: ["Ctrl+Shift+S"], run: dialog("save-as") },
  { id: "open", title: "Open…", group: "Document", keys: ["Ctrl+O"], run: dialog("open") },
  { id: "export", title: "Export…", group: "Document", keys: ["Ctrl+E"], run: dialog("export") },
  { id: "gallery", title: "Examples and recent files", group: "Document", run: () => (store.page.value = "gallery") },
  { id: "runs", title: "Import, collect, train, evaluate", group: "Document", run: () => (store.page.value = "runs") },
  { id: "rendered", title: "The picture as it is exported", group: "View", run: () => (store.side.value = store.side.value === "rendered" ? "curves" : "rendered") },
];

/** The joint that is chosen on the timeline, in the viewport or among the sliders. */
export function chosenJoint(): string | undefined {
  const at = store.joint.value;
  return at === undefined ? undefined : clip()?.robot.joints[at];
}

function needsJoint(): string | undefined {
  return chosenJoint() ? undefined : "choose a joint first: click its name on the timeline";
}

/** Why a single joint cannot be masked now; undefined when it can. */
export function noJointMask(): string | undefined {
  return store.doc.value?.findings.granularity === "state"
    ? `${store.settings.value.policy} was trained with whole frames left open, not single joints; choose another policy to mask one joint`
    : undefined;
}

function needsJointMask(): string | undefined {
  return needsJoint() ?? noJointMask();
}

/** Still pictures have one view. */
function needsSpace(): string | undefined {
  return store.stills.value ? "still pictures are seen from where the whole motion fits; views need the 3D view" : undefined;
}

/** Masks or unmasks joints of a row about the playhead, as M and U do. */
export function toggleMask(joints: string[]): void {
  const s = span();
  const c = clip();
  if (!s || !c || s.to <= s.from) return;
  const hidden = (j: string): boolean => (c.masks ?? []).some((m) => m.from <= s.from && s.to <= m.to && (!m.joints || m.joints.includes(j)));
  const masked = !joints.every(hidden);
  const why = noJointMask();
  if (masked && why) return store.toast(why);
  const names = joints.length > 1 ? `${joints.length} joints` : (joints[0] ?? "");
  void edit("mask.set", { ...s, joints, masked }).then((ok) => {
    if (ok) store.toast(`frames ${s.from} to ${s.to - 1}, ${names}: ${masked ? "no goal" : "goals again"}`);
  });
}

function maskSpan(masked: boolean, joint?: string): void {
  const s = span();
  if (!s || s.to <= s.from) return;
  void edit("mask.set", { ...s, ...(joint ? { joints: [joint] } : {}), masked }).then((ok) => {
    if (ok) store.toast(`frames ${s.from} to ${s.to - 1}, ${joint ?? "all joints"}: ${masked ? "no goal" : "goals again"}`);
  });
}

function nudge(df: number, ripple: boolean): void {
  const frames = selected();
  const first = frames[0] ?? 0;
  if (first + df < 0) return;
  void edit("keys.move", { frames, df, ripple, replace: false }).then((ok) => {
    if (ok) store.selection.value = new Set(frames.map((f) => f + df));
  });
}

export function act(id: string): void {
  const action = ACTIONS.find((a) => a.id === id);
  const why = action?.not?.();
  if (why) store.toast(why);
  else action?.run();
}
