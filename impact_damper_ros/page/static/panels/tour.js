// SPDX-License-Identifier: Apache-2.0
// Six steps through the page, each with something to try.

import { byId, toast } from '../dom.js';

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  /** Gap control before the tour switched it on; null if it has not. */
  let control = null;
  const widen = (factor) => {
    const gap = store.values.gap * factor;
    if (gap > 0) actions.turn({ gap: Number(gap.toPrecision(3)) });
  };
  const optimum = () => {
    const best = store.theory.best.gap;
    if (best > 0) actions.turn({ gap: Number(best.toPrecision(4)) });
    else toast('No best gap is known for this rig.');
  };
  const timed = () => {
    control ??= store.values.gap_control;
    actions.turn({ gap_control: 'timed' });
  };
  /** Where each step is, what it says, and what there is to try. */
  const steps = /** @type {[string, string, string, string, () => void][]} */ ([
    ['#rig', 'The rig', 'A force F shakes the mass M on its spring. The loose mass m rattles in the gap and hits the two stops. Each impact takes energy out of the vibration.',
      'Load the bench rig and reset', () => actions.loadPreset('bench')],
    ['#traces', 'The motion', 'X is M (blue), Z is m (orange); the grey lines are the stops, which ride on M. Squares are impacts on stop 1, dots those on stop 2. Look closer with a shorter window.',
      'Show the last second', () => store.setWindow(1)],
    ['#first-knobs [data-name=gap]', 'Turn a knob', 'Change the gap and watch the rhythm. In a gap that is too wide, two impacts per cycle are no longer kept up. A labelled line in the traces shows what you did.',
      'Widen the gap by a half', () => widen(1.5)],
    ['#map', 'Regular or chaotic?', 'Every impact is a mark: force phase across, speed of m up. A few marks are a periodic motion, closed curves a quasi-periodic one, a cloud a chaotic one.',
      'Narrow it again', () => widen(1 / 1.5)],
    ['#curve', 'What theory says', 'Solid: stable periodic motions over the gap; dashed: unstable ones; dotted: ones that the rig cannot make. The dot is the rig. Click on the curve to set the gap. Multipliers within the unit circle mean stable.',
      'Go to the best gap', optimum],
    ['#first-knobs [data-name=gap_control]', 'Let the stops move', 'With gap control, the stops follow the vibration, at any force; the end of the tour sets it back to what it was.',
      'Switch on timed control', timed],
  ]);
  const recorded = ' Record a run, play it back, and compare it with the exact theory.';
  const card = byId('tour');
  let at = 0;
  let marked = null;
  let before = null;

  const leave = () => marked?.classList.remove('toured');
  const show = () => {
    const [selector, title, text, label] = steps[at];
    const last = at === steps.length - 1;
    leave();
    marked = document.querySelector(selector);
    marked.classList.add('toured');
    // At once: the card is placed beside it. Below it there is room for the card on a phone.
    marked.scrollIntoView({ block: innerWidth < 640 ? 'start' : 'nearest' });
    byId('tour-count').textContent = `Step ${at + 1} of ${steps.length}`;
    byId('tour-title').textContent = title;
    byId('tour-text').textContent = text + (last && !store.isInPage ? recorded : '');
    byId('tour-try').textContent = label;
    byId('tour-back').disabled = at === 0;
    byId('tour-next').textContent = last ? 'Done' : 'Next';
    place();
  };

  /** Put the card into the corner in which it hides least of what it speaks of. */
  const place = () => {
    const box = marked.getBoundingClientRect();
    const { offsetWidth: width, offsetHeight: height } = card;
    const hidden = ([left, top]) => Math.max(0, Math.min(left + width, box.right) - Math.max(left, box.left))
      * Math.max(0, Math.min(top + height, box.bottom) - Math.max(top, box.top));
    const edge = 12;
    const [right, bottom] = [innerWidth - width - edge, innerHeight - height - edge];
    const corners = [[right, bottom], [edge, bottom], [right, 56], [edge, 56]];
    const [left, top] = /** @type {[number, number][]} */ (corners).reduce((best, one) => (hidden(one) < hidden(best) ? one : best));
    Object.assign(card.style, { left: `${Math.max(0, left)}px`, top: `${Math.max(0, top)}px` });
  };
  const close = () => {
    card.hidden = true;
    leave();
    if (control !== null) actions.turn({ gap_control: control });
    control = null;
    before?.focus();
  };
  const go = (to) => {
    at = Math.max(0, to);
    if (at === steps.length) close();
    else show();
  };
  byId('tour-open').addEventListener('click', (event) => {
    before = event.currentTarget;
    card.hidden = false;
    go(0);
    card.focus();
  });
  byId('tour-try').addEventListener('click', () => steps[at][4]());
  byId('tour-back').addEventListener('click', () => go(at - 1));
  byId('tour-next').addEventListener('click', () => go(at + 1));
  byId('tour-close').addEventListener('click', close);
  card.addEventListener('keydown', (event) => {
    if (event.key === 'Escape') close();
  });
};
