// Commanded against achieved, by joint, and the error over time. Colour is the joint, pattern the
// kind: crosses are commanded, the line is achieved, dashes are takes compared with.

import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { isOf, keyEnd, values } from "./clip";
import { addedAt, isDense } from "./layers";
import { digitsOf, fixed } from "./numbers";
import * as store from "./store";
import { colors, hue, palette, takeColor } from "./theme";

/** Goals of one joint by frame; null where masked. Fills between keys are left to the line. */
function goals(joint: number): (number | null)[] {
  const clip = store.doc.value?.clip;
  if (!clip) return [];
  const row: (number | null)[] = new Array(clip.length).fill(null);
  const keys = clip.keys.filter((key) => isOf(clip, key, joint));
  for (const [i, key] of keys.entries()) {
    const own = values(clip, key)[joint];
    if (typeof own !== "number") continue;
    const end = Math.min(keyEnd(key), keys[i + 1]?.frame ?? clip.length);
    row.fill(own + addedAt(clip, joint, key.frame), key.frame, end);
  }
  for (const m of clip.masks ?? []) {
    if (m.joints && !m.joints.includes(clip.robot.joints[joint] ?? "")) continue;
    for (let f = m.from; f < Math.min(m.to, clip.length); f++) row[f] = null;
  }
  return row;
}

function column(q: number[][], joint: number, length: number): (number | null)[] {
  return Array.from({ length }, (_, f) => q[f]?.[joint] ?? null);
}

/** Keys that are nearer to one another than this have no cross each, pixels. */
const CROWDED = 6;

/** A cross where a key commands the joint, however short; a line as long as it is held. Of very many keys, as a
 * recording has them, crosses are drawn where there is room for them. */
function crosses(u: uPlot, joint: number, color: string, turn: number): void {
  const d = store.doc.value;
  if (!d) return;
  const goal = goals(joint);
  const { ctx } = u;
  const r = 3.5 * devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left - r, u.bbox.top - r, u.bbox.width + 2 * r, u.bbox.height + 2 * r);
  ctx.clip();
  ctx.strokeStyle = color;
  ctx.lineWidth = 1.6 * devicePixelRatio;
  ctx.beginPath();
  const apart = u.bbox.width / Math.max(1, d.clip.keys.length);
  const dense = isDense(d.clip) || apart < CROWDED * devicePixelRatio;
  let before = -Infinity;
  for (const key of d.clip.keys) {
    const v = goal[key.frame];
    if (v === null || v === undefined || !isOf(d.clip, key, joint)) continue;
    const y = u.valToPos(v * turn, "y", true);
    const x = u.valToPos(key.frame / d.clip.fps, "x", true);
    if (dense && x - before < 4 * r) continue;
    before = x;
    ctx.moveTo(x - r, y - r);
    ctx.lineTo(x + r, y + r);
    ctx.moveTo(x + r, y - r);
    ctx.lineTo(x - r, y + r);
    let last = key.frame;
    while (last + 1 < keyEnd(key) && goal[last + 1] === v) last++;
    if (last > key.frame) {
      ctx.moveTo(x, y);
      ctx.lineTo(u.valToPos(last / d.clip.fps, "x", true), y);
    }
  }
  ctx.stroke();
  ctx.restore();
}

/** A stem and a dot where a goal stands alone: between masked frames there is no line to see. */
function stems(u: uPlot): void {
  const { ctx } = u;
  const floor = u.valToPos(0, "y", true);
  ctx.save();
  u.series.slice(1).forEach((series, i) => {
    const row = u.data[i + 1] ?? [];
    ctx.fillStyle = ctx.strokeStyle = String(
      typeof series.stroke === "function" ? series.stroke(u, i + 1) : series.stroke,
    );
    ctx.lineWidth = 1.4 * devicePixelRatio;
    // As the legend has it: dashes are takes.
    ctx.setLineDash(i === 0 ? [] : [5 * devicePixelRatio, 4 * devicePixelRatio]);
    row.forEach((v, f) => {
      if (typeof v !== "number" || typeof row[f - 1] === "number" || typeof row[f + 1] === "number") return;
      const [x, y] = [u.valToPos(u.data[0][f] ?? 0, "x", true), u.valToPos(v, "y", true)];
      ctx.beginPath();
      ctx.moveTo(x, floor);
      ctx.lineTo(x, y);
      ctx.stroke();
      ctx.beginPath();
      ctx.arc(x, y, 2.5 * devicePixelRatio, 0, 2 * Math.PI);
      ctx.fill();
    });
  });
  ctx.restore();
}

