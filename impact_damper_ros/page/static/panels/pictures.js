// SPDX-License-Identifier: Apache-2.0
// Plots as files for a slide: PNG in double size, or SVG, with their units and the values of the rig.

import { colours, font } from '../chart.js';
import { byId, element } from '../dom.js';
import { SvgContext } from '../svg.js';
import { rigInWords } from '../words.js';

/** Room for the title and for the values of the rig, px. */
const [ABOVE, BELOW] = [30, 26];
const SCALE = 2;

/** Draw the title, and what rig it is, around a plot of a size. */
function frame(context, { width, height }, title, rig) {
  Object.assign(context, { fillStyle: colours.page, globalAlpha: 1 });
  context.fillRect(0, 0, width, height + ABOVE + BELOW);
  Object.assign(context, { fillStyle: colours.ink, font: font(0.95, '600'), textAlign: 'left', textBaseline: 'alphabetic' });
  context.fillText(title, 8, 20);
  Object.assign(context, { fillStyle: colours.quiet, font: font(0.78) });
  context.fillText(rig, 8, height + ABOVE + 17);
}

/** Draw a plot by its own commands, or those of its panel, on another context. */
function drawOn(plot, context, panel) {
  const { context: own } = plot;
  Object.assign(plot, { context, stale: true });
  panel.draw(performance.now(), true);
  Object.assign(plot, { context: own, stale: true });
}

function save(content, name) {
  const address = URL.createObjectURL(content);
  element('a', { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, _actions, plots) => {
  /** Save a plot as a file of a kind. */
  const write = (title, name, plot, kind, panel = plot) => {
    // A small one has room for what rig it is.
    const [width, height] = [Math.max(280, plot.width), plot.height];
    const rig = rigInWords(store.values);
    const canvas = document.createElement('canvas');
    Object.assign(canvas, { width: SCALE * width, height: SCALE * (height + ABOVE + BELOW) });
    const context = canvas.getContext('2d');
    if (kind === 'svg') {
      const [around, inner] = [new SvgContext(width, height + ABOVE + BELOW, context), new SvgContext(plot.width, height, context)];
      frame(around, { width, height }, title, rig);
      drawOn(plot, inner, panel);
      around.parts.push(`<svg y="${ABOVE}" width="${plot.width}" height="${height}">${inner.parts.join('')}</svg>`);
      save(new Blob([around.text()], { type: 'image/svg+xml' }), `${name}.svg`);
      return;
    }
    context.scale(SCALE, SCALE);
    frame(context, { width, height }, title, rig);
    context.drawImage(plot.canvas, 0, ABOVE, plot.width, height);
    canvas.toBlob((content) => save(content, `${name}.png`));
  };
  const row = ([name, [title, plot, panel]]) => element(
    'li', {}, element('span', { text: title }),
    ...['png', 'svg'].map((kind) => element('button', { type: 'button', text: kind.toUpperCase(), 'aria-label': `${title} as ${kind.toUpperCase()}`, 'data-picture': `${name}.${kind}`, onclick: () => write(title, name, plot, kind, panel) })),
  );
  byId('pictures').querySelector('ul').append(...Object.entries(plots).map(row));
};
