// A film or a sound beside the clip, to be followed by eye and ear. The browser decodes the file; it stays
// in this page and is never sent.

import { effect, signal } from "@preact/signals";
import * as store from "./store";
import type { Sound, Times } from "./timeline/scene";

export interface Reference {
  name: string;
  /** It has pictures, not only a sound. */
  seen: boolean;
  /** How long it is. */
  secs: number;
}

export const reference = signal<Reference | undefined>(undefined);
/** Its loudness over time, once it is known. */
export const sound = signal<Sound | undefined>(undefined);
/** The second of the file that frame 0 shows; below 0 it begins after frame 0. */
export const begins = signal(0);
export const muted = signal(false);

/** What the time axis shows of it. */
export const heard = (): Times["heard"] => sound.value && { sound: sound.value, begins: begins.value };

/** What plays it, wherever it is shown. */
export const media = document.createElement("video");
media.preload = "auto";
media.playsInline = true;

/** A file larger than this is played without its sound being drawn: the drawing needs all of it at once. */
const DRAWN = 512 << 20;
/** Samples a second that are looked at, and loudnesses a second that are kept. */
const RATE = 8000;
const PER_SEC = 80;
/** The playing file may be so far from the playhead, seconds, before it is set there: a jump is heard. */
const LAG = 0.12;

/** Whether a file can only be a film or a sound. */
export const isMedia = (file: { name: string; type?: string }): boolean =>
  /^(video|audio)\//.test(file.type ?? "") ||
  /\.(mp4|m4v|mov|webm|mkv|ogv|mp3|m4a|aac|wav|ogg|oga|opus|flac)$/i.test(file.name);

/** The time in the file at a frame. */
const secondAt = (frame: number): number => frame / store.fps.value + begins.value;

export async function openReference(file: File): Promise<void> {
  closeReference();
  const url = URL.createObjectURL(file);
  const plays = await new Promise<boolean>((done) => {
    media.onloadedmetadata = () => done(true);
    media.onerror = () => done(false);
    media.src = url;
  });
  media.onloadedmetadata = media.onerror = null;
  if (!plays) {
    closeReference();
    return store.toast(`${file.name}: this browser cannot play it`, "error");
  }
  reference.value = { name: file.name, seen: media.videoWidth > 0, secs: media.duration };
  store.side.value = "reference";
  const heard = file.size <= DRAWN ? await loudness(file) : undefined;
  // Another file may have been chosen meanwhile.
  if (media.src === url) sound.value = heard;
}

export function closeReference(): void {
  const url = media.src;
  reference.value = undefined;
  sound.value = undefined;
  begins.value = 0;
  media.pause();
  media.removeAttribute("src");
  media.load();
  if (url) URL.revokeObjectURL(url);
}

/** The loudest sample of each short piece, 0 to 1; undefined where there is no sound. */
async function loudness(file: File): Promise<Sound | undefined> {
  try {
    const audio = await new OfflineAudioContext(1, 1, RATE).decodeAudioData(await file.arrayBuffer());
    const wave = audio.getChannelData(0);
    const piece = RATE / PER_SEC;
    const peaks = new Float32Array(Math.ceil(wave.length / piece));
    wave.forEach((v, i) => {
      const at = Math.floor(i / piece);
      peaks[at] = Math.max(peaks[at] ?? 0, Math.abs(v));
    });
    return { peaks, perSec: PER_SEC };
  } catch {
    return undefined;
  }
}

/** The browser's own picker. */
export function pickReference(): void {
  const input = document.createElement("input");
  input.type = "file";
  input.accept = "video/*,audio/*";
  input.hidden = true;
  input.onchange = () => {
    const file = input.files?.[0];
    input.remove();
    if (file) void openReference(file);
  };
  input.oncancel = () => input.remove();
  document.body.append(input);
  input.click();
}

/** Plays and stands where the playhead does. */
export function followPlayhead(): void {
  effect(() => {
    const own = reference.value;
    const at = secondAt(store.playhead.value);
    const [playing, speed] = [store.playing.value, store.speed.value];
    media.muted = muted.value;
    if (!own) return;
    const inside = at >= 0 && !(at >= own.secs);
    // In the middle of the film's picture, not on the edge to the one before.
    const wanted = Math.min(Math.max(0, at + 0.001), own.secs);
    const off = Math.abs(media.currentTime - wanted);
    if (playing && inside) {
      media.playbackRate = speed;
      if (off > LAG * Math.max(1, speed)) media.currentTime = wanted;
      // A browser that lets no page make a sound by itself shows its pictures all the same.
      if (media.paused)
        void media.play().catch(() => {
          media.currentTime = wanted;
        });
    } else {
      if (!media.paused) media.pause();
      if (off > 0.002) media.currentTime = wanted;
    }
  });
}
