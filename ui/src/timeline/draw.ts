// Draws the dope sheet. Shape or hatch always repeats what colour says.

import { digitsOf, fixed } from "../numbers";
import { ground } from "./ground";
import { labels } from "./labels";
import { blocks, offsets } from "./layers";
import {
  frameToX,
  LABELS,
  LOOK_AHEAD,
  MARKERS,
  PRE_ROLL,
  ROW,
  type RowKind,
  RULER,
  rowToY,
  STRIP,
  tick,
  xToFrame,
} from "./layout";
import {
  bands,
  bars,
  type Diamond,
  diamonds,
  type Glyph,
  isPartial,
  type Mark,
  marks,
  ofPoint,
  ofRow,
} from "./marks";
import type { Ctx, Scene, Theme, Times } from "./scene";
import { sound } from "./sound";

let hatches = new Map<string, CanvasPattern>();

/** Diagonal lines of one colour; made once per colour. */
function hatch(ctx: Ctx, color: string): CanvasPattern | string {
  const known = hatches.get(color);
  if (known) return known;
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const t = tile.getContext("2d");
  if (!t) return color;
  t.strokeStyle = color;
  t.lineWidth = 1.2;
  t.beginPath();
  for (const o of [-8, 0, 8]) {
    t.moveTo(o - 1, 9);
    t.lineTo(o + 9, -1);
  }
  t.stroke();
  const pattern = ctx.createPattern(tile, "repeat");
  if (!pattern) return color;
  hatches.set(color, pattern);
  return pattern;
}

export function forgetHatches(): void {
  hatches = new Map();
  sprites = new Map();
}

export function draw(ctx: Ctx, s: Scene): void {
  const { box, theme, view } = s;
  ground(ctx, box, theme);
  backdrop(ctx, s);
  ctx.save();
  ctx.beginPath();
  ctx.rect(LABELS, RULER + MARKERS, box.width - LABELS, box.height - RULER - MARKERS - STRIP);
  ctx.clip();
  // Mostly every key has a goal for every joint: then they are drawn once for all rows.
  const list = marks(s.clip, view, box, s.dragged, s.selection);
  const ratio = ctx.getTransform().a || 1;
  const own = isPartial(s.clip) ? list : [];
  const common = own.length ? undefined : ready(s, list, ratio);
  s.rows.forEach((row, i) => {
    const y = rowToY(view, i);
    if (y <= -ROW || y >= box.height) return;
    if (row.kind === "offsets") offsets(ctx, s, y);
    else if (row.kind === "point") {
      ctx.fillStyle = `${theme.rule}40`;
      ctx.fillRect(LABELS, y, box.width, ROW - 1);
      ink(ctx, theme, ofPoint(list, row.name), y + ROW / 2, ratio, "point");
    } else bar(ctx, s, row, y, common, own, ratio);
  });
  ctx.restore();
  strip(ctx, s);
  ruler(ctx, s);
  markers(ctx, s);
  playhead(ctx, s);
  if (s.boxSelect) {
    const b = s.boxSelect;
    ctx.strokeStyle = theme.selected;
    ctx.fillStyle = `${theme.selected}22`;
    ctx.fillRect(b.x0, b.y0, b.x1 - b.x0, b.y1 - b.y0);
    ctx.strokeRect(b.x0 + 0.5, b.y0 + 0.5, b.x1 - b.x0, b.y1 - b.y0);
  }
  ctx.restore();
  labels(ctx, s);
}

function backdrop(ctx: Ctx, s: Scene): void {
  const { box, theme, view, clip } = s;
  const x0 = frameToX(view, 0);
  const end = frameToX(view, clip.length);
  ctx.fillStyle = theme.panel;
  ctx.fillRect(x0, 0, end - x0, box.height);
  // Pre-roll: the past that the policy is told.
  const pre = frameToX(view, -PRE_ROLL);
  ctx.fillStyle = `${theme.faint}88`;
  ctx.fillRect(pre, RULER, x0 - pre, box.height - RULER);
  // A blind span: a tint, and an edge that needs no colour to be seen.
  for (const b of s.blind) {
    const x = frameToX(view, b.from);
    const w = frameToX(view, b.to) - x;
    ctx.fillStyle = `${theme.blind}26`;
    ctx.fillRect(x, RULER + MARKERS, w, box.height - RULER - MARKERS - STRIP);
    ctx.fillStyle = theme.blind;
    ctx.fillRect(x, RULER + MARKERS, w, 2);
  }
  if (s.loop) {
    ctx.fillStyle = `${theme.focus}18`;
    const x = frameToX(view, s.loop.from);
    ctx.fillRect(x, 0, frameToX(view, s.loop.to) - x, box.height);
  }
  // What the policy sees from the playhead.
  const ahead = frameToX(view, s.playhead + 1);
  const width = LOOK_AHEAD * view.zoom;
  ctx.fillStyle = `${theme.look}1c`;
  ctx.fillRect(ahead, RULER, width, box.height - RULER);
  ctx.strokeStyle = theme.look;
  ctx.lineWidth = 1;
  ctx.beginPath();
  ctx.moveTo(ahead + 0.5, RULER + 5);
  ctx.lineTo(ahead + 0.5, RULER + 0.5);
  ctx.lineTo(ahead + width - 0.5, RULER + 0.5);
  ctx.lineTo(ahead + width - 0.5, RULER + 5);
  ctx.stroke();
}

