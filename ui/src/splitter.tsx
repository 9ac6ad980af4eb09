// Edges of panels that can be moved: by mouse, by arrow keys; a double click gives the size back
// that the page chose. Sizes are kept for the next visit.

import { useRef } from "preact/hooks";

export type Panel = "left" | "right" | "curves" | "sheet";

/** Which way the panel grows, and between which sizes, shares of the window. */
const PANELS: Record<
  Panel,
  { title: string; across: boolean; sign: 1 | -1; least: number; most: number; element: string }
> = {
  left: {
    title: "Width of the left panel",
    across: true,
    sign: 1,
    least: 0.08,
    most: 0.25,
    element: ".left",
  },
  right: {
    title: "Width of the right panel",
    across: true,
    sign: -1,
    least: 0.12,
    most: 0.4,
    element: ".right",
  },
  curves: { title: "Width of the curves", across: true, sign: -1, least: 0.12, most: 0.6, element: ".side" },
  sheet: {
    title: "Height of the timeline",
    across: false,
    sign: -1,
    least: 0.18,
    most: 0.6,
    element: ".below",
  },
};

const key = (of: Panel): string => `panel-${of}`;

/** Shares, not pixels: another window keeps the proportions. */
function put(of: Panel, share: number | undefined): void {
  const p = PANELS[of];
  const style = document.documentElement.style;
  if (share === undefined || !Number.isFinite(share)) {
    style.removeProperty(`--${of}`);
    localStorage.removeItem(key(of));
    return;
  }
  const sane = Math.min(p.most, Math.max(p.least, share));
  document.querySelector(`.splitter.of-${of}`)?.setAttribute("aria-valuenow", String(Math.round(100 * sane)));
  style.setProperty(`--${of}`, `${(100 * sane).toFixed(2)}${p.across ? "vw" : "vh"}`);
  localStorage.setItem(key(of), sane.toFixed(4));
}

export function restorePanels(): void {
  for (const of of Object.keys(PANELS) as Panel[]) {
    const kept = localStorage.getItem(key(of));
    if (kept !== null) put(of, Number(kept));
  }
}

export function Splitter({ of }: { of: Panel }) {
  const p = PANELS[of];
  const bar = useRef<HTMLDivElement>(null);
  const held = useRef<{ at: number; share: number } | undefined>(undefined);
  const share = (): number => {
    const r = document.querySelector(p.element)?.getBoundingClientRect();
    return !r ? 0 : p.across ? r.width / innerWidth : r.height / innerHeight;
  };
  const place = (e: PointerEvent): number => (p.across ? e.clientX / innerWidth : e.clientY / innerHeight);
  const release = (): void => {
    held.current = undefined;
    bar.current?.classList.remove("held");
  };
  const onKey = (e: KeyboardEvent): void => {
    const step = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1 }[e.key];
    if (step === undefined) return;
    e.preventDefault();
    e.stopPropagation();
    put(of, share() + step * p.sign * 0.02);
  };
  return (
    <div
      ref={bar}
      class={`splitter of-${of}`}
      role="separator"
      tabIndex={0}
      aria-label={p.title}
      aria-valuenow={Math.round(100 * share())}
      data-testid={`splitter-${of}`}
      aria-orientation={p.across ? "vertical" : "horizontal"}
      title={`${p.title}: drag or use arrow keys; double-click to reset`}
      onPointerDown={(e) => {
        e.preventDefault();
        bar.current?.setPointerCapture(e.pointerId);
        bar.current?.classList.add("held");
        held.current = { at: place(e), share: share() };
      }}
      onPointerMove={(e) =>
        held.current && put(of, held.current.share + (place(e) - held.current.at) * p.sign)
      }
      onPointerUp={release}
      onPointerCancel={release}
      onDblClick={() => put(of, undefined)}
      onKeyDownCapture={onKey}
      onClick={(e) => e.stopPropagation()}
    />
  );
}
