// Colours of the canvas, read from the style sheet so that there is one palette.

import { signal } from "@preact/signals";
import type { Theme } from "./timeline/draw";

let cached: Theme | undefined;

export function colors(): Theme {
  if (cached) return cached;
  const style = getComputedStyle(document.documentElement);
  const v = (name: string): string => style.getPropertyValue(`--${name}`).trim();
  cached = {
    back: v("back"),
    panel: v("panel"),
    rule: v("rule"),
    faint: v("faint"),
    text: v("text"),
    dim: v("dim"),
    key: v("key"),
    keyEdge: v("key-edge"),
    selected: v("selected"),
    fill: v("fill"),
    hatch: v("hatch"),
    blind: v("blind"),
    playhead: v("playhead"),
    look: v("look"),
    error: v("error"),
    marker: v("marker"),
    cached: v("cached"),
    focus: v("focus"),
  };
  return cached;
}

/** The colour of a curve by its number. */
export function hue(i: number): string {
  const all = getComputedStyle(document.documentElement).getPropertyValue("--series").trim().split(/\s+/);
  return all[i % all.length] || "#56b4e9";
}

/** Rises when the colours change. */
export const palette = signal(0);

function changed(): void {
  cached = undefined;
  palette.value++;
}

matchMedia("(prefers-color-scheme: light)").addEventListener("change", changed);

/** What was chosen, else what the system says. */
export function isDark(): boolean {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : !matchMedia("(prefers-color-scheme: light)").matches;
}

export function setTheme(theme: "dark" | "light" | "auto"): void {
  if (theme === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = theme;
  localStorage.setItem("theme", theme);
  changed();
}
