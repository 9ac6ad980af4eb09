// Which panels are shown and which tab is in front, kept for the next visit.

import { effect, signal } from "@preact/signals";

export type LeftTab = "poses" | "policies" | "takes";
export const LEFT_TABS: LeftTab[] = ["poses", "policies", "takes"];

/** The keys as rows, or as curves. */
export type SheetTab = "timeline" | "graph";

const kept = localStorage.getItem("left-tab");

export const leftTab = signal<LeftTab>(LEFT_TABS.find((t) => t === kept) ?? "poses");
export const sheetTab = signal<SheetTab>(
  localStorage.getItem("sheet-tab") === "graph" ? "graph" : "timeline",
);
export const leftShown = signal(localStorage.getItem("left-hidden") === null);
export const rightShown = signal(localStorage.getItem("right-hidden") === null);

export function startLayout(): void {
  effect(() => localStorage.setItem("left-tab", leftTab.value));
  effect(() => localStorage.setItem("sheet-tab", sheetTab.value));
  for (const [name, shown] of [
    ["left-hidden", leftShown],
    ["right-hidden", rightShown],
  ] as const)
    effect(() => (shown.value ? localStorage.removeItem(name) : localStorage.setItem(name, "yes")));
}

/** Puts a tab of the left panel in front. */
export function openLeft(tab: LeftTab): void {
  leftTab.value = tab;
  leftShown.value = true;
}
