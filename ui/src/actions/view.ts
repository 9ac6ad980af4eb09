// What is shown, and from where.

import { leftShown, openLeft, rightShown, sheetTab } from "../layout";
import { pickReference } from "../reference";
import { toggleShadows } from "../shadows";
import * as store from "../store";
import { timeline } from "../timeline/handle";
import { frameToX, LABELS, PRE_ROLL, zoomAt } from "../timeline/layout";
import { startTour } from "../tour";
import { tell } from "../wire";
import { type Action, dialog, needsClip } from "./action";
import { seek } from "./playback";

/** Zooms about the playhead, or about the middle where that is out of sight. */
export function zoom(factor: number): void {
  const { width } = store.sheet.value;
  const x = frameToX(store.view.value, store.playhead.value);
  store.view.value = zoomAt(store.view.value, x >= LABELS && x <= width ? x : (LABELS + width) / 2, factor);
}

export function pan(share: number): void {
  const v = store.view.value;
  const frames = (store.sheet.value.width - LABELS) / v.zoom;
  store.view.value = {
    ...v,
    left: Math.min(store.length.value, Math.max(-PRE_ROLL, v.left + share * frames)),
  };
}

export function problem(direction: 1 | -1): void {
  const places = (store.doc.value?.findings.lints ?? [])
    .flatMap((l) => (l.frames ? [l.frames[0]] : []))
    .sort((a, b) => a - b);
  const at = store.playhead.value;
  const next =
    direction === 1
      ? (places.find((f) => f > at) ?? places[0])
      : (places.filter((f) => f < at).at(-1) ?? places.at(-1));
  if (next === undefined) store.toast("no problems");
  else seek(next);
}

export function toggleShow(what: keyof typeof store.show.value): void {
  store.show.value = { ...store.show.value, [what]: !store.show.value[what] };
  tell("view.show", { [what]: store.show.value[what] });
}

/** Still pictures have one view. */
export function needsSpace(): string | undefined {
  return store.stills.value ? "still pictures have one view only; other views need the 3D view" : undefined;
}

