// SPDX-License-Identifier: Apache-2.0
// What theory says of the present rig: the predicted motion, and the curve over the gap.

export class Theory {
  constructor() {
    this.clear();
  }

  clear() {
    this.orbit = null;
    this.curve = null;
    /** Kind of the motion that the rig comes to. */
    this.kind = '';
    [this.missing, this.failure] = ['', ''];
    /** With which of its cycles a predicted motion of several begins. */
    this.shift = 0;
  }

  /** When a period of the predicted motion begins; one of several cycles may begin with any of them, that which fits best. */
  zero(samples, end) {
    const { t, z, t_zero: zero, period, cycles } = this.orbit;
    const cycle = period / cycles;
    const [time, seen] = ['time', 'z'].map((name) => samples.field(name));
    const least = samples.after(end - 2 * period);
    const stride = Math.max(1, Math.floor((samples.end - least) / 60));
    const misfits = Array.from({ length: cycles }, (_, shift) => {
      let sum = 0;
      for (let n = least; n < samples.end; n += stride) {
        const part = (time[n] - zero - shift * cycle) / period;
        const into = (part - Math.floor(part)) * period;
        sum += (seen[n] - z.at(t.findLastIndex((one) => one <= into))) ** 2;
      }
      return sum;
    });
    // One that fits hardly better does not take turns with the other.
    const best = misfits.indexOf(Math.min(...misfits));
    if (!(misfits[this.shift] < 2 * misfits[best])) this.shift = best;
    return zero + this.shift * cycle;
  }

  /** Why there is no motion to show; empty if there is one. */
  get failed() {
    return this.failure || (this.orbit ? '' : this.missing);
  }

  /** Take in a message of type orbit, which may have no curve, gap_curve or theory_failed. */
  take(message) {
    if (message.type === 'orbit') {
      this.orbit = message.found ? message : null;
      this.missing = message.text;
      this.kind = message.kind;
    } else if (message.type === 'gap_curve') this.curve = message;
    else this.failure = message.text;
  }

  /** Whether the rig comes to a motion that never repeats. */
  get irregular() {
    return this.kind === 'chaotic' || this.kind === 'quasi-periodic';
  }

  /** What the impact map shows. */
  get title() {
    const { label = '', stable = true } = this.orbit ?? {};
    if (this.irregular) return this.kind;
    return stable ? label : `unstable: ${label}`;
  }

  /** The best gap known, and whether it is beyond an end of the curve. */
  get best() {
    return this.curve?.optimum ?? { gap: NaN, bound: '' };
  }
}
