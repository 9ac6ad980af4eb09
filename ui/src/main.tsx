// The shell: which page, the editor's grid, banners, menus; and the hooks of browser tests.

import { render } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";
import "./app.css";
import { act, span } from "./actions";
import { ackTimes, connect, edit, http, tell } from "./api";
import { Curves } from "./curves";
import { Dialogs } from "./dialogs";
import { FileMenu } from "./filemenu";
import { Gallery } from "./gallery";
import { overLink } from "./hand";
import { Inspector } from "./inspector";
import { Menu } from "./menu";
import { DropZone } from "./intake";
import { Poses, Problems, Takes } from "./panels";
import { install } from "./shortcuts";
import type { Demand as DemandOf } from "./protocol";
import * as store from "./store";
import { setTheme } from "./theme";
import { Timeline, measured, testPoints } from "./timeline/timeline";
import { Transport } from "./transport";
import { Rendered } from "./rendered";
import { Runs } from "./runs";
import { restorePanels, Splitter } from "./splitter";
import { Viewport } from "./viewport";

const PAGES: [store.Page, string][] = [["gallery", "Examples"], ["editor", "Editor"], ["runs", "Training"]];

function Pages() {
  const running = [...store.jobs.value.values()].filter((j) => (j.kind === "collect" || j.kind === "train" || j.kind === "eval") && j.phase === "running").length;
  return (
    <nav class="pages" aria-label="Pages">
      {PAGES.map(([page, title]) => (
        <button key={page} class="quiet" aria-current={store.page.value === page ? "page" : undefined} disabled={page === "editor" && !store.doc.value} onClick={() => (store.page.value = page)} data-testid={`page-${page}`}>
          {title}{page === "runs" && running ? ` (${running})` : ""}
        </button>
      ))}
    </nav>
  );
}

function Brand() {
  return <span class="brand"><img src="/ui/icon.svg" width="18" height="18" alt="" /> RoBERT Studio</span>;
}

/** The clip's name, to be typed over, and its file. */
function Title() {
  const text = useSignal<string | undefined>(undefined);
  const field = useRef<HTMLInputElement>(null);
  const d = store.doc.value;
  useEffect(() => {
    const begin = (): void => {
      text.value = store.doc.value?.clip.name ?? "";
    };
    document.addEventListener("robert-rename", begin);
    return () => document.removeEventListener("robert-rename", begin);
  }, []);
  const typing = text.value !== undefined;
  useEffect(() => {
    if (typing) field.current?.select();
  }, [typing]);
  if (!d) return null;
  const done = (keep: boolean): void => {
    const name = text.value?.trim();
    text.value = undefined;
    if (keep && name !== undefined && name !== (d.clip.name ?? "")) void edit("clip.rename", { name });
  };
  const file = d.path?.split("/").at(-1);
  return typing ? (
    <input type="text" class="title" ref={field} aria-label="Name of the clip" data-testid="name" value={text.value}
      onInput={(e) => (text.value = e.currentTarget.value)} onBlur={() => done(true)}
      onKeyDown={(e) => { if (e.key === "Enter") done(true); if (e.key === "Escape") done(false); }} />
  ) : (
    <>
      <button class="quiet name" data-testid="title" title="Rename the clip (F2)" onClick={() => act("rename")}>{d.clip.name || "untitled"}{d.dirty ? " •" : ""}</button>
      {file ? <span class="of" title={d.path ?? ""}>{file}</span> : null}
    </>
  );
}

function Bar() {
  const d = store.doc.value;
  const h = d?.history;
  return (
    <header class="bar">
      <Brand />
      <Pages />
      <FileMenu />
      <Title />
      <span class="of">{store.robot.value?.title}</span>
      <span class="grow" />
      <button class="quiet" onClick={() => act("undo")} disabled={!h || h.done === 0} title={h && h.done > 0 ? `Undo: ${h.labels[h.done - h.first - 1] ?? ""} (Ctrl+Z)` : "Nothing to undo"} data-testid="undo">Undo</button>
      <button class="quiet" onClick={() => act("redo")} disabled={!h || h.done >= h.len} title={h && h.done < h.len ? `Redo: ${h.labels[h.done - h.first] ?? ""} (Ctrl+Shift+Z)` : "Nothing to redo"}>Redo</button>
      <button class="quiet" onClick={() => act("history")} disabled={!h || h.len === 0} title="Every edit by name">History</button>
      <button class="quiet" onClick={() => act("palette")} title="Ctrl+K">Commands</button>
      <button onClick={() => act("save")} disabled={!d?.dirty && !!d?.path} title="Ctrl+S" data-testid="save">Save</button>
      <button class="quiet" onClick={() => act("help")} title="Shortcuts (?)" aria-label="Shortcuts">?</button>
    </header>
  );
}

