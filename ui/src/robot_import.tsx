// A robot of the user becomes a folder that every command takes.

import { useSignal } from "@preact/signals";
import * as store from "./store";
import { complain, http } from "./wire";

export function ImportRobot() {
  const file = useSignal("");
  const id = useSignal("");
  const fixed = useSignal(false);
  const without = useSignal("");
  const servos = useSignal("keep");
  const drives = useSignal("modelled");
  const files = useSignal<File[]>([]);
  const busy = useSignal("");
  const models = files.value.filter((f) => /\.(urdf|xml|mjcf)$/i.test(f.name));
  const nameOf = (f: File): string => f.webkitRelativePath || f.name;
  const start = async (): Promise<void> => {
    try {
      let path = file.value;
      const uploaded = files.value.length > 0;
      if (uploaded) {
        for (const [i, f] of files.value.entries()) {
          busy.value = `sending ${i + 1} of ${files.value.length}`;
          await http("PUT /api/upload", { query: { path: nameOf(f), first: i === 0 }, body: f });
        }
        path ||= nameOf(models[0] ?? (files.value[0] as File));
      }
      await http("POST /api/import", {
        body: {
          file: path,
          uploaded,
          id: id.value,
          fixed_base: fixed.value,
          without: without.value.split(/[\s,]+/).filter(Boolean),
          actuators: servos.value,
          drives: drives.value,
        },
      });
    } catch (e) {
      complain(e);
    }
    busy.value = "";
  };
  const pick = (list: FileList | null): void => {
    files.value = [...(list ?? [])];
    const first = files.value.find((f) => /\.(urdf|xml|mjcf)$/i.test(f.name));
    file.value = first ? nameOf(first) : "";
    if (first && !id.value)
      id.value = first.name
        .replace(/\.\w+$/, "")
        .toLowerCase()
        .replace(/[^a-z0-9_-]+/g, "_");
  };
  return (
    <details class="import" data-testid="import">
      <summary>Import a robot (URDF, or MJCF for MuJoCo 2.2.2)</summary>
      <div class="fields">
        <label>
          Its folder{" "}
          <input
            type="file"
            multiple
            {...{ webkitdirectory: true }}
            onChange={(e) => pick(e.currentTarget.files)}
            data-testid="import-folder"
          />
        </label>
        <label>
          or files{" "}
          <input
            type="file"
            multiple
            onChange={(e) => pick(e.currentTarget.files)}
            data-testid="import-files"
          />
        </label>
        {models.length > 1 ? (
          <label>
            Model{" "}
            <select value={file.value} onChange={(e) => (file.value = e.currentTarget.value)}>
              {models.map((f) => (
                <option key={nameOf(f)} value={nameOf(f)}>
                  {nameOf(f)}
                </option>
              ))}
            </select>
          </label>
        ) : (
          <label>
            Model file{" "}
            <input
              type="text"
              value={file.value}
              placeholder={`path in ${store.folder.value}`}
              disabled={files.value.length > 0}
              onInput={(e) => (file.value = e.currentTarget.value)}
              data-testid="import-path"
            />
          </label>
        )}
        <label>
          Name{" "}
          <input
            type="text"
            value={id.value}
            placeholder="my_arm"
            onInput={(e) => (id.value = e.currentTarget.value)}
            data-testid="import-id"
          />
        </label>
        <label>
          <input
            type="checkbox"
            checked={fixed.value}
            onChange={(e) => (fixed.value = e.currentTarget.checked)}
          />{" "}
          fix a floating base
        </label>
        <label title="Names of bodies with a comma between them; what hangs on them goes, too (MJCF)">
          Leave out{" "}
          <input
            type="text"
            value={without.value}
            placeholder="ball, table"
            onInput={(e) => (without.value = e.currentTarget.value)}
            data-testid="import-without"
          />
        </label>
        <label title="Position and velocity servos of the file">
          Servos{" "}
          <select
            value={servos.value}
            onChange={(e) => (servos.value = e.currentTarget.value)}
            data-testid="import-actuators"
          >
            <option value="keep">stay servos</option>
            <option value="torque">become torque motors</option>
          </select>
        </label>
        <label title="Damping and inertia of the drives of joints that have none in the file">
          Drives{" "}
          <select
            value={drives.value}
            onChange={(e) => (drives.value = e.currentTarget.value)}
            data-testid="import-drives"
          >
            <option value="modelled">modelled where they are missing</option>
            <option value="file">as the file says</option>
          </select>
        </label>
      </div>
      <div class="row">
        <button
          class="main"
          disabled={!id.value || (!file.value && !files.value.length) || !!busy.value}
          onClick={() => void start()}
          data-testid="import-start"
        >
          Import
        </button>
        <span>{busy.value}</span>
      </div>
      <p class="about">
        The model is checked in a process of its own. Motors, contacts and limits that are missing from its
        file are added and listed.
      </p>
    </details>
  );
}
