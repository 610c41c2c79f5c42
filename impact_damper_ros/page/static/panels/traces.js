// SPDX-License-Identifier: Apache-2.0
// Scrolling traces of X, Z and both stops by uPlot, with impacts, turned knobs and theory.

import { colours, dashes, font, SteadySpan, stopColour, strokeLines, within } from '../chart.js';
import { byId, element, mark, write } from '../dom.js';
import { decimalsOf, digits, lengthUnit, minus, TAU } from '../format.js';
import { drive } from '../words.js';

const MOST_DOTS = 1200;
/** Stops so many times farther away than anything moves are not in view. */
const FAR = 20;
/** Steps between the numbers of an axis: 1, 2 and 5 times powers of ten. */
const STEPS = Array.from({ length: 22 }, (_, n) => n - 11).flatMap((power) => [1, 2, 5].map((one) => Number(`${one}e${power}`)));
const WINDOWS = [30, 10, 3, 1];

class Traces {
  constructor(store) {
    this.store = store;
    this.history = store.history;
    this.theory = store.theory;
    this.stale = true;
    this.place = byId('plot');
    this.range = new SteadySpan();
    this.unit = lengthUnit(1);
    this.legend = this.makeLegend();
    this.make();
    new ResizeObserver(() => this.resize()).observe(this.place);
  }

  makeLegend() {
    const list = byId('legend');
    const made = {};
    for (const [key, name, title] of [
      ['x', 'X', 'Displacement of M from its static equilibrium'],
      ['z', 'Z', 'Displacement of m'],
      ['stop', 'stops', 'Places of the stops, which ride on M; here their distance, the gap'],
      ['ghost', 'what if', 'X and Z of the rig with other parameters'],
      ['measured', 'measured', 'X and Z as the sensors measure them'],
      ['commands', 'commands', 'Where the stops are to go, by command; below, the active force on M'],
    ]) {
      const value = element('dd', {});
      list.append(element('div', { title, 'data-series': key, hidden: !['x', 'z', 'stop'].includes(key) }, element('dt', { text: name }), value));
      made[key] = value;
    }
    return made;
  }

  size() {
    return { width: Math.max(120, this.place.clientWidth), height: Math.max(90, this.place.clientHeight) };
  }

  make() {
    this.chart?.destroy();
    const axisFont = font(0.78);
    const em = Math.max(10.5, 0.78 * colours.size);
    const axis = {
      incrs: STEPS,
      stroke: () => colours.quiet,
      font: axisFont,
      grid: { stroke: () => colours.grid, width: 1 },
      ticks: { stroke: () => colours.line, width: 1, size: 4 },
      border: { show: true, stroke: () => colours.line, width: 1 },
    };
    const line = (stroke, width) => ({ stroke, width, points: { show: false }, spanGaps: false });
    this.chart = new globalThis.uPlot(
      {
        ...this.size(),
        padding: [Math.round(1.9 * em), Math.round(1.4 * em), 0, 0],
        legend: { show: false },
        cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
        select: { show: false },
        scales: {
          x: { time: false, range: () => this.span() },
          y: { range: () => this.reach() },
        },
        axes: [
          {
            ...axis,
            size: Math.round(2.6 * em),
            gap: 3,
            space: 5 * em,
            values: (_, values) => this.numbers(values),
          },
          {
            ...axis,
            size: Math.round(3.9 * em),
            gap: 4,
            space: 2.6 * em,
            values: (_, values) => this.numbers(values, this.unit.factor),
          },
        ],
        series: [
          {},
          line(() => stopColour(1), 0.8),
          line(() => stopColour(2), 0.8),
          line(() => colours.damper, 1.8),
          line(() => colours.primary, 2.6),
        ],
        hooks: { drawClear: [(u) => this.under(u)], draw: [(u) => this.over(u)], setCursor: [() => this.readOut()] },
      },
      this.data(),
      this.place,
    );
    this.chart.over.setAttribute('aria-hidden', 'true');
  }

