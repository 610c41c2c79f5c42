// The last impacts at 1/20 of their speed, while the rig runs on.

import { byId } from './dom.js';
import { RigDrawing } from './rig_drawing.js';

const SLOWER = 20;
const IMPACTS = 5;
const PAUSE = 700;

export class SlowMotion {
  constructor(connection) {
    this.connection = connection;
    this.drawing = new RigDrawing(byId('slow-canvas'));
    this.stage = byId('slow-stage');
    this.on = false;
    this.clear();
  }

  clear() {
    this.film = null;
    this.asked = 0;
    this.ended = 0;
    this.drawing.clear();
  }

  switch(on) {
    this.on = on;
    this.stage.hidden = !on;
    byId('rig').classList.toggle('split', on);
    this.clear();
  }

  take(film) {
    if (!this.on || film.t.length < 2) return;
    this.film = film;
    this.begun = performance.now();
    this.at = 0;
    this.hit = 0;
    this.ended = 0;
  }

  draw(now, state, options) {
    if (!this.on || !state) return;
    if (!this.film || (this.ended && now - this.ended > PAUSE)) {
      if (now - this.asked > 1000) {
        this.asked = now;
        this.connection.send({ type: 'slow_motion', impacts: IMPACTS });
      }
    }
    const { film } = this;
    if (!film) {
      this.drawing.begin();
      return;
    }
    const last = film.t.at(-1);
    const time = Math.min(last, film.t[0] + (now - this.begun) / 1000 / this.pace());
    while (this.at < film.t.length - 2 && film.t[this.at + 1] < time) this.at += 1;
    const n = this.at;
    const part = Math.min(1, Math.max(0, (time - film.t[n]) / (film.t[n + 1] - film.t[n] || 1)));
    const mixed = (values) => (values?.[n] === null || values?.[n] === undefined ? NaN : values[n] + part * (values[n + 1] - values[n]));
    while (this.hit < film.impacts.length && film.impacts[this.hit].t <= time) {
      this.drawing.flash(film.impacts[this.hit].stop, film.impacts[this.hit].impulse, now);
      this.hit += 1;
    }
    const shown = Float32Array.from(state);
    [shown[0], shown[2], shown[4], shown[6]] = [mixed(film.x), mixed(film.z), mixed(film.stop_1), mixed(film.stop_2)];
    shown[9] = NaN;
    this.drawing.draw(shown, { ...options, ghost: null, driven: false, now });
    if (time >= last && !this.ended) this.ended = now;
  }

  /** A rig much slower than a bench rig is slow enough as it is: no film is longer than a minute. */
  pace() {
    const span = this.film.t.at(-1) - this.film.t[0];
    return Math.max(0.05, Math.min(SLOWER, 60 / span));
  }
}
