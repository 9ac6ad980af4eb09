// The graph editor: values of several joints over time, on the same time axis as the timeline.

import { effect, useSignal } from "@preact/signals";
import type { IconNode } from "lucide";
import { CircleDashed, CornerDownRight, Maximize, Percent, Slash, Spline } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { offsetItems, tangentItems } from "../actions";
import { setFill } from "../actions/masks";
import { type Clip, type Fill, fillAfter, keyAt, prevKey } from "../clip";
import { openDialog } from "../dialog";
import { Icon } from "../icon";
import { isDense } from "../layers";
import { openMenu } from "../menu";
import { endPreview, preview } from "../posing";
import { begun } from "../problems";
import { heard } from "../reference";
import { SheetTabs } from "../sheet_tabs";
import * as store from "../store";
import { colors, hue, palette } from "../theme";
import { type TimelineHandle, timeline } from "../timeline/handle";
import { fit } from "../timeline/layout";
import { menuOf } from "../timeline/timeline";
import { applyOp, tell } from "../wire";
import {
  addPoint,
  type Bent,
  bent,
  choosePoints,
  chosen,
  curves,
  endShape,
  followSelection,
  lifted,
  previewShape,
  shape,
  shownJoints,
} from "./edits";
import { type Handle, handles, type Top, tops } from "./handles";
import { Hands, type Sheet } from "./hands";
import { paint } from "./paint";
import { dragged, fitSpan, nameOf, type Space, type Span, valueToY, yToValue } from "./space";

const FILLS: [Fill, IconNode, string][] = [
  ["cubic", Spline, "Smooth curve that never overshoots"],
  ["linear", Slash, "Straight line"],
  ["hold", CornerDownRight, "Hold"],
  ["mask", CircleDashed, "Leave it to the policy"],
];

/** The clip as a drag would leave it, and where the chosen keys went. */
interface Drag {
  clip: Clip;
  to: ReadonlyMap<number, number>;
}

/** Published for browser tests. */
export const graphPoints: {
  yOf: (joint: number, value: number) => number;
  handles: () => (Handle | Top)[];
} = { yOf: () => Number.NaN, handles: () => [] };

