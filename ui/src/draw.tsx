// Drawing a motion: a line on a plane, by pointer or pen, becomes keys of the chosen end effector.

import { signal } from "@preact/signals";
import { X } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { type Clip, keyAt } from "./clip";
import { hold } from "./hand";
import { Icon } from "./icon";
import { parseNumber, TIMES } from "./numbers";
import { poseAt } from "./posing";
import type { DrawAnswer, Op, Plane } from "./protocol";
import { inClipOrder, inRobotOrder, siteTitle } from "./sites";
import * as store from "./store";
import { colors } from "./theme";
import { applyOp, complain, http, tell } from "./wire";

/** A point of the stroke: 0 to 1 from the top left corner of the view, and its time, s. */
type Point = [x: number, y: number, secs: number];

/** The page waits for a stroke, or has one under the pointer. */
export const drawing = signal(false);
/** What the last stroke became; tests compare the take with its line. */
export const drawn = signal<DrawAnswer | undefined>(undefined);
const plane = signal<Plane>("level");
/** Seconds that the motion takes; empty: as long as the hand took. */
const secs = signal("");
const tolerance = signal("2");

/** Frames that a clip goes on after the last key of a drawn line. */
const AFTERGLOW = 10;
/** Strokes have at most this many points; the server takes no more. */
const MOST = 4000;

export function needsSpaceAndSite(): string | undefined {
  if (!store.doc.value) return "open a clip first";
  if (store.stills.value) return "drawing needs the 3D view, and this browser shows still pictures";
  return (store.robot.value?.ik_sites ?? []).length
    ? undefined
    : "the model of this robot defines no end effector to draw with";
}

export function toggleDrawing(): void {
  drawing.value = !drawing.value;
  if (!drawing.value) return;
  const [first] = store.robot.value?.ik_sites ?? [];
  if (store.site.value === undefined && first) tell("view.select", { site: first.name });
  store.announcement.value = "draw a line in the 3D view; Escape gives up";
}

/** The edit that puts a drawn line into the clip from the playhead on, and how many keys it ends. */
export function drawnEdit(clip: Clip, frame: number, answer: DrawAnswer): [Op, number] {
  const keys = answer.keys.map((k) => ({
    frame: frame + k.frame,
    q: inClipOrder(k.q),
    ...(k.hold > 1 ? { hold: k.hold } : {}),
    fill: "linear" as const,
  }));
  const [first] = keys;
  const end = frame + answer.frames;
  const ops: Op[] = [];
  const last = clip.keys.at(-1)?.frame ?? 0;
  const length = Math.max(clip.length, end + (end > last ? AFTERGLOW : 0));
  if (length > clip.length) ops.push({ op: "clip.length", args: { length } });
  const gone = clip.keys.filter((k) => k.frame > frame && k.frame < end).map((k) => k.frame);
  if (gone.length) ops.push({ op: "keys.delete", args: { frames: gone } });
  if (first && first.frame > frame) {
    // From where the robot is, straight to where the line begins.
    const here = keyAt(clip, frame);
    if (here) ops.push({ op: "fill.set", args: { frames: [frame], fill: "linear" } });
    else keys.unshift({ frame, q: poseAt(clip, frame), fill: "linear" });
  }
  ops.push({ op: "keys.add", args: { keys, replace: true } });
  return [{ op: "batch", args: { label: "Draw a path", ops } }, gone.length];
}

async function finish(points: Point[]): Promise<void> {
  const d = store.doc.value;
  const site = store.site.value;
  if (!d || site === undefined || points.length < 2) return;
  const even = secs.value.trim() === "" ? undefined : parseNumber(secs.value, TIMES);
  if (secs.value.trim() !== "" && !(even !== undefined && even > 0))
    return store.toast(`"${secs.value}" is not a time in seconds`, "error");
  const mm = parseNumber(tolerance.value, { mm: 1, m: 1000, cm: 10 });
  if (mm === undefined || mm <= 0)
    return store.toast(`"${tolerance.value}" is not a length in millimetres`, "error");
  const frame = store.playhead.value;
  try {
    const answer = await http("POST /api/draw", {
      body: {
        tab: store.TAB,
        q: inRobotOrder(poseAt(d.clip, frame)),
        site,
        plane: plane.value,
        points,
        ...(even === undefined ? {} : { secs: even }),
        tolerance_m: mm / 1000,
        locked: [...store.locked.value],
      },
    });
    const now = store.doc.value;
    if (now?.opened !== d.opened || answer.keys.length === 0) return;
    const [op, gone] = drawnEdit(now.clip, frame, answer);
    if (!(await applyOp(op))) return;
    drawn.value = answer;
    drawing.value = false;
    store.selection.value = new Set(answer.keys.map((k) => frame + k.frame));
    const took = (answer.frames / store.fps.value).toFixed(1);
    const out =
      answer.off_m > 0.001
        ? `; ${siteTitle(site)} stays up to ${(answer.off_m * 1000).toFixed(0)} mm off, because the line leaves its reach`
        : "";
    const lost = gone ? `; replaced ${gone === 1 ? "a key" : `${gone} keys`}` : "";
    store.toast(`drawn: ${answer.keys.length} keys, ${took} s${out}${lost}`, "info", true, "draw");
  } catch (e) {
    complain(e);
  }
}

