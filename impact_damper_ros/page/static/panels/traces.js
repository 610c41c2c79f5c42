// SPDX-License-Identifier: Apache-2.0
// Scrolling traces of X, Z and both stops, with impacts, turned knobs and theory.

import { Axes, colours, dashes, font, plain, SteadySpan, stopColour } from '../chart.js';
import { all, byId, mark, viewSwitch, write } from '../dom.js';
import { digits, lengthUnit, TAU } from '../format.js';
import { drive } from '../words.js';

const MOST_DOTS = 1200;
/** Stops so many times farther away than anything moves are not in view. */
const FAR = 20;

class Traces extends Axes {
  constructor(canvas, store) {
    super(canvas);
    this.store = store;
    this.history = store.history;
    this.range = new SteadySpan();
    this.unit = lengthUnit(1);
    this.legend = Object.fromEntries(all('#legend div').map((one) => [one.dataset.series, one.lastElementChild]));
  }

  /** Choose the scale anew. */
  rescale() {
    this.range = new SteadySpan();
  }

  span() {
    const { end, window } = this.history;
    return Number.isFinite(end) ? [end - window, end] : [-window, 0];
  }

  /** The range: all that moves, the what-if too, and the stops unless they are far beyond it. */
  reach(now) {
    const all = this.history.reach(this.span()[0]);
    let { low, high } = all;
    const moved = Math.max(-low, high);
    if (!(moved > 0) || Math.max(-all.lower, all.upper) < FAR * moved) [low, high] = [Math.min(low, all.lower), Math.max(high, all.upper)];
    return this.range.fit(1.04 * low, 1.04 * high, now);
  }

  draw(now, anew) {
    if ((!anew && !this.stale) || !this.begin()) return;
    const [low, high] = this.reach(now);
    this.unit = lengthUnit(Math.max(-low, high));
    const { box } = this.axes({ x: this.span(), along: ['rig time', plain('s')], y: [low, high], across: ['X, Z', this.unit], xTicks: 12, yTicks: 9 });
    this.changes(box);
    this.within(box, () => {
      const { own: { samples, relative }, other } = this.history;
      for (const [name, stroke, wide] of /** @type {[string, string, number][]} */ ([
        ['stop_1', stopColour(1), 0.8], ['stop_2', stopColour(2), 0.8], ['z', colours.damper, 1.8], ['x', colours.primary, 2.6],
      ])) this.series(samples, name, stroke, wide);
      this.context.globalAlpha = 0.8;
      for (const [name, wide] of /** @type {[string, number][]} */ ([['z', 0.8], ['x', 1.3]])) this.series(other.samples, name, colours.special, wide);
      this.context.globalAlpha = 1;
      this.impacts(box);
      // Theory is of X in the laboratory.
      if (this.store.showTheory && !relative && this.store.theory.orbit?.t) this.predicted(box);
      this.controlled(box);
      if (this.pointer) this.lines(colours.steel, 1, [[[this.pointer[0], box.top], [this.pointer[0], box.top + box.height]]]);
    });
  }

  /** Samples in the window as a line, from the one before it on; of many in a column of the screen's pixels first, least, largest and last. */
  series(samples, name, strokeStyle, lineWidth) {
    const { context, ratio, plan: { toX, toY } } = this;
    const [time, values] = ['time', name].map((one) => samples.field(one));
    const [left, middle] = [toX(0), toY(0)];
    const [across, up] = [toX(1) - left, toY(1) - middle];
    let [column, x, first, y, least, most] = [NaN, 0, 0, 0, 0, 0];
    // A line that only rises or falls in its column has no corner there.
    const finish = () => {
      if (least < most) for (const level of [least, most].filter((one) => one !== first).concat(y)) context.lineTo(x, level);
    };
    Object.assign(context, { strokeStyle, lineWidth });
    context.beginPath();
    for (let n = Math.max(samples.start, samples.after(this.span()[0]) - 1); n < samples.end; n += 1) {
      const there = middle + up * values[n];
      if (Number.isNaN(there)) continue;
      const place = left + across * time[n];
      if (Math.floor(ratio * place) !== column) {
        finish();
        context.lineTo(place, there);
        column = Math.floor(ratio * place);
        [first, least, most] = [there, there, there];
      } else if (there < least) least = there;
      else if (there > most) most = there;
      x = place;
      y = there;
    }
    finish();
    context.stroke();
  }