export function Graph(props: { onHint: (text: string) => void }) {
  const host = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const { sheet: size } = store;
  const span = useSignal<Span>({ lo: -1, hi: 1 });
  /** Fitted by hand: it stays as it is. */
  const touched = useSignal(false);
  const normal = useSignal(false);
  const drag = useSignal<Drag | undefined>(undefined);
  const box = useSignal<Parameters<Sheet["box"]>[0]>(undefined);

  const d = store.doc.value;
  const units = new Set(shownJoints().map((j) => d?.table.joints[j]?.unit));
  const mixed = units.size > 1;
  const space = (): Space => ({
    view: store.view.value,
    box: size.value,
    span: span.value,
    normal: normal.value || mixed,
    facts: store.doc.value?.table.joints ?? [],
  });
  const refit = (): void => {
    const clip = store.doc.value?.clip;
    if (clip) span.value = fitSpan(space(), clip, shownJoints(), store.frames.value.q);
  };

  useEffect(() => {
    const element = canvas.current;
    const parent = host.current;
    const ctx = element?.getContext("2d");
    if (!element || !parent || !ctx) return;
    const observer = new ResizeObserver(() => {
      // A graph that was just closed has no width, and must not fit the timeline's view to it.
      if (parent.clientWidth === 0) return;
      const before = size.value.width;
      size.value = { width: parent.clientWidth, height: parent.clientHeight };
      if (before !== parent.clientWidth) store.view.value = fit(store.length.value, size.value);
    });
    observer.observe(parent);
    /** Draws and previews what a hand on a handle does; when it lets go there is one edit. */
    const shapeBy = async (make: (clip: Clip) => Bent | undefined, done: boolean): Promise<boolean> => {
      const clip = store.doc.value?.clip;
      const made = clip && make(clip);
      if (!made) return false;
      if (!done) {
        drag.value = { clip: made.clip, to: new Map() };
        preview(made.op);
        return false;
      }
      endPreview();
      const ok = await applyOp(made.op);
      drag.value = undefined;
      tell("preview.end");
      return ok;
    };
    const hands = new Hands(element, {
      clip: () => store.doc.value?.clip,
      space,
      joints: shownJoints,
      selection: () => chosen.value,
      select: choosePoints,
      setView: (v) => (store.view.value = v),
      setSpan: (s) => {
        touched.value = true;
        span.value = s;
      },
      seek: (f) => {
        store.playing.value = false;
        store.playhead.value = f;
      },
      choose,
      preview: (changes, to) => {
        const clip = store.doc.value?.clip;
        drag.value = clip && changes && to ? { clip: dragged(clip, changes, to), to } : undefined;
        if (!changes || !to) return endShape();
        const [first] = to;
        previewShape(changes, [...to.keys()], first ? first[1] - first[0] : 0);
      },
      box: (b) => (box.value = b),
      drop: (changes, frames, df) =>
        void shape(changes, frames, df).then(() => {
          drag.value = undefined;
        }),
      addKey: (frame, joint, y) => {
        const own = store.joint.value ?? joint;
        const at = curves.value.has(own) ? own : joint;
        addPoint(frame, at, yToValue(space(), at, y));
      },
      openKey: (frame) => openDialog({ name: "key", frame }),
      menu: (frame, x, y) =>
        openMenu(
          "Graph",
          { x, y },
          frame === undefined
            ? menuOf({ kind: "frames" })
            : [...tangentItems(), ...menuOf({ kind: "key", frame })],
        ),
      bend: (h, slope, both, done) => shapeBy((clip) => bent(clip, h, slope, both), done),
      lift: (t, by, df, done) =>
        shapeBy((clip) => lifted(clip, t, by, df), done).then((ok) => {
          if (ok) store.chosenOffset.value = t.frame + df;
        }),
      chooseOffset: (frame) => (store.chosenOffset.value = frame),
      offsetMenu: (frame, x, y) => openMenu("Graph", { x, y }, offsetItems(frame)),
      hint: props.onHint,
    });
    const stops = [hands.attach(), followSelection()];
    let queued = false;
    const draw = (): void => {
      queued = false;
      const d = store.doc.value;
      const ratio = devicePixelRatio || 1;
      const { width, height } = size.value;
      const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
      if (element.width !== w || element.height !== h) Object.assign(element, { width: w, height: h });
      if (!d || width === 0) return;
      if (!touched.value && !drag.value) refit();
      const s = space();
      graphPoints.yOf = (joint, value) => valueToY(s, joint, value);
      graphPoints.handles = () => [
        ...handles(s, d.clip, shownJoints(), chosen.value),
        ...tops(s, d.clip, shownJoints()),
      ];
      const joints = shownJoints();
      const unit = d.table.joints[joints[0] ?? 0]?.unit ?? "rad";
      const degrees = unit === "rad" && store.degrees.value;
      const take = store.rollout.value;
      const own = drag.value;
      const moved = (name: string): string => {
        const [f, j] = name.split(":").map(Number) as [number, number];
        return nameOf({ frame: own?.to.get(f) ?? f, joint: j });
      };
      ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
      paint(ctx, {
        clip: own?.clip ?? d.clip,
        offset: store.chosenOffset.value,
        dense: isDense(d.clip),
        space: s,
        view: s.view,
        box: s.box,
        theme: colors(),
        joints,
        hue,
        chosen: joints.includes(store.joint.value ?? -1)
          ? store.joint.value
          : joints.length === 1
            ? joints[0]
            : undefined,
        selection: own ? new Set([...chosen.value].map(moved)) : chosen.value,
        reached: store.frames.value.q,
        boxSelect: box.value,
        scale: degrees ? 180 / Math.PI : 1,
        unit: unit === "m" ? " m" : degrees ? "°" : " rad",
        playhead: store.playhead.value,
        end: undefined,
        stale: take ? take.rev !== d.rev && take.rev !== 0 : false,
        cachedTo: take?.cached_to ?? 0,
        loop: store.range.value,
        heard: heard(),
        blind: begun() ? [] : d.findings.blind,
      });
    };
    stops.push(
      effect(() => {
        void [
          store.doc.value,
          store.frames.value,
          store.rollout.value,
          store.view.value,
          store.playhead.value,
          store.joint.value,
          store.degrees.value,
          store.range.value,
          heard(),
          size.value,
          curves.value,
          chosen.value,
          store.chosenOffset.value,
          drag.value,
          box.value,
          span.value,
          normal.value,
          touched.value,
          palette.value,
        ];
        if (queued) return;
        queued = true;
        requestAnimationFrame(draw);
      }),
    );
    const own: TimelineHandle = {
      fit: () => {
        touched.value = false;
        store.view.value = fit(store.length.value, size.value);
      },
      menu: () => {
        const at = store.playhead.value;
        const r = element.getBoundingClientRect();
        const clip = store.doc.value?.clip;
        const key = clip && keyAt(clip, at);
        openMenu(
          "Graph",
          { x: r.left + 200, y: r.top + 40 },
          key ? [...tangentItems(), ...menuOf({ kind: "key", frame: at })] : menuOf({ kind: "frames" }),
        );
      },
      step: (by) => {
        const n = store.titles.value.length;
        if (n) choose(((store.joint.value ?? (by === 1 ? -1 : 0)) + by + n) % n);
      },
      enter: () => {
        const clip = store.doc.value?.clip;
        if (clip && keyAt(clip, store.playhead.value))
          openDialog({ name: "key", frame: store.playhead.value });
        else store.toast("there is no key at the playhead");
      },
    };
    timeline.value = own;
    return () => {
      stops.forEach((stop) => stop());
      observer.disconnect();
      // The timeline may have come already.
      if (timeline.value === own) timeline.value = undefined;
    };
  }, []);

  return (
    <div class="sheet graph" ref={host} role="group" aria-label="Graph" data-testid="graph">
      {/* biome-ignore lint/a11y/noAriaHiddenOnFocusable: it takes no focus; keys and values are read out as they are changed */}
      <canvas ref={canvas} aria-hidden="true" />
      <SheetTabs />
      <div class="graph-tools">
        <Tangents />
        <span class="rule" />
        <button
          class="small"
          title="Fit the curves (Shift+F); Ctrl+wheel zooms values, Alt+wheel moves them"
          onClick={() => {
            touched.value = false;
            refit();
          }}
        >
          <Icon of={Maximize} size={12} /> Fit
        </button>
        <button
          class="small"
          aria-pressed={normal.value || mixed}
          disabled={mixed}
          title={
            mixed
              ? "Joints of different units are shown as parts of their ranges"
              : "Show each joint as a part of its range"
          }
          onClick={() => {
            normal.value = !normal.value;
            touched.value = false;
          }}
        >
          <Icon of={Percent} size={12} /> Normalise
        </button>
      </div>
      <CurveList />
    </div>
  );
}

