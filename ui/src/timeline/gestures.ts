// Pointer gestures of the dope sheet as one small state machine. A gesture previews locally
// and sends one edit when it ends, so that a drag is one entry in the history. Esc cancels.

import { type Clip, clock, FPS, replaced } from "../clip";
import { endsOf, pivotOf } from "../grow";
import { hold } from "../hand";
import { blocksOf } from "../layers";
import type { Op } from "../protocol";
import { jointsOf, LABELS, MARKERS, ROW, RULER, STRIP, switchAt, xToFrame, yToRow, zoomAt } from "./layout";
import type { Sheet } from "./sheet";
import { blockUnder, endAt, hit, markerAt, offsetUnder } from "./under";

interface Press {
  kind: "scrub" | "pan" | "box" | "keys" | "marker" | "end" | "offset" | "block";
  x: number;
  y: number;
  frame: number;
  moved: boolean;
  base: ReadonlySet<number>;
  retime: boolean;
}

/** Whether keys were dragged since S went down. */
export const retimeByHand = { used: false };

export class Gestures {
  private press: Press | undefined;
  private retimeKey = false;

  constructor(
    private readonly canvas: HTMLElement,
    private readonly sheet: Sheet,
  ) {}

  /** Listens; the returned function stops listening. */
  attach(): () => void {
    const on = <K extends keyof HTMLElementEventMap>(
      type: K,
      handler: (e: HTMLElementEventMap[K]) => void,
      options?: AddEventListenerOptions,
    ): (() => void) => {
      this.canvas.addEventListener(type, handler, options);
      return () => this.canvas.removeEventListener(type, handler, options);
    };
    // Before the shortcuts, which let nothing that they know pass.
    const keys = (e: KeyboardEvent): void => {
      if (e.key === "Escape" && this.press) this.cancel();
      if (e.key.toLowerCase() === "s" && !e.ctrlKey && !e.metaKey) this.retimeKey = e.type === "keydown";
    };
    window.addEventListener("keydown", keys, true);
    window.addEventListener("keyup", keys, true);
    const stops = [
      on("pointerdown", (e) => this.down(e)),
      on("pointermove", (e) => this.move(e)),
      on("pointerup", (e) => this.up(e)),
      on("pointercancel", () => this.cancel()),
      on("pointerleave", () => {
        this.sheet.over(undefined);
        if (!this.press) this.sheet.hint("");
      }),
      on("dblclick", (e) => this.double(e)),
      on("contextmenu", (e) => this.context(e)),
      on("wheel", (e) => this.wheel(e), { passive: false }),
      () => window.removeEventListener("keydown", keys, true),
      () => window.removeEventListener("keyup", keys, true),
    ];
    return () => stops.forEach((stop) => stop());
  }

  private at(e: MouseEvent): { x: number; y: number } {
    const r = this.canvas.getBoundingClientRect();
    return { x: e.clientX - r.left, y: e.clientY - r.top };
  }

  private down(e: PointerEvent): void {
    const { x, y } = this.at(e);
    const { sheet } = this;
    const frame = xToFrame(sheet.view(), x);
    this.canvas.setPointerCapture(e.pointerId);
    const begin = (kind: Press["kind"], at = frame): void => {
      this.press = {
        kind,
        x,
        y,
        frame: at,
        moved: false,
        base: sheet.selection(),
        retime: this.retimeKey,
      };
      if (kind !== "scrub") hold(() => this.cancel());
    };
    if (e.button === 1) return begin("pan");
    if (e.button !== 0) return;
    if (x < LABELS) return this.label(x, y);
    if (endAt(sheet, x, y)) return begin("end");
    if (y < RULER || y > sheet.box().height - STRIP) {
      begin("scrub");
      return this.scrub(x);
    }
    const marker = markerAt(sheet, x, y);
    if (marker !== undefined) return begin("marker", marker);
    const block = blockUnder(sheet, x, y);
    if (block) return begin("block", block.frame);
    const offset = offsetUnder(sheet, x, y);
    sheet.chooseOffset(offset);
    if (offset !== undefined) {
      sheet.setSelection(new Set());
      return begin("offset", offset);
    }
    const key = hit(sheet, x, y);
    const row = sheet.rows()[yToRow(sheet.view(), y, sheet.rows().length) ?? -1];
    if (row?.kind === "joint") sheet.setJoint(row.joint);
    if (key === undefined) return begin("box");
    const selected = sheet.selection();
    if (e.ctrlKey || e.metaKey) {
      const next = new Set(selected);
      if (!next.delete(key)) next.add(key);
      sheet.setSelection(next);
    } else if (e.shiftKey && selected.size > 0 && !selected.has(key)) {
      const [lo, hi] = [Math.min(key, ...selected), Math.max(key, ...selected)];
      sheet.setSelection(
        new Set(
          sheet
            .clip()
            ?.keys.map((k) => k.frame)
            .filter((f) => f >= lo && f <= hi),
        ),
      );
    } else if (!selected.has(key)) {
      sheet.setSelection(new Set([key]));
    }
    begin("keys", key);
    if (this.retimeKey) retimeByHand.used = true;
  }

