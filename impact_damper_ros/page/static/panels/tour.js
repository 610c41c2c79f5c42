// SPDX-License-Identifier: Apache-2.0
// Six steps through the page, each with something to try.

import { byId, toast } from '../dom.js';

const RECORDED = ' Record a run, play it back, and compare it with the exact theory.';

/** Put the card into the corner in which it hides least of what it speaks of. */
function place(card, marked) {
  const box = marked.getBoundingClientRect();
  const { offsetWidth: width, offsetHeight: height } = card;
  const hidden = ([left, top]) => Math.max(0, Math.min(left + width, box.right) - Math.max(left, box.left))
    * Math.max(0, Math.min(top + height, box.bottom) - Math.max(top, box.top));
  const edge = 12;
  const [right, bottom] = [innerWidth - width - edge, innerHeight - height - edge];
  const corners = [[right, bottom], [edge, bottom], [right, 56], [edge, 56]];
  const [left, top] = /** @type {[number, number][]} */ (corners).reduce((best, one) => (hidden(one) < hidden(best) ? one : best));
  Object.assign(card.style, { left: `${Math.max(0, left)}px`, top: `${Math.max(0, top)}px` });
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const steps = byId('tour-steps').content.children;
  let at = 0;
  /** Gap control before the tour switched it on; null if it has not. */
  let control = null;
  const setGap = (gap, count = 3) => actions.turn({ gap: Number(gap.toPrecision(count)) });
  /** What there is to try in each. */
  const acts = [
    () => actions.loadPreset('bench'),
    () => store.setWindow(1),
    () => setGap(1.5 * store.values.gap),
    () => setGap(store.values.gap / 1.5),
    () => (store.theory.best.gap > 0 ? setGap(store.theory.best.gap, 4) : toast('No best gap is known for this rig.')),
    () => {
      control ??= store.values.gap_control;
      actions.turn({ gap_control: 'timed' });
    },
  ];
  const leave = () => document.querySelector('.toured')?.classList.remove('toured');
  const go = (to) => {
    leave();
    at = to;
    if (at === steps.length) {
      root.close();
      return;
    }
    const { dataset, children: [title, text] } = steps[at];
    const last = at === steps.length - 1;
    const marked = document.querySelector(dataset.at);
    marked.classList.add('toured');
    // At once: the card is placed beside it. Below it there is room for the card on a phone.
    marked.scrollIntoView({ block: innerWidth < 640 ? 'start' : 'nearest' });
    byId('tour-count').textContent = `Step ${at + 1} of ${steps.length}`;
    byId('tour-title').textContent = title.textContent;
    byId('tour-text').textContent = text.textContent + (last && !store.isInPage ? RECORDED : '');
    byId('tour-try').textContent = dataset.try;
    byId('tour-back').disabled = at === 0;
    byId('tour-next').textContent = last ? 'Done' : 'Next';
    place(root, marked);
  };
  byId('tour-open').addEventListener('click', () => {
    root.show();
    go(0);
  });
  byId('tour-try').addEventListener('click', () => acts[at]());
  byId('tour-back').addEventListener('click', () => go(at - 1));
  byId('tour-next').addEventListener('click', () => go(at + 1));
  root.addEventListener('keydown', (event) => { if (event.key === 'Escape') root.close(); });
  root.addEventListener('close', () => {
    leave();
    if (control !== null) actions.turn({ gap_control: control });
    control = null;
  });
};
