// One search over all that has a name: commands, joints, poses, policies, examples, own files.

import type { IconNode } from "lucide";
import { Box, File as FileSign, Film, Hand, Rotate3d, Terminal } from "lucide";
import { ACTIONS, act } from "./actions/index";
import { opening } from "./documents";
import { toJoint } from "./joint_row";
import { openLeft } from "./layout";
import { choices } from "./policies";
import { applyPose, poseNames } from "./poses";
import * as store from "./store";
import { http } from "./wire";

export interface Found {
  id: string;
  title: string;
  kind: "Command" | "Joint" | "Pose" | "Policy" | "Example" | "File";
  /** What else is said of it: the group of a command, the robot of an example. */
  of: string;
  keys?: string | undefined;
  /** Why it cannot be done now. */
  why?: string | undefined;
  run: () => void;
}

export const SIGNS: Record<Found["kind"], IconNode> = {
  Command: Terminal,
  Joint: Rotate3d,
  Pose: Hand,
  Policy: Box,
  Example: Film,
  File: FileSign,
};

function everything(): Found[] {
  const editing = store.doc.value !== undefined;
  const commands: Found[] = ACTIONS.map((a) => ({
    id: a.id,
    title: a.title,
    kind: "Command",
    of: a.group,
    keys: a.keys?.[0],
    why: a.not?.(),
    run: () => act(a.id),
  }));
  const joints: Found[] = store.titles.value.map((title, index) => ({
    id: `joint-${index}`,
    title,
    kind: "Joint",
    of: store.groups.value.find((g) => g.joints.includes(index))?.title ?? "",
    run: () => toJoint(index),
  }));
  const poses: Found[] = poseNames().map((name) => ({
    id: `pose-${name}`,
    title: name.replaceAll("_", " "),
    kind: "Pose",
    of: "apply at the playhead",
    run: () => applyPose(name),
  }));
  const policies: Found[] = (editing ? choices().list : []).map((c) => ({
    id: `policy-${c.id}`,
    title: c.title,
    kind: "Policy",
    of: c.name,
    why: c.why,
    run: () => {
      choices().choose(c.id);
      openLeft("policies");
    },
  }));
  const files: Found[] = store.recent.value
    .filter((r) => r.exists)
    .map((r) => ({
      id: `file-${r.path}`,
      title: r.name || (r.path.split("/").at(-1) ?? r.path),
      kind: "File",
      of: r.path,
      run: () => void opening(http("POST /api/open", { body: { path: r.path } })),
    }));
  const examples: Found[] = store.gallery.value.map((g) => ({
    id: `example-${g.id}`,
    title: g.name,
    kind: "Example",
    of: g.robot,
    run: () => void opening(http("POST /api/gallery/{id}", { at: { id: g.id } })),
  }));
  return [...commands, ...joints, ...poses, ...policies, ...files, ...examples];
}

/** The better the smaller; undefined when a word is missing. */
export function rank(words: string[], title: string, beside: string): number | undefined {
  const t = title.toLowerCase();
  const all = `${t} ${beside.toLowerCase()}`;
  if (!words.every((w) => all.includes(w))) return undefined;
  const query = words.join(" ");
  if (t === query) return 0;
  if (t.startsWith(query)) return 1;
  const begins = new RegExp(`\\b${query.replace(/[^\w ]/g, "\\$&")}`);
  return begins.test(t) ? 2 : words.every((w) => t.includes(w)) ? 3 : 4;
}

/** What the words name, best first; without words all commands. */
export function search(text: string): Found[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  const all = everything();
  if (words.length === 0) return all.filter((f) => f.kind === "Command");
  return all
    .flatMap((f) => {
      const r = rank(words, f.title, `${f.kind} ${f.of}`);
      return r === undefined ? [] : [{ f, r }];
    })
    .sort((a, b) => a.r - b.r)
    .map(({ f }) => f);
}
