// SPDX-License-Identifier: Apache-2.0
// Knobs made from the descriptors of the parameters: degrees and hertz for people, SI for the rig.

import { all, byId, element, mark, write } from '../dom.js';
import { capital, digits, typed, withUnit } from '../format.js';
import { term } from '../glossary.js';
import { readTyped, SliderScale } from '../slider.js';

/** @import { Answer, Descriptor, Values } from '../messages.js' */

const GROUPS = [['rig', 'Rig'], ['forcing', 'Force'], ['control', 'Gap control'], ['run', 'Run']];

/** One knob: a label, a number, and for the first ones a slider. */
class Knob {
  constructor(descriptor, knobs, { title, about = '', slider = false }) {
    this.descriptor = descriptor;
    this.knobs = knobs;
    this.slider = slider;
    const { values, whatIf, units } = knobs.store;
    this.value = { ...values, ...whatIf }[descriptor.name];
    this.busy = false;
    this.next = null;
    this.shown = units.of(descriptor);
    const { name, type, choices = [] } = descriptor;
    this.id = `${slider ? 'knob' : 'parameter'}-${name}`;
    const help = [descriptor.description, this.rangeText(), descriptor.read_only ? 'Set at the start of the node.' : ''].filter(Boolean).join(' ');
    this.error = element('p', { class: 'error', id: `${this.id}-error`, role: 'alert' });
    const shared = { id: this.id, disabled: descriptor.read_only || knobs.locked, 'aria-describedby': `${this.id}-help ${this.id}-error` };
    if (type === 'bool') {
      this.input = element('input', { type: 'checkbox', ...shared, onchange: () => this.send(this.input.checked) });
    } else if (choices.length) {
      const options = choices.map((choice) => element('option', { value: choice, text: choice.replace(/_/g, ' ') }));
      this.input = element('select', { ...shared, onchange: () => this.send(this.input.value) }, ...options);
    } else {
      this.input = element('input', {
        type: 'text', autocomplete: 'off', spellcheck: 'false', inputmode: ['string', 'double_array'].includes(type) ? 'text' : 'decimal', ...shared,
        // What is being typed is not overwritten by a value that comes in meanwhile.
        oninput: () => { this.typing = true; },
        onchange: () => { this.typing = false; this.enter(); },
        onblur: () => {
          if (this.typing) this.forget();
          write(this.error, '');
        },
        onkeydown: (event) => this.key(event),
        onfocus: () => {
          this.input.select();
          if (!this.error.textContent) write(this.error, this.rangeText());
        },
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
    if (slider && type !== 'bool' && !choices.length) this.addSlider(title);
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
    if (choices?.length || type === 'bool' || (low ?? null) === null) return '';
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
    const done = () => {
      this.dragging = false;
      this.knobs.store.grab('');
      this.show();
    };
    const drag = () => {
      if (!this.dragging) {
        this.knobs.store.grab(this.descriptor.name);
        byId('curve').classList.toggle('above', this.range.getBoundingClientRect().top > innerHeight / 2);
      }
      this.dragging = true;
      const number = this.scale.at(Number(this.range.value) / 1000);
      this.input.value = typed(number, 1e-4);
      this.sendNumber(number);
    };
    this.range = element('input', {
      type: 'range', min: 0, max: 1000, step: 1, 'aria-label': `${title}, slider`, tabindex: 0, disabled: this.input.disabled, oninput: drag, onchange: done, onblur: done,
    });
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
      this.fail('');
      this.forget();
      return;
    }
    const turn = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!turn || !(['double', 'integer'].includes(this.descriptor.type) || this.firstOnly)) return;
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
    this.next = { value };
    while (this.next && !this.busy) {
      const { name } = this.descriptor;
      [value, this.next, this.busy] = [this.next.value, null, true];
      const { ok, reason, values } = await this.knobs.set({ [name]: value });
      this.busy = false;
      this.fail(ok ? '' : reason);
      if (ok) {
        this.take(values[name], true);
        this.doubt();
      }
    }
  }

  /** Show why a value was rejected. */
  fail(reason) {
    write(this.error, reason);
    this.input.setAttribute('aria-invalid', reason ? 'true' : 'false');
    this.place.classList.toggle('wrong', Boolean(reason));
  }

  /** A value far from the usual ones may be meant in another unit. */
  doubt() {
    const [low, high] = this.descriptor.usual ?? [];
    if ([this.value].flat().some((one) => one && (one < low || one > high))) write(this.error, `This is far from usual. ${this.rangeText()}`);
  }

  /** Take in a value that the rig has. */
  take(value, own = false) {
    this.value = value;
    if (this.busy || this.next || this.typing) return;
    if (!own && document.activeElement === this.input && this.input.type === 'text' && this.place.classList.contains('wrong')) return;
    this.show();
    if (own) return;
    this.fail('');
    this.place.classList.remove('turned');
    requestAnimationFrame(() => this.place.classList.add('turned'));
  }

  /** Write a text into the field, unless one is being typed; a text that is selected as a whole stays so. */
  write(text) {
    const { input } = this;
    if (this.typing || input.value === text) return;
    const all = document.activeElement === input && input.selectionStart === 0 && input.selectionEnd === input.value.length;
    input.value = text;
    if (all) input.select();
  }

  /** Show the value of the rig in place of what is being typed. */
  forget() {
    this.typing = false;
    this.show(true);
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
  knobs = /** @type {Knob[]} */ ([]);

  descriptors = /** @type {Descriptor[]} */ ([]);

  /** Whether the values are only shown. */
  locked = false;

  constructor(/** @type {import('../store.js').Store} */ store, /** @type {(values: Values) => Promise<Answer>} */ set) {
    this.store = store;
    this.set = set;
    byId('knob-search').addEventListener('input', () => this.filter());
    byId('more-knobs').addEventListener('toggle', () => this.makeRest());
  }

  /** Make the first knobs of a rig, and the others once they are looked at. */
  make(descriptors) {
    this.descriptors = descriptors;
    this.knobs = [];
    const first = descriptors.filter((one) => one.first).sort((one, other) => one.first.place - other.first.place);
    byId('first-knobs').replaceChildren(...first.map((one) => this.made(one, { title: one.first.title, about: one.first.term, slider: true })));
    byId('more-knobs').querySelector('summary').textContent = `All ${descriptors.length} parameters`;
    byId('all-knobs').replaceChildren();
    this.makeRest();
  }

  makeRest() {
    const place = byId('all-knobs');
    if (!byId('more-knobs').open || place.firstChild) return;
    place.append(...GROUPS.map(([key, title]) => element(
      'fieldset',
      { class: 'group' },
      element('legend', { text: title }),
      ...this.descriptors.filter((one) => one.group === key).map((one) => this.made(one, { title: capital(one.name.replace(/_/g, ' ')) })),
    )));
    this.filter();
  }

  made(descriptor, options) {
    const knob = new Knob(descriptor, this, options);
    this.knobs.push(knob);
    return knob.place;
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

  /** Show only parameters whose name or meaning has the words searched for. */
  filter() {
    const words = byId('knob-search').value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of all('#all-knobs .knob')) {
      const text = `${row.dataset.name} ${row.dataset.name.replace(/_/g, ' ')} ${row.title}`.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
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
