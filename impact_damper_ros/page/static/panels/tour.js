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
  const steps = byId('tour-steps').content.children;
  /** What there is to try in each. */
  const acts = [
    () => actions.loadPreset('bench'),
    () => store.setWindow(1),
    () => widen(1.5),
    () => widen(1 / 1.5),
    optimum,
    timed,
  ];
  const recorded = ' Record a run, play it back, and compare it with the exact theory.';
  const card = byId('tour');
  let at = 0;
  let marked = null;
  let before = null;

  const leave = () => marked?.classList.remove('toured');
  const show = () => {
    const { dataset, children: [title, text] } = steps[at];
    const last = at === steps.length - 1;
    leave();
    marked = document.querySelector(dataset.at);
    marked.classList.add('toured');
    // At once: the card is placed beside it. Below it there is room for the card on a phone.
    marked.scrollIntoView({ block: innerWidth < 640 ? 'start' : 'nearest' });
    byId('tour-count').textContent = `Step ${at + 1} of ${steps.length}`;
    byId('tour-title').textContent = title.textContent;
    byId('tour-text').textContent = text.textContent + (last && !store.isInPage ? recorded : '');
    byId('tour-try').textContent = dataset.try;
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
  byId('tour-try').addEventListener('click', () => acts[at]());
  byId('tour-back').addEventListener('click', () => go(at - 1));
  byId('tour-next').addEventListener('click', () => go(at + 1));
  byId('tour-close').addEventListener('click', close);
  card.addEventListener('keydown', (event) => {
    if (event.key === 'Escape') close();
  });
};
