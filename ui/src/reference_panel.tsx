// The film or sound that is followed, beside the timeline.

import { useSignal } from "@preact/signals";
import { Volume2, VolumeX, X } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { Icon } from "./icon";
import { fixed, parseNumber, TIMES } from "./numbers";
import { begins, closeReference, media, muted, pickReference, reference } from "./reference";
import * as store from "./store";

/** Where the film begins: the second of it that frame 0 shows. */
function Begin() {
  const text = useSignal<string | undefined>(undefined);
  const commit = (): void => {
    const typed = text.value;
    text.value = undefined;
    if (typed === undefined) return;
    const secs = parseNumber(typed, TIMES);
    if (secs === undefined) store.toast(`"${typed}" is not a number of seconds`, "error");
    else begins.value = secs;
  };
  return (
    <label title="The second of the file that is shown at frame 0; below 0 it begins later than the clip">
      at frame 0{" "}
      <input
        type="text"
        class="time"
        aria-label="Second of the file at frame 0"
        data-testid="reference-begin"
        value={text.value ?? fixed(begins.value, 2)}
        onFocus={(e) => e.currentTarget.select()}
        onInput={(e) => (text.value = e.currentTarget.value)}
        onBlur={commit}
        onKeyDown={(e) => {
          if (e.key === "Enter") e.currentTarget.blur();
        }}
      />{" "}
      s
    </label>
  );
}

export function ReferencePanel() {
  const host = useRef<HTMLDivElement>(null);
  const own = reference.value;
  useEffect(() => {
    if (own) host.current?.append(media);
    return () => media.remove();
  }, [own]);
  return (
    <section class="rendered reference" aria-label="Reference" data-testid="reference">
      {own ? (
        <>
          <div ref={host} class={own.seen ? "film" : "film unseen"}>
            {own.seen ? null : <p class="empty">A sound: it is drawn below the ruler.</p>}
          </div>
          <div class="row tools">
            <span class="of grow" title={own.name}>
              {own.name}
            </span>
            <Begin />
            <button
              class="icon quiet"
              aria-label="Sound of the reference"
              aria-pressed={!muted.value}
              title={muted.value ? "Play its sound" : "Mute it"}
              onClick={() => (muted.value = !muted.value)}
            >
              <Icon of={muted.value ? VolumeX : Volume2} size={14} />
            </button>
            <button
              class="icon quiet"
              aria-label="Remove the reference"
              title="Remove it from the page"
              onClick={closeReference}
              data-testid="reference-remove"
            >
              <Icon of={X} size={14} />
            </button>
          </div>
        </>
      ) : (
        <>
          <p class="empty">A film or a sound to follow. It plays with the clip and never leaves this page.</p>
          <div class="row tools">
            <button class="main" onClick={pickReference} data-testid="reference-pick">
              Choose a file…
            </button>
          </div>
        </>
      )}
    </section>
  );
}
