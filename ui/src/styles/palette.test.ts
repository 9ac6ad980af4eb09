import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

/** Contrast of two colours, WCAG 2.2. */
function contrast(a: string, b: string): number {
  const light = (hex: string): number => {
    const [r, g, bl] = [1, 3, 5].map((i) => {
      const c = parseInt(hex.slice(i, i + 2), 16) / 255;
      return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
    }) as [number, number, number];
    return 0.2126 * r + 0.7152 * g + 0.0722 * bl;
  };
  const [hi, lo] = [light(a), light(b)].sort((x, y) => y - x) as [number, number];
  return (hi + 0.05) / (lo + 0.05);
}

test("words have a contrast of 4.5 to 1, shapes and curves of 3 to 1, dark and light", () => {
  assert.ok(Math.abs(contrast("#000000", "#ffffff") - 21) < 1e-6);
  const css = readFileSync("src/styles/palette.css", "utf8");
  const themes = [...css.matchAll(/:root[^{]*\{([^{}]*--back:[^{}]*)\}/g)].map(
    (m) =>
      new Map(
        [...(m[1] ?? "").matchAll(/--([\w-]+):\s*([^;]+);/g)].map(
          (v) => [v[1] ?? "", (v[2] ?? "").trim()] as const,
        ),
      ),
  );
  assert.equal(themes.length, 2, "each palette once");
  for (const theme of themes) {
    const color = (name: string): string => {
      const v = theme.get(name);
      assert.match(v ?? "", /^#[0-9a-f]{6}$/, name);
      return v ?? "";
    };
    const least = (front: string, backs: string[], ratio: number, name = front): void => {
      for (const b of backs) {
        const c = contrast(front.startsWith("#") ? front : color(front), color(b));
        assert.ok(c >= ratio, `${name} on ${b}: ${c.toFixed(2)}`);
      }
    };
    for (const word of ["text", "dim", "ok", "warn", "bad", "accent", "marker"])
      least(word, ["back", "panel", "raise"], 4.5);
    least("accent-text", ["accent"], 4.5);
    for (const shape of [
      "key",
      "selected",
      "playhead",
      "look",
      "error",
      "cached",
      "focus",
      "blind",
      "fill",
      "hatch",
    ])
      least(shape, ["back", "panel"], 3);
    const series = (theme.get("series") ?? "").split(" ");
    assert.equal(new Set(series).size, 8);
    for (const c of series) least(c, ["panel"], 3, `curve ${c}`);
  }
});
