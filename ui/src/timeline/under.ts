// What lies under a pixel of the dope sheet.

import { type Block, blocksOf, spanOf } from "../layers";
import { frameToX, LABELS, MARKERS, RULER, STRIP, xToFrame, yToRow } from "./layout";
import type { Sheet } from "./sheet";

/** The key whose diamond is under a pixel. */
export function hit(sheet: Sheet, x: number, y: number): number | undefined {
  const clip = sheet.clip();
  if (!clip) return undefined;
  const rows = sheet.rows();
  const row = yToRow(sheet.view(), y, rows.length);
  if (row === undefined || rows[row]?.kind === "offsets" || x < LABELS || y > sheet.box().height - STRIP)
    return undefined;
  let best: number | undefined;
  let near = 9;
  for (const key of clip.keys) {
    const d = Math.abs(frameToX(sheet.view(), key.frame) - x);
    if (d < near) {
      near = d;
      best = key.frame;
    }
  }
  return best;
}

export function markerAt(sheet: Sheet, x: number, y: number): number | undefined {
  if (y < RULER || y >= RULER + MARKERS) return undefined;
  return sheet
    .clip()
    ?.markers?.find((m) => m.to === undefined && Math.abs(frameToX(sheet.view(), m.frame) - x) < 8)?.frame;
}

/** The block under a pixel of the row of markers. */
export function blockUnder(sheet: Sheet, x: number, y: number): Block | undefined {
  const clip = sheet.clip();
  if (!clip || y < RULER || y >= RULER + MARKERS || x < LABELS) return undefined;
  const frame = xToFrame(sheet.view(), x);
  return blocksOf(clip).find((b) => b.frame <= frame && frame < b.to);
}

/** The offset whose hill is under a pixel of its row; of several the nearest. */
export function offsetUnder(sheet: Sheet, x: number, y: number): number | undefined {
  const clip = sheet.clip();
  const rows = sheet.rows();
  if (!clip || x < LABELS || y > sheet.box().height - STRIP) return undefined;
  if (rows[yToRow(sheet.view(), y, rows.length) ?? -1]?.kind !== "offsets") return undefined;
  const frame = xToFrame(sheet.view(), x);
  const over = (clip.offsets ?? []).filter((o) => {
    const { from, to } = spanOf(o, clip.length);
    const slack = 6 / sheet.view().zoom;
    return from - slack <= frame && frame <= to + slack;
  });
  return over.sort((a, b) => Math.abs(a.frame - frame) - Math.abs(b.frame - frame))[0]?.frame;
}

/** Whether the end of the clip is under a pixel of the ruler. */
export function endAt(sheet: Sheet, x: number, y: number): boolean {
  const clip = sheet.clip();
  return (
    clip !== undefined && y < RULER && x >= LABELS && Math.abs(frameToX(sheet.view(), clip.length) - x) < 6
  );
}
