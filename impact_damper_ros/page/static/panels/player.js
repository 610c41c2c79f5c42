// SPDX-License-Identifier: Apache-2.0
// Playing a recording: scrub, speed, jumps, and what would have been with other parameters.

import { all, byId, write } from '../dom.js';
import { clock } from '../format.js';
import { Canvas, colours } from '../chart.js';

export class Player {
  constructor(store, actions) {
    this.store = store;
    this.actions = actions;
    this.connection = actions.connection;
    this.on = false;
    this.start = 0;
    this.duration = 0;
    /** @type {import('../messages.js').Change[]} */
    this.changes = [];
    this.playing = false;
    this.speed = 1;
    this.scrubbing = false;
    /** Where a recording stood when the connection was lost; null if it was not. */
    this.left = null;
    const speeds = byId('speed');
    speeds.addEventListener('change', () => {
      this.speed = Number(speeds.value);
      if (this.playing) this.play(true);
    });
    byId('play').addEventListener('click', () => this.play(!this.playing));
    const scrub = byId('scrub');
    let due = 0;
    scrub.addEventListener('input', () => {
      this.scrubbing = true;
      write(byId('played'), this.progress(Number(scrub.value)));
      clearTimeout(due);
      due = setTimeout(() => this.seek(Number(scrub.value)), 60);
    });
    scrub.addEventListener('change', () => {
      clearTimeout(due);
      this.seek(Number(scrub.value));
      this.scrubbing = false;
    });
    for (const button of all('.jump button')) button.addEventListener('click', () => this.jump(button.dataset.jump, Number(button.value)));
    this.canvas = new Canvas(byId('marks'));
  }

  /** Begin with a recording, or end with none. */
  begin({ mode, start = 0, duration = 0, changes = [] }) {
    this.on = mode === 'player';
    byId('player').hidden = !this.on;
    document.body.classList.toggle('playing', this.on);
    if (!this.on) return;
    [this.start, this.duration, this.changes] = [start, duration, changes];
    const scrub = byId('scrub');
    scrub.min = String(start);
    scrub.max = String(start + duration);
    scrub.value = String(start);
    this.marks();
  }

  progress(time) {
    return `${clock(time - this.start)} of ${clock(this.duration)}`;
  }

  play(on) {
    this.playing = on;
    this.connection.send({ type: 'play', speed: on ? this.speed : 0 });
    write(byId('play'), on ? 'Pause' : 'Play');
  }

  /** Keep where a recording stands as the connection is lost. */
  leave(bag, time) {
    if (this.on) this.left ??= { bag, time, playing: this.playing };
  }

  /** Go on where the connection was lost, if it was with this recording. */
  goOn(bag) {
    const { left } = this;
    this.left = null;
    if (left?.bag !== bag) return;
    this.play(left.playing);
    this.seek(left.time);
  }

  seek(time) {
    this.connection.send({ type: 'seek', time });
  }

  jump(to, direction) {
    this.connection.send({ type: 'jump', to, direction });
  }

  status({ time }) {
    if (!this.on) return;
    const { status } = this.store;
    this.playing = status === 'running';
    if (status === 'ended') this.show(time);
    write(byId('play'), this.playing ? 'Pause' : 'Play');
  }

  /** Show how far it has come. */
  show(time) {
    if (!this.on || this.scrubbing || !Number.isFinite(time)) return;
    byId('scrub').value = String(time);
    const text = this.progress(time);
    write(byId('played'), text);
    byId('scrub').setAttribute('aria-valuetext', text);
  }

  get pictures() {
    return [this.canvas];
  }

  draw(now, anew) {
    if (anew) this.show(this.store.history.end);
    if (this.canvas.stale) this.marks();
  }

  /** Marks of changes and resets under the slider. */
  marks() {
    const { context, width, height } = this.canvas;
    if (!this.canvas.begin() || !this.on) return;
    // The thumb of a slider never goes beyond its ends by half.
    const inset = 8;
    for (const { time, kind } of this.changes) {
      const place = inset + ((time - this.start) / (this.duration || 1)) * (width - 2 * inset);
      context.fillStyle = kind === 'change' ? colours.special : colours.quiet;
      context.fillRect(place - 1, 0, 2, height);
    }
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const player = new Player(store, actions);
  const { opened, address } = store;
  byId('back-live').addEventListener('click', () => actions.join({}));
  store.on('hello', () => {
    byId('back-live').hidden = !store.hello.ros;
    player.begin(store.hello);
  });
  store.on('status', (status) => player.status(status));
  actions.connection.on('lost', () => player.leave(address.bag, store.history.end));
  // Once the server listens
  store.on('joined', () => {
    if (store.isLive) return;
    if (opened.time && opened.bag === address.bag) player.seek(opened.time);
    opened.time = NaN;
    player.goOn(address.bag);
    if (Object.keys(address.values).length) actions.turn(address.values);
  });
  return player;
};