/** Lies over the view while a line is drawn. */
export function Draw() {
  const canvas = useRef<HTMLCanvasElement>(null);
  const points = useRef<Point[]>([]);
  const on = drawing.value;
  useEffect(() => {
    const c = canvas.current;
    if (!on || !c) return;
    points.current = [];
    const fit = (): void => {
      c.width = Math.round(c.clientWidth * devicePixelRatio);
      c.height = Math.round(c.clientHeight * devicePixelRatio);
    };
    fit();
    const sized = new ResizeObserver(fit);
    sized.observe(c);
    return () => sized.disconnect();
  }, [on]);
  if (!on) return null;
  const add = (e: PointerEvent): void => {
    const c = canvas.current;
    const ctx = c?.getContext("2d");
    const box = c?.getBoundingClientRect();
    if (!c || !ctx || !box) return;
    const own = e.getCoalescedEvents?.() ?? [];
    for (const at of own.length ? own : [e]) {
      if (points.current.length >= MOST) return;
      const last = points.current.at(-1);
      const point: Point = [
        (at.clientX - box.left) / box.width,
        (at.clientY - box.top) / box.height,
        at.timeStamp / 1000,
      ];
      if (point.some((v) => !Number.isFinite(v)) || Math.min(...point) < 0) continue;
      points.current.push(point);
      if (!last) continue;
      ctx.strokeStyle = colors().key;
      ctx.lineWidth = 3 * devicePixelRatio;
      ctx.lineCap = "round";
      ctx.beginPath();
      ctx.moveTo(last[0] * c.width, last[1] * c.height);
      ctx.lineTo(point[0] * c.width, point[1] * c.height);
      ctx.stroke();
    }
  };
  const site = store.site.value;
  return (
    <div class="draw" data-testid="draw">
      <canvas
        ref={canvas}
        aria-label="Draw a line"
        data-testid="draw-canvas"
        onPointerDown={(e) => {
          if (e.button !== 0) return;
          e.currentTarget.setPointerCapture(e.pointerId);
          const c = e.currentTarget;
          const clear = (): void => {
            points.current = [];
            c.getContext("2d")?.clearRect(0, 0, c.width, c.height);
          };
          clear();
          hold(clear);
          add(e);
        }}
        onPointerMove={(e) => {
          if (e.buttons & 1 && points.current.length) add(e);
        }}
        onPointerUp={() => {
          const stroke = points.current;
          points.current = [];
          void finish(stroke);
        }}
      />
      <div class="draw-tools" role="group" aria-label="Drawing">
        <label title="The end effector that follows the line">
          Draw with
          <select
            data-testid="draw-site"
            value={site ?? ""}
            onChange={(e) => tell("view.select", { site: e.currentTarget.value })}
          >
            {(store.robot.value?.ik_sites ?? []).map((s) => (
              <option key={s.name} value={s.name}>
                {siteTitle(s.name)}
              </option>
            ))}
          </select>
        </label>
        <label title="The plane that the line lies on">
          on
          <select
            data-testid="draw-plane"
            value={plane.value}
            onChange={(e) => (plane.value = e.currentTarget.value as Plane)}
          >
            <option value="level">a level plane through it</option>
            <option value="view">a plane that faces you</option>
            <option value="ground">the ground</option>
          </select>
        </label>
        <label title="Duration of the line in seconds, at constant speed. If empty, as long as the drawing takes. It becomes slower where joints cannot keep up">
          in
          <input
            type="text"
            inputMode="decimal"
            placeholder="hand's time"
            data-testid="draw-secs"
            value={secs.value}
            onInput={(e) => (secs.value = e.currentTarget.value)}
          />
          s
        </label>
        <label title="How far the commanded path may be from the line">
          within
          <input
            type="text"
            inputMode="decimal"
            class="short"
            data-testid="draw-tolerance"
            value={tolerance.value}
            onInput={(e) => (tolerance.value = e.currentTarget.value)}
          />
          mm
        </label>
        <button class="quiet" onClick={toggleDrawing} title="Esc" aria-label="Stop drawing">
          <Icon of={X} size={14} />
        </button>
      </div>
    </div>
  );
}
