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
import { Banner } from "./banner";
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
import { followDocument } from "./offsets";
import { Problems } from "./problems";
import { followPlayhead } from "./reference";
import { ReferencePanel } from "./reference_panel";
import { Rendered } from "./rendered";
import { install } from "./shortcuts";
import { restorePanels, Splitter } from "./splitter";
import * as store from "./store";
import { Tabs } from "./tabs";
import { TakeTable } from "./take_table";
import { publish } from "./testing";
import { startTheme } from "./theme";
import { Timeline } from "./timeline/timeline";
import { offerTour, Tour } from "./tour";
import { Runs } from "./training_page";
import { Transport } from "./transport";
import { Viewport } from "./viewport";
import { connect } from "./wire";

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
          { id: "compare", title: "Compare" },
          { id: "reference", title: "Reference" },
        ]}
        now={store.side.value}
        onChoose={(id) => (store.side.value = id)}
      />
      {store.side.value === "rendered" ? (
        <Rendered />
      ) : store.side.value === "compare" ? (
        <TakeTable />
      ) : store.side.value === "reference" ? (
        <ReferencePanel />
      ) : (
        <Curves />
      )}
    </aside>
  );
}

function Editor() {
  const hint = useSignal("");
  useEffect(offerTour, []);
  // What was said of one clip means nothing in the next.
  useEffect(() => void (hint.value = ""), [store.doc.value?.opened]);
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
  const d = store.doc.value;
  return (
    <>
      <Banner />
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
            {t.answer ? (
              <button
                onClick={() => {
                  store.dismiss(t.id);
                  t.answer?.run();
                }}
              >
                {t.answer.title}
              </button>
            ) : null}
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
followDocument();
followPlayhead();
install(window);
restorePanels();
const root = document.getElementById("app");
if (root) render(<App />, root);
publish();
void connect(receive);
