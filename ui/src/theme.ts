// Which palette is in use, and its colours for canvases, read from the style sheet.

import { signal } from "@preact/signals";
import type { Theme } from "./timeline/scene";

export type Choice = "dark" | "light" | "auto";

const KEY = "theme";
const light = matchMedia("(prefers-color-scheme: light)");

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
    font: v("font"),
  };
  return cached;
}

function variable(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** One of the colours of a list. */
function one(list: string, i: number): string {
  const all = variable(list).split(/\s+/);
  return all[i % all.length] ?? "";
}

/** The colour of a curve by its number. */
export const hue = (i: number): string => one("series", i);

/** The colour of the take that is compared at this place. */
export const takeColor = (place: number): string => one("compared", place);

/** The stops of the background behind the robot. */
export const stageColors = (): string => variable("stage");

/** Rises when the colours or the letters change. */
export const palette = signal(0);

/** Dark unless something else was chosen. */
export function choice(): Choice {
  const kept = localStorage.getItem(KEY);
  return kept === "light" || kept === "auto" ? kept : "dark";
}

export function isDark(): boolean {
  return document.documentElement.dataset.theme !== "light";
}

function apply(): void {
  const wanted = choice();
  const dark = wanted === "auto" ? !light.matches : wanted === "dark";
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  cached = undefined;
  palette.value++;
}

export function setTheme(theme: Choice): void {
  localStorage.setItem(KEY, theme);
  apply();
}

/** Before anything is drawn. Canvases draw once more when the letters have come. */
export function startTheme(): void {
  apply();
  light.addEventListener("change", apply);
  void document.fonts.load('13px "Inter Variable"').then(apply, () => undefined);
}
