// Jobs and the runs that they leave, each with what can be done with it.

import { useSignal } from "@preact/signals";
import { Line, shellWord } from "./command_line";
import { opening } from "./documents";
import { JobBar, minutes } from "./job_bar";
import { isRunning, resumeJob, startJob } from "./jobs";
import { withRun } from "./policy";
import type { JobView, RunCard } from "./protocol";
import * as store from "./store";
import { resumeArgs } from "./training";
import { Charts, figures, RunCurves } from "./training_charts";
import { complain, http, tell } from "./wire";

interface EvalResult {
  unit: string;
  results: {
    policy: string;
    suite: string;
    precision_mean: number | null;
    tasks: { name: string; precision: number | null }[];
  }[];
}

/** The table of an evaluation: tasks as rows, policies as columns. */
function Table({ job }: { job: JobView }) {
  const found = job.lines.find((l) => l.event === "result")?.result as EvalResult | undefined;
  if (!found?.results) return null;
  const suites = [...new Set(found.results.map((r) => r.suite))];
  const text = (v: number | null | undefined): string =>
    v === null || v === undefined
      ? "failed"
      : found.unit === "rad" || found.unit === "m"
        ? store.shownError(v, found.unit)
        : v.toPrecision(3);
  return (
    <>
      {suites.map((suite) => {
        const columns = found.results.filter((r) => r.suite === suite);
        return (
          <table key={suite} class="result" data-testid="eval-table">
            <caption>{suite}: mean error, lower is better</caption>
            <thead>
              <tr>
                <th>task</th>
                {columns.map((c) => (
                  <th key={c.policy}>{c.policy}</th>
                ))}
              </tr>
            </thead>
            <tbody>
              {(columns[0]?.tasks ?? []).map((t, i) => (
                <tr key={t.name}>
                  <td>{t.name}</td>
                  {columns.map((c) => (
                    <td key={c.policy} class="num">
                      {text(c.tasks[i]?.precision)}
                    </td>
                  ))}
                </tr>
              ))}
              <tr class="mean">
                <td>mean</td>
                {columns.map((c) => (
                  <td key={c.policy} class="num">
                    {text(c.precision_mean)}
                  </td>
                ))}
              </tr>
            </tbody>
          </table>
        );
      })}
    </>
  );
}

export function Job({ job }: { job: JobView }) {
  const log = job.log.filter((l) => l.trim() !== "");
  // The card and its memory, or why there is none.
  const device = log.find((l) => l.startsWith("training on "));
  const imported =
    job.kind === "import" && job.phase === "done"
      ? (job.lines.find((l) => l.event === "result")?.result as
          | { id: string; folder: string; dropped: string[]; assumed: string[]; changed: string[] }
          | undefined)
      : undefined;
  return (
    <article class="job" data-testid={`job-${job.id}`} data-phase={job.phase}>
      <header class="row">
        <b>{job.title || job.kind}</b>
        <span class={`phase ${job.phase}`}>{job.phase}</span>
        <span class="num">{job.secs < 1 ? "" : minutes(job.secs)}</span>
        <span class="grow" />
        {!isRunning(job) && job.phase !== "done" ? (
          <button onClick={() => void resumeJob(job.id)} data-testid={`resume-${job.id}`}>
            {job.kind === "train" || job.kind === "collect" ? "Resume" : "Run again"}
          </button>
        ) : null}
      </header>
      <Line kind={job.kind} args={job.args} />
      {isRunning(job) ? <JobBar job={job} /> : null}
      {device ? (
        <p class="note" data-testid={`device-${job.id}`}>
          {device}
        </p>
      ) : null}
      {job.progress?.note && job.phase !== "done" ? <p class="note">{job.progress.note}</p> : null}
      <Charts kind={job.kind} points={() => figures(job.id)} />
      {job.kind === "eval" ? <Table job={job} /> : null}
      {imported ? (
        <div data-testid="imported">
          <p>
            <button
              class="main"
              onClick={() => void opening(http("POST /api/new", { body: { robot: imported.folder } }))}
            >
              New clip with {imported.id}
            </button>
          </p>
          <ul>
            {[
              ...imported.assumed.map((t) => `assumed: ${t}`),
              ...imported.changed.map((t) => `changed: ${t}`),
              ...imported.dropped.map((t) => `ignored: ${t}`),
            ].map((t) => (
              <li key={t}>{t}</li>
            ))}
          </ul>
        </div>
      ) : null}
      {job.phase === "failed" ? (
        <p class="note failed" role="alert">
          {log.filter((l) => l.startsWith("error")).at(-1) ?? log.at(-1) ?? `exit ${job.exit}`}
        </p>
      ) : null}
      {log.length ? (
        <details>
          <summary>Log</summary>
          <pre>{log.join("\n")}</pre>
        </details>
      ) : null}
    </article>
  );
}

async function perform(run: RunCard): Promise<void> {
  if (!run.model || !run.robot) return;
  tell("rollout.set", withRun(store.settings.value, run, store.policies.value));
  if (store.doc.value?.clip.robot.id !== run.robot) {
    const source = store.robots.value.find((r) => r.id === run.robot)?.source ?? run.robot;
    await opening(http("POST /api/new", { body: { robot: source } }));
  }
  store.page.value = "editor";
}

/** A run on disk: how far, how good, its curves, and what can be done with it. */
export function Run({ run }: { run: RunCard }) {
  const shown = useSignal(false);
  const args = resumeArgs(run, store.workspace.value, store.robots.value);
  const precision = Object.entries(run.precision ?? {});
  return (
    <article class="run" data-testid={`run-${run.path}`}>
      <div class="take">
        <span class="grow" title={`preset ${run.preset}`}>
          {run.path}
        </span>
        <span class="num">
          {run.step.toLocaleString("en")} of {run.steps.toLocaleString("en")} step{run.steps === 1 ? "" : "s"}
        </span>
        <button
          class="quiet"
          aria-expanded={shown.value}
          onClick={() => (shown.value = !shown.value)}
          data-testid={`curves-${run.path}`}
        >
          Curves
        </button>
        {run.step < run.steps && run.robot ? (
          <button
            disabled={!args}
            title={
              args
                ? `robert train ${args.map(shellWord).join(" ")}`
                : "its training data are no longer in the data folder"
            }
            onClick={() => args && void startJob("train", args)}
            data-testid={`go-on-${run.path}`}
          >
            Resume
          </button>
        ) : null}
        <button
          disabled={!run.model}
          onClick={() => void perform(run).catch(complain)}
          data-testid={`perform-${run.path}`}
        >
          Use it
        </button>
      </div>
      {precision.length ? (
        <p
          class="precision"
          title="Mean error over all goals of the suite, of the best checkpoint; lower is better"
          data-testid={`precision-${run.path}`}
        >
          {precision.map(([name, v]) => (
            <span key={name}>
              {name} <b class="num">{v.toPrecision(2)}</b>
            </span>
          ))}
        </p>
      ) : null}
      {shown.value ? <RunCurves path={run.path} /> : null}
    </article>
  );
}
