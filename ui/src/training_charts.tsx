// Curves of a job while it goes on, and of a run on disk.

import { effect, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import type { JobKind, Json } from "./protocol";
import * as store from "./store";
import { colors, hue } from "./theme";
import { complain, http } from "./wire";

/** Curves out of `figures` events: what rises and falls with `step`. */
function series(
  kind: JobKind,
  points: Record<string, Json>[],
): { title: string; names: string[]; x: number[]; ys: (number | null)[][] }[] {
  const number = (v: Json | undefined): number | null =>
    typeof v === "number" && Number.isFinite(v) ? v : null;
  const chart = (title: string, of: [string, (p: Record<string, Json>) => number | null][]) => {
    const rows = points.filter((p) => of.some(([, get]) => get(p) !== null));
    rows.sort((a, b) => (number(a.step) ?? 0) - (number(b.step) ?? 0));
    return {
      title,
      names: of.map(([n]) => n),
      x: rows.map((p) => number(p.step) ?? 0),
      ys: of.map(([, get]) => rows.map(get)),
    };
  };
  if (kind === "train") {
    const inside = (p: Record<string, Json>, outer: string, key: string): number | null =>
      number((p[outer] as Record<string, Json> | undefined)?.[key]);
    return [
      chart("loss", [["loss", (p) => number(p.loss)]]),
      chart("action error", [
        ["visible", (p) => number(p.action_rms_visible)],
        ["masked", (p) => number(p.action_rms_masked)],
      ]),
      chart("Precision", [["rollout", (p) => inside(p, "evaluation", "precision")]]),
    ].filter((c) => c.x.length > 0);
  }
  const agents = [...new Set(points.map((p) => String(p.agent ?? "")))].filter(Boolean);
  return ["coverage", "reward"]
    .map((what) =>
      chart(
        what,
        agents.map((a) => [a, (p) => (p.agent === a ? number(p[what]) : null)]),
      ),
    )
    .filter((c) => c.x.length > 0);
}

/** The figures of a job so far. */
export function figures(id: number): Record<string, Json>[] | undefined {
  return store.jobs.value
    .get(id)
    ?.lines.flatMap((l) => (l.event === "figures" && l.figures ? [l.figures] : []));
}

/** The curves of a run on disk, as its own metrics have them. */
export function RunCurves({ path }: { path: string }) {
  const points = useSignal<Record<string, Json>[] | undefined>(undefined);
  useEffect(
    () => void http("GET /api/curves", { query: { path } }).then((p) => (points.value = p), complain),
    [path],
  );
  if (!points.value) return <p class="about">reading…</p>;
  if (points.value.length === 0) return <p class="about">there are no measurements yet</p>;
  return <Charts kind="train" points={() => points.value} />;
}

export function Charts({
  kind,
  points,
}: {
  kind: JobKind;
  points: () => Record<string, Json>[] | undefined;
}) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    let plots: uPlot[] = [];
    let shape = "";
    const dispose = effect(() => {
      const seen = points();
      const parent = host.current;
      if (!seen || !parent) return;
      const charts = series(kind, seen);
      const now = JSON.stringify(charts.map((c) => [c.title, c.names]));
      if (now !== shape) {
        shape = now;
        plots.forEach((p) => p.destroy());
        const c = colors();
        const axis = {
          stroke: c.dim,
          grid: { stroke: c.faint, width: 1 },
          ticks: { stroke: c.rule },
          font: `11px ${colors().font}`,
        };
        plots = charts.map(
          (chart) =>
            new uPlot(
              {
                width: 320,
                height: 150,
                title: chart.title,
                legend: { live: false, show: chart.names.length > 1 },
                scales: { x: { time: false } },
                axes: [
                  { ...axis, values: (_, at) => at.map((v) => (v >= 1000 ? `${v / 1000}k` : `${v}`)) },
                  { ...axis, size: 52 },
                ],
                series: [
                  {},
                  ...chart.names.map((label, i) => ({
                    label,
                    stroke: hue(i),
                    width: 1.5,
                    spanGaps: true,
                    points: { show: chart.x.length < 30, size: 4 },
                  })),
                ],
              },
              [chart.x, ...chart.ys] as uPlot.AlignedData,
              parent,
            ),
        );
      }
      charts.forEach((chart, i) => plots[i]?.setData([chart.x, ...chart.ys] as uPlot.AlignedData));
    });
    return () => {
      dispose();
      plots.forEach((p) => p.destroy());
    };
  }, []);
  return <div class="job-curves" ref={host} />;
}
