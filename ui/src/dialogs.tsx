// Everything that asks something: palette, shortcut sheet, small questions, files, export.

import { retime } from "./actions/keys";
import { Ask } from "./ask";
import { Open, Whose } from "./clip_import";
import { CloseRow, closeDialog, Dialog, openDialog, question } from "./dialog";
import { fileStem, reload, save } from "./documents";
import { Export } from "./export";
import { ScaleValues, Slope } from "./graph/questions";
import { pivotOf } from "./grow";
import { KeyEditor, wholeFrames } from "./key_editor";
import { parseNumber } from "./numbers";
import { OffsetFades } from "./offset_fades";
import { Palette, Shortcuts } from "./palette";
import { poseAt } from "./posing";
import type { Op } from "./protocol";
import { Replace } from "./replace";
import * as store from "./store";
import { choice, setTheme } from "./theme";
import { edit, tell } from "./wire";

function History({ onClose }: { onClose: () => void }) {
  const h = store.doc.value?.history;
  if (!h) return null;
  const rows = h.labels.map((label, i) => ({ label, done: h.first + i + 1 })).reverse();
  const go = (done: number): void => tell("history.goto", { done });
  return (
    <Dialog title={`History: ${h.done} of ${h.len} edits done`} onClose={onClose}>
      <ol class="history" reversed data-testid="history">
        {rows.map((r) => (
          <li key={r.done} value={r.done} class={r.done > h.done ? "undone" : ""}>
            <button
              class="quiet"
              aria-current={r.done === h.done ? "step" : undefined}
              onClick={() => go(r.done)}
            >
              {r.label}
            </button>
          </li>
        ))}
        {h.first > 0 ? (
          <li value={h.first} class="undone">
            {h.first} earlier edits
          </li>
        ) : null}
        <li value={0}>
          <button class="quiet" aria-current={h.done === 0 ? "step" : undefined} onClick={() => go(0)}>
            The clip as it was opened
          </button>
        </li>
      </ol>
      <CloseRow onClose={onClose} />
    </Dialog>
  );
}

/** Achieved states in the place of the keys of a span. */
function bake(span: { from: number; to: number }, every: number): void {
  const clip = store.doc.value?.clip;
  const { q } = store.frames.value;
  if (!clip) return;
  const gone = clip.keys.map((k) => k.frame).filter((f) => f >= span.from && f < span.to);
  const keys: { frame: number; q: number[] }[] = [];
  for (let f = span.from; f < Math.min(span.to, q.length); f += every) {
    keys.push({ frame: f, q: (q[f] ?? []).map((v) => Math.round(v * 1e6) / 1e6) });
  }
  const ops: Op[] = [{ op: "keys.add", args: { keys } }];
  // What was reached has in it what offsets added.
  const added = clip.offsets?.map((o) => o.frame).filter((f) => f >= span.from && f < span.to) ?? [];
  if (added.length) ops.unshift({ op: "offsets.delete", args: { frames: added } });
  if (gone.length) ops.unshift({ op: "keys.delete", args: { frames: gone } });
  void edit("batch", { label: `Take as ${keys.length} keys`, ops }).then((ok) => {
    if (!ok) return;
    store.selection.value = new Set(keys.map((k) => k.frame));
    store.toast(
      `${keys.length} keys from the take${gone.length ? `, ${gone.length} replaced` : ""}`,
      "info",
      true,
    );
  });
}

