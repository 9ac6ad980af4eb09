// The export dialog: one list of formats, where the file goes, how far it is.

import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Dialog } from "./dialog";
import { fileStem } from "./documents";
import { JobBar } from "./job_bar";
import { ended, fetchFile, isRunning, saveUrl, startExport } from "./jobs";
import { labelInWords } from "./policy_words";
import type { ExportFormat } from "./protocol";
import { Replace } from "./replace";
import * as store from "./store";
import { complain, http, httpFile } from "./wire";

/** What can be made of a document's motion, as the studio lists it for its robot. */
const listed = signal<{ opened: number | undefined; formats: readonly ExportFormat[] }>({
  opened: undefined,
  formats: [],
});

const SIZES: [[string, [number, number]], ...[string, [number, number]][]] = [
  ["640×480", [640, 480]],
  ["1280×720", [1280, 720]],
  ["1920×1080", [1920, 1080]],
];
const OVERLAYS: [string, string, boolean][] = [
  ["ghost", "the command, translucent", true],
  ["error", "links tinted by their error", true],
  ["trail", "path of the end effector or fingertips", true],
  ["caption", "title, time, error", true],
  ["onion", "the keys before and after", false],
  ["axes", "coordinate axes of the bodies", false],
  ["contacts", "contact points", false],
];
const CAMERAS = ["fit", "fixed", "top", "orbit"];
/** What may be laid over, as it was chosen last. */
const overlays = signal<ReadonlySet<string>>(
  new Set(OVERLAYS.filter(([, , on]) => on).map(([name]) => name)),
);
const cameraChosen = signal("fit");
const momentsTyped = signal("6");
/** Beside: nothing, a take (its number), a file. */
const beside = signal<"" | number | "file">("");
const besideFile = signal("");

/** The last part of a file's name: formats that share an ending, and files that were made before, do not share a
 * name. */
function freePath(stem: string, f: ExportFormat): string {
  const shared = listed.value.formats.some((x) => x !== f && x.ending === f.ending);
  const own = !shared || f.format === f.ending ? stem : `${stem}-${f.format}`;
  const made = [...store.jobs.value.values()].flatMap((job) => job.args[job.args.indexOf("-o") + 1] ?? []);
  const isMade = (path: string): boolean => made.includes(`${store.folder.value}/${path}`);
  let path = `${own}.${f.ending}`;
  for (let n = 2; isMade(path); n++) path = `${own}-${n}.${f.ending}`;
  return path;
}

