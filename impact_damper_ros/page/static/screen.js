// SPDX-License-Identifier: Apache-2.0
// All pictures, drawn once for each frame of the screen, and only where something has changed.

import { readColours } from './chart.js';

/** @import { Store } from './store.js' */

/**
 * Puts a panel into its element, and shows there what the store has; `others` are panels that it works with.
 * @typedef {(root: any, store: Store, actions?: import('./actions.js').Actions, others?: any) => any} Mount
 * What a panel that draws has: draw(now, anew), rescale() if it has scales, and `stale`, or pictures that have it.
 * @typedef {{ draw: (now: number, anew: boolean) => void, rescale?: () => void, stale?: boolean, pictures?: { stale?: boolean }[] }} Drawn
 */

export class Screen {
  constructor(/** @type {Store} */ store, /** @type {Drawn[]} */ panels) {
    this.store = store;
    this.panels = panels;
    this.version = -1;
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.recolour());
    // The size of letters may be another one.
    addEventListener('resize', () => this.recolour());
    store.on('rescale', ({ time }) => this.rescale(time));
    store.on('change', ({ another, time }) => { if (another) this.rescale(time); });
    store.on('theory', () => this.redraw());
  }

  /** Colours and sizes of letters are other ones. */
  recolour() {
    readColours();
    this.redraw();
  }

  /** Choose all scales anew, from what moves since an instant. */
  rescale(time = NaN) {
    if (Number.isFinite(time)) this.store.history.begun = time;
    for (const panel of this.panels) panel.rescale?.();
    this.redraw();
  }

  /** Draw everything anew though nothing moves. */
  redraw() {
    this.version = -1;
    for (const picture of this.panels.flatMap((panel) => panel.pictures ?? [panel])) picture.stale = true;
  }

  begin() {
    // Large letters may have come since the first look.
    this.recolour();
    const draw = (now) => {
      requestAnimationFrame(draw);
      const { version } = this.store.history;
      const anew = version !== this.version;
      this.version = version;
      for (const panel of this.panels) panel.draw(now, anew);
      if (anew) this.store.emit('drawn');
    };
    requestAnimationFrame(draw);
  }
}
