// Pointer gestures of the graph. A gesture previews, and sends one edit when it ends; Esc cancels.

import type { Clip } from "../clip";
import { hold } from "../hand";
import { frameToX, LABELS, RULER, xToFrame, zoomAt } from "../timeline/layout";
import { type Handle, handles, slopeAt, type Top, tops, under as underOf } from "./handles";
import {
  type Changes,
  nameOf,
  type Point,
  perPixel,
  pointAt,
  points,
  raised,
  type Space,
  valueToY,
  yToSeen,
} from "./space";

export interface Sheet {
  clip(): Clip | undefined;
  space(): Space;
  joints(): number[];
  selection(): ReadonlySet<string>;
  select(points: ReadonlySet<string>): void;
  setView(view: Space["view"]): void;
  setSpan(span: Space["span"]): void;
  seek(frame: number): void;
  choose(joint: number): void;
  /** As a drag would leave it; without arguments as it is. */
  preview(changes?: Changes, to?: ReadonlyMap<number, number>): void;
  box(box: { x0: number; y0: number; x1: number; y1: number } | undefined): void;
  drop(changes: Changes, frames: number[], df: number): void;
  addKey(frame: number, joint: number, y: number): void;
  openKey(frame: number): void;
  menu(frame: number | undefined, x: number, y: number): void;
  hint(text: string): void;
  /** A tangent's slope, units a frame, as a drag would leave it; with `done` as one edit. */
  bend(handle: Handle, slope: number, both: boolean, done: boolean): unknown;
  /** How far an offset is raised, and the number of frames by which it is moved. */
  lift(top: Top, by: number, df: number, done: boolean): unknown;
  chooseOffset(frame: number): void;
  offsetMenu(frame: number, x: number, y: number): void;
}

interface Press {
  kind: "scrub" | "points" | "box" | "pan" | "tangent" | "offset";
  x: number;
  y: number;
  moved: boolean;
  base: ReadonlySet<string>;
  handle?: Handle | undefined;
  top?: Top | undefined;
}

export class Hands {
  private press: Press | undefined;

  constructor(
    private readonly canvas: HTMLElement,
    private readonly sheet: Sheet,
  ) {}

  /** Listens; the returned function stops listening. */
  attach(): () => void {
    const ends = new AbortController();
    const { signal } = ends;
    const on = <K extends keyof HTMLElementEventMap>(
      type: K,
      handler: (e: HTMLElementEventMap[K]) => void,
    ): void => this.canvas.addEventListener(type, handler, { signal, passive: false });
    on("pointerdown", (e) => this.down(e));
    on("pointermove", (e) => this.move(e));
    on("pointerup", (e) => this.up(e));
    on("pointercancel", () => this.cancel());
    on("pointerleave", () => this.press ?? this.sheet.hint(""));
    on("dblclick", (e) => this.double(e));
    on("contextmenu", (e) => this.context(e));
    on("wheel", (e) => this.wheel(e));
    const keys = (e: KeyboardEvent): void => {
      if (e.key !== "Escape" || !this.press) return;
      e.stopPropagation();
      this.cancel();
    };
    window.addEventListener("keydown", keys, { signal, capture: true });
    return () => ends.abort();
  }

  private at(e: MouseEvent): { x: number; y: number } {
    const r = this.canvas.getBoundingClientRect();
    return { x: e.clientX - r.left, y: e.clientY - r.top };
  }

  private all(): Point[] {
    const clip = this.sheet.clip();
    return clip ? points(clip, this.sheet.joints()) : [];
  }

  private under(x: number, y: number): Point | undefined {
    return pointAt(this.sheet.space(), this.all(), x, y);
  }

  private handle(x: number, y: number): Handle | undefined {
    const { sheet } = this;
    const clip = sheet.clip();
    return clip && underOf(handles(sheet.space(), clip, sheet.joints(), sheet.selection()), x, y);
  }

  private top(x: number, y: number): Top | undefined {
    const clip = this.sheet.clip();
    return clip && underOf(tops(this.sheet.space(), clip, this.sheet.joints()), x, y);
  }

