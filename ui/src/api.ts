// The wire: one session cookie, one socket, every edit a message. The page never changes the
// document by itself; it sends operations and draws what comes back.

import { batch } from "@preact/signals";
import { changedBy, keyAt, values, type Clip } from "./clip";
import { within } from "./span";
import {
  patched, type Demand, type DocumentView, type Event, type Failure, type JobEvent, type JobKind, type JobView, type RobotFacts,
  type State, type WorkerState,
} from "./protocol";
import { dragCancelled, dragged } from "./hand";
import * as store from "./store";
import { heardOfTakes } from "./takes";

let socket: WebSocket | undefined;
let client = 0;
let nextId = 1;
const waiting = new Map<number, { resolve: (r: Reply) => void; sent: number }>();

export interface Reply {
  ok: boolean;
  result?: unknown;
  error?: Failure;
}

/** Time from sending an edit to its acknowledgement, milliseconds; the last 500. */
export const ackTimes: number[] = [];

export class Refusal extends Error {
  constructor(
    readonly body: Failure,
    readonly status: number,
  ) {
    super(body.message);
  }
}

export async function http<T>(method: string, path: string, body?: unknown): Promise<T> {
  const init: RequestInit = { method, credentials: "same-origin" };
  if (body instanceof Blob) {
    init.body = body;
  } else if (typeof body === "string") {
    init.body = body;
    init.headers = { "content-type": "text/plain" };
  } else if (body !== undefined) {
    init.body = JSON.stringify(body);
    init.headers = { "content-type": "application/json" };
  }
  const answer = await fetch(path, init);
  const text = await answer.text();
  if (!answer.ok) {
    let refusal: Failure = { code: "failed", message: text || answer.statusText };
    try {
      refusal = JSON.parse(text) as Failure;
    } catch {
      // Not every refusal comes from a handler.
    }
    throw new Refusal(refusal, answer.status);
  }
  try {
    return JSON.parse(text) as T;
  } catch {
    return text as T;
  }
}

/** Says what went wrong, with the place, as the command line would. */
export function complain(e: unknown): void {
  if (e instanceof Refusal) store.toast(e.body.mend ? `${e.body.message} (${e.body.mend})` : e.body.message, "error");
  else store.toast(e instanceof Error ? e.message : String(e), "error");
}

/** Trades the token in the URL for a cookie and forgets it. */
async function session(): Promise<void> {
  const token = /token=([0-9a-f]+)/i.exec(location.hash)?.[1];
  if (!token) return;
  const answer = await fetch("/api/session", { method: "POST", headers: { authorization: `Bearer ${token}` } });
  if (answer.ok) history.replaceState(null, "", location.pathname + location.search);
}

export async function connect(): Promise<void> {
  try {
    await session();
  } catch {
    // The socket's own reconnect says so.
  }
  // The address of a studio that was started anew differs in its token only: no new page is loaded.
  window.addEventListener("hashchange", () => void session().catch(() => undefined));
  open();
}

function open(): void {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const ws = new WebSocket(`${scheme}://${location.host}/api/ws`);
  socket = ws;
  let greeted = false;
  ws.onmessage = (m) => {
    greeted = true;
    receive(JSON.parse(String(m.data)) as Event);
  };
  ws.onclose = () => {
    for (const w of waiting.values()) w.resolve({ ok: false, error: { code: "lost", message: "the studio is gone" } });
    waiting.clear();
    failures = greeted ? 0 : failures + 1;
    known ||= greeted;
    void answer().then((there) => {
      if (socket !== ws) return;
      store.link.value = there ? (known ? "moved" : "refused") : failures < PATIENCE ? "lost" : "gone";
      setTimeout(open, 1000);
    });
  };
}

/** Attempts before a page says that the studio may not come back to this address. */
const PATIENCE = 5;
let failures = 0;
/** This page was let in once. */
let known = false;

/** Whether somebody answers here who does not let this page in; a socket does not say why it closed. */
async function answer(): Promise<boolean> {
  try {
    const { status } = await fetch("/api/state", { method: "HEAD", credentials: "same-origin", signal: AbortSignal.timeout(5000) });
    return status === 401 || status === 403;
  } catch {
    return false;
  }
}

