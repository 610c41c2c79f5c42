// SPDX-License-Identifier: Apache-2.0
// The menu of the presets: a small picture of each rig, its title and what it shows.

import { all, byId, copyOf, mark, write } from '../dom.js';

/** Return the entry of a preset: a rig in a few lines, how it is inclined, how heavy m is, and what its stops do. */
function entryOf({ name, title, description, values }, load) {
  const entry = copyOf('preset-entry');
  const at = (selector) => entry.querySelector(selector);
  const slug = 5 + 14 * Math.min(1, Math.sqrt(values.damper_mass / values.primary_mass));
  at('g').setAttribute('transform', `rotate(${((values.angle * 180) / Math.PI).toFixed(1)})`);
  for (const [key, value] of Object.entries({ x: 8 - slug / 2, y: 8 - slug, width: slug, height: slug })) at('.damper').setAttribute(key, String(value));
  if (values.one_sided) at('.upper').remove();
  if (values.gap_control === 'off') at('.moves').remove();
  if (!(values.friction > 0.1)) at('.rough').remove();
  [at('strong').textContent, at('.quiet').textContent] = [title, description];
  const button = at('button');
  button.dataset.name = name;
  button.addEventListener('click', () => load(name));
  return entry;
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  store.on('hello', () => root.querySelector('ul').replaceChildren(...store.hello.presets.map((one) => entryOf(one, (name) => actions.loadPreset(name)))));
  store.on('hello preset', () => {
    const { preset } = store.address;
    const title = store.design ? 'My structure' : store.hello.presets.find((one) => one.name === preset)?.title ?? '';
    write(byId('preset-name'), store.isLive ? title : 'as a ghost');
    for (const button of all('button', root.querySelector('ul'))) mark(button, 'aria-current', String(button.dataset.name === preset));
  });
};
