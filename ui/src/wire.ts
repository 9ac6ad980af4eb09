// The wire: one session cookie, requests, one socket. Every edit is a message: the page never
// changes the document by itself, it sends operations and draws what comes back.

import type { Args, Event, Failure, Op, Outcome, Request, Routes } from "./protocol";
import * as store from "./store";

let socket: WebSocket | undefined;
let nextId = 1;
const waiting = new Map<number, { resolve: (r: Reply) => void; edits: boolean }>();

export interface Reply {
  ok: boolean;
  result?: Outcome;
  error?: Failure;
}

export class Refusal extends Error {
  constructor(
    readonly body: Failure,
    readonly status: number,
  ) {
    super(body.message);
  }
}

type Route = keyof Routes;

/** Names in braces in an address. */
type Places<Address extends string> = Address extends `${string}{${infer Name}}${infer Rest}`
  ? Name | Places<Rest>
  : never;

/** Where a request goes: what stands in its address and after it. */
type Aimed<R extends Route> = ([Places<R>] extends [never]
  ? object
  : { at: Record<Places<R>, string | number> }) &
  (Routes[R] extends { query: infer Query } ? { query: Query } : object);

/** All that a request takes. */
type Given<R extends Route> = Aimed<R> & (Routes[R] extends { body: infer Body } ? { body: Body } : object);

/** Nothing where nothing must be given. */
type Rest<T> = Record<string, never> extends T ? [given?: T] : [given: T];

/** The address of a request; of a GET it can be the source of a picture. */
export function addressOf<R extends Route>(route: R, ...[given]: Rest<Aimed<R>>): string {
  const { at, query } = (given ?? {}) as { at?: Record<string, string | number>; query?: object };
  const path = route
    .replace(/^\w+ /, "")
    .replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(String(at?.[name])));
  const asked = Object.entries(query ?? {}).filter(([, value]) => value !== undefined && value !== null);
  const text = new URLSearchParams(asked.map(([name, value]) => [name, String(value)])).toString();
  return text ? `${path}?${text}` : path;
}

export async function http<R extends Route>(
  route: R,
  ...[given]: Rest<Given<R>>
): Promise<Routes[R]["answer"]> {
  const answer = await requested(route, ...([given] as Rest<Given<R>>));
  const kind = answer.headers.get("content-type") ?? "";
  if (answer.status === 204) return undefined as Routes[R]["answer"];
  return kind.startsWith("application/json")
    ? answer.json()
    : (answer.blob() as Promise<Routes[R]["answer"]>);
}

/** A file of the studio, whatever it contains. */
export async function httpFile<R extends Route>(route: R, ...[given]: Rest<Given<R>>): Promise<Blob> {
  return (await requested(route, ...([given] as Rest<Given<R>>))).blob();
}

async function requested<R extends Route>(route: R, ...[given]: Rest<Given<R>>): Promise<Response> {
  const { body } = (given ?? {}) as { body?: string | Blob | object };
  const init: RequestInit = { method: route.split(" ")[0] ?? "GET", credentials: "same-origin" };
  if (body instanceof Blob) {
    init.body = body;
  } else if (typeof body === "string") {
    init.body = body;
    init.headers = { "content-type": "text/plain" };
  } else if (body !== undefined) {
    init.body = JSON.stringify(body);
    init.headers = { "content-type": "application/json" };
  }
  const answer = await fetch(addressOf(route, ...([given] as Rest<Aimed<R>>)), init);
  if (!answer.ok) throw await refusal(answer);
  return answer;
}

async function refusal(answer: Response): Promise<Refusal> {
  const text = await answer.text();
  try {
    return new Refusal(JSON.parse(text) as Failure, answer.status);
  } catch {
    // Not every refusal comes from a handler.
    return new Refusal({ code: "failed", message: text || answer.statusText }, answer.status);
  }
}

/** Says what went wrong, with the place, as the command line would. */
export function complain(e: unknown): void {
  if (e instanceof Refusal)
    store.toast(e.body.mend ? `${e.body.message} (${e.body.mend})` : e.body.message, "error");
  else store.toast(e instanceof Error ? e.message : String(e), "error");
}