export function Export({ onClose }: { onClose: () => void }) {
  const chosen = useSignal(0);
  const size = useSignal(0);
  const whole = useSignal(true);
  const typed = useSignal<string | undefined>(undefined);
  const job = useSignal<number | undefined>(undefined);
  const said = useSignal("");
  /** The file that is there already, while the question is open whether it is replaced. */
  const there = useSignal<string | undefined>(undefined);
  /** Found when a format is chosen: it does not change while the file is being made. */
  const offered = useSignal("");
  const d = store.doc.value;
  const isListed = listed.value.opened === d?.opened;
  const choose = (index: number): void => {
    const [format, name] = [listed.value.formats[index], d?.clip.name];
    chosen.value = index;
    typed.value = undefined;
    said.value = "";
    offered.value = format ? freePath(fileStem(name), format) : "";
  };
  if (typeof beside.value === "number" && !store.takes.value.some((t) => t.id === beside.value))
    beside.value = "";
  useEffect(() => {
    if (isListed) choose(0);
    // The robot may have been loaded since.
    void http("GET /api/formats").then(
      (formats) => {
        listed.value = { opened: d?.opened, formats };
        if (!isListed) choose(0);
      },
      (e) => {
        said.value = "The formats could not be read. Close this, and open it again.";
        complain(e);
      },
    );
  }, [d?.opened]);
  const { formats } = listed.value;
  const f = isListed ? formats[chosen.value] : undefined;
  if (!d) return null;
  if (!f)
    return (
      <Dialog key="waiting" title="Export" class="wide" onClose={onClose}>
        <p role="status">{said.value || "Asking what can be made of this motion…"}</p>
      </Dialog>
    );
  const isFilm = f.kind === "film";
  const isPictured = isFilm || f.kind === "picture";
  const isClip = f.kind === "clip";
  const isFolder = f.kind === "folder";
  const stem = fileStem(d.clip.name);
  const path = typed.value ?? offered.value;
  const current = job.value === undefined ? undefined : store.jobs.value.get(job.value);
  const busy = isRunning(current);
  const range = store.range.value;

  const clipFile = async (): Promise<string> => {
    const format = f.format === "command" ? "csv" : f.format;
    // A clip is JSON, too.
    return URL.createObjectURL(await httpFile("GET /api/export", { query: { format } }));
  };
  const run = async (toFolder: boolean, replace = false): Promise<void> => {
    said.value = "";
    try {
      if (isClip) return saveUrl(await clipFile(), `${stem}.${f.ending}`);
      const moments = Math.round(Number(momentsTyped.value));
      if (f.format === "strip" && !(moments >= 1 && moments <= 64))
        return void (said.value = "a strip has 1 to 64 moments");
      const compare =
        beside.value === "file"
          ? besideFile.value.trim() && { file: besideFile.value.trim() }
          : beside.value === ""
            ? undefined
            : { take: beside.value };
      const at = store.playhead.value;
      const frames: [number, number] | undefined =
        f.format === "png" ? [at, at + 1] : !whole.value && range ? [range.from, range.to] : undefined;
      const started = await startExport({
        format: f.format,
        ...(toFolder ? { path, replace } : {}),
        ...(isPictured ? { size: (SIZES[size.value] ?? SIZES[0])[1] } : {}),
        ...(frames && isPictured && f.format !== "strip" ? { frames } : {}),
        ...(isPictured
          ? {
              overlay: [...overlays.value].join(",") || "none",
              camera: cameraChosen.value.trim() || "fit",
              ...(compare ? { compare } : {}),
            }
          : {}),
        ...(f.format === "strip" ? { moments } : {}),
      });
      if (!started) return;
      if (started === "exists") return void (there.value = path);
      job.value = started.id;
      const done = await ended(started.id);
      if (done.phase === "failed")
        said.value = done.log.filter((l) => l.startsWith("error")).at(-1) ?? "the export failed";
      else if (done.phase === "interrupted") said.value = "cancelled; nothing was saved";
      else if (toFolder) said.value = `saved: ${store.folder.value}/${path}`;
      else saveUrl(await fetchFile(done), path.split("/").at(-1) || (done.file ?? `${stem}.${f.ending}`));
    } catch (e) {
      store.toast(e instanceof Error ? e.message : String(e), "error");
    }
  };
  if (there.value !== undefined) {
    const back = (): void => void (there.value = undefined);
    return <Replace path={there.value} onClose={back} onReplace={() => void run(true, true)} />;
  }
  return (
    // A dialog of its own, so that its first field has the focus.
    <Dialog key="formats" title="Export" class="wide" onClose={onClose}>
      <div class="formats" role="radiogroup" aria-label="Format">
        {formats.map((x, i) => {
          const why = x.why;
          return (
            <label key={x.format} class={i === chosen.value ? "on" : why ? "unfit" : ""}>
              <input
                type="radio"
                name="format"
                checked={i === chosen.value}
                disabled={why !== null}
                onChange={() => choose(i)}
                data-testid={`format-${x.format}`}
              />
              <b>{x.title}</b>
              <span>{why ?? x.about}</span>
            </label>
          );
        })}
      </div>
      <div class="row" style="margin-top: 10px">
        {isPictured ? (
          <select
            aria-label="Size"
            value={String(size.value)}
            onChange={(e) => (size.value = Number(e.currentTarget.value))}
          >
            {SIZES.map(([title], i) => (
              <option key={title} value={String(i)}>
                {title}
              </option>
            ))}
          </select>
        ) : null}
        {isFilm ? (
          <label title={range ? "" : "set the loop range with [ and ]"}>
            <input
              type="checkbox"
              disabled={!range}
              checked={!whole.value && !!range}
              onChange={(e) => (whole.value = !e.currentTarget.checked)}
            />{" "}
            loop range only
          </label>
        ) : null}
        <span style="color: var(--dim)">
          motion of {labelInWords(store.settings.value.policy)}
          {store.settings.value.refine ? " with refine" : ""}, as shown
        </span>
      </div>
      {isPictured ? (
        <div class="pictured" data-testid="pictured">
          <fieldset>
            <legend>Overlays</legend>
            {OVERLAYS.map(([name, about]) => (
              <label key={name} title={about}>
                <input
                  type="checkbox"
                  checked={overlays.value.has(name)}
                  onChange={() => {
                    const next = new Set(overlays.value);
                    if (!next.delete(name)) next.add(name);
                    overlays.value = next;
                  }}
                  data-testid={`overlay-${name}`}
                />{" "}
                {name}
              </label>
            ))}
          </fieldset>
          <div class="row">
            <label title="fit, fixed, top, orbit, follow:BODY or the name of a camera of the model">
              Camera{" "}
              <input
                type="text"
                list="cameras"
                style="width: 110px"
                value={cameraChosen.value}
                onInput={(e) => (cameraChosen.value = e.currentTarget.value)}
                data-testid="export-camera"
              />
            </label>
            <datalist id="cameras">
              {CAMERAS.map((c) => (
                <option key={c} value={c} />
              ))}
            </datalist>
            {f.format === "strip" ? (
              <label>
                Moments{" "}
                <input
                  type="number"
                  min={1}
                  max={64}
                  style="width: 64px"
                  value={momentsTyped.value}
                  onInput={(e) => (momentsTyped.value = e.currentTarget.value)}
                  data-testid="export-moments"
                />
              </label>
            ) : null}
            <label title="Two motions side by side, seen by the same camera">
              Side by side with{" "}
              <select
                value={String(beside.value)}
                onChange={(e) => {
                  const v = e.currentTarget.value;
                  beside.value = v === "" || v === "file" ? v : Number(v);
                }}
                data-testid="export-beside"
              >
                <option value="">nothing</option>
                {store.takes.value.map((t) => (
                  <option key={t.id} value={String(t.id)}>
                    {t.name}: {t.policy}
                    {t.mae === null ? "" : `, ${store.shownError(t.mae, store.unit.value)}`}
                  </option>
                ))}
                <option value="file">another clip or take…</option>
              </select>
            </label>
            {beside.value === "file" ? (
              <input
                type="text"
                aria-label="Clip or take to show beside it"
                placeholder={`in ${store.folder.value}`}
                value={besideFile.value}
                onInput={(e) => (besideFile.value = e.currentTarget.value)}
                data-testid="export-beside-file"
              />
            ) : null}
          </div>
        </div>
      ) : null}
      {isClip ? null : (
        <label style="display: block; margin-top: 10px">
          File, relative to {store.folder.value}
          <br />
          <input
            type="text"
            style="width: 100%; padding: 6px 8px"
            value={path}
            onInput={(e) => (typed.value = e.currentTarget.value)}
            data-testid="export-path"
          />
        </label>
      )}
      {current && busy ? <JobBar job={current} /> : null}
      {said.value ? (
        <p role="status" data-testid="export-said">
          {said.value}
        </p>
      ) : null}
      <div class="row foot">
        <button onClick={onClose}>Close</button>
        {isClip ? null : (
          <button disabled={busy} onClick={() => void run(true)} data-testid="export-folder">
            Save to folder
          </button>
        )}
        <button
          class="main"
          disabled={busy || isFolder}
          title={isFolder ? "this format is a folder: it can be saved, but not downloaded" : ""}
          onClick={() => void run(false)}
          data-testid="export-download"
        >
          Download
        </button>
      </div>
    </Dialog>
  );
}
