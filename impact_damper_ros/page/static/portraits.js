// Phase portrait of m in the gap, impact map, multipliers on the unit circle.

import { Axes, Canvas, colours, font, SteadyRange } from './chart.js';
import { digits, lengthUnit, niceAbove, velocityUnit } from './format.js';

const BANDS = 6;

const fields = (samples) => ['time', 'x', 'xv', 'z', 'zv'].map((name) => samples.field(name));

/** Index of the first of the rows that are not older. */
function firstSince(samples, oldest) {
  const time = samples.field('time');
  let first = samples.end;
  while (first > samples.start && time[first - 1] >= oldest) first -= 1;
  return first;
}

/** Velocity of m relative to M over its place in the gap, the last cycles, older ones paler. */
export class PhasePortrait extends Axes {
  constructor(canvas, history, theory) {
    super(canvas);
    this.history = history;
    this.theory = theory;
    this.across = new SteadyRange();
    this.up = new SteadyRange();
    this.seconds = 2;
    this.masses = [1, 1];
    this.showTheory = true;
  }

  draw(now) {
    if (!this.begin()) return;
    const { samples, state, ghost, ghostSamples } = this.history;
    const [time, x, xv, z, zv] = fields(samples);
    const oldest = this.history.end - this.seconds;
    const first = firstSince(samples, oldest);
    const predicted = this.showTheory ? this.theory.portrait() : null;
    let [far, fast] = [0, 0];
    for (const rows of [samples, ghostSamples]) {
      const [, x, xv, z, zv] = fields(rows);
      for (let n = firstSince(rows, oldest); n < rows.end; n += 1) {
        far = Math.max(far, Math.abs(z[n] - x[n]));
        fast = Math.max(fast, Math.abs(zv[n] - xv[n]));
      }
    }
    for (const one of [state, ghost]) {
      if (one) far = Math.max(far, Math.abs(one[4] - one[0]), Math.abs(one[6] - one[0]) || 0);
    }
    if (predicted) for (const value of predicted.rate) fast = Math.max(fast, Math.abs(value));
    const width = this.across.fit(far > 0 ? niceAbove(1.08 * far) : 0, now);
    const height = this.up.fit(fast > 0 ? niceAbove(1.05 * fast) : 0, now);
    const [length, speed] = [lengthUnit(width), velocityUnit(height)];
    const axes = this.axes({
      x: [-width * length.factor, width * length.factor],
      y: [-height * speed.factor, height * speed.factor],
      xName: `Y (${length.unit})`,
      yName: `Y′ (${speed.unit})`,
    });
    const toX = (value) => axes.toX(value * length.factor);
    const toY = (value) => axes.toY(value * speed.factor);
    this.inside(axes.box, (context) => {
      for (const [one, stroke, width] of [[ghost, colours.special, 1], [state, colours.steel, 2]]) {
        if (!one) continue;
        context.strokeStyle = stroke;
        context.lineWidth = width;
        context.beginPath();
        for (const place of [one[4] - one[0], one[6] - one[0]]) {
          if (!Number.isFinite(place)) continue;
          context.moveTo(toX(place), axes.box.top);
          context.lineTo(toX(place), axes.box.top + axes.box.height);
        }
        context.stroke();
      }
      const { damper } = colours;
      context.strokeStyle = damper;
      context.lineWidth = 1.3;
      const count = samples.end - first;
      const { impacts } = this.history;
      const inverse = 1 / this.masses[0] + 1 / this.masses[1];
      let hit = impacts.start;
      if (count > 0) while (hit < impacts.end && impacts.arrays[0][hit] <= time[first]) hit += 1;
      for (let band = 0; band < BANDS; band += 1) {
        const from = first + Math.floor((band * count) / BANDS);
        const to = Math.min(samples.end, first + Math.floor(((band + 1) * count) / BANDS) + 1);
        context.globalAlpha = 0.12 + (0.78 * (band + 1)) / BANDS;
        context.beginPath();
        for (let n = from; n < to; n += 1) {
          const [a, b] = [toX(z[n] - x[n]), toY(zv[n] - xv[n])];
          if (n === from) {
            context.moveTo(a, b);
            while (hit < impacts.end && impacts.arrays[0][hit] <= time[n]) hit += 1;
            continue;
          }
          // An impact between two samples is a corner that none of them has.
          while (hit < impacts.end && impacts.arrays[0][hit] <= time[n]) {
            const [, stop, , primary, mass, impulse, , y] = impacts.arrays.map((values) => values[hit]);
            const after = mass - primary;
            context.lineTo(toX(y), toY(after + (stop === 1 ? 1 : -1) * impulse * inverse));
            context.lineTo(toX(y), toY(after));
            hit += 1;
          }
          context.lineTo(a, b);
        }
        context.stroke();
      }
      context.globalAlpha = 0.8;
      this.whatIf(oldest, toX, toY);
      context.globalAlpha = 1;
      if (predicted) {
        context.strokeStyle = colours.theory;
        context.lineWidth = 1.2;
        context.setLineDash([5, 4]);
        context.beginPath();
        predicted.y.forEach((value, n) => {
          if (n === 0) context.moveTo(toX(value), toY(predicted.rate[n]));
          else context.lineTo(toX(value), toY(predicted.rate[n]));
        });
        context.stroke();
        context.setLineDash([]);
      }
      if (state) {
        context.fillStyle = damper;
        context.strokeStyle = colours.page;
        context.lineWidth = 1.5;
        context.beginPath();
        context.arc(toX(state[2] - state[0]), toY(state[3] - state[1]), 4.5, 0, 7);
        context.fill();
        context.stroke();
      }
    });
  }
  /** The what-if beside a recording: a thin line from sample to sample. */
  whatIf(oldest, toX, toY) {
    const { context } = this;
    const { ghostSamples: rows } = this.history;
    const [, x, xv, z, zv] = fields(rows);
    context.strokeStyle = colours.special;
    context.lineWidth = 1;
    context.beginPath();
    for (let n = firstSince(rows, oldest); n < rows.end; n += 1) {
      context.lineTo(toX(z[n] - x[n]), toY(zv[n] - xv[n]));
    }
    context.stroke();
  }
}

