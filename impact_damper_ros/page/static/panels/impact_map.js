// SPDX-License-Identifier: Apache-2.0
// Impact map: velocity of m after each impact over the phase of the force.

import { Axes, colours, plain, plotPanel, SteadyRange, stopColour } from '../chart.js';
import { write, writeLine } from '../dom.js';
import { niceAbove, velocityUnit } from '../format.js';

const MOST_DOTS = 1500;

class ImpactMap extends Axes {
  constructor(canvas, store) {
    super(canvas);
    this.store = store;
    this.end = -1;
    this.rescale();
  }

  /** Choose the scale anew. */
  rescale() {
    this.up = new SteadyRange();
  }

  draw(now) {
    const { history, theory, showTheory } = this.store;
    const { impacts } = history;
    if ((impacts.end === this.end && !this.stale) || !this.begin()) return;
    this.end = impacts.end;
    const [time, stop, damper, phase] = ['time', 'stop', 'damper_velocity_after', 'phase'].map((name) => impacts.field(name));
    const predicted = (showTheory && theory.orbit?.impacts) || [];
    const since = history.lastChange;
    let fast = 0;
    const first = Math.max(impacts.start, impacts.end - MOST_DOTS);
    for (let n = Math.max(first, impacts.after(history.begun)); n < impacts.end; n += 1) fast = Math.max(fast, Math.abs(damper[n]));
    for (const one of predicted) fast = Math.max(fast, Math.abs(one.damper_velocity_after));
    const height = this.up.fit(fast > 0 ? niceAbove(1.2 * fast) : 0, now);
    const { toX, toY, box } = this.axes({
      x: [0, 1], along: ['phase of the force', plain('cycles')], y: [-height, height], across: ['Z′ after', velocityUnit(height)], xTicks: 5,
    });
    this.marks = [];
    this.within(box, (context) => {
      const dot = impacts.end - first > 400 ? 1.3 : 1.9;
      for (let n = first; n < impacts.end; n += 1) {
        if (!Number.isFinite(phase[n])) continue;
        const age = (impacts.end - n) / MOST_DOTS;
        const old = time[n] < since;
        context.globalAlpha = old ? 0.14 : Math.max(0.25, 0.95 - age);
        const [a, b] = [toX(phase[n]), toY(damper[n])];
        this.marks.unshift([a, b, () => `stop ${stop[n]}: ${this.values(a, b)}`]);
        this.impact(stop[n], a, b, dot, old ? colours.quiet : stopColour(stop[n]));
      }
      context.globalAlpha = 1;
      for (const one of predicted) this.disc(toX(((one.phase % 1) + 1) % 1), toY(one.damper_velocity_after), 6.5, '', colours.theory);
      // the last impact
      if (impacts.length) {
        const n = impacts.end - 1;
        this.dot(toX(phase[n]), toY(damper[n]), stopColour(stop[n]), 4);
      }
    });
    write(this.note, !impacts.length ? 'no impact yet' : Number.isFinite(phase[impacts.end - 1]) ? '' : 'no force: no phase');
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store) => {
  const { canvas, line } = plotPanel(root, 'map', 'impact-map', 'Impact map: velocity of m after each impact over the phase of the force');
  const panel = new ImpactMap(canvas, store);
  store.on('theory', () => writeLine(line, store.theory.title));
  return panel;
};
