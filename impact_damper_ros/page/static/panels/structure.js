// SPDX-License-Identifier: Apache-2.0
// "My structure": what people know of theirs, its best gap, and what the damper leaves of the vibration.

import { all, byId, mark, showShare, write } from '../dom.js';
import { digits, withUnit } from '../format.js';

/** What is typed. */
const typed = () => Object.fromEntries(/** @type {any} */ (new FormData(byId('structure-form'))));

/** Show what is wrong with a field; without one, below all of them. */
function fail(name = '', reason = '') {
  const inputs = all('#structure-form input');
  for (const input of inputs) {
    const wrong = input.name === name ? reason : '';
    write(byId(`${input.id}-error`), wrong);
    mark(input, 'aria-invalid', String(Boolean(wrong)));
  }
  const elsewhere = inputs.every((input) => input.name !== name) ? reason : '';
  byId('structure-result').classList.toggle('stale', reason !== elsewhere);
  write(byId('structure-error'), elsewhere);
  if (elsewhere) write(byId('structure-gap'), '');
}

function show(design) {
  const { gap, x_max: left, without, mass_damper: other } = design;
  const rows = all('#structure-result .ratios div');
  write(byId('structure-gap'), `Best gap ${withUnit(gap, 'm')}, with ${withUnit(1000 * design.damper_mass, 'g')}`);
  [without, other, left].forEach((size, n) => showShare(rows[n], size / without, `${withUnit(size, 'm')}, ${digits((100 * size) / without, 3)} %`));
  const texts = {
    start: design.reached
      ? 'From rest the damper starts by itself.'
      : `A gap of ${withUnit(design.best_gap, 'm')} would leave ${withUnit(design.best_x_max, 'm')}, but from rest the rig does not come to that motion: m would need a push.`,
    levels: `m hits a stop at up to ${withUnit(design.impact_speed, 'm/s', 2)}. With the best gap the motion lasts for levels from ${digits(design.level_low, 2)} to ${digits(design.level_high, 3)} times this one.`,
    note: design.note,
    command: design.command,
  };
  for (const place of all('#structure-result [data-text]')) write(place, texts[place.dataset.text]);
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const form = byId('structure-form');
  let looking = /** @type {Promise<import('../messages.js').Answer> | null} */ (null);
  /** Show the best gap of what is typed, and return the answer; what is typed meanwhile is asked for when that comes. */
  const look = () => {
    const ask = async () => {
      let [values, answer] = [{}, /** @type {import('../messages.js').Answer} */ (null)];
      do {
        values = typed();
        answer = await actions.connection.ask({ type: 'structure', values });
      } while (JSON.stringify(values) !== JSON.stringify(typed()));
      looking = null;
      fail(answer.field, answer.ok ? '' : answer.reason);
      if (answer.ok) show(answer.design);
      return answer;
    };
    looking ??= ask();
    return looking;
  };
  form.addEventListener('input', ({ target }) => {
    if (target === form.elements.shaken) {
      write(byId('structure-size-unit'), target.selectedOptions[0].dataset.unit);
      form.elements.size.select();
    }
    look();
  });
  form.addEventListener('submit', async (event) => {
    event.preventDefault();
    // Set the rig to what is typed.
    const found = await look();
    if (!found.ok) return form.elements[found.field]?.focus();
    const { ok, reason } = await actions.beginDesign(found.design, found.values);
    return ok || fail('', reason);
  });
  byId('structure-open').addEventListener('click', () => {
    root.showModal();
    look();
  });
};