/** Trades the token in the URL for a cookie and forgets it. */
async function session(): Promise<void> {
  const token = /token=([0-9a-f]+)/i.exec(location.hash)?.[1];
  if (!token) return;
  const answer = await fetch("/api/session", {
    method: "POST",
    headers: { authorization: `Bearer ${token}` },
  });
  if (answer.ok) history.replaceState(null, "", location.pathname + location.search);
}

/** Lets the page in and keeps a socket open; `hear` is told what the studio says. */
export async function connect(hear: (event: Event) => void): Promise<void> {
  try {
    await session();
  } catch {
    // The socket's own reconnect says so.
  }
  // The address of a studio that was started anew differs in its token only: no new page is loaded.
  window.addEventListener("hashchange", () => void session().catch(() => undefined));
  open(hear);
}

function open(hear: (event: Event) => void): void {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const ws = new WebSocket(`${scheme}://${location.host}/api/ws`);
  socket = ws;
  let greeted = false;
  ws.onmessage = (m) => {
    greeted = true;
    hear(JSON.parse(String(m.data)) as Event);
  };
  ws.onclose = () => {
    for (const w of waiting.values())
      w.resolve({ ok: false, error: { code: "lost", message: "the studio has stopped" } });
    waiting.clear();
    failures = greeted ? 0 : failures + 1;
    known ||= greeted;
    void answer().then((there) => {
      if (socket !== ws) return;
      store.link.value = there ? (known ? "moved" : "refused") : failures < PATIENCE ? "lost" : "gone";
      setTimeout(() => open(hear), 1000);
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
    const { status } = await fetch("/api/state", {
      method: "HEAD",
      credentials: "same-origin",
      signal: AbortSignal.timeout(5000),
    });
    return status === 401 || status === 403;
  } catch {
    return false;
  }
}

function send(request: Request, edits = false): Promise<Reply> {
  const ws = socket;
  if (!ws || ws.readyState !== WebSocket.OPEN) {
    return Promise.resolve({
      ok: false,
      error: { code: "lost", message: "not connected: the edit was not made" },
    });
  }
  const id = nextId++;
  return new Promise((resolve) => {
    waiting.set(id, { resolve, edits });
    ws.send(JSON.stringify({ id, ...request }));
  });
}

const requestOf = <Name extends Request["op"]>(op: Name, args: Args<Name> | undefined): Request =>
  ({ op, args: args ?? {} }) as Request;

/** An edit. Resolves when it is on the server's disk; refusals are shown. */
export async function applyOp(op: Op): Promise<boolean> {
  const reply = await send(op, true);
  if (reply.error) complain(new Refusal(reply.error, 422));
  return reply.ok;
}

/** Several edits that count as one; undefined for none. */
export function asOne(ops: Op[], label: string): Op | undefined {
  return ops.length < 2 ? ops[0] : { op: "batch", args: { label, ops } };
}

/** An edit by its name. */
export function edit<Name extends Op["op"]>(op: Name, args: Args<Name>): Promise<boolean> {
  return applyOp({ op, args } as Op);
}

/** Tells the server something that is no edit; silence is success. */
export function tell<Name extends Request["op"]>(op: Name, ...[args]: Rest<Args<Name>>): void {
  void send(requestOf(op, args)).then((r) => {
    if (r.error && r.error.code !== "lost") complain(new Refusal(r.error, 422));
  });
}

/** Asks for something that is no edit. */
export function ask<Name extends Request["op"]>(op: Name, ...[args]: Rest<Args<Name>>): Promise<Reply> {
  return send(requestOf(op, args));
}

/** The answer to the request of this number has come. */
export function settle(id: number | undefined, reply: Reply): void {
  const w = id === undefined ? undefined : waiting.get(id);
  if (!w || id === undefined) {
    // An edit that was refused after a document had come whole.
    if (reply.error) complain(new Refusal(reply.error, 422));
    return;
  }
  waiting.delete(id);
  w.resolve(reply);
}

/** A document that comes whole has all edits in it that were under way. Other requests get their own answers. */
export function settleEdits(): void {
  for (const [id, w] of [...waiting]) if (w.edits) settle(id, { ok: true });
}