  get pictures() {
    return [this];
  }

  /** The canvas of the chart, with its size in CSS pixels. */
  get picture() {
    return { canvas: this.chart.ctx.canvas, width: this.chart.width, height: this.chart.height };
  }

  recolour() {
    this.make();
  }

  /** Choose the scale anew. */
  rescale() {
    this.range = new SteadySpan();
  }

  resize() {
    const { width, height } = this.size();
    if (width !== this.chart.width || height !== this.chart.height) this.chart.setSize({ width, height });
  }

  span() {
    const { end, window } = this.history;
    return Number.isFinite(end) ? [end - window, end] : [-window, 0];
  }

  /** The range: all that moves, the what-if too, and the stops unless they are far beyond it. */
  reach() {
    const all = this.history.reach(this.span()[0]);
    let { low, high } = all;
    const moved = Math.max(-low, high);
    if (!(moved > 0) || Math.max(-all.lower, all.upper) < FAR * moved) [low, high] = [Math.min(low, all.lower), Math.max(high, all.upper)];
    const range = this.range.fit(1.04 * low, 1.04 * high, performance.now());
    this.unit = lengthUnit(Math.max(-range[0], range[1]));
    return range;
  }

  /** Numbers of an axis, with the decimals that their step needs. */
  numbers(values, factor = 1) {
    const decimals = decimalsOf(values.length > 1 ? factor * (values[1] - values[0]) : 1);
    return values.map((value) => minus((value * factor + 0).toFixed(decimals)));
  }

  /** The samples in the window, and the one before it. */
  data() {
    const { samples } = this.history.own;
    const first = Math.max(samples.start, samples.after(this.span()[0]) - 1);
    return ['time', 'stop_1', 'stop_2', 'z', 'x'].map((name) => samples.field(name).subarray(first, samples.end));
  }

  /** Draw what is new. */
  draw(now, anew) {
    if (!anew && !this.stale) return;
    this.stale = false;
    this.chart.setData(this.data(), false);
    const [min, max] = this.span();
    this.chart.setScale('x', { min, max });
    this.readOut();
  }

  /** Under the lines: knobs turned, as labelled lines. */
  under(u) {
    const { ctx: context, bbox } = u;
    const ratio = devicePixelRatio || 1;
    const em = Math.max(10.5, 0.78 * colours.size) * ratio;
    context.save();
    // names of both axes
    context.font = font(0.78).replace(/([\d.]+)px/, (_, size) => `${size * ratio}px`);
    context.fillStyle = colours.quiet;
    context.textBaseline = 'alphabetic';
    context.textAlign = 'left';
    context.fillText(this.unit.unit, 4 * ratio, bbox.top - 0.85 * em);
    context.textAlign = 'right';
    context.fillText('rig time (s)', bbox.left + bbox.width, bbox.top + bbox.height + 2.35 * em);
    context.beginPath();
    context.rect(bbox.left, bbox.top - 1.8 * em, bbox.width, bbox.height + 1.8 * em);
    context.clip();
    const taken = [];
    const [from, to] = this.span();
    context.strokeStyle = colours.special;
    context.fillStyle = colours.special;
    context.lineWidth = ratio;
    context.textAlign = 'left';
    // The newest first: it has its text in any case.
    for (const { time, text } of this.history.changes.toReversed()) {
      if (time < from || time > to) continue;
      const place = u.valToPos(time, 'x', true);
      context.setLineDash([4 * ratio, 3 * ratio]);
      strokeLines(context, [[place, bbox.top - 1.3 * em], [place, bbox.top + bbox.height]]);
      context.setLineDash([]);
      const { width } = context.measureText(text);
      const left = Math.max(bbox.left, Math.min(place + 0.35 * em, bbox.left + bbox.width - width));
      const free = (height) => taken.every(([low, high, other]) => other !== height || left > high || left + width < low);
      const row = [bbox.top - 0.45 * em, bbox.top + 1.1 * em].find(free);
      if (row === undefined) continue;
      taken.push([left - em, left + width + em, row]);
      context.fillText(text, left, row);
    }
    context.restore();
  }

