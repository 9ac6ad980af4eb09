// The bar at the top: pages, the clip, what is done to all of it.

import type { IconNode } from "lucide";
import {
  CircleQuestionMark,
  PanelLeft,
  PanelRight,
  Redo2,
  RotateCcwClock,
  Search,
  SunMoon,
  Undo2,
} from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { act } from "./actions/index";
import { FileMenu } from "./filemenu";
import { Icon } from "./icon";
import { leftShown, rightShown } from "./layout";
import { PolicySelect } from "./policies";
import * as store from "./store";
import { edit } from "./wire";

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
          {page === "runs" && running ? <small>{running}</small> : null}
        </button>
      ))}
    </nav>
  );
}

function Brand() {
  return (
    <span class="brand">
      <img src="/ui/icon.svg" width="18" height="18" alt="" /> <span>RoBERT Studio</span>
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
        <span>{d.clip.name || "untitled"}</span>
        {d.dirty ? <i class="dirty" role="img" aria-label="not saved" /> : null}
      </button>
      {file ? (
        <span class="of file" title={d.path ?? ""}>
          {file}
        </span>
      ) : null}
    </>
  );
}

/** A button with a sign only: its name is said and shown on hover. */
function Tool(props: {
  of: IconNode;
  name: string;
  title: string;
  run: () => void;
  disabled?: boolean | undefined;
  pressed?: boolean;
  id?: string;
}) {
  return (
    <button
      class="icon quiet"
      aria-label={props.name}
      aria-pressed={props.pressed}
      title={props.title}
      disabled={props.disabled}
      onClick={props.run}
      data-testid={props.id}
    >
      <Icon of={props.of} />
    </button>
  );
}

/** The bar of the editor. */
export function Bar() {
  const d = store.doc.value;
  const h = d?.history;
  const next = h && h.done < h.len ? h.labels[h.done - h.first] : undefined;
  const last = h && h.done > 0 ? h.labels[h.done - h.first - 1] : undefined;
  return (
    <header class="bar">
      <Brand />
      <Pages />
      <FileMenu />
      <span class="what">
        <Title />
        <span class="of">{store.robot.value?.title}</span>
      </span>
      <span class="grow" />
      <Tool
        of={Undo2}
        name="Undo"
        id="undo"
        disabled={!h || h.done === 0}
        title={last === undefined ? "Nothing to undo" : `Undo: ${last} (Ctrl+Z)`}
        run={() => act("undo")}
      />
      <Tool
        of={Redo2}
        name="Redo"
        disabled={!h || h.done >= h.len}
        title={next === undefined ? "Nothing to redo" : `Redo: ${next} (Ctrl+Shift+Z)`}
        run={() => act("redo")}
      />
      <Tool
        of={RotateCcwClock}
        name="History"
        disabled={!h || h.len === 0}
        title="List of all edits (Ctrl+H)"
        run={() => act("history")}
      />
      <SearchButton />
      <span class="rule" />
      <PolicySelect />
      <button onClick={() => act("save")} disabled={!d?.dirty && !!d?.path} title="Ctrl+S" data-testid="save">
        Save
      </button>
      <button class="main" onClick={() => act("export")} title="Ctrl+E">
        Export
      </button>
      <span class="rule" />
      <Tool
        of={PanelLeft}
        name="Left panel"
        title="Show or hide the left panel (Ctrl+B)"
        pressed={leftShown.value}
        run={() => act("panel-left")}
      />
      <Tool
        of={PanelRight}
        name="Right panel"
        title="Show or hide the right panel (Ctrl+Shift+B)"
        pressed={rightShown.value}
        run={() => act("panel-right")}
      />
      <Tool of={CircleQuestionMark} name="Shortcuts" title="Shortcuts (?)" run={() => act("help")} />
    </header>
  );
}

function SearchButton() {
  return (
    <button class="search" onClick={() => act("palette")} title="Joints, poses, examples, commands (Ctrl+K)">
      <Icon of={Search} size={14} /> <span>Search</span> <kbd>Ctrl K</kbd>
    </button>
  );
}

/** The bar of the other pages. */
export function FrontBar() {
  return (
    <header class="bar">
      <Brand />
      <Pages />
      <span class="grow" />
      <SearchButton />
      <Tool of={SunMoon} name="Theme" title="Dark or light" run={() => act("theme")} />
      <span class="of">{store.version.value}</span>
    </header>
  );
}
