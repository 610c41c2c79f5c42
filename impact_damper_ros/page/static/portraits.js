// SPDX-License-Identifier: Apache-2.0
// Phase portrait of m in the gap, impact map, multipliers on the unit circle.

import { Axes, Canvas, circle, colours, dashes, SteadyRange, SteadySpan, stopColour, strokeLines, within } from './chart.js';
import { mark } from './dom.js';
import { digits, lengthUnit, niceAbove, velocityUnit } from './format.js';

const BANDS = 6;
/** Most points of a portrait, and impacts of a map. */
const MOST_POINTS = 4000;
const MOST_DOTS = 1500;

/** Y and its rate at the samples since an instant; an impact between two of them is a corner. */
function pointsSince({ samples, impacts }, oldest) {
  const [time, x, xRate, z, zRate] = ['time', 'x', 'primary_velocity', 'z', 'damper_velocity'].map((name) => samples.field(name));
  const first = samples.after(oldest);
  const stride = Math.max(1, Math.ceil((samples.end - first) / MOST_POINTS));
  const points = [];
  let hit = impacts.after(time[first]);
  for (let n = first; n < samples.end; n += stride) {
    for (; hit < impacts.end && impacts.field('time')[hit] <= time[n]; hit += 1) {
      const one = impacts.row(hit);
      points.push([one.y, one.damper_velocity_before - one.primary_velocity_before], [one.y, one.damper_velocity_after - one.primary_velocity_after]);
    }
    points.push([z[n] - x[n], zRate[n] - xRate[n]]);
  }
  return points;
}

/** Velocity of m relative to M over its place in the gap, the last cycles, older ones paler. */
export class PhasePortrait extends Axes {
  constructor(canvas, history, theory) {
    super(canvas);
    this.history = history;
    this.theory = theory;
    this.rescale();
    this.seconds = 2;
    this.showTheory = true;
  }

  /** Choose the scales anew. */
  rescale() {
    this.across = new SteadySpan();
    this.up = new SteadyRange();
  }

  draw(now) {
    if (!this.begin()) return;
    const { own, other, state, ghost, end } = this.history;
    const from = Math.max(end - this.seconds, this.history.begun);
    const [line, ghostLine] = [own, other].map((motion) => pointsSince(motion, from));
    const { y = [], relative_velocity: rate = [] } = (this.showTheory && this.theory.orbit) || {};
    const orbit = y.map((value, n) => [value, rate[n]]);
    const stops = [ghost, state].map((one) => (one ? [one.stop_1 - one.x, one.stop_2 - one.x].filter(Number.isFinite) : []));
    const largest = (values) => values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    const places = [...line, ...ghostLine].map(([place]) => place);
    const moved = largest(places);
    // Stops far beyond all that moves are not in view.
    const ends = stops.flat().filter((place) => !(moved > 0) || Math.abs(place) < 20 * moved);
    const [least, most] = [...places, ...ends].reduce(([low, high], place) => [Math.min(low, place), Math.max(high, place)], [0, 0]);
    const fast = largest([...line, ...ghostLine, ...orbit].map(([, speed]) => speed));
    const [left, right] = this.across.fit(1.08 * least, 1.08 * most, now);
    const height = this.up.fit(fast > 0 ? niceAbove(1.05 * fast) : 0, now);
    const [length, speed] = [lengthUnit(Math.max(-left, right)), velocityUnit(height)];
    const axes = this.axes({
      x: [left * length.factor, right * length.factor],
      y: [-height * speed.factor, height * speed.factor],
      xName: `Y (${length.unit})`,
      yName: `Y′ (${speed.unit})`,
    });
    const toX = (value) => axes.toX(value * length.factor);
    const toY = (value) => axes.toY(value * speed.factor);
    within(this.context, axes.box, (context) => {
      const draw = (points, stroke, wide) => {
        context.strokeStyle = stroke;
        context.lineWidth = wide;
        if (points.length) strokeLines(context, points.map(([a, b]) => [toX(a), toY(b)]));
      };
      stops.forEach((places, n) => {
        for (const place of places) draw([[place, -height], [place, height]], n ? stopColour(place > 0 ? 1 : 2) : colours.special, n + 1);
      });
      for (let band = 0; band < BANDS; band += 1) {
        context.globalAlpha = 0.12 + (0.78 * (band + 1)) / BANDS;
        const [from, to] = [band, band + 1].map((n) => Math.floor((n * line.length) / BANDS));
        draw(line.slice(from, to + 1), colours.damper, 2.6);
      }
      context.globalAlpha = 0.8;
      draw(ghostLine, colours.special, 1);
      context.globalAlpha = 1;
      context.setLineDash(dashes(this.theory.orbit ?? {}));
      draw(orbit, colours.theory, 0.9);
      context.setLineDash([]);
      if (!state || !line.length) return;
      const [place, velocity] = line.at(-1);
      this.dot(toX(place), toY(velocity), colours.damper, 4.5);
    });
  }
}