/** What leads from the chosen keys to the next ones. */
function Tangents() {
  const clip = store.doc.value?.clip;
  if (!clip) return null;
  const at = store.playhead.value;
  const here = keyAt(clip, at) ?? prevKey(clip, at);
  const acted = clip.keys.filter((k) =>
    store.selection.value.size ? store.selection.value.has(k.frame) : k === here,
  );
  const fills = new Set(acted.map((k) => fillAfter(clip, k)));
  return (
    <span role="group" aria-label="After the chosen keys">
      {FILLS.map(([fill, sign, title]) => (
        <button
          key={fill}
          class="small"
          aria-label={title}
          aria-pressed={fills.size === 1 && fills.has(fill)}
          disabled={acted.length === 0}
          title={`After the chosen keys: ${title.toLowerCase()}`}
          onClick={() => setFill(fill)}
          data-testid={`fill-${fill}`}
        >
          <Icon of={sign} size={13} />
        </button>
      ))}
    </span>
  );
}

function choose(joint: number): void {
  if (store.joint.value === joint) return;
  store.joint.value = joint;
  const name = store.doc.value?.clip.robot.joints[joint];
  if (name) tell("view.select", { joint: name });
}

/** The joints: which are drawn, and in which colour. */
function CurveList() {
  const names = store.titles.value;
  const toggle = (joint: number, add: boolean): void => {
    const next = new Set(add ? curves.value : []);
    if (!add || !next.delete(joint)) next.add(joint);
    if (next.size) curves.value = next;
    if (next.has(joint)) choose(joint);
  };
  const row = (joint: number) => (
    <button
      key={joint}
      class={`quiet curve ${store.joint.value === joint ? "on" : ""}`}
      aria-pressed={curves.value.has(joint)}
      title="Show this curve alone; Ctrl or Shift adds it or takes it away"
      onClick={(e) => toggle(joint, e.ctrlKey || e.metaKey || e.shiftKey)}
      data-testid={`curve-${joint}`}
    >
      <i style={`background: ${hue(joint)}`} />
      {names[joint]}
    </button>
  );
  void palette.value;
  const grouped = new Set(store.groups.value.flatMap((g) => g.joints));
  const seen = new Set<number>();
  return (
    <div class="curve-list" role="group" aria-label="Curves shown">
      {store.groups.value.map((g) => {
        const own = g.joints.filter((j) => !seen.has(j));
        own.forEach((j) => seen.add(j));
        return own.length ? (
          <div key={g.name}>
            <button
              class="quiet small"
              title="Show all curves of this group"
              onClick={() => {
                curves.value = new Set(g.joints);
                choose(g.joints[0] ?? 0);
              }}
            >
              {g.title}
            </button>
            {own.map(row)}
          </div>
        ) : null;
      })}
      {names.map((_, j) => (grouped.has(j) ? null : row(j)))}
    </div>
  );
}