/** Velocity of m after each impact over the phase of the force. */
export class ImpactMap extends Axes {
  constructor(canvas, history, theory) {
    super(canvas);
    this.history = history;
    this.theory = theory;
    this.up = new SteadyRange();
    this.showTheory = true;
  }

  draw(now) {
    if (!this.begin()) return;
    const { impacts } = this.history;
    const [time, stop, damper, phase] = ['time', 'stop', 'damper', 'phase'].map((name) => impacts.field(name));
    const predicted = (this.showTheory && this.theory.orbit?.impacts) || [];
    const since = this.history.lastChange;
    let fast = 0;
    const first = Math.max(impacts.start, impacts.end - 1500);
    for (let n = first; n < impacts.end; n += 1) fast = Math.max(fast, Math.abs(damper[n]));
    for (const one of predicted) fast = Math.max(fast, Math.abs(one.damper_velocity_after ?? one.velocity_after));
    const height = this.up.fit(fast > 0 ? niceAbove(1.2 * fast) : 0, now);
    const speed = velocityUnit(height);
    const axes = this.axes({
      x: [0, 1],
      y: [-height * speed.factor, height * speed.factor],
      xName: 'phase of the force (cycles)',
      yName: `Z′ after (${speed.unit})`,
      xTicks: 5,
    });
    const toY = (value) => axes.toY(value * speed.factor);
    this.inside(axes.box, (context) => {
      const dot = impacts.end - first > 400 ? 1.3 : 1.9;
      for (let n = first; n < impacts.end; n += 1) {
        if (!Number.isFinite(phase[n])) continue;
        const age = (impacts.end - n) / 1500;
        const old = time[n] < since;
        context.globalAlpha = old ? 0.14 : Math.max(0.25, 0.95 - age);
        context.fillStyle = old ? colours.quiet : stop[n] === 1 ? colours.damper : colours.upper;
        const [a, b] = [axes.toX(phase[n]), toY(damper[n])];
        if (stop[n] === 1) context.fillRect(a - dot, b - dot, 2 * dot, 2 * dot);
        else {
          context.beginPath();
          context.arc(a, b, 1.2 * dot, 0, 7);
          context.fill();
        }
      }
      context.globalAlpha = 1;
      context.strokeStyle = colours.theory;
      context.lineWidth = 1.5;
      for (const one of predicted) {
        const place = ((one.phase % 1) + 1) % 1;
        context.beginPath();
        context.arc(axes.toX(place), toY(one.damper_velocity_after ?? one.velocity_after), 6.5, 0, 7);
        context.stroke();
      }
      // the last impact
      if (impacts.length) {
        const n = impacts.end - 1;
        context.fillStyle = stop[n] === 1 ? colours.damper : colours.upper;
        context.strokeStyle = colours.page;
        context.beginPath();
        context.arc(axes.toX(phase[n]), toY(damper[n]), 4, 0, 7);
        context.fill();
        context.stroke();
      }
    });
    if (!impacts.length) {
      const { context } = this;
      context.font = font(0.85);
      context.fillStyle = colours.quiet;
      context.textAlign = 'center';
      context.textBaseline = 'middle';
      context.fillText('no impact yet', axes.box.left + axes.box.width / 2, axes.box.top + axes.box.height * 0.75);
    }
  }
}

/** Multipliers in the complex plane: within the unit circle, a deviation dies out. */
export class Multipliers extends Canvas {
  draw(multipliers) {
    if (!this.begin()) return;
    const { context } = this;
    const [cx, cy] = [this.width / 2, this.height / 2];
    const sizes = (multipliers ?? []).map(([re, im]) => Math.hypot(re, im));
    const most = Math.max(1.15, ...sizes.filter(Number.isFinite).map((size) => Math.min(size * 1.1, 3)));
    const unit = (Math.min(cx, cy) - 3) / most;
    context.lineWidth = 1;
    context.strokeStyle = colours.grid;
    context.beginPath();
    context.moveTo(3, cy);
    context.lineTo(this.width - 3, cy);
    context.moveTo(cx, 3);
    context.lineTo(cx, this.height - 3);
    context.stroke();
    context.strokeStyle = colours.steel;
    context.lineWidth = 1.3;
    context.beginPath();
    context.arc(cx, cy, unit, 0, 7);
    context.stroke();
    (multipliers ?? []).forEach(([re, im], n) => {
      const cut = Math.min(1, (0.98 * most) / sizes[n]);
      context.fillStyle = sizes[n] < 1 ? colours.good : colours.bad;
      context.beginPath();
      context.arc(cx + re * cut * unit, cy - im * cut * unit, 3.6, 0, 7);
      context.fill();
    });
    const largest = sizes.length ? Math.max(...sizes) : NaN;
    const said = sizes.length
      ? `Stability multipliers on the unit circle; the largest modulus is ${digits(largest, 3)}`
      : 'Stability multipliers: none';
    if (this.canvas.getAttribute('aria-label') !== said) this.canvas.setAttribute('aria-label', said);
  }
}
