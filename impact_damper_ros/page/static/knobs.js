// SPDX-License-Identifier: Apache-2.0
// Knobs made from the descriptors of the parameters: degrees and hertz for people, SI for the rig.

import { byId, element, mark, reducedMotion, write } from './dom.js';
import { digits, lengthUnit, TAU, typed, withUnit } from './format.js';
import { term } from './glossary.js';

/** Parameters of the node that do not change the rig. */
const SETTINGS = new Set(['real_time_factor', 'record', 'bag_directory', 'predict_motion', 'max_bag_size', 'max_bag_duration']);
const GROUPS = [
  ['rig', 'Rig'],
  ['forcing', 'Force'],
  ['control', 'Gap control'],
  ['run', 'Run'],
];
const worded = (name) => {
  const text = name.replace(/_/g, ' ');
  return text[0].toUpperCase() + text.slice(1);
};

/** Units of the motion of the base, by its quantity. */
export const BASE = { displacement: 'm', velocity: 'm/s', acceleration: 'm/s²' };

/** How a parameter is shown: unit and factor; lengths in a scale, the motion of the base as its quantity. */
function display({ name, unit }, { scale, quantity }) {
  if (name === 'base_amplitudes') return { unit: BASE[quantity] ?? '', factor: 1 };
  if (unit === 'rad/s') return { unit: 'Hz', factor: 1 / TAU };
  if (unit === 'rad') return { unit: '°', factor: 360 / TAU };
  if (unit === 'm') return scale;
  if (unit === 'kg' || unit === 'N' || unit === 'N/m' || unit === 'N s/m') return { unit, factor: 1 };
  return { unit: unit.replace('^2', '²').replace(' ', '\u202f'), factor: 1 };
}

/** One knob: a label, a number, and for the first ones a slider. */
class Knob {
  constructor(descriptor, knobs, { title, about = '', slider = false }) {
    this.descriptor = descriptor;
    this.knobs = knobs;
    this.slider = slider;
    this.value = descriptor.value;
    this.busy = false;
    this.next = null;
    this.shown = display(descriptor, knobs);
    const { name, type } = descriptor;
    this.id = `${slider ? 'knob' : 'parameter'}-${name}`;
    const fixed = descriptor.read_only || knobs.locked;
    const help = [descriptor.description, this.rangeText(), descriptor.read_only ? 'Set at the start of the node.' : ''].filter(Boolean).join(' ');
    this.error = element('p', { class: 'error', id: `${this.id}-error`, role: 'alert', hidden: true });
    const described = { 'aria-describedby': `${this.id}-help ${this.id}-error` };
    if (type === 'bool') {
      this.input = element('input', { type: 'checkbox', id: this.id, disabled: fixed, ...described });
      this.input.addEventListener('change', () => this.send(this.input.checked));
    } else if (type === 'string' && descriptor.choices?.length) {
      this.input = element('select', { id: this.id, disabled: fixed, ...described });
      for (const choice of descriptor.choices) {
        this.input.append(element('option', { value: choice, text: choice.replace(/_/g, ' ') }));
      }
      this.input.addEventListener('change', () => this.send(this.input.value));
    } else {
      this.input = element('input', {
        type: 'text', id: this.id, disabled: fixed, autocomplete: 'off', spellcheck: 'false',
        inputmode: type === 'string' || type === 'double_array' ? 'text' : 'decimal', ...described,
      });
      // What is being typed is not overwritten by a value that comes in meanwhile.
      this.input.addEventListener('input', () => { this.typing = true; });
      this.input.addEventListener('change', () => { this.typing = false; this.enter(); });
      this.input.addEventListener('blur', () => {
        if (this.typing) {
          this.typing = false;
          this.show();
        }
        this.note('');
      });
      this.input.addEventListener('keydown', (event) => this.key(event));
      this.input.addEventListener('focus', () => {
        this.input.select();
        if (this.error.hidden) this.note(this.rangeText());
      });
    }
    const label = element('label', { for: this.id, text: title });
    this.unit = element('span', { class: 'unit', text: this.unitText() });
    this.place = element(
      'div',
      { class: `knob ${slider ? 'big' : 'row'}`, 'data-name': name, title: help },
      element('div', { class: 'name' }, label, about ? term(about, '?') : null),
      element('div', { class: 'value' }, this.input, this.unit),
    );
    const button = this.place.querySelector('button.term');
    if (button) button.setAttribute('aria-label', `What ${title} means`);
    if (slider && type !== 'bool' && !descriptor.choices?.length) this.addSlider(title);
    this.place.append(
      element('p', { class: 'visually-hidden', id: `${this.id}-help`, text: help }),
      this.error,
    );
    this.show();
  }

