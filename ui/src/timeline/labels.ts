// The column beside the dope sheet: names of rows, their locks and masks.

import { jointsOf, LABELS, MARKERS, ROW, type RowKind, RULER, rowToY, STRIP, SWITCHES } from "./layout";
import type { Ctx, Scene } from "./scene";

/** A padlock, and an eye that is shut: 16 by 16 pixels. */
const SIGNS = {
  lock: "M4 7.5h8v6H4z M5.5 7.5V5.3a2.5 2.5 0 0 1 5 0v2.2",
  mask: "M1.5 6.5c3.4 4.4 9.6 4.4 13 0 M4 9l-1.2 2 M8 10v2.3 M12 9l1.2 2",
};

/** The lock of a row's joints, and whether they are left to the policy: shown when on or when the pointer is there. */
function switches(ctx: Ctx, s: Scene, row: RowKind, y: number, shown: boolean): void {
  const joints = jointsOf(row);
  if (joints.length === 0) return;
  const { theme } = s;
  const names = joints.map((j) => s.clip.robot.joints[j] ?? "");
  const here = (s.clip.masks ?? []).filter((m) => m.from <= s.playhead && s.playhead < m.to);
  const masked = names.every((n) => here.some((m) => !m.joints || m.joints.includes(n)));
  const sign = (x: number, path: string, on: boolean, color: string, dim: boolean): void => {
    if (!on && !shown) return;
    ctx.save();
    ctx.globalAlpha = dim ? 0.35 : 1;
    ctx.translate(x, y + (ROW - 16) / 2);
    ctx.strokeStyle = on ? color : theme.dim;
    ctx.lineWidth = on ? 2 : 1.4;
    ctx.lineCap = ctx.lineJoin = "round";
    ctx.stroke(new Path2D(path));
    ctx.restore();
  };
  sign(SWITCHES.lock, SIGNS.lock, joints.every(s.locked), theme.playhead, false);
  sign(SWITCHES.mask, SIGNS.mask, masked, theme.marker, !s.maskable);
}

export function labels(ctx: Ctx, s: Scene): void {
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
    const bold = row.kind !== "joint" && row.kind !== "point";
    ctx.font = `${bold ? "600 " : ""}${bold ? 12 : 11}px ${theme.font}`;
    if (row.kind === "joint" && row.joint === s.selectedJoint) {
      ctx.fillStyle = `${theme.selected}33`;
      ctx.fillRect(0, y, LABELS, ROW - 1);
    }
    ctx.fillStyle = bold ? theme.text : theme.dim;
    const text =
      row.kind === "all"
        ? "All joints"
        : row.kind === "offsets"
          ? "Offsets"
          : row.kind === "point"
            ? s.pointName(row.name)
            : row.kind === "group"
              ? row.group.title
              : s.names(row.joint);
    if (row.kind === "group") {
      ctx.strokeStyle = theme.dim;
      ctx.lineWidth = 1.6;
      ctx.stroke(new Path2D(row.open ? `M8 ${mid - 2}l4 4 4-4` : `M10 ${mid - 4}l4 4-4 4`));
    }
    ctx.fillText(
      text,
      row.kind === "joint" ? 30 : row.kind === "group" || row.kind === "point" ? 22 : 10,
      mid + 0.5,
      row.kind === "all" ? LABELS - 34 : SWITCHES.lock - 30,
    );
    switches(ctx, s, row, y, i === s.hoverRow || (s.focused && i === s.focusRow));
    if (s.focused && i === s.focusRow) {
      ctx.strokeStyle = theme.focus;
      ctx.lineWidth = 2;
      ctx.strokeRect(1, y + 1, box.width - 2, ROW - 3);
    }
  });
  ctx.restore();
  ctx.font = `11px ${theme.font}`;
  ctx.fillStyle = theme.dim;
  ctx.fillText("error", 10, box.height - STRIP / 2);
  ctx.strokeStyle = theme.rule;
  ctx.lineWidth = 1;
  ctx.beginPath();
  ctx.moveTo(LABELS - 0.5, 0);
  ctx.lineTo(LABELS - 0.5, box.height);
  ctx.stroke();
}
