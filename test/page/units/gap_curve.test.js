// SPDX-License-Identifier: Apache-2.0
// The curve over the gap: its scale, what a click sets, what the pointer reads, its special points and its kinds of lines.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { colours } from '../../../impact_damper_ros/page/static/chart.js';
import { GapCurve } from '../../../impact_damper_ros/page/static/panels/gap_curve.js';
import { SvgContext } from '../../../impact_damper_ros/page/static/svg.js';

Object.assign(colours, { size: 16, theory: 'black', quiet: 'grey', primary: 'blue', special: 'pink', page: 'white' });

const BRANCHES = [
  { gap: [0.01, 0.02, 0.03, 0.04], x_max_ratio: [0.4, 0.2, 0.1, 0.3], stable: [false, true, true, false], viable: [true, true, true, true] },
  { gap: [0.04, 0.02, 0.01], x_max_ratio: [0.9, 0.8, 0.7], stable: [false, false, false], viable: [false, false, false] },
];
const SPECIAL = [{ kind: 'end', gap: 0.035, x_max_ratio: 0.2 }, { kind: 'corner', gap: 0.015, x_max_ratio: 0.3 }];

/** A curve of a rig, drawn. */
function drawn(values = {}) {
  const theory = { curve: { branches: BRANCHES, special: SPECIAL, optimum: null, text: '', gap: 0.024, x_max_ratio: 0.15 }, failed: '' };
  const store = { values: { gap: 0.024, ...values }, numbers: { x_max_ratio: 0.16 }, design: null, steers: true, theory };
  const curve = Object.assign(Object.create(GapCurve.prototype), {
    store, canvas: { getAttribute: () => null, setAttribute() {} }, context: new SvgContext(400, 300, { measureText: (text) => ({ width: 7 * text.length }) }),
    line: { textContent: '' }, note: { textContent: '' }, width: 400, height: 300, ratio: 1, stale: true, visited: -1, low: 0, high: 1, top: 1, unit: '', pointer: null, marks: [],
  });
  curve.draw();
  return curve;
}

test('the scale has the curve and the rig, and stays while the rig moves a little', () => {
  const curve = drawn();
  const { low, high } = curve;
  assert.ok(low <= 0.01 && high >= 0.04 && high < 0.06);
  curve.store.values.gap = 0.03;
  Object.assign(curve, { stale: true }).draw();
  assert.deepEqual([curve.low, curve.high, curve.beyond], [low, high, false]);
  // A rig far beyond the curve stands at its end, with its gap in words.
  curve.store.values.gap = 10;
  Object.assign(curve, { stale: true }).draw();
  assert.deepEqual([curve.high, curve.beyond], [high, true]);
  assert.match(curve.context.text(), /the rig is at 10\.0.m →/);
});

test('a click sets the gap under it, within the frame', () => {
  const curve = drawn();
  const { toX, toY, box } = curve.plan;
  curve.pointer = [toX(0.028), toY(0.5)];
  assert.ok(Math.abs(curve.aim - 0.028) < 1e-12);
  curve.pointer = [box.left - 5, toY(0.5)];
  assert.ok(Number.isNaN(curve.aim));
});

test('the pointer reads the gap, and the branch that is nearest to it', () => {
  const curve = drawn();
  const { toX, toY } = curve.plan;
  assert.equal(curve.values(toX(0.025), toY(0.2)), 'd 25.0\u202fmm, Xmax/A 0.150');
  assert.equal(curve.values(toX(0.015), toY(0.9)), 'd 15.0\u202fmm, Xmax/A 0.750');
  assert.equal(curve.values(2, 2), '');
});

test('keys go through the special points in the order of their gaps, and around', () => {
  const curve = drawn();
  const seen = [1, 1, 1, -1].map((step) => {
    curve.visit(step);
    return curve.line.textContent;
  });
  const [corner, end] = ['corner at 15.0\u202fmm, Xmax/A 0.300. ', 'end at 35.0\u202fmm, Xmax/A 0.200. '];
  assert.deepEqual(seen, [corner, end, corner, end]);
  // They stand for no gap to be set.
  assert.ok(Number.isNaN(curve.aim));
});

test('stable parts are solid, unstable ones dashed, and those that are not viable dotted', () => {
  const lines = drawn().context.parts.filter((part) => /stroke="(black|grey)"/.test(part));
  const kinds = lines.map((part) => [/stroke="(\w+)"/.exec(part)[1], /dasharray="([\d ]+)"/.exec(part)?.[1], part.match(/[ML]/g).length]);
  assert.deepEqual(kinds, [['grey', '5 4', 2], ['black', undefined, 2], ['grey', '5 4', 2], ['grey', '1 3', 3]]);
});
