// SPDX-License-Identifier: Apache-2.0
// A small canvas for a scientific picture: size, colours of the theme, axes with units.

import { element, write } from './dom.js';
import { capital, digits, minus, niceAbove, ticks } from './format.js';
import { entry, term } from './glossary.js';

/** How far from a mark the pointer still means it, px. */
const NEAR = 8;
const NAMES = [
  'page', 'panel', 'line', 'ink', 'quiet', 'grid', 'stop', 'primary', 'damper', 'theory', 'special',
  'good', 'bad', 'open', 'force', 'link', 'steel', 'shade', 'lower', 'upper',
];

/** Colours of the theme in force; read anew when it changes. */
export const colours = {};

export function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue(`--${name}`).trim();
  colours.size = parseFloat(style.fontSize);
}

/** Font of a size relative to the text of the page. */
export const font = (scale = 0.8, weight = '') =>
  `${weight} ${Math.round(Math.max(10.5, scale * colours.size))}px system-ui, 'Segoe UI', Roboto, 'Noto Sans', 'Liberation Sans', 'DejaVu Sans', sans-serif`;

/** Colour of stop 1 or 2. */
export const stopColour = (stop) => (stop === 1 ? colours.lower : colours.upper);

/** Dashes of a line for a motion: solid if stable, dashed if not, dotted if it is not viable. */
export const dashes = ({ stable, viable }) => (viable === false ? [1, 3] : stable ? [] : [5, 4]);

/** The unit of a quantity without one, or of one that is read as it is. */
export const plain = (unit = '') => ({ factor: 1, unit });

/** A canvas that knows its size in CSS pixels and draws sharply on every screen. */
export class Canvas {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.width = this.height = this.ratio = 0;
    this.stale = true;
    new ResizeObserver(() => this.measure()).observe(canvas);
    this.measure();
  }

  measure() {
    const box = this.canvas.getBoundingClientRect();
    const ratio = Math.min(3, devicePixelRatio || 1);
    const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (width !== this.canvas.width || height !== this.canvas.height) Object.assign(this.canvas, { width, height });
    Object.assign(this, { ratio, width: box.width, height: box.height, stale: true });
  }

  /** Begin a picture; false if the canvas is not shown. */
  begin() {
    this.stale = false;
    if (this.width < 4 || this.height < 4) return false;
    const { context, ratio } = this;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    Object.assign(context, { lineJoin: 'round', lineCap: 'butt', globalAlpha: 1 });
    return true;
  }

  /** Draw lines through points [x, y]. */
  lines(colour, width, lines, dash = []) {
    const { context } = this;
    Object.assign(context, { strokeStyle: colour, lineWidth: width });
    context.setLineDash(dash);
    context.beginPath();
    for (const [[x, y], ...rest] of lines) {
      context.moveTo(x, y);
      for (const [a, b] of rest) context.lineTo(a, b);
    }
    context.stroke();
    context.setLineDash([]);
  }

  /** Draw a disc in a colour, or only its rim. */
  disc(x, y, radius, colour, rim = '', width = 1.5) {
    const { context } = this;
    context.beginPath();
    context.arc(x, y, radius, 0, 7);
    if (colour) Object.assign(context, { fillStyle: colour }).fill();
    if (rim) Object.assign(context, { strokeStyle: rim, lineWidth: width }).stroke();
  }

  /** Write words. */
  text(words, x, y, { size = 0.78, colour = colours.quiet, align = 'left', level = 'alphabetic', style = '' } = {}) {
    Object.assign(this.context, { font: font(size, style), fillStyle: colour, textAlign: align, textBaseline: level }).fillText(words, x, y);
  }

  /** Draw within a box only. */
  within({ left, top, width, height }, draw) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    draw(context);
    context.restore();
  }
}

/** Append a small panel for a plot: its heading, an entry of the glossary, a line of words, and the canvas with a description; return the last two. */
export function plotPanel(root, id, about, label, attributes = {}) {
  const line = element('p', { class: 'line', id: `${id}-line` });
  const canvas = element('canvas', { id: `${id}-canvas`, role: 'img', 'aria-label': label, ...attributes });
  const heading = element('h2', { id: `${id}-title` }, term(about, capital(entry(about)[0])));
  root.append(element('section', { class: 'panel small', id, 'aria-labelledby': `${id}-title` }, element('div', { class: 'head' }, heading, line), element('div', { class: 'chart' }, canvas)));
  return { line, canvas };
}

/** A range that grows at once and shrinks only if it has been far too large for a while. */
export class SteadyRange {
  range = 0;

  since = 0;

  fit(asked, now) {
    if (!(asked > 0)) return this.range || 1;
    const grows = asked > this.range;
    if (!grows && asked > 0.62 * this.range) this.since = now;
    if (grows || now - this.since > 1500) [this.range, this.since] = [asked, now];
    return this.range;
  }
}

/** A range about zero, with as much on either side unless one of them needs less than half of that. */
export class SteadySpan {
  sides = [new SteadyRange(), new SteadyRange()];

  /** Return both ends for values between a least and a largest one. */
  fit(least, most, now) {
    const asked = [-least, most];
    const larger = Math.max(...asked);
    const [down, up] = asked.map((one, n) => this.sides[n].fit(larger > 0 ? niceAbove(one < 0.5 * larger ? Math.max(one, 0.2 * larger) : larger) : 0, now));
    return [-down, up];
  }
}

/** A plot with a line that names what is under the pointer: one of its marks, or the values there. */
export class ReadOut extends Canvas {
  /** Where marks are drawn, the foremost first, and what each is called. */
  marks = /** @type {[number, number, () => string][]} */ ([]);