  private label(x: number, y: number): void {
    const rows = this.sheet.rows();
    const row = rows[yToRow(this.sheet.view(), y, rows.length) ?? -1];
    const which = switchAt(x);
    const joints = jointsOf(row);
    if (which && joints.length > 0)
      return which === "lock" ? this.sheet.toggleLock(joints) : this.sheet.toggleMask(joints);
    if (row?.kind === "group") this.sheet.toggleGroup(row.group.name);
    if (row?.kind === "joint") this.sheet.setJoint(row.joint);
    if (row?.kind === "all") {
      this.sheet.setSelection(new Set(this.sheet.clip()?.keys.map((k) => k.frame)));
    }
  }

  private scrub(x: number): void {
    const last = (this.sheet.clip()?.length ?? 1) - 1;
    this.sheet.setPlayhead(Math.min(last, Math.max(0, Math.round(xToFrame(this.sheet.view(), x)))));
  }

  /** Alt copies, Shift ripples; a copy does not ripple. */
  private manner(e: PointerEvent): { copy: boolean; ripple: boolean } {
    return { copy: e.altKey, ripple: e.shiftKey && !e.altKey };
  }

  /** The length that a drag of the clip's end asks for: no key, offset or marker falls out of it. */
  private lengthAt(x: number): number {
    const clip = this.sheet.clip();
    const last = Math.max(
      1,
      ...(clip?.keys ?? []).map((k) => k.frame),
      ...(clip?.offsets ?? []).map((o) => o.frame),
      ...(clip?.markers ?? []).map((m) => m.frame),
    );
    return Math.max(last + 1, Math.round(xToFrame(this.sheet.view(), x)));
  }

  /** What stays when keys are retimed; a hand on that very key pulls it from the other end. */
  private pivot(press: Press): number {
    const frames = [...this.sheet.selection()];
    const pivot = pivotOf(frames, this.sheet.playhead());
    return pivot === press.frame && pivot !== this.sheet.playhead() ? Math.max(...frames) : pivot;
  }

  /** Where the selected keys would land. */
  private landing(e: PointerEvent, x: number): { df: number; to: Map<number, number>; factor: number } {
    const { sheet, press } = this;
    const frames = [...sheet.selection()].sort((a, b) => a - b);
    const to = new Map<number, number>();
    const now = xToFrame(sheet.view(), x);
    if (press?.retime) {
      const pivot = this.pivot(press);
      const span = press.frame - pivot;
      const factor = span === 0 ? 1 : Math.max(0.05, (now - pivot) / span);
      for (const f of frames) to.set(f, Math.max(0, Math.round(pivot + (f - pivot) * factor)));
      return { df: 0, to, factor };
    }
    const first = frames[0] ?? 0;
    let df = Math.round(now - (press?.frame ?? now));
    if (first + df < 0) df = -first;
    for (const f of frames) to.set(f, f + df);
    if (this.manner(e).ripple) {
      for (const key of sheet.clip()?.keys ?? []) if (key.frame > first) to.set(key.frame, key.frame + df);
    }
    return { df, to, factor: 1 };
  }

