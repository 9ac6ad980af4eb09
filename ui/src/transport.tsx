// Play, step, time, loop, speed, and the switches that decide what an edit does.

import { useSignal } from "@preact/signals";
import { Pause, Play, Repeat, SkipBack, SkipForward, StepBack, StepForward } from "lucide";
import { useEffect } from "preact/hooks";
import { act } from "./actions/index";
import { seek } from "./actions/playback";
import { clock, parseTime } from "./clip";
import { Icon } from "./icon";
import { startPlayback } from "./playback";
import { Splitter } from "./splitter";
import * as store from "./store";
import { edit } from "./wire";

/** A rollout that takes longer than a moment. */
function stoppable(): boolean {
  const r = store.rollout.value;
  if (r?.phase !== "running" && r?.phase !== "waiting") return false;
  if (r.stage && r.stage !== "correct") return true;
  const slow = store.policies.value.some((p) => p.slow && p.name === store.settings.value.policy);
  return slow || store.settings.value.refine || (r.ms_per_frame ?? 0) * (r.frames - r.cached_to) > 1500;
}

/** Over how many seconds a new offset grows and fades. */
function Fade() {
  const text = useSignal<string | undefined>(undefined);
  const commit = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined) return;
    const frames = parseTime(/^\d*\.\d+$/.test(t.trim()) ? `${t.trim()}s` : t, store.fps.value);
    if (frames === undefined) store.toast(`"${t}" is not a time: type 0.5s or 10`, "error");
    else store.fade.value = frames;
  };
  return (
    <label class="of" title="Over how long a new offset grows and fades; type 0.5s, or frames">
      <span class="wide-only">fade</span>{" "}
      <input
        class="time"
        type="text"
        aria-label="Fade of new offsets, seconds"
        data-testid="fade"
        value={text.value ?? clock(store.fade.value, store.fps.value)}
        onFocus={(e) => e.currentTarget.select()}
        onInput={(e) => (text.value = e.currentTarget.value.replace(" s", "s"))}
        onBlur={commit}
        onKeyDown={(e) => {
          if (e.key !== "Enter") return;
          commit();
          e.currentTarget.blur();
        }}
      />
    </label>
  );
}

const counted = (n: number, what: string): string[] => (n ? [`${n} ${what}${n === 1 ? "" : "s"}`] : []);

/** A clip is not cut before its last key without a word: that takes a click more. */
function setLength(length: number): void {
  const d = store.doc.value;
  if (!d) return;
  const { clip, opened, rev } = d;
  const beyond = (all: readonly { frame: number }[] = []): number =>
    all.filter((x) => x.frame >= length).length;
  const numbers = [beyond(clip.keys), beyond(clip.offsets), beyond(clip.markers)];
  const all = numbers.reduce((sum, n) => sum + n, 0);
  if (all === 0 || length < 1) return void edit("clip.length", { length });
  const lost = ["key", "offset", "marker"].flatMap((what, i) => counted(numbers[i] ?? 0, what)).join(", ");
  store.toast(`${lost} ${all === 1 ? "is" : "are"} at frame ${length} or later`, "error", false, "length", {
    title: "Cut the clip there",
    run: () => {
      const now = store.doc.value;
      if (now?.opened !== opened) return;
      // What came meanwhile was not counted.
      if (now.rev === rev) void edit("clip.length", { length, cut: true });
      else setLength(length);
    },
  });
}

