// The clip as a whole: its start, its files, its rollouts.

import { pick } from "../clip_import";
import { opening, save } from "../documents";
import { poseAt } from "../posing";
import * as store from "../store";
import { compareBefore, pinTake } from "../takes";
import { edit, http, tell } from "../wire";
import { type Action, clip, dialog, needsClip, needsTake } from "./action";

/** Sets the state before frame 0; the last frame of the take makes the clip run on where it ends. */
export function setStart(from: "key" | "rest" | "pose" | "take"): void {
  const d = store.doc.value;
  if (!d) return;
  const q =
    from === "rest"
      ? d.table.rest
      : from === "pose"
        ? (store.floating.value ?? poseAt(d.clip, store.playhead.value))
        : store.frames.value.q.at(-1);
  void edit("clip.start", {
    start: from === "key" || !q ? null : { q: q.map((v) => Math.round(v * 1e6) / 1e6) },
  });
}

/** An empty clip of the robot that is open; this one waits if it was never saved. */
export function newClip(): Promise<void> {
  const id = clip()?.robot.id ?? "";
  return opening(
    http("POST /api/new", { body: { robot: store.robots.value.find((r) => r.id === id)?.source ?? id } }),
  );
}

export const DOCUMENT: Action[] = [
  { id: "start-key", title: "Start at the first key", group: "Document", run: () => setStart("key") },
  {
    id: "start-rest",
    title: "Start at the rest pose of the robot",
    group: "Document",
    run: () => setStart("rest"),
  },
  {
    id: "start-pose",
    title: "Start from the pose at the playhead",
    group: "Document",
    run: () => setStart("pose"),
  },
  {
    id: "start-take",
    title: "Start at the end of the take",
    group: "Document",
    not: needsTake,
    run: () => setStart("take"),
  },
  {
    id: "rename",
    title: "Rename the clip…",
    group: "Document",
    keys: ["F2"],
    run: () => (store.renaming.value = true),
  },
  {
    id: "length",
    title: "Length of the clip…",
    group: "Document",
    run: () => document.querySelector<HTMLElement>("[data-testid=length]")?.focus(),
  },
  { id: "undo", title: "Undo", group: "Document", keys: ["Ctrl+Z"], run: () => tell("undo") },
  { id: "redo", title: "Redo", group: "Document", keys: ["Ctrl+Shift+Z", "Ctrl+Y"], run: () => tell("redo") },
  {
    id: "history",
    title: "History: go to any edit…",
    group: "Document",
    keys: ["Ctrl+H"],
    run: dialog("history"),
  },
  { id: "save", title: "Save", group: "Document", keys: ["Ctrl+S"], not: needsClip, run: () => void save() },
  {
    id: "save-as",
    title: "Save as…",
    group: "Document",
    keys: ["Ctrl+Shift+S"],
    not: needsClip,
    run: dialog("save-as"),
  },
  {
    id: "new",
    title: "New clip of this robot",
    group: "Document",
    not: needsClip,
    run: () => void newClip(),
  },
  { id: "open", title: "Open…", group: "Document", keys: ["Ctrl+O"], run: dialog("open") },
  {
    id: "pick",
    title: "Import from this computer (CSV, MJCF keys, ROS)…",
    group: "Document",
    keys: ["Ctrl+Shift+O"],
    run: () => pick(),
  },
  {
    id: "export",
    title: "Export…",
    group: "Document",
    keys: ["Ctrl+E"],
    not: needsClip,
    run: dialog("export"),
  },
  {
    id: "gallery",
    title: "Examples and recent files",
    group: "Document",
    run: () => (store.page.value = "gallery"),
  },
  {
    id: "runs",
    title: "Import, collect, train, evaluate",
    group: "Document",
    run: () => (store.page.value = "runs"),
  },
];

export const ROLLOUT: Action[] = [
  { id: "rollout", title: "Roll out now", group: "Rollout", keys: ["R"], run: () => tell("rollout.run") },
  {
    id: "stop-rollout",
    title: "Stop the rollout",
    group: "Rollout",
    keys: ["Shift+Escape"],
    not: () =>
      /running|waiting/.test(store.rollout.value?.phase ?? "") ? undefined : "no rollout is under way",
    run: () => tell("rollout.cancel"),
  },
  {
    id: "auto",
    title: "Automatic rollout on or off",
    group: "Rollout",
    keys: ["Shift+R"],
    run: () => tell("rollout.set", { ...store.settings.value, auto: !store.settings.value.auto }),
  },
  { id: "pin-take", title: "Pin or unpin the take", group: "Rollout", keys: ["Shift+B"], run: pinTake },
  {
    id: "compare",
    title: "Compare with the previous take (A/B)",
    group: "Rollout",
    keys: ["B"],
    run: compareBefore,
  },
];
