// The question whether edits that came back are kept: it is asked once for each document, also if the page is loaded
// again.

import { signal } from "@preact/signals";
import type { DocumentView } from "./protocol";
import type { Document } from "./store";

const PLACE = "restored";

const answered = signal<readonly string[]>(JSON.parse(globalThis.sessionStorage?.getItem(PLACE) ?? "[]"));

/** How many edits came back when the document was opened. */
export function recoveredOf(d: DocumentView): number {
  return d.restored?.edits ?? 0;
}

/** How many of them are done: what was undone since is none. */
export function restoredOf(d: DocumentView): number {
  return Math.min(recoveredOf(d), d.history.done);
}

/** Numbers of documents begin anew with each studio, so what was restored is part of the name. */
function nameOf(d: Pick<Document, "path" | "opened" | "recovered">): string {
  return [d.path ?? "", d.opened, d.recovered].join(":");
}

export function isAnswered(d: Pick<Document, "path" | "opened" | "recovered">): boolean {
  return answered.value.includes(nameOf(d));
}

export function setAnswered(d: Pick<Document, "path" | "opened" | "recovered">): void {
  answered.value = [...answered.value, nameOf(d)];
  globalThis.sessionStorage?.setItem(PLACE, JSON.stringify(answered.value));
}
