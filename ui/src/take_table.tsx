// Takes side by side: error, worst joint, roughness. The best of each column is marked; only takes
// of the same goals compare.

import { useSignal } from "@preact/signals";
import { Circle, CircleDot, Diamond, Pin } from "lucide";
import { Icon } from "./icon";
import { labelInWords } from "./policy_words";
import type { TakeCard } from "./protocol";
import * as store from "./store";
import { takeOfNow, toggleCompared } from "./takes";
import { takeColor } from "./theme";
import { tell } from "./wire";

type Column = "mae" | "worst" | "jerk";

const COLUMNS: [Column, string, string][] = [
  ["mae", "Error", "Mean absolute error over all goals"],
  ["worst", "Worst joint", "The joint with the largest mean error, and that error"],
  ["jerk", "Jerk", "Roughness: root mean square of the third derivative over all joints; smoother is lower"],
];

/** In the order of a column, what cannot be compared last. Pure. */
export function ranked(takes: TakeCard[], by: Column): TakeCard[] {
  const place = (t: TakeCard): number => (t.same_goals ? (t[by] ?? Infinity) : Infinity);
  return [...takes].sort((a, b) => Number(b.same_goals) - Number(a.same_goals) || place(a) - place(b));
}

function shownJerk(value: number): string {
  const inner = store.unit.value === "rad" && store.degrees.value ? (value * 180) / Math.PI : value;
  return inner >= 1000
    ? `${(inner / 1000).toFixed(1)}k`
    : inner >= 10
      ? inner.toFixed(0)
      : inner.toPrecision(2);
}

const jerkUnit = (): string => (store.unit.value === "m" ? "m/s³" : store.degrees.value ? "°/s³" : "rad/s³");

export function TakeTable() {
  const by = useSignal<Column>("mae");
  const takes = ranked(store.takes.value, by.value);
  const now = takeOfNow()?.id;
  const alike = takes.filter((t) => t.same_goals);
  const best = (c: Column): number =>
    Math.min(...alike.flatMap((t) => (t[c] === null ? [] : [t[c] as number])));
  const wanted = new Set([now, alike[0]?.id, ...store.compared.value]);
  const others = takes.filter((t) => !t.pinned && !wanted.has(t.id));
  const title = (joint: string | null): string => {
    const at = store.doc.value?.clip.robot.joints.indexOf(joint ?? "") ?? -1;
    return store.titles.value[at] ?? joint ?? "";
  };
  return (
    <section class="take-table" aria-label="Compare takes" data-testid="take-table">
      <div class="scroll">
        <table>
          <thead>
            <tr>
              <th scope="col">Take</th>
              {COLUMNS.map(([c, name, about]) => (
                <th key={c} scope="col" aria-sort={by.value === c ? "ascending" : "none"}>
                  <button
                    class={`quiet small ${by.value === c ? "on" : ""}`}
                    title={`${about}. Click to sort by it`}
                    onClick={() => (by.value = c)}
                  >
                    {name}
                    {c === "jerk" ? <small>{jerkUnit()}</small> : null}
                  </button>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {takes.map((t) => {
              const on = store.compared.value.indexOf(t.id);
              const cell = (c: Column, text: string, value: number | null) => (
                <td class={`num ${t.same_goals && value !== null && value === best(c) ? "best" : ""}`}>
                  {text}
                </td>
              );
              return (
                <tr
                  key={t.id}
                  class={`${t.id === now ? "now" : ""} ${t.same_goals ? "" : "stale"}`}
                  title={t.same_goals ? "" : "Measured against other goals: it does not compare"}
                  data-testid={`row-${t.id}`}
                >
                  <th scope="row">
                    <button
                      class="quiet"
                      aria-pressed={on >= 0}
                      title="Draw it beside the current take; Ctrl adds it to those that are drawn"
                      onClick={(e) => toggleCompared(t.id, e.ctrlKey || e.metaKey || e.shiftKey)}
                    >
                      <span class="mark" style={on >= 0 ? `color: ${takeColor(on)}` : ""}>
                        <Icon of={t.id === now ? CircleDot : on >= 0 ? Diamond : Circle} size={12} />
                      </span>
                      <span class="of-take">
                        {t.name}
                        <small title={t.policy}>{labelInWords(t.policy)}</small>
                      </span>
                      {t.pinned ? <Icon of={Pin} size={11} /> : null}
                    </button>
                  </th>
                  {cell("mae", t.mae === null ? "" : store.shownError(t.mae, store.unit.value), t.mae)}
                  <td
                    class={`num ${t.same_goals && t.worst !== null && t.worst === best("worst") ? "best" : ""}`}
                  >
                    {t.worst === null ? "" : store.shownError(t.worst, store.unit.value)}
                    <small>{title(t.worst_joint)}</small>
                  </td>
                  {cell("jerk", t.jerk === null ? "" : shownJerk(t.jerk), t.jerk)}
                </tr>
              );
            })}
          </tbody>
        </table>
      </div>
      <div class="tools-row">
        <button
          disabled={others.length === 0}
          title="Remove the takes that are neither pinned, nor current, nor compared, nor the best"
          onClick={() => others.forEach((t) => tell("take.remove", { id: t.id }))}
        >
          Remove the others ({others.length})
        </button>
      </div>
    </section>
  );
}