  /** Alt bends one side alone; a corner stays one. */
  private bend(e: PointerEvent, h: Handle, done: boolean): void {
    const { x, y } = this.at(e);
    const slope = e.shiftKey ? 0 : slopeAt(this.sheet.space(), h, x, y);
    void this.sheet.bend(h, slope, h.smooth && !e.altKey, done);
  }

  private lift(e: PointerEvent, press: Press, top: Top, done: boolean): void {
    const space = this.sheet.space();
    const { df, dy } = this.gone(e, press, [top.frame]);
    const by = dy * perPixel(space, top.joint);
    void this.sheet.lift(top, by, df, done);
  }

  private scrub(x: number): void {
    const last = (this.sheet.clip()?.length ?? 1) - 1;
    this.sheet.seek(Math.min(last, Math.max(0, Math.round(xToFrame(this.sheet.space().view, x)))));
  }

  private down(e: PointerEvent): void {
    const { x, y } = this.at(e);
    const { sheet } = this;
    if (x < LABELS || (e.button !== 0 && e.button !== 1)) return;
    this.canvas.setPointerCapture(e.pointerId);
    const begin = (kind: Press["kind"]): void => {
      this.press = { kind, x, y, moved: false, base: sheet.selection() };
      if (kind !== "scrub") hold(() => this.cancel());
    };
    if (e.button === 1) return begin("pan");
    if (y < RULER) {
      begin("scrub");
      return this.scrub(x);
    }
    const handle = this.handle(x, y);
    if (handle) {
      begin("tangent");
      if (this.press) this.press.handle = handle;
      return;
    }
    const top = this.top(x, y);
    if (top) {
      sheet.chooseOffset(top.frame);
      sheet.choose(top.joint);
      begin("offset");
      if (this.press) this.press.top = top;
      return;
    }
    const p = this.under(x, y);
    if (!p) return begin("box");
    sheet.choose(p.joint);
    const name = nameOf(p);
    const now = sheet.selection();
    if (e.ctrlKey || e.metaKey || (e.shiftKey && !now.has(name))) {
      const next = new Set(now);
      if (!next.delete(name)) next.add(name);
      sheet.select(next);
    } else if (!now.has(name)) sheet.select(new Set([name]));
    begin("points");
  }

  /** Frames and pixels that the hand has gone; with Shift along one axis only. */
  private gone(
    e: PointerEvent,
    press: Press,
    frames = this.chosen().map((p) => p.frame),
  ): { df: number; dy: number } {
    const { x, y } = this.at(e);
    const [dx, dy] = [x - press.x, press.y - y];
    const along = e.shiftKey && Math.abs(dx) >= Math.abs(dy);
    const upright = e.shiftKey && !along;
    const df = upright ? 0 : Math.round(dx / this.sheet.space().view.zoom);
    return { df: Math.max(df, -Math.min(...frames)), dy: along ? 0 : dy };
  }

  private chosen(): Point[] {
    const on = this.sheet.selection();
    return this.all().filter((p) => on.has(nameOf(p)));
  }

  private landing(df: number): Map<number, number> {
    return new Map(this.chosen().map((p) => [p.frame, p.frame + df]));
  }

  private move(e: PointerEvent): void {
    const { press, sheet } = this;
    const { x, y } = this.at(e);
    if (!press) {
      const inside = x >= LABELS && y >= RULER;
      const handle = inside ? this.handle(x, y) : undefined;
      const top = inside && !handle ? this.top(x, y) : undefined;
      const over = inside && !handle && !top ? this.under(x, y) : undefined;
      this.canvas.style.cursor = handle || top || over ? "grab" : y < RULER ? "ew-resize" : "default";
      if (handle) return sheet.hint("drag: slope of the curve on both sides, Alt: on this side, Shift: flat");
      if (top) return sheet.hint("drag: what is added to the motion here, and when; Shift: one of them");
      sheet.hint(
        over
          ? "drag: time and value, Shift: one of them. A key is a pose: its time is that of all joints"
          : "drag: select; double-click: a key here; wheel: time, Ctrl+wheel: values",
      );
      return;
    }
    if (!press.moved && Math.hypot(x - press.x, y - press.y) < 3) return;
    press.moved = true;
    if (press.kind === "scrub") return this.scrub(x);
    const space = sheet.space();
    if (press.kind === "pan") {
      const rise = yToSeen(space, y) - yToSeen(space, y - e.movementY);
      sheet.setView({ ...space.view, left: space.view.left - e.movementX / space.view.zoom });
      return sheet.setSpan({ lo: space.span.lo - rise, hi: space.span.hi - rise });
    }
    if (press.kind === "box") {
      const b = {
        x0: Math.min(x, press.x),
        y0: Math.min(y, press.y),
        x1: Math.max(x, press.x),
        y1: Math.max(y, press.y),
      };
      sheet.box(b);
      const inside = this.all().filter((p) => {
        const [px, py] = [frameToX(space.view, p.frame), valueToY(space, p.joint, p.value)];
        return px >= b.x0 && px <= b.x1 && py >= b.y0 && py <= b.y1;
      });
      const add = e.ctrlKey || e.metaKey || e.shiftKey;
      return sheet.select(new Set([...(add ? press.base : []), ...inside.map(nameOf)]));
    }
    if (press.handle) return this.bend(e, press.handle, false);
    if (press.top) return this.lift(e, press, press.top, false);
    const { df, dy } = this.gone(e, press);
    sheet.preview(raised(space, this.chosen(), dy), this.landing(df));
  }

