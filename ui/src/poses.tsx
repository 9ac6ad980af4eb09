// The poses of the robot and of the clip, to be applied by a click.

import { useSignal } from "@preact/signals";
import { Search } from "lucide";
import { openDialog } from "./dialog";
import { Icon } from "./icon";
import { unlockedOnly } from "./locks";
import { openMenu } from "./menu";
import type { Op } from "./protocol";
import { inClipOrder } from "./sites";
import * as store from "./store";
import { addressOf, applyOp, asOne, edit } from "./wire";

/** The clip's own poses, then those of the robot. */
export function poseNames(): string[] {
  const own = Object.keys(store.doc.value?.clip.poses ?? {});
  const given = store.doc.value ? (store.robot.value?.poses ?? []).map((p) => p.name) : [];
  // A pose of the robot keeps its place when the clip gets a copy of it.
  return [...own.filter((n) => !given.includes(n)), ...given];
}

/** At the playhead, or to the selected keys; `blend` 1 is all of it. */
export function applyPose(name: string, blend = 1, mirrored = false): void {
  const own = Object.keys(store.doc.value?.clip.poses ?? {});
  const frames = store.selection.value.size ? [...store.selection.value] : [store.playhead.value];
  const ops: Op[] = [];
  const builtin = store.robot.value?.poses.find((p) => p.name === name);
  if (!own.includes(name) && builtin)
    ops.push({ op: "pose.save", args: { name, q: inClipOrder(builtin.q) } });
  ops.push({ op: "pose.apply", args: { name, frames, blend, mirrored, ...unlockedOnly() } });
  const op = asOne(ops, `Apply pose ${name}`);
  if (op) void applyOp(op);
}

export function Poses() {
  const blend = useSignal(100);
  const find = useSignal("");
  const mirrored = useSignal(false);
  const d = store.doc.value;
  if (!d) return null;
  const own = Object.keys(d.clip.poses ?? {});
  const names = poseNames().filter((n) =>
    n.replaceAll("_", " ").toLowerCase().includes(find.value.replaceAll("_", " ").toLowerCase()),
  );
  const apply = (name: string): void => applyPose(name, blend.value / 100, mirrored.value);
  /** Another picture is asked for when the pose changes. */
  const version = (name: string): string =>
    `${d.clip.robot.id}${own.includes(name) ? JSON.stringify(d.clip.poses?.[name]) : ""}`.slice(0, 600);
  const menu = (e: MouseEvent, name: string): void => {
    e.preventDefault();
    const why = own.includes(name)
      ? null
      : "this pose belongs to the robot; apply it once to copy it into the clip";
    openMenu(`Pose ${name}`, { x: e.clientX, y: e.clientY }, [
      { title: "Apply", run: () => apply(name) },
      { title: "Rename…", why, run: () => openDialog({ name: "rename-pose", pose: name }) },
      {
        title: "Delete",
        why,
        run: () =>
          void edit("pose.delete", { name }).then(
            (ok) =>
              ok && store.toast(`pose ${name} deleted; keys that used it keep its values`, "info", true),
          ),
      },
    ]);
  };
  return (
    <section class="panel fill pose-list" aria-label="Poses" data-testid="poses">
      {names.length > 8 || find.value ? (
        <label class="find">
          <Icon of={Search} size={14} />
          <input
            type="text"
            placeholder="Find a pose"
            aria-label="Find a pose"
            value={find.value}
            onInput={(e) => (find.value = e.currentTarget.value)}
          />
        </label>
      ) : null}
      <div class="scroll">
        <div class="poses">
          {names.map((name) => (
            <button
              class="pose quiet"
              key={name}
              data-menu
              onClick={() => apply(name)}
              onContextMenu={(e) => menu(e, name)}
              title={`Apply ${name} at the playhead or to the selected keys; right-click or Shift+F10 to rename or delete it`}
              data-testid={`pose-${name}`}
            >
              <img
                src={addressOf("GET /api/pose.jpg", { query: { pose: name, v: version(name) } })}
                alt=""
                loading="lazy"
                onError={(e) => (e.currentTarget.style.visibility = "hidden")}
              />
              <span>{name.replaceAll("_", " ")}</span>
            </button>
          ))}
        </div>
      </div>
      <div class="blend">
        <label title="How far the pose is blended in: at 50 % half way from where the robot is">
          Blend
          <input
            type="range"
            min={0}
            max={100}
            step={5}
            value={blend.value}
            onInput={(e) => (blend.value = Number(e.currentTarget.value))}
          />
          <span class="num">{blend.value} %</span>
        </label>
        <label title={store.noMirror.value ?? "Apply the mirror image"}>
          <input
            type="checkbox"
            disabled={store.noMirror.value !== null}
            checked={mirrored.value}
            onChange={(e) => (mirrored.value = e.currentTarget.checked)}
          />{" "}
          mirrored
        </label>
      </div>
    </section>
  );
}
