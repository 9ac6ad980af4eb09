// The shell: which page, the editor's grid, banners, menus.

import { useSignal } from "@preact/signals";
import { render } from "preact";
import { useEffect, useRef } from "preact/hooks";
import "./styles/base.css";
import "./styles/editor.css";
import "./styles/training.css";
import "./styles/panels.css";
import "./styles/dialogs.css";
import "./styles/controls.css";
import "./styles/sizes.css";
import { act } from "./actions/index";
import { span } from "./actions/masks";
import { DropZone } from "./clip_import";
import { Curves } from "./curves";
import { Dialogs } from "./dialogs";
import { receive } from "./events";
import { FileMenu } from "./filemenu";
import { Gallery } from "./gallery";
import { overLink } from "./hover";
import { Inspector } from "./inspector";
import { Menu } from "./menu";
import { Poses, Problems, Takes } from "./panels";
import type { Demand as DemandOf } from "./protocol";
import { Rendered } from "./rendered";
import { install } from "./shortcuts";
import { restorePanels, Splitter } from "./splitter";
import * as store from "./store";
import { publish } from "./testing";
import { setTheme } from "./theme";
import { Timeline } from "./timeline/timeline";
import { Runs } from "./training_page";
import { Transport } from "./transport";
import { Viewport } from "./viewport";
import { connect, edit, http, tell } from "./wire";

const PAGES: [store.Page, string][] = [
  ["gallery", "Examples"],
  ["editor", "Editor"],
  ["runs", "Training"],
];

function Pages() {
  const running = [...store.jobs.value.values()].filter(
    (j) => (j.kind === "collect" || j.kind === "train" || j.kind === "eval") && j.phase === "running",
  ).length;
  return (
    <nav class="pages" aria-label="Pages">
      {PAGES.map(([page, title]) => (
        <button
          key={page}
          class="quiet"
          aria-current={store.page.value === page ? "page" : undefined}
          disabled={page === "editor" && !store.doc.value}
          onClick={() => (store.page.value = page)}
          data-testid={`page-${page}`}
        >
          {title}
          {page === "runs" && running ? ` (${running})` : ""}
        </button>
      ))}
    </nav>
  );
}

function Brand() {
  return (
    <span class="brand">
      <img src="/ui/icon.svg" width="18" height="18" alt="" /> RoBERT Studio
    </span>
  );
}

/** The clip's name, to be typed over, and its file. */
function Title() {
  const field = useRef<HTMLInputElement>(null);
  const d = store.doc.value;
  const typing = store.renaming.value;
  useEffect(() => {
    if (typing) field.current?.select();
  }, [typing]);
  if (!d) return null;
  const done = (keep: boolean): void => {
    const name = field.current?.value.trim();
    // Leaving the field by Enter leaves it a second time when it goes.
    if (!store.renaming.value) return;
    store.renaming.value = false;
    if (keep && name !== undefined && name !== (d.clip.name ?? "")) void edit("clip.rename", { name });
  };
  const file = d.path?.split("/").at(-1);
  return typing ? (
    <input
      type="text"
      class="title"
      ref={field}
      aria-label="Name of the clip"
      data-testid="name"
      defaultValue={d.clip.name ?? ""}
      onBlur={() => done(true)}
      onKeyDown={(e) => {
        if (e.key === "Enter") done(true);
        if (e.key === "Escape") done(false);
      }}
    />
  ) : (
    <>
      <button
        class="quiet name"
        data-testid="title"
        title="Rename the clip (F2)"
        onClick={() => act("rename")}
      >
        {d.clip.name || "untitled"}
        {d.dirty ? " •" : ""}
      </button>
      {file ? (
        <span class="of" title={d.path ?? ""}>
          {file}
        </span>
      ) : null}
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
      <button
        class="quiet"
        onClick={() => act("undo")}
        disabled={!h || h.done === 0}
        title={h && h.done > 0 ? `Undo: ${h.labels[h.done - h.first - 1] ?? ""} (Ctrl+Z)` : "Nothing to undo"}
        data-testid="undo"
      >
        Undo
      </button>
      <button
        class="quiet"
        onClick={() => act("redo")}
        disabled={!h || h.done >= h.len}
        title={
          h && h.done < h.len ? `Redo: ${h.labels[h.done - h.first] ?? ""} (Ctrl+Shift+Z)` : "Nothing to redo"
        }
      >
        Redo
      </button>
      <button
        class="quiet"
        onClick={() => act("history")}
        disabled={!h || h.len === 0}
        title="List of all edits"
      >
        History
      </button>
      <button class="quiet" onClick={() => act("palette")} title="Ctrl+K">
        Commands
      </button>
      <button onClick={() => act("save")} disabled={!d?.dirty && !!d?.path} title="Ctrl+S" data-testid="save">
        Save
      </button>
      <button class="quiet" onClick={() => act("help")} title="Shortcuts (?)" aria-label="Shortcuts">
        ?
      </button>
    </header>
  );
}

