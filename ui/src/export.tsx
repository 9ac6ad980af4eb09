// The export dialog: one list of formats, where the file goes, how far it is.

import { signal, useSignal } from "@preact/signals";
import { Dialog } from "./dialog";
import { JobBar } from "./job_bar";
import { ended, fetchFile, isRunning, saveUrl, startExport } from "./jobs";
import * as store from "./store";
import { http } from "./wire";

interface Format {
  format: string;
  title: string;
  about: string;
  ending: string;
  /** Of the clip alone: made at once, without performing anything. */
  clip?: true;
  /** A folder: it is written on the server's disk and cannot be downloaded. */
  folder?: true;
}

const FORMATS: Format[] = [
  {
    format: "mp4",
    title: "Film",
    about: "MP4, H.264: command and achieved motion with captions",
    ending: "mp4",
  },
  { format: "apng", title: "Sharp film", about: "APNG: every pixel as rendered, larger", ending: "apng" },
  { format: "gif", title: "Animated picture", about: "GIF for pages and chats", ending: "gif" },
  { format: "strip", title: "Film strip", about: "moments in one PNG", ending: "png" },
  { format: "png", title: "Picture", about: "the playhead as a PNG", ending: "png" },
  { format: "mcap", title: "Take", about: "MCAP for Foxglove, Lichtblick, Rerun", ending: "mcap" },
  { format: "html", title: "Page", about: "one HTML file that plays the take anywhere", ending: "html" },
  {
    format: "csv",
    title: "Achieved motion",
    about: "CSV: frame, time, mask and one column for each joint",
    ending: "csv",
  },
  {
    format: "command",
    title: "Command table",
    about: "CSV of the commanded motion, masked cells empty",
    ending: "command.csv",
    clip: true,
  },
  {
    format: "json",
    title: "Clip",
    about: "keyframes in the format robert-clip/1",
    ending: "clip.json",
    clip: true,
  },
  { format: "mjcf", title: "MuJoCo keys", about: "MJCF <keyframe> of the achieved motion", ending: "xml" },
  {
    format: "ros",
    title: "ROS 2 trajectory",
    about: "JointTrajectory with velocities, YAML",
    ending: "yaml",
  },
  { format: "bag", title: "ROS 2 bag", about: "a folder for ros2 bag play", ending: "bag", folder: true },
  {
    format: "lerobot",
    title: "LeRobot dataset",
    about: "a folder with this motion as one episode",
    ending: "lerobot",
    folder: true,
  },
  {
    format: "glb",
    title: "3D animation",
    about: "glTF for Blender, Unreal, three.js, slides",
    ending: "glb",
  },
  { format: "bvh", title: "Motion capture", about: "BVH for Blender, MotionBuilder, Houdini", ending: "bvh" },
  { format: "usda", title: "USD", about: "for Isaac Sim, Omniverse, usdview", ending: "usda" },
  { format: "npz", title: "Tracking file", about: "NPZ of BeyondMimic and mjlab, 50 Hz", ending: "npz" },
  {
    format: "lafan",
    title: "LAFAN rows",
    about: "CSV of base and joints for retargeting tools",
    ending: "lafan.csv",
  },
];

const SIZES: [[string, [number, number]], ...[string, [number, number]][]] = [
  ["640×480", [640, 480]],
  ["1280×720", [1280, 720]],
  ["1920×1080", [1920, 1080]],
];
const FILMS = new Set(["mp4", "apng", "gif"]);
const PICTURES = new Set([...FILMS, "strip", "png"]);
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

export function Export({ onClose }: { onClose: () => void }) {
  const chosen = useSignal(0);
  const size = useSignal(0);
  const whole = useSignal(true);
  const typed = useSignal<string | undefined>(undefined);
  const job = useSignal<number | undefined>(undefined);
  const said = useSignal("");
  if (typeof beside.value === "number" && !store.takes.value.some((t) => t.id === beside.value))
    beside.value = "";
  const f = FORMATS[chosen.value] ?? FORMATS[0];
  const d = store.doc.value;
  if (!f || !d) return null;
  const stem = (d.clip.name ?? "clip").replace(/[^\w-]+/g, "_") || "clip";
  const path = typed.value ?? `${stem}.${f.ending}`;
  const current = job.value === undefined ? undefined : store.jobs.value.get(job.value);
  const busy = isRunning(current);
  const range = store.range.value;

  const clipFile = async (): Promise<string> => {
    const format = f.format === "command" ? "csv" : f.format;
    return URL.createObjectURL(await http("GET /api/export", { query: { format } }));
  };
  const run = async (toFolder: boolean): Promise<void> => {
    said.value = "";
    try {
      if (f.clip) return saveUrl(await clipFile(), `${stem}.${f.ending}`);
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
        ...(toFolder ? { path } : {}),
        ...(PICTURES.has(f.format) ? { size: (SIZES[size.value] ?? SIZES[0])[1] } : {}),
        ...(frames && PICTURES.has(f.format) && f.format !== "strip" ? { frames } : {}),
        ...(PICTURES.has(f.format)
          ? {
              overlay: [...overlays.value].join(",") || "none",
              camera: cameraChosen.value.trim() || "fit",
              ...(compare ? { compare } : {}),
            }
          : {}),
        ...(f.format === "strip" ? { moments } : {}),
      });
      if (!started) return;
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
  return (
    <Dialog title="Export" onClose={onClose}>
      <div class="formats" role="radiogroup" aria-label="Format">
        {FORMATS.map((x, i) => (
          <label key={x.format} class={i === chosen.value ? "on" : ""}>
            <input
              type="radio"
              name="format"
              checked={i === chosen.value}
              onChange={() => {
                chosen.value = i;
                typed.value = undefined;
                said.value = "";
              }}
              data-testid={`format-${x.format}`}
            />
            <b>{x.title}</b>
            <span>{x.about}</span>
          </label>
        ))}
      </div>
      <div class="row" style="margin-top: 10px">
        {PICTURES.has(f.format) ? (
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
        {FILMS.has(f.format) ? (
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
          motion of {store.settings.value.policy}
          {store.settings.value.refine ? " with refine" : ""}, as shown
        </span>
      </div>
      {PICTURES.has(f.format) ? (
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
      {f.clip ? null : (
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
      <div class="row" style="margin-top: 12px; justify-content: flex-end">
        <button onClick={onClose}>Close</button>
        {f.clip ? null : (
          <button disabled={busy} onClick={() => void run(true)} data-testid="export-folder">
            Save to folder
          </button>
        )}
        <button
          class="main"
          disabled={busy || f.folder}
          title={f.folder ? "this format is a folder, which can only be saved" : ""}
          onClick={() => void run(false)}
          data-testid="export-download"
        >
          Download
        </button>
      </div>
    </Dialog>
  );
}
