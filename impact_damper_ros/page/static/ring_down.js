// SPDX-License-Identifier: Apache-2.0
// Ring-down: what M loses in each cycle while nothing shakes it, over its amplitude.

import { Axes, circle, colours, SteadyRange, strokeLines, within } from './chart.js';
import { mark } from './dom.js';
import { lengthUnit, niceAbove } from './format.js';

const MOST_CYCLES = 400;

/** Whether neither a force nor the base shakes a rig. */
export const ringsDown = ({ force_amplitudes: force = [1], base_amplitudes: base = [], multisine_level: level = 0, force_record: pushed = 'none', base_record: moved = 'none' }) =>
  [...force, ...base, level].every((value) => value === 0) && pushed === 'none' && moved === 'none';

/**
 * Velocities V of M at the upward passages of X through the middle, since an instant.
 *
 * M alone is an oscillator: from the sample beside the passage, without an impact between them,
 * V^2 = v^2 + (omega x)^2, less what the dashpot takes on the way.
 */
export function passages({ samples, impacts }, since, { primary_mass: M, stiffness: K, damping: C, damper_mass: m, gravity, angle }) {
  const [time, x, velocity] = ['time', 'x', 'primary_velocity'].map((name) => samples.field(name));
  const middle = (m * gravity * Math.sin(angle)) / K;
  const found = [];
  for (let n = samples.after(since); n + 1 < samples.end; n += 1) {
    const [before, after] = [x[n] - middle, x[n + 1] - middle];
    if (!(before < 0 && after >= 0)) continue;
    const at = time[n] + ((time[n + 1] - time[n]) * before) / (before - after);
    const struck = (from, to) => impacts.after(from) < impacts.after(to);
    const [one, place] = struck(time[n], at) ? [n + 1, after] : [n, before];
    if (struck(Math.min(at, time[one]), Math.max(at, time[one]))) continue;
    const fast = Math.sqrt(velocity[one] ** 2 + (K / M) * place ** 2);
    found.push(fast * Math.exp((-C / M) * (at - time[one])));
  }
  return found.slice(-MOST_CYCLES - 1);
}

/** Loss of energy of each cycle over its amplitude, beside that of the dashpot alone. */
export class RingDown extends Axes {
  constructor(canvas, history) {
    super(canvas);
    this.history = history;
    this.cycles = [];
    this.rescale();
  }

  /** Choose the scales anew. */
  rescale() {
    this.across = new SteadyRange();
  }

  draw(now, values) {
    const { primary_mass: M, stiffness: K, damping: C } = values;
    const omega = Math.sqrt(K / M);
    const zeta = C / (2 * M * omega);
    const alone = 1 - Math.exp((-4 * Math.PI * zeta) / Math.sqrt(Math.max(1e-9, 1 - zeta * zeta)));
    const speeds = passages(this.history.own, Math.max(this.history.begun, this.history.lastChange), values);
    this.cycles = speeds.slice(1).map((next, n) => ({ amplitude: speeds[n] / omega, loss: 1 - (next / speeds[n]) ** 2 }));
    const last = this.cycles.at(-1);
    const words = last ? `${this.cycles.length} cycles; the last one lost ${(100 * last.loss).toFixed(1)} % of the energy` : 'no cycle yet';
    mark(this.canvas, 'aria-label', `Ring-down: loss of energy in each cycle over the amplitude of M; ${words}`);
    if (!this.begin()) return;
    const widest = this.cycles.reduce((most, { amplitude }) => Math.max(most, amplitude), 0);
    const right = this.across.fit(widest > 0 ? niceAbove(1.05 * widest) : 0, now);
    const length = lengthUnit(right);
    const highest = this.cycles.reduce((most, { loss }) => Math.max(most, loss), 1.2 * alone);
    const axes = this.axes({
      x: [0, right * length.factor],
      y: [0, Math.min(100, 110 * highest)],
      xName: `amplitude of M (${length.unit})`,
      yName: 'energy lost in a cycle (%)',
    });
    within(this.context, axes.box, (context) => {
      context.strokeStyle = colours.quiet;
      context.setLineDash([5, 4]);
      const [from, to] = [0, right * length.factor].map(axes.toX);
      strokeLines(context, [[from, axes.toY(100 * alone)], [to, axes.toY(100 * alone)]]);
      context.setLineDash([]);
      context.fillStyle = colours.primary;
      for (const { amplitude, loss } of this.cycles) {
        circle(context, axes.toX(amplitude * length.factor), axes.toY(100 * loss), 2.4);
        context.fill();
      }
      if (last) this.dot(axes.toX(last.amplitude * length.factor), axes.toY(100 * last.loss), colours.primary, 4);
    });
    if (!last) this.say('no cycle yet', axes.box, 0.75);
  }
}
