// SPDX-License-Identifier: Apache-2.0
// Numbers, units and lines in words.

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { clock, digits, lengthUnit, niceAbove, ticks, typed, withUnit } from '../../../impact_damper_ros/page/static/format.js';
import { readTyped, SliderScale } from '../../../impact_damper_ros/page/static/slider.js';
import { Theory } from '../../../impact_damper_ros/page/static/theory.js';
import { changeInWords, lengthHint, push, rigInWords, Units, verdictInWords } from '../../../impact_damper_ros/page/static/words.js';

const TABLE = [
  [digits, [[[0], '0'], [[null], '–'], [[NaN], '–'], [[12.3456], '12.3'], [[-0.00123456, 4], '−0.001235'], [[1234567], '1.23e+6']]],
  [withUnit, [[[0.0241, 'm'], '24.1\u202fmm'], [[0, 'N'], '0\u202fN'], [[999.9996, 'Hz'], '1.00\u202fkHz'], [[-3e-7, 'm', 2], '−300\u202fnm'], [[1234567, 'B', 2], '1.2\u202fMB']]],
  [typed, [[[0.0241], '0.0241'], [[0.1 + 0.2], '0.3'], [[31.416 / (2 * Math.PI), 5e-6], '5'], [[1.96133, 5e-6], '1.96133'], [[1e21], '1e+21'], [[Infinity], '']]],
  [clock, [[[75], '75.00\u202fs'], [[3725.25, true], '1:02:05.250'], [[-1], '−1.00\u202fs'], [[NaN], '–']]],
  [(...range) => ticks(...range).decimals, [[[0, 0.2, 4], 2], [[0, 40, 4], 0]]],
  [niceAbove, [[[0.0241], 0.025], [[1], 1], [[NaN], 1], [[7.1e5], 8e5]]],
  [(size) => lengthUnit(size).unit, [[[3], 'm'], [[0.02], 'mm'], [[2e-5], 'µm']]],
  [(...range) => ticks(...range).values.join(' '), [[[0, 1, 4], '0 0.5 1'], [[-24, 24, 5], '-20 -10 0 10 20'], [[1, 1, 3], '']]],
  [(text) => Object.values(readTyped(text)).join('|'), [[['24.5'], '24.5|'], [['24,5 mm'], '24.5|mm'], [[' -3e-2m '], '-0.03|m'], [['wide'], 'NaN|']]],
];
for (const [convert, cases] of TABLE) {
  for (const [given, expected] of cases) {
    test(`${convert.name || String(convert)}(${given.map(String)}) is ${expected}`, () => assert.equal(convert(...given), expected));
  }
}

test('a length of a link without a unit is questioned where it is in m and the rig in mm', () => {
  const lengths = ['gap', 'initial_damper_offset'].map((name) => ({ name, unit: 'm' }));
  const hint = (values, gap = 0.024) => lengthHint(values, [...lengths, { name: 'stiffness', unit: 'N/m' }], new Units({ gap }));
  assert.equal(hint({ gap: 12, stiffness: 2000 }), 'The link has gap=12 without a unit: that is 12.0\u202fm. If mm are meant, write gap=12mm.');
  assert.match(hint({ gap: 0.02, initial_damper_offset: -5 }), /offset=-5 .* −5\.00\u202fm\. .*offset=-5mm/);
  assert.match(hint({ gap: 20 }, 0.0001), /20µm/);
  assert.deepEqual([{ gap: 0.034 }, { gap: '12mm' }, { stiffness: 12 }, {}].map((values) => hint(values)), ['', '', '', '']);
  assert.equal(hint({ gap: 24 }, 37), '');
});

test('a slider goes eight times up and down, within what is usual', () => {
  const gap = { name: 'gap', min: 1e-9, max: 1e9, usual: [0.001, 0.1] };
  const scale = new SliderScale(gap, 24, 1000, 5);
  assert.deepEqual(scale.span.slice(0, 2), [3, 100]);
  assert.equal(scale.at(scale.of(24)), 24);
  assert.deepEqual([scale.at(0), scale.at(1), scale.of(1e9), scale.misses(101)], [3, 100, 1, true]);
  const frequency = new SliderScale({ ...gap, name: 'force_frequencies' }, 5, 1, 5);
  assert.deepEqual(frequency.span, [2.5, 7.5, 0.005]);
  assert.equal(frequency.at(0.5), 5);
  assert.deepEqual(new SliderScale({ ...gap, name: 'friction' }, 0, 1, 5).span, [0, 1, 0.005]);
});