/** A key with a pose is a diamond, a key with an end-effector goal a disc. */
type Shape = "pose" | "point" | "dense";

let sprites = new Map<string, HTMLCanvasElement>();

/** A diamond as a small picture: drawn thousands of times, it costs as much as a copy. */
function sprite(theme: Theme, what: Diamond["ink"], ratio: number, shape: Shape): HTMLCanvasElement {
  const name = `${what}:${shape}:${ratio}`;
  const known = sprites.get(name);
  if (known) return known;
  const tile = document.createElement("canvas");
  tile.width = tile.height = Math.ceil(SPRITE * ratio);
  const t = tile.getContext("2d");
  if (t) {
    const r = what === "selected" ? 6 : 5;
    t.scale(ratio, ratio);
    t.translate(SPRITE / 2, SPRITE / 2);
    t.beginPath();
    if (shape === "point") t.arc(0, 0, r - 0.5, 0, 2 * Math.PI);
    else {
      t.moveTo(0, -r);
      t.lineTo(r, 0);
      t.lineTo(0, r);
      t.lineTo(-r, 0);
    }
    t.closePath();
    t.fillStyle = what === "selected" ? theme.selected : what === "whole" ? theme.key : theme.panel;
    t.fill();
    t.strokeStyle = what === "selected" ? theme.text : what === "whole" ? theme.keyEdge : theme.key;
    t.lineWidth = what === "selected" ? 2 : 1.4;
    t.stroke();
  }
  sprites.set(name, tile);
  return tile;
}

/** Side of a diamond's picture, pixels. */
const SPRITE = 18;

/** Draws some keys and what is between them on one line. */
function ink(ctx: Ctx, theme: Theme, list: Glyph[], mid: number, ratio: number, shape: Shape = "pose"): void {
  for (const b of bars(list)) {
    const width = b.to - b.from;
    if (b.ink === "masked") {
      // Left to the policy: dots, as little ink as can be seen.
      ctx.strokeStyle = theme.hatch;
      ctx.lineWidth = 1.5;
      ctx.setLineDash([1.5, 4.5]);
      ctx.beginPath();
      ctx.moveTo(b.from, mid);
      ctx.lineTo(b.to, mid);
      ctx.stroke();
      ctx.setLineDash([]);
    } else if (b.ink === "hold") {
      ctx.fillStyle = theme.fill;
      ctx.beginPath();
      ctx.roundRect(b.from, mid - 4, width, 8, [0, 4, 4, 0]);
      ctx.fill();
    } else if (b.ink === "held") {
      ctx.fillStyle = `${theme.fill}88`;
      ctx.fillRect(b.from, mid - 2, width, 4);
    } else {
      ctx.strokeStyle = theme.fill;
      ctx.lineWidth = 1.6;
      ctx.setLineDash(b.ink === "cubic" ? [5, 3] : []);
      ctx.beginPath();
      ctx.moveTo(b.from, mid);
      ctx.lineTo(b.to, mid);
      ctx.stroke();
      ctx.setLineDash([]);
    }
  }
  // Keys at nearly every frame are a band: as diamonds they would be a wall.
  if (shape === "dense") {
    ctx.fillStyle = `${theme.key}b0`;
    for (const { from, to } of bands(list)) ctx.fillRect(from - 0.5, mid - 2, Math.max(2, to - from + 1), 4);
  }
  // Whole pixels: a copy between them would be blurred.
  const snap = (v: number): number => Math.round(v * ratio) / ratio;
  const all = diamonds(list).filter((d) => shape !== "dense" || d.ink === "selected");
  for (const what of ["part", "whole", "selected"] as const) {
    const picture = sprite(theme, what, ratio, shape);
    for (const d of all)
      if (d.ink === what)
        ctx.drawImage(picture, snap(d.x - SPRITE / 2), snap(mid - SPRITE / 2), SPRITE, SPRITE);
  }
}