function send(op: string, args: object): Promise<Reply> {
  const ws = socket;
  if (!ws || ws.readyState !== WebSocket.OPEN) {
    return Promise.resolve({ ok: false, error: { code: "lost", message: "not connected: the edit was not made" } });
  }
  const id = nextId++;
  return new Promise((resolve) => {
    waiting.set(id, { resolve, sent: performance.now() });
    ws.send(JSON.stringify({ id, op, args }));
  });
}

/** An edit. Resolves when it is on the server's disk; refusals are shown. */
export async function edit(op: string, args: object): Promise<boolean> {
  const reply = await send(op, args);
  if (reply.error) complain(new Refusal(reply.error, 422));
  return reply.ok;
}

/** Tells the server something that is no edit; silence is success. */
export function tell(op: string, args: object = {}): void {
  void send(op, args).then((r) => {
    if (r.error && r.error.code !== "lost") complain(new Refusal(r.error, 422));
  });
}

/** Asks for something that is no edit. */
export async function ask(op: string, args: object = {}): Promise<Reply> {
  return send(op, args);
}

function settle(id: number | undefined, reply: Reply): void {
  const w = id === undefined ? undefined : waiting.get(id);
  if (!w || id === undefined) return;
  waiting.delete(id);
  ackTimes.push(performance.now() - w.sent);
  if (ackTimes.length > 500) ackTimes.shift();
  w.resolve(reply);
}

function receive(e: Event): void {
  switch (e.event) {
    case "hello":
      client = e.client;
      store.link.value = "open";
      welcome(e.state);
      return;
    case "edit": {
      const d = store.doc.value;
      if (d) {
        batch(() => {
          const clip = patched(d.clip, e.patch);
          store.doc.value = { ...d, rev: e.rev, clip, dirty: e.dirty, history: e.history };
          // A key that has gone, or gone elsewhere, is no longer selected.
          store.range.value = within(store.range.value, clip.length);
          store.playhead.value = Math.min(store.playhead.value, Math.max(0, clip.length - 1));
          const there = [...store.selection.value].filter((f) => clip.keys.some((k) => k.frame === f));
          if (there.length < store.selection.value.size) store.selection.value = new Set(there);
          store.announcement.value = e.label;
        });
      }
      if (e.by === client) settle(e.id, { ok: true });
      return;
    }
    case "reply":
      settle(e.id, e.error ? { ok: false, error: e.error } : { ok: true, result: e.result });
      return;
    case "document":
      store.moving.value = undefined;
      store.demand.value = undefined;
      for (const id of [...waiting.keys()]) settle(id, { ok: true });
      adopt(e.document);
      return;
    case "saved": {
      const d = store.doc.value;
      if (d) store.doc.value = { ...d, path: e.path, dirty: d.rev !== e.rev };
      store.toast(`saved ${e.path}`);
      return;
    }
    case "findings": {
      const d = store.doc.value;
      if (d) store.doc.value = { ...d, findings: e };
      return;
    }
    case "rollout.settings": {
      // They are sent back when one of them is changed: without the name of the event.
      const { event: _, ...settings } = e;
      store.settings.value = settings;
      return;
    }
    case "rollout.frames": {
      const f = store.frames.value;
      store.frames.value = {
        q: [...f.q.slice(0, e.from), ...e.q],
        error: [...f.error.slice(0, e.from), ...e.error],
      };
      return;
    }
    case "rollout.state":
      store.rollout.value = e;
      if (e.phase === "failed" && e.error) store.announcement.value = e.error;
      return;
    case "select": {
      const joints = store.doc.value?.clip.robot.joints ?? [];
      store.joint.value = e.joint === undefined ? undefined : Math.max(0, joints.indexOf(e.joint));
      store.site.value = e.site;
      return;
    }
    case "joint":
      // A drag in another page's 3D view is that page's to make an edit of.
      if (e.tab !== undefined && e.tab !== store.TAB) return;
      dragged(e.values, e.done);
      void jointMoved(e.values, e.done);
      return;
    case "joint.cancelled":
      if (e.tab === undefined || e.tab === store.TAB) dragCancelled();
      return;
    case "locked":
      store.locked.value = new Set(e.joints);
      return;
    case "notice":
      store.toast(e.message, e.level === "error" ? "error" : "info");
      return;
    case "takes":
      heardOfTakes(e);
      return;
    case "worker":
      heardOfWorker(e);
      return;
    case "job": {
      const before = store.jobs.value.get(e.id);
      store.jobs.value = new Map(store.jobs.value).set(e.id, { ...e, lines: [...(before?.lines ?? []), ...newLines(e, before)] });
      if (before?.phase !== e.phase && (e.phase === "done" || e.phase === "interrupted" || e.phase === "failed")) jobEnded(e);
    }
  }
}

