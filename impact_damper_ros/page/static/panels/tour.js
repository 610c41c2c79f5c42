// SPDX-License-Identifier: Apache-2.0
// Six steps through the page, each with something to try.

import { byId, toast } from '../dom.js';

/** What the steps do. */
function acts(store, actions) {
  /** Gap control before the tour switched it on; null if it has not. */
  let before = null;
  return {
    records: () => !store.isInPage,
    preset: (name) => actions.loadPreset(name),
    window: (seconds) => store.setWindow(seconds),
    widen: (factor) => {
      const gap = store.values.gap * factor;
      if (gap > 0) actions.turn({ gap: Number(gap.toPrecision(3)) });
    },
    optimum: () => {
      const best = store.theory.curve?.optimum?.gap;
      if (best > 0) actions.turn({ gap: Number(best.toPrecision(4)) });
      else toast('No best gap is known for this rig.');
    },
    control: (law) => {
      before ??= store.values.gap_control;
      actions.turn({ gap_control: law });
    },
    end: () => {
      if (before !== null) actions.turn({ gap_control: before });
      before = null;
    },
  };
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const act = acts(store, actions);
  const steps = [
    {
      at: '#rig',
      title: 'The rig',
      text: 'A force F shakes the mass M on its spring. The loose mass m rattles in the gap and hits the two stops. Each impact takes energy out of the vibration.',
      label: 'Load the bench rig and reset',
      run: () => act.preset('bench'),
    },
    {
      at: '#traces',
      title: 'The motion',
      text: 'X is M (blue), Z is m (orange); the grey lines are the stops, which ride on M. Squares are impacts on stop 1, dots those on stop 2. Look closer with a shorter window.',
      label: 'Show the last second',
      run: () => act.window(1),
    },
    {
      at: '#first-knobs [data-name=gap]',
      title: 'Turn a knob',
      text: 'Change the gap and watch the rhythm. In a gap that is too wide, two impacts per cycle are no longer kept up. A labelled line in the traces shows what you did.',
      label: 'Widen the gap by a half',
      run: () => act.widen(1.5),
    },
    {
      at: '#map',
      title: 'Regular or chaotic?',
      text: 'Every impact is a mark: force phase across, speed of m up. A few marks are a periodic motion, closed curves a quasi-periodic one, a cloud a chaotic one.',
      label: 'Narrow it again',
      run: () => act.widen(1 / 1.5),
    },
    {
      at: '#curve',
      title: 'What theory says',
      text: 'Solid: stable periodic motions over the gap; dashed: unstable ones; dotted: ones that the rig cannot make. The dot is the rig. Click on the curve to set the gap. Multipliers within the unit circle mean stable.',
      label: 'Go to the best gap',
      run: () => act.optimum(),
    },
    {
      at: '#first-knobs [data-name=gap_control]',
      title: 'Let the stops move',
      text: 'With gap control, the stops follow the vibration, at any force; the end of the tour sets it back to what it was.',
      recorded: ' Record a run, play it back, and compare it with the exact theory.',
      label: 'Switch on timed control',
      run: () => act.control('timed'),
    },
  ];
  const card = byId('tour');
  let at = 0;
  let marked = null;
  let before = null;

  const leave = () => marked?.classList.remove('toured');
  const show = () => {
    const step = steps[at];
    leave();
    marked = document.querySelector(step.at);
    marked.classList.add('toured');
    // At once: the card is placed beside it. Below it there is room for the card on a phone.
    marked.scrollIntoView({ block: innerWidth < 640 ? 'start' : 'nearest' });
    byId('tour-count').textContent = `Step ${at + 1} of ${steps.length}`;
    byId('tour-title').textContent = step.title;
    byId('tour-text').textContent = step.text + (act.records() ? step.recorded ?? '' : '');
    byId('tour-try').textContent = step.label;
    byId('tour-back').disabled = at === 0;
    byId('tour-next').textContent = at === steps.length - 1 ? 'Done' : 'Next';
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
    act.end();
    before?.focus();
  };
  byId('tour-open').addEventListener('click', (event) => {
    before = event.currentTarget;
    at = 0;
    card.hidden = false;
    show();
    card.focus();
  });
  byId('tour-try').addEventListener('click', () => steps[at].run());
  byId('tour-back').addEventListener('click', () => {
    at = Math.max(0, at - 1);
    show();
  });
  byId('tour-next').addEventListener('click', () => {
    if (at === steps.length - 1) close();
    else {
      at += 1;
      show();
    }
  });
  byId('tour-close').addEventListener('click', close);
  card.addEventListener('keydown', (event) => {
    if (event.key === 'Escape') close();
  });
};
