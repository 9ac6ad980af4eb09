// A film or a sound to follow: it plays with the clip, and the file never leaves the page.

import assert from "node:assert/strict";
import { describe, eventually, onTheArm, type Studio, type Tab, test } from "./harness";

/** Two seconds of silence with a tone from 1.0 to 1.4 s, as a WAV of 8,000 samples a second. */
function tone(): Buffer {
  const [rate, secs] = [8000, 2];
  const wav = Buffer.alloc(44 + 2 * rate * secs);
  wav.write("RIFF", 0);
  wav.writeUInt32LE(wav.length - 8, 4);
  wav.write("WAVEfmt ", 8);
  wav.writeUInt32LE(16, 16);
  wav.writeUInt16LE(1, 20);
  wav.writeUInt16LE(1, 22);
  wav.writeUInt32LE(rate, 24);
  wav.writeUInt32LE(2 * rate, 28);
  wav.writeUInt16LE(2, 32);
  wav.writeUInt16LE(16, 34);
  wav.write("data", 36);
  wav.writeUInt32LE(2 * rate * secs, 40);
  for (let i = rate; i < 1.4 * rate; i++) wav.writeInt16LE(Math.round(20_000 * Math.sin(i / 2)), 44 + 2 * i);
  return wav;
}

describe("reference", () => {
  let studio: Studio;
  let t: Tab;

  onTheArm((with_, page) => {
    [studio, t] = [with_, page];
  });
  const choose = async (name: string, mimeType: string, buffer: Buffer): Promise<void> => {
    await t.byId("tab-reference").click();
    const chooser = t.page.waitForEvent("filechooser");
    await t.byId("reference-pick").click();
    await (await chooser).setFiles({ name, mimeType, buffer });
  };
  const playing = () => t.page.evaluate(() => window.__studio.reference());
  const standsAt = (secs: number, what: string): Promise<unknown> =>
    eventually(async () => {
      const now = await playing();
      return now.paused && Math.abs(now.at - secs) < 0.01;
    }, what);
  /** Coloured pixels of the band above the rows in a few frames. */
  const ink = (from: number, to: number): Promise<number> =>
    t.page.evaluate(
      ([a, b]) => {
        window.__studio.redraw();
        const canvas = document.querySelector(".sheet canvas") as HTMLCanvasElement;
        const k = devicePixelRatio;
        const x = window.__studio.frameToX(a) * k;
        const data =
          canvas
            .getContext("2d")
            ?.getImageData(x, 22 * k, Math.max(1, window.__studio.frameToX(b) * k - x), 18 * k).data ?? [];
        const [r, g, bl] = [data[0] ?? 0, data[1] ?? 0, data[2] ?? 0];
        let count = 0;
        for (let i = 0; i < data.length; i += 4)
          if (
            Math.abs((data[i] ?? 0) - r) +
              Math.abs((data[i + 1] ?? 0) - g) +
              Math.abs((data[i + 2] ?? 0) - bl) >
            30
          )
            count++;
        return count;
      },
      [from, to] as const,
    );

  test("a sound stands along the time axis, follows the playhead, and is never sent", async () => {
    await t.afresh();
    await t.rolledOut();
    // Questions about poses are small; the file has 32 kB and begins with RIFF.
    const sent: string[] = [];
    t.page.on("request", (r) => {
      const body = r.postDataBuffer();
      if (body && (body.length > 8000 || body.includes("RIFF"))) sent.push(`${r.method()} ${r.url()}`);
    });
    await choose("beat.wav", "audio/wav", tone());
    const s = await t.until((x) => x.reference !== undefined && x.heard !== undefined, "decoded");
    assert.deepEqual(
      { ...s.reference, secs: Math.round((s.reference?.secs ?? 0) * 10) / 10 },
      { name: "beat.wav", seen: false, secs: 2 },
    );
    await t.painted();
    // Loud from frame 20 to 28, silent before.
    assert.ok((await ink(21, 27)) > 3 * (await ink(5, 11)), `${await ink(21, 27)} and ${await ink(5, 11)}`);
    await t.picture("reference-sound");
    await t.goTo(30);
    await standsAt(1.5, "where the playhead is");
    // Half a second later on the axis.
    await t.byId("reference-begin").fill("-0.5");
    await t.byId("reference-begin").press("Enter");
    await standsAt(1.0, "it begins half a second after the clip");
    await t.blur();
    await t.press("-", "Space");
    await eventually(
      async () => !(await playing()).paused && (await playing()).rate === 0.5,
      "it plays along",
    );
    await t.press("Space", "0");
    const rest = (await t.until((x) => !x.playing, "paused")).playhead;
    await standsAt(Math.min(2, Math.max(0, rest / 20 - 0.5)), "and stands where the clip stands");
    // In the graph, too, and gone when it is removed.
    await t.press("v");
    await t.byId("graph").waitFor();
    await t.press("v");
    await t.byId("timeline").waitFor();
    await t.byId("reference-remove").click();
    await t.until((x) => x.reference === undefined && x.heard === undefined, "removed");
    assert.deepEqual(sent, [], "nothing of it was sent");
  });

  test("a film shows its picture of the playhead; a file that is none says so", async () => {
    await t.afresh();
    await t.rolledOut();
    // A film of the studio's own: one second.
    await studio.api("POST", "/api/ops", {
      ops: [
        { op: "keys.delete", args: { frames: [30, 60] } },
        { op: "clip.length", args: { length: 20 } },
      ],
    });
    await t.rolledOut();
    const { id } = (
      await studio.api("POST", "/api/exports", {
        format: "mp4",
        size: [128, 96],
        overlay: "none",
        camera: "fit",
      })
    ).json() as { id: number };
    assert.equal((await studio.ended(id)).phase, "done", "the film is made");
    const film = (await studio.api("GET", `/api/jobs/${id}/file`)).bytes;
    await choose("walk.mp4", "video/mp4", film);
    const s = await t.until((x) => x.reference !== undefined, "it can be played");
    assert.deepEqual([s.reference?.seen, Math.round(s.reference?.secs ?? 0)], [true, 1]);
    await t.goTo(10);
    await standsAt(0.5, "its tenth picture");
    await t.picture("reference-film");
    const shown = await t.byId("reference").locator("video").boundingBox();
    assert.ok((shown?.width ?? 0) > 100 && (shown?.height ?? 0) > 40, JSON.stringify(shown));
    // Another document has another film, or none.
    await t.afresh();
    await t.until((x) => x.reference === undefined, "forgotten");
    await choose("song.mp3", "audio/mpeg", Buffer.from("no song"));
    await t.page.getByRole("alert").filter({ hasText: "song.mp3: this browser cannot play it" }).waitFor();
    await t.byId("tab-curves").click();
  });

  test("nothing left the origin, and no script broke", () => {
    assert.deepEqual(t.foreign, []);
    assert.deepEqual(t.errors, []);
  });
});
