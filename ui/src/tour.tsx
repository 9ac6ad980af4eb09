// Five steps through the editor, once. It stands beside what it speaks of and blocks nothing; it
// can be skipped, and comes again only when it is asked for.

import { signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import * as store from "./store";

const KEY = "tour";

interface Step {
  title: string;
  text: string;
  /** What it speaks of. */
  of: string;
}

const STEPS: Step[] = [
  {
    title: "Place keys in time",
    text: "Each diamond is a pose that the robot shall reach. Drag it to another time. Click anywhere to go there.",
    of: ".sheet",
  },
  {
    title: "Pose the robot",
    text: "Drag a part of the robot, drag a joint's field, or click a pose. Moving a joint makes a key at the playhead.",
    of: ".right",
  },
  {
    title: "A policy performs it",
    text: "Physics runs at once after every edit. Where nothing is keyed, the policy decides. Choose another one here.",
    of: ".policy-select",
  },
  {
    title: "See the error",
    text: "Blue is what you command, solid is what the robot reaches. The mean error is below; Space plays the motion.",
    of: ".viewport",
  },
  {
    title: "Find anything",
    text: "Ctrl+K searches joints, poses, examples and commands. Question mark shows all shortcuts.",
    of: ".search",
  },
];

/** The step that is shown; undefined when none is. */
export const tourStep = signal<number | undefined>(undefined);

export function startTour(): void {
  tourStep.value = 0;
}

/** Shown once to who has never seen it, as soon as the editor is. */
export function offerTour(): void {
  if (localStorage.getItem(KEY) !== null) return;
  localStorage.setItem(KEY, "shown");
  startTour();
}

export function Tour() {
  const box = useRef<HTMLDivElement>(null);
  const next = useRef<HTMLButtonElement>(null);
  const at = tourStep.value;
  const step = at === undefined || store.page.value !== "editor" ? undefined : STEPS[at];
  useLayoutEffect(() => {
    const card = box.current;
    const of = step && document.querySelector<HTMLElement>(step.of);
    if (!card || !of) return;
    of.classList.add("toured");
    of.scrollIntoView({ block: "nearest" });
    const place = (): void => {
      const [r, c] = [of.getBoundingClientRect(), card.getBoundingClientRect()];
      const room = (v: number, most: number): number => Math.max(8, Math.min(v, most - 8));
      // Beside it where there is room, else above or below, else inside.
      const left =
        r.left > c.width + 16
          ? r.left - c.width - 12
          : r.right + c.width + 16 < innerWidth
            ? r.right + 12
            : r.left + 16;
      const beside = left < r.left || left > r.right;
      const top = beside ? r.top : r.top > c.height + 60 ? r.top - c.height - 52 : r.bottom - c.height - 16;
      card.style.left = `${room(left, innerWidth - c.width)}px`;
      card.style.top = `${room(r.height < 60 ? r.bottom + 12 : top, innerHeight - c.height)}px`;
    };
    place();
    window.addEventListener("resize", place);
    return () => {
      of.classList.remove("toured");
      window.removeEventListener("resize", place);
    };
  }, [step]);
  const open = step !== undefined;
  useEffect(() => {
    if (!open) return;
    // The search that asked for it gives the focus back first; a field in which somebody types keeps it.
    const soon = requestAnimationFrame(() => {
      if (!document.activeElement?.matches("input, select, textarea")) next.current?.focus();
    });
    return () => cancelAnimationFrame(soon);
  }, [open]);
  if (!step || at === undefined) return null;
  const go = (to: number): void => void (tourStep.value = to < STEPS.length ? Math.max(0, to) : undefined);
  return (
    <div
      ref={box}
      class="tour"
      role="dialog"
      aria-label={step.title}
      data-testid="tour"
      onKeyDown={(e) => {
        if (e.key !== "Escape") return;
        e.stopPropagation();
        tourStep.value = undefined;
      }}
    >
      <h2>{step.title}</h2>
      <p>{step.text}</p>
      <div class="row">
        <span class="dots">
          {at + 1} of {STEPS.length}
        </span>
        {at > 0 ? (
          <button class="quiet" onClick={() => go(at - 1)}>
            Back
          </button>
        ) : (
          <button class="quiet" onClick={() => (tourStep.value = undefined)} data-testid="tour-skip">
            Skip
          </button>
        )}
        <button ref={next} class="main" onClick={() => go(at + 1)} data-testid="tour-next">
          {at + 1 < STEPS.length ? "Next" : "Done"}
        </button>
      </div>
    </div>
  );
}
