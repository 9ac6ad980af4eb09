// Everything a person can do, once: shortcuts, palette, menus and buttons all come here.

import { dropFloating, edit, keyFloating, openWith, poseAt, save, tell } from "./api";
import { keyAt, keyEnd, nextKey, prevKey, replaced, type Fill, type Key } from "./clip";
import { cancelDrag, nextSite, toggleLock, unlockedOnly } from "./hand";
import { pick } from "./intake";
import { menuByKey, type Item } from "./menu";
import { acted, type Span, type Why } from "./span";
import { LABELS, PRE_ROLL, frameToX, withFrame, zoomAt } from "./timeline/layout";
import * as store from "./store";
import { compareBefore, pinTake } from "./takes";

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
const needsClip = (): string | undefined => (clip() ? undefined : "open a clip first");
const selected = (): number[] => [...store.selection.value].sort((a, b) => a - b);

export function seek(frame: number): void {
  const last = Math.max(0, store.length.value - 1);
  store.playing.value = false;
  store.playhead.value = Math.min(last, Math.max(0, Math.round(frame)));
  keepInView(store.playhead.value);
}

/** A timeline that somebody has zoomed in follows the playhead. */
export function keepInView(frame: number): void {
  store.view.value = withFrame(store.view.value, store.sheet.value, frame);
}

/** Zooms about the playhead, or about the middle where that is out of sight. */
function zoom(factor: number): void {
  const { width } = store.sheet.value;
  const x = frameToX(store.view.value, store.playhead.value);
  store.view.value = zoomAt(store.view.value, x >= LABELS && x <= width ? x : (LABELS + width) / 2, factor);
}

function pan(share: number): void {
  const v = store.view.value;
  const frames = (store.sheet.value.width - LABELS) / v.zoom;
  store.view.value = { ...v, left: Math.min(store.length.value, Math.max(-PRE_ROLL, v.left + share * frames)) };
}

/** The next or previous key from the playhead joins the selection, and the playhead goes there. */
function extend(direction: 1 | -1): void {
  const c = clip();
  if (!c) return;
  const at = store.playhead.value;
  const to = direction === 1 ? nextKey(c, at) : prevKey(c, at);
  const here = keyAt(c, at);
  const chosen = new Set(store.selection.value);
  if (here) chosen.add(at);
  if (to) {
    // Back over a selected key takes the last one out again.
    if (here && chosen.has(to.frame)) chosen.delete(at);
    chosen.add(to.frame);
    seek(to.frame);
  }
  store.selection.value = chosen;
  store.announcement.value = `${chosen.size} selected`;
}

function toggleSelected(): void {
  const at = store.playhead.value;
  const chosen = new Set(store.selection.value);
  if (!chosen.delete(at)) chosen.add(at);
  store.selection.value = chosen;
  store.announcement.value = `key at frame ${at} ${chosen.has(at) ? "selected" : "not selected"}`;
}

const needsTake = (): string | undefined => (store.rollout.value?.phase === "done" && store.frames.value.q.length ? undefined : "there is no finished take");
const markerHere = () => clip()?.markers?.find((m) => m.frame === store.playhead.value);
const needsMarker = (): string | undefined => (markerHere() ? undefined : "there is no marker at the playhead: Ctrl+. goes to the next");

function toMarker(direction: 1 | -1): void {
  const all = (clip()?.markers ?? []).map((m) => m.frame).sort((a, b) => a - b);
  const at = store.playhead.value;
  const to = direction === 1 ? all.find((f) => f > at) : all.filter((f) => f < at).at(-1);
  if (to === undefined) store.toast(all.length ? "no more markers there" : "no markers; Shift+M sets one");
  else seek(to);
}

let turn: Promise<void> = Promise.resolve();

/** One after the other: a key that is held down repeats faster than edits are acknowledged. */
function inTurn(run: () => Promise<void>): void {
  turn = turn.then(run, run);
}

function moveMarker(df: number): void {
  inTurn(async () => {
    const why = needsMarker();
    if (why) return store.toast(why);
    const to = store.playhead.value + df;
    if (to < 0 || to >= store.length.value) return;
    if (await edit("markers.move", { frame: store.playhead.value, to })) seek(to);
  });
}

/** What can be done with the marker at a frame. */
export function markerItems(frame: number): Item[] {
  const here = (id: string) => () => { seek(frame); act(id); };
  return [
    { title: "Rename marker…", run: here("rename-marker") },
    { title: "Marker one frame earlier", keys: "<", run: here("marker-earlier") },
    { title: "Marker one frame later", keys: ">", run: here("marker-later") },
    { title: "Delete marker", run: here("delete-marker") },
  ];
}

