// Numbers as people type them.

/** What one unit is in the unit that is wanted. */
export type Units = Readonly<Record<string, number>>;

export const ANGLES: Units = { "°": Math.PI / 180, deg: Math.PI / 180, rad: 1 };
export const LENGTHS: Units = { mm: 1e-3, cm: 1e-2, m: 1 };
export const TIMES: Units = { ms: 1e-3, s: 1 };

/**
 * The number of a text such as `60`, `-1,5` or `60 deg`; without a unit it is of `plain`.
 * Undefined when it is none: nothing, a word, a sum.
 */
export function parseNumber(text: string, units: Units = {}, plain = 1): number | undefined {
  const parts = /^([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[+-]?\d+)?)\s*(\S*)$/i.exec(text.trim());
  const scale = parts?.[2] ? units[parts[2]] : plain;
  const value = Number(parts?.[1]?.replace(",", ".")) * (scale ?? Number.NaN);
  return Number.isFinite(value) ? value : undefined;
}

/** A number with this many digits. A number that is rounded to zero has no sign. */
export function fixed(value: number, digits: number): string {
  const text = value.toFixed(digits);
  return /^-[0.]*$/.test(text) ? text.slice(1) : text;
}

/** The fewest digits after the point, up to six, that write multiples of this step exactly. */
export function digitsOf(step: number): number {
  for (let digits = 0; digits < 6; digits++) {
    const scaled = Math.abs(step) * 10 ** digits;
    if (scaled >= 1 - 1e-9 && Math.abs(scaled - Math.round(scaled)) < 1e-6) return digits;
  }
  return 6;
}

/** A sentence of the program with its angles in degrees, if that is what the page shows: the program's
 * own unit is the radian. */
export function inUnits(message: string, degrees: boolean): string {
  if (!degrees) return message;
  const angle = (text: string): string => fixed((Number(text) * 180) / Math.PI, 1);
  return message
    .replace(
      /(-?[\d.]+) is outside (-?\d[\d.]*?)\.\.(-?[\d.]+) rad\b/g,
      (_, v, lo, hi) => `${angle(v)}° is outside ${angle(lo)}..${angle(hi)}°`,
    )
    .replace(/(-?[\d.]+) of (-?[\d.]+) rad\/s/g, (_, v, most) => `${angle(v)} of ${angle(most)} °/s`)
    .replace(/(-?\d[\d.]*) rad\/s/g, (_, v) => `${angle(v)} °/s`)
    .replace(/(-?\d[\d.]*) rad\b/g, (_, v) => `${angle(v)}°`);
}
