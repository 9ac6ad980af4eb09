// Draws the dope sheet. Shape or hatch always repeats what colour says.

import { fillAfter, keyEnd, values, type Clip, type Key } from "../clip";
import {
  LABELS, LOOK_AHEAD, MARKERS, PRE_ROLL, ROW, RULER, STRIP, SWITCH, SWITCHES, frameToX, jointsOf, rowToY, tick,
  type Box, type RowKind, type View,
} from "./layout";

export interface Theme {
  back: string; panel: string; rule: string; faint: string; text: string; dim: string;
  key: string; keyEdge: string; selected: string; fill: string; hatch: string; blind: string;
  playhead: string; look: string; error: string; marker: string; cached: string; focus: string;
}

export interface Span {
  from: number;
  to: number;
}

export interface Scene {
  clip: Clip;
  rows: RowKind[];
  view: View;
  box: Box;
  theme: Theme;
  playhead: number;
  selection: ReadonlySet<number>;
  selectedJoint: number | undefined;
  blind: Span[];
  lints: { frame: number; level: "error" | "warning" }[];
  /** Mean error by frame, null where masked. */
  errors: (number | null)[];
  /** Error that fills the strip, rad or m. */
  errorTop: number;
  cachedTo: number;
  loop: Span | undefined;
  /** Keys as a drag in progress would leave them: frame -> frame. */
  dragged: ReadonlyMap<number, number>;
  boxSelect: { x0: number; y0: number; x1: number; y1: number } | undefined;
  names: (joint: number) => string;
  locked: (joint: number) => boolean;
  /** Whether the policy can leave single joints open. */
  maskable: boolean;
  stale: boolean;
  focusRow: number;
  focused: boolean;
}

type Ctx = CanvasRenderingContext2D;

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
}

