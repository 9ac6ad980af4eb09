// What the studio says, and what it changes on the page.

import { batch } from "@preact/signals";
import { adopt, refreshGallery } from "./documents";
import { onJob, refreshJobs, refreshWorkspace } from "./jobs";
import { patched } from "./patch";
import { pathTouched } from "./path";
import { dragCancelled, dragged, jointMoved } from "./posing";
import type { Event, State, WorkerState } from "./protocol";
import { within } from "./span";
import * as store from "./store";
import { heardOfTakes } from "./takes";
import { settle, settleEdits } from "./wire";

/** This page's number. */
let client = 0;

export function receive(e: Event): void {
  switch (e.event) {
    case "hello":
      client = e.client;
      store.link.value = "open";
      onWelcome(e.state);
      return;
    case "edit": {
      const d = store.doc.value;
      if (d) {
        batch(() => {
          const clip = patched(d.clip, e.patch);
          store.doc.value = { ...d, rev: e.rev, clip, dirty: e.dirty, history: e.history };
          // A key that has gone, or gone elsewhere, is no longer selected.
          store.range.value = within(store.range.value, clip.length);
          store.playhead.value = Math.min(store.playhead.value, Math.max(0, clip.length - 1));
          const there = [...store.selection.value].filter((f) => clip.keys.some((k) => k.frame === f));
          if (there.length < store.selection.value.size) store.selection.value = new Set(there);
          store.announcement.value = e.label;
        });
      }
      if (e.by === client) settle(e.id, { ok: true });
      return;
    }
    case "reply":
      settle(e.id, e.error ? { ok: false, error: e.error } : { ok: true, result: e.result ?? null });
      return;
    case "document":
      store.moving.value = undefined;
      store.demand.value = undefined;
      settleEdits();
      adopt(e.document);
      return;
    case "saved": {
      const d = store.doc.value;
      if (d) store.doc.value = { ...d, path: e.path, dirty: d.rev !== e.rev };
      store.toast(`saved ${e.path}`);
      return;
    }
    case "findings": {
      const d = store.doc.value;
      if (d) store.doc.value = { ...d, findings: e };
      return;
    }
    case "rollout.settings": {
      // They are sent back when one of them is changed: without the name of the event.
      const { event: _, ...settings } = e;
      store.settings.value = settings;
      return;
    }
    case "rollout.frames": {
      const f = store.performed.value;
      store.performed.value = {
        q: [...f.q.slice(0, e.from), ...e.q],
        error: [...f.error.slice(0, e.from), ...e.error],
      };
      return;
    }
    case "rollout.state":
      store.rollout.value = e;
      if (e.phase === "failed" && e.error) store.announcement.value = e.error;
      return;
    case "select": {
      // A joint that this clip does not have is none of its rows.
      const joint = store.doc.value?.clip.robot.joints.indexOf(e.joint ?? "") ?? -1;
      store.joint.value = joint < 0 ? undefined : joint;
      store.site.value = e.site;
      return;
    }
    case "joint":
      // A drag in another page's 3D view is that page's to make an edit of.
      if (e.tab !== undefined && e.tab !== store.TAB) return;
      dragged(e.values, e.done);
      void jointMoved(e.values, e.done);
      return;
    case "joint.cancelled":
      if (e.tab === undefined || e.tab === store.TAB) dragCancelled();
      return;
    case "locked":
      store.locked.value = new Set(e.joints);
      return;
    case "pinned":
      store.pins.value = e.pins;
      return;
    case "path.point":
      if (e.tab === undefined || e.tab === store.TAB) pathTouched(e.frame, e.values);
      return;
    case "notice":
      store.toast(e.message, e.level === "error" ? "error" : "info");
      return;
    case "takes":
      heardOfTakes(e);
      return;
    case "worker":
      heardOfWorker(e);
      return;
    case "job":
      onJob(e);
  }
}

function heardOfWorker(state: WorkerState): void {
  const before = store.worker.value;
  store.worker.value = state;
  if (state.phase === "restarting")
    store.toast(
      `The simulation stopped unexpectedly and is restarting (${state.reason ?? "unknown reason"}). Nothing was lost.`,
      "error",
    );
  if (state.phase === "ready" && before?.phase === "restarting")
    store.announcement.value = "the simulation is running again";
}

function onWelcome(state: State): void {
  batch(() => {
    store.version.value = state.version;
    store.folder.value = state.folder;
    store.viser.value = state.viser;
    store.settings.value = state.rollout;
    store.policies.value = state.policies;
    store.worker.value = state.worker;
    store.locked.value = new Set(state.locked);
    store.pins.value = state.pins;
  });
  heardOfTakes(state.takes);
  adopt(state.document);
  void refreshGallery().then(rememberKilled);
  void refreshJobs();
  // What was trained in this folder can be chosen.
  void refreshWorkspace();
}

let reminded = false;

/** Once: a clip that a killed studio left, when this one was started for something else. */
function rememberKilled(): void {
  const left = store.drafts.value.find((d) => d.abandoned);
  if (reminded || !left || !store.doc.value) return;
  reminded = true;
  store.toast(
    `"${left.name || "untitled"}" was open when the studio was killed; you find it under Examples, Your clips`,
  );
}