/** While the pointer is over a link. */
const LINK_HINTS: [string, string][] = [
  ["drag", "turn its joint"],
  ["Alt", "reach"],
  ["Shift", "small steps"],
  ["Esc", "cancel"],
  ["click", "select"],
  ["F", "show it"],
  ["G", "next fingertip"],
  ["?", "all shortcuts"],
];
/** What keys and the mouse do now; M says which frames it means. */
function hints(): [string, string][] {
  const s = span();
  const mask = s ? `mask ${s.to - s.from === 1 ? s.from : `${s.from} to ${s.to - 1}`} (${s.why})` : "mask";
  return [
    ["drag", "move"],
    ["Alt", "copy"],
    ["Shift", "move later keys too"],
    ["S", "retime"],
    ["K", "key"],
    ["Space", "play"],
    ["?", "all shortcuts"],
    ["M", mask],
  ];
}

/** What the edit under the hand asks of the joints: red above what the policy's data hold. */
function Demand({ of }: { of: DemandOf }) {
  const index = store.doc.value?.clip.robot.joints.indexOf(of.joint) ?? -1;
  const limit = Math.min(of.usual ?? Infinity, of.max ?? Infinity);
  const above = of.needed > limit;
  const unit = of.unit === "m" ? "m/s" : store.degrees.value ? "°/s" : "rad/s";
  const speed = (v: number): string =>
    of.unit === "rad" && store.degrees.value ? ((v * 180) / Math.PI).toFixed(0) : v.toFixed(2);
  const what =
    of.max !== null && of.needed > of.max
      ? `the limit of the joint is ${speed(of.max)}`
      : `the policy was trained up to ${speed(of.usual ?? of.max ?? 0)}`;
  return (
    <b class={`demand ${above ? "above" : ""}`} data-testid="demand">
      {above ? "too fast: " : ""}
      {store.titles.value[index] ?? of.joint} needs {speed(of.needed)} {unit}, {what}
    </b>
  );
}

