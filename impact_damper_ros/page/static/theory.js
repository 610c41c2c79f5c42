// What theory says of the present rig: the predicted motion, and the curve over the gap.

import { TAU } from './format.js';

export class Theory {
  constructor() {
    this.clear();
  }

  clear() {
    this.orbit = null;
    this.curve = null;
    this.failed = '';
    this.frequency = NaN;
    this.version = 0;
  }

  /** Take in a message of type orbit, which may have no curve, gap_curve or theory_failed. */
  take(message) {
    if (message.type === 'orbit') {
      this.orbit = message.found ? message : null;
      this.failed = message.found ? '' : message.text;
    } else if (message.type === 'gap_curve') {
      this.curve = message;
    } else {
      this.orbit = null;
      this.curve = null;
      this.failed = message.text;
    }
    this.version += 1;
  }

  /** Rig time at which the predicted motion begins, so that force and impacts are in step. */
  zero(history) {
    const { orbit } = this;
    if (Number.isFinite(orbit.t_zero)) return orbit.t_zero;
    const phase = history.state[9];
    const cycle = TAU / this.frequency;
    if (!Number.isFinite(phase) || !Number.isFinite(cycle)) return 0;
    const cycles = Math.max(1, Math.round(orbit.period / cycle));
    const base = history.end - phase * cycle;
    if (cycles === 1) return base;
    // Which of several cycles it is: that with the nearest impacts.
    let best = [Infinity, base];
    for (let turn = 0; turn < cycles; turn += 1) {
      const zero = base - turn * cycle;
      best = [[this.distance(history, zero), zero], best].sort((a, b) => a[0] - b[0])[0];
    }
    return best[1];
  }

  distance(history, zero) {
    const { orbit } = this;
    const { impacts } = history;
    const [time, x] = [impacts.field('time'), impacts.field('x')];
    let sum = 0;
    for (let n = Math.max(impacts.start, impacts.end - 8); n < impacts.end; n += 1) {
      const into = (((time[n] - zero) % orbit.period) + orbit.period) % orbit.period;
      let nearest = 0;
      for (let k = 1; k < orbit.t.length; k += 1) {
        if (Math.abs(orbit.t[k] - into) < Math.abs(orbit.t[nearest] - into)) nearest = k;
      }
      sum += Math.abs(orbit.x[nearest] - x[n]);
    }
    return sum;
  }

  /** Y and its rate along the predicted motion. */
  portrait() {
    const { orbit } = this;
    if (!orbit?.t) return null;
    if (orbit.relative_velocity) return { y: orbit.y, rate: orbit.relative_velocity };
    const y = orbit.t.map((_, n) => orbit.z[n] - orbit.x[n]);
    const rate = y.map((value, n) => {
      const [a, b] = [Math.max(0, n - 1), Math.min(y.length - 1, n + 1)];
      return (y[b] - y[a]) / (orbit.t[b] - orbit.t[a] || 1);
    });
    return { y, rate };
  }
}