  /** The usual values, and the units in which they can be typed. */
  rangeText() {
    const { min, max, unit, units, usual, choices, type } = this.descriptor;
    const [low, high] = usual ?? [min, max];
    if (choices?.length || type === 'bool' || low === null || low === undefined) return '';
    const { factor } = this.shown;
    const text = (value) => (unit === 'm' ? withUnit(value, unit) : digits(value * factor, 3));
    const shown = unit === 'm' ? '' : this.unitText();
    return `${usual ? 'Usually' : 'From'} ${text(low)} to ${text(high)}${shown && `\u202f${shown}`}.${units.length > 1 ? ` Units: ${units.join(', ')}.` : ''}`;
  }

  unitText() {
    return this.descriptor.type === 'string' || this.descriptor.type === 'bool' ? '' : this.shown.unit;
  }

  /** Whether this knob turns the first entry of an array. */
  get firstOnly() {
    return this.slider && this.descriptor.type === 'double_array';
  }

  get number() {
    const value = Array.isArray(this.value) ? this.value[0] : this.value;
    return value * this.shown.factor;
  }

  addSlider(title) {
    this.range = element('input', {
      type: 'range', min: 0, max: 1000, step: 1, 'aria-label': `${title}, slider`, tabindex: 0, disabled: this.input.disabled,
    });
    this.range.addEventListener('input', () => {
      if (!this.dragging) this.knobs.hold(this.descriptor.name);
      this.dragging = true;
      const number = this.fromSlider(Number(this.range.value) / 1000);
      this.input.value = typed(number, 1e-4);
      this.sendNumber(number);
    });
    const done = () => {
      this.dragging = false;
      this.knobs.hold('');
      this.show();
    };
    this.range.addEventListener('change', done);
    this.range.addEventListener('blur', done);
    this.place.append(this.range);
    this.scaleSlider();
  }

  /** Choose the range of the slider about what the knob stands at. */
  scaleSlider() {
    if (!this.range) return;
    const { name, min, max } = this.descriptor;
    const { factor } = this.shown;
    const number = this.number;
    this.log = false;
    if (name === 'angle') this.span = [-90, 90, 0.5];
    else if (name.startsWith('restitution')) this.span = [0, 1, 0.01];
    else if (name === 'friction') this.span = [0, Math.max(1, 2 * number), 0.005];
    else if (name === 'force_frequencies' || name === 'base_frequencies') {
      const natural = this.knobs.natural || number || 1;
      this.span = [0.5 * natural, Math.max(1.5 * natural, 1.2 * number), 0.001 * natural];
    } else if (number > 0) {
      this.log = true;
      // Eight times smaller and larger, but not farther than is usual
      const [low, high] = (this.descriptor.usual ?? [min, max]).map((bound) => bound * factor);
      this.span = [Math.min(number, Math.max(low, number / 8)), Math.max(number, Math.min(high, number * 8)), 0];
    } else this.span = [0, 1, 0.001];
  }

  fromSlider(part) {
    const [low, high, step] = this.span;
    if (this.log) return Number((low * (high / low) ** part).toPrecision(3));
    return Number((Math.round((low + part * (high - low)) / step) * step).toPrecision(6));
  }

  toSlider(number) {
    const [low, high] = this.span;
    const part = this.log ? Math.log(number / low) / Math.log(high / low) : (number - low) / (high - low);
    return Math.round(1000 * Math.min(1, Math.max(0, part)));
  }

  /** Send what was typed, to be read with its unit; without one it is in that of the knob. */
  enter() {
    const { type, unit } = this.descriptor;
    const { value } = this.input;
    if (type === 'string') return this.send(value);
    const rest = this.firstOnly ? this.value.slice(1).map((one) => `${one} ${unit}`) : [];
    const text = this.firstOnly ? `[${[value, ...rest].join(';')};]` : value;
    return this.send({ text, unit: this.shown.factor === 1 ? unit : this.shown.unit });
  }

  sendNumber(number) {
    let value = number / this.shown.factor;
    // As it is typed, not as it is computed: 5 Hz is 31.4159265358979 rad/s to the last digit.
    if (this.descriptor.type === 'integer') value = Math.round(value);
    else if (this.shown.factor !== 1) value = Number(value.toPrecision(15));
    this.send(this.firstOnly ? [value, ...this.value.slice(1)] : value);
  }