  private move(e: PointerEvent): void {
    const { press, sheet } = this;
    const { x, y } = this.at(e);
    sheet.over(yToRow(sheet.view(), y, sheet.rows().length));
    if (!press) {
      const key = hit(sheet, x, y);
      const strip = y > sheet.box().height - STRIP;
      const which =
        x < LABELS && jointsOf(sheet.rows()[yToRow(sheet.view(), y, sheet.rows().length) ?? -1]).length > 0
          ? switchAt(x)
          : undefined;
      sheet.hint(
        which === "lock"
          ? "Lock, so that no slider, drag, reach, pose or paste moves it (Alt+L)"
          : which === "mask"
            ? "Leave it to the policy between the keys about the playhead, or between those selected (Alt+M, Alt+U)"
            : x < LABELS || y < RULER || key !== undefined
              ? ""
              : strip
                ? "error of each frame: mean over the joints that have a goal"
                : sheet.about(Math.round(xToFrame(sheet.view(), x))),
      );
      this.canvas.style.cursor = endAt(sheet, x, y)
        ? "col-resize"
        : key === undefined
          ? y < RULER
            ? "ew-resize"
            : "default"
          : "grab";
      return;
    }
    if (!press.moved && Math.hypot(x - press.x, y - press.y) < 3) return;
    press.moved = true;
    if (press.kind === "scrub") this.scrub(x);
    if (press.kind === "pan") {
      const v = sheet.view();
      sheet.setView({ ...v, left: v.left - e.movementX / v.zoom, top: Math.max(0, v.top - e.movementY) });
    }
    if (press.kind === "box") {
      const box = {
        x0: Math.min(x, press.x),
        y0: Math.min(y, press.y),
        x1: Math.max(x, press.x),
        y1: Math.max(y, press.y),
      };
      sheet.preview(new Map(), box);
      const [from, to] = [xToFrame(sheet.view(), box.x0), xToFrame(sheet.view(), box.x1)];
      const inside =
        sheet
          .clip()
          ?.keys.map((k) => k.frame)
          .filter((f) => f >= from && f <= to) ?? [];
      sheet.setSelection(new Set(e.ctrlKey || e.metaKey || e.shiftKey ? [...press.base, ...inside] : inside));
    }
    if (press.kind === "keys") {
      const { df, to, factor } = this.landing(e, x);
      sheet.preview(to, undefined);
      const what = press.retime ? `retime × ${factor.toFixed(2)}` : `${df >= 0 ? "+" : ""}${df} frames`;
      const { copy, ripple } = this.manner(e);
      sheet.hint(`${what}${copy ? ", copy" : ""}${ripple ? ", later keys too" : ""}`);
      const frames = [...sheet.selection()].sort((a, b) => a - b);
      if (press.retime)
        sheet.follow({ op: "keys.scale", args: { frames, pivot: this.pivot(press), factor } });
      else if (df !== 0) sheet.follow({ op: "keys.move", args: { frames, df, copy, ripple, replace: true } });
      else sheet.follow();
    }
    if (press.kind === "end") {
      const length = this.lengthAt(x);
      sheet.previewEnd(length);
      sheet.hint(`length ${length} frames, ${clock(length, sheet.clip()?.fps ?? FPS)}`);
    }
    if (press.kind === "offset") {
      const at = this.offsetTo(press, x);
      sheet.previewOffset({ frame: press.frame, at });
      sheet.hint(`offset to ${clock(at, sheet.clip()?.fps ?? FPS)}`);
      const df = at - press.frame;
      if (df === 0) sheet.follow();
      else sheet.follow({ op: "offsets.move", args: { frames: [press.frame], df } });
    }
    if (press.kind === "block") {
      sheet.carry({ frame: press.frame, dx: x - press.x });
      const [place, count] = this.placeOf(press, x);
      sheet.hint(`place ${place + 1} of ${count}`);
    }
    if (press.kind === "marker")
      sheet.hint(`marker to frame ${Math.max(0, Math.round(xToFrame(sheet.view(), x)))}`);
  }

