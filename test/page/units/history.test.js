// SPDX-License-Identifier: Apache-2.0
// The motion as it comes in frames: places between samples, the base, changes.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { History } from '../../../impact_damper_ros/page/static/history.js';
import { RigDrawing } from '../../../impact_damper_ros/page/static/rig_drawing.js';
import { Theory } from '../../../impact_damper_ros/page/static/theory.js';

const SAMPLES = ['time', 'x', 'primary_velocity', 'z', 'damper_velocity', 'stop_1', 'stop_2', 'angle', 'phase', 'base', 'base_velocity'];
const IMPACTS = ['time', 'stop', 'x', 'y', 'primary_velocity_before', 'primary_velocity_after', 'damper_velocity_before', 'damper_velocity_after', 'impulse', 'phase'];
const TABLES = {
  samples: SAMPLES, impacts: IMPACTS, measured: ['time', 'x', 'z'], acts: ['time', 'command', 'stop_1', 'stop_2', 'force', 'energy'],
  ghost_samples: SAMPLES, ghost_impacts: IMPACTS,
};

function begun() {
  const history = new History();
  history.shape(TABLES);
  return history;
}

/** A frame with rows that count from its end. */
function frame(end, tables = {}, flags = {}) {
  const rows = Object.fromEntries(Object.keys(TABLES).map((name) => [name, (tables[name] ?? []).flatMap(([time, ...rest]) => [time - end, ...rest])]));
  return { end, epoch: 0, paused: false, replace: false, replace_ghost: false, ...rows, ...flags };
}

/** A rig whose X is a cubic, on a base that moves evenly. */
const sample = (t, base = 0, rate = 0) => [t, t ** 3, 3 * t ** 2, 2 * t, 2, t ** 3 + 1, t ** 3 - 1, 0.1, t % 1, base, rate];

test('between two samples the motion is the cubic through places and velocities', () => {
  const history = begun();
  history.add(frame(0.5, { samples: [sample(0), sample(1)] }));
  assert.ok(Math.abs(history.state.x - 0.125) < 1e-12);
  assert.ok(Math.abs(history.state.z - 1) < 1e-12);
  // The stops ride on M.
  assert.ok(Math.abs(history.state.stop_1 - 1.125) < 1e-12);
  assert.equal(history.state.phase, 0);
});

test('an impact between two samples is a corner', () => {
  const history = begun();
  // m flies to the stop at 2 m/s and leaves it at -1 m/s, at t = 0.5.
  const [before, after] = [[0, 0, 0, 0, 2, 1, -1, 0, 0, 0, 0], [1, 0, 0, 0.5, -1, 1, -1, 0, 0, 0, 0]];
  const hit = [0.5, 1, 0, 1, 0, 0, 2, -1, 3, 0.25];
  history.add(frame(0, { samples: [before] }));
  history.add(frame(1, { samples: [after], impacts: [hit] }));
  assert.ok(Math.abs(history.own.at(0.25).z - 0.5) < 1e-12);
  assert.ok(Math.abs(history.own.at(0.75).z - 0.75) < 1e-12);
  // Its stop lights up once.
  const drawing = Object.create(RigDrawing.prototype);
  drawing.clear();
  drawing.flash(history.impacts, 0, 1, 7);
  history.add(frame(1.1, { samples: [sample(1.1)] }));
  drawing.flash(history.impacts, 1, 1.1, 8);
  assert.deepEqual(drawing.flashes, [{ stop: 1, strength: 1, since: 7 }]);
});