let shared: HTMLCanvasElement | undefined;

/** One row with the keys that are the same in all rows, to be copied into each. */
function ready(s: Scene, list: Mark[], ratio: number): HTMLCanvasElement | undefined {
  if (list.length === 0) return undefined;
  shared ??= document.createElement("canvas");
  const [w, h] = [Math.ceil(s.box.width * ratio), Math.ceil(ROW * ratio)];
  if (shared.width !== w || shared.height !== h) Object.assign(shared, { width: w, height: h });
  const ctx = shared.getContext("2d");
  if (!ctx) return undefined;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, s.box.width, ROW);
  ink(ctx, s.theme, list, ROW / 2, ratio, s.dense ? "dense" : "pose");
  return shared;
}

/** The keys, holds, fills and masks of one row. What is the same in all rows comes ready made. */
function bar(
  ctx: Ctx,
  s: Scene,
  row: RowKind,
  y: number,
  common: HTMLCanvasElement | undefined,
  own: Mark[],
  ratio: number,
): void {
  const { clip, view, theme } = s;
  if (row.kind !== "joint") {
    ctx.fillStyle = `${theme.rule}40`;
    ctx.fillRect(LABELS, y, s.box.width, ROW - 1);
  } else if (row.joint === s.selectedJoint) {
    ctx.fillStyle = `${theme.selected}1a`;
    ctx.fillRect(LABELS, y, s.box.width, ROW - 1);
  }
  const joints = row.kind === "joint" ? [row.joint] : row.kind === "group" ? row.group.joints : undefined;
  if (common)
    ctx.drawImage(common, 0, Math.round(y * ratio) / ratio, common.width / ratio, common.height / ratio);
  if (own.length) {
    const shape = s.dense ? "dense" : "pose";
    ink(ctx, theme, ofRow(own, joints), y + ROW / 2, ratio, shape);
  }
  for (const mask of clip.masks ?? []) {
    const all = !mask.joints;
    const hits = all || !joints || joints.some((j) => mask.joints?.includes(clip.robot.joints[j] ?? ""));
    if (!hits) continue;
    const x = frameToX(view, mask.from);
    const w = frameToX(view, mask.to) - x;
    if (x > s.box.width || x + w < LABELS) continue;
    // Paler where it hides some joints of the row only.
    const names = joints ? joints.map((j) => clip.robot.joints[j] ?? "") : clip.robot.joints;
    ctx.globalAlpha = all || names.every((n) => mask.joints?.includes(n)) ? 1 : 0.35;
    ctx.fillStyle = `${theme.back}b0`;
    ctx.fillRect(x, y + 2, w, ROW - 5);
    ctx.fillStyle = hatch(ctx, theme.hatch);
    ctx.fillRect(x, y + 2, w, ROW - 5);
    ctx.globalAlpha = 1;
  }
}

export function ruler(ctx: Ctx, s: Times): void {
  const { box, theme, view, clip } = s;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(LABELS, 0, box.width - LABELS, RULER);
  const { minor, major } = tick(view.zoom, clip.fps);
  const digits = digitsOf(major / clip.fps);
  const first = Math.floor(view.left / minor) * minor;
  ctx.strokeStyle = theme.rule;
  ctx.fillStyle = theme.dim;
  ctx.font = `11px ${theme.font}`;
  ctx.textBaseline = "top";
  ctx.textAlign = "left";
  ctx.beginPath();
  for (let f = first; frameToX(view, f) < box.width; f += minor) {
    const x = Math.round(frameToX(view, f)) + 0.5;
    const on = f % major === 0;
    ctx.moveTo(x, RULER);
    ctx.lineTo(x, RULER - (on ? 9 : 4));
    const text = `${fixed(f / clip.fps, digits)} s`;
    if (on && f >= 0 && x + 4 + ctx.measureText(text).width < box.width) ctx.fillText(text, x + 4, 3);
  }
  ctx.stroke();
  // The end of the clip: a bracket to drag.
  const e = Math.round(frameToX(view, s.end ?? clip.length)) + 0.5;
  ctx.strokeStyle = s.end === undefined ? theme.dim : theme.selected;
  ctx.lineWidth = s.end === undefined ? 1.5 : 2.5;
  ctx.beginPath();
  ctx.moveTo(e - 5, 2);
  ctx.lineTo(e, 2);
  ctx.lineTo(e, RULER - 3);
  ctx.lineTo(e - 5, RULER - 3);
  ctx.stroke();
  if (s.end !== undefined) {
    ctx.beginPath();
    ctx.moveTo(e, RULER);
    ctx.lineTo(e, box.height);
    ctx.stroke();
  }
  ctx.lineWidth = 1;
  // How far the take is simulated.
  ctx.fillStyle = s.stale ? hatch(ctx, theme.cached) : theme.cached;
  const from = frameToX(view, 0);
  ctx.fillRect(from, RULER - 3, Math.max(0, frameToX(view, s.cachedTo) - from), 3);
}