/** An event of a job carries its newest line only; a first sight asks for the rest. */
function newLines(job: JobView, before: JobView | undefined): JobEvent[] {
  if (!job.last) return [];
  if (before && job.events === before.events) return [];
  if (before ? job.events > before.events + 1 : job.events > 1) void loadJob(job.id);
  return [job.last];
}

/** All lines of a job, for its curves. */
export async function loadJob(id: number): Promise<void> {
  try {
    const whole = await http<JobView>("GET", `/api/jobs/${id}?from=0`);
    store.jobs.value = new Map(store.jobs.value).set(id, whole);
  } catch (e) {
    complain(e);
  }
}

function jobEnded(job: JobView): void {
  document.dispatchEvent(new CustomEvent("robert-job-ended", { detail: job }));
  const what = job.title || job.kind;
  if (job.phase === "failed") store.toast(`${what}: ${job.log.filter((l) => l.startsWith("error")).at(-1) ?? "failed"}`, "error");
  else if (job.kind === "collect" || job.kind === "train" || job.kind === "eval" || job.kind === "import") {
    store.toast(job.phase === "done" ? `${what} is done` : `${what} stopped; it can go on`);
  }
  if (job.kind !== "render" && job.kind !== "export") void refreshShelf();
}

export async function refreshShelf(): Promise<void> {
  try {
    store.shelf.value = await http("GET", "/api/shelf");
    store.robots.value = await http("GET", "/api/robots");
  } catch (e) {
    complain(e);
  }
}

export async function startJob(kind: JobKind, args: string[]): Promise<JobView | undefined> {
  try {
    return await http<JobView>("POST", "/api/jobs", { kind, args });
  } catch (e) {
    complain(e);
    return undefined;
  }
}

/** Starts an export of the clip as it is performed now. */
export async function startExport(options: object): Promise<JobView | undefined> {
  try {
    const job = await http<JobView>("POST", "/api/exports", options);
    store.jobs.value = new Map(store.jobs.value).set(job.id, store.jobs.value.get(job.id) ?? job);
    return job;
  } catch (e) {
    complain(e);
    return undefined;
  }
}

export async function cancelJob(id: number): Promise<void> {
  try {
    await http("POST", `/api/jobs/${id}/cancel`);
  } catch (e) {
    complain(e);
  }
}

export async function resumeJob(id: number): Promise<void> {
  try {
    await http("POST", `/api/jobs/${id}/resume`);
  } catch (e) {
    complain(e);
  }
}

function heardOfWorker(state: WorkerState): void {
  const before = store.worker.value;
  store.worker.value = state;
  if (state.phase === "restarting") store.toast(`The simulation died and is starting again (${state.reason ?? "no reason given"}). Nothing was lost.`, "error");
  if (state.phase === "ready" && before?.phase === "restarting") store.announcement.value = "the simulation runs again";
}

function welcome(state: State): void {
  batch(() => {
    store.version.value = state.version;
    store.folder.value = state.folder;
    store.viser.value = state.viser;
    store.settings.value = state.rollout;
    store.policies.value = state.policies;
    store.worker.value = state.worker;
    store.locked.value = new Set(state.locked);
  });
  heardOfTakes(state.takes);
  adopt(state.document);
  void refreshGallery().then(rememberKilled);
  void refreshJobs();
}

