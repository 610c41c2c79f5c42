// SPDX-License-Identifier: Apache-2.0
// Phase portrait of m in the gap.

import { Axes, colours, dashes, plotPanel, SteadyRange, SteadySpan, stopColour } from '../chart.js';
import { write } from '../dom.js';
import { lengthUnit, niceAbove, TAU, velocityUnit } from '../format.js';
import { drive } from '../words.js';

const BANDS = 6;
const MOST_POINTS = 4000;

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
class PhasePortrait extends Axes {
  constructor(canvas, store) {
    super(canvas);
    this.store = store;
    this.rescale();
    this.seconds = 2;
  }

  /** Choose the scales anew. */
  rescale() {
    this.across = new SteadySpan();
    this.up = new SteadyRange();
  }

  draw(now, anew) {
    if ((!anew && !this.stale) || !this.begin()) return;
    const { history, theory, showTheory } = this.store;
    const { own, other, state, ghost, end } = history;
    const from = Math.max(end - this.seconds, history.begun);
    const [line, ghostLine] = [own, other].map((motion) => pointsSince(motion, from));
    const { y = [], relative_velocity: rate = [] } = (showTheory && theory.orbit) || {};
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
    const { toX, toY, box } = this.axes({
      x: [left, right], along: ['Y', lengthUnit(Math.max(-left, right))], y: [-height, height], across: ['Y′', velocityUnit(height)],
    });
    this.within(box, (context) => {
      const draw = (points, stroke, wide, dash = []) => {
        if (points.length) this.lines(stroke, wide, [points.map(([a, b]) => [toX(a), toY(b)])], dash);
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
      draw(orbit, colours.theory, 0.9, dashes(theory.orbit ?? {}));
      if (!state || !line.length) return;
      const [place, velocity] = line.at(-1);
      this.dot(toX(place), toY(velocity), colours.damper, 4.5);
    });
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store) => {
  const { canvas, line } = plotPanel(root, 'portrait', 'phase-portrait', 'Phase portrait of m in the gap: velocity over position relative to M');
  write(line, 'm in the gap');
  const panel = new PhasePortrait(canvas, store);
  store.on('values', () => {
    const frequency = drive(store.values).frequency / TAU;
    panel.seconds = frequency > 0 ? Math.min(40, 8 / frequency) : 10;
  });
  return panel;
};
