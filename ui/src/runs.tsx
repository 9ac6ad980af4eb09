// From a robot to a policy without leaving the page: import, collect, train, evaluate. Every
// form is a command line, shown as such; what runs here is what runs in a shell.

import { effect, useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { complain, http, openWith, refreshShelf, resumeJob, startJob, tell } from "./api";
import { isRunning, JobBar, minutes } from "./jobs";
import { leaving } from "./policy";
import type { JobKind, JobView, RunCard } from "./protocol";
import { isBuiltin, resumeArgs, sourceOf, usualPolicies, usualSuite } from "./shelf";
import * as store from "./store";
import { colors, hue } from "./theme";

const AGENTS: [string, string][] = [
  ["noise", "smooth random torque: seconds"], ["babble", "random poses behind weak servos: seconds"], ["rnd", "random network distillation"], ["icm", "curiosity of a forward model"],
  ["apt", "particle entropy"], ["aps", "particle entropy and successor features"], ["proto", "prototypes"],
];

/** A word that a shell would take apart is put in quotes. */
export function shellWord(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;
}

function Line({ kind, args }: { kind: JobKind; args: string[] }) {
  return <code class="line">robert {kind} {args.map(shellWord).join(" ")}</code>;
}

function stamp(): string {
  return new Date().toISOString().slice(0, 16).replace(/[-:]/g, "").replace("T", "-");
}

function Step(props: { n: number; title: string; about: string; children: ComponentChildren }) {
  return (
    <section class="step" aria-label={props.title}>
      <h2><span class="n">{props.n}</span>{props.title}</h2>
      <p class="about">{props.about}</p>
      {props.children}
    </section>
  );
}

function Robots(props: { value: string; onChange: (source: string) => void }) {
  return (
    <select aria-label="Robot" value={props.value} onChange={(e) => props.onChange(e.currentTarget.value)} data-testid="runs-robot">
      {store.robots.value.map((r) => <option key={r.source} value={r.source}>{r.id}{r.builtin ? "" : " (yours)"}</option>)}
    </select>
  );
}

function Import() {
  const file = useSignal("");
  const id = useSignal("");
  const fixed = useSignal(false);
  const files = useSignal<File[]>([]);
  const busy = useSignal("");
  const models = files.value.filter((f) => /\.(urdf|xml|mjcf)$/i.test(f.name));
  const nameOf = (f: File): string => f.webkitRelativePath || f.name;
  const start = async (): Promise<void> => {
    try {
      let path = file.value;
      const uploaded = files.value.length > 0;
      if (uploaded) {
        for (const [i, f] of files.value.entries()) {
          busy.value = `sending ${i + 1} of ${files.value.length}`;
          const answer = await fetch(`/api/upload?path=${encodeURIComponent(nameOf(f))}&first=${i === 0}`, { method: "PUT", body: f, credentials: "same-origin" });
          if (!answer.ok) throw new Error(((await answer.json().catch(() => ({}))) as { message?: string }).message ?? answer.statusText);
        }
        path ||= nameOf(models[0] ?? files.value[0] as File);
      }
      await http("POST", "/api/import", { file: path, uploaded, id: id.value, fixed_base: fixed.value });
    } catch (e) {
      complain(e);
    }
    busy.value = "";
  };
  const pick = (list: FileList | null): void => {
    files.value = [...(list ?? [])];
    const first = files.value.find((f) => /\.(urdf|xml|mjcf)$/i.test(f.name));
    file.value = first ? nameOf(first) : "";
    if (first && !id.value) id.value = first.name.replace(/\.\w+$/, "").toLowerCase().replace(/[^a-z0-9_-]+/g, "_");
  };
  return (
    <details class="import" data-testid="import">
      <summary>Import a robot (URDF, or MJCF for MuJoCo 2.2.2)</summary>
      <div class="fields">
        <label>Its folder <input type="file" multiple {...{ webkitdirectory: true }} onChange={(e) => pick(e.currentTarget.files)} data-testid="import-folder" /></label>
        <label>or files <input type="file" multiple onChange={(e) => pick(e.currentTarget.files)} data-testid="import-files" /></label>
        {models.length > 1 ? (
          <label>Model <select value={file.value} onChange={(e) => (file.value = e.currentTarget.value)}>{models.map((f) => <option key={nameOf(f)} value={nameOf(f)}>{nameOf(f)}</option>)}</select></label>
        ) : (
          <label>Model file <input type="text" value={file.value} placeholder={`path in ${store.folder.value}`} disabled={files.value.length > 0} onInput={(e) => (file.value = e.currentTarget.value)} data-testid="import-path" /></label>
        )}
        <label>Call it <input type="text" value={id.value} placeholder="my_arm" onInput={(e) => (id.value = e.currentTarget.value)} data-testid="import-id" /></label>
        <label><input type="checkbox" checked={fixed.value} onChange={(e) => (fixed.value = e.currentTarget.checked)} /> hold a floating base still</label>
      </div>
      <div class="row"><button class="main" disabled={!id.value || (!file.value && !files.value.length) || !!busy.value} onClick={() => void start()} data-testid="import-start">Import</button><span>{busy.value}</span></div>
      <p class="about">The model is checked in a process of its own. Motors, contacts and limits that its file does not give are added and listed.</p>
    </details>
  );
}

/** Curves out of `figures` events: what rises and falls with `step`. */
function series(kind: JobKind, points: Record<string, unknown>[]): { title: string; names: string[]; x: number[]; ys: (number | null)[][] }[] {
  const number = (v: unknown): number | null => (typeof v === "number" && Number.isFinite(v) ? v : null);
  const chart = (title: string, of: [string, (p: Record<string, unknown>) => number | null][]) => {
    const rows = points.filter((p) => of.some(([, get]) => get(p) !== null));
    rows.sort((a, b) => (number(a["step"]) ?? 0) - (number(b["step"]) ?? 0));
    return { title, names: of.map(([n]) => n), x: rows.map((p) => number(p["step"]) ?? 0), ys: of.map(([, get]) => rows.map(get)) };
  };
  if (kind === "train") {
    const inside = (p: Record<string, unknown>, outer: string, key: string): number | null => number((p[outer] as Record<string, unknown> | undefined)?.[key]);
    return [
      chart("loss", [["loss", (p) => number(p["loss"])]]),
      chart("action error", [["visible", (p) => number(p["action_rms_visible"])], ["masked", (p) => number(p["action_rms_masked"])]]),
      chart("Precision", [["rollout", (p) => inside(p, "evaluation", "precision")]]),
    ].filter((c) => c.x.length > 0);
  }
  const agents = [...new Set(points.map((p) => String(p["agent"] ?? "")))].filter(Boolean);
  return ["coverage", "reward"].map((what) => chart(what, agents.map((a) => [a, (p) => (p["agent"] === a ? number(p[what]) : null)]))).filter((c) => c.x.length > 0);
}

/** The figures of a job so far. */
function figures(id: number): Record<string, unknown>[] | undefined {
  return store.jobs.value.get(id)?.lines.flatMap((l) => (l.event === "figures" && l.figures ? [l.figures] : []));
}

/** The curves of a run on disk, as its own metrics have them. */
function RunCurves({ path }: { path: string }) {
  const points = useSignal<Record<string, unknown>[] | undefined>(undefined);
  useEffect(() => void http<Record<string, unknown>[]>("GET", `/api/curves?path=${encodeURIComponent(path)}`).then((p) => (points.value = p), complain), [path]);
  if (!points.value) return <p class="about">reading…</p>;
  if (points.value.length === 0) return <p class="about">nothing was measured yet</p>;
  return <Charts kind="train" points={() => points.value} />;
}

function Charts({ kind, points }: { kind: JobKind; points: () => Record<string, unknown>[] | undefined }) {
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
        const axis = { stroke: c.dim, grid: { stroke: c.faint, width: 1 }, ticks: { stroke: c.rule }, font: "11px system-ui" };
        plots = charts.map((chart) => new uPlot({
          width: 320, height: 150, title: chart.title, legend: { live: false, show: chart.names.length > 1 },
          scales: { x: { time: false } },
          axes: [{ ...axis, values: (_, at) => at.map((v) => (v >= 1000 ? `${v / 1000}k` : `${v}`)) }, { ...axis, size: 52 }],
          series: [{}, ...chart.names.map((label, i) => ({ label, stroke: hue(i), width: 1.5, spanGaps: true, points: { show: chart.x.length < 30, size: 4 } }))],
        }, [chart.x, ...chart.ys] as uPlot.AlignedData, parent));
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

interface EvalResult {
  unit: string;
  results: { policy: string; suite: string; precision_mean: number | null; tasks: { name: string; precision: number | null }[] }[];
}

/** The table of an evaluation: tasks as rows, policies as columns. */
function Table({ job }: { job: JobView }) {
  const found = job.lines.find((l) => l.event === "result")?.result as EvalResult | undefined;
  if (!found?.results) return null;
  const suites = [...new Set(found.results.map((r) => r.suite))];
  const text = (v: number | null | undefined): string => (v === null || v === undefined ? "failed" : v.toFixed(4));
  return (
    <>
      {suites.map((suite) => {
        const columns = found.results.filter((r) => r.suite === suite);
        return (
          <table key={suite} class="result" data-testid="eval-table">
            <caption>{suite}: Precision in {found.unit}, lower is better</caption>
            <thead><tr><th>task</th>{columns.map((c) => <th key={c.policy}>{c.policy}</th>)}</tr></thead>
            <tbody>
              {(columns[0]?.tasks ?? []).map((t, i) => <tr key={t.name}><td>{t.name}</td>{columns.map((c) => <td key={c.policy} class="num">{text(c.tasks[i]?.precision)}</td>)}</tr>)}
              <tr class="mean"><td>mean</td>{columns.map((c) => <td key={c.policy} class="num">{text(c.precision_mean)}</td>)}</tr>
            </tbody>
          </table>
        );
      })}
    </>
  );
}

function Job({ job }: { job: JobView }) {
  const log = job.log.filter((l) => l.trim() !== "");
  const imported = job.kind === "import" && job.phase === "done" ? (job.lines.find((l) => l.event === "result")?.result as { id: string; folder: string; dropped: string[]; assumed: string[]; changed: string[] } | undefined) : undefined;
  return (
    <article class="job" data-testid={`job-${job.id}`} data-phase={job.phase}>
      <header class="row"><b>{job.title || job.kind}</b><span class={`phase ${job.phase}`}>{job.phase}</span><span class="num">{minutes(job.secs)}</span><span class="grow" />
        {!isRunning(job) && job.phase !== "done" ? <button onClick={() => void resumeJob(job.id)} data-testid={`resume-${job.id}`}>{job.kind === "train" || job.kind === "collect" ? "Go on" : "Again"}</button> : null}
      </header>
      <Line kind={job.kind} args={job.args} />
      {isRunning(job) ? <JobBar job={job} /> : null}
      {job.progress?.note ? <p class="note">{job.progress.note}</p> : null}
      <Charts kind={job.kind} points={() => figures(job.id)} />
      {job.kind === "eval" ? <Table job={job} /> : null}
      {imported ? (
        <div data-testid="imported">
          <p><button class="main" onClick={() => void openWith("POST", "/api/new", { robot: imported.folder })}>New clip with {imported.id}</button></p>
          <ul>{[...imported.assumed.map((t) => `assumed: ${t}`), ...imported.changed.map((t) => `changed: ${t}`), ...imported.dropped.map((t) => `left out: ${t}`)].map((t) => <li key={t}>{t}</li>)}</ul>
        </div>
      ) : null}
      {job.phase === "failed" ? <p class="note failed" role="alert">{log.filter((l) => l.startsWith("error")).at(-1) ?? log.at(-1) ?? `exit ${job.exit}`}</p> : null}
      {log.length ? <details><summary>Log</summary><pre>{log.join("\n")}</pre></details> : null}
    </article>
  );
}

async function perform(run: RunCard): Promise<void> {
  if (!run.model || !run.robot) return;
  tell("rollout.set", { ...leaving(store.settings.value, store.policies.value), policy: "robert", model_path: run.model });
  if (store.doc.value?.clip.robot.id !== run.robot) {
    const source = store.robots.value.find((r) => r.id === run.robot)?.source ?? run.robot;
    await openWith("POST", "/api/new", { robot: source });
  }
  store.page.value = "editor";
}

/** A run on disk: how far, how good, its curves, and what can be done with it. */
function Run({ run }: { run: RunCard }) {
  const shown = useSignal(false);
  const args = resumeArgs(run, store.shelf.value, store.robots.value);
  const precision = Object.entries(run.precision ?? {});
  return (
    <article class="run" data-testid={`run-${run.path}`}>
      <div class="take">
        <span class="grow" title={`preset ${run.preset}`}>{run.path}</span>
        <span class="num">{run.step.toLocaleString("en")} of {run.steps.toLocaleString("en")} steps</span>
        <button class="quiet" aria-expanded={shown.value} onClick={() => (shown.value = !shown.value)} data-testid={`curves-${run.path}`}>Curves</button>
        {run.step < run.steps && run.robot ? <button disabled={!args} title={args ? `robert train ${args.map(shellWord).join(" ")}` : "the data that it learns from is not in this folder's data/ any more"} onClick={() => args && void startJob("train", args)} data-testid={`go-on-${run.path}`}>Go on</button> : null}
        <button disabled={!run.model} onClick={() => void perform(run).catch(complain)} data-testid={`perform-${run.path}`}>Perform with it</button>
      </div>
      {precision.length ? <p class="precision" title="Mean error over all goals of the suite, of the best checkpoint; lower is better" data-testid={`precision-${run.path}`}>{precision.map(([name, v]) => <span key={name}>{name} <b class="num">{v.toPrecision(2)}</b></span>)}</p> : null}
      {shown.value ? <RunCurves path={run.path} /> : null}
    </article>
  );
}

export function Runs() {
  const robot = useSignal("pointmass");
  // Until some are picked it is what needs no training and no tuning on this robot.
  const picked = useSignal<ReadonlySet<string> | undefined>(undefined);
  const transitions = useSignal("100000");
  const agentSteps = useSignal("20000");
  const out = useSignal("");
  const data = useSignal("");
  const preset = useSignal("instant");
  const run = useSignal("");
  // Until some are typed it is what this robot has.
  const policies = useSignal<string | undefined>(undefined);
  // Until one is typed it is what this robot has.
  const suite = useSignal<string | undefined>(undefined);
  useEffect(() => {
    const id = store.doc.value?.clip.robot.id;
    const choose = (): void => {
      if (id) robot.value = store.robots.value.find((r) => r.id === id)?.source ?? id;
    };
    choose();
    // The list of robots may only now come to know it.
    void refreshShelf().then(choose);
  }, []);
  const shelf = store.shelf.value;
  const id = store.robots.value.find((r) => r.source === robot.value)?.id ?? robot.value;
  const mine = shelf.data.filter((d) => d.robot === id);
  const chosen = data.value && mine.some((d) => d.path === data.value) ? data.value : mine[0]?.path ?? "";
  const list = [...store.jobs.value.values()].filter((j) => j.kind !== "render" && j.kind !== "export").sort((a, b) => b.id - a.id);
  const agents = picked.value ?? new Set([isBuiltin(id, store.robots.value) ? "noise" : "babble"]);
  const curious = [...agents].some((a) => a !== "noise" && a !== "babble");
  const collect = ["--robot", robot.value, "--agent", [...agents].join(","), "--transitions", transitions.value, ...(curious && agentSteps.value ? ["--agent-steps", agentSteps.value] : []), "--out", out.value || `data/${id}-${[...agents].join("-")}`];
  const train = ["--robot", robot.value, "--data", chosen, "--preset", preset.value, "--out", run.value || `runs/${stamp()}-${id}-${preset.value}`];
  const open = store.doc.value?.clip.robot.id === id ? store.doc.value : undefined;
  const suites = suite.value ?? usualSuite(id, store.robots.value, open?.path);
  const models = store.robots.value.find((r) => r.id === id)?.models ?? [];
  const compared = policies.value ?? usualPolicies(models);
  const evaluate = ["--robot", robot.value, "--suite", suites, "--policy", compared];
  // What is being collected right now is not unfinished business.
  const busy = list.filter(isRunning).flatMap((j) => j.args);
  const begun = shelf.begun.filter((b) => !busy.includes(b.path));
  const trained = shelf.runs.filter((r) => r.model && r.robot === id);
  const text = (signal: { value: string }, label: string, placeholder = "") => (
    <label>{label} <input type="text" value={signal.value} placeholder={placeholder} onInput={(e) => (signal.value = e.currentTarget.value)} /></label>
  );
  return (
    <div class="runs" data-testid="runs">
      <div class="steps">
        <div class="row head"><h1>Train a policy</h1><Robots value={robot.value} onChange={(r) => { robot.value = r; policies.value = undefined; }} /></div>
        <Import />
        <Step n={1} title="Collect motion" about="Agents move the robot as their curiosity drives them: no reward, no demonstration.">
          <div class="fields">
            {AGENTS.map(([name, about]) => (
              <label key={name} title={about}><input type="checkbox" checked={agents.has(name)} onChange={() => { const next = new Set(agents); if (!next.delete(name)) next.add(name); if (next.size) picked.value = next; }} /> {name}</label>
            ))}
            {text(transitions, "transitions")}
            {curious ? text(agentSteps, "steps an agent learns") : null}
            {text(out, "folder", `data/${id}-${[...agents].join("-")}`)}
          </div>
          <Line kind="collect" args={collect} />
          <button class="main" onClick={() => void startJob("collect", collect)} data-testid="collect">Collect</button>
        </Step>
        <Step n={2} title="Train" about="A transformer learns which torque leads from one frame to the next, with goals hidden at random.">
          <div class="fields">
            <label>data <select value={chosen} onChange={(e) => (data.value = e.currentTarget.value)}>{mine.length ? mine.map((d) => <option key={d.path} value={d.path}>{d.path} ({d.frames.toLocaleString("en")} frames)</option>) : <option value="">none for {id} yet</option>}</select></label>
            <label>preset <select value={preset.value} onChange={(e) => (preset.value = e.currentTarget.value)}>{shelf.presets.map(([name, about]) => <option key={name} value={name} title={about}>{name}</option>)}</select></label>
            {text(run, "run", "runs/…")}
          </div>
          <p class="about">{shelf.presets.find(([n]) => n === preset.value)?.[1]}</p>
          <Line kind="train" args={train} />
          <button class="main" disabled={!chosen} onClick={() => void startJob("train", train)} data-testid="train">Train</button>
        </Step>
        <Step n={3} title="Evaluate" about="A table of how near each policy comes on the task clips.">
          <div class="fields">
            <label title="manual, extra, validation, drawn, fast, touch (of the program's robots), trial, or paths of clips; commas between them">suite <input type="text" list="suites" value={suites} onInput={(e) => (suite.value = e.currentTarget.value)} data-testid="suite" /></label>
            <datalist id="suites">{(isBuiltin(id, store.robots.value) ? ["manual", "extra", "validation", "drawn", "fast", "touch", "trial"] : ["trial"]).map((s) => <option key={s} value={s} />)}</datalist>
            <button class="quiet" disabled={!open?.path} title={open?.path ?? (open ? "save the clip first" : `no clip of ${id} is open`)} onClick={() => { const p = open?.path; if (p && !suites.split(",").includes(p)) suite.value = suites ? `${suites},${p}` : p; }} data-testid="this-clip">+ this clip</button>
            <label>policies <input type="text" value={compared} onInput={(e) => (policies.value = e.currentTarget.value)} /></label>
            {[...models.filter((m) => m !== "robert"), ...trained.map((r) => r.path)].map((m) => <button key={m} class="quiet" disabled={compared.split(",").includes(`robert:${m}`)} onClick={() => (policies.value = compared ? `${compared},robert:${m}` : `robert:${m}`)} title="Add this model to the table">+ {m}</button>)}
          </div>
          <Line kind="eval" args={evaluate} />
          <button class="main" onClick={() => void startJob("eval", evaluate)} data-testid="evaluate">Evaluate</button>
        </Step>
      </div>
      <div class="work">
        <h2>At work</h2>
        {list.length === 0 ? <p class="about">Nothing yet. Jobs run on when this page is closed; they end with the studio, and can go on later.</p> : null}
        {list.map((j) => <Job key={j.id} job={j} />)}
        <h2>Trained here</h2>
        {shelf.runs.length === 0 ? <p class="about">No runs in {store.folder.value}/runs.</p> : null}
        {shelf.runs.map((r) => <Run key={r.path} run={r} />)}
        {begun.length ? <h2>Unfinished data</h2> : null}
        {begun.map((b) => (
          <div class="take" key={b.path} data-testid={`begun-${b.path}`}>
            <span class="grow">{b.path}</span>
            <span>{b.robot} · {b.agents.join(", ")} · {b.transitions.toLocaleString("en")} frames wanted</span>
            <button onClick={() => void startJob("collect", ["--robot", sourceOf(b.robot, store.robots.value), "--out", b.path, "--resume"])} data-testid={`go-on-${b.path}`}>Go on</button>
          </div>
        ))}
      </div>
    </div>
  );
}