test('a number whose 0 has a meaning has a place for it at the end of a logarithmic slider', () => {
  const speed = { name: 'restitution_speed', min: 0, max: 1e9, usual: [0, 100], zero: 'constant R' };
  const scale = new SliderScale(speed, 0, 1, 5);
  assert.deepEqual(scale.span.slice(0, 2), [0.001, 100]);
  assert.deepEqual([scale.of(0), scale.at(1), scale.at(0.96), scale.at(0.95), scale.at(0)], [1, 0, 0, 100, 0.001]);
  assert.equal(scale.at(scale.of(0.3)), 0.3);
  assert.deepEqual([scale.misses(0), scale.misses(1e-4), scale.misses(101)], [false, true, true]);
  assert.deepEqual(new SliderScale(speed, 1e-5, 1, 5).span.slice(0, 2), [1e-5, 100]);
});

const RIG = { primary_mass: 2, stiffness: 2 * (10 * Math.PI) ** 2, gap: 0.024, base_quantity: 'displacement' };

test('lengths stay in their unit while a knob is turned, and not where the rig is another one', () => {
  const units = new Units(RIG);
  assert.ok(Math.abs(units.natural - 5) < 1e-12);
  const gap = { name: 'gap', unit: 'm' };
  assert.equal(units.of(gap).unit, 'mm');
  assert.equal(units.take({ gap: 0.6 }, { ...RIG, gap: 0.6 }), false);
  assert.equal(units.of(gap).unit, 'mm');
  assert.equal(units.take({ gap: 0.6, friction: 0, damping: 1 }, { ...RIG, gap: 0.6 }), true);
  assert.equal(units.of(gap).unit, 'm');
  assert.equal(units.take({ stiffness: 1 }, { ...RIG, gap: 0.6, stiffness: 1 }), true);
  assert.equal(units.of({ name: 'base_amplitudes', unit: '' }).unit, 'm');
  units.take({ base_quantity: 'acceleration' }, RIG);
  assert.equal(units.of({ name: 'base_amplitudes', unit: '' }).unit, 'm/s²');
  assert.ok(Math.abs(units.of({ name: 'angle', unit: 'rad' }).factor - 180 / Math.PI) < 1e-12);
});

const known = (name, unit, symbol = '', type = 'double') => ({ name, unit, type, first: symbol ? { symbol } : null });
const KNOWN = [known('gap', 'm', 'd'), known('force_amplitudes', 'N', 'F', 'double_array'), known('force_frequencies', 'rad/s', 'f', 'double_array'), known('gap_control', '', 'control', 'string'), known('friction', '')];
for (const [change, text, name] of [
  [{ kind: 'change', values: { gap: 0.0305 } }, 'd = 30.5 mm', 'gap'],
  [{ kind: 'change', values: { force_amplitudes: [1.2, 0.3] } }, 'F = 1.2, 0.3 N', 'force_amplitudes'],
  // A list that only becomes as long as another one is no change.
  [{ kind: 'change', values: { force_frequencies: [10, 0] } }, '', ''],
  [{ kind: 'change', values: { force_frequencies: [10 * Math.PI] } }, 'f = 5 Hz', 'force_frequencies'],
  [{ kind: 'change', values: { gap_control: 'timed', friction: 0.02 } }, 'control = timed, friction = 0.02', ''],
  [{ kind: 'change', values: { record: true, bag_directory: '/a, = b' } }, '', ''],
  [{ kind: 'reset', values: {} }, 'reset', ''],
  [{ kind: 'reset', values: { gap: 0.01, friction: 0, gap_control: 'off' }, preset: 'Bench rig' }, 'reset, Bench rig', ''],
  [{ kind: 'change', values: { gap: 0.01, friction: 0, gap_control: 'off' } }, '3 parameters', ''],
  [{ kind: 'change', values: { strange: 'a = b' } }, 'strange a = b', 'strange'],
]) {
  test(`${JSON.stringify(change)} is “${text}”`, () => {
    assert.deepEqual(changeInWords(change, { force_frequencies: [10] }, KNOWN, new Units(RIG)), { text, name });
  });
}

