// A dialog: what it looks like, how the focus moves in it, and which one is open.

import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";

/** A question to the person, with what it is about. */
export type Question =
  | { name: "palette" | "keys" | "history" | "theme" | "export" | "open" | "whose" | "save-as" | "changed" }
  | {
      name:
        | "retime"
        | "scale"
        | "slope"
        | "time"
        | "hold"
        | "sparsify"
        | "densify"
        | "pose"
        | "marker"
        | "rename-marker"
        | "insert"
        | "offset";
    }
  | { name: "key"; frame: number }
  | { name: "rename-pose"; pose: string }
  | { name: "replace"; path: string };

/** The dialog that is open. */
export const question = signal<Question | undefined>(undefined);

export function openDialog(of: Question): void {
  question.value = of;
}

export function closeDialog(): void {
  question.value = undefined;
}

export function Dialog(props: {
  title: string;
  onClose: () => void;
  children: ComponentChildren;
  class?: string;
}) {
  const box = useRef<HTMLDivElement>(null);
  const close = useRef(props.onClose);
  close.current = props.onClose;
  useLayoutEffect(() => {
    const before = document.activeElement;
    const enter = (): void => {
      const first = box.current?.querySelector<HTMLElement>("input:enabled, select:enabled, button:enabled");
      // A long sheet is read from its top.
      (first ?? box.current)?.focus({ preventScroll: true });
      if (first instanceof HTMLInputElement) first.select();
    };
    // A button that is disabled while it works loses the focus to the page: its keys come here.
    const astray = (e: KeyboardEvent): void => {
      if (e.target instanceof Node && box.current?.contains(e.target)) return;
      e.stopPropagation();
      if (e.key === "Escape") return close.current();
      if (e.key === "Tab") e.preventDefault();
      enter();
    };
    enter();
    document.addEventListener("keydown", astray, true);
    return () => {
      document.removeEventListener("keydown", astray, true);
      if (before instanceof HTMLElement) before.focus();
    };
  }, []);
  const onKey = (e: KeyboardEvent): void => {
    e.stopPropagation();
    if (e.key === "Escape") props.onClose();
    if (e.key !== "Tab") return;
    const all = [
      ...(box.current?.querySelectorAll<HTMLElement>(
        "input:enabled, select:enabled, button:enabled, a[href]",
      ) ?? []),
    ];
    const edge = e.shiftKey ? all[0] : all.at(-1);
    if (document.activeElement === edge) {
      e.preventDefault();
      (e.shiftKey ? all.at(-1) : all[0])?.focus();
    }
  };
  return (
    <div class="scrim" onPointerDown={(e) => e.target === e.currentTarget && props.onClose()}>
      <div
        class={`dialog ${props.class ?? ""}`}
        role="dialog"
        aria-modal="true"
        aria-label={props.title}
        ref={box}
        tabIndex={-1}
        onKeyDown={onKey}
      >
        <h2>{props.title}</h2>
        {props.children}
      </div>
    </div>
  );
}

/** The last row of a form: what it does, or nothing. */
export function Answers({ onClose, yes = "OK" }: { onClose: () => void; yes?: string }) {
  return (
    <div class="row answers">
      <button type="button" onClick={onClose}>
        Cancel
      </button>
      <button class="main" type="submit">
        {yes}
      </button>
    </div>
  );
}

/** The last row of a sheet that is only read. */
export function CloseRow({ onClose }: { onClose: () => void }) {
  return (
    <div class="row answers">
      <button class="main" onClick={onClose}>
        Close
      </button>
    </div>
  );
}