/** Velocity of m after each impact over the phase of the force. */
export class ImpactMap extends Axes {
  constructor(canvas, history, theory) {
    super(canvas);
    this.history = history;
    this.theory = theory;
    this.rescale();
    this.showTheory = true;
  }

  /** Choose the scale anew. */
  rescale() {
    this.up = new SteadyRange();
  }

  draw(now) {
    if (!this.begin()) return;
    const { impacts } = this.history;
    const [time, stop, damper, phase] = ['time', 'stop', 'damper_velocity_after', 'phase'].map((name) => impacts.field(name));
    const predicted = (this.showTheory && this.theory.orbit?.impacts) || [];
    const since = this.history.lastChange;
    let fast = 0;
    const first = Math.max(impacts.start, impacts.end - MOST_DOTS);
    for (let n = Math.max(first, impacts.after(this.history.begun)); n < impacts.end; n += 1) fast = Math.max(fast, Math.abs(damper[n]));
    for (const one of predicted) fast = Math.max(fast, Math.abs(one.damper_velocity_after));
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
    within(this.context, axes.box, (context) => {
      const dot = impacts.end - first > 400 ? 1.3 : 1.9;
      for (let n = first; n < impacts.end; n += 1) {
        if (!Number.isFinite(phase[n])) continue;
        const age = (impacts.end - n) / MOST_DOTS;
        const old = time[n] < since;
        context.globalAlpha = old ? 0.14 : Math.max(0.25, 0.95 - age);
        context.fillStyle = old ? colours.quiet : stopColour(stop[n]);
        const [a, b] = [axes.toX(phase[n]), toY(damper[n])];
        if (stop[n] === 1) context.fillRect(a - dot, b - dot, 2 * dot, 2 * dot);
        else {
          circle(context, a, b, 1.2 * dot);
          context.fill();
        }
      }
      context.globalAlpha = 1;
      context.strokeStyle = colours.theory;
      context.lineWidth = 1.5;
      for (const one of predicted) {
        const place = ((one.phase % 1) + 1) % 1;
        circle(context, axes.toX(place), toY(one.damper_velocity_after), 6.5);
        context.stroke();
      }
      // the last impact
      if (impacts.length) {
        const n = impacts.end - 1;
        this.dot(axes.toX(phase[n]), toY(damper[n]), stopColour(stop[n]), 4);
      }
    });
    if (!impacts.length) this.say('no impact yet', axes.box, 0.75);
    else if (!Number.isFinite(phase[impacts.end - 1])) this.say('no force: no phase', axes.box, 0.75);
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
    strokeLines(context, [[3, cy], [this.width - 3, cy]], [[cx, 3], [cx, this.height - 3]]);
    context.strokeStyle = colours.steel;
    context.lineWidth = 1.3;
    circle(context, cx, cy, unit);
    context.stroke();
    (multipliers ?? []).forEach(([re, im], n) => {
      const cut = Math.min(1, (0.98 * most) / sizes[n]);
      context.fillStyle = sizes[n] < 1 ? colours.good : colours.bad;
      circle(context, cx + re * cut * unit, cy - im * cut * unit, 3.6);
      context.fill();
    });
    const largest = sizes.length ? Math.max(...sizes) : NaN;
    const words = sizes.length
      ? `Stability multipliers on the unit circle; the largest modulus is ${digits(largest, 3)}`
      : 'Stability multipliers: none';
    mark(this.canvas, 'aria-label', words);
  }
}
