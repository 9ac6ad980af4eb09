// From a robot to a policy without leaving the page: import, collect, train, evaluate. Every
// form is a command line, shown as such; what runs here is what runs in a shell.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect } from "preact/hooks";
import { Line } from "./command_line";
import { imported, isRunning, refreshWorkspace, startJob } from "./jobs";
import { ImportRobot } from "./robot_import";
import * as store from "./store";
import { isBuiltin, sourceOf, usualPolicies, usualSuite } from "./training";
import { Job, Run } from "./training_jobs";

const AGENTS: [string, string][] = [
  ["noise", "smooth random torque; takes seconds"],
  ["babble", "random poses with weak servos; takes seconds"],
  ["rnd", "random network distillation"],
  ["icm", "prediction error of a forward model"],
  ["apt", "entropy of visited states"],
  ["aps", "entropy of visited states and successor features"],
  ["proto", "prototypical representations"],
];

function stamp(): string {
  return new Date().toISOString().slice(0, 16).replace(/[-:]/g, "").replace("T", "-");
}

function Step(props: { n: number; title: string; about: string; children: ComponentChildren }) {
  return (
    <section class="step" aria-label={props.title}>
      <h2>
        <span class="n">{props.n}</span>
        {props.title}
      </h2>
      <p class="about">{props.about}</p>
      {props.children}
    </section>
  );
}

