// Time that passes by itself. A browser test stops it, by putting a list in place of the clock
// before the page is loaded, and runs what is due when it likes.

declare global {
  interface Window {
    __timers?: { ms: number; run: () => void }[];
  }
}

/** Runs this after a number of milliseconds. */
export function afterMs(ms: number, run: () => void): void {
  const stopped = globalThis.window?.__timers;
  if (stopped) stopped.push({ ms, run });
  else setTimeout(run, ms);
}
