// Offsets over the motion, and blocks of a sequence.

import { keyAt } from "../clip";
import { openDialog } from "../dialog";
import { type Block, blockAt, blocksOf, reordered } from "../layers";
import {
  bakeOffsets,
  deleteOffset,
  moveOffset,
  needsBase,
  needsOffset,
  toggleShaping,
  widen,
} from "../offsets";
import { needsSite } from "../pins";
import { shownPose } from "../posing";
import { sitePlace } from "../sites";
import * as store from "../store";
import { complain, edit } from "../wire";
import { type Action, clip, needsClip } from "./action";
import { inTurn } from "./keys";

/** Frames of the curve between a block and its copy. */
const BLEND = 10;

function block(): Block | undefined {
  const c = clip();
  return c && blockAt(c, store.playhead.value);
}

const needsBlock = (): string | undefined =>
  block() ? undefined : "put the playhead on a block first: a clip that was inserted is one";

/** The block under the playhead changes places with its neighbour. */
async function moveBlock(by: 1 | -1): Promise<void> {
  const c = clip();
  const own = block();
  if (!c || !own) return;
  const place = blocksOf(c).findIndex((b) => b.frame === own.frame) + by;
  await orderBlocks(own, place);
}

/** Puts a block at another place among the others; the playhead goes with it. */
export async function orderBlocks(own: Block, place: number): Promise<void> {
  const c = clip();
  if (!c) return;
  const before = blocksOf(c);
  const frames = reordered(before, own.frame, place);
  if (frames.join() === before.map((b) => b.frame).join()) return;
  if (!(await edit("blocks.order", { frames }))) return;
  const now = clip();
  const moved = now && blocksOf(now)[frames.indexOf(own.frame)];
  if (moved) store.playhead.value = moved.frame;
}

/** A key that says where the chosen end effector is, in place of joint values. */
async function keyPoint(): Promise<void> {
  const opened = store.doc.value?.opened;
  const site = store.site.value;
  const q = shownPose();
  if (!site || !q) return;
  const frame = store.playhead.value;
  try {
    const place = await sitePlace(site, q);
    // The key goes where the playhead was, into the clip as it is by now.
    const c = clip();
    if (!place || !c || store.doc.value?.opened !== opened) return;
    const grid = (v: number): number => Math.round(v * 1e6) / 1e6;
    const goal = { site, pos: place.pos.map(grid) as [number, number, number] };
    const own = keyAt(c, frame);
    const reach = [...(own?.reach ?? []).filter((r) => r.site !== site), goal];
    const made = own
      ? await edit("keys.set", { frame, reach })
      : await edit("keys.add", { keys: [{ frame, reach }] });
    if (made) store.selection.value = new Set([frame]);
  } catch (e) {
    complain(e);
  }
}

export const LAYERS: Action[] = [
  {
    id: "key-point",
    title: "Key where the chosen end effector is; its joints follow from it",
    group: "Keys",
    keys: ["Shift+K"],
    not: needsSite,
    run: () => void keyPoint(),
  },
  {
    id: "shaping",
    title: "Offsets on or off: moving a joint adds to the motion around the playhead, or makes keys",
    group: "Keys",
    keys: ["J"],
    not: () => (store.shaping.value ? undefined : needsBase()),
    run: toggleShaping,
  },
  {
    id: "offset-wider",
    title: "Let the offset fade over two more frames",
    group: "Keys",
    keys: ["Shift+J"],
    not: needsOffset,
    run: () => inTurn(() => widen(2)),
  },
  {
    id: "offset-narrower",
    title: "Let the offset fade over two frames less",
    group: "Keys",
    keys: ["Alt+J"],
    not: needsOffset,
    run: () => inTurn(() => widen(-2)),
  },
  {
    id: "offset-fade",
    title: "Offset: hold and fades…",
    group: "Keys",
    not: needsOffset,
    run: () => openDialog({ name: "offset" }),
  },
  {
    id: "offset-earlier",
    title: "Move the offset one frame earlier",
    group: "Keys",
    not: needsOffset,
    run: () => inTurn(() => moveOffset(-1)),
  },
  {
    id: "offset-later",
    title: "Move the offset one frame later",
    group: "Keys",
    not: needsOffset,
    run: () => inTurn(() => moveOffset(1)),
  },
  {
    id: "offset-delete",
    title: "Delete the offset",
    group: "Keys",
    not: needsOffset,
    run: () => void deleteOffset(),
  },
  {
    id: "offset-bake",
    title: "Bake: add all offsets to the keys",
    group: "Keys",
    not: () => (clip()?.offsets?.length ? undefined : "there are no offsets"),
    run: bakeOffsets,
  },
  {
    id: "insert",
    title: "Insert another clip at the playhead…",
    group: "Document",
    keys: ["Shift+I"],
    not: needsClip,
    run: () => openDialog({ name: "insert" }),
  },
  {
    id: "block-earlier",
    title: "Move the block before the one before it",
    group: "Keys",
    keys: ["Alt+,"],
    not: needsBlock,
    run: () => inTurn(() => moveBlock(-1)),
  },
  {
    id: "block-later",
    title: "Move the block after the one after it",
    group: "Keys",
    keys: ["Alt+."],
    not: needsBlock,
    run: () => inTurn(() => moveBlock(1)),
  },
  {
    id: "block-repeat",
    title: "Repeat the block after itself",
    group: "Keys",
    keys: ["Alt+D"],
    not: needsBlock,
    run: () => {
      const own = block();
      if (own) void edit("blocks.repeat", { frame: own.frame, blend: BLEND });
    },
  },
  {
    id: "block-delete",
    title: "Delete the block with its frames",
    group: "Keys",
    not: needsBlock,
    run: () => {
      const own = block();
      if (own) void edit("blocks.delete", { frame: own.frame });
    },
  },
];