  /** Over the lines: the what-if, impacts as dots where m is, and the predicted motion. */
  over(u) {
    const { ctx: context, bbox } = u;
    const { impacts } = this.history;
    const ratio = devicePixelRatio || 1;
    const [from, to] = this.span();
    within(context, bbox, () => {
      this.ghost(u, context, ratio, from);
      const [time, stop, x, y] = ['time', 'stop', 'x', 'y'].map((name) => impacts.field(name));
      const perPixel = (impacts.end - impacts.after(from)) / Math.max(1, bbox.width / ratio);
      const size = (perPixel > 0.25 || this.history.window > 12 ? 1.6 : 2.6) * ratio;
      for (const side of [1, 2]) {
        context.fillStyle = stopColour(side);
        context.beginPath();
        for (let n = Math.max(impacts.after(from), impacts.end - MOST_DOTS); n < impacts.end; n += 1) {
          if (stop[n] !== side || time[n] > to) continue;
          const place = u.valToPos(time[n], 'x', true);
          const height = u.valToPos(x[n] + y[n], 'y', true);
          if (side === 1) context.rect(place - size, height - size, 2 * size, 2 * size);
          else {
            context.moveTo(place + 1.15 * size, height);
            context.arc(place, height, 1.15 * size, 0, 7);
          }
        }
        context.fill();
      }
      // Theory is of X in the laboratory.
      if (this.store.showTheory && !this.history.own.relative && this.theory.orbit?.t) this.predicted(u, context, ratio, from, to);
      this.controlled(u, context, ratio, from);
    });
  }

  /** What the sensors measured as dots; a command as dashes where the stops are to go, and its force. */
  controlled(u, context, ratio, from) {
    const { measured, acts, samples } = this.history.own;
    const { top, height, width } = u.bbox;
    const [time, x, z] = ['time', 'x', 'z'].map((name) => measured.field(name));
    const first = Math.max(measured.after(from), measured.end - MOST_DOTS);
    const dot = ((measured.end - first) * 6 < width / ratio ? 1.8 : 0.8) * ratio;
    context.fillStyle = colours.ink;
    for (let n = first; n < measured.end; n += 1) {
      const place = u.valToPos(time[n], 'x', true) - dot;
      for (const value of [x[n], z[n]]) context.fillRect(place, u.valToPos(value, 'y', true) - dot, 2 * dot, 2 * dot);
    }
    const shown = Math.max(acts.after(from), acts.end - MOST_DOTS);
    const [at, command, force] = ['time', 'command', 'force'].map((name) => acts.field(name));
    let largest = 0;
    for (let n = shown; n < acts.end; n += 1) if (force[n]) largest = Math.max(largest, Math.abs(force[n]));
    for (let n = shown; n < acts.end; n += 1) {
      if (!command[n]) continue;
      const place = u.valToPos(at[n], 'x', true);
      // Places in M, which is here by then
      const rest = samples.field('x')[Math.max(samples.after(at[n]) - 1, samples.start)];
      for (const stop of [1, 2]) {
        context.fillStyle = stopColour(stop);
        const level = u.valToPos(rest + acts.field(`stop_${stop}`)[n], 'y', true);
        if (Number.isFinite(level)) context.fillRect(place - 4 * ratio, level - 1.25 * ratio, 8 * ratio, 2.5 * ratio);
      }
      context.fillStyle = colours.force;
      if (force[n]) context.fillRect(place - ratio, top + height, 2 * ratio, (-0.12 * height * Math.abs(force[n])) / largest);
    }
  }

