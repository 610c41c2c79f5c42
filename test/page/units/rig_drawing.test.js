// SPDX-License-Identifier: Apache-2.0
// The picture of the rig: m is as large as it is heavy, all that moves has room, and stops far beyond it do not shrink it.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { colours } from '../../../impact_damper_ros/page/static/chart.js';
import { RigDrawing } from '../../../impact_damper_ros/page/static/rig_drawing.js';

colours.size = 16;
const state = { x: 0.001, stop_1: 0.013, stop_2: -0.011, angle: 0 };
const extent = { swing: 0.008, apart: 0.012, shaken: 0 };

/** The plan of a picture of this size. */
function plan({ width = 800, height = 220, massRatio = 0.05, ...changes } = {}) {
  const drawing = Object.assign(Object.create(RigDrawing.prototype), { width, height });
  drawing.clear();
  return drawing.layout({ ...extent, ...changes.extent }, { ...state, ...changes.state }, massRatio, 0);
}

test('the area of m is as its mass', () => {
  const [light, heavy] = [0.01, 0.1].map((massRatio) => plan({ massRatio }).slug);
  assert.ok(Math.abs(heavy / light / Math.sqrt(10) - 1) < 0.1);
});

test('all that moves has room at every inclination', () => {
  for (const angle of [-1.5, -0.4, 0, 0.3, 0.9, 1.5]) {
    for (const [width, height] of [[340, 190], [800, 220], [500, 500]]) {
      const { left, right, up, down } = plan({ width, height, state: { angle } });
      const [cos, sin] = [Math.abs(Math.cos(angle)), Math.abs(Math.sin(angle))];
      assert.ok((right - left) * cos + (up + down) * sin <= width);
      assert.ok((right - left) * sin + (up + down) * cos <= height + 1 || right - left < 112);
    }
  }
});

test('stops far beyond all that moves stand at the edge', () => {
  const { spread, scale } = plan({ state: { stop_1: 500, stop_2: -500 } });
  assert.ok(spread < 100 * 0.012 * 1.3);
  assert.ok(scale > 0);
});