  key(event) {
    if (event.key === 'Escape') {
      this.typing = false;
      this.fail('');
      this.show(true);
      return;
    }
    const turn = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!turn || !['double', 'integer', 'double_array'].includes(this.descriptor.type)) return;
    if (this.descriptor.type === 'double_array' && !this.firstOnly) return;
    // A number as it may be typed: with a comma, and a unit of its own
    const [, text, own] = /^\s*([-+\d.,eE]+)\s*(.*)$/.exec(this.input.value) ?? [];
    const number = Number(text?.replace(',', '.'));
    if (!Number.isFinite(number)) return;
    event.preventDefault();
    const step = this.descriptor.type === 'integer' ? 1 : (!own && this.span?.[2]) || 10 ** Math.floor(Math.log10(Math.abs(number) || 1) - 1);
    const next = Number((number + turn * step).toPrecision(12));
    this.input.value = own ? `${typed(next)} ${own}` : typed(next);
    if (own) this.enter();
    else this.sendNumber(next);
  }

  /** Send a value; while one is on its way, only the newest waits. */
  async send(value) {
    if (this.busy) {
      this.next = { value };
      return;
    }
    this.busy = true;
    const { name } = this.descriptor;
    const { ok, reason, values } = await this.knobs.set({ [name]: value });
    this.busy = false;
    this.fail(ok ? '' : reason);
    if (ok) {
      this.take(values[name], true);
      this.doubt();
    }
    if (this.next) {
      const { value: newest } = this.next;
      this.next = null;
      await this.send(newest);
    }
  }

  /** Show why a value was rejected. */
  fail(reason) {
    this.note(reason);
    this.input.setAttribute('aria-invalid', reason ? 'true' : 'false');
    this.place.classList.toggle('wrong', Boolean(reason));
  }

  /** Show a text under the knob. */
  note(text) {
    this.error.hidden = !text;
    write(this.error, text);
  }

  /** A value far from the usual ones may be meant in another unit. */
  doubt() {
    const [low, high] = this.descriptor.usual ?? [];
    if ([this.value].flat().some((one) => one && (one < low || one > high))) this.note(`This is far from usual. ${this.rangeText()}`);
  }

  /** Take in a value that the rig has. */
  take(value, own = false) {
    this.value = value;
    if (this.busy || this.next || this.typing) return;
    if (!own && document.activeElement === this.input && this.input.type === 'text' && this.place.classList.contains('wrong')) return;
    this.show();
    if (!own) {
      this.fail('');
      if (!reducedMotion()) {
        this.place.classList.remove('turned');
        requestAnimationFrame(() => this.place.classList.add('turned'));
      }
    }
  }

  /** Write a text into the field, unless one is being typed; a text that is selected as a whole stays so. */
  write(text) {
    const { input } = this;
    if (this.typing || input.value === text) return;
    const all = document.activeElement === input && input.selectionStart === 0 && input.selectionEnd === input.value.length;
    input.value = text;
    if (all) input.select();
  }

  show(force = false) {
    const { type } = this.descriptor;
    if (type === 'bool') this.input.checked = Boolean(this.value);
    else if (this.input.tagName === 'SELECT') this.input.value = this.value;
    else if (type === 'string') this.write(this.value);
    else if (type === 'double_array' && !this.firstOnly) {
      this.write(this.value.map((one) => typed(one * this.shown.factor)).join(', '));
    } else if (force || !this.dragging) this.write(typed(this.number, type === 'integer' ? 1e-15 : 5e-6));
    if (this.range && !this.dragging) {
      this.range.value = this.toSlider(this.number);
      mark(this.range, 'aria-valuetext', `${this.input.value} ${this.shown.unit}`);
    }
  }

  /** The unit of lengths, or the natural frequency, is another one. */
  rescale() {
    const { unit } = this.shown;
    this.shown = display(this.descriptor, this.knobs);
    // What is half typed was meant in the unit before.
    if (this.shown.unit !== unit) this.typing = false;
    write(this.unit, this.unitText());
    this.scaleSlider();
    this.show(true);
  }
}

export class Knobs {
  /** `set` sends values and returns the answer {ok, reason}. */
  constructor(set) {
    this.set = set;
    this.natural = 0;
    this.scale = { factor: 1, unit: 'm' };
    this.knobs = [];
    /** Whether the values are only shown. */
    this.locked = false;
    // The parameter that is dragged, and the number of the drag
    this.held = { name: '', number: 0 };
    byId('knob-search').addEventListener('input', () => this.filter());
  }

  /** Make knobs for all parameters of a rig. */
  make(descriptors) {
    const known = new Map(descriptors.map((one) => [one.name, one]));
    const [mass, stiffness] = [known.get('primary_mass')?.value, known.get('stiffness')?.value];
    this.natural = mass > 0 ? Math.sqrt(stiffness / mass) / TAU : 0;
    this.scale = lengthUnit(known.get('gap')?.value ?? 1);
    this.quantity = known.get('base_quantity')?.value;
    this.knobs = [];
    const first = byId('first-knobs');
    first.replaceChildren();
    for (const descriptor of descriptors.filter((one) => one.first).sort((one, other) => one.first.place - other.first.place)) {
      const { title, term: about } = descriptor.first;
      const knob = new Knob(descriptor, this, { title, about, slider: true });
      this.knobs.push(knob);
      first.append(knob.place);
    }
    const all = byId('all-knobs');
    all.replaceChildren();
    for (const [key, title] of GROUPS) {
      const members = descriptors.filter((one) => one.group === key);
      if (!members.length) continue;
      const group = element('fieldset', { class: 'group' }, element('legend', { text: title }));
      for (const descriptor of members) {
        const knob = new Knob(descriptor, this, { title: worded(descriptor.name) });
        this.knobs.push(knob);
        group.append(knob.place);
      }
      all.append(group);
    }
    const count = descriptors.length;
    byId('more-knobs').querySelector('summary').textContent = `All ${count} parameters`;
    this.filter();
  }