  /** X and Z of the what-if, as far as they are known: thin lines, X the stronger one. */
  ghost(u, context, ratio, from) {
    const { samples } = this.history.other;
    const time = samples.field('time');
    const first = samples.after(from);
    // No more points than pixels
    const stride = Math.max(1, Math.floor((samples.end - first) / (2 * u.bbox.width)));
    context.strokeStyle = colours.special;
    context.globalAlpha = 0.8;
    for (const [name, width] of /** @type {[string, number][]} */ ([['z', 0.8], ['x', 1.3]])) {
      const values = samples.field(name);
      context.lineWidth = width * ratio;
      const points = [];
      for (let n = first; n < samples.end; n += stride) points.push([u.valToPos(time[n], 'x', true), u.valToPos(values[n], 'y', true)]);
      if (points.length) strokeLines(context, points);
    }
    context.globalAlpha = 1;
  }

  predicted(u, context, ratio, from, to) {
    const { orbit } = this.theory;
    const count = orbit.t.length;
    const begin = Math.max(from, this.history.lastChange);
    // Thinner than what is measured, which is seen on both sides of it
    context.strokeStyle = colours.theory;
    context.lineWidth = 0.8 * ratio;
    context.setLineDash(dashes(orbit).map((length) => length * ratio));
    const lines = [];
    const perPeriod = (orbit.period / (to - from)) * (u.bbox.width / ratio);
    if (perPeriod < 36) {
      // Too dense to be seen as a line: how far M is predicted to move.
      const most = orbit.x.reduce((far, value) => Math.max(far, Math.abs(value)), 0);
      for (const value of [most, -most]) {
        const height = u.valToPos(value, 'y', true);
        lines.push([[u.valToPos(begin, 'x', true), height], [u.bbox.left + u.bbox.width, height]]);
      }
    } else {
      const zero = this.theory.zero(this.history.own.samples, this.history.end);
      const first = Math.floor((begin - zero - orbit.t[0]) / orbit.period);
      // No more points than pixels.
      const stride = Math.max(1, Math.floor(count / perPeriod));
      for (const values of [orbit.x, orbit.z]) {
        const points = [];
        for (let turn = first; zero + orbit.t[0] + turn * orbit.period < to; turn += 1) {
          for (let n = 0; n < count; n += stride) {
            const time = zero + orbit.t[n] + turn * orbit.period;
            if (time >= begin && time <= to) points.push([u.valToPos(time, 'x', true), u.valToPos(values[n], 'y', true)]);
          }
        }
        if (points.length) lines.push(points);
      }
    }
    strokeLines(context, ...lines);
    context.setLineDash([]);
  }

  /** Values at the cursor, or now. */
  readOut() {
    const { own, other } = this.history;
    for (const [key, rows] of [['ghost', other.samples], ['measured', own.measured], ['commands', own.acts]]) {
      this.legend[key].parentElement.hidden = rows.after(this.span()[0]) === rows.end;
    }
    const { left } = this.chart.cursor;
    const time = left >= 0 ? Math.min(this.chart.posToVal(left, 'x'), this.history.end) : this.history.end;
    const state = own.at(time);
    if (!state) return;
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
  const panel = new Traces(store);
  const buttons = WINDOWS.map((seconds) => element('button', {
    type: 'button', value: String(seconds), text: `${seconds} s`, 'aria-pressed': 'false', onclick: () => {
      store.setWindow(seconds);
      store.keepView('window', String(seconds));
    },
  }));
  byId('windows').append(...buttons);
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
    const seconds = [...WINDOWS].reverse().find((one) => one >= 8 / frequency) ?? WINDOWS[0];
    if (seconds !== store.history.window) store.setWindow(seconds);
  });
  const theory = byId('theory');
  const showTheory = () => {
    store.showTheory = theory.checked;
    store.emit('rescale', { time: NaN });
  };
  theory.checked = store.address.view.theory !== '0';
  theory.addEventListener('change', () => {
    showTheory();
    store.keepView('theory', theory.checked ? '' : '0');
  });
  store.showTheory = theory.checked;
  showWindow();
  return panel;
};
