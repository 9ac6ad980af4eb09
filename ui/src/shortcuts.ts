// Keyboard: one table (actions.ts), one listener, also installed inside the viewport's frame.

import { ACTIONS, act } from "./actions/index";
import { isHeld, release } from "./hand";
import { cancelDrag } from "./posing";
import * as store from "./store";
import { retimeByHand } from "./timeline/gestures";

/** `Ctrl+Shift+V` for an event; Cmd counts as Ctrl. */
export function chord(e: KeyboardEvent): string {
  const name = e.code === "Space" ? "Space" : e.key.length === 1 ? e.key.toUpperCase() : e.key;
  const symbol = e.key.length === 1 && !/[a-z0-9 ]/i.test(e.key);
  const parts = [];
  if (e.ctrlKey || e.metaKey) parts.push("Ctrl");
  if (e.altKey) parts.push("Alt");
  // A symbol already says that shift was held.
  if (e.shiftKey && !symbol) parts.push("Shift");
  return [...parts, name].join("+");
}

const byKey = new Map(
  ACTIONS.flatMap((a) =>
    (a.keys ?? []).map((k) => [k.replace(/\b([a-z])$/, (c) => c.toUpperCase()), a.id] as const),
  ),
);

function typing(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target.tagName === "TEXTAREA" || target.tagName === "SELECT") return true;
  return target instanceof HTMLInputElement && target.type !== "range" && target.type !== "checkbox";
}

/** A key that gave something up goes on being pressed: its repetitions mean nothing. */
let spent = false;

/** A hand on a key, a point, a slider or the robot: what it does comes before every shortcut. */
function underHand(e: KeyboardEvent, keys: string): boolean {
  spent &&= e.repeat;
  const held = isHeld() || store.moving.value !== undefined;
  if (!spent && !(held && byKey.has(keys))) return false;
  e.preventDefault();
  e.stopPropagation();
  if (spent || (keys !== "Ctrl+Z" && keys !== "Escape")) return true;
  spent = true;
  release();
  cancelDrag();
  return true;
}

export function onKeyDown(e: KeyboardEvent): void {
  if (e.defaultPrevented || document.querySelector(".scrim, .menu")) return;
  const keys = chord(e);
  if (underHand(e, keys)) return;
  if (typing(e.target) && !/^(Ctrl\+[SKOE]|Ctrl\+Shift\+[SO]|F1)$/.test(keys)) return;
  const focus = e.target instanceof HTMLElement ? e.target : undefined;
  // A focused button or heading keeps Space and Enter, a slider or an edge of a panel its arrows.
  if ((focus?.tagName === "BUTTON" || focus?.tagName === "SUMMARY") && (keys === "Space" || keys === "Enter"))
    return;
  // The tour is ended by Esc while the focus is in it.
  if (focus?.closest("[role=dialog]") && keys === "Escape") return;
  if (focus instanceof HTMLInputElement && focus.type === "range") {
    if (/Arrow|Home|End/.test(keys)) return;
    // Esc gives them back to the page.
    if (keys === "Escape") focus.blur();
  }
  if (focus?.getAttribute("role") === "separator" && /Arrow/.test(keys)) return;
  // A menu's button opens it.
  if (focus?.getAttribute("aria-haspopup") === "menu" && keys === "ArrowDown") return;
  const id = byKey.get(keys);
  if (!id) return;
  e.preventDefault();
  e.stopPropagation();
  // S held while dragging retimes by hand; only S alone asks for a number.
  if (id === "retime") {
    if (e.repeat) return;
    retimeByHand.used = false;
    window.addEventListener("keyup", () => retimeByHand.used || act(id), { once: true });
    return;
  }
  act(id);
}

/** Our keys go first, wherever the focus is: here and in the viewport's frame. */
export function install(target: Window): void {
  target.addEventListener("keydown", onKeyDown, true);
}