/** Where the motion starts: what stands before frame 0. */
export function startItems(): Item[] {
  return ["start-key", "start-rest", "start-pose", "start-take"].flatMap((id) => {
    const a = ACTIONS.find((x) => x.id === id);
    return a ? [{ title: a.title, run: () => act(id), why: a.not?.() }] : [];
  });
}

/** Sets the state before frame 0; the last frame of the take makes the clip run on where it ends. */
function setStart(from: "key" | "rest" | "pose" | "take"): void {
  const d = store.doc.value;
  if (!d) return;
  const q = from === "rest" ? d.table.rest : from === "pose" ? (store.floating.value ?? poseAt(d.clip, store.playhead.value)) : store.frames.value.q.at(-1);
  void edit("clip.start", { start: from === "key" || !q ? null : { q: q.map((v) => Math.round(v * 1e6) / 1e6) } });
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
  const landing = keys.map((k) => k.frame - first + at);
  const c = clip();
  const lost = c ? replaced(c, landing) : 0;
  if (await edit("keys.paste", { at, keys, replace: true, mirrored, ...unlockedOnly() })) {
    store.selection.value = new Set(landing);
    tellReplaced(lost);
  }
}

/** What stood where keys have landed is gone: that is said, with the way back. */
export function tellReplaced(count: number): void {
  if (count) store.toast(`replaced ${count === 1 ? "a key" : `${count} keys`}`, "info", true);
}