function Robots(props: { value: string; onChange: (source: string) => void }) {
  return (
    <select
      aria-label="Robot"
      value={props.value}
      onChange={(e) => props.onChange(e.currentTarget.value)}
      data-testid="runs-robot"
    >
      {store.robots.value.map((r) => (
        <option key={r.source} value={r.source}>
          {r.id}
          {r.builtin ? "" : " (yours)"}
        </option>
      ))}
    </select>
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
  const device = useSignal("cpu");
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
    void refreshWorkspace().then(choose);
    // What is imported while this page is open is what comes next.
    const before = imported.value;
    return imported.subscribe((source) => {
      if (!source || source === before) return;
      robot.value = source;
      policies.value = suite.value = picked.value = undefined;
    });
  }, []);
  const shelf = store.workspace.value;
  const id = store.robots.value.find((r) => r.source === robot.value)?.id ?? robot.value;
  const mine = shelf.data.filter((d) => d.robot === id);
  const chosen = data.value && mine.some((d) => d.path === data.value) ? data.value : (mine[0]?.path ?? "");
  const list = [...store.jobs.value.values()]
    .filter((j) => j.kind !== "render" && j.kind !== "export")
    .sort((a, b) => b.id - a.id);
  const agents = picked.value ?? new Set([isBuiltin(id, store.robots.value) ? "noise" : "babble"]);
  const curious = [...agents].some((a) => a !== "noise" && a !== "babble");
  const collect = [
    "--robot",
    robot.value,
    "--agent",
    [...agents].join(","),
    "--transitions",
    transitions.value,
    ...(curious && agentSteps.value ? ["--agent-steps", agentSteps.value] : []),
    "--out",
    out.value || `data/${id}-${[...agents].join("-")}`,
  ];
  const train = [
    "--robot",
    robot.value,
    "--data",
    chosen,
    "--preset",
    preset.value,
    "--out",
    run.value || `runs/${stamp()}-${id}-${preset.value}`,
    ...(device.value === "cpu" ? [] : ["--device", device.value]),
  ];
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
    <label>
      {label}{" "}
      <input
        type="text"
        value={signal.value}
        placeholder={placeholder}
        onInput={(e) => (signal.value = e.currentTarget.value)}
      />
    </label>
  );
  return (
    <div class="runs" data-testid="runs">
      <div class="steps">
        <div class="row head">
          <h1>Train a policy</h1>
          <Robots
            value={robot.value}
            onChange={(r) => {
              robot.value = r;
              policies.value = undefined;
            }}
          />
        </div>
        <ImportRobot />
        <Step
          n={1}
          title="Collect motion"
          about="Exploration agents move the robot in simulation, without task rewards or demonstrations."
        >
          <div class="fields">
            {AGENTS.map(([name, about]) => (
              <label key={name} title={about}>
                <input
                  type="checkbox"
                  checked={agents.has(name)}
                  onChange={() => {
                    const next = new Set(agents);
                    if (!next.delete(name)) next.add(name);
                    if (next.size) picked.value = next;
                  }}
                />{" "}
                {name}
              </label>
            ))}
            {text(transitions, "transitions")}
            {curious ? text(agentSteps, "training steps of the agent") : null}
            {text(out, "folder", `data/${id}-${[...agents].join("-")}`)}
          </div>
          <Line kind="collect" args={collect} />
          <button class="main" onClick={() => void startJob("collect", collect)} data-testid="collect">
            Collect
          </button>
        </Step>
        <Step
          n={2}
          title="Train"
          about="A transformer learns which torques lead from one state to the next, while goals are masked at random."
        >
          <div class="fields">
            <label>
              data{" "}
              <select value={chosen} onChange={(e) => (data.value = e.currentTarget.value)}>
                {mine.length ? (
                  mine.map((d) => (
                    <option key={d.path} value={d.path}>
                      {d.path} ({d.frames.toLocaleString("en")} frames)
                    </option>
                  ))
                ) : (
                  <option value="">none for {id} yet</option>
                )}
              </select>
            </label>
            <label>
              preset{" "}
              <select value={preset.value} onChange={(e) => (preset.value = e.currentTarget.value)}>
                {shelf.presets.map(([name, about]) => (
                  <option key={name} value={name} title={about}>
                    {name}
                  </option>
                ))}
              </select>
            </label>
            {text(run, "run", "runs/…")}
            <label title="A graphics card with a Vulkan driver; without one the processor trains, and the log says why">
              on{" "}
              <select
                value={device.value}
                onChange={(e) => (device.value = e.currentTarget.value)}
                data-testid="device"
              >
                <option value="cpu">the processor</option>
                <option value="auto">a graphics card</option>
              </select>
            </label>
          </div>
          <p class="about">{shelf.presets.find(([n]) => n === preset.value)?.[1]}</p>
          <Line kind="train" args={train} />
          <button
            class="main"
            disabled={!chosen}
            onClick={() => void startJob("train", train)}
            data-testid="train"
          >
            Train
          </button>
        </Step>
        <Step n={3} title="Evaluate" about="Measures the error of each policy on a suite of task clips.">
          <div class="fields">
            <label title="manual, extra, validation, drawn, fast, touch (for built-in robots), trial, or paths of clips, separated by commas">
              suite{" "}
              <input
                type="text"
                list="suites"
                value={suites}
                onInput={(e) => (suite.value = e.currentTarget.value)}
                data-testid="suite"
              />
            </label>
            <datalist id="suites">
              {(isBuiltin(id, store.robots.value)
                ? ["manual", "extra", "validation", "drawn", "fast", "touch", "trial"]
                : ["trial"]
              ).map((s) => (
                <option key={s} value={s} />
              ))}
            </datalist>
            <button
              class="quiet"
              disabled={!open?.path}
              title={open?.path ?? (open ? "save the clip first" : `no clip of ${id} is open`)}
              onClick={() => {
                const p = open?.path;
                if (p && !suites.split(",").includes(p)) suite.value = suites ? `${suites},${p}` : p;
              }}
              data-testid="this-clip"
            >
              + this clip
            </button>
            <label>
              policies{" "}
              <input type="text" value={compared} onInput={(e) => (policies.value = e.currentTarget.value)} />
            </label>
            {[...models.filter((m) => m !== "robert"), ...trained.map((r) => r.path)].map((m) => (
              <button
                key={m}
                class="quiet"
                disabled={compared.split(",").includes(`robert:${m}`)}
                onClick={() => (policies.value = compared ? `${compared},robert:${m}` : `robert:${m}`)}
                title="Add this model to the table"
              >
                + {m}
              </button>
            ))}
          </div>
          <Line kind="eval" args={evaluate} />
          <button class="main" onClick={() => void startJob("eval", evaluate)} data-testid="evaluate">
            Evaluate
          </button>
        </Step>
      </div>
      <div class="work">
        <h2>Jobs</h2>
        {list.length === 0 ? (
          <p class="about">
            No jobs yet. Jobs continue when this page is closed. They stop with the studio and can be resumed.
          </p>
        ) : null}
        {list.map((j) => (
          <Job key={j.id} job={j} />
        ))}
        <h2>Trained here</h2>
        {shelf.runs.length === 0 ? <p class="about">No runs in {store.folder.value}/runs.</p> : null}
        {shelf.runs.map((r) => (
          <Run key={r.path} run={r} />
        ))}
        {begun.length ? <h2>Unfinished data</h2> : null}
        {begun.map((b) => (
          <div class="take" key={b.path} data-testid={`begun-${b.path}`}>
            <span class="grow">{b.path}</span>
            <span>
              {b.robot} · {b.agents.join(", ")} · {b.transitions.toLocaleString("en")} frames planned
            </span>
            <button
              onClick={() =>
                void startJob("collect", [
                  "--robot",
                  sourceOf(b.robot, store.robots.value),
                  "--out",
                  b.path,
                  "--resume",
                ])
              }
              data-testid={`go-on-${b.path}`}
            >
              Resume
            </button>
          </div>
        ))}
      </div>
    </div>
  );
}
