// The shell: which page, the editor's grid, banners, menus; and the hooks of browser tests.

import { render } from "preact";
import { useEffect, useLayoutEffect } from "preact/hooks";
import { useSignal } from "@preact/signals";
import "./app.css";
import { act, setFill, chosenJoint, noJointMask } from "./actions";
import { ackTimes, connect, http, tell } from "./api";
import { Curves } from "./curves";
import { Dialogs } from "./dialogs";
import { Gallery } from "./gallery";
import { overLink } from "./hand";
import { Inspector } from "./inspector";
import { Poses, Problems, Takes } from "./panels";
import { install } from "./shortcuts";
import type { Demand as DemandOf } from "./protocol";
import * as store from "./store";
import { setTheme } from "./theme";
import { Timeline, testPoints, type Menu } from "./timeline/timeline";
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

function Bar() {
  const d = store.doc.value;
  const name = d?.path?.split("/").at(-1) ?? d?.clip.name ?? "";
  const h = d?.history;
  return (
    <header class="bar">
      <Brand />
      <Pages />
      <span class="name" data-testid="title">{name}{d?.dirty ? " •" : ""}</span>
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
const HINTS: [string, string][] = [["drag", "move"], ["Alt", "copy"], ["Shift", "ripple"], ["S", "retime"], ["M", "mask"], ["K", "key"], ["Space", "play"], ["?", "all"]];

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
      {text || held.value ? <b>{text || held.value}</b> : (overLink.value && !store.stills.value ? LINK_HINTS : HINTS).map(([k, t]) => <span key={k}><kbd>{k}</kbd> {t}</span>)}
      <span class="grow" />
      <span>{store.selection.value.size ? `${store.selection.value.size} selected` : ""}</span>
      <span>{!d ? "" : d.dirty ? "every edit is journalled; not saved to the file yet" : d.path ? "saved" : "not in a file yet"}</span>
      <span>{store.link.value === "open" ? "connected" : store.link.value}</span>
    </footer>
  );
}

function ContextMenu({ menu, onClose, onOpenKey }: { menu: Menu; onClose: () => void; onOpenKey: (frame: number) => void }) {
  const item = (title: string, keys: string, run: () => void, why?: string | null) => (
    <button role="menuitem" disabled={!!why} title={why ?? ""} onClick={() => { onClose(); run(); }}>{title}<span style="color: var(--dim)">{keys}</span></button>
  );
  // Before it is seen: the next key may come at once.
  useLayoutEffect(() => {
    const close = (e: Event): void => {
      if (!(e.target instanceof Element) || !e.target.closest(".menu")) onClose();
    };
    const key = (e: KeyboardEvent): void => {
      if (e.key === "Escape") onClose();
    };
    window.addEventListener("pointerdown", close, true);
    window.addEventListener("keydown", key, true);
    return () => {
      window.removeEventListener("pointerdown", close, true);
      window.removeEventListener("keydown", key, true);
    };
  }, []);
  const { key } = menu;
  const joint = chosenJoint();
  const left = Math.min(menu.x, innerWidth - 230);
  const top = Math.min(menu.y, innerHeight - 330);
  return (
    <div class="menu" role="menu" style={`left: ${left}px; top: ${top}px`}>
      {key === undefined ? (
        <>
          {item("Key here", "K", () => act("key"))}
          {item("Mask: no goal here", "M", () => act("mask"))}
          {item(`Mask ${joint ?? "one joint"} only`, "Alt+M", () => act("mask-joint"), joint ? noJointMask() : "choose a joint first")}
          {item("Unmask", "U", () => act("unmask"))}
          {item(`Unmask ${joint ?? "one joint"} only`, "Alt+U", () => act("unmask-joint"), joint ? null : "choose a joint first")}
          {item(joint && store.locked.value.has(joint) ? `Free ${joint}` : `Lock ${joint ?? "one joint"}`, "Alt+L", () => act("lock-joint"), joint ? null : "choose a joint first")}
          {item("Paste", "Ctrl+V", () => act("paste"))}
          {item("Insert or remove time…", "E", () => act("ripple-right"))}
          {item("Marker here…", "Shift+M", () => act("marker"))}
        </>
      ) : (
        <>
          {item("Type values…", "double-click", () => onOpenKey(key))}
          {item("Hold…", "H", () => act("hold"))}
          {item("Leave to the policy until the next key", "", () => setFill("mask"))}
          {item("Straight line to the next key", "", () => setFill("linear"))}
          {item("Smooth curve to the next key", "", () => setFill("cubic"))}
          {item("Copy", "Ctrl+C", () => act("copy"))}
          {item("Mirror", "", () => act("mirror"), store.noMirror.value)}
          {item("Save as pose…", "P", () => { store.playhead.value = key; act("save-pose"); })}
          {item("Marker here…", "Shift+M", () => { store.playhead.value = key; act("marker"); })}
          {item("Delete", "X", () => act("delete"))}
        </>
      )}
    </div>
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
  const menu = useSignal<Menu | undefined>(undefined);
  const hint = useSignal("");
  return (
    <div class="editor" data-testid="editor">
      <Bar />
      <aside class="left"><Poses /><Takes /></aside>
      <Viewport />
      <aside class="right"><Inspector /><Problems /></aside>
      <Transport />
      <div class="below">
        <Timeline onMenu={(m) => (menu.value = m)} onOpenKey={props.openKey} onHint={(t) => (hint.value = t)} />
        <Side />
      </div>
      <Hint text={hint.value} />
      {menu.value ? <ContextMenu menu={menu.value} onClose={() => (menu.value = undefined)} onOpenKey={props.openKey} /> : null}
    </div>
  );
}

function App() {
  const dialog = useSignal<string | undefined>(undefined);
  const keyFrame = useSignal<number | undefined>(undefined);
  const dismissed = useSignal(false);
  useEffect(() => {
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
        <div class="banner" role="alert">This page has no access. Open the address that <code>robert studio</code> printed, with its token.</div>
      ) : store.link.value === "lost" ? (
        <div class="banner" role="alert">The studio is gone. Nothing is lost: every acknowledged edit is on disk. Reconnecting…</div>
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
      <Dialogs name={dialog.value} frame={keyFrame.value} onClose={() => { dialog.value = undefined; keyFrame.value = undefined; }} />
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
        page: store.page.value, link: store.link.value, rev: store.doc.value?.rev, clip: store.doc.value?.clip,
        dirty: store.doc.value?.dirty, playhead: store.playhead.value, selection: [...store.selection.value], site: store.site.value, locked: [...store.locked.value], moving: store.moving.value, demand: store.demand.value, floating: store.floating.value,
        rollout: store.rollout.value, frames: store.frames.value.q.length, joint: store.joint.value, playing: store.playing.value,
        history: store.doc.value?.history, findings: store.doc.value?.findings, settings: store.settings.value, view: store.view.value,
        robot: store.robot.value?.id, worker: store.worker.value, range: store.range.value, takes: store.takes.value.length,
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
    frameToX: (f: number) => testPoints().frameToX(f),
    rowToY: (name: string) => testPoints().rowToY(name),
  },
});
