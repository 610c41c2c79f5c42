// SPDX-License-Identifier: Apache-2.0
// Multipliers in the complex plane: within the unit circle, a deviation dies out.

import { colours, ReadOut } from '../chart.js';
import { byId, mark } from '../dom.js';
import { digits } from '../format.js';

class Multipliers extends ReadOut {
  constructor(canvas, theory) {
    super(canvas);
    this.theory = theory;
  }

  /** A number in the plane by its modulus and angle. */
  named(re, im) {
    return `|λ| ${digits(Math.hypot(re, im), 3)}, ${digits((Math.atan2(im, re) * 180) / Math.PI, 3)}°`;
  }

  values(x, y) {
    return x >= 0 ? this.named((x - this.width / 2) / this.unit, (this.height / 2 - y) / this.unit) : '';
  }

  draw() {
    if (!this.stale || !this.begin()) return;
    const { multipliers = [] } = this.theory.orbit ?? {};
    const [cx, cy] = [this.width / 2, this.height / 2];
    const sizes = multipliers.map(([re, im]) => Math.hypot(re, im));
    const most = Math.max(1.15, ...sizes.filter(Number.isFinite).map((size) => Math.min(size * 1.1, 3)));
    const unit = this.unit = (Math.min(cx, cy) - 3) / most;
    this.lines(colours.grid, 1, [[[3, cy], [this.width - 3, cy]], [[cx, 3], [cx, this.height - 3]]]);
    this.disc(cx, cy, unit, '', colours.steel, 1.3);
    this.marks = multipliers.map(([re, im], n) => {
      const cut = Math.min(1, (0.98 * most) / sizes[n]) * unit;
      return [cx + re * cut, cy - im * cut, () => this.named(re, im)];
    });
    this.marks.forEach(([x, y], n) => this.disc(x, y, 3.6, sizes[n] < 1 ? colours.good : colours.bad));
    const largest = sizes.length ? ` on the unit circle; the largest modulus is ${digits(Math.max(...sizes), 3)}` : ': none';
    mark(this.canvas, 'aria-label', `Stability multipliers${largest}`);
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store) => new Multipliers(byId('multipliers-canvas'), store.theory);