export const VIEW: Action[] = [
  {
    id: "show-command",
    title: "Show the command",
    group: "View",
    keys: ["1"],
    run: () => toggleShow("command"),
  },
  {
    id: "show-achieved",
    title: "Show the achieved motion",
    group: "View",
    keys: ["2"],
    run: () => toggleShow("achieved"),
  },
  {
    id: "show-both",
    title: "Show the command and the achieved motion",
    group: "View",
    keys: ["3"],
    run: () => {
      store.show.value = { ...store.show.value, command: true, achieved: true };
      tell("view.show", { command: true, achieved: true });
    },
  },
  {
    id: "ghosts",
    title: "Ghosts of the neighbouring keys",
    group: "View",
    keys: ["4", "O"],
    run: () => toggleShow("ghosts"),
  },
  {
    id: "path",
    title: "Path of the selected link or end effector",
    group: "View",
    keys: ["5"],
    not: needsSpace,
    run: () => toggleShow("path"),
  },
  {
    id: "show-reachable",
    title: "Show the reachable pose, where a key asks for another",
    group: "View",
    keys: ["6"],
    not: needsSpace,
    run: () => toggleShow("reachable"),
  },
  {
    id: "frame",
    title: "Show the selected link, or the whole motion",
    group: "View",
    keys: ["F"],
    not: needsSpace,
    run: () => tell("view.camera", { preset: "selection" }),
  },
  {
    id: "view-home",
    title: "View: the whole motion",
    group: "View",
    keys: ["Alt+0"],
    not: needsSpace,
    run: () => tell("view.camera", { preset: "fit" }),
  },
  {
    id: "view-front",
    title: "View: from the front",
    group: "View",
    keys: ["Alt+1"],
    not: needsSpace,
    run: () => tell("view.camera", { preset: "front" }),
  },
  {
    id: "view-side",
    title: "View: from the side",
    group: "View",
    keys: ["Alt+2"],
    not: needsSpace,
    run: () => tell("view.camera", { preset: "side" }),
  },
  {
    id: "view-top",
    title: "View: from above",
    group: "View",
    keys: ["Alt+3"],
    not: needsSpace,
    run: () => tell("view.camera", { preset: "top" }),
  },
  {
    id: "fit",
    title: "Fit the timeline",
    group: "View",
    keys: ["Shift+F"],
    run: () => timeline.value?.fit(),
  },
  { id: "zoom-in", title: "Zoom the timeline in", group: "View", keys: ["Z"], run: () => zoom(1.5) },
  {
    id: "zoom-out",
    title: "Zoom the timeline out",
    group: "View",
    keys: ["Shift+Z"],
    run: () => zoom(1 / 1.5),
  },
  { id: "pan-left", title: "Timeline to the left", group: "View", keys: ["PageUp"], run: () => pan(-0.5) },
  { id: "pan-right", title: "Timeline to the right", group: "View", keys: ["PageDown"], run: () => pan(0.5) },
  {
    id: "row-up",
    title: "Row above",
    group: "View",
    keys: ["Ctrl+ArrowUp"],
    run: () => timeline.value?.step(-1),
  },
  {
    id: "row-down",
    title: "Row below",
    group: "View",
    keys: ["Ctrl+ArrowDown"],
    run: () => timeline.value?.step(1),
  },
  { id: "next-problem", title: "Next problem", group: "View", keys: ["N"], run: () => problem(1) },
  { id: "prev-problem", title: "Previous problem", group: "View", keys: ["Shift+N"], run: () => problem(-1) },
  {
    id: "unit",
    title: "Degrees or radians",
    group: "View",
    run: () => {
      store.degrees.value = !store.degrees.value;
      localStorage.setItem("unit", store.degrees.value ? "deg" : "rad");
    },
  },
  {
    id: "panel-left",
    title: "Show or hide the left panel",
    group: "View",
    keys: ["Ctrl+B"],
    run: () => (leftShown.value = !leftShown.value),
  },
  {
    id: "panel-right",
    title: "Show or hide the right panel",
    group: "View",
    keys: ["Ctrl+Shift+B"],
    run: () => (rightShown.value = !rightShown.value),
  },
  {
    id: "compare-table",
    title: "Compare all takes in a table",
    group: "View",
    run: () => (store.side.value = "compare"),
  },
  {
    id: "reference",
    title: "Reference: a film or a sound to follow…",
    group: "View",
    not: needsClip,
    run: pickReference,
  },
  {
    id: "graph",
    title: "Keys as rows or as curves: timeline or graph",
    group: "View",
    keys: ["V"],
    run: () => (sheetTab.value = sheetTab.value === "graph" ? "timeline" : "graph"),
  },
  { id: "tab-poses", title: "Panel: poses", group: "View", run: () => openLeft("poses") },
  { id: "tab-policies", title: "Panel: policies", group: "View", run: () => openLeft("policies") },
  { id: "tab-takes", title: "Panel: takes", group: "View", run: () => openLeft("takes") },
  {
    id: "shadows",
    title: "Shadow of the robot on the ground",
    group: "View",
    not: needsSpace,
    run: toggleShadows,
  },
  { id: "theme", title: "Dark or light", group: "View", run: dialog("theme") },
  { id: "tour", title: "Take the tour", group: "View", not: needsClip, run: startTour },
  { id: "help", title: "All shortcuts", group: "View", keys: ["?", "F1"], run: dialog("keys") },
  {
    id: "palette",
    title: "Search joints, poses, examples, commands",
    group: "View",
    keys: ["Ctrl+K"],
    run: dialog("palette"),
  },
  {
    id: "rendered",
    title: "Show or hide the picture as it is exported",
    group: "View",
    run: () => (store.side.value = store.side.value === "rendered" ? "curves" : "rendered"),
  },
];
