// The dope sheet: a canvas that draws, and an invisible grid that screen readers read.

import { effect, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { act, blockItems, markerItems, offsetItems, startItems } from "../actions/index";
import { editGrowing, tellReplaced } from "../actions/keys";
import { orderBlocks } from "../actions/layers";
import { chosenJoint, noJointMask, setFill, toggleMask } from "../actions/masks";
import { fillAfter, keyAt, keyEnd, nextKey, prevKey, values } from "../clip";
import { openDialog } from "../dialog";
import { toggleGroup } from "../folds";
import { isDense, offsetAt } from "../layers";
import { isLocked, toggleLock } from "../locks";
import { type Item, openMenu } from "../menu";
import { endPreview, preview } from "../posing";
import { begun } from "../problems";
import { heard } from "../reference";
import { SheetTabs } from "../sheet_tabs";
import { siteTitle } from "../sites";
import * as store from "../store";
import { colors, palette, takeColor } from "../theme";
import { tell } from "../wire";
import { draw, forgetHatches } from "./draw";
import { Gestures } from "./gestures";
import { timeline } from "./handle";
import { fit, frameToX, ROW, type RowKind, rowsOf, rowToY, type View, withRow } from "./layout";
import type { Scene } from "./scene";
import type { BoxSelect, Sheet, Target } from "./sheet";

/** Error that fills the strip: what a person sees as off, rad or m. */
const ERROR_TOP = 0.1;

/** The error of the take that stands in the viewport, too. */
function beside(): Scene["beside"] {
  const place = store.compared.value.length - 1;
  const frames = store.takeFrames.value.get(store.compared.value[place] ?? -1);
  return frames && { errors: frames.error, color: takeColor(place) };
}

const openKey = (frame: number): void => openDialog({ name: "key", frame });

export function Timeline(props: { onHint: (text: string) => void }) {
  const host = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const focused = useSignal(false);
  const { row, sheet: size } = store;
  const end = useSignal<number | undefined>(undefined);
  const dragged = useSignal<ReadonlyMap<number, number>>(new Map());
  const box = useSignal<BoxSelect | undefined>(undefined);
  const over = useSignal<number | undefined>(undefined);
  const carried = useSignal<Scene["carried"]>(undefined);
  const offsetDrag = useSignal<Scene["offset"]>(undefined);

  useEffect(() => {
    const element = canvas.current;
    const parent = host.current;
    if (!element || !parent) return;
    const ctx = element.getContext("2d");
    if (!ctx) return;
    let fitted = "";
    let fittedView: View | undefined;
    const observer = new ResizeObserver(() => {
      size.value = { width: parent.clientWidth, height: parent.clientHeight };
    });
    observer.observe(parent);
    const sheet: Sheet = {
      clip: () => store.doc.value?.clip,
      rows: () => rows(),
      view: () => store.view.value,
      box: () => size.value,
      playhead: () => store.playhead.value,
      selection: () => store.selection.value,
      setView: (v) => (store.view.value = v),
      setPlayhead: (f) => {
        store.playing.value = false;
        store.playhead.value = f;
      },
      setSelection: (f) => (store.selection.value = f),
      setJoint: (j) => {
        if (store.joint.value === j) return;
        store.joint.value = j;
        const name = j === undefined ? undefined : store.doc.value?.clip.robot.joints[j];
        tell("view.select", name ? { joint: name } : {});
      },
      toggleGroup,
      toggleLock: (joints) => toggleLock(named(joints)),
      toggleMask: (joints) => toggleMask(named(joints)),
      preview: (d, b) => {
        dragged.value = d;
        box.value = b;
      },
      previewEnd: (length) => (end.value = length),
      edit: (op, ends = []) => {
        endPreview();
        return editGrowing(op, ends, op.op === "keys.scale" ? "Retime keys" : "Copy keys");
      },
      overwrote: tellReplaced,
      follow: (op) => {
        if (op) preview(op);
        else {
          endPreview();
          tell("preview.end");
        }
      },
      openKey,
      menu: (target, x, y) => openMenu("Timeline", { x, y }, menuOf(target)),
      about: (frame) => {
        const d = store.doc.value;
        const at = store.playhead.value;
        if (!d || frame >= d.clip.length) return "";
        if (frame < 0) return "before the clip: the history that the policy is given";
        const within = (s: { from: number; to: number }): boolean => s.from <= frame && frame < s.to;
        if (d.findings.blind.some(within))
          return "tinted: no goal within the 20 frames ahead that the policy sees, so the program leads through the gap";
        if (d.findings.spans.some((s) => (s.kind === "masked" || s.kind === "open") && within(s)))
          return "dots: masked, the policy decides the motion";
        if (frame > at && frame <= at + 20)
          return "green: the 20 frames ahead of the playhead that the policy sees";
        return "";
      },
      over: (at) => (over.value = at),
      chooseOffset: (frame) => (store.chosenOffset.value = frame),
      previewOffset: (of) => (offsetDrag.value = of),
      carry: (of) => (carried.value = of),
      order: (block, place) => void orderBlocks(block, place),
      hint: props.onHint,
    };
    const stop = new Gestures(element, sheet).attach();
    let queued = false;
    const repaint = (): void => {
      forgetHatches();
      paint();
    };
    const fitAll = (): void => {
      fitted = "";
      paint();
    };
    // The same menus at the playhead, on the row of the keys.
    const menu = (): void => {
      const d = store.doc.value;
      if (!d) return;
      const at = store.playhead.value;
      const key = keyAt(d.clip, at);
      if (key && !store.selection.value.has(at)) store.selection.value = new Set([at]);
      const r = element.getBoundingClientRect();
      const x = r.left + Math.min(size.value.width - 20, Math.max(40, frameToX(store.view.value, at)));
      const y =
        r.top + Math.min(size.value.height - 20, Math.max(20, rowToY(store.view.value, row.value) + ROW));
      const marker = d.clip.markers?.some((m) => m.frame === at);
      openMenu("Timeline", { x, y }, [
        ...menuOf(key ? { kind: "key", frame: at } : { kind: "frames" }),
        ...(marker ? menuOf({ kind: "marker", frame: at }) : []),
        ...(at === 0 ? menuOf({ kind: "past" }) : []),
      ]);
    };
    const step = (by: 1 | -1): void => {
      const d = store.doc.value;
      const list = rows();
      if (!d) return;
      row.value = Math.min(list.length - 1, Math.max(0, row.value + by));
      const now = list[row.value];
      if (now?.kind === "joint") store.joint.value = now.joint;
      store.view.value = withRow(store.view.value, size.value, row.value);
      store.announcement.value = cellText(d, now, store.playhead.value);
    };
    /** Enter: a group opens or folds, a key shows its values. */
    const enter = (): void => {
      const now = document.activeElement === parent ? rows()[row.value] : undefined;
      if (now?.kind === "group") toggleGroup(now.group.name);
      else if (keyAt(store.doc.value?.clip ?? { keys: [] }, store.playhead.value))
        openKey(store.playhead.value);
      else store.toast("there is no key at the playhead");
    };
    const own = { fit: fitAll, menu, step, enter };
    timeline.value = own;
    const paint = (): void => {
      queued = false;
      const d = store.doc.value;
      const { width, height } = size.value;
      const ratio = devicePixelRatio || 1;
      if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) {
        element.width = Math.round(width * ratio);
        element.height = Math.round(height * ratio);
        element.style.width = `${width}px`;
        element.style.height = `${height}px`;
      }
      if (!d) return;
      const name = `${d.path}:${d.clip.name}:${d.clip.robot.id}`;
      // The whole clip, until somebody looks closer; also after the panels have moved.
      const shape = `${name}:${d.clip.length}:${width}`;
      const untouched = store.view.value === fittedView || !fitted.startsWith(`${name}:`);
      if (fitted !== shape && untouched && width > 200) {
        fitted = shape;
        fittedView = fit(d.clip.length, size.value);
        store.view.value = fittedView;
      }
      ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
      draw(ctx, scene(d));
    };
    measured.paint = () => {
      const began = performance.now();
      paint();
      // What was drawn is read back, so that it has been drawn.
      ctx.getImageData(element.width - 1, element.height - 1, 1, 1);
      return performance.now() - began;
    };
    const scene = (d: store.Document): Scene => {
      const take = store.rollout.value;
      return {
        clip: d.clip,
        rows: rows(),
        view: store.view.value,
        box: size.value,
        theme: colors(),
        playhead: store.playhead.value,
        selection: store.selection.value,
        offset:
          offsetDrag.value ??
          (store.chosenOffset.value === undefined
            ? undefined
            : { frame: store.chosenOffset.value, at: store.chosenOffset.value }),
        carried: carried.value,
        dense: isDense(d.clip),
        selectedJoint: store.joint.value,
        blind: begun() ? [] : d.findings.blind,
        lints: d.findings.lints.flatMap((l) =>
          l.frames && l.level !== "info" ? [{ frame: l.frames[0], level: l.level }] : [],
        ),
        errors: store.frames.value.error,
        beside: beside(),
        errorTop: ERROR_TOP,
        cachedTo: take?.cached_to ?? 0,
        loop: store.range.value,
        heard: heard(),
        end: end.value,
        dragged: dragged.value,
        boxSelect: box.value,
        names: (j) => store.titles.value[j] ?? "",
        pointName: siteTitle,
        locked: (j) => isLocked(d.clip.robot.joints[j] ?? ""),
        maskable: d.findings.granularity !== "state",
        stale: take ? take.rev !== d.rev && take.rev !== 0 : false,
        focusRow: row.value,
        focused: focused.value,
        hoverRow: over.value,
      };
    };
    const themed = palette.subscribe(repaint);
    // Any signal that the scene reads asks for a new frame; one frame serves them all.
    const dispose = effect(() => {
      void [
        store.doc.value,
        store.rollout.value,
        store.frames.value,
        store.groups.value,
        store.view.value,
        store.playhead.value,
        store.selection.value,
        store.joint.value,
        store.closed.value,
        store.range.value,
        store.locked.value,
        store.shaping.value,
        store.chosenOffset.value,
        offsetDrag.value,
        carried.value,
        store.compared.value,
        store.takeFrames.value,
        heard(),
        size.value,
        dragged.value,
        end.value,
        box.value,
        focused.value,
        over.value,
        row.value,
        store.robot.value,
      ];
      if (!queued) {
        queued = true;
        requestAnimationFrame(paint);
      }
    });
    return () => {
      stop();
      dispose();
      observer.disconnect();
      themed();
      // The graph may have come already.
      if (timeline.value === own) timeline.value = undefined;
    };
  }, []);

  const d = store.doc.value;
  const list = d ? rows() : [];
  const at = store.playhead.value;
  return (
    <div
      class="sheet"
      ref={host}
      tabIndex={0}
      role="grid"
      data-testid="timeline"
      aria-label="Timeline"
      aria-rowcount={list.length}
      aria-colcount={store.length.value}
      aria-activedescendant="sheet-cell"
      onFocus={() => (focused.value = true)}
      onBlur={() => (focused.value = false)}
    >
      {/* biome-ignore lint/a11y/noAriaHiddenOnFocusable: it takes no focus, and the grid below says what it shows */}
      <canvas ref={canvas} aria-hidden="true" />
      <SheetTabs />
      <div class="offscreen">
        {list.map((r, i) => (
          <div role="row" aria-rowindex={i + 1} key={i}>
            <span role="rowheader">{rowName(r)}</span>
            {i === row.value && d ? (
              <span
                role="gridcell"
                id="sheet-cell"
                aria-colindex={at + 1}
                aria-selected={store.selection.value.has(at)}
              >
                {cellText(d, r, at)}
              </span>
            ) : null}
          </div>
        ))}
      </div>
    </div>
  );
}

