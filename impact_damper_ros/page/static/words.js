// SPDX-License-Identifier: Apache-2.0
// A rig, and what is done to it, in a line.

import { capital, digits, lengthUnit, TAU, withUnit } from './format.js';

/** @import { Descriptor, Diagnostics, Values } from './messages.js' */

/** Parameters of the node that do not change the rig. */
const SETTINGS = new Set(['real_time_factor', 'record', 'bag_directory', 'predict_motion', 'max_bag_size', 'max_bag_duration']);
/** Units of the motion of the base, by its quantity. */
const BASE = { displacement: 'm', velocity: 'm/s', acceleration: 'm/s²' };

const naturalOf = (/** @type {Values} */ { primary_mass: mass, stiffness }) => (mass > 0 ? Math.sqrt(stiffness / mass) / TAU : 0);

/** In which units the values of a rig are read; they change only where they have to. */
export class Units {
  constructor(/** @type {Values} */ values = {}) {
    this.natural = naturalOf(values);
    this.scale = lengthUnit(values.gap ?? 1);
    this.quantity = values.base_quantity;
  }

  /** Take in values that have changed, of all that the rig has by then; return whether a unit is another one. */
  take(/** @type {Values} */ changed, /** @type {Values} */ values) {
    let anew = false;
    if ('gap' in changed || 'primary_mass' in changed || 'stiffness' in changed) {
      const natural = naturalOf(values);
      // A knob that is turned keeps its unit: who has typed millimetres types millimetres next.
      const scale = Object.keys(changed).length > 2 ? lengthUnit(values.gap ?? 1) : this.scale;
      anew = scale.unit !== this.scale.unit || Math.abs(Math.log((natural || 1) / (this.natural || 1))) > 0.05;
      this.natural = natural;
      if (anew) this.scale = scale;
    }
    if (changed.base_quantity && changed.base_quantity !== this.quantity) {
      this.quantity = changed.base_quantity;
      anew = true;
    }
    return anew;
  }

  /** How a parameter is shown: unit and factor; lengths in a scale, the motion of the base as its quantity. */
  of({ name, unit }) {
    if (name === 'base_amplitudes') return { unit: BASE[this.quantity] ?? '', factor: 1 };
    if (unit === 'rad/s') return { unit: 'Hz', factor: 1 / TAU };
    if (unit === 'rad') return { unit: '°', factor: 360 / TAU };
    if (unit === 'm') return this.scale;
    return { unit: ['kg', 'N', 'N/m', 'N s/m'].includes(unit) ? unit : unit.replace('^2', '²').replace(' ', '\u202f'), factor: 1 };
  }
}

/** Whether a list has only become as long as that of another parameter. */
function isPadded(before, value) {
  const trimmed = (list) => JSON.stringify(list.slice(0, list.findLastIndex((one) => one !== 0) + 1));
  return Array.isArray(value) && Array.isArray(before) && value.length !== before.length && trimmed(value) === trimmed(before);
}

/** What was done to a rig, for the lines in the traces: a text, and the name of the parameter if it is a single one. */
export function changeInWords({ kind, values = {}, preset = '' }, /** @type {Values} */ before, /** @type {Descriptor[]} */ descriptors, /** @type {Units} */ units) {
  const names = Object.keys(values).filter((name) => !SETTINGS.has(name) && !name.startsWith('initial_') && !isPadded(before[name], values[name]));
  const one = (name) => {
    const known = descriptors.find((other) => other.name === name);
    if (!known) return `${name} ${values[name]}`;
    const { unit, factor } = units.of(known);
    const text = (value) => (typeof value === 'number' ? digits(value * factor, 4).replace(/(\.\d*?)0+$/, '$1').replace(/\.$/, '') : String(value).slice(0, 40));
    const shown = Array.isArray(values[name]) ? values[name].slice(0, 3).map(text).join(', ') : text(values[name]);
    const isNumber = known.type !== 'string' && known.type !== 'bool';
    return `${known.first?.symbol ?? name.replace(/_/g, ' ')} = ${shown}${isNumber && unit ? ` ${unit}` : ''}`;
  };
  const turned = names.length > 2 ? preset || `${names.length} parameters` : names.map(one).join(', ');
  return { text: [kind === 'reset' ? 'reset' : '', turned].filter(Boolean).join(', '), name: kind !== 'reset' && names.length === 1 ? names[0] : '' };
}

