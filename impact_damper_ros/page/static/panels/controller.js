// SPDX-License-Identifier: Apache-2.0
// What moves the stops: the controller's last command, its score, and faults to try it under.

import { all, byId, element, mark, write, writeNumbers } from '../dom.js';
import { digits, withUnit } from '../format.js';

const FAULTS = [['sensor_fault', 'Sensors'], ['actuator_fault', 'Stops']];

/** Make a switch for each fault of a rig. */
function makeFaults(descriptors, turn) {
  byId('faults').replaceChildren(...FAULTS.flatMap(([name, title]) => {
    const { choices = [], description } = descriptors.find((one) => one.name === name) ?? {};
    const switches = choices.filter((choice) => choice !== 'none').map((choice) => element('button', {
      type: 'button', value: choice, 'data-steers': '', text: choice.replace('stop_', '').replace(/_/g, ' '), title: choice.replace(/_/g, ' '), 'aria-pressed': 'false',
      onclick: ({ currentTarget }) => turn({ [name]: currentTarget.ariaPressed === 'true' ? 'none' : choice }),
    }));
    const legend = element('legend', { text: title });
    return switches.length ? [element('fieldset', { 'data-fault': name, title: description }, legend, ...switches)] : [];
  }));
}

/** Show what the node reports of a controller outside of it. */
function showReport(report) {
  const place = byId('command-age');
  const age = report?.age ?? NaN;
  write(place, report ? `Controller: ${report.text}${Number.isFinite(age) ? `, ${withUnit(age, 's', 2)} ago` : ''}` : '');
  mark(place, 'data-level', report?.level ?? 'ok');
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  store.on('hello', () => {
    makeFaults(store.hello.parameters, (values) => actions.turn(values));
    showReport(null);
  });
  store.on('values', () => {
    document.body.classList.toggle('controlled', (store.values.gap_control ?? 'off') !== 'off');
    for (const button of all('#faults button')) mark(button, 'aria-pressed', String(store.values[button.parentElement.dataset.fault] === button.value));
  });
  store.on('diagnostics', () => showReport(store.diagnostics.controller));
  store.on('numbers', () => {
    // What has been achieved in the last minute
    const { score } = store.numbers;
    write(byId('score-title'), score ? `Last ${digits(score.seconds, 2)} s` : 'Last minute');
    writeNumbers('#score dd', score);
  });
};