for (const [values, expected] of [
  [{ force_amplitudes: [1.2], force_frequencies: [10 * Math.PI], gap: 0.024, gap_control: 'off' }, '1.20\u202fN at 5.000\u202fHz · gap 24.0\u202fmm'],
  [{ force_amplitudes: [0], base_amplitudes: [2], base_frequencies: [10 * Math.PI], base_quantity: 'acceleration', gap: 1 }, 'base 2.00\u202fm/s² at 5.000\u202fHz · gap 1.00\u202fm'],
  [{ force_amplitudes: [0], gap: 0.01, gap_control: 'timed' }, 'no force · gap 10.0\u202fmm · timed control'],
  [{ force_amplitudes: [1, 2, 3], force_frequencies: [0], multisine_level: 0.5, gap: 0.01 }, '1.00\u202fN at 0\u202fHz · +2 harmonics · multisine 500\u202fmN rms · gap 10.0\u202fmm'],
]) test(expected, () => assert.equal(rigInWords(values), expected));

const orbit = { type: 'orbit', found: true, label: '2 impacts in 1 cycle', stable: true, viable: true, text: '', kind: '' };
for (const [report, theory, words, shade, predicted] of [
  [{ kind: 'without impacts', message: 'm has not hit a stop for 14867 cycles of the force' }, null, 'No impacts', 'none', ''],
  [{ kind: 'transient', message: '2 impacts in 1 cycle, settling' }, null, 'Settling', 'none', ''],
  [{ kind: 'periodic', message: '2 impacts in 1 cycle, settled', agreement: 'agrees' }, orbit, 'Agrees with theory', 'ok', 'Theory: 2 impacts in 1 cycle, stable'],
  [{ kind: 'periodic', message: '', agreement: 'disagrees', verdict: 'none' }, { ...orbit, stable: false, viable: false, text: 'why' }, 'Differs from theory', 'warn', 'Theory: 2 impacts in 1 cycle, unstable, not viable; why'],
  [{ kind: 'not periodically driven', message: 'not periodically driven', verdict: 'off' }, null, 'No verdict', 'none', 'Theory: off'],
  [{ kind: 'undecided', message: 'undecided' }, { ...orbit, found: false, kind: 'chaotic' }, 'Chaotic', 'none', ''],
  [{ kind: 'periodic', message: '', agreement: 'agrees', level: 'error' }, orbit, 'Agrees with theory', 'error', 'Theory: 2 impacts in 1 cycle, stable'],
  [{ kind: '', message: '', verdict: '2 impacts in 1 cycle, stable' }, null, '2 impacts in 1 cycle, stable', 'none', 'Theory: 2 impacts in 1 cycle, stable'],
]) {
  test(`the verdict of ${JSON.stringify(report)} is ${words}`, () => {
    const known_ = new Theory();
    if (theory) known_.take(theory);
    const found = verdictInWords({ level: 'ok', message: '', verdict: '', agreement: '', ...report }, known_);
    assert.deepEqual([found.words, found.shade, found.predicted], [words, shade, predicted]);
  });
}

for (const [values, phase, share] of [
  [{ force_amplitudes: [2], force_phases: [0] }, 0.25, 1],
  [{ force_amplitudes: [-2], force_phases: [0] }, 0.25, -1],
  [{ force_amplitudes: [2], force_phases: [Math.PI / 2] }, 0.5, -1],
  [{ force_amplitudes: [0], force_phases: [0] }, 0.25, NaN],
  [{}, NaN, NaN],
]) {
  test(`the force of ${JSON.stringify(values)} at a phase of ${phase} is ${share} of its amplitude`, () => {
    assert.ok(Object.is(push(values, phase), share) || Math.abs(push(values, phase) - share) < 1e-12);
  });
}
