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
