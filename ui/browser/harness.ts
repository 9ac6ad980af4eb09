// A real server, a real browser, and the few gestures that all tests share. Tests wait for
// what they expect, never for a time, so that they pass on any machine.

import assert from "node:assert/strict";
import { existsSync, readFileSync } from "node:fs";
import { basename, join } from "node:path";
import { type Browser, type BrowserContext, chromium, type Page, test as plain } from "@playwright/test";
import type {} from "../src/clock";
import type { Snapshot } from "../src/testing";
import { eventually, PATIENCE_MS, Studio } from "./studio";

export { eventually, Studio };

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

  /** Where a part of the page is. */
  async box(id: string): Promise<{ x: number; y: number; width: number; height: number }> {
    const box = await this.byId(id).boundingBox();
    assert.ok(box, id);
    return box;
  }

  /** Where a value of a joint stands in the graph, in page coordinates. */
  async graphAt(frame: number, joint: number, value: number): Promise<{ x: number; y: number }> {
    const box = await this.box("graph");
    const [x, y] = await this.page.evaluate(
      ([f, j, v]) => [window.__studio.frameToX(f), window.__studio.graphY(j, v)] as const,
      [frame, joint, value] as const,
    );
    return { x: box.x + x, y: box.y + y };
  }

  /** A point of the timeline in page coordinates. */
  async at(frame: number, row = "All joints"): Promise<{ x: number; y: number }> {
    const box = await this.box("timeline");
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
    await this.blur();
  }

  /** Nothing has the focus: a slider that has it would take Home for itself. */
  async blur(): Promise<void> {
    await this.page.evaluate(() => (document.activeElement as HTMLElement | null)?.blur());
  }

  /** Shows these parts of the viewport, or hides them. */
  async toggle(...names: ("Command" | "Achieved" | "Ghosts")[]): Promise<void> {
    const legend = this.page.getByRole("group", { name: "Shown" });
    for (const name of names) await legend.getByRole("button", { name }).click();
  }

  /** To another page, until it is shown. */
  async turnTo(page: Snapshot["page"]): Promise<void> {
    await this.click(`page-${page}`);
    await this.until((s) => s.page === page, `on the page ${page}`);
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

/** A page that was built later than the program, so that the program need not be built for it. */
const PAGE = process.env.ROBERT_PAGE;

async function pageFrom(context: BrowserContext, folder: string): Promise<void> {
  await context.route(/\/ui\/app\.(js|css)$/, async (route) => {
    const { "content-length": _, ...headers } = (await route.fetch()).headers();
    const body = readFileSync(join(folder, basename(new URL(route.request().url()).pathname)));
    await route.fulfill({ headers, body });
  });
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
  if (PAGE) await pageFrom(context, PAGE);
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

/** The same in the 3D view, of any clip of the arm. */
export function inView(
  begin: (studio: Studio, page: Tab) => void,
  size = { width: 1100, height: 640 },
  text = ARM,
): void {
  let studio: Studio | undefined;
  let close: (() => Promise<void>) | undefined;
  before(async () => {
    studio = await Studio.start();
    await studio.api("POST", "/api/new", { text });
    const { tab: page, ...made } = await webgl(studio, size);
    close = made.close;
    await page.until((s) => s.clip?.name === JSON.parse(text).name, "the clip open");
    await page.byId("policy").selectOption("computed-torque");
    await page.until((s) => s.settings.policy === "computed-torque", "the policy chosen");
    await page.rolledOut();
    begin(studio, page);
  });
  after(async () => {
    await close?.();
    await studio?.end();
  });
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
