// Files in: what the browser hands over by its picker or a drop, and what lies in folders.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { FPS, parseTime } from "./clip";
import { Answers, Dialog, openDialog } from "./dialog";
import { opening } from "./documents";
import type { DocumentView, FileCard, Listing } from "./protocol";
import { isMedia, openReference } from "./reference";
import * as store from "./store";
import { complain, http, Refusal } from "./wire";

/** A file on its way to become a clip: its content, or its place on the studio's machine. */
export type Incoming = { name: string; body: Blob } | { name: string; path: string };

const ENDINGS = /\.(json|csv|xml|mjcf|ya?ml|mcap)$/i;
/** As the studio reads them. */
const CAP = 16 << 20;

/** Formats that do not say whose joints they are. */
const nameless = (name: string): boolean => !/\.(json|mcap)$/i.test(name);

/** A file that waits for its robot. */
let waiting: Incoming | undefined;

/** Makes a clip of it; asks whose it is where nobody can know. */
export async function take(file: Incoming, robot?: string): Promise<void> {
  if (!ENDINGS.test(file.name))
    return store.toast(
      `${file.name}: only .clip.json, .csv, .lafan.csv, .xml, .yaml, .json and .mcap files can be opened`,
      "error",
    );
  if ("body" in file && file.body.size > CAP)
    return store.toast(
      `${file.name} has ${Math.ceil(file.body.size / 1e6)} MB; the limit is ${CAP >> 20} MB`,
      "error",
    );
  if ("path" in file && /\.json$/i.test(file.name)) return opening(openPath(file.path));
  if (nameless(file.name) && !robot && !store.doc.value) {
    waiting = file;
    return openDialog({ name: "whose" });
  }
  const query = {
    ...("path" in file ? { path: file.path } : { name: file.name }),
    ...(robot ? { robot } : {}),
  };
  await opening(http("POST /api/clips", { query, body: "body" in file ? file.body : "" }));
}

/** Opens the file of a clip. A command ends in `.json`, too: it becomes a new clip, as one that is dropped does. */
async function openPath(path: string): Promise<DocumentView> {
  try {
    return await http("POST /api/open", { body: { path } });
  } catch (e) {
    if (!(e instanceof Refusal && e.body.code === "invalid")) throw e;
    return http("POST /api/clips", { query: { path }, body: "" });
  }
}

/** A file becomes a block of the clip, where the playhead is. */
async function insert(file: Incoming, blend: number): Promise<void> {
  const at = store.playhead.value;
  // After the last frame is the end: nothing of the clip follows there.
  const before = at >= store.length.value - 1 ? store.length.value : at;
  const query = { ...("path" in file ? { path: file.path } : { name: file.name }), at: before, blend };
  try {
    await http("POST /api/insert", { query, body: "body" in file ? file.body : "" });
    store.toast(`inserted ${file.name}`, "info", true);
  } catch (e) {
    complain(e);
  }
}

/** The browser's own picker. */
export function pick(then: (file: Incoming) => Promise<void> = take): void {
  const input = document.createElement("input");
  input.type = "file";
  input.accept = ".json,.csv,.xml,.mjcf,.yaml,.yml,.mcap";
  input.dataset.testid = "picker";
  input.hidden = true;
  input.onchange = () => {
    const file = input.files?.[0];
    input.remove();
    if (file) void then({ name: file.name, body: file });
  };
  input.oncancel = () => input.remove();
  document.querySelectorAll('[data-testid="picker"]').forEach((old) => old.remove());
  document.body.append(input);
  input.click();
}

/** Covers the page while a file is dragged over it, so that it can be dropped anywhere. */
export function DropZone() {
  const over = useSignal(false);
  useEffect(() => {
    const files = (e: DragEvent): boolean => e.dataTransfer?.types.includes("Files") ?? false;
    const enter = (e: DragEvent): void => {
      if (!files(e)) return;
      e.preventDefault();
      over.value = true;
    };
    const leave = (e: DragEvent): void => {
      // Only out of the window: from element to element there is somewhere to go.
      if (!e.relatedTarget) over.value = false;
    };
    const drop = (e: DragEvent): void => {
      if (!files(e)) return;
      e.preventDefault();
      over.value = false;
      const list = [...(e.dataTransfer?.files ?? [])];
      if (list.length > 1) store.toast(`${list.length} files were dropped; the first is opened`);
      const file = list[0];
      if (file && isMedia(file) && store.doc.value) return void openReference(file);
      if (file) void take({ name: file.name, body: file });
    };
    window.addEventListener("dragenter", enter);
    window.addEventListener("dragover", enter);
    window.addEventListener("dragleave", leave);
    window.addEventListener("drop", drop);
    return () => {
      window.removeEventListener("dragenter", enter);
      window.removeEventListener("dragover", enter);
      window.removeEventListener("dragleave", leave);
      window.removeEventListener("drop", drop);
    };
  }, []);
  return over.value ? (
    <div class="drop" data-testid="drop">
      <p>Drop a clip, CSV, MJCF or ROS trajectory to open it, a film or a sound to follow it</p>
    </div>
  ) : null;
}

