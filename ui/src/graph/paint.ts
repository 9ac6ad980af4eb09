// Draws the graph: curves with their keys, how fast joints may move, where the policy's data lie.

import { type Clip, isOf } from "../clip";
import { digitsOf, fixed } from "../numbers";
import { playhead, ruler } from "../timeline/draw";
import { ground } from "../timeline/ground";
import { frameToX, LABELS, RULER, xToFrame } from "../timeline/layout";
import type { Times } from "../timeline/scene";
import { sound } from "../timeline/sound";
import { bareStretches, steepest, stretches } from "./curve";
import { type Handle, handles, tops } from "./handles";
import { nameOf, type Point, points, type Space, valueToY, yToSeen } from "./space";

export interface Scene extends Times {
  space: Space;
  /** What is drawn: the clip, or what a drag would make of it. */
  clip: Clip;
  joints: number[];
  hue: (joint: number) => string;
  /** The joint whose bands and limits are shown. */
  chosen: number | undefined;
  selection: ReadonlySet<string>;
  /** The chosen offset. */
  offset: number | undefined;
  reached: number[][];
  /** There is a key at nearly every frame. */
  dense: boolean;
  boxSelect: { x0: number; y0: number; x1: number; y1: number } | undefined;
  /** Turns a value into the unit that is read. */
  scale: number;
  unit: string;
}

type Ctx = CanvasRenderingContext2D;

export function paint(ctx: Ctx, s: Scene): void {
  const { box, theme, view } = s;
  ground(ctx, box, theme);
  const x0 = frameToX(view, 0);
  ctx.fillStyle = theme.panel;
  ctx.fillRect(x0, 0, frameToX(view, s.clip.length) - x0, box.height);
  for (const b of s.blind) {
    ctx.fillStyle = `${theme.blind}18`;
    ctx.fillRect(frameToX(view, b.from), RULER, (b.to - b.from) * view.zoom, box.height - RULER);
  }
  ctx.beginPath();
  ctx.rect(LABELS, RULER, box.width - LABELS, box.height - RULER);
  ctx.save();
  ctx.clip();
  sound(ctx, s);
  data(ctx, s);
  grid(ctx, s);
  cones(ctx, s);
  for (const j of s.joints) if (j !== s.chosen) curve(ctx, s, j);
  if (s.chosen !== undefined && s.joints.includes(s.chosen)) curve(ctx, s, s.chosen);
  for (const p of points(s.clip, s.joints)) diamond(ctx, s, p);
  for (const h of handles(s.space, s.clip, s.joints, s.selection)) handle(ctx, s, h);
  for (const t of tops(s.space, s.clip, s.joints))
    top(ctx, s, t.x, t.y, t.frame === s.offset, s.hue(t.joint));
  ctx.restore();
  ruler(ctx, s);
  playhead(ctx, s);
  if (s.boxSelect) {
    const b = s.boxSelect;
    ctx.strokeStyle = theme.selected;
    ctx.lineWidth = 1;
    ctx.fillStyle = `${theme.selected}22`;
    ctx.fillRect(b.x0, b.y0, b.x1 - b.x0, b.y1 - b.y0);
    ctx.strokeRect(b.x0 + 0.5, b.y0 + 0.5, b.x1 - b.x0, b.y1 - b.y0);
  }
  ctx.restore();
}

/** Lines at round values, and what they stand for. */
function grid(ctx: Ctx, s: Scene): void {
  const { box, theme, space } = s;
  const scale = space.normal ? 100 : s.scale;
  const [lo, hi] = [space.span.lo * scale, space.span.hi * scale];
  const wanted = ((hi - lo) * 36) / Math.max(60, box.height - RULER);
  const ten = 10 ** Math.floor(Math.log10(wanted));
  const step = [1, 2, 5, 10].map((k) => k * ten).find((v) => v >= wanted) ?? 10 * ten;
  const digits = digitsOf(step);
  ctx.font = `11px ${theme.font}`;
  ctx.textBaseline = "middle";
  ctx.lineWidth = 1;
  for (let k = Math.ceil(lo / step); k * step <= hi; k++) {
    const share = (k * step - lo) / (hi - lo);
    const y = Math.round(valueAt(space, share)) + 0.5;
    ctx.strokeStyle = k === 0 && !space.normal ? theme.rule : theme.faint;
    ctx.beginPath();
    ctx.moveTo(LABELS, y);
    ctx.lineTo(box.width, y);
    ctx.stroke();
    ctx.fillStyle = theme.dim;
    ctx.fillText(`${fixed(k * step, digits)}${space.normal ? " %" : s.unit}`, LABELS + 6, y - 7);
  }
}

