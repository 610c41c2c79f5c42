// SPDX-License-Identifier: Apache-2.0
// The menu of the presets: a small picture of each rig, its title and what it shows.

import { all, byId, element, mark, write } from '../dom.js';

const SVG = 'http://www.w3.org/2000/svg';

/** Return an element of a picture. */
function shape(tag, attributes, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}

/** A rig in a few lines: how it is inclined, how heavy m is, its stops and whether they move. */
function sketch(values) {
  const slug = 5 + 14 * Math.min(1, Math.sqrt(values.damper_mass / values.primary_mass));
  const [left, right] = [-10, 30];
  const stop = (place, kind) => shape('path', { d: `M${place} -7V7`, class: kind });
  const moving = values.gap_control !== 'off';
  const arrow = (from, to) => shape('path', { d: `M${from} 13H${to}m${from > to ? 3 : -3} -3l${from > to ? -3 : 3} 3l${from > to ? 3 : -3} 3`, class: 'moves' });
  const degrees = (values.angle * 180) / Math.PI;
  return shape(
    'svg',
    { viewBox: '-36 -36 72 72', 'aria-hidden': 'true', class: 'sketch' },
    shape(
      'g',
      { transform: `rotate(${degrees.toFixed(1)})` },
      shape('path', { d: 'M-34 -9V9M-34 0h3l2 -5l4 10l4 -10l4 10l2 -5h5', class: 'spring' }),
      shape('rect', { x: left, y: -10, width: right - left, height: 20, rx: 2, class: 'primary' }),
      shape('rect', { x: 8 - slug / 2, y: 8 - slug, width: slug, height: slug, rx: 1, class: 'damper' }),
      stop(right - 4, 'lower'),
      ...(values.one_sided ? [] : [stop(left + 4, 'upper')]),
      ...(moving ? [arrow(right - 2, right - 12), arrow(left + 2, left + 12)] : []),
      ...(values.friction > 0.1 ? [shape('path', { d: `M${left + 3} 10H${right - 3}`, class: 'rough' })] : []),
    ),
  );
}

/** Make the menu; `load` takes the name of the preset that is chosen. */
function makePresets(presets, load) {
  byId('presets').querySelector('ul').replaceChildren(...presets.map((one) => element('li', {}, element(
    'button',
    { type: 'button', 'data-name': one.name, onclick: () => {
      byId('presets').hidePopover();
      load(one.name);
    } },
    sketch(one.values),
    element('span', {}, element('strong', { text: one.title }), element('span', { class: 'quiet', text: one.description })),
  ))));
}

/** Mark the preset that the rig has. */
function markPreset(name) {
  for (const button of all('#presets button')) {
    mark(button, 'aria-current', String(button.dataset.name === name));
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  store.on('hello', () => makePresets(store.hello.presets, (name) => actions.loadPreset(name)));
  store.on('hello preset', () => {
    const { preset } = store.address;
    const title = store.design ? 'My structure' : store.hello.presets.find((one) => one.name === preset)?.title ?? '';
    write(byId('preset-name'), store.isLive ? title : 'as a ghost');
    markPreset(preset);
  });
};
