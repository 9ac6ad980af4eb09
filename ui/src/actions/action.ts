// What an action is, and what several of them need.

import { openDialog, type Question } from "../dialog";
import * as store from "../store";

export interface Action {
  id: string;
  title: string;
  group: "Playback" | "Keys" | "Masks" | "View" | "Document" | "Rollout";
  keys?: string[];
  run: () => void;
  /** Why it cannot be done now; undefined when it can. */
  not?: () => string | undefined;
}

/** Dialogs that are about nothing but what is open. */
type Plain = Exclude<Question, { frame: number } | { pose: string } | { path: string }>;

export const clip = () => store.doc.value?.clip;

export const selected = (): number[] => [...store.selection.value].sort((a, b) => a - b);

export const needsKeys = (): string | undefined =>
  store.selection.value.size ? undefined : "select keys first";

export const needsClip = (): string | undefined => (clip() ? undefined : "open a clip first");

export const needsTake = (): string | undefined =>
  store.rollout.value?.phase === "done" && store.frames.value.q.length
    ? undefined
    : "there is no finished take yet";

export const dialog = (name: Plain["name"]) => () => openDialog({ name });