/** The dialog that is open. */
export function Dialogs() {
  const asked = question.value;
  const onClose = closeDialog;
  const frames = [...store.selection.value].sort((a, b) => a - b);
  const number = (text: string, then: (n: number) => void): boolean => {
    const n = parseNumber(text);
    if (n === undefined) {
      store.toast(`"${text}" is not a number`, "error");
      return false;
    }
    then(n);
    return true;
  };
  switch (asked?.name) {
    case "key":
      return <KeyEditor frame={asked.frame} onClose={onClose} />;
    case "palette":
      return <Palette onClose={onClose} />;
    case "keys":
      return <Shortcuts onClose={onClose} />;
    case "history":
      return <History onClose={onClose} />;
    case "export":
      return <Export onClose={onClose} />;
    case "retime": {
      const pivot = pivotOf(frames, store.playhead.value);
      return (
        <Ask
          title="Retime"
          label={
            pivot === store.playhead.value
              ? "Factor on the distance to the playhead"
              : "Factor on the distance to the first of the keys"
          }
          value="1.5"
          hint="2 is twice as slow. Keys are moved to whole frames."
          onClose={onClose}
          onDone={(t) => number(t, (factor) => void retime(frames, factor))}
        />
      );
    }
    case "scale":
      return <ScaleValues onClose={onClose} />;
    case "slope":
      return <Slope onClose={onClose} />;
    case "time":
      return (
        <Ask
          title="Insert or remove time"
          label="Frames (negative removes)"
          value="10"
          hint="All keys after the playhead move."
          onClose={onClose}
          onDone={(t) =>
            number(t, (n) => {
              const at = store.playhead.value;
              if (n > 0) void edit("time.insert", { at, frames: Math.round(n) });
              else if (n < 0) void edit("time.delete", { from: at, to: at - Math.round(n) });
            })
          }
        />
      );
    case "hold":
      return (
        <Ask
          title="Hold"
          label="Frames, or a time such as 0.5s"
          value="20"
          onClose={onClose}
          onDone={(t) => {
            const hold = wholeFrames(t);
            if (!hold) store.toast(`"${t}" is not a number of frames`, "error");
            else void edit("keys.hold", { frames, hold });
            return !!hold;
          }}
        />
      );
    case "sparsify": {
      const clip = store.doc.value?.clip;
      const some = frames.length > 2 ? frames : (clip?.keys ?? []).map((k) => k.frame);
      const metres = store.unit.value === "m";
      const scale = metres ? 1000 : store.degrees.value ? 180 / Math.PI : 1;
      const unit = metres ? "mm" : store.degrees.value ? "degrees" : "rad";
      return (
        <Ask
          title={`Thin out ${frames.length > 2 ? `${some.length} selected keys` : `all ${some.length} keys`}`}
          label={`Remove keys nearer than this to the line between their neighbours, ${unit}`}
          value={metres ? "2" : store.degrees.value ? "2" : "0.03"}
          hint="Keys at the extremes of the motion stay, and so do keys with a hold, a note or a pose."
          onClose={onClose}
          onDone={(t) =>
            number(t, (n) => {
              const before = some.length;
              void edit("keys.sparsify", { frames: some, tolerance: n / scale }).then((ok) => {
                const left = new Set(store.doc.value?.clip.keys.map((k) => k.frame));
                if (ok)
                  store.toast(
                    `${before - some.filter((f) => left.has(f)).length} of ${before} keys removed`,
                    "info",
                    true,
                  );
              });
            })
          }
        />
      );
    }
    case "densify": {
      const clip = store.doc.value?.clip;
      const span = store.range.value ?? { from: 0, to: clip?.length ?? 0 };
      return (
        <Ask
          title={`Turn the take into keys, frames ${span.from} to ${span.to - 1}`}
          label="Frames from key to key"
          value="1"
          hint="The reached motion becomes the commanded motion. Thin out the keys afterwards."
          onClose={onClose}
          onDone={(t) => number(t, (n) => bake(span, Math.max(1, Math.round(n))))}
        />
      );
    }
    case "pose":
      return (
        <Ask
          title="Save pose"
          label="Name"
          value="pose"
          onClose={onClose}
          onDone={(name) => {
            const clip = store.doc.value?.clip;
            if (!name || !clip) return false;
            void edit("pose.save", {
              name,
              q: store.floating.value ?? poseAt(clip, store.playhead.value),
              replace: true,
            });
            return true;
          }}
        />
      );
    case "marker":
      return (
        <Ask
          title="Marker"
          label="Name"
          value="mark"
          onClose={onClose}
          onDone={(name) => void edit("markers.add", { frame: store.playhead.value, name })}
        />
      );
    case "rename-marker": {
      const frame = store.playhead.value;
      const marker = store.doc.value?.clip.markers?.find((m) => m.frame === frame);
      return (
        <Ask
          title="Rename marker"
          label="Name"
          value={marker?.name ?? ""}
          onClose={onClose}
          onDone={(name) => void edit("markers.set", { frame, name })}
        />
      );
    }
    case "rename-pose": {
      const old = asked.pose;
      return (
        <Ask
          title={`Rename pose ${old}`}
          label="Name"
          value={old}
          hint="Keys that use this pose are updated."
          onClose={onClose}
          onDone={(to) => {
            if (!to) return false;
            if (to !== old) void edit("pose.rename", { name: old, to });
            return true;
          }}
        />
      );
    }
    case "save-as":
      return (
        <Ask
          title="Save as"
          label="File"
          value={store.doc.value?.path ?? `${fileStem(store.doc.value?.clip.name)}.clip.json`}
          hint={`relative to ${store.folder.value}`}
          onClose={onClose}
          onDone={(path) => void save(path)}
        />
      );
    case "replace": {
      const { path } = asked;
      return <Replace path={path} onClose={onClose} onReplace={() => void save(path, true)} />;
    }
    case "changed": {
      const then = (run: () => void) => () => {
        onClose();
        run();
      };
      return (
        <Dialog title="The file has changed" onClose={onClose}>
          <p>
            Another program has changed {store.doc.value?.path} since it was read here. Saving would undo that
            change; reading the file again replaces your edits, and undo brings them back.
          </p>
          <div class="row answers">
            <button type="button" onClick={onClose}>
              Cancel
            </button>
            <button
              type="button"
              onClick={() => openDialog({ name: "save-as" })}
              data-testid="save-elsewhere"
            >
              Save as…
            </button>
            <button type="button" onClick={then(() => void reload())} data-testid="reload">
              Read it again
            </button>
            <button class="main" onClick={then(() => void save(undefined, true))} data-testid="overwrite">
              Overwrite
            </button>
          </div>
        </Dialog>
      );
    }
    case "open":
      return <Open onClose={onClose} />;
    case "insert":
      return <Open onClose={onClose} insert />;
    case "offset":
      return <OffsetFades onClose={onClose} />;
    case "whose":
      return <Whose onClose={onClose} />;
    case "theme":
      return (
        <Dialog title="Theme" onClose={onClose}>
          <div class="row">
            {(["dark", "light", "auto"] as const).map((t) => (
              <button
                key={t}
                aria-pressed={choice() === t}
                onClick={() => {
                  setTheme(t);
                  onClose();
                }}
              >
                {t === "auto" ? "as the system" : t}
              </button>
            ))}
          </div>
        </Dialog>
      );
    case undefined:
      return null;
  }
}
