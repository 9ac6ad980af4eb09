// What a hand holds between press and release: a key on the timeline, a point of the graph, a slider. While it holds
// something, shortcuts make no other edit, and Escape and undo give up what is held and nothing else.

let giveUp: (() => void) | undefined;

/** Something is held from now on, until the button is let go; `cancel` gives it up. */
export function hold(cancel: () => void): void {
  const over = new AbortController();
  const { signal } = over;
  const mine = (): void => cancel();
  const end = (): void => {
    over.abort();
    if (giveUp === mine) giveUp = undefined;
  };
  giveUp = mine;
  for (const type of ["pointerup", "pointercancel"])
    window.addEventListener(type, end, { signal, capture: true });
  // The button may have been let go over the 3D view, which is a window of its own.
  window.addEventListener("pointermove", (e) => e.buttons === 0 && end(), { signal, capture: true });
}

export function isHeld(): boolean {
  return giveUp !== undefined;
}

/** What is held goes back to where it was. */
export function release(): void {
  const cancel = giveUp;
  giveUp = undefined;
  cancel?.();
}
