// SPDX-License-Identifier: Apache-2.0
// All pictures, drawn once for each frame of the screen, and only where something has changed.

import { readColours } from './chart.js';
import { byId, mark, write } from './dom.js';
import { clock, digits, withUnit } from './format.js';
import { GapCurve } from './gap_curve.js';
import { ImpactMap, Multipliers, PhasePortrait } from './portraits.js';
import { RigDrawing } from './rig_drawing.js';
import { SlowMotion } from './slow_motion.js';
import { history, state, theory } from './state.js';
import { Traces } from './traces.js';

/** Time between two descriptions of the rig for a screen reader, ms. */
const SPOKEN = 2000;
const MOST_TIMES = 600;

export class Drawing {
  /** `setGap` is called with the gap that the curve was pressed at, `player` shows how far it has come. */
  constructor({ setGap, player }) {
    readColours();
    this.player = player;
    this.rig = new RigDrawing(byId('rig-canvas'));
    this.slow = new SlowMotion(history);
    this.traces = new Traces(history, theory);
    this.portrait = new PhasePortrait(byId('portrait-canvas'), history, theory);
    this.map = new ImpactMap(byId('map-canvas'), history, theory);
    this.multipliers = new Multipliers(byId('multipliers-canvas'));
    this.curve = new GapCurve(byId('curve-canvas'), theory, setGap);
    /** Measurements: pictures drawn so far, and how long each took, ms. */
    this.drawn = 0;
    this.times = [];
    this.version = this.impacts = -1;
    this.spoken = 0;
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.recolour());
    let size = 0;
    addEventListener('resize', () => {
      const now = parseFloat(getComputedStyle(document.documentElement).fontSize);
      if (now !== size) this.recolour();
      size = now;
    });
  }

  begin() {
    requestAnimationFrame((now) => this.draw(now));
  }

  /** Begin with another rig or recording. */
  clear() {
    this.rig.clear();
    this.slow.clear();
    this.multipliers.stale = this.curve.stale = true;
  }

  /** Colours and sizes of letters are other ones. */
  recolour() {
    readColours();
    this.traces.make();
    for (const picture of [this.rig, this.portrait, this.map, this.multipliers, this.curve, this.slow.drawing]) picture.stale = true;
    this.player.marks();
  }

  /** Choose all scales anew, from what moves since an instant. */
  rescale(time) {
    if (Number.isFinite(time)) history.begun = time;
    for (const picture of [this.rig, this.slow.drawing, this.traces, this.portrait, this.map]) picture.rescale();
  }

  /** Draw the motion anew though nothing moves: theory is another one. */
  redraw() {
    this.version = -1;
    this.map.stale = this.curve.stale = this.multipliers.stale = true;
  }

  showTheory(on) {
    for (const picture of [this.traces, this.portrait, this.map]) picture.showTheory = on;
    this.redraw();
  }

  draw(now) {
    requestAnimationFrame((next) => this.draw(next));
    const begun = performance.now();
    const anew = history.version !== this.version;
    this.drawRig(now, anew);
    if (anew) {
      this.traces.draw();
      write(byId('clock'), Number.isFinite(history.end) ? clock(history.end, state.status === 'paused') : '');
      this.player.show(history.end);
      this.version = history.version;
      this.drawn += 1;
    }
    if (anew || this.portrait.stale) this.portrait.draw(now);
    if (this.player.canvas.stale) this.player.marks();
    if (history.impacts.end !== this.impacts || this.map.stale) {
      this.map.draw(now);
      this.impacts = history.impacts.end;
    }
    if (this.curve.stale) this.curve.draw();
    if (this.multipliers.stale) this.multipliers.draw(theory.orbit?.multipliers);
    if (now - this.spoken > SPOKEN && history.state) this.describe(now);
    if (anew) {
      this.times.push(performance.now() - begun);
      if (this.times.length > MOST_TIMES) this.times.shift();
    }
  }

  drawRig(now, anew) {
    const { force_amplitudes: forces, damper_mass: m, primary_mass: M } = state.values;
    if ((anew || this.rig.stale || this.rig.flashing) && history.state) {
      const options = { extent: history.reach(history.end - 4), oneSided: !Number.isFinite(history.state.stop_2), massRatio: m / M };
      this.rig.draw(history.state, { ...options, ghost: history.ghost, driven: (forces?.[0] ?? 1) !== 0, now });
      this.slow.options = options;
    } else if (!history.state && this.rig.stale) this.rig.begin();
    this.slow.draw(now, this.slow.options);
  }

  /** Describe the rig to a screen reader. */
  describe(now) {
    this.spoken = now;
    const { x, angle } = history.state;
    mark(byId('rig-canvas'), 'aria-label', `The rig: M at ${withUnit(x, 'm')}, inclined by ${digits((angle * 180) / Math.PI, 3)} degrees, ${history.impacts.length} impacts in view`);
  }
}
