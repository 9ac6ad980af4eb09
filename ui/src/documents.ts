// The open document, and the ways to another one.

import { batch } from "@preact/signals";
import { openDialog } from "./dialog";
import { forgetPose } from "./posing";
import type { DocumentView } from "./protocol";
import { closeReference } from "./reference";
import { recoveredOf, restoredOf } from "./restored";
import * as store from "./store";
import { complain, http, Refusal, tell } from "./wire";

/** The server has this document open, or none. */
export function adopt(d: DocumentView | null): void {
  const before = store.doc.value;
  batch(() => {
    const came = d && {
      restored: restoredOf(d),
      recovered: recoveredOf(d),
      superseded: d.restored?.file_changed ?? false,
    };
    store.doc.value = d && came ? { ...d, ...came } : undefined;
    // What the page asks for and shows of a robot is of this clip's, or waits for it.
    if (store.robot.value?.id !== d?.clip.robot.id) store.robot.value = undefined;
    if (!d) {
      store.page.value = "gallery";
      store.performed.value = { q: [], error: [] };
      store.rollout.value = undefined;
      return;
    }
    store.policies.value = d.policies;
    if (store.page.value === "gallery") store.page.value = "editor";
    // The same one again comes to who has fallen behind or was cut off.
    if (before?.opened !== d.opened || before.clip.robot.id !== d.clip.robot.id || d.rev < before.rev)
      forget();
    if (before && before.opened !== d.opened && store.locked.value.size) {
      store.locked.value = new Set();
      tell("view.lock", { joints: [] });
    }
  });
  if (d) void loadRobot(d.clip.robot.id);
}

/** What was chosen in one document means nothing in the next. */
function forget(): void {
  store.announcement.value = "";
  store.renaming.value = false;
  store.playing.value = false;
  store.selection.value = new Set();
  store.playhead.value = 0;
  store.range.value = undefined;
  store.joint.value = undefined;
  store.site.value = undefined;
  store.performed.value = { q: [], error: [] };
  store.rollout.value = undefined;
  closeReference();
  forgetPose();
}

async function loadRobot(id: string): Promise<void> {
  if (store.robot.value?.id === id) return;
  try {
    const facts = await http("GET /api/robot/{id}", { at: { id } });
    // Another document may have been opened meanwhile, of another robot.
    if (store.doc.value?.clip.robot.id === id) store.robot.value = facts;
  } catch (e) {
    complain(e);
  }
}

/** Shows the document that this request opens; the `document` event does the rest. */
export async function opening(request: Promise<DocumentView>): Promise<void> {
  const left = store.doc.value;
  try {
    const opened = await request;
    // The event of it came first, or is about to: it brings what follows from it, too. Another
    // document may even have been opened since, and stays.
    if ((store.doc.value?.opened ?? -1) < opened.opened) adopt(opened);
    store.page.value = "editor";
    if (left && !left.path && left.history.done > 0)
      store.toast(
        `"${left.clip.name || "untitled"}" was never saved; you find it under Examples, Your clips`,
      );
  } catch (e) {
    complain(e);
  }
}

/** What a file of a clip of this name is called, before its ending. */
export function fileStem(name: string | undefined): string {
  const plain = (name ?? "").replace(/(^|\.)clip(\.json)?$/i, "");
  return plain.replace(/[^\w-]+/g, "_") || "untitled";
}

export async function save(path?: string, replace = false): Promise<void> {
  try {
    await http("POST /api/save", { body: path === undefined ? { replace } : { path, replace } });
  } catch (e) {
    if (e instanceof Refusal && e.body.code === "exists" && path !== undefined) {
      openDialog({ name: "replace", path });
      return;
    }
    if (e instanceof Refusal && e.body.code === "untitled") openDialog({ name: "save-as" });
    else if (e instanceof Refusal && e.body.code === "changed") openDialog({ name: "changed" });
    else complain(e);
  }
}

/** Takes over what the file holds now; undo brings the edits back. */
export async function reload(): Promise<void> {
  try {
    await http("POST /api/reload");
    store.toast("the file was read again", "info", true);
  } catch (e) {
    complain(e);
  }
}

let refreshes = 0;
let latest = Promise.resolve();

/** Reads the lists of the first page. The answer to an earlier call never replaces a later one's. */
export function refreshGallery(): Promise<void> {
  latest = readGallery(++refreshes);
  return latest;
}

async function readGallery(own: number): Promise<void> {
  try {
    const lists = [http("GET /api/gallery"), http("GET /api/recent"), http("GET /api/drafts")] as const;
    const [gallery, recent, drafts] = await Promise.all(lists);
    if (own !== refreshes) return latest;
    store.gallery.value = gallery;
    store.recent.value = recent;
    store.drafts.value = drafts;
  } catch (e) {
    complain(e);
  }
}