/** Whose joints a table is about. */
export function Whose({ onClose }: { onClose: () => void }) {
  const robot = useSignal(store.robots.value[0]?.source ?? "ur5e");
  useEffect(() => {
    if (store.robots.value.length === 0)
      void http("GET /api/robots").then((r) => {
        store.robots.value = r;
        robot.value = r[0]?.source ?? "";
      }, complain);
  }, []);
  const file = waiting;
  const done = (): void => {
    onClose();
    waiting = undefined;
    if (file) void take(file, robot.value);
  };
  return (
    <Dialog title="Which robot is it for?" onClose={onClose}>
      <form
        onSubmit={(e) => {
          e.preventDefault();
          done();
        }}
      >
        <p>{file?.name} contains joint values but does not name its robot.</p>
        <select
          aria-label="Robot"
          value={robot.value}
          onChange={(e) => (robot.value = e.currentTarget.value)}
          data-testid="whose"
        >
          {store.robots.value.map((r) => (
            <option key={r.source} value={r.source}>
              {r.id}
              {r.builtin ? "" : " (yours)"}
            </option>
          ))}
        </select>
        <Answers onClose={onClose} yes="Open" />
      </form>
    </Dialog>
  );
}

const WHAT: Record<FileCard["kind"], string> = {
  clip: "clip",
  csv: "CSV",
  mjcf: "MJCF keys",
  ros: "ROS trajectory",
  lafan: "LAFAN motion, 30 rows a second",
  take: "take: the motion that it reached",
};

function about(f: FileCard): string {
  if (f.why) return f.why;
  if (f.clip)
    return `${f.clip.name || "untitled"} · ${f.clip.robot} · ${(f.clip.length / FPS).toFixed(0)} s · ${f.clip.keys} key${f.clip.keys === 1 ? "" : "s"}`;
  return WHAT[f.kind];
}

interface Entry {
  id: string;
  name: string;
  about: string;
  off: boolean;
  go: () => void;
}

