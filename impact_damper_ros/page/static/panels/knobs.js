// SPDX-License-Identifier: Apache-2.0
// Knobs made from the descriptors of the parameters: degrees and hertz for people, SI for the rig.

import { all, byId, element, mark, reducedMotion, write } from '../dom.js';
import { capital, digits, typed, withUnit } from '../format.js';
import { term } from '../glossary.js';
import { readTyped, SliderScale } from '../slider.js';

const GROUPS = [
  ['rig', 'Rig'],
  ['forcing', 'Force'],
  ['control', 'Gap control'],
  ['run', 'Run'],
];

/** One knob: a label, a number, and for the first ones a slider. */
class Knob {
  constructor(descriptor, knobs, { title, about = '', slider = false }) {
    this.descriptor = descriptor;
    this.knobs = knobs;
    this.slider = slider;
    this.value = descriptor.value;
    this.busy = false;
    this.next = null;
    this.shown = knobs.store.units.of(descriptor);
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
    const shown = unit === 'm' ? '' : this.shown.unit;
    return `${usual ? 'Usually' : 'From'} ${text(low)} to ${text(high)}${shown && `\u202f${shown}`}.${units.length > 1 ? ` Units: ${units.join(', ')}.` : ''}`;
  }

  unitText() {
    const { type, zero } = this.descriptor;
    if (zero && this.value === 0) return zero;
    return type === 'string' || type === 'bool' ? '' : this.shown.unit;
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
      if (!this.dragging) {
        this.knobs.store.grab(this.descriptor.name);
        byId('curve').classList.toggle('above', this.range.getBoundingClientRect().top > innerHeight / 2);
      }
      this.dragging = true;
      const number = this.scale.at(Number(this.range.value) / 1000);
      this.input.value = typed(number, 1e-4);
      this.sendNumber(number);
    });
    const done = () => {
      this.dragging = false;
      this.knobs.store.grab('');
      this.show();
    };
    this.range.addEventListener('change', done);
    this.range.addEventListener('blur', done);
    this.place.append(this.range);
    this.scaleSlider();
  }

  /** Choose the range of the slider about what the knob stands at. */
  scaleSlider() {
    if (this.range) this.scale = new SliderScale(this.descriptor, this.number, this.shown.factor, this.knobs.store.units.natural);
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
    const { number, own } = readTyped(this.input.value);
    if (!Number.isFinite(number)) return;
    event.preventDefault();
    const step = this.descriptor.type === 'integer' ? 1 : (!own && this.scale?.span[2]) || 10 ** Math.floor(Math.log10(Math.abs(number) || 1) - 1);
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
    write(this.unit, this.unitText());
    if (this.range && !this.dragging) {
      this.range.value = String(Math.round(1000 * this.scale.of(this.number)));
      mark(this.range, 'aria-valuetext', `${this.input.value} ${this.unitText()}`);
    }
  }

  /** The unit of lengths, or the natural frequency, is another one. */
  rescale() {
    const { unit } = this.shown;
    this.shown = this.knobs.store.units.of(this.descriptor);
    // What is half typed was meant in the unit before.
    if (this.shown.unit !== unit) this.typing = false;
    this.scaleSlider();
    this.show(true);
  }
}

export class Knobs {
  /**
   * @param {import('../store.js').Store} store
   * @param {(values: import('../messages.js').Values) => Promise<import('../messages.js').Answer>} set
   */
  constructor(store, set) {
    this.store = store;
    this.set = set;
    /** @type {Knob[]} */
    this.knobs = [];
    /** Whether the values are only shown. */
    this.locked = false;
    byId('knob-search').addEventListener('input', () => this.filter());
  }

  /** Make knobs for all parameters of a rig. */
  make(descriptors) {
    this.knobs = [];
    const first = byId('first-knobs');
    first.replaceChildren();
    for (const descriptor of descriptors.filter((one) => one.first).sort((one, other) => one.first.place - other.first.place)) {
      const { title, term: about } = descriptor.first;
      const knob = new Knob(descriptor, this, { title, about, slider: true });
      this.knobs.push(knob);
      first.append(knob.place);
    }
    const rest = byId('all-knobs');
    rest.replaceChildren();
    for (const [key, title] of GROUPS) {
      const members = descriptors.filter((one) => one.group === key);
      if (!members.length) continue;
      const group = element('fieldset', { class: 'group' }, element('legend', { text: title }));
      for (const descriptor of members) {
        const knob = new Knob(descriptor, this, { title: capital(descriptor.name.replace(/_/g, ' ')) });
        this.knobs.push(knob);
        group.append(knob.place);
      }
      rest.append(group);
    }
    const count = descriptors.length;
    byId('more-knobs').querySelector('summary').textContent = `All ${count} parameters`;
    this.filter();
  }

  /** Take in values that the rig has now; a knob that makes the what-if another rig stays where it is, unless they are its own. */
  take(values, own = false) {
    for (const knob of this.knobs) {
      const { name } = knob.descriptor;
      const value = values[name];
      if (value === undefined || (!own && name in this.store.whatIf) || JSON.stringify(value) === JSON.stringify(knob.value)) continue;
      knob.take(value);
    }
    this.rescale(false);
  }

  /** Choose the ranges anew, all or those that do not reach a value. */
  rescale(all) {
    for (const knob of this.knobs) {
      const outside = knob.range && !knob.dragging && knob.scale.misses(knob.number);
      if (all || outside) knob.rescale();
    }
  }

  /** Turn a knob, as a drag of it would: while a value is on its way, only the newest waits. */
  turn(name, value) {
    this.knobs.find((knob) => knob.descriptor.name === name).send(value);
  }

  /** Present values by name. */
  values() {
    return Object.fromEntries(this.knobs.map((knob) => [knob.descriptor.name, knob.value]));
  }

  /** Show only parameters whose name or meaning has the words searched for. */
  filter() {
    const words = byId('knob-search').value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const group of all('#all-knobs .group')) {
      let some = false;
      for (const row of all('.knob', group)) {
        const text = `${row.dataset.name} ${row.dataset.name.replace(/_/g, ' ')} ${row.title}`.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        some ||= !row.hidden;
      }
      group.hidden = !some;
    }
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const knobs = new Knobs(store, (values) => actions.set(values));
  store.on('hello', () => {
    knobs.locked = store.isLive && !store.hello.steers;
    write(byId('knobs-title'), store.isLive ? 'Knobs' : 'What if');
    byId('clear-ghost').hidden = true;
    knobs.make(store.hello.parameters);
  });
  store.on('values', (values) => knobs.take(values));
  // Those of a what-if are not the rig's own.
  store.on('turned', (values) => knobs.take(values, true));
  store.on('units', () => knobs.rescale(true));
  store.on('whatIf', () => {
    const none = !Object.keys(store.whatIf).length;
    byId('clear-ghost').hidden = none;
    if (none) knobs.make(store.hello.parameters);
  });
  byId('clear-ghost').addEventListener('click', () => actions.clearWhatIf());
  // Where there is room for it, all parameters are in view.
  byId('more-knobs').open = matchMedia('(min-width: 110rem) and (min-height: 50rem)').matches;
  return knobs;
};