  /** The frame where a dragged offset would be; never on another one. */
  private offsetTo(press: Press, x: number): number {
    const { sheet } = this;
    const clip = sheet.clip();
    const df = Math.round((x - press.x) / sheet.view().zoom);
    const to = Math.max(0, Math.min((clip?.length ?? 1) - 1, press.frame + df));
    return clip?.offsets?.some((o) => o.frame === to) ? press.frame : to;
  }

  /** The place of a dragged block among the blocks, and how many there are. */
  private placeOf(press: Press, x: number): [number, number] {
    const { sheet } = this;
    const all = blocksOf(sheet.clip() as Clip);
    const own = all.find((b) => b.frame === press.frame);
    if (!own) return [0, all.length];
    const middle = (own.frame + own.to) / 2 + (x - press.x) / sheet.view().zoom;
    const before = all.filter((b) => b !== own && (b.frame + b.to) / 2 < middle);
    return [before.length, all.length];
  }

  private up(e: PointerEvent): void {
    const { press, sheet } = this;
    if (!press) return;
    this.press = undefined;
    const { x } = this.at(e);
    sheet.hint("");
    if (press.kind !== "keys" || !press.moved) sheet.preview(new Map(), undefined);
    if (press.kind === "box" && !press.moved) {
      sheet.setSelection(new Set());
      this.scrub(x);
    }
    if (press.kind === "keys" && !press.moved) {
      // A click on one of several selected keys selects it alone.
      const adds = e.ctrlKey || e.metaKey || e.shiftKey;
      if (!adds && press.base.has(press.frame)) sheet.setSelection(new Set([press.frame]));
      sheet.setPlayhead(press.frame);
    }
    if (press.kind === "keys" && press.moved) void this.drop(press, e, x);
    if (press.kind === "end") {
      const length = this.lengthAt(x);
      if (press.moved && length !== sheet.clip()?.length)
        void sheet.edit({ op: "clip.length", args: { length } });
      sheet.previewEnd(undefined);
    }
    if (press.kind === "marker" && press.moved) {
      const to = Math.max(0, Math.round(xToFrame(sheet.view(), x)));
      if (to !== press.frame) void sheet.edit({ op: "markers.move", args: { frame: press.frame, to } });
    }
    if (press.kind === "marker" && !press.moved) sheet.setPlayhead(press.frame);
    if (press.kind === "offset") {
      const at = this.offsetTo(press, x);
      if (!press.moved || at === press.frame) {
        sheet.previewOffset(undefined);
        sheet.follow();
        sheet.setPlayhead(press.frame);
      } else
        void sheet
          .edit({ op: "offsets.move", args: { frames: [press.frame], df: at - press.frame } })
          .then((ok) => {
            sheet.previewOffset(undefined);
            sheet.follow();
            if (!ok) return;
            sheet.chooseOffset(at);
            sheet.setPlayhead(at);
          });
    }
    if (press.kind === "block") {
      sheet.carry(undefined);
      const own = blocksOf(sheet.clip() as Clip).find((b) => b.frame === press.frame);
      if (own && press.moved) sheet.order(own, this.placeOf(press, x)[0]);
      else sheet.setPlayhead(press.frame);
    }
  }

