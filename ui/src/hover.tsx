// What the pointer is over: the joint and its value beside it.

import { computed, signal } from "@preact/signals";
import { isLocked } from "./locks";
import { valueAt } from "./posing";
import { siteTitle } from "./sites";
import * as store from "./store";

/** The joint that moves a body of this name: its own, else that of the nearest one it hangs on. */
function jointOf(body: string): string | undefined {
  const robot = store.robot.value;
  let at = robot?.bodies.findIndex((b) => b.name === body) ?? -1;
  for (let steps = 0; robot && at >= 0 && steps < robot.bodies.length; steps++) {
    const fact = robot.bodies[at];
    const joint = fact?.joints.at(-1);
    if (joint !== undefined) return robot.table.joints[joint]?.name;
    if (!fact || at === 0) return undefined;
    at = fact.parent;
  }
  return undefined;
}

const over = signal<{ x: number; y: number; body: string } | undefined>(undefined);
let asking = false;
let next: (() => Promise<void>) | undefined;

/** The pointer is there, in pixels of the viewport; `ask` finds out what is under it. */
export function hover(x: number, y: number, ask: () => Promise<string | null>): void {
  next = async () => {
    const body = await ask();
    over.value = body === null ? undefined : { x, y, body };
  };
  if (asking) return;
  asking = true;
  void (async () => {
    try {
      for (let step: (() => Promise<void>) | undefined = next; step; step = next) {
        next = undefined;
        await step();
        // Sixteen a second are as good as sixty.
        await new Promise((resolve) => setTimeout(resolve, 60));
      }
    } catch {
      over.value = undefined;
    }
    asking = false;
  })();
}

export function hoverEnds(): void {
  next = undefined;
  over.value = undefined;
}

/** Whether the pointer is over a link. */
export const overLink = computed(() => over.value !== undefined);

/** Joint and value beside the pointer. */
export function Tip() {
  const at = over.value;
  const d = store.doc.value;
  if (!at || !d) return null;
  const moving = store.moving.value;
  const pulled = moving ? Object.keys(moving) : [];
  const joint = pulled.length === 1 ? pulled[0] : jointOf(at.body);
  const index = joint === undefined ? -1 : d.clip.robot.joints.indexOf(joint);
  const fact = d.table.joints[index];
  const frame = Math.round(store.playhead.value);
  const value =
    moving?.[joint ?? ""] ??
    store.floating.value?.[index] ??
    store.frames.value.q[frame]?.[index] ??
    valueAt(d.clip, index, frame);
  return (
    <div class="tip" style={`left: ${at.x + 14}px; top: ${at.y + 10}px`} data-testid="tip">
      {pulled.length > 1 && store.site.value ? (
        siteTitle(store.site.value)
      ) : index < 0 ? (
        at.body
      ) : (
        <>
          {store.titles.value[index]} <b class="num">{store.shown(value ?? 0, fact?.unit ?? "rad")}</b>
          {isLocked(joint ?? "") ? " · locked" : ""}
        </>
      )}
    </div>
  );
}
