// Keys, poses and markers: what is chosen, made, moved, copied.

import { clock, type Key, keyAt, keyEnd, nextKey, prevKey, replaced } from "../clip";
import { type Fragment, fitted, fragmentOf, parseFragment } from "../clipboard";
import { drawing, needsSpaceAndSite, toggleDrawing } from "../draw";
import { deletePoints, needsPoint, nudgeValue } from "../graph/edits";
import { endsOf, grown, pivotOf } from "../grow";
import { sheetTab } from "../layout";
import { toggleLock, unlockedOnly } from "../locks";
import { menuByKey } from "../menu";
import { deleteOffset, needsOffset } from "../offsets";
import { needsSite, setPins, togglePin } from "../pins";
import { addPose, barePose, cancelDrag, dropFloating, keyFloating } from "../posing";
import type { Op } from "../protocol";
import { nextSite } from "../reach";
import * as store from "../store";
import { timeline } from "../timeline/handle";
import { applyOp, edit, tell } from "../wire";
import { type Action, clip, dialog, needsKeys, needsTake, selected } from "./action";
import { chosenJoint, needsJoint } from "./masks";
import { needsMarker, seek } from "./playback";

let turn: Promise<void> = Promise.resolve();

/** One after the other: a key that is held down repeats faster than edits are acknowledged. */
export function inTurn(run: () => Promise<void>): void {
  turn = turn.then(run, run);
}