let reminded = false;

/** Once: a clip that a killed studio left, when this one was started for something else. */
function rememberKilled(): void {
  const left = store.drafts.value.find((d) => d.abandoned);
  if (reminded || !left || !store.doc.value) return;
  reminded = true;
  store.toast(`"${left.name || "untitled"}" was open when the studio was killed; it waits under Examples, Unsaved`);
}

async function refreshJobs(): Promise<void> {
  try {
    const all = await http<JobView[]>("GET", "/api/jobs");
    store.jobs.value = new Map(all.map((j) => [j.id, j]));
    for (const j of all) if (j.events > 0 && j.kind !== "render" && j.kind !== "export") void loadJob(j.id);
  } catch (e) {
    complain(e);
  }
}

export async function refreshGallery(): Promise<void> {
  try {
    store.gallery.value = await http("GET", "/api/gallery");
    store.recent.value = await http("GET", "/api/recent");
    store.drafts.value = await http("GET", "/api/drafts");
  } catch (e) {
    complain(e);
  }
}

function adopt(d: DocumentView | null): void {
  const before = store.doc.value;
  batch(() => {
    store.doc.value = d ? { ...d, restored: d.restored?.edits ?? 0 } : undefined;
    if (!d) {
      store.page.value = "gallery";
      store.frames.value = { q: [], error: [] };
      store.rollout.value = undefined;
      return;
    }
    store.policies.value = d.policies;
    if (store.page.value === "gallery") store.page.value = "editor";
    // The same one again comes to who has fallen behind or was cut off.
    if (before?.opened !== d.opened || before.clip.robot.id !== d.clip.robot.id || d.rev < before.rev) forget();
    if (before && before.opened !== d.opened && store.locked.value.size) {
      store.locked.value = new Set();
      tell("view.lock", { joints: [] });
    }
  });
  if (d) void loadRobot(d.clip.robot.id);
}

/** What was chosen in one document means nothing in the next. */
function forget(): void {
  if (store.floating.value) dropFloating();
  store.playing.value = false;
  store.selection.value = new Set();
  store.playhead.value = 0;
  store.range.value = undefined;
  store.joint.value = undefined;
  store.site.value = undefined;
  store.frames.value = { q: [], error: [] };
  store.rollout.value = undefined;
  base = undefined;
  endPreview();
}

async function loadRobot(id: string): Promise<void> {
  if (store.robot.value?.id === id) return;
  try {
    store.robot.value = await http<RobotFacts>("GET", `/api/robot/${encodeURIComponent(id)}`);
  } catch (e) {
    complain(e);
  }
}

/** Opens from the server's side; the `document` event does the rest. */
export async function openWith(method: string, path: string, body?: unknown): Promise<void> {
  const left = store.doc.value;
  try {
    const opened = await http<DocumentView>(method, path, body);
    // The event of it came first, or is about to: it brings what follows from it, too. Another
    // document may even have been opened since, and stays.
    if ((store.doc.value?.opened ?? -1) < opened.opened) adopt(opened);
    store.page.value = "editor";
    if (left && !left.path && left.history.done > 0) store.toast(`"${left.clip.name || "untitled"}" was never saved; it waits under Examples, Unsaved`);
  } catch (e) {
    complain(e);
  }
}

/** The pose at the playhead: the key there, else what is commanded or achieved. */
export function poseAt(clip: Clip, frame: number): number[] {
  const d = store.doc.value;
  const rest = d?.table.rest ?? [];
  const key = clip.keys.find((k) => k.frame === frame);
  const achieved = store.frames.value.q[frame];
  const before = clip.keys.filter((k) => k.frame <= frame).at(-1) ?? clip.keys[0];
  const from = key ? values(clip, key) : (achieved ?? (before ? values(clip, before) : rest));
  return clip.robot.joints.map((_, j) => from[j] ?? achieved?.[j] ?? rest[j] ?? 0);
}

