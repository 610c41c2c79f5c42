// SPDX-License-Identifier: Apache-2.0
// What the rig does in words and numbers: verdict, measured and predicted Xmax/A, first numbers.

import { all, byId, mark, showShare, toast, write } from '../dom.js';
import { digits, withUnit } from '../format.js';
import { verdictInWords } from '../words.js';

/** @type {Record<string, (value: number, message: any) => string>} */
const NUMBERS = {
  natural_frequency_hz: (value) => withUnit(value, 'Hz'),
  damping_ratio: (value) => digits(value, 3),
  frequency_ratio: (value) => digits(value, 4),
  static_amplitude: (value) => withUnit(value, 'm'),
  mass_ratio: (value) => digits(value, 3),
  gap_ratio: (value, { bound }) => about(digits(value, 3), bound),
  impacts_per_cycle: (value) => digits(value, 3),
  energy_per_cycle: (value) => withUnit(value, 'J'),
};
/** A best gap beyond the curve: the sign of its ratio, and where it is. */
const BEYOND = {
  'at least': ['≤', 'M moves least at the largest gap of the curve: the best gap is beyond'],
  'at most': ['≥', 'M moves least at the smallest gap of the curve: the best gap is beyond'],
};
const about = (text, bound) => (bound in BEYOND && text !== '–' ? `${BEYOND[bound][0]}\u202f${text}` : text);
/** Numbers of a what-if, as `replay_run --set` prints them. */
const TOTALS = { x_max: (value) => withUnit(value, 'm', 4), x_rms: (value) => withUnit(value, 'm', 4), impacts: String };

/** Write a text, which is whole in its tooltip where there is no room for it. */
function line(id, text) {
  write(byId(id), text);
  mark(byId(id), 'title', text);
}

/** Show the verdict, its shade, and a line each on the measured and the predicted motion. */
function show({ words, shade = 'none', measured = '', predicted = '' }) {
  write(byId('verdict-text'), words);
  byId('verdict-text').dataset.level = shade;
  line('motion-text', measured);
  line('theory-text', predicted);
}

/** What the recorded run and the what-if amount to, once the latter is computed. */
function showWhatIf({ totals, done, on, text }) {
  const table = byId('totals');
  const known = on && done && totals?.what_if;
  table.hidden = !known;
  byId('clear-ghost').hidden = !on;
  line('theory-text', known ? `What if: ${text}` : on ? 'What if: computing' : '');
  if (!known) return;
  const { recorded, what_if: other } = totals;
  for (const row of all('[data-total]', table)) {
    const key = row.dataset.total;
    const [before, after, ratio] = row.querySelectorAll('td');
    [before.textContent, after.textContent] = [recorded, other].map((one) => TOTALS[key](one[key]));
    ratio.textContent = recorded[key] ? digits(other[key] / recorded[key], 3) : '–';
  }
}

function showNumbers(message, theory) {
  const { gap: best, bound } = theory.best;
  message = { ...message, gap_ratio: best > 0 ? message.gap / best : null, bound };
  for (const place of all('[data-number]')) write(place, NUMBERS[place.dataset.number](message[place.dataset.number], message));
  const [, origin] = BEYOND[best > 0 ? bound : ''] ?? ['', ''];
  const ratio = document.querySelector('[data-number=gap_ratio]');
  mark(ratio, 'title', origin);
  ratio.classList.toggle('preliminary', Boolean(origin));
  const shares = { measured: message.x_max_ratio, predicted: theory.orbit?.x_max_ratio };
  for (const row of all('[data-ratio]')) showShare(row, shares[row.dataset.ratio], digits(shares[row.dataset.ratio], 3));
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store) => {
  const { theory } = store;
  store.on('hello', () => {
    byId('totals').hidden = true;
    // Beside a recording there is no live prediction.
    show(store.isLive ? { words: 'waiting for the rig' } : { words: 'Recording', measured: 'To check it against theory: Recordings, then Compare.' });
  });
  store.on('diagnostics theory', () => {
    if (!store.isLive || !store.diagnostics) return;
    show(verdictInWords(store.diagnostics, theory));
    // Without a measured motion the verdict has all of it.
    byId('theory-text').hidden = store.isInPage && !theory.failed;
  });
  store.on('numbers theory', () => showNumbers(store.numbers, theory));
  store.on('what_if', (message) => {
    showWhatIf(message);
    if (!message.on && message.text) toast(message.text, 'bad');
  });
};