function Hint({ text }: { text: string }) {
  const held = useSignal("");
  useEffect(() => {
    const on = (e: KeyboardEvent): void => {
      held.value = [
        e.ctrlKey || e.metaKey ? "Ctrl: add to the selection" : "",
        e.altKey ? "Alt: drag to copy a key or to pull a fingertip" : "",
        e.shiftKey
          ? "Shift: drag to move all later keys too or to turn a link in small steps; arrow keys step 10 frames"
          : "",
      ]
        .filter(Boolean)
        .join(" · ");
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
      {text || held.value ? (
        <b>{text || held.value}</b>
      ) : (
        (overLink.value && !store.stills.value ? LINK_HINTS : hints()).map(([k, t]) => (
          <span key={k}>
            <kbd>{k}</kbd> {t}
          </span>
        ))
      )}
      <span class="grow" />
      <span>{store.selection.value.size ? `${store.selection.value.size} selected` : ""}</span>
      <span>
        {!d
          ? ""
          : d.dirty
            ? "every edit is backed up; not saved to the file yet"
            : d.path
              ? "saved"
              : "not saved to a file yet"}
      </span>
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
        <button
          role="tab"
          aria-selected={!rendered}
          onClick={() => (store.side.value = "curves")}
          data-testid="tab-curves"
        >
          Curves
        </button>
        <button
          role="tab"
          aria-selected={rendered}
          onClick={() => (store.side.value = "rendered")}
          data-testid="tab-rendered"
        >
          Rendered
        </button>
      </div>
      {rendered ? <Rendered /> : <Curves />}
    </aside>
  );
}

function Editor() {
  const hint = useSignal("");
  return (
    <div class="editor" data-testid="editor">
      <Bar />
      <aside class="left">
        <Poses />
        <Takes />
      </aside>
      <Viewport />
      <aside class="right">
        <Inspector />
        <Problems />
      </aside>
      <Transport />
      <div class="below">
        <Timeline onHint={(t) => (hint.value = t)} />
        <Side />
      </div>
      <Hint text={hint.value} />
    </div>
  );
}

function App() {
  const dismissed = useSignal(false);
  const d = store.doc.value;
  return (
    <>
      {store.link.value === "refused" ? (
        <div class="banner" role="alert">
          This page has no access. Open the address that <code>robert studio</code> printed last, with its
          token.
        </div>
      ) : store.link.value === "moved" ? (
        <div class="banner" role="alert" data-testid="moved">
          Another studio is running at this address, and this page has no access to it. Nothing is lost: every
          confirmed edit is on disk. Open the address that <code>robert studio</code> printed last, with its
          token.
        </div>
      ) : store.link.value === "lost" || store.link.value === "gone" ? (
        <div class="banner" role="alert" data-testid="gone">
          The studio has stopped. Nothing is lost: every confirmed edit is on disk.{" "}
          {store.link.value === "lost" ? (
            "Reconnecting…"
          ) : (
            <>
              Nothing answers at this address: start <code>robert studio</code> again and open the address
              that it prints.
            </>
          )}
        </div>
      ) : store.worker.value?.phase === "stopped" ? (
        <div class="banner" role="alert" data-testid="worker-stopped">
          The simulation stopped: {store.worker.value.reason}. You can go on editing; nothing is lost.
          <button class="main" onClick={() => tell("worker.restart")}>
            Start it again
          </button>
        </div>
      ) : d && d.restored > 0 && !dismissed.value && store.page.value === "editor" ? (
        <div class="banner" role="status" data-testid="restored">
          Restored {d.restored} unsaved edit{d.restored === 1 ? "" : "s"}.
          <button onClick={() => (dismissed.value = true)}>Keep</button>
          <button onClick={() => void http("POST /api/discard").then(() => (dismissed.value = true))}>
            {d.path ? "Return to the saved file" : "Discard them"}
          </button>
        </div>
      ) : null}
      {store.page.value === "editor" && d ? (
        <Editor />
      ) : (
        <div class="front">
          <header class="bar">
            <Brand />
            <Pages />
            <span class="grow" />
            <button class="quiet" onClick={() => act("theme")}>
              Theme
            </button>
            <span style="color: var(--dim)">{store.version.value}</span>
          </header>
          {store.page.value === "runs" ? <Runs /> : <Gallery />}
        </div>
      )}
      <Dialogs />
      <Menu />
      <DropZone />
      <div class="toasts">
        {store.toasts.value.map((t) => (
          <div class={`toast ${t.kind}`} key={t.id} role={t.kind === "error" ? "alert" : "status"}>
            <span>{t.text}</span>
            {t.undo ? <button onClick={() => act("undo")}>Undo</button> : null}
            <button class="quiet" aria-label="Dismiss" onClick={() => store.dismiss(t.id)}>
              ×
            </button>
          </div>
        ))}
      </div>
      <div class="offscreen" aria-live="polite">
        {store.announcement.value}
      </div>
    </>
  );
}

const theme = localStorage.getItem("theme");
if (theme === "dark" || theme === "light") setTheme(theme);
install(window);
restorePanels();
const root = document.getElementById("app");
if (root) render(<App />, root);
publish();
void connect(receive);