  /** Knobs turned, as labelled lines. */
  changes({ left, top, width, height }) {
    const { context } = this;
    const em = Math.max(10.5, 0.78 * colours.size);
    const taken = [];
    const [from, to] = this.span();
    context.font = font(0.78);
    // The newest first: it has its text in any case.
    for (const { time, text } of this.history.changes.toReversed()) {
      if (time < from || time > to) continue;
      const place = this.plan.toX(time);
      this.lines(colours.special, 1, [[[place, top - 1.3 * em], [place, top + height]]], [4, 3]);
      const wide = context.measureText(text).width;
      // Beside the unit of the axis
      const begin = Math.max(left + 2.5 * em, Math.min(place + 0.35 * em, left + width - wide));
      const row = [top - 0.45 * em, top + 1.1 * em].find((level) => taken.every(([low, high, other]) => other !== level || begin > high || begin + wide < low));
      if (row === undefined) continue;
      taken.push([begin - em, begin + wide + em, row]);
      this.text(text, begin, row, { colour: colours.special });
    }
  }

  /** Impacts as dots where m is. */
  impacts({ width }) {
    const { impacts, window } = this.history;
    const [from, to] = this.span();
    const [time, stop, x, y] = ['time', 'stop', 'x', 'y'].map((name) => impacts.field(name));
    const first = impacts.after(from);
    const size = (impacts.end - first) / Math.max(1, width) > 0.25 || window > 12 ? 1.6 : 2.6;
    for (let n = Math.max(first, impacts.end - MOST_DOTS); n < impacts.end; n += 1) {
      if (time[n] <= to) this.impact(stop[n], this.plan.toX(time[n]), this.plan.toY(x[n] + y[n]), size);
    }
  }

  /** What the sensors measured as dots; a command as dashes where the stops are to go, and its force. */
  controlled({ top, height, width }) {
    const { context, history: { own: { measured, acts, samples } } } = this;
    const [from] = this.span();
    const [time, x, z] = ['time', 'x', 'z'].map((name) => measured.field(name));
    const first = Math.max(measured.after(from), measured.end - MOST_DOTS);
    const dot = (measured.end - first) * 6 < width ? 1.8 : 0.8;
    context.fillStyle = colours.ink;
    for (let n = first; n < measured.end; n += 1) {
      for (const value of [x[n], z[n]]) context.fillRect(this.plan.toX(time[n]) - dot, this.plan.toY(value) - dot, 2 * dot, 2 * dot);
    }
    const shown = Math.max(acts.after(from), acts.end - MOST_DOTS);
    const [at, command, force] = ['time', 'command', 'force'].map((name) => acts.field(name));
    const largest = force.subarray(shown, acts.end).reduce((most, value) => Math.max(most, Math.abs(value) || 0), 0);
    for (let n = shown; n < acts.end; n += 1) {
      if (!command[n]) continue;
      const place = this.plan.toX(at[n]);
      // Places in M, which is here by then
      const rest = samples.field('x')[Math.max(samples.after(at[n]) - 1, samples.start)];
      for (const stop of [1, 2]) {
        context.fillStyle = stopColour(stop);
        const level = this.plan.toY(rest + acts.field(`stop_${stop}`)[n]);
        if (Number.isFinite(level)) context.fillRect(place - 4, level - 1.25, 8, 2.5);
      }
      context.fillStyle = colours.force;
      if (force[n]) context.fillRect(place - 1, top + height, 2, (-0.12 * height * Math.abs(force[n])) / largest);
    }
  }

