// Everything a person can do, once: shortcuts, palette, menus and buttons all come here.

import { blockAt } from "../layers";
import type { Item } from "../menu";
import * as store from "../store";
import type { Action } from "./action";
import { DOCUMENT, ROLLOUT } from "./clips";
import { KEYS } from "./keys";
import { LAYERS } from "./layers";
import { MASKS } from "./masks";
import { PLAYBACK, seek } from "./playback";
import { TANGENTS } from "./tangents";
import { VIEW } from "./view";

export const ACTIONS: Action[] = [
  ...PLAYBACK,
  ...KEYS,
  ...TANGENTS,
  ...LAYERS,
  ...MASKS,
  ...VIEW,
  ...DOCUMENT,
  ...ROLLOUT,
];

export function act(id: string): void {
  const action = ACTIONS.find((a) => a.id === id);
  const why = action?.not?.();
  if (why) store.toast(why);
  else action?.run();
}

/** What can be done with the marker at a frame. */
export function markerItems(frame: number): Item[] {
  const here = (id: string) => () => {
    seek(frame);
    act(id);
  };
  return [
    { title: "Rename marker…", run: here("rename-marker") },
    { title: "Marker one frame earlier", keys: "<", run: here("marker-earlier") },
    { title: "Marker one frame later", keys: ">", run: here("marker-later") },
    { title: "Delete marker", run: here("delete-marker") },
  ];
}

const item = (id: string): Item[] => {
  const a = ACTIONS.find((x) => x.id === id);
  return a ? [{ title: a.title, keys: a.keys?.[0] ?? "", run: () => act(id), why: a.not?.() }] : [];
};

/** What can be done with the offset at a frame. */
export function offsetItems(frame: number): Item[] {
  store.chosenOffset.value = frame;
  seek(frame);
  const ids = ["fade", "wider", "narrower", "earlier", "later", "bake", "delete"];
  return ids.flatMap((id) => item(`offset-${id}`));
}

/** What can be done with the block that begins at a frame. */
export function blockItems(frame: number): Item[] {
  seek(frame);
  const select = (): void => {
    const c = store.doc.value?.clip;
    const own = c && blockAt(c, frame);
    if (!own) return;
    const inside = c.keys.map((k) => k.frame).filter((f) => f >= own.frame && f < own.to);
    store.selection.value = new Set(inside);
  };
  return [
    { title: "Select its keys", run: select },
    ...[
      "block-repeat",
      "block-earlier",
      "block-later",
      "rename-marker",
      "delete-marker",
      "block-delete",
    ].flatMap(item),
  ];
}

/** How curves pass the chosen points of the graph. */
export function tangentItems(): Item[] {
  return TANGENTS.map((a) => ({ title: a.title, run: () => act(a.id), why: a.not?.() }));
}

/** Where the motion starts: what stands before frame 0. */
export function startItems(): Item[] {
  return ["start-key", "start-rest", "start-pose", "start-take"].flatMap((id) => {
    const a = ACTIONS.find((x) => x.id === id);
    return a ? [{ title: a.title, run: () => act(id), why: a.not?.() }] : [];
  });
}
