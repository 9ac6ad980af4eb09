// Long work in processes of its own: collect, train, evaluate, export, import.

import { signal } from "@preact/signals";
import type { ExportRequest, JobEvent, JobKind, JobView } from "./protocol";
import * as store from "./store";
import { complain, http, Refusal } from "./wire";

/** The source of the robot that was imported last: the training page turns to it. */
export const imported = signal<string | undefined>(undefined);

/** Lines of a job that are kept, as many as the server keeps. */
const LINES = 2000;

/** A job has something new to say. */
export function onJob(job: JobView): void {
  const before = store.jobs.value.get(job.id);
  store.jobs.value = new Map(store.jobs.value).set(job.id, {
    ...job,
    lines: [...(before?.lines ?? []), ...newLines(job, before)].slice(-LINES),
  });
  if (
    before?.phase !== job.phase &&
    (job.phase === "done" || job.phase === "interrupted" || job.phase === "failed")
  )
    jobEnded(job);
}

/** An event of a job carries its newest line only; a first sight asks for the rest. */
function newLines(job: JobView, before: JobView | undefined): JobEvent[] {
  if (!job.last) return [];
  if (before && job.events === before.events) return [];
  if (before ? job.events > before.events + 1 : job.events > 1) void loadJob(job.id);
  return [job.last];
}

/** What an answer says of a job. An event that came while the answer was on its way may be the later of the two:
 * it stands, unless the answer knows of more. */
function newest(answer: JobView, asked: JobView | undefined): JobView {
  const now = store.jobs.value.get(answer.id);
  if (!now || now === asked || now.events < answer.events) return answer;
  const missed = now.events - answer.events;
  const lines = [...answer.lines, ...(missed ? now.lines.slice(-missed) : [])];
  return { ...now, lines: lines.slice(-LINES) };
}

/** All lines of a job, for its curves. */
export async function loadJob(id: number): Promise<void> {
  const asked = store.jobs.value.get(id);
  try {
    const whole = await http("GET /api/jobs/{id}", { at: { id }, query: { from: 0 } });
    store.jobs.value = new Map(store.jobs.value).set(id, newest(whole, asked));
  } catch (e) {
    complain(e);
  }
}

function jobEnded(job: JobView): void {
  const what = job.title || job.kind;
  if (job.phase === "failed")
    store.toast(`${what}: ${job.log.filter((l) => l.startsWith("error")).at(-1) ?? "failed"}`, "error");
  else if (job.kind === "collect" || job.kind === "train" || job.kind === "eval" || job.kind === "import") {
    store.toast(job.phase === "done" ? `${what} is done` : `${what} stopped; you can resume it`);
  }
  if (job.kind !== "render" && job.kind !== "export") void refreshWorkspace().then(() => turnToImported(job));
}

/** The list of robots knows what a job has imported. */
function turnToImported(job: JobView): void {
  if (job.kind !== "import" || job.phase !== "done") return;
  const id = job.args[job.args.indexOf("--id") + 1];
  imported.value = store.robots.value.find((r) => r.id === id)?.source;
}

/** Robots, runs and data in the folder. */
export async function refreshWorkspace(): Promise<void> {
  try {
    store.workspace.value = await http("GET /api/shelf");
    store.robots.value = await http("GET /api/robots");
  } catch (e) {
    complain(e);
  }
}

export async function startJob(kind: JobKind, args: string[]): Promise<JobView | undefined> {
  try {
    return await http("POST /api/jobs", { body: { kind, args } });
  } catch (e) {
    complain(e);
    return undefined;
  }
}

/** Starts an export of the clip as it is performed now; nothing is started where a file would have to be replaced. */
export async function startExport(options: ExportRequest): Promise<JobView | "exists" | undefined> {
  try {
    const job = await http("POST /api/exports", { body: options });
    store.jobs.value = new Map(store.jobs.value).set(job.id, store.jobs.value.get(job.id) ?? job);
    return job;
  } catch (e) {
    if (e instanceof Refusal && e.body.code === "exists") return "exists";
    complain(e);
    return undefined;
  }
}

export async function cancelJob(id: number): Promise<void> {
  try {
    await http("POST /api/jobs/{id}/cancel", { at: { id } });
  } catch (e) {
    complain(e);
  }
}

export async function resumeJob(id: number): Promise<void> {
  try {
    await http("POST /api/jobs/{id}/resume", { at: { id } });
  } catch (e) {
    complain(e);
  }
}

export async function refreshJobs(): Promise<void> {
  const before = store.jobs.value;
  try {
    const all = await http("GET /api/jobs");
    const begun = [...store.jobs.value].filter(([id]) => !before.has(id));
    store.jobs.value = new Map([...begun, ...all.map((j) => [j.id, newest(j, before.get(j.id))] as const)]);
    for (const j of all) if (j.events > 0 && j.kind !== "render" && j.kind !== "export") void loadJob(j.id);
  } catch (e) {
    complain(e);
  }
}

export function isRunning(job: JobView | undefined): boolean {
  return job?.phase === "running" || job?.phase === "cancelling";
}

/** Saves what a finished export made, as the browser saves files. */
export async function fetchFile(job: JobView): Promise<string> {
  return URL.createObjectURL(await http("GET /api/jobs/{id}/file", { at: { id: job.id } }));
}

export function saveUrl(url: string, name: string): void {
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
  store.toast(`${name} was saved to your downloads folder`);
}

/** Resolves when the job has ended. */
export function ended(id: number): Promise<JobView> {
  return new Promise((resolve) => {
    const stop = store.jobs.subscribe((all) => {
      const job = all.get(id);
      if (!job || isRunning(job)) return;
      queueMicrotask(() => stop());
      resolve(job);
    });
  });
}
