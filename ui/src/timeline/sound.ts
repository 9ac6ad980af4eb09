// The loudness of the reference along the time axis.

import { frameToX, LABELS, MARKERS, RULER, xToFrame } from "./layout";
import type { Ctx, Times } from "./scene";

export function sound(ctx: Ctx, s: Times): void {
  const { box, clip, heard, theme, view } = s;
  if (!heard) return;
  const { begins, sound } = heard;
  const middle = RULER + MARKERS / 2;
  const high = MARKERS / 2 - 1;
  const pieceAt = (x: number): number => Math.floor((xToFrame(view, x) / clip.fps + begins) * sound.perSec);
  const from = Math.max(LABELS, Math.floor(frameToX(view, -begins * clip.fps)));
  const secs = sound.peaks.length / sound.perSec;
  const to = Math.min(box.width, Math.ceil(frameToX(view, (secs - begins) * clip.fps)));
  ctx.fillStyle = `${theme.look}90`;
  for (let x = from; x < to; x++) {
    // The loudest of all pieces that this column stands for.
    let peak = 0;
    const last = Math.max(pieceAt(x) + 1, pieceAt(x + 1));
    for (let i = Math.max(0, pieceAt(x)); i < last; i++) peak = Math.max(peak, sound.peaks[i] ?? 0);
    const h = Math.max(0.5, high * Math.min(1, peak));
    ctx.fillRect(x, middle - h, 1, 2 * h);
  }
}