function rows(): RowKind[] {
  const d = store.doc.value;
  return d ? rowsOf(d.clip, store.groups.value, store.closed.value, store.shaping.value) : [];
}

function named(joints: number[]): string[] {
  return joints.map((j) => store.doc.value?.clip.robot.joints[j] ?? "").filter(Boolean);
}

/** What can be done with a thing on the timeline. */
export function menuOf(target: Target): Item[] {
  const item = (title: string, keys: string, run: () => void, why?: string | null | undefined): Item => ({
    title,
    keys,
    run,
    why,
  });
  const joint = chosenJoint();
  const one = joint ? null : "select a joint first: click its name on the timeline";
  if (target.kind === "marker") return markerItems(target.frame);
  if (target.kind === "offset") return offsetItems(target.frame);
  if (target.kind === "block") return blockItems(target.frame);
  if (target.kind === "past") return startItems();
  if (target.kind === "frames")
    return [
      item("Key here", "K", () => act("key")),
      item("Mask: leave these frames to the policy", "M", () => act("mask")),
      item(`Mask ${joint ?? "one joint"} only`, "Alt+M", () => act("mask-joint"), one ?? noJointMask()),
      item("Unmask", "U", () => act("unmask")),
      item(`Unmask ${joint ?? "one joint"} only`, "Alt+U", () => act("unmask-joint"), one),
      item(
        joint && store.locked.value.has(joint) ? `Unlock ${joint}` : `Lock ${joint ?? "one joint"}`,
        "Alt+L",
        () => act("lock-joint"),
        one,
      ),
      item("Paste", "Ctrl+V", () => act("paste")),
      item("Insert or remove time…", "E", () => act("ripple-right")),
      item("Marker here…", "Shift+M", () => act("marker")),
    ];
  const { frame } = target;
  return [
    item("Type values…", "Enter", () => openKey(frame)),
    item("Hold…", "H", () => act("hold")),
    item("Leave to the policy until the next key", "", () => setFill("mask")),
    item("Straight line to the next key", "", () => setFill("linear")),
    item("Smooth curve to the next key", "", () => setFill("cubic")),
    item("Hold until the next key", "", () => setFill("hold")),
    item("Copy", "Ctrl+C", () => act("copy")),
    item("Paste here", "Ctrl+V", () => {
      store.playhead.value = frame;
      act("paste");
    }),
    item("Duplicate", "Ctrl+D", () => act("duplicate")),
    item("Retime…", "S", () => act("retime")),
    item("Thin out…", "T", () => act("sparsify")),
    item("Mirror", "", () => act("mirror"), store.noMirror.value),
    item("Save as pose…", "P", () => {
      store.playhead.value = frame;
      act("save-pose");
    }),
    item("Marker here…", "Shift+M", () => {
      store.playhead.value = frame;
      act("marker");
    }),
    item("Delete", "X", () => act("delete")),
  ];
}

