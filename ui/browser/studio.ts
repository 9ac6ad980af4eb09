// The program under test as a server, and how to wait for it.

import assert from "node:assert/strict";
import { type ChildProcess, spawn, spawnSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

const root = process.env.ROBERT_ROOT ?? join(process.cwd(), "..");

/** The program under test: ROBERT_BIN, else what cargo has built last. */
function binary(): string {
  const named = process.env.ROBERT_BIN;
  if (named) return named;
  const built = ["debug", "release"].map((p) => join(root, "target", p, "robert")).find(existsSync);
  assert.ok(built, "no robert is built: cargo build");
  return built;
}

/** How long a condition may take on a crowded machine before it counts as never. */
export const PATIENCE_MS = Number(process.env.ROBERT_PATIENCE_MS ?? 150_000);

/** Asks until there is an answer. */
export async function eventually<T>(ask: () => Promise<T | undefined | false>, what: string): Promise<T> {
  const end = Date.now() + PATIENCE_MS;
  for (;;) {
    const found = await ask().catch(() => undefined);
    if (found) return found;
    assert.ok(Date.now() < end, `never: ${what}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

export class Studio {
  private child: ChildProcess | undefined;
  url = "";

  private constructor(
    readonly dir: string,
    private readonly args: string[],
  ) {}

  /** Where it was reached since it began: a page may still ask at the address before a restart. */
  readonly origins = new Set<string>();

  static async start(
    args: string[] = [],
    dir = mkdtempSync(join(tmpdir(), "robert-browser-")),
  ): Promise<Studio> {
    const studio = new Studio(dir, args);
    await studio.run();
    return studio;
  }

  async run(port = 0): Promise<void> {
    const child = spawn(binary(), ["studio", "--no-open", "--port", String(port), ...this.args], {
      cwd: this.dir,
      env: { ...process.env, ROBERT_STATE_DIR: join(this.dir, "state"), NO_COLOR: "1" },
      stdio: ["ignore", "pipe", "inherit"],
    });
    this.child = child;
    this.url = await new Promise<string>((resolve, reject) => {
      let text = "";
      child.stdout.on("data", (d: Buffer) => {
        text += d.toString();
        if (text.includes("\n")) resolve(text.trim());
      });
      child.on("exit", (code) => reject(new Error(`the studio ended with ${code}`)));
    });
    // A test that waits for a page cannot tell that the studio is gone, nor how it ended.
    child.on("exit", (code, signal) => {
      if (!child.killed)
        console.error(`the studio at ${this.url} ended by itself: ${signal ?? `code ${code}`}`);
    });
    this.origins.add(new URL(this.url).origin);
  }

  get token(): string {
    return this.url.split("token=")[1] ?? "";
  }

  /** A request beside the browser, as a script makes it. */
  async api(
    method: string,
    path: string,
    body?: unknown,
  ): Promise<{ status: number; json: () => any; bytes: Buffer }> {
    const answer = await fetch(new URL(path, this.url), {
      method,
      headers: { authorization: `Bearer ${this.token}`, "content-type": "application/json" },
      ...(body === undefined ? {} : { body: JSON.stringify(body) }),
    });
    const bytes = Buffer.from(await answer.arrayBuffer());
    return { status: answer.status, bytes, json: () => JSON.parse(bytes.toString()) };
  }

  /** A job when it has ended. */
  ended(id: number): Promise<{ phase: string; log: string[] }> {
    return eventually(async () => {
      const job = (await this.api("GET", `/api/jobs/${id}`)).json();
      return job.phase !== "running" && job;
    }, `job ${id} ends`);
  }

  /** As a power cut would. */
  async kill(): Promise<void> {
    const child = this.child;
    if (!child || child.exitCode !== null || child.signalCode !== null) return;
    const gone = new Promise((resolve) => child.on("exit", resolve));
    child.kill("SIGKILL");
    await gone;
  }

  async end(): Promise<void> {
    await this.kill();
    rmSync(this.dir, { recursive: true, force: true });
  }

  /** Runs the program in its folder, as in a shell. */
  shell(...args: string[]): { code: number; out: string; err: string } {
    const ran = spawnSync(binary(), args, {
      cwd: this.dir,
      encoding: "utf8",
      env: { ...process.env, NO_COLOR: "1" },
    });
    return { code: ran.status ?? -1, out: ran.stdout, err: ran.stderr };
  }

  file(name: string, text?: string): string {
    const path = join(this.dir, name);
    if (text !== undefined) {
      mkdirSync(join(path, ".."), { recursive: true });
      writeFileSync(path, text);
    }
    return path;
  }

  read(name: string): Buffer {
    return readFileSync(join(this.dir, name));
  }
}
