// What rows and curves are drawn on.

import { type Box, LABELS } from "./layout";
import type { Theme } from "./scene";

/** Clears the canvas; what is drawn until the next `restore` stays right of the labels. */
export function ground(ctx: CanvasRenderingContext2D, box: Box, theme: Theme): void {
  ctx.fillStyle = theme.back;
  ctx.fillRect(0, 0, box.width, box.height);
  ctx.save();
  ctx.beginPath();
  ctx.rect(LABELS, 0, box.width - LABELS, box.height);
  ctx.clip();
}