/** While the pointer is over a link. */
const LINK_HINTS: [string, string][] = [["drag", "turn its joint"], ["Alt", "reach"], ["Shift", "fine"], ["Esc", "give up"], ["click", "select"], ["F", "frame"], ["G", "next tip"], ["?", "all"]];
/** What keys and the mouse do now; M says which frames it means. */
function hints(): [string, string][] {
  const s = span();
  const mask = s ? `mask ${s.to - s.from === 1 ? s.from : `${s.from} to ${s.to - 1}`} (${s.why})` : "mask";
  return [["drag", "move"], ["Alt", "copy"], ["Shift", "ripple"], ["S", "retime"], ["K", "key"], ["Space", "play"], ["?", "all"], ["M", mask]];
}

/** What the edit under the hand asks of the joints: red above what the policy's data hold. */
function Demand({ of }: { of: DemandOf }) {
  const index = store.doc.value?.clip.robot.joints.indexOf(of.joint) ?? -1;
  const limit = Math.min(of.usual ?? Infinity, of.max ?? Infinity);
  const above = of.needed > limit;
  const unit = of.unit === "m" ? "m/s" : store.degrees.value ? "°/s" : "rad/s";
  const speed = (v: number): string => (of.unit === "rad" && store.degrees.value ? (v * 180 / Math.PI).toFixed(0) : v.toFixed(2));
  const what = of.max !== null && of.needed > of.max ? `the joint can do ${speed(of.max)}` : `the policy knows up to ${speed(of.usual ?? of.max ?? 0)}`;
  return <b class={`demand ${above ? "above" : ""}`} data-testid="demand">{above ? "too fast: " : ""}{store.titles.value[index] ?? of.joint} needs {speed(of.needed)} {unit}, {what}</b>;
}

function Hint({ text }: { text: string }) {
  const held = useSignal("");
  useEffect(() => {
    const on = (e: KeyboardEvent): void => {
      held.value = [e.ctrlKey || e.metaKey ? "Ctrl: add to the selection" : "", e.altKey ? "Alt: drag copies a key, pulls a fingertip" : "", e.shiftKey ? "Shift: drag ripples keys, turns links finely, arrows step 10" : ""].filter(Boolean).join(" · ");
    };
    window.addEventListener("keydown", on);
    window.addEventListener("keyup", on);
    return () => {
      window.removeEventListener("keydown", on);
      window.removeEventListener("keyup", on);
    };
  }, []);
  const d = store.doc.value;
  return (
    <footer class="hint">
      {store.demand.value ? <Demand of={store.demand.value} /> : null}
      {text || held.value ? <b>{text || held.value}</b> : (overLink.value && !store.stills.value ? LINK_HINTS : hints()).map(([k, t]) => <span key={k}><kbd>{k}</kbd> {t}</span>)}
      <span class="grow" />
      <span>{store.selection.value.size ? `${store.selection.value.size} selected` : ""}</span>
      <span>{!d ? "" : d.dirty ? "every edit is journalled; not saved to the file yet" : d.path ? "saved" : "not in a file yet"}</span>
      <span>{store.link.value === "open" ? "connected" : store.link.value}</span>
    </footer>
  );
}

/** Beside the timeline: curves, or the picture as it is exported. */
function Side() {
  const rendered = store.side.value === "rendered";
  return (
    <aside class="side" aria-label="Curves and picture">
      <Splitter of="curves" />
      <div class="tabs" role="tablist">
        <button role="tab" aria-selected={!rendered} onClick={() => (store.side.value = "curves")} data-testid="tab-curves">Curves</button>
        <button role="tab" aria-selected={rendered} onClick={() => (store.side.value = "rendered")} data-testid="tab-rendered">Rendered</button>
      </div>
      {rendered ? <Rendered /> : <Curves />}
    </aside>
  );
}

function Editor(props: { openKey: (frame: number) => void }) {
  const hint = useSignal("");
  return (
    <div class="editor" data-testid="editor">
      <Bar />
      <aside class="left"><Poses /><Takes /></aside>
      <Viewport />
      <aside class="right"><Inspector /><Problems /></aside>
      <Transport />
      <div class="below">
        <Timeline onOpenKey={props.openKey} onHint={(t) => (hint.value = t)} />
        <Side />
      </div>
      <Hint text={hint.value} />
    </div>
  );
}

