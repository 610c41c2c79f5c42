// SPDX-License-Identifier: Apache-2.0
// The last impacts at 1/20 of their speed, while the rig runs on.

import { byId } from './dom.js';
import { RigDrawing } from './rig_drawing.js';

const SLOWER = 20;
const IMPACTS = 5;
/** Time between two films, and the longest one, ms. */
const PAUSE = 700;
const LONGEST = 60000;

export class SlowMotion {
  constructor(history) {
    this.history = history;
    this.drawing = new RigDrawing(byId('slow-canvas'));
    this.stage = byId('slow-stage');
    this.clear();
  }

  clear() {
    this.film = null;
    this.drawing.clear();
  }

  switch(on) {
    this.stage.hidden = !on;
    byId('rig').classList.toggle('split', on);
    this.clear();
  }

  /** Return the film of the last impacts, with a little of what is before and after them. */
  cut(now) {
    const { impacts, samples } = this.history.own;
    const last = impacts.after(this.history.end) - 1;
    const first = Math.max(impacts.start, last - IMPACTS + 1);
    if (last < first) return null;
    const [begin, end] = [first, last].map((n) => impacts.arrays[0][n]);
    const pause = 0.3 * Math.max((end - begin) / Math.max(1, last - first), 1e-3);
    const from = Math.max(begin - pause, samples.arrays[0][samples.start]);
    const to = Math.min(end + pause, this.history.end);
    const takes = Math.min(1000 * SLOWER * (to - from), LONGEST);
    return { from, to, begun: now, takes, shown: from };
  }

  draw(now, options) {
    if (this.stage.hidden) return;
    if (!this.film || now > this.film.begun + this.film.takes + PAUSE) this.film = this.cut(now);
    const { film } = this;
    const { own } = this.history;
    const part = film && Math.min(1, (now - film.begun) / film.takes);
    const time = film && film.from + part * (film.to - film.from);
    const state = film && own.at(time);
    if (!state) {
      this.drawing.begin();
      return;
    }
    this.drawing.flash(own.impacts, film.shown, time, now);
    film.shown = time;
    this.drawing.draw(state, { ...options, now });
  }
}