function markers(ctx: Ctx, s: Scene): void {
  const { theme, view, clip } = s;
  ctx.fillStyle = theme.back;
  ctx.fillRect(LABELS, RULER, s.box.width - LABELS, MARKERS);
  sound(ctx, s);
  ctx.font = `11px ${theme.font}`;
  ctx.textBaseline = "middle";
  blocks(ctx, s);
  for (const m of clip.markers ?? []) {
    if (m.to !== undefined) continue;
    const x = frameToX(view, m.frame);
    const y = RULER + MARKERS / 2;
    ctx.fillStyle = theme.marker;
    ctx.beginPath();
    ctx.moveTo(x - 5, y - 5);
    ctx.lineTo(x + 5, y - 5);
    ctx.lineTo(x, y + 5);
    ctx.closePath();
    ctx.fill();
    ctx.fillText(m.name, x + 8, y);
  }
  for (const l of s.lints) {
    const x = frameToX(view, l.frame);
    ctx.fillStyle = l.level === "error" ? theme.error : theme.marker;
    ctx.fillRect(x - 1.5, RULER + MARKERS - 5, 3, 5);
  }
}

/** Error by frame: height and darkness both grow with it. */
function strip(ctx: Ctx, s: Scene): void {
  const { theme, view, box } = s;
  const y = box.height - STRIP;
  ctx.fillStyle = theme.back;
  ctx.fillRect(LABELS, y, box.width - LABELS, STRIP);
  const wide = Math.max(1, view.zoom);
  const until = Math.min(s.errors.length, Math.ceil(xToFrame(view, box.width)) + 1);
  for (let f = Math.max(0, Math.floor(view.left)); f < until; f++) {
    const e = s.errors[f];
    if (e === undefined || e === null) continue;
    const share = Math.min(1, e / s.errorTop);
    const h = 2 + share * (STRIP - 5);
    ctx.globalAlpha = 0.35 + 0.65 * share;
    ctx.fillStyle = theme.error;
    ctx.fillRect(frameToX(view, f - 0.5), box.height - 1 - h, wide + 0.5, h);
  }
  ctx.globalAlpha = 1;
  if (s.beside) besideLine(ctx, s, s.beside);
  ctx.strokeStyle = theme.rule;
  ctx.beginPath();
  ctx.moveTo(LABELS, y + 0.5);
  ctx.lineTo(box.width, y + 0.5);
  ctx.stroke();
}

/** The error of the take that is compared, as a line over the bars; broken where it had no goal. */
function besideLine(ctx: Ctx, s: Scene, beside: { errors: (number | null)[]; color: string }): void {
  const { view, box } = s;
  ctx.save();
  ctx.beginPath();
  ctx.rect(LABELS, box.height - STRIP, box.width - LABELS, STRIP);
  ctx.clip();
  ctx.strokeStyle = beside.color;
  ctx.lineWidth = 1.6;
  ctx.setLineDash([5, 3]);
  ctx.beginPath();
  let pen = false;
  const last = Math.min(beside.errors.length, Math.ceil(view.left + (box.width - LABELS) / view.zoom) + 2);
  for (let f = Math.max(0, Math.floor(view.left) - 1); f < last; f++) {
    const e = beside.errors[f];
    if (e === undefined || e === null) {
      pen = false;
      continue;
    }
    const x = frameToX(view, f);
    const top = box.height - 3 - Math.min(1, e / s.errorTop) * (STRIP - 5);
    if (pen) ctx.lineTo(x, top);
    else ctx.moveTo(x - 1, top);
    ctx.lineTo(x, top);
    pen = true;
  }
  ctx.stroke();
  ctx.restore();
}

export function playhead(ctx: Ctx, s: Pick<Times, "view" | "box" | "theme" | "playhead">): void {
  const x = Math.round(frameToX(s.view, s.playhead)) + 0.5;
  ctx.strokeStyle = s.theme.playhead;
  ctx.fillStyle = s.theme.playhead;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(x, 8);
  ctx.lineTo(x, s.box.height);
  ctx.stroke();
  ctx.beginPath();
  ctx.moveTo(x - 6, 0);
  ctx.lineTo(x + 6, 0);
  ctx.lineTo(x + 6, 6);
  ctx.lineTo(x, 12);
  ctx.lineTo(x - 6, 6);
  ctx.closePath();
  ctx.fill();
}