/** The frames that M and U act on now. */
export function span(): (Span & { why: Why }) | undefined {
  const c = clip();
  return c && acted(c, store.selection.value, store.range.value, store.playhead.value);
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
  if (keyAt(c, frame)) {
    // It keeps all that it has: hold, fill, note, pose, joints left open.
    store.selection.value = new Set([frame]);
    store.announcement.value = `key at frame ${frame} selected`;
    return;
  }
  void edit("keys.add", { keys: [{ frame, q: poseAt(c, frame) }] }).then((ok) => {
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

const row = (by: 1 | -1): void => void document.dispatchEvent(new CustomEvent("robert-row", { detail: by }));
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

  { id: "key", title: "Key the pose at the playhead; a key that is there is selected", group: "Keys", keys: ["K", "I"], run: addKey },
  { id: "delete", title: "Delete keys", group: "Keys", keys: ["Delete", "X"], not: needsKeys, run: () => void edit("keys.delete", { frames: selected() }).then((ok) => ok && (store.selection.value = new Set())) },
  { id: "copy", title: "Copy keys", group: "Keys", keys: ["Ctrl+C"], not: needsKeys, run: () => void copyKeys() },
  { id: "cut", title: "Cut keys", group: "Keys", keys: ["Ctrl+X"], not: needsKeys, run: () => { const k = copyKeys(); if (k.length) void edit("keys.delete", { frames: k.map((x) => x.frame) }); } },
  { id: "paste", title: "Paste keys at the playhead", group: "Keys", keys: ["Ctrl+V"], run: () => void paste(false) },
  { id: "paste-mirrored", title: "Paste mirrored", group: "Keys", keys: ["Ctrl+Shift+V"], not: () => store.noMirror.value ?? undefined, run: () => void paste(true) },
  { id: "duplicate", title: "Duplicate keys after the last", group: "Keys", keys: ["Ctrl+D"], not: needsKeys, run: () => { const f = selected(); const a = f[0] ?? 0; const b = f.at(-1) ?? a; const last = clip()?.keys.find((k) => k.frame === b); const df = (last ? keyEnd(last) : b + 1) - a + 4; const landing = f.map((x) => x + df); const c = clip(); const lost = c ? replaced(c, landing) : 0; void edit("keys.move", { frames: f, df, copy: true, replace: true }).then((ok) => { if (ok) { store.selection.value = new Set(landing); tellReplaced(lost); } }); } },
  { id: "mirror", title: "Mirror keys", group: "Keys", not: () => needsKeys() ?? store.noMirror.value ?? undefined, run: () => void edit("keys.mirror", { frames: selected() }) },
  { id: "select-here", title: "Select the key at the playhead, or not", group: "Keys", keys: ["Ctrl+Space"], not: () => (clip() && keyAt(clip() ?? { keys: [] }, store.playhead.value) ? undefined : "there is no key at the playhead"), run: toggleSelected },
  { id: "extend-next", title: "Select on to the next key", group: "Keys", keys: ["Ctrl+Shift+ArrowRight"], run: () => extend(1) },
  { id: "extend-prev", title: "Select back to the previous key", group: "Keys", keys: ["Ctrl+Shift+ArrowLeft"], run: () => extend(-1) },
  { id: "open-key", title: "Type the values of the key at the playhead", group: "Keys", keys: ["Enter"], run: () => void document.dispatchEvent(new Event("robert-enter")) },
  { id: "menu", title: "Menu at the playhead, or of a pose", group: "Keys", keys: ["Shift+F10", "ContextMenu"], run: menuByKey },
  { id: "select-all", title: "Select all keys", group: "Keys", keys: ["Ctrl+A"], run: () => (store.selection.value = new Set(clip()?.keys.map((k) => k.frame))) },
  { id: "clear", title: "Clear selection", group: "Keys", keys: ["Escape"], run: () => { if (cancelDrag()) return; if (store.site.value) tell("view.select", {}); if (store.floating.value) dropFloating(); store.selection.value = new Set(); } },
  { id: "earlier", title: "Move keys one frame earlier", group: "Keys", keys: ["Alt+ArrowLeft"], not: needsKeys, run: () => nudge(-1, false) },
  { id: "later", title: "Move keys one frame later", group: "Keys", keys: ["Alt+ArrowRight"], not: needsKeys, run: () => nudge(1, false) },
  { id: "ripple-earlier", title: "Ripple one frame earlier", group: "Keys", keys: ["Alt+Shift+ArrowLeft"], not: needsKeys, run: () => nudge(-1, true) },
  { id: "ripple-later", title: "Ripple one frame later", group: "Keys", keys: ["Alt+Shift+ArrowRight"], not: needsKeys, run: () => nudge(1, true) },
  { id: "retime", title: "Retime keys about the playhead…", group: "Keys", keys: ["S"], not: needsKeys, run: dialog("retime") },
  { id: "ripple-right", title: "Insert or remove time at the playhead…", group: "Keys", keys: ["E"], run: dialog("time") },
  { id: "hold", title: "Hold keys…", group: "Keys", keys: ["H"], not: needsKeys, run: dialog("hold") },
  { id: "sparsify", title: "Thin out keys: keep the extremes…", group: "Keys", keys: ["T"], not: () => ((clip()?.keys.length ?? 0) > 2 ? undefined : "there are no three keys"), run: dialog("sparsify") },
  { id: "densify", title: "Take as keys…", group: "Keys", keys: ["Shift+T"], not: needsTake, run: dialog("densify") },
  { id: "save-pose", title: "Save the pose at the playhead", group: "Keys", keys: ["P"], run: dialog("pose") },
  { id: "marker", title: "Add a marker at the playhead", group: "Keys", keys: ["Shift+M"], run: dialog("marker") },
  { id: "next-marker", title: "Next marker", group: "Playback", keys: ["Ctrl+."], run: () => toMarker(1) },
  { id: "prev-marker", title: "Previous marker", group: "Playback", keys: ["Ctrl+,"], run: () => toMarker(-1) },
  { id: "marker-earlier", title: "Move the marker one frame earlier", group: "Keys", keys: ["<"], run: () => moveMarker(-1) },
  { id: "marker-later", title: "Move the marker one frame later", group: "Keys", keys: [">"], run: () => moveMarker(1) },
  { id: "rename-marker", title: "Rename the marker at the playhead…", group: "Keys", not: needsMarker, run: dialog("rename-marker") },
  { id: "delete-marker", title: "Delete the marker at the playhead", group: "Keys", not: needsMarker, run: () => void edit("markers.delete", { frames: [store.playhead.value] }) },

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
  { id: "zoom-in", title: "Zoom the timeline in", group: "View", keys: ["Z"], run: () => zoom(1.5) },
  { id: "zoom-out", title: "Zoom the timeline out", group: "View", keys: ["Shift+Z"], run: () => zoom(1 / 1.5) },
  { id: "pan-left", title: "Timeline to the left", group: "View", keys: ["PageUp"], run: () => pan(-0.5) },
  { id: "pan-right", title: "Timeline to the right", group: "View", keys: ["PageDown"], run: () => pan(0.5) },
  { id: "row-up", title: "Row above", group: "View", keys: ["Ctrl+ArrowUp"], run: () => row(-1) },
  { id: "row-down", title: "Row below", group: "View", keys: ["Ctrl+ArrowDown"], run: () => row(1) },
  { id: "next-problem", title: "Next problem", group: "View", keys: ["N"], run: () => problem(1) },
  { id: "prev-problem", title: "Previous problem", group: "View", keys: ["Shift+N"], run: () => problem(-1) },
  { id: "unit", title: "Degrees or radians", group: "View", run: () => { store.degrees.value = !store.degrees.value; localStorage.setItem("unit", store.degrees.value ? "deg" : "rad"); } },
  { id: "theme", title: "Dark or light", group: "View", run: dialog("theme") },
  { id: "help", title: "All shortcuts", group: "View", keys: ["?", "F1"], run: dialog("keys") },
  { id: "palette", title: "Find a command", group: "View", keys: ["Ctrl+K"], run: dialog("palette") },

  { id: "start-key", title: "Start where the first key is", group: "Document", run: () => setStart("key") },
  { id: "start-rest", title: "Start where the robot rests", group: "Document", run: () => setStart("rest") },
  { id: "start-pose", title: "Start from the pose at the playhead", group: "Document", run: () => setStart("pose") },
  { id: "start-take", title: "Start where the take ends", group: "Document", not: needsTake, run: () => setStart("take") },
  { id: "rename", title: "Rename the clip…", group: "Document", keys: ["F2"], run: () => void document.dispatchEvent(new Event("robert-rename")) },
  { id: "length", title: "Length of the clip…", group: "Document", run: () => document.querySelector<HTMLElement>("[data-testid=length]")?.focus() },

  { id: "rollout", title: "Roll out now", group: "Rollout", keys: ["R"], run: () => tell("rollout.run") },
  { id: "stop-rollout", title: "Stop the rollout", group: "Rollout", keys: ["Shift+Escape"], not: () => (/running|waiting/.test(store.rollout.value?.phase ?? "") ? undefined : "no rollout is under way"), run: () => tell("rollout.cancel") },
  { id: "auto", title: "Automatic rollout on or off", group: "Rollout", keys: ["Shift+R"], run: () => tell("rollout.set", { ...store.settings.value, auto: !store.settings.value.auto }) },
  { id: "pin-take", title: "Pin the take, or let it go", group: "Rollout", keys: ["Shift+B"], run: pinTake },
  { id: "compare", title: "Compare with the take before (A/B)", group: "Rollout", keys: ["B"], run: compareBefore },
  { id: "auto-key", title: "Automatic keys on or off", group: "Keys", run: () => (store.autoKey.value = !store.autoKey.value) },

  { id: "undo", title: "Undo", group: "Document", keys: ["Ctrl+Z"], run: () => tell("undo") },
  { id: "redo", title: "Redo", group: "Document", keys: ["Ctrl+Shift+Z", "Ctrl+Y"], run: () => tell("redo") },
  { id: "history", title: "History: go to any edit…", group: "Document", keys: ["Ctrl+H"], run: dialog("history") },
  { id: "save", title: "Save", group: "Document", keys: ["Ctrl+S"], not: needsClip, run: () => void save() },
  { id: "save-as", title: "Save as…", group: "Document", keys: ["Ctrl+Shift+S"], not: needsClip, run: dialog("save-as") },
  { id: "new", title: "New clip of this robot", group: "Document", not: needsClip, run: () => void newClip() },
  { id: "open", title: "Open…", group: "Document", keys: ["Ctrl+O"], run: dialog("open") },
  { id: "pick", title: "Import from this computer (CSV, MJCF keys, ROS)…", group: "Document", keys: ["Ctrl+Shift+O"], run: pick },
  { id: "export", title: "Export…", group: "Document", keys: ["Ctrl+E"], not: needsClip, run: dialog("export") },
  { id: "gallery", title: "Examples and recent files", group: "Document", run: () => (store.page.value = "gallery") },
  { id: "runs", title: "Import, collect, train, evaluate", group: "Document", run: () => (store.page.value = "runs") },
  { id: "rendered", title: "The picture as it is exported", group: "View", run: () => (store.side.value = store.side.value === "rendered" ? "curves" : "rendered") },
];

/** An empty clip of the robot that is open; this one waits if it was never saved. */
function newClip(): Promise<void> {
  const id = clip()?.robot.id ?? "";
  return openWith("POST", "/api/new", { robot: store.robots.value.find((r) => r.id === id)?.source ?? id });
}

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
  void edit("mask.set", { from: s.from, to: s.to, joints, masked }).then((ok) => {
    if (ok) store.toast(`frames ${s.from} to ${s.to - 1}, ${names}: ${masked ? "no goal" : "goals again"}`);
  });
}

function maskSpan(masked: boolean, joint?: string): void {
  const s = span();
  if (!s) return store.toast("there are no frames between keys here");
  void edit("mask.set", { from: s.from, to: s.to, ...(joint ? { joints: [joint] } : {}), masked }).then((ok) => {
    if (ok) store.toast(`frames ${s.from} to ${s.to - 1}, ${joint ?? "all joints"}: ${masked ? "no goal" : "goals again"}`);
  });
}

function nudge(df: number, ripple: boolean): void {
  inTurn(async () => {
    const frames = selected();
    const first = frames[0];
    if (first === undefined || first + df < 0) return;
    if (!(await edit("keys.move", { frames, df, ripple, replace: false }))) return;
    // The playhead stays on the key that it was on.
    if (frames.includes(store.playhead.value)) seek(store.playhead.value + df);
    store.selection.value = new Set(frames.map((f) => f + df));
  });
}

export function act(id: string): void {
  const action = ACTIONS.find((a) => a.id === id);
  const why = action?.not?.();
  if (why) store.toast(why);
  else action?.run();
}