export function Transport() {
  useEffect(() => startPlayback(), []);
  const text = useSignal<string | undefined>(undefined);
  const long = useSignal<string | undefined>(undefined);
  const frame = store.playhead.value;
  const stretch = (): void => {
    const t = long.value;
    long.value = undefined;
    if (t === undefined) return;
    const length = parseTime(t, store.fps.value);
    if (length === undefined) store.toast(`"${t}" is not a length: type 100, 5:00 or 5s`, "error");
    else if (length !== store.length.value) setLength(length);
  };
  const commit = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined) return;
    const f = parseTime(t, store.fps.value);
    if (f === undefined) store.toast(`"${t}" is not a time: type 55, 55f, 2:15 or 2.75s`, "error");
    else seek(f);
  };
  return (
    <div class="transport" role="toolbar" aria-label="Playback">
      <Splitter of="sheet" />
      <button class="icon quiet" onClick={() => act("home")} aria-label="To the start" title="Home">
        <Icon of={SkipBack} />
      </button>
      <button class="icon quiet" onClick={() => act("prev-frame")} aria-label="Previous frame" title="Left">
        <Icon of={StepBack} />
      </button>
      <button
        class="main"
        onClick={() => act("play")}
        aria-label={store.playing.value ? "Pause" : "Play"}
        title="Space"
        data-testid="play"
      >
        <Icon of={store.playing.value ? Pause : Play} />
      </button>
      <button class="icon quiet" onClick={() => act("next-frame")} aria-label="Next frame" title="Right">
        <Icon of={StepForward} />
      </button>
      <button class="icon quiet" onClick={() => act("end")} aria-label="To the end" title="End">
        <Icon of={SkipForward} />
      </button>
      <button
        class="icon quiet"
        aria-label="Loop"
        aria-pressed={store.loop.value}
        onClick={() => act("loop")}
        title="Loop (L)"
      >
        <Icon of={Repeat} />
      </button>
      <select
        aria-label="Speed"
        value={String(store.speed.value)}
        onChange={(e) => (store.speed.value = Number(e.currentTarget.value))}
      >
        {[0.1, 0.25, 0.5, 1, 2, 4].map((s) => (
          <option key={s} value={String(s)}>
            {s}×
          </option>
        ))}
      </select>
      <label>
        <span class="wide-only">frame</span>{" "}
        <input
          class="time"
          type="text"
          aria-label="Frame or time"
          data-testid="frame"
          value={text.value ?? String(frame)}
          onFocus={(e) => e.currentTarget.select()}
          onInput={(e) => (text.value = e.currentTarget.value)}
          onBlur={commit}
          onKeyDown={(e) => {
            if (e.key === "Enter") {
              commit();
              e.currentTarget.blur();
            }
          }}
        />
      </label>
      <span class="of">{clock(frame, store.fps.value)} of</span>
      <input
        class="time length"
        type="text"
        aria-label="Length of the clip in frames or time"
        title={`Length: ${clock(store.length.value, store.fps.value)}; type frames, or 5s`}
        data-testid="length"
        value={long.value ?? String(store.length.value)}
        onFocus={(e) => e.currentTarget.select()}
        onInput={(e) => (long.value = e.currentTarget.value)}
        onBlur={stretch}
        onKeyDown={(e) => {
          if (e.key === "Escape") long.value = undefined;
          if (e.key === "Enter" || e.key === "Escape") {
            stretch();
            e.currentTarget.blur();
          }
        }}
      />
      <span class="of wide-only">{clock(store.length.value, store.fps.value)}</span>
      <span class="grow" />
      <span class="segments" role="group" aria-label="What moving a joint does" data-testid="layer">
        <button
          aria-pressed={!store.shaping.value}
          onClick={() => store.shaping.value && act("shaping")}
          title="Moving a joint makes or changes a key at the playhead (J)"
        >
          Keys
        </button>
        <button
          aria-pressed={store.shaping.value}
          onClick={() => store.shaping.value || act("shaping")}
          title="Moving a joint adds to the motion around the playhead: it grows and fades (J)"
          data-testid="shaping"
        >
          Offsets
        </button>
      </span>
      {store.shaping.value ? <Fade /> : null}
      <button
        aria-pressed={store.autoKey.value}
        onClick={() => act("auto-key")}
        title="Moving a joint makes a key at the playhead"
      >
        Auto-key
      </button>
      <button
        aria-pressed={store.settings.value.auto}
        onClick={() => act("auto")}
        title="Roll out after every edit (Shift+R)"
      >
        Auto-rollout
      </button>
      {stoppable() ? (
        <button
          onClick={() => act("stop-rollout")}
          title="Stop and keep the frames so far (Shift+Esc)"
          data-testid="stop-rollout"
        >
          Stop
        </button>
      ) : (
        <button onClick={() => act("rollout")} title="R">
          Roll out
        </button>
      )}
    </div>
  );
}
