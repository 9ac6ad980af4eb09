// Menus of the right button, of Shift+F10 and of the menu key: the focus goes in, arrows, Home,
// End and first letters move it, Escape and Tab give it back.

import { signal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import * as store from "./store";
import { timeline } from "./timeline/handle";

export interface Item {
  title: string;
  keys?: string;
  run: () => void;
  /** Why it cannot be done now. */
  why?: string | null | undefined;
}

interface Open {
  label: string;
  x: number;
  y: number;
  items: Item[];
}

const shown = signal<Open | undefined>(undefined);

export function openMenu(label: string, at: { x: number; y: number }, items: Item[]): void {
  shown.value = { label, ...at, items };
}

/** The menu of what has the focus, else of the place where the playhead is. */
export function menuByKey(): void {
  const own = document.activeElement?.closest<HTMLElement>("[data-menu]");
  if (!own) return timeline.value?.menu();
  const r = own.getBoundingClientRect();
  own.dispatchEvent(
    new MouseEvent("contextmenu", {
      bubbles: true,
      cancelable: true,
      clientX: r.left + r.width / 2,
      clientY: r.top + r.height / 2,
    }),
  );
}

export function Menu() {
  const menu = shown.value;
  return menu ? <Shown key={`${menu.x}:${menu.y}:${menu.label}`} menu={menu} /> : null;
}

function Shown({ menu }: { menu: Open }) {
  const box = useRef<HTMLDivElement>(null);
  const before = useRef(document.activeElement).current;
  /** The focus goes back first: what is chosen may open a dialog, which gives it back in turn. */
  const close = (): void => {
    if (box.current?.contains(document.activeElement) && before instanceof HTMLElement)
      before.focus({ preventScroll: true });
    shown.value = undefined;
  };
  // Before it is seen: the next key may come at once.
  useLayoutEffect(() => {
    const element = box.current;
    if (!element) return;
    const r = element.getBoundingClientRect();
    element.style.left = `${Math.max(4, Math.min(menu.x, innerWidth - r.width - 6))}px`;
    element.style.top = `${Math.max(4, Math.min(menu.y, innerHeight - r.height - 6))}px`;
    const all = (): HTMLElement[] => [...element.querySelectorAll<HTMLElement>("[role=menuitem]")];
    const outside = (e: Event): void => {
      if (!(e.target instanceof Node) || !element.contains(e.target)) close();
    };
    const key = (e: KeyboardEvent): void => {
      const items = all();
      const at = items.indexOf(document.activeElement as HTMLElement);
      const go = (i: number): void => items[(i + items.length) % items.length]?.focus();
      if (e.key === "Escape" || e.key === "Tab") close();
      else if (e.key === "ArrowDown") go(at + 1);
      else if (e.key === "ArrowUp") go(at < 0 ? -1 : at - 1);
      else if (e.key === "Home") go(0);
      else if (e.key === "End") go(-1);
      else if (e.key === "Enter" || e.key === " ") items[at]?.click();
      else if (e.key.length === 1 && !e.ctrlKey && !e.altKey && !e.metaKey) {
        const letter = e.key.toLowerCase();
        const from = [...items.slice(at + 1), ...items.slice(0, at + 1)];
        from.find((i) => i.textContent?.toLowerCase().startsWith(letter))?.focus();
      } else return;
      e.preventDefault();
      e.stopPropagation();
    };
    all()[0]?.focus({ preventScroll: true });
    window.addEventListener("pointerdown", outside, true);
    window.addEventListener("keydown", key, true);
    return () => {
      window.removeEventListener("pointerdown", outside, true);
      window.removeEventListener("keydown", key, true);
    };
  }, []);
  const chosen = (item: Item): void => {
    close();
    if (item.why) store.toast(item.why);
    else item.run();
  };
  return (
    <div
      class="menu"
      role="menu"
      aria-label={menu.label}
      ref={box}
      style={`left: ${menu.x}px; top: ${menu.y}px`}
    >
      {menu.items.map((item) => (
        <button
          key={item.title}
          role="menuitem"
          tabIndex={-1}
          aria-disabled={item.why ? "true" : undefined}
          title={item.why ?? ""}
          onClick={() => chosen(item)}
        >
          {item.title}
          <span class="of">{item.keys}</span>
        </button>
      ))}
    </div>
  );
}
