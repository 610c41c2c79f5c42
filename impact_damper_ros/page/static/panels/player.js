// SPDX-License-Identifier: Apache-2.0
// Playing a recording: scrub, speed, jumps, and what would have been with other parameters.

import { all, byId, element, mark, write } from '../dom.js';
import { clock } from '../format.js';

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const { connection } = actions;
  const { address } = store;
  /** Where a recording begins, if not at its start. */
  let begin = store.opened;
  const [scrub, speed] = ['scrub', 'speed'].map(byId);
  const isPlaying = () => store.status === 'running';
  const play = (on) => connection.send({ type: 'play', speed: on ? Number(speed.value) : 0 });
  const seek = (time) => connection.send({ type: 'seek', time });
  const jump = (to, direction) => connection.send({ type: 'jump', to, direction });
  const toggle = () => play(!isPlaying());
  const say = (time) => {
    const text = `${clock(time - store.hello.start)} of ${clock(store.hello.duration)}`;
    write(byId('played'), text);
    mark(scrub, 'aria-valuetext', text);
  };
  /** Show how far it has come, unless somebody holds the slider. */
  const show = (time) => {
    if (store.isLive || !Number.isFinite(time) || scrub.matches(':active')) return;
    scrub.value = String(time);
    say(time);
  };

  scrub.addEventListener('input', () => {
    say(Number(scrub.value));
    seek(Number(scrub.value));
  });
  scrub.addEventListener('change', () => seek(Number(scrub.value)));
  speed.addEventListener('change', () => { if (isPlaying()) play(true); });
  byId('play').addEventListener('click', toggle);
  for (const button of all('.jump button')) button.addEventListener('click', () => jump(button.dataset.jump, Number(button.value)));
  byId('back-live').addEventListener('click', () => actions.join({}));
  store.on('hello', () => {
    const { start = 0, duration = 0, changes = [] } = store.hello;
    Object.assign(scrub, { min: start, max: start + duration, value: start });
    byId('marks').replaceChildren(...changes.map(({ time }) => element('option', { value: time })));
  });
  store.on('status', ({ time }) => {
    write(byId('play'), isPlaying() ? 'Pause' : 'Play');
    if (store.status === 'ended') show(time);
  });
  store.on('drawn', () => show(store.history.end));
  // Where the connection is lost it goes on, as where an address has it.
  connection.on('lost', () => {
    if (!store.isLive && store.status !== 'offline') begin = { bag: address.bag, time: store.history.end, playing: isPlaying() };
  });
  // Once the server listens
  store.on('joined', () => {
    if (store.isLive) return;
    if (begin.time && begin.bag === address.bag) {
      play(begin.playing ?? true);
      seek(begin.time);
    }
    begin = {};
    if (Object.keys(address.values).length) actions.turn(address.values);
  });
  return { toggle, jump };
};