  private up(e: PointerEvent): void {
    const { press, sheet } = this;
    if (!press) return;
    this.press = undefined;
    sheet.box(undefined);
    if (press.kind === "box" && !press.moved) {
      sheet.select(new Set());
      this.scrub(this.at(e).x);
    }
    if (press.handle) return press.moved ? this.bend(e, press.handle, true) : undefined;
    if (press.top) return press.moved ? this.lift(e, press, press.top, true) : sheet.seek(press.top.frame);
    if (press.kind !== "points") return;
    if (!press.moved) {
      const p = this.under(press.x, press.y);
      if (p && !(e.ctrlKey || e.metaKey || e.shiftKey)) sheet.select(new Set([nameOf(p)]));
      if (p) sheet.seek(p.frame);
      return;
    }
    const { df, dy } = this.gone(e, press);
    const changes: Changes = dy === 0 ? new Map() : raised(sheet.space(), this.chosen(), dy);
    sheet.drop(
      changes,
      [...new Set(this.chosen().map((p) => p.frame))].sort((a, b) => a - b),
      df,
    );
  }

  private cancel(): void {
    const { press, sheet } = this;
    this.press = undefined;
    if (!press) return;
    sheet.select(press.base);
    sheet.box(undefined);
    sheet.preview();
  }

  private double(e: MouseEvent): void {
    const { x, y } = this.at(e);
    if (x < LABELS || y < RULER) return;
    const p = this.under(x, y);
    if (p) return this.sheet.openKey(p.frame);
    const [first] = this.sheet.joints();
    if (first !== undefined) this.sheet.addKey(Math.round(xToFrame(this.sheet.space().view, x)), first, y);
  }

  private context(e: MouseEvent): void {
    e.preventDefault();
    const { x, y } = this.at(e);
    if (x < LABELS || y < RULER) return;
    const top = this.top(x, y);
    if (top) return this.sheet.offsetMenu(top.frame, e.clientX, e.clientY);
    const p = this.under(x, y);
    if (p && !this.sheet.selection().has(nameOf(p))) this.sheet.select(new Set([nameOf(p)]));
    if (!p) this.scrub(x);
    this.sheet.menu(p?.frame, e.clientX, e.clientY);
  }

  private wheel(e: WheelEvent): void {
    e.preventDefault();
    const { sheet } = this;
    const space = sheet.space();
    const { x, y } = this.at(e);
    if (e.ctrlKey || e.altKey) {
      const [at, k] = [yToSeen(space, y), Math.exp(e.deltaY * (e.ctrlKey ? 0.0012 : 0))];
      const shift = e.altKey ? ((space.span.hi - space.span.lo) * e.deltaY) / 600 : 0;
      return sheet.setSpan({
        lo: at + (space.span.lo - at) * k - shift,
        hi: at + (space.span.hi - at) * k - shift,
      });
    }
    if (e.shiftKey) {
      const { view } = space;
      return sheet.setView({ ...view, left: view.left + (e.deltaY + e.deltaX) / view.zoom });
    }
    sheet.setView(zoomAt(space.view, x, Math.exp(-e.deltaY * 0.0018)));
  }
}
