// SPDX-License-Identifier: Apache-2.0
// Playing a recording: scrub, speed, jumps, and what would have been with other parameters.

import { all, byId, element, write } from '../dom.js';
import { clock } from '../format.js';

export class Player {
  constructor(store, actions) {
    this.store = store;
    this.actions = actions;
    this.connection = actions.connection;
    this.on = false;
    this.start = 0;
    this.duration = 0;
    this.playing = false;
    this.speed = 1;
    this.scrubbing = false;
    const speeds = byId('speed');
    speeds.addEventListener('change', () => {
      this.speed = Number(speeds.value);
      if (this.playing) this.play(true);
    });
    byId('play').addEventListener('click', () => this.play(!this.playing));
    const scrub = byId('scrub');
    for (const kind of ['input', 'change']) {
      scrub.addEventListener(kind, () => {
        this.scrubbing = kind === 'input';
        write(byId('played'), this.progress(Number(scrub.value)));
        this.seek(Number(scrub.value));
      });
    }
    for (const button of all('.jump button')) button.addEventListener('click', () => this.jump(button.dataset.jump, Number(button.value)));
  }

  /** Begin with a recording, or end with none. */
  begin({ mode, start = 0, duration = 0, changes = [] }) {
    this.on = mode === 'player';
    if (!this.on) return;
    Object.assign(this, { start, duration });
    Object.assign(byId('scrub'), { min: start, max: start + duration, value: start });
    byId('marks').replaceChildren(...changes.map(({ time }) => element('option', { value: time })));
  }

  progress(time) {
    return `${clock(time - this.start)} of ${clock(this.duration)}`;
  }

  play(on) {
    this.playing = on;
    this.connection.send({ type: 'play', speed: on ? this.speed : 0 });
    write(byId('play'), on ? 'Pause' : 'Play');
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
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const player = new Player(store, actions);
  const { opened, address } = store;
  byId('back-live').addEventListener('click', () => actions.join({}));
  store.on('hello', () => player.begin(store.hello));
  store.on('status', (status) => player.status(status));
  store.on('frame', () => player.show(store.history.end));
  // Where the connection is lost it goes on, as where an address has it.
  actions.connection.on('lost', () => {
    if (player.on) Object.assign(opened, { bag: address.bag, time: store.history.end, playing: player.playing });
  });
  // Once the server listens
  store.on('joined', () => {
    if (store.isLive) return;
    if (opened.time && opened.bag === address.bag) {
      player.play(opened.playing ?? true);
      player.seek(opened.time);
    }
    opened.time = NaN;
    if (Object.keys(address.values).length) actions.turn(address.values);
  });
  return player;
};