/** Where a share of the visible span stands. */
function valueAt(space: Space, share: number): number {
  const [top, bottom] = [RULER, space.box.height];
  const at = space.span.lo + share * (space.span.hi - space.span.lo);
  // yToSeen is linear: two of its points give the others.
  const [a, b] = [yToSeen(space, top), yToSeen(space, bottom)];
  return top + ((at - a) / (b - a)) * (bottom - top);
}

/** Of the chosen joint: the data of the policy as a tint, its stops as lines with what lies beyond shaded. */
function data(ctx: Ctx, s: Scene): void {
  const { chosen, theme, box, space } = s;
  const fact = chosen === undefined ? undefined : space.facts[chosen];
  if (!fact || chosen === undefined) return;
  const y = (v: number): number => valueToY(space, chosen, v);
  if (fact.band) {
    ctx.fillStyle = `${theme.look}14`;
    ctx.fillRect(LABELS, y(fact.band[1]), box.width, y(fact.band[0]) - y(fact.band[1]));
  }
  if (!fact.range) return;
  // The other curves have other stops.
  if (s.joints.length === 1) {
    ctx.fillStyle = `${theme.error}12`;
    ctx.fillRect(LABELS, RULER, box.width, y(fact.range[1]) - RULER);
    ctx.fillRect(LABELS, y(fact.range[0]), box.width, box.height - y(fact.range[0]));
  }
  ctx.strokeStyle = theme.error;
  ctx.setLineDash([2, 4]);
  ctx.lineWidth = 1;
  for (const edge of fact.range) {
    ctx.beginPath();
    ctx.moveTo(LABELS, y(edge));
    ctx.lineTo(box.width, y(edge));
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

/** From the selected keys of the chosen joint: where its next key can lie. Green at the policy's usual speed, amber up to what the joint can do. */
function cones(ctx: Ctx, s: Scene): void {
  const { chosen, theme, view, box, space, clip } = s;
  const fact = chosen === undefined ? undefined : space.facts[chosen];
  if (!fact || chosen === undefined) return;
  const own = points(clip, [chosen]).filter((p) => s.selection.has(nameOf(p)));
  for (const p of own.slice(0, 3)) {
    const at = stretches(clip, chosen).find((t) => t.kind === "key" && t.from === p.frame);
    for (const [from, way] of [
      [at?.to ?? p.frame, 1],
      [p.frame, -1],
    ] as const) {
      // As far as the next key, or what is in sight.
      const keys = clip.keys.filter((k) => isOf(clip, k, chosen)).map((k) => k.frame);
      const next = way === 1 ? keys.find((f) => f > from) : keys.filter((f) => f < from).at(-1);
      const far = next ?? xToFrame(view, way === 1 ? box.width : LABELS);
      const wedge = (speed: number, color: string): void => {
        const rise = (Math.abs(far - from) / clip.fps) * speed;
        ctx.fillStyle = color;
        ctx.beginPath();
        ctx.moveTo(frameToX(view, from), valueToY(space, chosen, p.value));
        ctx.lineTo(frameToX(view, far), valueToY(space, chosen, p.value + rise));
        ctx.lineTo(frameToX(view, far), valueToY(space, chosen, p.value - rise));
        ctx.closePath();
        ctx.fill();
      };
      if (fact.speed_max !== null) wedge(fact.speed_max, `${theme.key}16`);
      if (fact.speed_usual !== null) wedge(fact.speed_usual, `${theme.look}22`);
    }
  }
}

/** What a stretch asks of the joint: 0 usual, 1 faster than the policy's data, 2 faster than the joint can. */
export function asks(space: Space, joint: number, perFrame: number, fps: number): 0 | 1 | 2 {
  const fact = space.facts[joint];
  const speed = perFrame * fps;
  if (fact?.speed_max != null && speed > fact.speed_max * (1 + 1e-9)) return 2;
  return fact?.speed_usual != null && speed > fact.speed_usual * (1 + 1e-9) ? 1 : 0;
}

function curve(ctx: Ctx, s: Scene, joint: number): void {
  const { theme, view, space, clip } = s;
  const bold = joint === s.chosen;
  const color = s.hue(joint);
  const at = (f: number, v: number): [number, number] => [frameToX(view, f), valueToY(space, joint, v)];
  // What was reached, thin behind what is commanded.
  ctx.strokeStyle = color;
  ctx.globalAlpha = bold ? 0.55 : 0.3;
  ctx.lineWidth = 1;
  ctx.beginPath();
  const last = Math.min(s.reached.length, Math.ceil(xToFrame(view, space.box.width)) + 1);
  for (let f = Math.max(0, Math.floor(view.left)); f < last; f++) {
    const v = s.reached[f]?.[joint];
    if (v !== undefined) ctx.lineTo(...at(f, v));
  }
  ctx.stroke();
  ctx.globalAlpha = 1;
  if (clip.offsets?.some((o) => o.add[clip.robot.joints[joint] ?? ""])) base(ctx, s, joint, color, at);
  for (const t of stretches(clip, joint)) {
    const asked = asks(space, joint, steepest(t), clip.fps);
    ctx.strokeStyle = asked === 2 ? theme.error : asked === 1 && bold ? theme.key : color;
    ctx.lineWidth = t.kind === "key" ? (bold ? 3 : 2) : bold ? 1.8 : 1.2;
    ctx.setLineDash(t.kind === "masked" ? [2, 4] : asked === 2 ? [7, 3] : []);
    ctx.beginPath();
    t.values.forEach((v, i) => {
      const step = t.kind === "masked" ? t.to - t.from : 1;
      ctx.lineTo(...at(t.from + i * step, v));
    });
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

/** The keys alone, under what offsets make of them. */
function base(
  ctx: Ctx,
  s: Scene,
  joint: number,
  color: string,
  at: (f: number, v: number) => [number, number],
): void {
  ctx.strokeStyle = color;
  ctx.globalAlpha = 0.6;
  ctx.lineWidth = 1;
  ctx.setLineDash([2, 3]);
  for (const t of bareStretches(s.clip, joint)) {
    if (t.kind === "masked") continue;
    ctx.beginPath();
    t.values.forEach((v, i) => ctx.lineTo(...at(t.from + i, v)));
    ctx.stroke();
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

/** A tangent: hollow while it is automatic. */
function handle(ctx: Ctx, s: Scene, h: Handle): void {
  const { theme } = s;
  ctx.strokeStyle = theme.selected;
  ctx.globalAlpha = h.set ? 1 : 0.65;
  ctx.lineWidth = 1.2;
  ctx.beginPath();
  ctx.moveTo(h.px, h.py);
  ctx.lineTo(h.x, h.y);
  ctx.stroke();
  ctx.beginPath();
  ctx.arc(h.x, h.y, 4, 0, 2 * Math.PI);
  ctx.fillStyle = h.set ? theme.selected : theme.panel;
  ctx.fill();
  ctx.stroke();
  ctx.globalAlpha = 1;
}

/** The top of an offset: a ring on the motion that it makes. */
function top(ctx: Ctx, s: Scene, x: number, y: number, on: boolean, color: string): void {
  const { theme } = s;
  ctx.beginPath();
  ctx.arc(x, y, on ? 7 : 6, 0, 2 * Math.PI);
  ctx.fillStyle = theme.panel;
  ctx.fill();
  ctx.lineWidth = on ? 3 : 2;
  ctx.strokeStyle = on ? theme.selected : color;
  ctx.stroke();
}

function diamond(ctx: Ctx, s: Scene, p: Point): void {
  const { theme, view, space } = s;
  const [x, y] = [frameToX(view, p.frame), valueToY(space, p.joint, p.value)];
  if (x < LABELS - 8 || x > space.box.width + 8) return;
  const on = s.selection.has(nameOf(p));
  // Keys of dense motion are dots: as diamonds they would hide it.
  if (!on && view.zoom < 8 && s.dense) {
    ctx.fillStyle = s.hue(p.joint);
    ctx.fillRect(x - 1, y - 1, 2, 2);
    return;
  }
  const r = on ? 6 : p.joint === s.chosen ? 5 : 4;
  ctx.beginPath();
  ctx.moveTo(x, y - r);
  ctx.lineTo(x + r, y);
  ctx.lineTo(x, y + r);
  ctx.lineTo(x - r, y);
  ctx.closePath();
  ctx.fillStyle = on ? theme.selected : s.hue(p.joint);
  ctx.fill();
  ctx.strokeStyle = on ? theme.text : theme.panel;
  ctx.lineWidth = on ? 2 : 1.2;
  ctx.stroke();
}
