// SPDX-License-Identifier: Apache-2.0
// What the rig does in words and numbers: verdict, measured and predicted Xmax/A, first numbers.

import { all, byId, mark, showShare, toast, write, writeLine, writeNumbers } from '../dom.js';
import { digits } from '../format.js';
import { verdictInWords } from '../words.js';

/** A best gap beyond the curve: the sign of its ratio, and where it is. */
const BEYOND = {
  'at least': ['≤', 'M moves least at the largest gap of the curve: the best gap is beyond'],
  'at most': ['≥', 'M moves least at the smallest gap of the curve: the best gap is beyond'],
};

/** Show the verdict, its shade, and a line each on the measured and the predicted motion. */
function show({ words, shade = 'none', measured = '', predicted = '' }) {
  write(byId('verdict-text'), words);
  byId('verdict-text').dataset.level = shade;
  writeLine(byId('motion-text'), measured);
  writeLine(byId('theory-text'), predicted);
}

/** What the recorded run and the what-if amount to, once the latter is computed. */
function showWhatIf({ totals, done, on, text }) {
  const known = on && done && totals?.what_if;
  byId('totals').hidden = !known;
  byId('clear-ghost').hidden = !on;
  writeLine(byId('theory-text'), known ? `What if: ${text}` : on ? 'What if: computing' : '');
  if (!known) return;
  const { recorded, what_if: other } = totals;
  const ratio = Object.fromEntries(Object.keys(other).map((key) => [key, recorded[key] ? other[key] / recorded[key] : NaN]));
  for (const [run, numbers] of Object.entries({ recorded, other, ratio })) writeNumbers(`#totals [data-run=${run}]`, numbers);
}

function showNumbers(numbers, theory) {
  const { gap: best, bound } = theory.best;
  writeNumbers('#numbers dd', { ...numbers, gap_ratio: best > 0 ? numbers.gap / best : null });
  const [sign, origin] = BEYOND[best > 0 ? bound : ''] ?? ['', ''];
  const ratio = document.querySelector('[data-number=gap_ratio]');
  mark(ratio, 'title', origin);
  mark(ratio, 'data-sign', sign);
  const shares = { measured: numbers.x_max_ratio, predicted: theory.orbit?.x_max_ratio };
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