export function draw(ctx: Ctx, s: Scene): void {
  const { box, theme, view } = s;
  ctx.fillStyle = theme.back;
  ctx.fillRect(0, 0, box.width, box.height);
  ctx.save();
  ctx.beginPath();
  ctx.rect(LABELS, 0, box.width - LABELS, box.height);
  ctx.clip();
  backdrop(ctx, s);
  ctx.save();
  ctx.beginPath();
  ctx.rect(LABELS, RULER + MARKERS, box.width - LABELS, box.height - RULER - MARKERS - STRIP);
  ctx.clip();
  s.rows.forEach((row, i) => {
    const y = rowToY(view, i);
    if (y > -ROW && y < box.height) bar(ctx, s, row, y);
  });
  ctx.restore();
  strip(ctx, s);
  ruler(ctx, s);
  markers(ctx, s);
  playhead(ctx, s);
  if (s.boxSelect) {
    const b = s.boxSelect;
    ctx.strokeStyle = theme.selected;
    ctx.fillStyle = theme.selected + "22";
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
  ctx.fillStyle = hatch(ctx, theme.faint);
  ctx.fillRect(pre, RULER, x0 - pre, box.height - RULER);
  for (const b of s.blind) {
    ctx.fillStyle = hatch(ctx, theme.blind);
    const x = frameToX(view, b.from);
    ctx.fillRect(x, RULER + MARKERS, frameToX(view, b.to) - x, box.height - RULER - MARKERS - STRIP);
  }
  if (s.loop) {
    ctx.fillStyle = theme.focus + "18";
    const x = frameToX(view, s.loop.from);
    ctx.fillRect(x, 0, frameToX(view, s.loop.to) - x, box.height);
  }
  // What the policy sees from the playhead.
  const ahead = frameToX(view, s.playhead + 1);
  const width = LOOK_AHEAD * view.zoom;
  ctx.fillStyle = theme.look + "1c";
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

/** The keys, holds, fills and masks of one row. */
function bar(ctx: Ctx, s: Scene, row: RowKind, y: number): void {
  const { clip, view, theme } = s;
  const mid = y + ROW / 2;
  if (row.kind !== "joint") {
    ctx.fillStyle = theme.rule + "55";
    ctx.fillRect(LABELS, y, s.box.width, ROW - 1);
  } else if (row.joint === s.selectedJoint) {
    ctx.fillStyle = theme.selected + "1a";
    ctx.fillRect(LABELS, y, s.box.width, ROW - 1);
  }
  const joints =
    row.kind === "joint" ? [row.joint] : row.kind === "group" ? row.group.joints : undefined;
  const keys = clip.keys;
  keys.forEach((key, i) => {
    const held = values(clip, key);
    const present = joints ? joints.filter((j) => held[j] !== null && held[j] !== undefined) : undefined;
    const some = present ? present.length > 0 : true;
    const whole = joints ? present?.length === joints.length : held.every((v) => v !== null);
    if (!some) return;
    const at = s.dragged.get(key.frame) ?? key.frame;
    const shift = at - key.frame;
    const x = frameToX(view, at);
    const holdEnd = frameToX(view, keyEnd(key) + shift);
    const next = keys[i + 1];
    const until = next ? frameToX(view, s.dragged.get(next.frame) ?? next.frame) : undefined;
    const fill = fillAfter(clip, key);
    if (until !== undefined && until > holdEnd && fill !== "mask") {
      ctx.fillStyle = theme.fill + "88";
      if (fill === "hold") ctx.fillRect(holdEnd, mid - 2, until - holdEnd, 4);
      else {
        ctx.strokeStyle = theme.fill;
        ctx.lineWidth = 1.6;
        ctx.setLineDash(fill === "cubic" ? [5, 3] : []);
        ctx.beginPath();
        ctx.moveTo(holdEnd, mid);
        ctx.lineTo(until, mid);
        ctx.stroke();
        ctx.setLineDash([]);
      }
    } else if (until !== undefined && until > holdEnd) {
      ctx.fillStyle = hatch(ctx, theme.hatch);
      ctx.fillRect(holdEnd, mid - 4, until - holdEnd, 8);
    }
    if ((key.hold ?? 1) > 1) {
      ctx.fillStyle = theme.fill;
      ctx.fillRect(x, mid - 4, holdEnd - x, 8);
    }
    diamond(ctx, s, key, x, mid, whole);
  });
  for (const mask of clip.masks ?? []) {
    const all = !mask.joints;
    const hits = all || !joints || joints.some((j) => mask.joints?.includes(clip.robot.joints[j] ?? ""));
    if (!hits) continue;
    const x = frameToX(view, mask.from);
    const w = frameToX(view, mask.to) - x;
    ctx.fillStyle = theme.back + "b0";
    ctx.fillRect(x, y + 2, w, ROW - 5);
    ctx.fillStyle = hatch(ctx, theme.hatch);
    ctx.fillRect(x, y + 2, w, ROW - 5);
  }
}

function diamond(ctx: Ctx, s: Scene, key: Key, x: number, y: number, whole: boolean): void {
  const { theme } = s;
  const selected = s.selection.has(key.frame);
  const r = selected ? 6 : 5;
  ctx.beginPath();
  ctx.moveTo(x, y - r);
  ctx.lineTo(x + r, y);
  ctx.lineTo(x, y + r);
  ctx.lineTo(x - r, y);
  ctx.closePath();
  ctx.fillStyle = selected ? theme.selected : whole ? theme.key : theme.panel;
  ctx.fill();
  ctx.strokeStyle = selected ? theme.text : whole ? theme.keyEdge : theme.key;
  ctx.lineWidth = selected ? 2 : 1.4;
  ctx.stroke();
}

function ruler(ctx: Ctx, s: Scene): void {
  const { box, theme, view, clip } = s;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(LABELS, 0, box.width - LABELS, RULER);
  const { minor, major } = tick(view.zoom, clip.fps);
  const first = Math.floor(view.left / minor) * minor;
  ctx.strokeStyle = theme.rule;
  ctx.fillStyle = theme.dim;
  ctx.font = "11px system-ui, sans-serif";
  ctx.textBaseline = "top";
  ctx.textAlign = "left";
  ctx.beginPath();
  for (let f = first; frameToX(view, f) < box.width; f += minor) {
    const x = Math.round(frameToX(view, f)) + 0.5;
    const on = f % major === 0;
    ctx.moveTo(x, RULER);
    ctx.lineTo(x, RULER - (on ? 9 : 4));
    if (on) ctx.fillText(f % clip.fps === 0 ? `${f / clip.fps} s` : `${f}`, x + 3, 3);
  }
  ctx.stroke();
  // How far the take is simulated.
  ctx.fillStyle = s.stale ? hatch(ctx, theme.cached) : theme.cached;
  const from = frameToX(view, 0);
  ctx.fillRect(from, RULER - 3, Math.max(0, frameToX(view, s.cachedTo) - from), 3);
}

function markers(ctx: Ctx, s: Scene): void {
  const { theme, view, clip } = s;
  ctx.fillStyle = theme.back;
  ctx.fillRect(LABELS, RULER, s.box.width - LABELS, MARKERS);
  ctx.font = "11px system-ui, sans-serif";
  ctx.textBaseline = "middle";
  for (const m of clip.markers ?? []) {
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
  for (let f = Math.max(0, Math.floor(view.left)); f < s.errors.length; f++) {
    const e = s.errors[f];
    if (e === undefined || e === null) continue;
    const share = Math.min(1, e / s.errorTop);
    const h = 2 + share * (STRIP - 5);
    ctx.globalAlpha = 0.35 + 0.65 * share;
    ctx.fillStyle = theme.error;
    ctx.fillRect(frameToX(view, f - 0.5), box.height - 1 - h, wide + 0.5, h);
  }
  ctx.globalAlpha = 1;
  ctx.strokeStyle = theme.rule;
  ctx.beginPath();
  ctx.moveTo(LABELS, y + 0.5);
  ctx.lineTo(box.width, y + 0.5);
  ctx.stroke();
}

function playhead(ctx: Ctx, s: Scene): void {
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

/** [L] locks the joints of a row, [M] leaves them to the policy; filled when on. */
function switches(ctx: Ctx, s: Scene, row: RowKind, y: number): void {
  const joints = jointsOf(row);
  if (joints.length === 0) return;
  const { theme } = s;
  const names = joints.map((j) => s.clip.robot.joints[j] ?? "");
  const here = (s.clip.masks ?? []).filter((m) => m.from <= s.playhead && s.playhead < m.to);
  const masked = names.every((n) => here.some((m) => !m.joints || m.joints.includes(n)));
  const box = (x: number, letter: string, on: boolean, color: string, dim: boolean): void => {
    ctx.globalAlpha = dim ? 0.35 : 1;
    ctx.fillStyle = on ? color : theme.panel;
    ctx.strokeStyle = on ? color : theme.rule;
    ctx.lineWidth = 1;
    ctx.beginPath();
    ctx.roundRect(x + 0.5, y + 2.5, SWITCH - 1, ROW - 6, 3);
    ctx.fill();
    ctx.stroke();
    ctx.fillStyle = on ? theme.panel : theme.dim;
    ctx.font = `${on ? "700 " : ""}10px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.fillText(letter, x + SWITCH / 2, y + ROW / 2);
    ctx.textAlign = "left";
    ctx.globalAlpha = 1;
  };
  box(SWITCHES.lock, "L", joints.every(s.locked), theme.playhead, false);
  box(SWITCHES.mask, "M", masked, theme.marker, !s.maskable);
}

function labels(ctx: Ctx, s: Scene): void {
  const { theme, view, box } = s;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(0, 0, LABELS, box.height);
  ctx.save();
  ctx.beginPath();
  ctx.rect(0, RULER + MARKERS, LABELS, box.height - RULER - MARKERS - STRIP);
  ctx.clip();
  ctx.textBaseline = "middle";
  s.rows.forEach((row, i) => {
    const y = rowToY(view, i);
    if (y < -ROW || y > box.height) return;
    const mid = y + ROW / 2;
    const bold = row.kind !== "joint";
    ctx.font = `${bold ? "600 " : ""}12px system-ui, sans-serif`;
    if (row.kind === "joint" && row.joint === s.selectedJoint) {
      ctx.fillStyle = theme.selected + "33";
      ctx.fillRect(0, y, LABELS, ROW - 1);
    }
    ctx.fillStyle = bold ? theme.text : theme.dim;
    const text =
      row.kind === "all" ? "All joints"
      : row.kind === "group" ? `${row.open ? "▾" : "▸"} ${row.group.title}`
      : s.names(row.joint);
    ctx.fillText(text, row.kind === "joint" ? 26 : 10, mid, row.kind === "all" ? LABELS - 34 : SWITCHES.lock - 30);
    switches(ctx, s, row, y);
    if (s.focused && i === s.focusRow) {
      ctx.strokeStyle = theme.focus;
      ctx.lineWidth = 2;
      ctx.strokeRect(1, y + 1, box.width - 2, ROW - 3);
    }
  });
  ctx.restore();
  ctx.font = "11px system-ui, sans-serif";
  ctx.fillStyle = theme.dim;
  ctx.fillText("error", 10, box.height - STRIP / 2);
  ctx.strokeStyle = theme.rule;
  ctx.lineWidth = 1;
  ctx.beginPath();
  ctx.moveTo(LABELS - 0.5, 0);
  ctx.lineTo(LABELS - 0.5, box.height);
  ctx.stroke();
}
