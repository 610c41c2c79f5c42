// SPDX-License-Identifier: Apache-2.0
// Numbers for people: units, prefixes, a true minus sign.

const SPACE = '\u202f';
/** @type {[number, string][]} */
const PREFIXES = [
  [1e9, 'G'], [1e6, 'M'], [1e3, 'k'], [1, ''], [1e-3, 'm'], [1e-6, 'µ'], [1e-9, 'n'],
];

export const TAU = 2 * Math.PI;

/** Begin a text with a capital. */
export const capital = (text) => text[0].toUpperCase() + text.slice(1);

/** Replace the hyphen of a number by a minus sign. */
export const minus = (text) => text.replace(/-/g, '−');

/** Return so many significant digits, without an exponent where that is readable. */
export function digits(value, count = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  if (value === 0) return '0';
  const size = Number(Math.abs(value).toPrecision(count));
  if (size >= 1e6 || size < 1e-4) return minus(value.toExponential(count - 1));
  const decimals = Math.max(0, count - 1 - Math.floor(Math.log10(size)));
  return minus(value.toFixed(Math.min(decimals, 8)));
}

/** Return a value with its unit and a prefix. */
export function withUnit(value, unit, count = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  if (value === 0) return `0${SPACE}${unit}`;
  const size = Math.abs(value) * (1 + 0.5 * 10 ** -count);
  const [factor, prefix] = PREFIXES.find(([least]) => size >= least) ?? PREFIXES.at(-1);
  return `${digits(value / factor, count)}${SPACE}${prefix}${unit}`;
}

/** Unit in which lengths of about this size are read. */
export function lengthUnit(size) {
  if (!(size > 0) || size >= 0.5) return { factor: 1, unit: 'm' };
  if (size >= 5e-4) return { factor: 1e3, unit: 'mm' };
  return { factor: 1e6, unit: 'µm' };
}

/** Unit in which velocities of about this size are read. */
export function velocityUnit(size) {
  if (!(size > 0) || size >= 0.1) return { factor: 1, unit: 'm/s' };
  return { factor: 1e3, unit: 'mm/s' };
}

/** Return a number as it would be typed: shortest text that stays within a relative error. */
export function typed(value, relative = 1e-6) {
  if (!Number.isFinite(value)) return '';
  const rounded = Array.from({ length: 17 }, (_, n) => Number(value.toPrecision(n + 1)));
  return String(rounded.find((one) => Math.abs(one - value) <= relative * Math.abs(value)));
}

/** Return a span of time as minutes and seconds; with milliseconds if it is to be exact. */
export function clock(seconds, exact = false) {
  if (!Number.isFinite(seconds)) return '–';
  const sign = seconds < 0 ? '−' : '';
  const size = Math.abs(seconds);
  if (size < 600) return `${sign}${size.toFixed(exact ? 3 : 2)}${SPACE}s`;
  const thousandths = Math.round(1000 * size);
  const whole = exact ? Math.floor(thousandths / 1000) : Math.floor(size);
  const parts = [Math.floor(whole / 60) % 60, whole % 60].map((n) => String(n).padStart(2, '0'));
  const hours = Math.floor(whole / 3600);
  const rest = exact ? `.${String(thousandths % 1000).padStart(3, '0')}` : '';
  return `${sign}${hours ? `${hours}:` : ''}${parts.join(':')}${rest}`;
}

/** Steps of 1, 2 or 5 that cut a range into about so many parts, and how many decimals they need. */
export function ticks(low, high, about) {
  const rough = (high - low) / Math.max(1, about);
  if (!(rough > 0) || !Number.isFinite(rough)) return { values: [], decimals: 0 };
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((n) => n * power >= rough * 0.999);
  const values = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) {
    values.push(n === 0 ? 0 : n * step);
  }
  return { values, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), step };
}

/** The least of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten that is not below a value. */
export function niceAbove(value) {
  if (!(value > 0) || !Number.isFinite(value)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  const steps = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10];
  return power * steps.find((n) => n * power >= value * 0.9999);
}