  constructor(canvas) {
    super(canvas);
    /** @type {[number, number] | null} */
    this.pointer = null;
    this.line = element('p', { class: 'read-out' });
    /** In place of what there is to plot */
    this.note = element('p', { class: 'note' });
    canvas.after(this.line, this.note);
    canvas.addEventListener('pointermove', (event) => this.follow(event));
    canvas.addEventListener('pointerleave', () => this.follow(null));
  }

  /** Follow the pointer; null where it is elsewhere. */
  follow(event) {
    const box = this.canvas.getBoundingClientRect();
    this.pointer = event ? [event.clientX - box.left, event.clientY - box.top] : null;
    this.stale = true;
    this.readOut();
  }

  /** The values at a place, in pixels. */
  values(_x, _y) {
    return '';
  }

  /** Show what is under the pointer. */
  readOut() {
    const [x, y] = this.pointer ?? [NaN, NaN];
    const near = this.marks.find(([a, b]) => Math.hypot(a - x, b - y) < NEAR);
    write(this.line, near ? near[2]() : this.values(x, y));
  }
}

/** Axes in a canvas: a frame with a light grid, numbers and the names of both quantities. */
export class Axes extends ReadOut {
  /** The frame, how to get from values to pixels and back, and both quantities. */
  plan = null;

  /** Both values under a place in the frame, with their units. */
  values(x, y) {
    const { box, fromX, fromY, along, across } = this.plan ?? {};
    if (!box || !(x >= box.left && x <= box.left + box.width && y >= box.top && y <= box.top + box.height)) return '';
    const value = ([name, { factor, unit }], number) => `${name} ${digits(number * factor, 3)}${unit && `\u202f${unit}`}`;
    return `${value(along, fromX(x))}, ${value(across, fromY(y))}`;
  }

  /** Draw the frame for ranges of two quantities, each with its name and the unit in which it is read; return how to get from values to pixels. */
  axes({ x, y, along, across, xTicks = 4, yTicks = 4 }) {
    const [[xName, xUnit], [yName, yUnit]] = [along, across];
    const { context } = this;
    const size = 0.78;
    context.font = font(size);
    const em = Math.max(10.5, size * colours.size);
    const [[xLow, xHigh], [yLow, yHigh]] = [[x, xUnit], [y, yUnit]].map(([range, { factor }]) => range.map((end) => end * factor));
    const rows = ticks(yLow, yHigh, Math.min(yTicks, Math.max(2, this.height / (3.2 * em))));
    const labels = rows.values.map((value) => minus(value.toFixed(rows.decimals)));
    const margin = {
      left: Math.ceil(Math.max(...labels.map((text) => context.measureText(text).width), 8) + 10),
      right: Math.ceil(0.9 * em),
      top: Math.ceil(2.1 * em),
      bottom: Math.ceil(2.75 * em),
    };
    const box = {
      left: margin.left,
      top: margin.top,
      width: Math.max(10, this.width - margin.left - margin.right),
      height: Math.max(10, this.height - margin.top - margin.bottom),
    };
    const toX = (value) => box.left + ((value - xLow) / (xHigh - xLow)) * box.width;
    const toY = (value) => box.top + box.height - ((value - yLow) / (yHigh - yLow)) * box.height;
    const columns = ticks(xLow, xHigh, Math.min(xTicks, Math.max(2, box.width / (4.5 * em))));
    const [ground, right] = [box.top + box.height, box.left + box.width];
    const sharp = (place) => Math.round(place) + 0.5;
    this.lines(colours.grid, 1, [
      ...columns.values.map((value) => [[sharp(toX(value)), box.top], [sharp(toX(value)), ground]]),
      ...rows.values.map((value) => [[box.left, sharp(toY(value))], [right, sharp(toY(value))]]),
    ]);
    context.strokeStyle = colours.line;
    context.strokeRect(sharp(box.left), sharp(box.top), Math.round(box.width), Math.round(box.height));
    for (const value of columns.values) this.text(minus(value.toFixed(columns.decimals)), toX(value), ground + 4, { align: 'center', level: 'top' });
    rows.values.forEach((value, n) => this.text(labels[n], box.left - 5, toY(value), { align: 'right', level: 'middle' }));
    const named = (name, { unit }) => (unit ? `${name} (${unit})` : name);
    this.text(named(xName, xUnit), right, this.height - 0.28 * em, { align: 'right' });
    this.text(named(yName, yUnit), Math.max(2, box.left - margin.left + 4), em + 1);
    this.plan = {
      box, along, across,
      toX: (value) => toX(value * xUnit.factor),
      toY: (value) => toY(value * yUnit.factor),
      fromX: (place) => (xLow + ((place - box.left) / box.width) * (xHigh - xLow)) / xUnit.factor,
      fromY: (place) => (yLow + ((box.top + box.height - place) / box.height) * (yHigh - yLow)) / yUnit.factor,
    };
    this.readOut();
    return this.plan;
  }

  /** An impact: a square of stop 1, a disc of stop 2. */
  impact(stop, x, y, size, colour = stopColour(stop)) {
    if (stop === 1) Object.assign(this.context, { fillStyle: colour }).fillRect(x - size, y - size, 2 * size, 2 * size);
    else this.disc(x, y, 1.2 * size, colour);
  }

  /** A point that moves, with a rim. */
  dot(x, y, colour, radius) {
    this.disc(x, y, radius, colour, colours.page);
  }
}
