// What the rest of the page may ask of the timeline.

import { signal } from "@preact/signals";

export interface TimelineHandle {
  /** Shows the whole clip. */
  fit(): void;
  /** Opens the menu of the playhead. */
  menu(): void;
  /** Chooses the row that is this many rows further down. */
  step(by: 1 | -1): void;
  /** Opens or folds the chosen group, else shows the values of the key at the playhead. */
  enter(): void;
}

/** The timeline that is on the page. */
export const timeline = signal<TimelineHandle | undefined>(undefined);