/** The next or previous key from the playhead joins the selection, and the playhead goes there. */
export function extend(direction: 1 | -1): void {
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

export function toggleSelected(): void {
  const at = store.playhead.value;
  const chosen = new Set(store.selection.value);
  if (!chosen.delete(at)) chosen.add(at);
  store.selection.value = chosen;
  store.announcement.value = `key at frame ${at} ${chosen.has(at) ? "selected" : "not selected"}`;
}

export function moveMarker(df: number): void {
  inTurn(async () => {
    const why = needsMarker();
    if (why) return store.toast(why);
    const to = store.playhead.value + df;
    if (to < 0 || to >= store.length.value) return;
    if (await edit("markers.move", { frame: store.playhead.value, to })) seek(to);
  });
}

export function copyKeys(): Key[] {
  const c = clip();
  const chosen = c?.keys.filter((k) => store.selection.value.has(k.frame)) ?? [];
  if (!c || chosen.length === 0) return [];
  clipboard = fragmentOf(c, chosen);
  void navigator.clipboard?.writeText(JSON.stringify(clipboard)).catch(() => undefined);
  store.toast(`${chosen.length === 1 ? "key" : `${chosen.length} keys`} copied`);
  return chosen;
}

/** The page's own clipboard. */
let clipboard: Fragment | undefined;

export async function paste(mirrored: boolean): Promise<void> {
  const at = store.playhead.value;
  let fragment = clipboard;
  try {
    fragment = parseFragment(await navigator.clipboard.readText()) ?? clipboard;
  } catch {
    // Without permission the page's own clipboard serves.
  }
  const c = clip();
  if (!c || !fragment) return store.toast("nothing to paste");
  const { ik_sites = [], bodies = [] } = store.robot.value ?? {};
  const points = [...ik_sites, ...bodies].map((p) => p.name);
  const { keys, left } = fitted(fragment, c, points);
  if (keys.length === 0)
    return store.toast("nothing was pasted: the copied keys are of other joints than this clip's", "error");
  const first = Math.min(...keys.map((k) => k.frame));
  const landing = keys.map((k) => k.frame - first + at);
  const lost = replaced(c, landing);
  const op: Op = { op: "keys.paste", args: { at, keys, replace: true, mirrored, ...unlockedOnly() } };
  if (
    await editGrowing(
      op,
      endsOf(keys, (f) => f - first + at),
      "Paste keys",
    )
  ) {
    store.selection.value = new Set(landing);
    tellReplaced(lost);
    const some =
      left.length > 3 ? `${left.slice(0, 3).join(", ")} and ${left.length - 3} more` : left.join(", ");
    if (left.length) store.toast(`left out, because this clip does not have them: ${some}`);
  }
}

/** An edit after which keys end at these frames; the clip grows for them, and that is said. */
export async function editGrowing(op: Op, ends: readonly number[], label: string): Promise<boolean> {
  const c = clip();
  if (!c) return false;
  const made = grown(c, op, ends, label);
  const done = await applyOp(made.op);
  if (done && made.length)
    store.toast(`the clip is longer now: ${made.length} frames, ${clock(made.length, c.fps)}`, "info", true);
  return done;
}

/** Changes the distances of keys by a factor, about the playhead if it is among them. */
export async function retime(frames: number[], factor: number): Promise<void> {
  const keys = clip()?.keys.filter((k) => frames.includes(k.frame)) ?? [];
  const pivot = pivotOf(frames, store.playhead.value);
  const to = (frame: number): number => Math.round(pivot + (frame - pivot) * factor);
  const op: Op = { op: "keys.scale", args: { frames, pivot, factor } };
  if (await editGrowing(op, endsOf(keys, to), "Retime keys")) store.selection.value = new Set(frames.map(to));
}

/** What stood where keys have landed is gone: that is said, with the way back. */
export function tellReplaced(count: number): void {
  if (count) store.toast(`replaced ${count === 1 ? "a key" : `${count} keys`}`, "info", true);
}

export function addKey(): void {
  const c = clip();
  if (!c) return;
  if (store.shaping.value && !store.floating.value)
    return store.toast("move a joint: it is added to the motion here. J makes keys again");
  if (store.floating.value) return void keyFloating();
  const frame = store.playhead.value;
  if (keyAt(c, frame)) {
    // It keeps all that it has: hold, fill, note, pose, joints left open.
    store.selection.value = new Set([frame]);
    store.announcement.value = `key at frame ${frame} selected`;
    return;
  }
  void addPose(frame, barePose(c, frame));
}

export function nudge(df: number, ripple: boolean): void {
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

export const KEYS: Action[] = [
  {
    id: "key",
    title: "Add a key at the playhead, or select the one that is there",
    group: "Keys",
    keys: ["K", "I"],
    run: addKey,
  },
  {
    id: "delete",
    title: "Delete keys; in the graph, take the selected joints out of them",
    group: "Keys",
    keys: ["Delete", "X"],
    not: () => (store.selection.value.size ? undefined : needsOffset() && needsKeys()),
    run: () => {
      // An offset is chosen when no key is.
      if (store.selection.value.size === 0) return void deleteOffset();
      if (sheetTab.value === "graph") return void deletePoints();
      void edit("keys.delete", { frames: selected() }).then(
        (ok) => ok && (store.selection.value = new Set()),
      );
    },
  },
  {
    id: "copy",
    title: "Copy keys",
    group: "Keys",
    keys: ["Ctrl+C"],
    not: needsKeys,
    run: () => void copyKeys(),
  },
  {
    id: "cut",
    title: "Cut keys",
    group: "Keys",
    keys: ["Ctrl+X"],
    not: needsKeys,
    run: () => {
      const k = copyKeys();
      if (k.length) void edit("keys.delete", { frames: k.map((x) => x.frame) });
    },
  },
  {
    id: "paste",
    title: "Paste keys at the playhead",
    group: "Keys",
    keys: ["Ctrl+V"],
    run: () => void paste(false),
  },
  {
    id: "paste-mirrored",
    title: "Paste mirrored",
    group: "Keys",
    keys: ["Ctrl+Shift+V"],
    not: () => store.noMirror.value ?? undefined,
    run: () => void paste(true),
  },
  {
    id: "duplicate",
    title: "Duplicate keys after the last",
    group: "Keys",
    keys: ["Ctrl+D"],
    not: needsKeys,
    run: () => {
      const f = selected();
      const a = f[0] ?? 0;
      const b = f.at(-1) ?? a;
      const last = clip()?.keys.find((k) => k.frame === b);
      const df = (last ? keyEnd(last) : b + 1) - a + 4;
      const landing = f.map((x) => x + df);
      const c = clip();
      const lost = c ? replaced(c, landing) : 0;
      const keys = c?.keys.filter((k) => f.includes(k.frame)) ?? [];
      const op: Op = { op: "keys.move", args: { frames: f, df, copy: true, replace: true } };
      void editGrowing(
        op,
        endsOf(keys, (x) => x + df),
        "Duplicate keys",
      ).then((ok) => {
        if (ok) {
          store.selection.value = new Set(landing);
          tellReplaced(lost);
        }
      });
    },
  },
  {
    id: "mirror",
    title: "Mirror keys",
    group: "Keys",
    not: () => needsKeys() ?? store.noMirror.value ?? undefined,
    run: () => void edit("keys.mirror", { frames: selected() }),
  },
  {
    id: "select-here",
    title: "Add the key at the playhead to the selection, or remove it",
    group: "Keys",
    keys: ["Ctrl+Space"],
    not: () =>
      clip() && keyAt(clip() ?? { keys: [] }, store.playhead.value)
        ? undefined
        : "there is no key at the playhead",
    run: toggleSelected,
  },
  {
    id: "extend-next",
    title: "Extend the selection to the next key",
    group: "Keys",
    keys: ["Ctrl+Shift+ArrowRight"],
    run: () => extend(1),
  },
  {
    id: "extend-prev",
    title: "Extend the selection to the previous key",
    group: "Keys",
    keys: ["Ctrl+Shift+ArrowLeft"],
    run: () => extend(-1),
  },
  {
    id: "open-key",
    title: "Type the values of the key at the playhead",
    group: "Keys",
    keys: ["Enter"],
    run: () => timeline.value?.enter(),
  },
  {
    id: "menu",
    title: "Menu at the playhead, or of a pose",
    group: "Keys",
    keys: ["Shift+F10", "ContextMenu"],
    run: menuByKey,
  },
  {
    id: "select-all",
    title: "Select all keys",
    group: "Keys",
    keys: ["Ctrl+A"],
    run: () => (store.selection.value = new Set(clip()?.keys.map((k) => k.frame))),
  },
  {
    id: "clear",
    title: "Clear selection",
    group: "Keys",
    keys: ["Escape"],
    run: () => {
      if (cancelDrag()) return;
      if (drawing.value) return toggleDrawing();
      if (store.site.value) tell("view.select", {});
      if (store.floating.value) dropFloating();
      store.selection.value = new Set();
      store.chosenOffset.value = undefined;
    },
  },
  {
    id: "earlier",
    title: "Move keys one frame earlier",
    group: "Keys",
    keys: ["Alt+ArrowLeft"],
    not: needsKeys,
    run: () => nudge(-1, false),
  },
  {
    id: "later",
    title: "Move keys one frame later",
    group: "Keys",
    keys: ["Alt+ArrowRight"],
    not: needsKeys,
    run: () => nudge(1, false),
  },
  {
    id: "ripple-earlier",
    title: "Move keys and all later ones one frame earlier",
    group: "Keys",
    keys: ["Alt+Shift+ArrowLeft"],
    not: needsKeys,
    run: () => nudge(-1, true),
  },
  {
    id: "ripple-later",
    title: "Move keys and all later ones one frame later",
    group: "Keys",
    keys: ["Alt+Shift+ArrowRight"],
    not: needsKeys,
    run: () => nudge(1, true),
  },
  {
    id: "retime",
    title: "Retime keys about the playhead…",
    group: "Keys",
    keys: ["S"],
    not: needsKeys,
    run: dialog("retime"),
  },
  {
    id: "scale-values",
    title: "Scale values of keys about the pose at the playhead…",
    group: "Keys",
    keys: ["Shift+S"],
    not: needsPoint,
    run: dialog("scale"),
  },
  {
    id: "ripple-right",
    title: "Insert or remove time at the playhead…",
    group: "Keys",
    keys: ["E"],
    run: dialog("time"),
  },
  { id: "hold", title: "Hold keys…", group: "Keys", keys: ["H"], not: needsKeys, run: dialog("hold") },
  {
    id: "sparsify",
    title: "Thin out keys, keep the extremes…",
    group: "Keys",
    keys: ["T"],
    not: () => ((clip()?.keys.length ?? 0) > 2 ? undefined : "at least three keys are needed"),
    run: dialog("sparsify"),
  },
  {
    id: "densify",
    title: "Turn the take into keys…",
    group: "Keys",
    keys: ["Shift+T"],
    not: needsTake,
    run: dialog("densify"),
  },
  {
    id: "save-pose",
    title: "Save the pose at the playhead",
    group: "Keys",
    keys: ["P"],
    run: dialog("pose"),
  },
  {
    id: "marker",
    title: "Add a marker at the playhead",
    group: "Keys",
    keys: ["Shift+M"],
    run: dialog("marker"),
  },
  {
    id: "marker-earlier",
    title: "Move the marker one frame earlier",
    group: "Keys",
    keys: ["<"],
    run: () => moveMarker(-1),
  },
  {
    id: "marker-later",
    title: "Move the marker one frame later",
    group: "Keys",
    keys: [">"],
    run: () => moveMarker(1),
  },
  {
    id: "rename-marker",
    title: "Rename the marker at the playhead…",
    group: "Keys",
    not: needsMarker,
    run: dialog("rename-marker"),
  },
  {
    id: "delete-marker",
    title: "Delete the marker at the playhead",
    group: "Keys",
    not: needsMarker,
    run: () => void edit("markers.delete", { frames: [store.playhead.value] }),
  },
  {
    id: "reach",
    title: "Select the next fingertip or end effector",
    group: "Keys",
    keys: ["G"],
    run: nextSite,
  },
  {
    id: "draw",
    title: "Draw a motion in the 3D view",
    group: "Keys",
    keys: ["D"],
    not: needsSpaceAndSite,
    run: toggleDrawing,
  },
  {
    id: "pin",
    title: "Pin or release the selected fingertip or end effector",
    group: "Keys",
    keys: ["Shift+G"],
    not: needsSite,
    run: () => void togglePin(),
  },
  {
    id: "unpin-all",
    title: "Release all pins",
    group: "Keys",
    not: () => (store.pins.value.length ? undefined : "nothing is pinned"),
    run: () => setPins([]),
  },
  {
    id: "lock-joint",
    title: "Lock or unlock the selected joint",
    group: "Keys",
    keys: ["Alt+L"],
    not: needsJoint,
    run: () => toggleLock([chosenJoint() ?? ""]),
  },
  {
    id: "unlock-all",
    title: "Unlock all joints",
    group: "Keys",
    not: () => (store.locked.value.size ? undefined : "no joint is locked"),
    run: () => toggleLock([...store.locked.value]),
  },
  ...(
    [
      ["value-up", "Raise the selected values by 1° or 1 mm", "Alt+ArrowUp", 1],
      ["value-down", "Lower the selected values by 1° or 1 mm", "Alt+ArrowDown", -1],
      ["value-up-fine", "Raise the selected values by a tenth of that", "Alt+Shift+ArrowUp", 0.1],
      ["value-down-fine", "Lower the selected values by a tenth of that", "Alt+Shift+ArrowDown", -0.1],
    ] as const
  ).map(
    ([id, title, key, share]): Action => ({
      id,
      title,
      group: "Keys",
      keys: [key],
      not: needsPoint,
      run: () => inTurn(() => nudgeValue(share)),
    }),
  ),
  {
    id: "auto-key",
    title: "Automatic keys on or off",
    group: "Keys",
    run: () => (store.autoKey.value = !store.autoKey.value),
  },
];