/** Where a clip may lie: a path that is typed, folders that are walked, the browser's picker. */
export function Open({ onClose, insert: inserts = false }: { onClose: () => void; insert?: boolean }) {
  const blend = useSignal("0.5s");
  /** Opens it, or puts it into the open clip. */
  const bring = async (file: Incoming): Promise<void> => {
    if (!inserts) return take(file);
    const frames = parseTime(blend.value, store.fps.value);
    if (frames === undefined) return store.toast(`"${blend.value}" is not a time: type 0.5s or 10`, "error");
    return insert(file, frames);
  };
  const path = useSignal("");
  const root = useSignal("");
  const listing = useSignal<Listing | undefined>(undefined);
  const said = useSignal("");
  const at = useSignal(-1);
  const list = useRef<HTMLUListElement>(null);
  const look = async (dir: string, below = root.value): Promise<boolean> => {
    try {
      listing.value = await http("GET /api/files", { query: { dir, ...(below ? { root: below } : {}) } });
      root.value = below;
      at.value = -1;
      said.value = "";
      return true;
    } catch (e) {
      said.value = e instanceof Refusal ? e.body.message : String(e);
      return false;
    }
  };
  useEffect(() => void look(""), []);
  /** What was typed led here; it does not sift what lies here. */
  const enter = (dir: string): void => {
    path.value = "";
    void look(dir);
  };
  const l = listing.value;
  const joined = (name: string): string => [l?.root ?? "", l?.dir ?? "", name].filter(Boolean).join("/");
  const inner = (name: string): string => (l?.dir ? `${l.dir}/${name}` : name);
  const all: Entry[] = [
    ...(l?.dir
      ? [
          {
            id: "up",
            name: "..",
            about: "the folder above",
            off: false,
            go: () => enter(l.dir.split("/").slice(0, -1).join("/")),
          },
        ]
      : []),
    ...(l?.folders ?? []).map((name) => ({
      id: `dir-${name}`,
      name: `${name}/`,
      about: "folder",
      off: false,
      go: () => enter(inner(name)),
    })),
    ...(l?.files ?? []).map((f) => ({
      id: `at-${f.name}`,
      name: f.name,
      about: about(f),
      off: !!f.why && f.kind !== "clip",
      go: () => {
        onClose();
        void bring({ name: f.name, path: joined(f.name) });
      },
    })),
  ];
  const words = path.value.trim().toLowerCase();
  const entries =
    words && !words.includes("/") ? all.filter((e) => e.name.toLowerCase().includes(words)) : all;
  const typed = async (): Promise<void> => {
    const text = path.value.trim();
    const chosen = entries[at.value];
    if (chosen) return void (chosen.off || chosen.go());
    if (!text) return;
    // A folder is looked into; everything else is opened, and says what is wrong with it.
    if (/(^|\/)\.{0,2}$/.test(text)) {
      path.value = "";
      return void (await look("", text));
    }
    onClose();
    await bring({ name: ENDINGS.test(text) ? (text.split("/").at(-1) ?? text) : `${text}.json`, path: text });
  };
  const move = (step: number): void => {
    at.value = Math.max(-1, Math.min(entries.length - 1, at.value + step));
    list.current?.children[at.value]?.scrollIntoView({ block: "nearest" });
  };
  return (
    <Dialog title={inserts ? "Insert at the playhead" : "Open"} onClose={onClose} class="open">
      <form
        onSubmit={(e) => {
          e.preventDefault();
          void typed();
        }}
      >
        <div class="row">
          <label class="grow">
            File
            <input
              type="text"
              style="width: 100%; padding: 6px 8px"
              value={path.value}
              placeholder={`a path, from ${store.folder.value}`}
              role="combobox"
              aria-expanded="true"
              aria-controls="folder"
              aria-activedescendant={at.value >= 0 ? `entry-${at.value}` : undefined}
              onInput={(e) => {
                path.value = e.currentTarget.value;
                at.value = -1;
              }}
              onKeyDown={(e) => {
                if (e.key === "ArrowDown") move(1);
                else if (e.key === "ArrowUp") move(-1);
                else if (e.key === "PageDown") move(8);
                else if (e.key === "PageUp") move(-8);
                else return;
                e.preventDefault();
              }}
            />
          </label>
          {inserts ? (
            <label title="A smooth curve over so long leads to it and from it; both sides keep their speed">
              Blend
              <input
                type="text"
                style="width: 72px; padding: 6px 8px"
                value={blend.value}
                onInput={(e) => (blend.value = e.currentTarget.value)}
                data-testid="blend"
              />
            </label>
          ) : null}
          <button class="main" type="submit">
            {inserts ? "Insert" : "Open"}
          </button>
        </div>
      </form>
      <p class="where" data-testid="where">
        {l ? joined("") : ""}
      </p>
      {said.value ? (
        <p role="alert" style="color: var(--error)">
          {said.value}
        </p>
      ) : null}
      <ul class="folder" id="folder" role="listbox" aria-label="Files in this folder" ref={list}>
        {entries.map((e, i) => (
          <li
            key={e.id}
            id={`entry-${i}`}
            role="option"
            aria-selected={i === at.value}
            aria-disabled={e.off}
            data-testid={e.id}
            onClick={() => {
              if (!e.off) e.go();
            }}
          >
            <span>{e.name}</span>
            <span class="sub">{e.about}</span>
          </li>
        ))}
        {l && entries.length === 0 ? <li class="none">there are no clips in this folder</li> : null}
      </ul>
      <p class="where">
        {l?.more ? "This list is not complete: type the path of a file that is missing. " : ""}
        {l?.left_out ? `${l.left_out} other file${l.left_out === 1 ? " is" : "s are"} not shown.` : ""}
      </p>
      <div class="row" style="margin-top: 8px; justify-content: space-between">
        <button
          onClick={() => {
            onClose();
            pick(bring);
          }}
          title="Ctrl+Shift+O"
          data-testid="pick"
        >
          From this computer…
        </button>
        <button onClick={onClose}>Cancel</button>
      </div>
    </Dialog>
  );
}