function App() {
  const dialog = useSignal<string | undefined>(undefined);
  const keyFrame = useSignal<number | undefined>(undefined);
  const dismissed = useSignal(false);
  useEffect(() => {
    // `name:about`, where a dialog is about one thing.
    const open = (e: Event): void => void (dialog.value = (e as CustomEvent<string>).detail);
    const saveAs = (): void => void (dialog.value = "save-as");
    document.addEventListener("robert-dialog", open);
    document.addEventListener("robert-save-as", saveAs);
    return () => {
      document.removeEventListener("robert-dialog", open);
      document.removeEventListener("robert-save-as", saveAs);
    };
  }, []);
  const d = store.doc.value;
  return (
    <>
      {store.link.value === "refused" ? (
        <div class="banner" role="alert">This page has no access. Open the address that <code>robert studio</code> printed last, with its token.</div>
      ) : store.link.value === "moved" ? (
        <div class="banner" role="alert" data-testid="moved">Another studio runs here now: this page has no access to it. Nothing is lost, every acknowledged edit is on disk. Open the address that <code>robert studio</code> printed last, with its token.</div>
      ) : store.link.value === "lost" || store.link.value === "gone" ? (
        <div class="banner" role="alert" data-testid="gone">The studio is gone. Nothing is lost: every acknowledged edit is on disk. {store.link.value === "lost" ? "Reconnecting…" : <>Nobody answers here any more: start <code>robert studio</code> again and open the address that it prints.</>}</div>
      ) : store.worker.value?.phase === "stopped" ? (
        <div class="banner" role="alert" data-testid="worker-stopped">The simulation stopped: {store.worker.value.reason}. Editing goes on, nothing is lost.
          <button class="main" onClick={() => tell("worker.restart")}>Start it again</button>
        </div>
      ) : d && d.restored > 0 && !dismissed.value && store.page.value === "editor" ? (
        <div class="banner" role="status" data-testid="restored">Restored {d.restored} unsaved edit{d.restored === 1 ? "" : "s"}.
          <button onClick={() => (dismissed.value = true)}>Keep</button>
          <button onClick={() => void http("POST", "/api/discard").then(() => (dismissed.value = true))}>{d.path ? "Back to the saved file" : "Back to how it began"}</button>
        </div>
      ) : null}
      {store.page.value === "editor" && d ? <Editor openKey={(f) => (keyFrame.value = f)} /> : (
        <div class="front">
          <header class="bar"><Brand /><Pages /><span class="grow" /><button class="quiet" onClick={() => act("theme")}>Theme</button><span style="color: var(--dim)">{store.version.value}</span></header>
          {store.page.value === "runs" ? <Runs /> : <Gallery />}
        </div>
      )}
      <Dialogs name={dialog.value?.split(":")[0]} about={dialog.value?.split(":").slice(1).join(":")} frame={keyFrame.value} onClose={() => { dialog.value = undefined; keyFrame.value = undefined; }} />
      <Menu />
      <DropZone />
      <div class="toasts">
        {store.toasts.value.map((t) => (
          <div class={`toast ${t.kind}`} key={t.id} role={t.kind === "error" ? "alert" : "status"}>
            <span>{t.text}</span>
            {t.undo ? <button onClick={() => act("undo")}>Undo</button> : null}
            <button class="quiet" aria-label="Dismiss" onClick={() => store.dismiss(t.id)}>×</button>
          </div>
        ))}
      </div>
      <div class="offscreen" aria-live="polite">{store.announcement.value}</div>
    </>
  );
}

const theme = localStorage.getItem("theme");
if (theme === "dark" || theme === "light") setTheme(theme);
install(window);
restorePanels();
const root = document.getElementById("app");
if (root) render(<App />, root);
void connect();

/** For browser tests: a snapshot, a promise of quiet, and where things are on the canvas. */
Object.assign(window, {
  __studio: {
    get state() {
      return {
        page: store.page.value, link: store.link.value, opened: store.doc.value?.opened, rev: store.doc.value?.rev, clip: store.doc.value?.clip,
        dirty: store.doc.value?.dirty, playhead: store.playhead.value, selection: [...store.selection.value], site: store.site.value, locked: [...store.locked.value], moving: store.moving.value, demand: store.demand.value, floating: store.floating.value,
        rollout: store.rollout.value, frames: store.frames.value.q.length, joint: store.joint.value, playing: store.playing.value,
        history: store.doc.value?.history, findings: store.doc.value?.findings, settings: store.settings.value, view: store.view.value,
        robot: store.robot.value?.id, worker: store.worker.value, range: store.range.value, takes: store.takes.value, compared: store.compared.value, takeFrames: [...store.takeFrames.value.keys()],
        error: store.frames.value.error, q: store.frames.value.q,
      };
    },
    idle: async () => {
      for (let i = 0; i < 600; i++) {
        const r = store.rollout.value;
        const d = store.doc.value;
        if (!d || !store.settings.value.auto || (r && r.rev === d.rev && (r.phase === "done" || r.phase === "failed"))) return true;
        await new Promise((resolve) => setTimeout(resolve, 25));
      }
      return false;
    },
    ackTimes,
    redraw: () => measured.paint(),
    frameToX: (f: number) => testPoints().frameToX(f),
    rowToY: (name: string) => testPoints().rowToY(name),
  },
});
