// SPDX-License-Identifier: Apache-2.0
// "My structure": what people know of theirs, its best gap, and what the damper leaves of the vibration.

import { all, byId, element, write } from '../dom.js';
import { digits, withUnit } from '../format.js';

const share = (value) => `${digits(100 * value, 3)} %`;

class Structure {
  /** `ask` sends a request and returns the answer; `set` sets the rig to a design and its values, and does so too. */
  constructor(ask, set) {
    this.ask = ask;
    this.set = set;
    this.looking = /** @type {Promise<import('../messages.js').Answer> | null} */ (null);
    const form = byId('structure-form');
    this.inputs = Object.fromEntries(all('input', form).map((input) => [input.name, { input, error: byId(`${input.id}-error`) }]));
    this.shaken = byId('structure-shaken');
    this.shaken.addEventListener('change', () => {
      write(byId('structure-size-unit'), this.shaken.selectedOptions[0].dataset.unit);
      this.inputs.size.input.select();
    });
    form.addEventListener('input', () => this.look());
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.send();
    });
  }

  open() {
    byId('structure').showModal();
    this.look();
  }

  get typed() {
    const values = Object.fromEntries(Object.entries(this.inputs).map(([name, { input }]) => [name, input.value]));
    return { ...values, shaken: this.shaken.value };
  }

  /** Show what is wrong with a field; without one, below all of them. */
  fail(name = '', reason = '') {
    for (const { input, error } of Object.values(this.inputs)) {
      error.hidden = true;
      input.setAttribute('aria-invalid', 'false');
    }
    const place = this.inputs[name];
    if (place && reason) {
      write(place.error, reason);
      place.error.hidden = false;
      place.input.setAttribute('aria-invalid', 'true');
    }
    const result = byId('structure-result');
    result.classList.toggle('stale', Boolean(place && reason));
    if (reason && !place) result.replaceChildren(element('p', { class: 'error', role: 'alert', text: reason }));
  }

  /** Show the best gap of what is typed, and return the answer; what is typed meanwhile is asked for when that comes. */
  look() {
    const look = async () => {
      let [values, answer] = [this.typed, await this.ask({ type: 'structure', values: this.typed })];
      while (JSON.stringify(values) !== JSON.stringify(this.typed)) {
        values = this.typed;
        answer = await this.ask({ type: 'structure', values });
      }
      this.looking = null;
      this.fail(answer.field, answer.ok ? '' : answer.reason);
      if (answer.ok) this.show(answer.design, answer.values);
      return answer;
    };
    this.looking ??= look();
    return this.looking;
  }

  /** Set the rig to what is typed. */
  async send() {
    const found = await this.look();
    if (!found.ok) {
      this.inputs[found.field]?.input.focus();
      return;
    }
    const { ok, reason } = await this.set(found.design, found.values);
    if (!ok) this.fail('', reason);
  }

  show(design, values) {
    const { gap, x_max: left, without, mass_damper: other } = design;
    const bar = (name, size, kind) => element(
      'div',
      {},
      element('dt', { text: name }),
      element('dd', { class: 'gauge', 'aria-hidden': 'true' }, element('span', { class: `fill ${kind}`, 'data-share': String(Math.min(1, size / without)) })),
      element('dd', { text: `${withUnit(size, 'm')}, ${share(size / without)}` }),
    );
    const bars = element(
      'dl',
      { class: 'ratios' },
      bar('no damper', without, 'none'),
      bar('tuned mass damper', other, 'predicted'),
      bar('impact damper', left, 'measured'),
    );
    for (const fill of bars.querySelectorAll('.fill')) fill.style.transform = `scaleX(${fill.dataset.share})`;
    const texts = [
      design.reached
        ? 'From rest the damper starts by itself.'
        : `A gap of ${withUnit(design.best_gap, 'm')} would leave ${withUnit(design.best_x_max, 'm')}, but from rest the rig does not come to that motion: m would need a push.`,
      `m hits a stop at up to ${withUnit(design.impact_speed, 'm/s', 2)}. With the best gap the motion lasts for levels from ${digits(design.level_low, 2)} to ${digits(design.level_high, 3)} times this one.`,
      design.note,
    ].filter(Boolean);
    byId('structure-result').replaceChildren(
      element('h3', { text: `Best gap ${withUnit(gap, 'm')}, with ${withUnit(1000 * design.damper_mass, 'g')}` }),
      bars,
      ...texts.map((text) => element('p', { text })),
      element('p', { class: 'quiet', text: 'In a terminal, for a range of masses and uncertain R and level, with a test plan:' }),
      element('pre', {}, element('code', { text: this.command(values) })),
    );
  }

  /** The command that designs the same damper. */
  command(values) {
    const typed = (name, unit) => {
      const text = this.inputs[name].input.value.trim().replace(/\s+/g, '').replace(',', '.');
      return /[a-z%]$/i.test(text) ? text : text + unit;
    };
    const base = this.shaken.value === 'acceleration' ? 'g' : 'mm';
    const shaken = values.base_amplitudes.some(Boolean) ? `--base ${typed('size', base)}` : `--force ${digits(values.force_amplitudes[0], 4)}`;
    const structure = `--mass ${typed('mass', 'kg')} --frequency ${typed('frequency', 'Hz')} --damping-ratio ${typed('damping', '%')}`;
    return `design_damper ${structure} ${shaken} --restitution ${typed('restitution', '')}`;
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const panel = new Structure(
    (message) => actions.connection.ask(message),
    (design, values) => actions.beginDesign(design, values),
  );
  store.on('hello', () => { byId('structure-open').hidden = !store.hello.designs; });
  byId('structure-open').addEventListener('click', () => {
    byId('presets').hidePopover();
    panel.open();
  });
};