test('from the base, places and velocities are less by its own, whenever that is asked for', () => {
  const rows = [0, 1, 2, 3].map((t) => sample(t, 10 * t, 10));
  const impact = [1.5, 2, 15.5, 0.25, 11, 12, 13, 14, 1, 0.5];
  const seen = [];
  for (const early of [true, false]) {
    const history = begun();
    if (early) history.countFrom(true);
    history.add(frame(2, { samples: rows.slice(0, 3), impacts: [impact], measured: [[0.5, 5, 6]], acts: [[1, 1, 0.1, -0.1, 0, 0]] }));
    history.add(frame(3, { samples: rows.slice(3) }));
    history.countFrom(true);
    seen.push([history.own.samples.row(2), history.own.impacts.row(0), history.own.measured.row(0), history.own.acts.row(0), history.state]);
  }
  assert.deepEqual(seen[0], seen[1]);
  const [row, hit, measured, act, state] = seen[0];
  assert.deepEqual([row.x, row.primary_velocity, row.z, row.damper_velocity, row.stop_1], [-12, 2, -16, -8, -11]);
  // Between two samples; places in M and impulses are the same
  assert.deepEqual([hit.x, hit.y, hit.primary_velocity_before, hit.damper_velocity_after, hit.impulse], [0.5, 0.25, 1, 4, 1]);
  assert.deepEqual([measured.x, measured.z], [0, 1]);
  assert.deepEqual([act.stop_1, act.stop_2], [0.1, -0.1]);
  assert.deepEqual([state.base, state.x], [0, -3]);
  const history = begun();
  history.add(frame(3, { samples: rows }));
  history.countFrom(true);
  assert.equal(history.reach(-1).shaken, 0);
  history.countFrom(false);
  assert.equal(history.own.samples.row(2).x, 8);
  assert.equal(history.reach(-1).shaken, 30);
});

test('a frame that replaces leaves nothing of before', () => {
  const history = begun();
  history.add(frame(2, { samples: [sample(1), sample(2)], ghost_samples: [sample(2)] }));
  history.add(frame(1, { samples: [sample(1)] }, { replace: true }));
  assert.deepEqual([history.own.samples.length, history.other.samples.length, history.state.time], [1, 1, 1]);
});

test('of very long runs the oldest rows go', () => {
  const history = begun();
  for (let k = 0; k < 6; k += 1) {
    const rows = Array.from({ length: 60000 }, (_, n) => sample((60000 * k + n) / 1000));
    history.add(frame(60 * (k + 1), { samples: rows }));
  }
  const { samples } = history.own;
  assert.equal(samples.length, 2 ** 17);
  assert.equal(samples.row(samples.end - 1).time, 359.999);
  assert.equal(samples.row(samples.after(359)).time > 359, true);
});

test('what is done is a line in the traces; a knob that is dragged makes one', () => {
  const history = begun();
  history.end = 100;
  history.change(1, { text: 'd = 20 mm', name: 'gap' });
  history.change(1.3, { text: 'd = 21 mm', name: 'gap' });
  history.change(1.4, { text: 'm = 0.2 kg', name: 'damper_mass' });
  history.change(1.5, { text: 'reset', name: '' });
  history.change(5, { text: 'd = 22 mm', name: 'gap' }, 7);
  history.change(9, { text: 'd = 23 mm', name: 'gap' }, 7);
  history.change(NaN, { text: 'd = 24 mm', name: 'gap' });
  assert.deepEqual(history.changes.map(({ time, text }) => [time, text]), [[1.3, 'd = 21 mm'], [1.4, 'm = 0.2 kg'], [9, 'd = 23 mm']]);
  assert.equal(history.lastChange, 9);
});

for (const begin of [0, 1]) {
  test(`theory of two cycles that begins with that of ${begin} s lies on the motion`, () => {
    const z = (time) => Math.sin(Math.PI * time) + 0.5 * Math.sin(2 * Math.PI * time);
    const history = begun();
    const rows = Array.from({ length: 1200 }, (_, n) => [n / 200, 0, 0, z(n / 200), ...Array(7).fill(0)]);
    history.add(frame(rows.at(-1)[0], { samples: rows }));
    const t = Array.from({ length: 400 }, (_, n) => n / 200);
    const theory = new Theory();
    theory.take({ type: 'orbit', found: true, text: '', kind: '', cycles: 2, period: 2, t_zero: 0, t, z: t.map((time) => z(time + begin)) });
    assert.equal(theory.zero(history.own.samples, history.end), begin);
  });
}
