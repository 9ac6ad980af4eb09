// Commanded against achieved, by joint, and the error over time. Colour is the joint, pattern the
// kind: crosses are commanded, the line is achieved, dashes are the take compared with.

import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { keyEnd, values } from "./clip";
import * as store from "./store";
import { SERIES, colors } from "./theme";

/** Goals of one joint by frame; null where masked. Fills between keys are left to the line. */
function goals(joint: number): (number | null)[] {
  const clip = store.doc.value?.clip;
  if (!clip) return [];
  const row: (number | null)[] = new Array(clip.length).fill(null);
  for (const key of clip.keys) {
    const v = values(clip, key)[joint];
    if (v === null || v === undefined) continue;
    for (let f = key.frame; f < Math.min(keyEnd(key), clip.length); f++) row[f] = v;
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
      const room = Math.max(120, parent.clientHeight - 66);
      const axis = { stroke: c.dim, grid: { stroke: c.faint, width: 1 }, ticks: { stroke: c.rule }, font: "11px system-ui" };
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
      const line = { hooks: { draw: [(u: uPlot) => {
        const x = u.valToPos(store.playhead.value / store.fps.value, "x", true);
        u.ctx.strokeStyle = c.playhead;
        u.ctx.beginPath();
        u.ctx.moveTo(x, u.bbox.top);
        u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
        u.ctx.stroke();
      }] } };
      const joint = store.joint.value ?? 0;
      const color = SERIES[joint % SERIES.length] ?? "#56b4e9";
      const unit = store.doc.value?.table.joints[joint]?.unit ?? "rad";
      const deg = unit === "rad" && store.degrees.value;
      const axisUnit = unit === "m" ? "m" : deg ? "deg" : "rad";
      const title = store.titles.value[joint] ?? "";
      const fmt = (v: number | null): string => (v === null || v === undefined ? "–" : v.toFixed(deg ? 1 : 3));
      // As many digits as tell one tick from the next; ticks near enough that there are two.
      const ticksOf = (_: uPlot, at: number[]): string[] => {
        const step = Math.abs((at[1] ?? 1) - (at[0] ?? 0));
        return at.map((v) => v.toFixed(Math.min(6, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)))));
      };
      const upright = { ...axis, size: 48, space: 22, values: ticksOf };
      const common = { width, legend: { live: false }, cursor: cursor as unknown as uPlot.Cursor, padding: [6, 8, 0, 0] as [number, number, number, number] };
      plots = [
        new uPlot({
          ...common, height: Math.round(room * 0.58), title: `${title}, ${axisUnit}`, plugins: [line as unknown as uPlot.Plugin],
          scales: { x: { time: false } },
          axes: [{ ...axis, values: (_, at) => at.map((v) => `${v} s`) }, upright],
          series: [{}, 
            { label: "commanded", stroke: color, paths: () => null, points: { show: true, size: 6, stroke: color, fill: c.panel }, value: (_, v) => fmt(v) },
            { label: "achieved", stroke: color, width: 1.6, value: (_, v) => fmt(v) },
            { label: "compared", stroke: c.dim, width: 1.2, dash: [5, 4], value: (_, v) => fmt(v), show: store.compared.value !== undefined }],
        }, [[0], [null], [null], [null]], parent),
        new uPlot({
          ...common, height: Math.round(room * 0.42), legend: { show: false }, title: `mean error, ${store.unit.value === "m" ? "mm" : "deg"}`, plugins: [line as unknown as uPlot.Plugin],
          scales: { x: { time: false } },
          axes: [{ ...axis, values: (_, at) => at.map((v) => `${v} s`) }, upright],
          series: [{}, { label: "error", stroke: c.error, width: 1.4, fill: c.error + "33" }, { label: "compared", stroke: c.dim, width: 1.2, dash: [5, 4] }],
        }, [[0], [null], [null]], parent),
      ];
    };
    let queued = false;
    const update = (): void => {
      queued = false;
      const d = store.doc.value;
      if (!d) return;
      const joint = store.joint.value ?? 0;
      const now = `${parent.clientWidth}:${parent.clientHeight}:${colors().back}:${store.compared.value}:${joint}:${store.degrees.value}:${d.clip.robot.id}`;
      if (now !== shape) {
        shape = now;
        build();
      }
      const n = d.clip.length;
      const xs = Array.from({ length: n }, (_, f) => f / d.clip.fps);
      const other = store.takes.value.find((t) => t.id === store.compared.value);
      const scale = store.unit.value === "m" ? 1000 : 180 / Math.PI;
      const errors = (e: (number | null)[]): (number | null)[] => xs.map((_, f) => (e[f] === null || e[f] === undefined ? null : e[f] * scale));
      // In the unit that is read, so that ticks stand at round numbers.
      const turn = d.table.joints[joint]?.unit === "rad" && store.degrees.value ? 180 / Math.PI : 1;
      const turned = (column: (number | null)[]): (number | null)[] => column.map((v) => (v === null ? null : v * turn));
      const rest = other ? turned(column(other.frames.q, joint, n)) : xs.map(() => null);
      plots[0]?.setData([xs, turned(goals(joint)), turned(column(store.frames.value.q, joint, n)), rest]);
      plots[1]?.setData([xs, errors(store.frames.value.error), other ? errors(other.frames.error) : xs.map(() => null)]);
    };
    const observer = new ResizeObserver(() => ask());
    const ask = (): void => {
      if (!queued) {
        queued = true;
        requestAnimationFrame(update);
      }
    };
    observer.observe(parent);
    const scheme = matchMedia("(prefers-color-scheme: light)");
    scheme.addEventListener("change", ask);
    document.addEventListener("robert-theme", ask);
    const dispose = effect(() => {
      void [store.doc.value, store.frames.value, store.joint.value, store.degrees.value, store.compared.value, store.takes.value, store.playhead.value];
      ask();
    });
    return () => {
      dispose();
      scheme.removeEventListener("change", ask);
      document.removeEventListener("robert-theme", ask);
      observer.disconnect();
      plots.forEach((p) => p.destroy());
    };
  }, []);
  return <section class="curves" ref={host} aria-label="Curves" data-testid="curves" />;
}
