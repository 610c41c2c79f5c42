// SPDX-License-Identifier: Apache-2.0
// A picture as SVG: what is drawn is there, within its clips, and texts are no markup.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { SvgContext } from '../../../impact_damper_ros/page/static/svg.js';

test('paths, clips and texts', () => {
  const context = new SvgContext(100, 50, { measureText: (text) => ({ width: 6 * text.length }) });
  context.save();
  context.beginPath();
  context.rect(1, 2, 30, 20);
  context.clip();
  Object.assign(context, { strokeStyle: '#0072b2', lineWidth: 2, globalAlpha: 0.5 });
  context.setLineDash([5, 4]);
  context.beginPath();
  context.moveTo(0, 0);
  context.lineTo(10.126, 5);
  context.stroke();
  context.restore();
  Object.assign(context, { font: 'italic 600 14px serif', textAlign: 'right', textBaseline: 'top' });
  context.fillText('Xmax / A <b>', 5, 6);
  assert.equal(context.measureText('abc').width, 18);
  assert.equal(context.text(), '<svg xmlns="http://www.w3.org/2000/svg" width="100" height="50" viewBox="0 0 100 50">'
    + '<clipPath id="c1"><path d="M1 2h30v20h-30z"/></clipPath><g clip-path="url(#c1)">'
    + '<path d="M0 0L10.13 5" fill="none" stroke="#0072b2" stroke-width="2" stroke-linejoin="miter" opacity="0.5" stroke-dasharray="5 4"/></g>'
    + '<text x="5" y="6" font-family="serif" font-size="14" font-style="italic" font-weight="600" text-anchor="end" dominant-baseline="text-before-edge" opacity="1" fill="#000">Xmax / A &#60;b&#62;</text></svg>');
});

test('the shapes of the rig', () => {
  const context = new SvgContext(100, 50, { measureText: () => ({ width: 0 }) });
  context.save();
  context.translate(10, 5);
  context.rotate(Math.PI / 6);
  context.beginPath();
  context.roundRect(0, 0, 20, 10, 2);
  context.fill('evenodd');
  context.restore();
  context.beginPath();
  context.arc(5, 5, 2, 0, Math.PI / 2);
  context.stroke();
  assert.equal(context.parts.join(''), '<g transform="translate(10 5)"><g transform="rotate(30)">'
    + '<path d="M2 0h16a2 2 0 0 1 2 2v6a2 2 0 0 1 -2 2h-16a2 2 0 0 1 -2 -2v-6a2 2 0 0 1 2 -2z" fill="#000" fill-rule="evenodd" opacity="1"/></g></g>'
    + '<path d="M7 5A2 2 0 0 1 5 7" fill="none" stroke="#000" stroke-width="1" stroke-linejoin="miter" opacity="1"/>');
});

for (const [font, size, weight] of [[' 12px serif', '12', undefined], ['600 9px serif', '9', '600'], ['italic 600 14px serif', '14', '600']]) {
  test(`a text in ${font.trim()}`, () => {
    const context = new SvgContext(100, 50, { measureText: () => ({ width: 0 }) });
    context.font = font;
    context.fillText('a', 0, 0);
    const found = (name) => new RegExp(`${name}="(.*?)"`).exec(context.parts[0])?.[1];
    assert.deepEqual([found('font-size'), found('font-weight')], [size, weight]);
  });
}