  /** Keys are let go: they stay drawn where they are until the answer, which may be no. */
  private async drop(press: Press, e: PointerEvent, x: number): Promise<void> {
    const { sheet } = this;
    this.press = press;
    const { df, to, factor } = this.landing(e, x);
    this.press = undefined;
    const frames = [...sheet.selection()].sort((a, b) => a - b);
    const { copy, ripple } = this.manner(e);
    const pivot = this.pivot(press);
    const still = press.retime ? factor === 1 : df === 0;
    const clip = sheet.clip();
    if (frames.length === 0) {
      sheet.preview(new Map(), undefined);
      sheet.hint("These keys are gone: another page deleted them.");
      return sheet.follow();
    }
    const lost = clip && !press.retime ? replaced(clip, to.values(), copy ? [] : to.keys()) : 0;
    const op: Op = press.retime
      ? { op: "keys.scale", args: { frames, pivot, factor } }
      : { op: "keys.move", args: { frames, df, copy, ripple, replace: true } };
    // Copies and a slower motion need room; a key that is only moved stays in the clip.
    const keys =
      (press.retime || copy ? clip?.keys : undefined)?.filter((k) => frames.includes(k.frame)) ?? [];
    const there = (f: number): number => (press.retime ? Math.round(pivot + (f - pivot) * factor) : f + df);
    const ends = endsOf(keys, there);
    const done = !still && (await sheet.edit(op, ends));
    // By now another one may have begun.
    if (!this.press) sheet.preview(new Map(), undefined);
    if (!done) return sheet.follow();
    sheet.overwrote(lost);
    if (this.press) return;
    // The playhead stays on the key that it was on, and so do the sliders.
    const along = to.get(sheet.playhead());
    if (along !== undefined && !copy) sheet.setPlayhead(along);
    sheet.setSelection(new Set(frames.map((f) => to.get(f) ?? f)));
  }

  private cancel(): void {
    const { press, sheet } = this;
    this.press = undefined;
    if (press) sheet.setSelection(press.base);
    if ((press?.kind === "keys" || press?.kind === "offset") && press.moved) sheet.follow();
    sheet.previewOffset(undefined);
    sheet.carry(undefined);
    sheet.previewEnd(undefined);
    sheet.preview(new Map(), undefined);
    sheet.hint("");
  }

  private double(e: MouseEvent): void {
    const { x, y } = this.at(e);
    const key = hit(this.sheet, x, y);
    if (key !== undefined) this.sheet.openKey(key);
  }

  private context(e: MouseEvent): void {
    e.preventDefault();
    const { x, y } = this.at(e);
    const key = hit(this.sheet, x, y);
    const rows = this.sheet.rows();
    const row = rows[yToRow(this.sheet.view(), y, rows.length) ?? -1];
    if (row?.kind === "joint") this.sheet.setJoint(row.joint);
    const marker = x >= LABELS ? markerAt(this.sheet, x, y) : undefined;
    if (marker !== undefined) return this.sheet.menu({ kind: "marker", frame: marker }, e.clientX, e.clientY);
    const block = blockUnder(this.sheet, x, y);
    if (block) return this.sheet.menu({ kind: "block", frame: block.frame }, e.clientX, e.clientY);
    const offset = offsetUnder(this.sheet, x, y);
    if (offset !== undefined) return this.sheet.menu({ kind: "offset", frame: offset }, e.clientX, e.clientY);
    if (key === undefined) {
      if (y < RULER + MARKERS || y > this.sheet.box().height - STRIP) return;
      if (x >= LABELS && xToFrame(this.sheet.view(), x) < -0.5)
        return this.sheet.menu({ kind: "past" }, e.clientX, e.clientY);
      if (x >= LABELS) this.scrub(x);
      return this.sheet.menu({ kind: "frames" }, e.clientX, e.clientY);
    }
    if (!this.sheet.selection().has(key)) this.sheet.setSelection(new Set([key]));
    this.sheet.menu({ kind: "key", frame: key }, e.clientX, e.clientY);
  }

  private wheel(e: WheelEvent): void {
    e.preventDefault();
    const { sheet } = this;
    const v = sheet.view();
    const { x } = this.at(e);
    const scroll = e.altKey || (x < LABELS && !e.ctrlKey);
    if (e.shiftKey) return sheet.setView({ ...v, left: v.left + (e.deltaY + e.deltaX) / v.zoom });
    if (scroll) {
      const height = sheet.rows().length * ROW;
      const room = sheet.box().height - RULER - MARKERS - STRIP;
      return sheet.setView({ ...v, top: Math.max(0, Math.min(v.top + e.deltaY, height - room)) });
    }
    if (Math.abs(e.deltaX) > Math.abs(e.deltaY))
      return sheet.setView({ ...v, left: v.left + e.deltaX / v.zoom });
    const step = e.ctrlKey ? 0.0006 : 0.0018;
    sheet.setView(zoomAt(v, x, Math.exp(-e.deltaY * step)));
  }
}