/** The takes that are drawn beside, each with its colour. */
function compared(): { id: number; name: string; color: string }[] {
  return store.compared.value.map((id, i) => ({
    id,
    name: store.takes.value.find((t) => t.id === id)?.name ?? `take ${id}`,
    color: takeColor(i),
  }));
}

/** What an error of 1 rad or 1 m is in the unit that is shown. */
function errorScale(): number {
  return store.unit.value === "m" ? 1000 : store.degrees.value ? 180 / Math.PI : 1;
}

/** An error that fills the chart at least, rad or m: what is smaller than anybody sees is no mountain. */
const LEAST = 0.0007;

export function Curves() {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const parent = host.current;
    if (!parent) return;
    let plots: uPlot[] = [];
    let shape = "";
    const build = (): void => {
      plots.forEach((p) => p.destroy());
      const c = colors();
      const width = Math.max(200, parent.clientWidth - 4);
      // Both charts in sight: what the panel has, less titles and legend.
      const room = Math.max(120, parent.clientHeight - 44);
      const axis = {
        stroke: c.dim,
        grid: { stroke: c.faint, width: 1 },
        ticks: { stroke: c.rule },
        font: `11px ${c.font}`,
      };
      const cursor = {
        sync: { key: "curves" },
        drag: { x: false, y: false },
        bind: {
          mousedown: (u: uPlot) => () => {
            const f = u.cursor.idx;
            if (typeof f === "number") {
              store.playing.value = false;
              store.playhead.value = f;
            }
            return null;
          },
        },
      };
      const line = {
        hooks: {
          draw: [
            (u: uPlot) => {
              const x = u.valToPos(store.playhead.value / store.fps.value, "x", true);
              u.ctx.strokeStyle = c.playhead;
              u.ctx.beginPath();
              u.ctx.moveTo(x, u.bbox.top);
              u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
              u.ctx.stroke();
            },
          ],
        },
      };
      const joint = store.joint.value ?? 0;
      const color = hue(joint);
      // The legend's, too, in every theme.
      parent.parentElement?.style.setProperty("--ink", color);
      const unit = store.doc.value?.table.joints[joint]?.unit ?? "rad";
      const deg = unit === "rad" && store.degrees.value;
      const axisUnit = unit === "m" ? "m" : deg ? "deg" : "rad";
      const title = store.titles.value[joint] ?? "";
      const turned = deg ? 180 / Math.PI : 1;
      // As many digits as tell one tick from the next; ticks near enough that there are two.
      const ticksOf = (_: uPlot, at: number[]): string[] => {
        const digits = digitsOf((at[1] ?? 1) - (at[0] ?? 0));
        return at.map((v) => fixed(v, digits));
      };
      // As wide as its longest number.
      const wide = (_: uPlot, ticks: string[] | null): number =>
        18 + 6.4 * Math.max(3, ...(ticks ?? []).map((v) => v.length));
      const upright = { ...axis, size: wide, space: 18, values: ticksOf };
      /** What is smaller than anybody sees is no mountain. */
      const atLeast =
        (least: number) =>
        (_: uPlot, lo: number | null, hi: number | null): [number, number] => {
          const [a, b] = [lo ?? 0, hi ?? 0];
          const room = Math.max(0.06 * (b - a), (least - (b - a)) / 2);
          return [a - room, b + room];
        };
      // Room for "100.5 s" beside its neighbour.
      const across = {
        ...axis,
        size: 26,
        gap: 3,
        space: 58,
        ticks: { ...axis.ticks, size: 5 },
        values: (_: uPlot, at: number[]) => at.map((v) => `${v} s`),
      };
      const common = {
        width,
        legend: { show: false },
        cursor: cursor as unknown as uPlot.Cursor,
        padding: [6, 20, 0, 0] as [number, number, number, number],
      };
      const others = compared().map((t) => ({ label: t.name, stroke: t.color, width: 1.4, dash: [5, 4] }));
      plots = [
        new uPlot(
          {
            ...common,
            height: Math.round(room * 0.58),
            title: `${title}, ${axisUnit}`,
            plugins: [
              line as unknown as uPlot.Plugin,
              { hooks: { draw: (u) => crosses(u, joint, color, turned) } },
            ],
            scales: { x: { time: false }, y: { range: atLeast(unit === "m" ? 0.004 : deg ? 0.4 : 0.007) } },
            axes: [across, upright],
            series: [
              {},
              // Drawn by `crosses`; here for the scale.
              { label: "commanded", stroke: color, paths: () => null, points: { show: false } },
              { label: "achieved", stroke: color, width: 1.6 },
              ...others,
            ],
          },
          [[0], [null], [null], ...others.map(() => [null])],
          parent,
        ),
        new uPlot(
          {
            ...common,
            height: Math.round(room * 0.42),
            title: `mean error, ${store.unit.value === "m" ? "mm" : store.degrees.value ? "deg" : "rad"}`,
            plugins: [line as unknown as uPlot.Plugin, { hooks: { draw: stems } }],
            scales: {
              x: { time: false },
              y: {
                range: (_, __, hi) => [0, Math.max(1.06 * (hi ?? 0), LEAST * errorScale())],
              },
            },
            axes: [across, upright],
            series: [{}, { label: "error", stroke: c.error, width: 1.4, fill: `${c.error}33` }, ...others],
          },
          [[0], [null], ...others.map(() => [null])],
          parent,
        ),
      ];
    };
    let queued = false;
    const update = (): void => {
      queued = false;
      const d = store.doc.value;
      if (!d) return;
      const joint = store.joint.value ?? 0;
      const now = `${parent.clientWidth}:${parent.clientHeight}:${colors().back}:${JSON.stringify(compared())}:${joint}:${store.degrees.value}:${d.clip.robot.id}`;
      if (now !== shape) {
        shape = now;
        build();
      }
      const n = d.clip.length;
      const xs = Array.from({ length: n }, (_, f) => f / d.clip.fps);
      const others = compared().map((t) => store.takeFrames.value.get(t.id) ?? { q: [], error: [] });
      const scale = errorScale();
      const errors = (e: (number | null)[]): (number | null)[] =>
        xs.map((_, f) => (e[f] === null || e[f] === undefined ? null : e[f] * scale));
      // In the unit that is read, so that ticks stand at round numbers.
      const turn = d.table.joints[joint]?.unit === "rad" && store.degrees.value ? 180 / Math.PI : 1;
      const turned = (column: (number | null)[]): (number | null)[] =>
        column.map((v) => (v === null ? null : v * turn));
      plots[0]?.setData([
        xs,
        turned(goals(joint)),
        turned(column(store.frames.value.q, joint, n)),
        ...others.map((o) => turned(column(o.q, joint, n))),
      ]);
      plots[1]?.setData([xs, errors(store.frames.value.error), ...others.map((o) => errors(o.error))]);
    };
    const observer = new ResizeObserver(() => ask());
    const ask = (): void => {
      if (!queued) {
        queued = true;
        requestAnimationFrame(update);
      }
    };
    observer.observe(parent);
    const dispose = effect(() => {
      void [
        store.doc.value,
        store.frames.value,
        store.joint.value,
        store.degrees.value,
        store.compared.value,
        store.takes.value,
        store.takeFrames.value,
        store.playhead.value,
        palette.value,
      ];
      ask();
    });
    return () => {
      dispose();
      observer.disconnect();
      plots.forEach((p) => p.destroy());
    };
  }, []);
  // Shape says the kind, as in the chart: a cross, a line, dashes.
  return (
    <section class="curves" aria-label="Curves" data-testid="curves">
      <div ref={host} class="plots" />
      <ul class="curve-legend" aria-label="Legend">
        <li>
          <svg width="12" height="12" viewBox="0 0 12 12" aria-hidden="true">
            <path d="M2 2l8 8M10 2l-8 8" stroke="var(--ink)" stroke-width="1.8" />
          </svg>
          commanded
        </li>
        <li>
          <svg width="20" height="12" viewBox="0 0 20 12" aria-hidden="true">
            <path d="M0 6h20" stroke="var(--ink)" stroke-width="2" />
          </svg>
          achieved
        </li>
        {compared().map((t) => (
          <li key={t.id}>
            <svg width="20" height="12" viewBox="0 0 20 12" aria-hidden="true">
              <path d="M0 6h20" stroke={t.color} stroke-width="1.5" stroke-dasharray="5 4" />
            </svg>
            {t.name}
          </li>
        ))}
      </ul>
    </section>
  );
}
