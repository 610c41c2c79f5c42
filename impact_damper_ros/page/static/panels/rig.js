// SPDX-License-Identifier: Apache-2.0
// The rig in side view, in slow motion beside it, and dragged by hand.

import { byId, mark, viewSwitch, write } from '../dom.js';
import { Drag } from '../drag.js';
import { digits, withUnit } from '../format.js';
import { RigDrawing } from '../rig_drawing.js';
import { push, rigInWords } from '../words.js';

/** Time between two descriptions of the rig for a screen reader, ms. */
const SPOKEN = 2000;
/** How much slower slow motion is, and how many impacts it shows. */
const SLOWER = 20;
const IMPACTS = 5;
/** Time between two films, and the longest one, ms. */
const PAUSE = 700;
const LONGEST = 60000;

/** The last impacts at 1/20 of their speed, while the rig runs on. */
class SlowMotion {
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

class RigPanel {
  constructor(store) {
    this.store = store;
    this.rig = new RigDrawing(byId('rig-canvas'));
    this.slow = new SlowMotion(store.history);
    this.spoken = 0;
    /** Up to when impacts have lit up the stops. */
    this.lit = Infinity;
  }

  get pictures() {
    return [this.rig, this.slow.drawing];
  }

  clear() {
    this.rig.clear();
    this.slow.clear();
  }

  rescale() {
    for (const picture of this.pictures) picture.rescale();
  }

  draw(now, anew) {
    const { history, values } = this.store;
    if (anew) this.rig.flash(history.impacts, this.lit, history.end, now);
    this.lit = history.end;
    const { state, ghost } = history;
    if (!state) {
      if (this.rig.stale) this.rig.begin();
      return;
    }
    const { damper_mass: m, primary_mass: M } = values;
    const options = { extent: history.reach(history.end - 4), oneSided: !Number.isFinite(state.stop_2), massRatio: m / M };
    if (anew || this.rig.stale || this.rig.flashes.length) this.rig.draw(state, { ...options, ghost, push: push(values, state.phase), now });
    this.slow.draw(now, options);
    if (now - this.spoken < SPOKEN) return;
    // For a screen reader
    this.spoken = now;
    const { x, angle } = state;
    mark(this.rig.canvas, 'aria-label', `The rig: M at ${withUnit(x, 'm')}, inclined by ${digits((angle * 180) / Math.PI, 3)} degrees, ${history.impacts.length} impacts in view`);
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions, { knobs }) => {
  const panel = new RigPanel(store);
  const { history } = store;
  const drag = new Drag(panel.rig, () => history.state, {
    hold: (name) => store.grab(name),
    gap: (value) => knobs.turn('gap', value),
    release: (place) => actions.release(place),
  });
  const showFrom = viewSwitch(store, 'relative', (on) => {
    history.countFrom(on && !byId('relative-switch').hidden);
    store.emit('rescale', { time: NaN });
  });
  store.on('hello', () => {
    panel.clear();
    drag.on = store.steers;
  });
  store.on('status', () => { panel.rig.stale = true; });
  store.on('values', () => {
    const { values } = store;
    // With a margin between the two, so that a knob that is dragged does not turn it to and fro
    const steep = document.body.classList.contains('steep') ? 0.6 : 0.8;
    document.body.classList.toggle('steep', Math.abs(values.angle) > steep);
    write(byId('rig-line'), rigInWords(values));
    panel.rig.stale = true;
    const still = !(values.base_amplitudes ?? []).some((one) => one !== 0);
    if (byId('relative-switch').hidden === still) return;
    byId('relative-switch').hidden = still;
    showFrom();
  });
  viewSwitch(store, 'slow', (on) => panel.slow.switch(on))();
  return panel;
};
