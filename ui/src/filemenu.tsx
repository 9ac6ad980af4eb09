// The File menu: everything that goes in and out, with its keys.

import { useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { ACTIONS, act } from "./actions/index";
import { opening, refreshGallery } from "./documents";
import * as store from "./store";
import { http } from "./wire";

const ITEMS: (string | null)[] = [
  "new",
  "open",
  "pick",
  "insert",
  null,
  "save",
  "save-as",
  "export",
  null,
  "gallery",
];
/** Recent files that are a click away. */
const RECENT = 5;

export function FileMenu() {
  const open = useSignal(false);
  const button = useRef<HTMLButtonElement>(null);
  const menu = useRef<HTMLDivElement>(null);
  const show = (on: boolean): void => {
    open.value = on;
    if (on) void refreshGallery();
  };
  const items = (): HTMLButtonElement[] => [
    ...(menu.current?.querySelectorAll<HTMLButtonElement>("button:enabled") ?? []),
  ];
  const close = (back: boolean): void => {
    open.value = false;
    if (back) button.current?.focus();
  };
  useLayoutEffect(() => {
    if (!open.value) return;
    items()[0]?.focus();
    const away = (e: Event): void => {
      if (
        e.target instanceof Node &&
        !menu.current?.contains(e.target) &&
        !button.current?.contains(e.target)
      )
        close(false);
    };
    // A click into the 3D view is told to its own window only.
    const blurred = (): void => close(false);
    window.addEventListener("pointerdown", away, true);
    window.addEventListener("blur", blurred);
    return () => {
      window.removeEventListener("pointerdown", away, true);
      window.removeEventListener("blur", blurred);
    };
  }, [open.value]);
  const onKey = (e: KeyboardEvent): void => {
    const all = items();
    const here = all.indexOf(document.activeElement as HTMLButtonElement);
    const to = (i: number): void => all[(i + all.length) % all.length]?.focus();
    if (e.key === "ArrowDown") to(here + 1);
    else if (e.key === "ArrowUp") to(here - 1);
    else if (e.key === "Home") to(0);
    else if (e.key === "End") to(-1);
    else if (e.key === "Escape") close(true);
    else if (e.key === "Tab") return close(false);
    else return;
    e.preventDefault();
    e.stopPropagation();
  };
  const path = store.doc.value?.path;
  const recent = store.recent.value.filter((r) => r.exists && r.path !== path).slice(0, RECENT);
  return (
    <span class="filemenu">
      <button
        class="quiet"
        ref={button}
        aria-haspopup="menu"
        aria-expanded={open.value}
        onClick={() => show(!open.value)}
        onKeyDown={(e) => {
          if (e.key === "ArrowDown" && !open.value) {
            e.preventDefault();
            show(true);
          }
        }}
        data-testid="file-menu"
      >
        File
      </button>
      {open.value ? (
        <div class="menu" role="menu" aria-label="Clips" ref={menu} onKeyDown={onKey}>
          {ITEMS.map((id, i) => {
            const a = ACTIONS.find((x) => x.id === id);
            if (!a) return <hr key={i} />;
            const why = a.not?.();
            return (
              <button
                key={a.id}
                role="menuitem"
                disabled={!!why}
                title={why ?? ""}
                onClick={() => {
                  close(true);
                  act(a.id);
                }}
                data-testid={`menu-${a.id}`}
              >
                {a.title}
                <span style="color: var(--dim)">{a.keys?.[0] ?? ""}</span>
              </button>
            );
          })}
          {recent.length ? <p class="sub">Recent</p> : null}
          {recent.map((r) => (
            <button
              key={r.path}
              role="menuitem"
              title={r.path}
              onClick={() => {
                close(true);
                void opening(http("POST /api/open", { body: { path: r.path } }));
              }}
            >
              {r.name || r.path.split("/").at(-1)}
              <span style="color: var(--dim)">{r.robot}</span>
            </button>
          ))}
        </div>
      ) : null}
    </span>
  );
}
