// SPDX-License-Identifier: Apache-2.0
// The rig in side view, in slow motion beside it, and dragged by hand.

import { byId, mark, viewSwitch, write } from '../dom.js';
import { Drag } from '../drag.js';
import { digits, withUnit } from '../format.js';
import { RigDrawing } from '../rig_drawing.js';
import { SlowMotion } from '../slow_motion.js';
import { push, rigInWords } from '../words.js';

/** Time between two descriptions of the rig for a screen reader, ms. */
const SPOKEN = 2000;

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
    if (anew || this.rig.stale || this.rig.flashing) this.rig.draw(state, { ...options, ghost, push: push(values, state.phase), now });
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
