// SPDX-License-Identifier: Apache-2.0
// What the rig does in words and numbers: verdict, measured and predicted Xmax/A, first numbers.

import { all, byId, mark, overflowing, reducedMotion, toast, write } from '../dom.js';
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

class Verdict {
  constructor() {
    this.values = Object.fromEntries(all('[data-number]').map((place) => [place.dataset.number, place]));
    const boxes = ['.verdict', '.words'].map((one) => document.querySelector(one));
    const looks = boxes.map(overflowing);
    this.goesOn = () => looks.forEach((look) => look());
    byId('more').addEventListener('click', () => boxes[0].scrollBy({ top: 0.7 * boxes[0].clientHeight, behavior: reducedMotion() ? 'auto' : 'smooth' }));
  }

  clear() {
    write(byId('verdict-text'), 'waiting for the rig');
    byId('verdict-text').dataset.level = 'none';
    for (const id of ['motion-text', 'theory-text']) write(byId(id), '');
    byId('totals').hidden = true;
    this.numbers({}, { best: {} });
  }

  /** Beside a recording there is no live prediction. */
  recorded() {
    write(byId('verdict-text'), 'Recording');
    this.line('motion-text', 'To check it against theory: Recordings, then Compare.');
  }

  /** What the recorded run and the what-if amount to, once the latter is computed. */
  whatIf({ totals, done, on, text }) {
    const table = byId('totals');
    const known = on && done && totals?.what_if;
    table.hidden = !known;
    byId('clear-ghost').hidden = !on;
    this.line('theory-text', known ? `What if: ${text}` : on ? 'What if: computing' : '');
    if (!known) return;
    const { recorded, what_if: other } = totals;
    for (const row of all('[data-total]', table)) {
      const key = row.dataset.total;
      const [before, after, ratio] = row.querySelectorAll('td');
      [before.textContent, after.textContent] = [recorded, other].map((one) => TOTALS[key](one[key]));
      ratio.textContent = recorded[key] ? digits(other[key] / recorded[key], 3) : '–';
    }
  }

  ratio(key, value) {
    const [bar, place] = all(`#ratios .gauge.${key}, #ratios .gauge.${key} + dd`);
    write(place, digits(value, 3));
    bar.firstChild.style.transform = `scaleX(${Math.min(1, value || 0).toFixed(4)})`;
  }

  /** What the node reports of the motion, and theory of it. */
  diagnostics(report, theory) {
    const { words, shade, measured, predicted } = verdictInWords(report, theory);
    write(byId('verdict-text'), words);
    byId('verdict-text').dataset.level = shade;
    this.line('motion-text', measured);
    this.line('theory-text', predicted);
  }

  line(id, text) {
    const place = byId(id);
    write(place, text);
    mark(place, 'title', text);
    this.goesOn();
  }

  numbers(message, theory) {
    const { gap: best, bound } = theory.best;
    message = { ...message, gap_ratio: best > 0 ? message.gap / best : null, bound };
    for (const [key, format] of Object.entries(NUMBERS)) write(this.values[key], format(message[key], message));
    const [, origin] = BEYOND[best > 0 ? bound : ''] ?? ['', ''];
    mark(this.values.gap_ratio, 'title', origin);
    this.values.gap_ratio.classList.toggle('preliminary', Boolean(origin));
    this.ratio('measured', message.x_max_ratio);
    this.ratio('predicted', theory.orbit?.x_max_ratio);
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store) => {
  const panel = new Verdict();
  const { theory } = store;
  const report = () => {
    if (!store.isLive || !store.diagnostics) return;
    panel.diagnostics(store.diagnostics, theory);
    // Without a measured motion the verdict has all of it.
    byId('theory-text').hidden = store.isInPage && !theory.failed;
  };
  store.on('hello', () => {
    panel.clear();
    if (!store.isLive) panel.recorded();
  });
  store.on('diagnostics theory', report);
  store.on('numbers theory', () => panel.numbers(store.numbers, theory));
  store.on('what_if', (message) => {
    panel.whatIf(message);
    if (!message.on && message.text) toast(message.text, 'bad');
  });
};
