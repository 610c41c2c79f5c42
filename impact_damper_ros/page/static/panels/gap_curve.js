// SPDX-License-Identifier: Apache-2.0
// Xmax/A over the gap by theory, with the rig's own dot on it; a click sets the gap.

import { Axes, colours, dashes, plain, plotPanel } from '../chart.js';
import { mark, write, writeLine } from '../dom.js';
import { digits, lengthUnit, niceAbove, withUnit } from '../format.js';
import { entry } from '../glossary.js';

/** Entries of the glossary that spell special points out. */
const MARKS = { fold: 'fold', 'period doubling': 'doubling', 'Neimark-Sacker': 'neimark-sacker', 'branch point': 'branch-point', grazing: 'grazing' };
const KINDS = ['not viable', 'unstable', 'stable'];

export class GapCurve extends Axes {
  constructor(canvas, store, setGap) {
    super(canvas);
    this.store = store;
    /** The special point gone to by the keyboard. */
    this.visited = -1;
    this.low = 0;
    this.high = this.top = 1;
    this.unit = '';
    this.beyond = false;
    canvas.addEventListener('click', (event) => {
      this.follow(event);
      if (this.aim > 0 && store.steers) setGap(Number(this.aim.toPrecision(4)));
    });
    canvas.addEventListener('keydown', (event) => {
      const special = { n: 1, p: -1 }[event.key];
      if (special) this.visit(special);
      const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!step || !(this.gap > 0) || !this.store.steers) return;
      event.preventDefault();
      setGap(Number((this.gap * 1.01 ** step).toPrecision(4)));
    });
  }

  follow(event) {
    this.visited = -1;
    super.follow(event);
  }

  /** The gap at the pointer; NaN where a click would set none. */
  get aim() {
    const gap = this.pointer && this.visited < 0 ? this.plan?.fromX(this.pointer[0]) : NaN;
    return gap >= this.low && gap <= this.high ? gap : NaN;
  }

  /** The branch that is nearest at a gap. */
  values(x, y) {
    const { fromX, toY } = this.plan ?? {};
    if (!super.values(x, y)) return '';
    const gap = fromX(x);
    const crossed = (this.store.theory.curve?.branches ?? []).flatMap(({ gap: gaps, x_max_ratio: ratios }) => gaps.slice(1).flatMap((to, n) => {
      const from = gaps[n];
      if ((from - gap) * (to - gap) > 0 || from === to) return [];
      return [ratios[n] + ((gap - from) / (to - from)) * (ratios[n + 1] - ratios[n])];
    }));
    const ratio = crossed.sort((one, other) => Math.abs(toY(one) - y) - Math.abs(toY(other) - y))[0];
    const { factor, unit } = lengthUnit(this.high);
    return [`d ${digits(gap * factor, 3)}\u202f${unit}`, ratio === undefined ? '' : `Xmax/A ${digits(ratio, 3)}`].filter(Boolean).join(', ');
  }

  /** A special point in words. */
  named({ kind, gap, x_max_ratio: ratio }) {
    const [name, sentence] = kind in MARKS ? entry(MARKS[kind]) : [kind, ''];
    return `${name} at ${withUnit(gap, 'm')}, Xmax/A ${digits(ratio, 3)}. ${sentence}`;
  }

  /** Go to the next or the last special point by the keyboard, and name it. */
  visit(step) {
    const { length } = this.marks;
    if (!length) return;
    this.visited = (Math.max(this.visited, step > 0 ? -1 : 0) + step + length) % length;
    this.point();
  }

  /** Point at the special point gone to, wherever it is by now. */
  point() {
    const place = this.marks[this.visited];
    if (!place) return;
    this.pointer = /** @type {[number, number]} */ (place.slice(0, 2));
    this.readOut();
    mark(this.canvas, 'aria-description', this.line.textContent);
  }

  get gap() {
    return this.store.values.gap ?? this.store.numbers.gap;
  }

  draw() {
    if (!this.stale || !this.begin()) return;
    const { design, numbers: { x_max_ratio: measured }, theory: { curve } } = this.store;
    const branches = curve?.branches ?? [];
    const gaps = branches.flatMap((branch) => branch.gap);
    let low = Math.min(Infinity, ...gaps);
    let high = Math.max(0, ...gaps);
    let most = Math.max(0, ...branches.flatMap((branch) => branch.x_max_ratio));
    // A rig far beyond the curve stands at its end.
    this.beyond = high > 0 && (this.gap > 4 * high || this.gap < low / 20);
    if (this.gap > 0 && !this.beyond) {
      low = Math.min(low, 0.9 * this.gap);
      high = Math.max(high, 1.1 * this.gap);
    }
    if (design) [low, high] = [Math.min(low, 0.9 * design.gap), Math.max(high, 1.1 * design.gap)];
    if (!(high > 0)) [low, high] = [0, 1];
    if (measured > 0) most = Math.max(most, Math.min(measured, 3 * (most || measured)));
    const { factor, unit } = lengthUnit(high);
    // The range changes only if it has to, so that the curve stays where it was.
    const end = niceAbove(high * factor) / factor;
    const begin = low < 0.35 * end ? 0 : 0.9 * low;
    if (!(this.high >= high && this.high <= 2 * end && this.low <= low && begin - this.low < 0.2 * end) || this.unit !== unit) {
      [this.low, this.high, this.unit] = [begin, end, unit];
    }
    const top = niceAbove(1.1 * most || 1);
    if (!(this.top >= top && this.top <= 2.5 * top)) this.top = top;
    const { toX, toY, box } = this.axes({ x: [this.low, this.high], along: ['gap d', { factor, unit }], y: [0, this.top], across: ['Xmax / A', plain()] });
    this.within(box, (context) => {
      const upright = (gap, stroke, alpha, dash = []) => {
        context.globalAlpha = alpha;
        this.lines(stroke, 1, [[[toX(gap), box.top], [toX(gap), box.top + box.height]]], dash);
        context.globalAlpha = 1;
      };
      /** Beside a line, on its left or right, at the top of the frame or at its bottom. */
      const label = (text, place, colour, left, level = 'top') => {
        this.text(text, place + (left ? -4 : 4), level === 'top' ? box.top + 3 : box.top + box.height - 3, { size: 0.75, colour, align: left ? 'right' : 'left', level });
      };
      if (curve?.optimum) upright(curve.optimum.gap, colours.good, 0.5, [2, 3]);
      if (design) {
        upright(design.gap, colours.good, 1, [6, 3]);
        label('my structure: best', toX(design.gap), colours.good, toX(design.gap) > box.left + box.width / 2);
      }
      for (const branch of branches) this.branch(branch, toX, toY);
      this.specials(curve?.special ?? [], toX, toY);
      // The predicted motion, of the value under the finger
      if (curve?.x_max_ratio > 0) this.dot(toX(curve.gap), toY(curve.x_max_ratio), colours.theory, 4);
      if (this.aim > 0 && this.store.steers) {
        upright(this.aim, colours.link, 1);
        label(`set ${digits(this.aim * factor, 3)} ${unit}`, toX(this.aim), colours.link, toX(this.aim) > box.left + box.width / 2, 'bottom');
      }
      if (this.beyond) {
        const right = this.gap > this.high;
        const text = `the rig is at ${withUnit(this.gap, 'm')}`;
        label(right ? `${text} →` : `← ${text}`, box.left + (right ? box.width : 0), colours.primary, right);
      } else if (this.gap > 0) {
        upright(this.gap, colours.primary, 0.55);
        if (Number.isFinite(measured)) this.dot(toX(this.gap), Math.max(toY(measured), box.top + 2), colours.primary, 6);
      }
    });
    write(this.note, branches.length ? '' : curve?.text || this.store.theory.failed || 'computing…');
    const there = this.gap > 0 ? `${digits(this.gap * factor, 4)} ${unit}` : 'unknown';
    Object.assign(this.canvas, { ariaValueMin: this.low, ariaValueMax: this.high, ariaValueNow: this.gap || 0, ariaValueText: `gap ${there}, Xmax over A ${digits(measured, 3)}` });
  }

  /** Special points as rings; the pointer names them. */
  specials(specials, toX, toY) {
    this.marks = specials.map((special) => /** @type {[number, number, () => string]} */ ([toX(special.gap), toY(special.x_max_ratio), () => this.named(special)])).sort(([one], [other]) => one - other);
    this.point();
    for (const [a, b] of this.marks) this.disc(a, b, 3.6, colours.page, colours.special, 1.6);
  }

  /** Stable parts solid, unstable ones dashed, those that are not viable dotted. */
  branch({ gap, x_max_ratio: ratio, stable, viable }, toX, toY) {
    const kind = (n) => (viable[n] ? (stable[n] ? 'stable' : 'unstable') : 'not viable');
    // Between two points of different kinds it is the lesser one.
    const piece = (n) => [kind(n), kind(n + 1)].sort((a, b) => KINDS.indexOf(a) - KINDS.indexOf(b))[0];
    let n = 0;
    while (n < gap.length - 1) {
      const shown = piece(n);
      const [from, solid] = [n, shown === 'stable'];
      while (n < gap.length - 1 && piece(n) === shown) n += 1;
      const points = gap.slice(from, n + 1).map((one, k) => [toX(one), toY(ratio[from + k])]);
      this.lines(solid ? colours.theory : colours.quiet, solid ? 2 : 1.2, [points], dashes({ stable: solid, viable: shown !== 'not viable' }));
    }
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const label = 'Gap on the curve of Xmax over A; keys N and P go to its special points';
  const range = { tabindex: '0', role: 'slider', 'aria-valuemin': '0', 'aria-valuemax': '1', 'aria-valuenow': '0' };
  const { canvas, line } = plotPanel(root, 'curve', 'gap-curve', label, range);
  const panel = new GapCurve(canvas, store, (gap) => actions.turn({ gap }));
  store.on('theory', () => {
    const { gap, bound } = store.theory.best;
    writeLine(line, gap > 0 ? `best gap ${bound && `${bound} `}${withUnit(gap, 'm')}` : '');
  });
  store.on('numbers values change preset', () => { panel.stale = true; });
  return panel;
};
