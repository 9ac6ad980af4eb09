// The shell: which page, the editor's grid, banners, menus.

import { useSignal } from "@preact/signals";
import { X } from "lucide";
import { render } from "preact";
import { useEffect } from "preact/hooks";
import "./styles/palette.css";
import "./styles/base.css";
import "./styles/editor.css";
import "./styles/training.css";
import "./styles/panels.css";
import "./styles/dialogs.css";
import "./styles/controls.css";
import "./styles/sizes.css";
import { act } from "./actions/index";
import { Bar, FrontBar } from "./bar";
import { DropZone } from "./clip_import";
import { Curves } from "./curves";
import { Dialogs } from "./dialogs";
import { receive } from "./events";
import { startFolds } from "./folds";
import { Gallery } from "./gallery";
import { Graph } from "./graph/graph";
import { Hint } from "./hint_bar";
import { Icon } from "./icon";
import { Inspector } from "./inspector";
import { leftShown, rightShown, sheetTab, startLayout } from "./layout";
import { Left } from "./left";
import { Menu } from "./menu";
import { Problems } from "./problems";
import { Rendered } from "./rendered";
import { install } from "./shortcuts";
import { restorePanels, Splitter } from "./splitter";
import * as store from "./store";
import { Tabs } from "./tabs";
import { publish } from "./testing";
import { startTheme } from "./theme";
import { Timeline } from "./timeline/timeline";
import { offerTour, Tour } from "./tour";
import { Runs } from "./training_page";
import { Transport } from "./transport";
import { Viewport } from "./viewport";
import { connect, http, tell } from "./wire";

/** Beside the timeline: curves, or the picture as it is exported. */
function Side() {
  return (
    <aside class="side" aria-label="Curves and picture">
      <Splitter of="curves" />
      <Tabs
        label="Beside the timeline"
        tabs={[
          { id: "curves", title: "Curves" },
          { id: "rendered", title: "Rendered" },
        ]}
        now={store.side.value}
        onChoose={(id) => (store.side.value = id)}
      />
      {store.side.value === "rendered" ? <Rendered /> : <Curves />}
    </aside>
  );
}

function Editor() {
  const hint = useSignal("");
  useEffect(offerTour, []);
  const hidden = `${leftShown.value ? "" : "no-left"} ${rightShown.value ? "" : "no-right"}`;
  return (
    <div class={`editor ${hidden}`} data-testid="editor">
      <Bar />
      {leftShown.value ? <Left /> : null}
      <Viewport />
      {rightShown.value ? (
        <aside class="right">
          <Inspector />
          <Problems />
        </aside>
      ) : null}
      <Transport />
      <div class="below">
        {sheetTab.value === "graph" ? (
          <Graph onHint={(t) => (hint.value = t)} />
        ) : (
          <Timeline onHint={(t) => (hint.value = t)} />
        )}
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
          <FrontBar />
          {store.page.value === "runs" ? <Runs /> : <Gallery />}
        </div>
      )}
      <Dialogs />
      <Menu />
      <DropZone />
      <Tour />
      <div class="toasts">
        {store.toasts.value.map((t) => (
          <div class={`toast ${t.kind}`} key={t.id} role={t.kind === "error" ? "alert" : "status"}>
            <span>{t.text}</span>
            {t.undo ? <button onClick={() => act("undo")}>Undo</button> : null}
            <button class="icon quiet" aria-label="Dismiss" onClick={() => store.dismiss(t.id)}>
              <Icon of={X} size={14} />
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

startTheme();
startLayout();
startFolds();
install(window);
restorePanels();
const root = document.getElementById("app");
if (root) render(<App />, root);
publish();
void connect(receive);