  predicted({ left, width }) {
    const { history, store: { theory, theory: { orbit } } } = this;
    const [from, to] = this.span();
    const begin = Math.max(from, history.lastChange, history.own.samples.row(history.own.samples.start).time ?? from);
    const lines = [];
    const perPeriod = (orbit.period / (to - from)) * width;
    if (perPeriod < 36) {
      // Too dense to be seen as a line: how far M is predicted to move.
      const most = orbit.x.reduce((far, value) => Math.max(far, Math.abs(value)), 0);
      for (const value of [most, -most]) lines.push([[this.plan.toX(begin), this.plan.toY(value)], [left + width, this.plan.toY(value)]]);
    } else {
      const zero = theory.zero(history.own.samples, history.end);
      const first = Math.floor((begin - zero - orbit.t[0]) / orbit.period);
      // No more points than pixels.
      const stride = Math.max(1, Math.floor(orbit.t.length / perPeriod));
      for (const values of [orbit.x, orbit.z]) {
        const points = [];
        for (let turn = first; zero + orbit.t[0] + turn * orbit.period < to; turn += 1) {
          for (let n = 0; n < orbit.t.length; n += stride) {
            const time = zero + orbit.t[n] + turn * orbit.period;
            if (time >= begin && time <= to) points.push([this.plan.toX(time), this.plan.toY(values[n])]);
          }
        }
        if (points.length) lines.push(points);
      }
    }
    // Thinner than what is measured, which is seen on both sides of it
    this.lines(colours.theory, 0.8, lines, dashes(orbit));
  }

  /** Values at the pointer, or now. */
  readOut() {
    const { own, other, end } = this.history ?? {};
    if (!this.plan) return;
    for (const [key, rows] of [['ghost', other.samples], ['measured', own.measured], ['commands', own.acts]]) {
      this.legend[key].parentElement.hidden = rows.after(this.span()[0]) === rows.end;
    }
    const time = this.pointer ? Math.min(this.plan.fromX(this.pointer[0]), end) : end;
    const state = own.at(time) ?? {};
    const { factor, unit } = this.unit;
    const shown = (value) => (Number.isFinite(value) ? `${digits(value * factor, 3)} ${unit}` : '–');
    const ghost = other.samples.length ? other.at(time) : null;
    write(this.legend.x, shown(state.x));
    write(this.legend.z, shown(state.z));
    write(this.legend.stop, shown(state.stop_1 - state.stop_2));
    write(this.legend.ghost, `X ${shown(ghost?.x)}, Z ${shown(ghost?.z)}`);
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const panel = new Traces(byId('plot-canvas'), store);
  const buttons = all('#windows button');
  const windows = buttons.map((button) => Number(button.value));
  for (const button of buttons) {
    button.addEventListener('click', () => {
      store.setWindow(Number(button.value));
      store.keepView('window', button.value);
    });
  }
  const showWindow = () => {
    for (const button of buttons) mark(button, 'aria-pressed', String(Number(button.value) === store.history.window));
    actions.view();
  };
  store.on('view hello', showWindow);
  document.addEventListener('visibilitychange', () => actions.view());
  store.on('values', (values) => {
    const frequency = drive(store.values).frequency / TAU;
    if (!(values.force_frequencies || values.base_frequencies) || !(frequency > 0) || store.address.view.window) return;
    // Some eight cycles of what shakes the rig, or more
    const seconds = windows.findLast((one) => one >= 8 / frequency) ?? windows[0];
    if (seconds !== store.history.window) store.setWindow(seconds);
  });
  viewSwitch(store, 'theory', (on) => {
    store.showTheory = on;
    store.emit('rescale', { time: NaN });
  }, true)();
  showWindow();
  return panel;
};