  /** Take in values that the rig has now. */
  take(values) {
    let anew = false;
    for (const knob of this.knobs) {
      const value = values[knob.descriptor.name];
      if (value === undefined || JSON.stringify(value) === JSON.stringify(knob.value)) continue;
      knob.take(value);
    }
    if ('gap' in values || 'primary_mass' in values || 'stiffness' in values) {
      const find = (name) => this.knobs.find((knob) => knob.descriptor.name === name)?.value;
      const natural = Math.sqrt(find('stiffness') / find('primary_mass')) / TAU || 0;
      // A knob that is turned keeps its unit: who has typed millimetres types millimetres next.
      const many = Object.keys(values).length > 2;
      const scale = many ? lengthUnit(find('gap') ?? 1) : this.scale;
      const far = Math.abs(Math.log((natural || 1) / (this.natural || 1))) > 0.05;
      anew = scale.unit !== this.scale.unit || far;
      this.natural = natural;
      if (anew) this.scale = scale;
    }
    if (values.base_quantity && values.base_quantity !== this.quantity) {
      this.quantity = values.base_quantity;
      anew = true;
    }
    for (const knob of this.knobs) {
      const outside = knob.range && !knob.dragging && (knob.number < knob.span[0] || knob.number > knob.span[1]);
      if (anew || outside) knob.rescale();
    }
  }

  /** Begin to drag a parameter, or end with none. */
  hold(name) {
    this.held = { name, number: this.held.number + 1 };
  }

  /** Number of the drag that has led to values; 0 if none has. */
  dragOf(values) {
    return this.held.name in values ? this.held.number : 0;
  }

  /** Turn a knob, as a drag of it would: while a value is on its way, only the newest waits. */
  turn(name, value) {
    this.knobs.find((knob) => knob.descriptor.name === name).send(value);
  }

  /** Present values by name. */
  values() {
    return Object.fromEntries(this.knobs.map((knob) => [knob.descriptor.name, knob.value]));
  }

  /** What was done to the rig, for the lines in the traces: the same for live and recorded rigs. */
  done({ kind, values = {}, preset = '' }) {
    const names = Object.keys(values).filter((name) => !SETTINGS.has(name) && !name.startsWith('initial_') && !this.padded(name, values[name]));
    const turned = names.length > 2
      ? preset || `${names.length} parameters`
      : names.map((name) => this.inWords(name, values[name])).join(', ');
    return [kind === 'reset' ? 'reset' : '', turned].filter(Boolean).join(', ');
  }

  /** Whether a list has only become as long as that of another knob. */
  padded(name, value) {
    const before = this.knobs.find((one) => one.descriptor.name === name)?.value;
    const trimmed = (list) => JSON.stringify(list.slice(0, list.findLastIndex((one) => one !== 0) + 1));
    return Array.isArray(value) && Array.isArray(before) && value.length !== before.length && trimmed(value) === trimmed(before);
  }

  /** Name for people, and a value with its unit, for the lines in the traces. */
  inWords(name, value) {
    const knob = this.knobs.find((one) => one.descriptor.name === name);
    if (!knob) return `${name} ${value}`;
    const { unit, factor } = knob.shown;
    const text = (one) => (typeof one === 'number' ? digits(one * factor, 4).replace(/(\.\d*?)0+$/, '$1').replace(/\.$/, '') : String(one).slice(0, 40));
    const shown = Array.isArray(value) ? value.slice(0, 3).map(text).join(', ') : text(value);
    const symbol = knob.descriptor.first?.symbol ?? name.replace(/_/g, ' ');
    return `${symbol} = ${shown}${knob.unitText() ? ` ${unit}` : ''}`;
  }

  /** Show only parameters whose name or meaning has the words searched for. */
  filter() {
    const words = byId('knob-search').value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const group of document.querySelectorAll('#all-knobs .group')) {
      let some = false;
      for (const row of group.querySelectorAll('.knob')) {
        const text = `${row.dataset.name} ${row.dataset.name.replace(/_/g, ' ')} ${row.title}`.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        some ||= !row.hidden;
      }
      group.hidden = !some;
    }
  }
}
