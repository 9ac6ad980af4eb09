// A real server, a real browser, and the few gestures that all tests share. Tests wait for
// what they expect, never for a time, so that they pass on any machine.

import assert from "node:assert/strict";
import { type ChildProcess, spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { type Browser, type BrowserContext, chromium, type Page, test as plain } from "@playwright/test";
import type {} from "../src/clock";
import type { Snapshot } from "../src/testing";

let still: Browser | undefined;

/** A test with assertions of node; the browser of its worker is closed when the worker ends. */
export const test = plain.extend<object, { browsers: undefined }>({
  browsers: [
    async ({}, use) => {
      await use(undefined);
      await still?.close();
      still = undefined;
    },
    { scope: "worker", auto: true },
  ],
});
export const { describe, beforeAll: before, afterAll: after } = test;

const root = process.env.ROBERT_ROOT ?? join(process.cwd(), "..");

/** The program under test: ROBERT_BIN, else what cargo has built last. */
export function binary(): string {
  const named = process.env.ROBERT_BIN;
  if (named) return named;
  const built = ["debug", "release"].map((p) => join(root, "target", p, "robert")).find(existsSync);
  assert.ok(built, "no robert is built: cargo build");
  return built;
}

function browserPath(): string {
  const named = process.env.CHROMIUM;
  const known = [
    "/usr/bin/chromium",
    "/usr/bin/chromium-browser",
    "/usr/bin/google-chrome",
    "/usr/bin/google-chrome-stable",
  ];
  const found = named ?? known.find(existsSync);
  assert.ok(found, "no Chromium is installed: script/bootstrap --test, or name one in CHROMIUM");
  return found;
}

/** Where pictures of what was seen go, for people to look at. */
const PICTURES = process.env.ROBERT_SCREENSHOTS;

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

/** How long a condition may take on a crowded machine before it counts as never. */
const PATIENCE_MS = Number(process.env.ROBERT_PATIENCE_MS ?? 150_000);

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

/** A page with what tests do on it. */
export class Tab {
  /** Requests that left the origin: there must be none. */
  readonly foreign: string[] = [];
  readonly errors: string[] = [];
  /** Every error in the console, also those that a test provokes. */
  readonly console: string[] = [];
  actions = 0;

  constructor(
    readonly page: Page,
    readonly context: BrowserContext,
    readonly studio: Studio,
  ) {
    // Two cores draw, simulate and serve at once; what never comes is found by the test's end.
    page.setDefaultTimeout(PATIENCE_MS);
    page.on("pageerror", (e) => this.errors.push(e.message));
    // What a page's policy forbids is said in the console alone.
    page.on("console", (m) => {
      if (m.type() !== "error") return;
      this.console.push(m.text());
      if (/Content Security Policy/.test(m.text())) this.errors.push(m.text());
    });
    page.on("request", (r) => {
      const url = r.url();
      if (/^(data|blob|about):/.test(url)) return;
      if (!studio.origins.has(new URL(url).origin.replace(/^ws/, "http"))) this.foreign.push(url);
    });
  }

  async open(): Promise<this> {
    await this.page.goto(this.studio.url);
    await this.until((s) => s.link === "open", "connected");
    return this;
  }

  async state(): Promise<Snapshot> {
    return (await this.news("", PATIENCE_MS)).state;
  }

  /** The page's state as soon as it is another than that of this mark. */
  private async news(mark: string, ms: number): Promise<{ mark: string; state: Snapshot }> {
    const ask = () => this.page.evaluate(([m, t]) => window.__studio.after(m, t), [mark, ms] as const);
    try {
      return await ask();
    } catch {
      // The page was being loaded.
      await this.page.waitForFunction(() => "__studio" in window);
      return ask();
    }
  }

  /** Waits until the page's state is as it should be and drawn; looks at it whenever it changes. */
  async until(ok: (s: Snapshot) => boolean, what: string): Promise<Snapshot> {
    const end = Date.now() + PATIENCE_MS;
    for (let mark = ""; ; ) {
      const { mark: now, state } = await this.news(mark, Math.max(0, end - Date.now()));
      if (ok(state)) {
        // Fields of what was shown before still take what is typed.
        await this.painted();
        return state;
      }
      if (now === mark || Date.now() > end) {
        const { q: _q, error: _e, findings: _f, clip: _c, ...rest } = state;
        assert.fail(`not ${what}: ${JSON.stringify(rest)}`);
      }
      mark = now;
    }
  }

  /** The browser has drawn what the page last asked for. */
  async painted(): Promise<void> {
    const drawn = () =>
      this.page.evaluate(
        () => new Promise<void>((done) => requestAnimationFrame(() => requestAnimationFrame(() => done()))),
      );
    // A page that is being loaded again is drawn again, too.
    await drawn().catch(drawn);
  }

  /** The rollout of what is on the page is done. */
  rolledOut(): Promise<Snapshot> {
    return this.until(
      (s) => s.rollout?.rev === s.rev && (s.rollout?.phase === "done" || s.rollout?.phase === "failed"),
      "rolled out",
    );
  }

  byId(id: string) {
    return this.page.locator(`[data-testid="${id}"]`);
  }

  async click(id: string): Promise<void> {
    this.actions++;
    await this.byId(id).click();
  }

  async press(...keys: string[]): Promise<void> {
    for (const key of keys) {
      this.actions++;
      await this.page.keyboard.press(key);
    }
  }

  /** Puts a tab of the left panel in front. */
  async panel(of: "poses" | "policies" | "takes"): Promise<void> {
    await this.byId(`tab-${of}`).click();
    await this.byId(of).waitFor();
  }

  /** A point of the timeline in page coordinates. */
  async at(frame: number, row = "All joints"): Promise<{ x: number; y: number }> {
    const box = await this.byId("timeline").boundingBox();
    assert.ok(box);
    const [x, y] = await this.page.evaluate(
      ([f, r]) => [window.__studio.frameToX(f), window.__studio.rowToY(r)] as const,
      [frame, row] as const,
    );
    assert.ok(y !== undefined, `row ${row}`);
    return { x: box.x + x, y: box.y + y };
  }

  async clickKey(frame: number, modifiers: ("Shift" | "Control" | "Alt")[] = []): Promise<void> {
    const p = await this.at(frame);
    this.actions++;
    for (const m of modifiers) await this.page.keyboard.down(m);
    await this.page.mouse.click(p.x, p.y);
    for (const m of modifiers) await this.page.keyboard.up(m);
  }

  /** Presses at one frame, moves in steps, releases at another. */
  async drag(
    from: number,
    to: number,
    options: { hold?: string; row?: string; steps?: number; before?: () => Promise<void> } = {},
  ): Promise<void> {
    const a = await this.at(from, options.row);
    const b = await this.at(to, options.row);
    this.actions++;
    if (options.hold) await this.page.keyboard.down(options.hold);
    await this.page.mouse.move(a.x, a.y);
    await this.page.mouse.down();
    const n = options.steps ?? 6;
    for (let i = 1; i <= n; i++)
      await this.page.mouse.move(a.x + ((b.x - a.x) * i) / n, a.y + ((b.y - a.y) * i) / n);
    await options.before?.();
    await this.page.mouse.up();
    if (options.hold) await this.page.keyboard.up(options.hold);
  }

  /** Another document, as like the last one as may be; nothing has the focus, nothing is said. */
  async afresh(text = ARM): Promise<void> {
    await this.page.keyboard.press("Escape");
    await this.page.evaluate(() => window.__studio.dismissAll());
    const opened = (await this.studio.api("POST", "/api/new", { text })).json().opened as number;
    await this.until((s) => s.opened === opened, `document ${opened} is open`);
    // A slider that has the focus would take Home for itself.
    await this.page.evaluate(() => (document.activeElement as HTMLElement | null)?.blur());
  }

  async goTo(frame: number): Promise<void> {
    const field = this.byId("frame");
    await field.fill(String(frame));
    await field.press("Enter");
    await this.until((s) => s.playhead === frame, `at frame ${frame}`);
  }

  /** The frames of the keys. */
  async keys(): Promise<number[]> {
    return ((await this.state()).clip?.keys ?? []).map((k) => k.frame);
  }

  async until_keys(frames: number[]): Promise<void> {
    await this.until(
      (s) => JSON.stringify(s.clip?.keys.map((k) => k.frame)) === JSON.stringify(frames),
      `keys at ${frames.join(", ")}`,
    );
  }

  async picture(name: string): Promise<void> {
    if (PICTURES) await this.page.screenshot({ path: join(PICTURES, `${name}.png`) });
  }
}

/** One browser without WebGL for all tests that need no 3D view: the viewport is stills. */
export async function stillBrowser(): Promise<Browser> {
  still ??= await chromium.launch({
    executablePath: browserPath(),
    args: ["--no-sandbox", "--disable-background-networking", "--disable-gpu", "--disable-3d-apis"],
  });
  return still;
}

/** A page whose clock stands: messages stay until they are dismissed. `kept` is what the browser remembers
 * from the last visit. */
async function opened(
  context: BrowserContext,
  studio: Studio,
  kept: Record<string, string> = {},
): Promise<Tab> {
  await context.addInitScript(
    (items) => {
      window.__timers = [];
      for (const [name, value] of Object.entries(items)) localStorage.setItem(name, value);
      // The tour is shown to newcomers; its own test asks for it.
    },
    { tour: "shown", ...kept },
  );
  return new Tab(await context.newPage(), context, studio).open();
}

export async function tab(studio: Studio, size = { width: 1280, height: 720 }): Promise<Tab> {
  const context = await (await stillBrowser()).newContext({
    viewport: size,
    acceptDownloads: true,
    permissions: ["clipboard-read", "clipboard-write"],
  });
  return opened(context, studio);
}

/** A fresh browser with WebGL in software: a second page in one may wait for its frames. */
export async function webgl(
  studio: Studio,
  size = { width: 1280, height: 720 },
  kept: Record<string, string> = {},
): Promise<{ tab: Tab; close: () => Promise<void> }> {
  const browser = await chromium.launch({
    executablePath: browserPath(),
    args: [
      "--no-sandbox",
      "--disable-background-networking",
      "--use-angle=swiftshader",
      "--enable-unsafe-swiftshader",
    ],
  });
  const context = await browser.newContext({ viewport: size });
  const made = await opened(context, studio, kept);
  return { tab: made, close: () => browser.close() };
}

/** Waits until the 3D view has drawn three more pictures: two may have been under way. */
export async function drawn(t: Tab): Promise<void> {
  const frame = t.page.frames().find((f) => f.url().includes("/viser/"));
  assert.ok(frame, "the 3D view is there");
  const count = (): Promise<number> =>
    frame.evaluate(() => (window as any).__viserTestpoints?.rendererInfo?.render?.frame ?? 0);
  const from = await count();
  await eventually(async () => (await count()) >= from + 3, "the 3D view draws");
}

/** What the client of the 3D view knows. */
export async function viser<T, A = string>(
  t: Tab,
  ask: (viser: any, arg: A) => T,
  arg: A = "" as A,
): Promise<T> {
  const frame = t.page.frames().find((f) => f.url().includes("/viser/"));
  assert.ok(frame, "the 3D view is there");
  return frame.evaluate(`(${ask.toString()})(window.__viserMutable, ${JSON.stringify(arg)})`) as Promise<T>;
}

/** Three keys of the arm, the rest masked. */
export const ARM = JSON.stringify({
  format: "robert-clip/1",
  name: "arm",
  robot: { id: "ur5e", joints: ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2"] },
  fps: 20,
  length: 80,
  fill: "linear",
  keys: [
    { frame: 0, q: [-1.57, -1.57, 1.57, -1.57, -1.57] },
    { frame: 30, q: [-1.2, -1.4, 1.4, -1.5, -1.5] },
    { frame: 60, q: [-1.4, -1.5, 1.3, -1.4, -1.6] },
  ],
});

/** A clip opened with computed torque, which is fast in every build. */
export async function armTab(studio: Studio): Promise<Tab> {
  await studio.api("POST", "/api/new", { text: ARM });
  const t = await tab(studio);
  await t.until((s) => s.page === "editor" && s.clip?.name === "arm", "the arm open");
  await t.byId("policy").selectOption("computed-torque");
  await t.until((s) => s.settings.policy === "computed-torque", "the policy chosen");
  await t.rolledOut();
  return t;
}

/** For all tests of a group: a studio of their own, and a page with the arm open. */
export function onTheArm(begin: (studio: Studio, page: Tab) => void): void {
  let studio: Studio | undefined;
  before(async () => {
    studio = await Studio.start();
    begin(studio, await armTab(studio));
  });
  after(() => studio?.end());
}
