// SPDX-License-Identifier: Apache-2.0
// Xmax/A over the gap by theory, with the rig's own dot on it; a click sets the gap.

import { Axes, circle, colours, dashes, font, strokeLines, within } from './chart.js';
import { mark } from './dom.js';
import { digits, lengthUnit, niceAbove, withUnit } from './format.js';
import { TERMS } from './glossary.js';

/** Short names of special points, and the entries of the glossary that spell them out. */
const MARKS = {
  fold: ['fold', 'fold'],
  'period doubling': ['doubling', 'doubling'],
  'Neimark-Sacker': ['N.-S.', 'neimark-sacker'],
  'branch point': ['branch', 'branch-point'],
  grazing: ['grazing', 'grazing'],
};
const KINDS = ['not viable', 'unstable', 'stable'];

export class GapCurve extends Axes {
  constructor(canvas, theory, setGap) {
    super(canvas);
    this.theory = theory;
    this.gap = NaN;
    this.measured = NaN;
    this.aim = null;
    this.top = 1;
    this.plan = null;
    this.busy = false;
    this.settable = true;
    /** The best gap of the user's structure. */
    this.design = NaN;
    const pointed = (event) => {
      if (!this.plan) return null;
      const { box } = this.plan;
      const at = event.clientX - canvas.getBoundingClientRect().left;
      if (at < box.left || at > box.left + box.width) return null;
      return (this.low + ((at - box.left) / box.width) * (this.high - this.low)) || null;
    };
    canvas.addEventListener('pointermove', (event) => {
      this.aim = pointed(event);
      this.stale = true;
      this.explain(event);
    });
    canvas.addEventListener('pointerleave', () => {
      this.aim = null;
      this.stale = true;
    });
    canvas.addEventListener('click', (event) => {
      const gap = pointed(event);
      if (gap > 0 && this.settable) setGap(Number(gap.toPrecision(4)));
    });
    canvas.addEventListener('keydown', (event) => {
      const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!step || !(this.gap > 0) || !this.settable) return;
      event.preventDefault();
      setGap(Number((this.gap * 1.01 ** step).toPrecision(4)));
    });
  }

  /** Spell out the special point under the pointer. */
  explain({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect();
    const near = (this.places ?? []).find(([a, b]) => Math.hypot(a + box.left - clientX, b + box.top - clientY) < 14);
    const [name, sentence] = TERMS[MARKS[near?.[2]]?.[1]] ?? ['', ''];
    mark(this.canvas, 'title', name && `${name}: ${sentence}`);
  }

  /** Where the rig is: its gap, and how far M moves. */
  place(gap, measured) {
    if (gap === this.gap && measured === this.measured) return;
    this.gap = gap;
    this.measured = measured;
    this.stale = true;
  }

  /** Mark the best gap of a structure; NaN: none. */
  markDesign(gap) {
    this.design = gap;
    this.stale = true;
  }

  draw() {
    if (!this.begin()) return;
    const { curve } = this.theory;
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
    if (this.design > 0) [low, high] = [Math.min(low, 0.9 * this.design), Math.max(high, 1.1 * this.design)];
    if (!(high > 0)) [low, high] = [0, 1];
    if (this.measured > 0) most = Math.max(most, Math.min(this.measured, 3 * (most || this.measured)));
    const { factor, unit } = lengthUnit(high);
    // The range changes only if it has to, so that the curve stays where it was.
    const end = niceAbove(high * factor) / factor;
    const begin = low < 0.35 * end ? 0 : 0.9 * low;
    if (!(this.high >= high && this.high <= 2 * end && this.low <= low && begin - this.low < 0.2 * end) || this.unit !== unit) {
      [this.low, this.high, this.unit] = [begin, end, unit];
    }
    const top = niceAbove(1.1 * most || 1);
    if (!(this.top >= top && this.top <= 2.5 * top)) this.top = top;
    const axes = this.axes({
      x: [this.low * factor, this.high * factor],
      y: [0, this.top],
      xName: `gap d (${unit})`,
      yName: 'Xmax / A',
    });
    this.plan = axes;
    const toX = (gap) => axes.toX(gap * factor);
    const { toY, box } = axes;
    within(this.context, box, (context) => {
      const upright = (gap, stroke, alpha, dash = []) => {
        Object.assign(context, { strokeStyle: stroke, globalAlpha: alpha, lineWidth: 1 });
        context.setLineDash(dash);
        strokeLines(context, [[toX(gap), box.top], [toX(gap), box.top + box.height]]);
        context.setLineDash([]);
        context.globalAlpha = 1;
      };
      /** Beside a line, on its left or right, at the top of the frame or at its bottom. */
      const write = (text, place, fillStyle, left, textBaseline = 'top') => {
        Object.assign(context, { fillStyle, textBaseline, font: font(0.75), textAlign: left ? 'right' : 'left' });
        context.fillText(text, place + (left ? -4 : 4), textBaseline === 'top' ? box.top + 3 : box.top + box.height - 3);
      };
      if (curve?.optimum) upright(curve.optimum.gap, colours.good, 0.5, [2, 3]);
      if (this.design > 0) {
        upright(this.design, colours.good, 1, [6, 3]);
        write('my structure: best', toX(this.design), colours.good, toX(this.design) > box.left + box.width / 2);
      }
      for (const branch of branches) this.branch(context, branch, toX, toY);
      this.specials(context, curve?.special ?? [], toX, toY);
      if (this.aim !== null && this.settable) {
        upright(this.aim, colours.link, 1);
        write(`set ${digits(this.aim * factor, 3)} ${unit}`, toX(this.aim), colours.link, toX(this.aim) > box.left + box.width / 2, 'bottom');
      }
      if (this.beyond) {
        const right = this.gap > this.high;
        const text = `the rig is at ${withUnit(this.gap, 'm')}`;
        write(right ? `${text} →` : `← ${text}`, box.left + (right ? box.width : 0), colours.primary, right);
      } else if (this.gap > 0) {
        upright(this.gap, colours.primary, 0.55);
        if (Number.isFinite(this.measured)) {
          this.dot(toX(this.gap), Math.max(toY(this.measured), box.top + 2), colours.primary, 6);
        }
      }
    });
    if (!branches.length) {
      this.say(curve?.text || this.theory.failed || (curve?.done ? 'no periodic motion found' : 'computing…'), box);
    }
    const label = this.gap > 0 ? `${digits(this.gap * factor, 4)} ${unit}` : 'unknown';
    const { canvas } = this;
    canvas.setAttribute('aria-valuemin', String(this.low));
    canvas.setAttribute('aria-valuemax', String(this.high));
    canvas.setAttribute('aria-valuenow', String(this.gap || 0));
    canvas.setAttribute('aria-valuetext', `gap ${label}, Xmax over A ${digits(this.measured, 3)}`);
  }

  /** Special points as rings; the pointer names them. */
  specials(context, specials, toX, toY) {
    this.places = specials.map(({ gap, x_max_ratio: ratio, kind }) => [toX(gap), toY(ratio), kind]);
    Object.assign(context, { strokeStyle: colours.special, fillStyle: colours.page, lineWidth: 1.6 });
    for (const [a, b] of this.places) {
      circle(context, a, b, 3.6);
      context.fill();
      context.stroke();
    }
  }

  /** Stable parts solid, unstable ones dashed, those that are not viable dotted. */
  branch(context, { gap, x_max_ratio: ratio, stable, viable }, toX, toY) {
    const kind = (n) => (viable[n] ? (stable[n] ? 'stable' : 'unstable') : 'not viable');
    // Between two points of different kinds it is the lesser one.
    const piece = (n) => [kind(n), kind(n + 1)].sort((a, b) => KINDS.indexOf(a) - KINDS.indexOf(b))[0];
    let n = 0;
    while (n < gap.length - 1) {
      const shown = piece(n);
      context.strokeStyle = shown === 'stable' ? colours.theory : colours.quiet;
      context.lineWidth = shown === 'stable' ? 2 : 1.2;
      context.setLineDash(dashes({ stable: shown === 'stable', viable: shown !== 'not viable' }));
      const from = n;
      while (n < gap.length - 1 && piece(n) === shown) n += 1;
      strokeLines(context, gap.slice(from, n + 1).map((one, k) => [toX(one), toY(ratio[from + k])]));
    }
    context.setLineDash([]);
  }
}
