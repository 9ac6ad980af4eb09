// Numbers as people type them.

/** What one unit is in the unit that is wanted. */
export type Units = Readonly<Record<string, number>>;

export const ANGLES: Units = { "°": Math.PI / 180, deg: Math.PI / 180, rad: 1 };
export const LENGTHS: Units = { mm: 1e-3, cm: 1e-2, m: 1 };
export const TIMES: Units = { ms: 1e-3, s: 1 };

/** A value in a sum, and whether a unit was written with it. */
interface Term {
  value: number;
  isMeasured: boolean;
}

/**
 * The number of a text such as `60`, `-1,5`, `60 deg` or `2 * (10 + 5)`; without a unit it is of `plain`. With the
 * value that it is to change, also `+=5` or `*=2`. Undefined when it is none: nothing, a word, a product of angles.
 */
export function parseNumber(text: string, units: Units = {}, plain = 1, now?: number): number | undefined {
  const change = /^\s*([-+*/])=(.*)$/.exec(text);
  if (change && now === undefined) return undefined;
  const tokens = (change?.[2] ?? text).match(
    /(?:\d+[.,]?\d*|[.,]\d+)(?:e[+-]?\d+)?|[-+*/()]|[^\s\d.,()*/+-]+|\S/gi,
  );
  const rest = [...(tokens ?? [])];
  const failed: Term = { value: Number.NaN, isMeasured: false };

  const measured = (t: Term): number => t.value * (t.isMeasured ? 1 : plain);
  const add = (a: Term, b: Term, sign: number): Term =>
    a.isMeasured === b.isMeasured
      ? { ...a, value: a.value + sign * b.value }
      : { value: measured(a) + sign * measured(b), isMeasured: true };
  // Only numbers without a unit multiply and divide: there are no square degrees.
  const multiply = (a: Term, b: Term): Term =>
    a.isMeasured && b.isMeasured
      ? failed
      : { value: a.value * b.value, isMeasured: a.isMeasured || b.isMeasured };
  const divide = (a: Term, b: Term): Term => (b.isMeasured ? failed : { ...a, value: a.value / b.value });

  const atom = (): Term => {
    const token = rest.shift() ?? "";
    if (/^[-+]$/.test(token) && !/^[-+]$/.test(rest[0] ?? "")) {
      const of = atom();
      return { ...of, value: token === "-" ? -of.value : of.value };
    }
    if (token === "(") {
      const inner = sum();
      return rest.shift() === ")" ? inner : failed;
    }
    if (!/^[\d.,]/.test(token)) return failed;
    const value = Number(token.replace(",", "."));
    const unit = /^[^-+*/()\d.,]/.test(rest[0] ?? "") ? rest.shift() : undefined;
    return unit === undefined
      ? { value, isMeasured: false }
      : { value: value * (units[unit] ?? Number.NaN), isMeasured: true };
  };
  const product = (): Term => {
    let t = atom();
    while (rest[0] === "*" || rest[0] === "/")
      t = rest.shift() === "*" ? multiply(t, atom()) : divide(t, atom());
    return t;
  };
  const sum = (): Term => {
    let t = product();
    while (rest[0] === "+" || rest[0] === "-") {
      const sign = rest.shift() === "+" ? 1 : -1;
      t = add(t, product(), sign);
    }
    return t;
  };

  const typed = sum();
  const from: Term = { value: now ?? 0, isMeasured: true };
  const by: Record<string, () => Term> = {
    "+": () => add(from, typed, 1),
    "-": () => add(from, typed, -1),
    "*": () => multiply(from, typed),
    "/": () => divide(from, typed),
  };
  const value = measured(by[change?.[1] ?? ""]?.() ?? typed);
  return rest.length === 0 && Number.isFinite(value) ? value : undefined;
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
