// The values of one key, typed.

import { useSignal } from "@preact/signals";
import { clock, keyAt, parseTime, values as valuesOf } from "./clip";
import { Answers, Dialog } from "./dialog";
import { ANGLES, fixed, LENGTHS, parseNumber } from "./numbers";
import { barePose, valueEdits } from "./posing";
import type { Op } from "./protocol";
import * as store from "./store";
import { edit } from "./wire";

/** Frames as typed: `20`, `20f`, `0.5s`. */
export const wholeFrames = (text: string): number | undefined => parseTime(text, store.fps.value);

export function KeyEditor({ frame, onClose }: { frame: number; onClose: () => void }) {
  const d = store.doc.value;
  if (!d) return null;
  const key = keyAt(d.clip, frame);
  const q = barePose(d.clip, frame);
  const at = useSignal(String(frame));
  const hold = useSignal(String(key?.hold ?? 1));
  const scale = (j: number): number =>
    d.table.joints[j]?.unit === "rad" && store.degrees.value ? 180 / Math.PI : 1;
  const shown = (v: number, j: number): string => fixed(v * scale(j), scale(j) === 1 ? 4 : 2);
  const own = key && valuesOf(d.clip, key);
  /** Joints that the key has a value for. */
  const stated = d.clip.robot.joints.filter((_, j) => typeof own?.[j] === "number");
  // The key says nothing about a joint whose field is empty.
  const reaches = (key?.reach?.length ?? 0) > 0;
  const before = q.map((v, j) => (own && !reaches && typeof own[j] !== "number" ? "" : shown(v, j)));
  const fields = useSignal(before);
  const done = async (): Promise<void> => {
    const changes: Record<string, number | null> = {};
    for (const [j, text] of fields.value.entries()) {
      if (text.trim() === before[j]) continue;
      const n = parseNumber(text, d.table.joints[j]?.unit === "m" ? LENGTHS : ANGLES, 1 / scale(j), q[j]);
      const name = d.clip.robot.joints[j] ?? "";
      if (text.trim() === "") {
        changes[name] = null;
        continue;
      }
      if (n === undefined) return store.toast(`${name}: "${text}" is not a number`, "error");
      changes[name] = n;
    }
    const [held, to] = [wholeFrames(hold.value), wholeFrames(at.value)];
    if (held === undefined || held < 1)
      return store.toast(`"${hold.value}" is not a number of frames to hold`, "error");
    if (to === undefined) return store.toast(`"${at.value}" is not a frame`, "error");
    const ops: Op[] = [];
    const empty = fields.value.every((text) => text.trim() === "");
    if (empty && !reaches) {
      if (await edit("keys.delete", { frames: [frame] })) onClose();
      return;
    }
    // Without any value a key keeps its end-effector goals alone.
    const values = empty ? Object.fromEntries(stated.map((name) => [name, null])) : changes;
    const given = Object.keys(values).length > 0;
    if (given || held !== (key?.hold ?? 1)) {
      const args = { frame, ...(given ? { values } : {}), hold: held };
      ops.push(...(key && given && !empty ? valueEdits(key, args) : [{ op: "keys.set" as const, args }]));
    }
    if (to !== frame) ops.push({ op: "keys.move", args: { frames: [frame], df: to - frame } });
    if (ops.length === 0 || (await edit("batch", { label: `Edit key at ${frame}`, ops }))) onClose();
  };
  return (
    <Dialog title={`Key at frame ${frame}, ${clock(frame, d.clip.fps)}`} onClose={onClose}>
      <form
        onSubmit={(e) => {
          e.preventDefault();
          void done();
        }}
      >
        <div class="row">
          <label>
            frame{" "}
            <input
              type="text"
              style="width: 70px"
              value={at.value}
              onInput={(e) => (at.value = e.currentTarget.value)}
            />
          </label>
          <label>
            hold{" "}
            <input
              type="text"
              style="width: 70px"
              value={hold.value}
              onInput={(e) => (hold.value = e.currentTarget.value)}
            />{" "}
            frames
          </label>
          <span class="of">
            {store.unit.value === "m"
              ? "values in m"
              : store.degrees.value
                ? "values in degrees"
                : "values in rad"}
          </span>
        </div>
        <div class="typed">
          {fields.value.map((t, j) => (
            <label key={j}>
              {store.titles.value[j]}
              <input
                type="text"
                value={t}
                placeholder={shown(q[j] ?? 0, j)}
                title="empty: the key says nothing about this joint"
                onInput={(e) =>
                  (fields.value = fields.value.map((x, i) => (i === j ? e.currentTarget.value : x)))
                }
              />
            </label>
          ))}
        </div>
        <Answers onClose={onClose} />
      </form>
    </Dialog>
  );
}