/** The pose that a drag began from: what its previews reach must not pull the other joints along. */
let base: { frame: number; rev: number; q: number[] } | undefined;

/** The edit that gives joints these values at the playhead. */
function poseEdit(changes: Record<string, number>): { op: string; args: object } | undefined {
  const d = store.doc.value;
  if (!d) return undefined;
  const frame = store.playhead.value;
  const key = d.clip.keys.find((k) => k.frame === frame);
  if (key) return { op: "keys.set", args: { frame, values: changes } };
  if (base?.frame !== frame || base.rev !== d.rev) base = { frame, rev: d.rev, q: poseAt(d.clip, frame) };
  const q = [...base.q];
  d.clip.robot.joints.forEach((name, j) => {
    const v = changes[name];
    if (v !== undefined) q[j] = v;
  });
  return { op: "keys.add", args: { keys: [{ frame, q }] } };
}

/**
 * A joint is being moved by a slider or in the viewport. While it moves the rollout follows as
 * a preview; when it is let go there is one edit. With auto-key off, and off a key, it is a
 * floating pose: shown, kept, and no key until the person says so.
 */
export async function jointMoved(changes: Record<string, number>, done: boolean): Promise<void> {
  const d = store.doc.value;
  if (!d) return;
  if (done && Object.keys(changes).length === 0) {
    // Taken and let go again.
    endPreview();
    return tell("preview.end");
  }
  const onKey = d.clip.keys.some((k) => k.frame === store.playhead.value);
  if (!onKey && !store.autoKey.value) {
    const q = store.floating.value ?? poseAt(d.clip, store.playhead.value);
    store.floating.value = d.clip.robot.joints.map((name, j) => changes[name] ?? q[j] ?? 0);
    tell("view.pose", { q: store.floating.value });
    return;
  }
  const e = poseEdit(changes);
  if (!e) return;
  if (done) {
    base = undefined;
    endPreview();
    await edit(e.op, e.args);
    tell("preview.end");
  }
  else preview(e);
}

let previewing = false;
let newest: object | undefined;
/** Rises when a drag ends: what its previews are answered with is no longer of interest. */
let asked = 0;

/** Sends previews no faster than they are answered; the newest wins. */
function preview(op: object): void {
  newest = op;
  if (previewing) return;
  previewing = true;
  const step = (): void => {
    const next = newest;
    newest = undefined;
    if (!next) {
      previewing = false;
      return;
    }
    const of = asked;
    void send("preview", { op: next }).then((r) => {
      if (of === asked) store.demand.value = (r.result as { demand?: Demand | null } | undefined)?.demand ?? undefined;
      step();
    });
  };
  step();
}

/** What waits to be previewed is out of date: an edit or its end follows. */
export function endPreview(): void {
  newest = undefined;
  asked++;
  store.demand.value = undefined;
}

export function previewEdit(op: string, args: object): void {
  preview({ op, args });
}

export async function keyFloating(): Promise<void> {
  const d = store.doc.value;
  const q = store.floating.value;
  if (!d || !q) return;
  const frame = store.playhead.value;
  const key = keyAt(d.clip, frame);
  const changes = key && changedBy(d.clip, key, q);
  const done = !changes ? await edit("keys.add", { keys: [{ frame, q }] })
    : Object.keys(changes).length === 0 || (await edit("keys.set", { frame, values: changes }));
  if (!done) return;
  dropFloating();
  store.selection.value = new Set([frame]);
}

export function dropFloating(): void {
  store.floating.value = undefined;
  tell("view.pose", { q: null });
}

export async function save(path?: string, replace = false): Promise<void> {
  try {
    await http("POST", "/api/save", path === undefined ? {} : { path, replace });
  } catch (e) {
    if (e instanceof Refusal && e.body.code === "exists" && path !== undefined) {
      document.dispatchEvent(new CustomEvent("robert-dialog", { detail: `replace:${path}` }));
      return;
    }
    if (e instanceof Refusal && e.body.code === "untitled") document.dispatchEvent(new CustomEvent("robert-save-as"));
    else complain(e);
  }
}