function rowName(row: RowKind | undefined): string {
  if (!row) return "";
  if (row.kind === "all") return "All joints";
  if (row.kind === "offsets") return "Offsets";
  if (row.kind === "point") return siteTitle(row.name);
  if (row.kind === "group") return row.group.title;
  return store.titles.value[row.joint] ?? `joint ${row.joint + 1}`;
}

/** "Index J3, frame 55, key, 12.3°": what is at a cell, in words. */
export function cellText(d: store.Document, row: RowKind | undefined, frame: number): string {
  const locked = row?.kind === "joint" && isLocked(d.clip.robot.joints[row.joint] ?? "") ? ", locked" : "";
  const name = rowName(row) + locked;
  if (row?.kind === "offsets") {
    const o = offsetAt(d.clip, frame);
    return `${name}, frame ${frame}, ${o ? `offset of ${Object.keys(o.add).join(", ")}` : "none"}`;
  }
  const key = keyAt(d.clip, frame);
  const joint = row?.kind === "joint" ? row.joint : undefined;
  const value = key && joint !== undefined ? values(d.clip, key)[joint] : undefined;
  if (key && (joint === undefined || typeof value === "number")) {
    const unit = store.doc.value?.table.joints[joint ?? -1]?.unit ?? "rad";
    const says = typeof value === "number" ? store.shown(value, unit) : (key.pose ?? "");
    const hold = (key.hold ?? 1) > 1 ? `, held ${key.hold} frames` : "";
    return `${name}, frame ${frame}, key, ${says}${hold}`;
  }
  // A key for other joints says nothing about this one.
  const before = prevKey(d.clip, frame, joint);
  const after = nextKey(d.clip, frame, joint);
  const fill = before ? fillAfter(d.clip, before) : "mask";
  const held = before !== undefined && frame < keyEnd(before);
  const way = held ? "held" : fill === "mask" ? "no goal" : after ? fill : "hold";
  return `${name}, frame ${frame}, ${way}`;
}

/** Published for measurements: draws at once and says how long it took, milliseconds. */
export const measured: { paint: () => number } = { paint: () => 0 };

/** Published for browser tests: where things are on the canvas. */
export function testPoints() {
  return {
    frameToX: (frame: number) => frameToX(store.view.value, frame),
    rowToY: (name: string) => {
      const list = rows();
      const i = list.findIndex(
        (r) =>
          rowName(r) === name || (r.kind === "joint" && store.doc.value?.clip.robot.joints[r.joint] === name),
      );
      return i < 0 ? undefined : rowToY(store.view.value, i) + 10;
    },
  };
}