/** A hint on a length that a link has without a unit: in m it is far longer than those of a rig which are read in mm; empty if there is none. */
export function lengthHint(/** @type {Values} */ values, /** @type {Descriptor[]} */ descriptors, /** @type {Units} */ { scale }) {
  const isFar = (value) => typeof value === 'number' && lengthUnit(Math.abs(value)).unit === 'm';
  const far = scale.unit !== 'm' && descriptors.find(({ name, unit }) => unit === 'm' && values[name] && isFar(values[name]));
  if (!far) return '';
  const given = `${far.name}=${values[far.name]}`;
  return `The link has ${given} without a unit: that is ${withUnit(values[far.name], 'm')}. If ${scale.unit} are meant, write ${given}${scale.unit}.`;
}

/** What shakes the rig first, the force or the base: amplitude, unit, and frequency in rad/s. */
export function drive(/** @type {Values} */ { force_amplitudes: force = [], force_frequencies: ofForce = [], base_amplitudes: base = [], base_frequencies: ofBase = [], base_quantity: quantity }) {
  if (!force[0] && base[0]) return { amplitude: Math.abs(base[0]), unit: BASE[quantity], frequency: ofBase[0], word: 'base ' };
  return { amplitude: Math.abs(force[0] ?? 0), unit: 'N', frequency: ofForce[0], word: '' };
}

/** The first harmonic of the force at a phase, in cycles of its angle, as a share of its amplitude; NaN without one. */
export function push({ force_amplitudes: [force = 1] = [], force_phases: [lead = 0] = [] }, phase) {
  return force ? Math.sign(force) * Math.sin(TAU * phase + lead) : NaN;
}

/** The rig in a line. */
export function rigInWords(values) {
  const { force_amplitudes: forces = [], multisine_level: level, gap, gap_control: control } = values;
  const { amplitude, unit, frequency, word } = drive(values);
  return [
    amplitude > 0 ? `${word}${withUnit(amplitude, unit)} at ${withUnit(frequency / TAU, 'Hz', 4)}` : level > 0 || forces.some(Boolean) ? '' : 'no force',
    forces.length > 1 ? `+${forces.length - 1} harmonic${forces.length > 2 ? 's' : ''}` : '',
    level > 0 ? `multisine ${withUnit(level, 'N')} rms` : '',
    `gap ${withUnit(gap, 'm')}`,
    control && control !== 'off' ? `${control} control` : '',
  ].filter(Boolean).join(' · ');
}

const AGREEMENT = {
  agrees: 'Agrees with theory',
  disagrees: 'Differs from theory',
  'not settled': 'Not settled yet',
};
/** Words for kinds of a measured motion with which theory is not compared. */
const KINDS = { 'without impacts': 'No impacts', transient: 'Settling' };

/** The verdict on a motion: words, their shade, and a line each on the measured and the predicted motion. */
export function verdictInWords(/** @type {Omit<Diagnostics, 'type' | 'controller'>} */ { level, kind, message, verdict, agreement }, /** @type {import('./theory.js').Theory} */ theory) {
  const { orbit } = theory;
  const irregular = theory.irregular && agreement !== 'agrees' && agreement !== 'disagrees';
  const words = AGREEMENT[agreement] ?? (verdict && !kind ? verdict : KINDS[kind] ?? 'No verdict');
  const shade = { agrees: 'ok', disagrees: 'warn' }[agreement] ?? 'none';
  const stability = orbit && `${orbit.label}, ${orbit.stable ? 'stable' : 'unstable'}${orbit.viable === false ? ', not viable' : ''}`;
  const predicted = orbit ? [stability, orbit.text].filter(Boolean).join('; ') : theory.failed || verdict;
  return {
    words: irregular ? capital(theory.kind) : words,
    shade: level === 'error' ? 'error' : shade,
    measured: message ? `Measured: ${message}` : '',
    predicted: predicted ? `Theory: ${predicted}` : '',
  };
}
