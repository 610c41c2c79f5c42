// SPDX-License-Identifier: Apache-2.0
// The range of a slider about what its knob stands at: linear, or logarithmic where the size is open.

/** Part of the way beyond which a number whose 0 has a meaning of its own is 0. */
const LAST = 0.95;
/** Decades of such a number. */
const DECADES = 5;

export class SliderScale {
  /** For a number in the unit shown, as `factor` makes it of the SI unit; `natural` is the natural frequency of the rig, Hz. */
  constructor({ name, min, max, usual, zero = '' }, number, factor, natural) {
    this.log = false;
    /** The part of the way that is for other numbers than 0. */
    this.way = zero ? LAST : 1;
    /** Ends and step */
    this.span = [0, 1, 0.001];
    if (name === 'angle') this.span = [-90, 90, 0.5];
    else if (zero) {
      this.log = true;
      const high = (usual ?? [min, max])[1] * factor;
      this.span = [Math.min(number || high, high * 10 ** -DECADES), Math.max(number, high), 0];
    } else if (name.startsWith('restitution')) this.span = [0, 1, 0.01];
    else if (name === 'friction') this.span = [0, Math.max(1, 2 * number), 0.005];
    else if (name === 'force_frequencies' || name === 'base_frequencies') {
      const about = natural || number || 1;
      this.span = [0.5 * about, Math.max(1.5 * about, 1.2 * number), 0.001 * about];
    } else if (number > 0) {
      this.log = true;
      // Eight times smaller and larger, but not farther than is usual
      const [low, high] = (usual ?? [min, max]).map((bound) => bound * factor);
      this.span = [Math.min(number, Math.max(low, number / 8)), Math.max(number, Math.min(high, number * 8)), 0];
    }
  }

  /** Whether a number is beyond an end. */
  misses(number) {
    return (number < this.span[0] && !(number === 0 && this.way < 1)) || number > this.span[1];
  }

  /** The number at a part of the way, 0 to 1. */
  at(part) {
    const [low, high, step] = this.span;
    if (part > this.way) return 0;
    if (this.log) return Number((low * (high / low) ** (part / this.way)).toPrecision(3));
    return Number((Math.round((low + part * (high - low)) / step) * step).toPrecision(6));
  }

  /** The part of the way at which a number is. */
  of(number) {
    const [low, high] = this.span;
    if (number === 0 && this.way < 1) return 1;
    const part = this.log ? Math.log(number / low) / Math.log(high / low) : (number - low) / (high - low);
    return this.way * Math.min(1, Math.max(0, part));
  }
}

/** A number as it may be typed, and its own unit; NaN if it is none. */
export function readTyped(text) {
  const [, number, own = ''] = /^\s*([-+\d.,eE]+)\s*(.*?)\s*$/.exec(text) ?? [];
  return { number: Number(number?.replace(',', '.')), own };
}
