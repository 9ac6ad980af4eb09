// Draws what lies over the keys: the row of offsets, and blocks in the row of markers.

import { blocksOf, spanOf, weight } from "../layers";
import { frameToX, LABELS, MARKERS, ROW, RULER } from "./layout";
import type { Ctx, Scene } from "./scene";

/** Each offset as the hill by which it grows and fades, with a ring at its frame. */
export function offsets(ctx: Ctx, s: Scene, y: number): void {
  const { theme, view, box, clip } = s;
  ctx.fillStyle = `${theme.look}14`;
  ctx.fillRect(LABELS, y, box.width, ROW - 1);
  const [foot, high] = [y + ROW - 3, ROW - 7];
  for (const o of clip.offsets ?? []) {
    const own = s.offset?.frame === o.frame ? s.offset : undefined;
    const shift = own ? own.at - o.frame : 0;
    const { from, to } = spanOf(o, clip.length);
    if (frameToX(view, to + shift) < LABELS || frameToX(view, from + shift) > box.width) continue;
    ctx.beginPath();
    ctx.moveTo(frameToX(view, from - 1 + shift), foot);
    for (let f = from; f < to; f++) ctx.lineTo(frameToX(view, f + shift), foot - high * weight(o, f));
    ctx.lineTo(frameToX(view, to + shift), foot);
    ctx.fillStyle = own ? `${theme.selected}55` : `${theme.look}55`;
    ctx.fill();
    ctx.strokeStyle = own ? theme.selected : theme.look;
    ctx.lineWidth = own ? 1.8 : 1.2;
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(frameToX(view, o.frame + shift), foot - high, 4, 0, 2 * Math.PI);
    ctx.fillStyle = theme.panel;
    ctx.fill();
    ctx.lineWidth = own ? 2.4 : 1.8;
    ctx.stroke();
  }
}

/** Blocks: named bars that are carried as a whole. */
export function blocks(ctx: Ctx, s: Scene): void {
  const { theme, view, clip, box } = s;
  blocksOf(clip).forEach((b, i) => {
    const carried = s.carried?.frame === b.frame ? s.carried.dx : 0;
    const [x, end] = [frameToX(view, b.frame) + carried, frameToX(view, b.to) + carried];
    if (end < LABELS || x > box.width) return;
    ctx.save();
    ctx.beginPath();
    ctx.roundRect(x + 0.5, RULER + 1.5, Math.max(6, end - x - 1), MARKERS - 4, 3);
    ctx.globalAlpha = carried ? 0.8 : 1;
    ctx.fillStyle = i % 2 ? `${theme.marker}38` : `${theme.marker}55`;
    ctx.fill();
    ctx.strokeStyle = carried ? theme.selected : theme.marker;
    ctx.lineWidth = carried ? 1.8 : 1;
    ctx.stroke();
    ctx.clip();
    ctx.fillStyle = theme.text;
    ctx.fillText(b.name, Math.max(x, LABELS) + 6, RULER + MARKERS / 2);
    ctx.restore();
  });
}
