// SPDX-License-Identifier: Apache-2.0
// The bar at the top: state and choice of the rig, its run, the link to it; and the keys.

import { byId, element, mark, toast, write } from '../dom.js';
import { clock, digits } from '../format.js';

/** Where the word for a state is not its name, and what is written over the rig, if not what the server says. */
const STATES = {
  gone: ['rig gone', 'The node does not answer; waiting for it.'],
  offline: ['no server', 'The page server does not answer; trying again.'],
  doubled: ['several rigs'],
  other_version: ['other version'],
};
/** Keys that jump in a recording; those that go forwards move a paused rig, too. */
const JUMP_KEYS = {
  ArrowRight: ['impact', 1], ArrowLeft: ['impact', -1], 'Shift+ArrowRight': ['sample', 1], 'Shift+ArrowLeft': ['sample', -1],
};
const STEP_KEYS = { ArrowRight: 'step_to_impact', 'Shift+ArrowRight': 'step' };
/** What has keys of its own. */
const TYPED = 'input, select, textarea, dialog, canvas, [role="dialog"], [tabindex="0"], :popover-open';

function showStatus({ status, isLive }, text) {
  const pill = byId('status');
  const curtain = byId('curtain');
  const paused = status === 'paused';
  const [words, shown = text] = STATES[status] ?? [status, paused && isLive ? 'Paused' : ''];
  for (const place of [pill, curtain]) mark(place, 'data-state', status);
  write(pill, words);
  curtain.hidden = !shown;
  write(curtain, shown);
  // A rig that lags says why in a tooltip and to a screen reader; it runs on.
  mark(pill, 'title', text || shown || words);
  mark(pill, 'aria-label', status === 'lagging' && text ? `${words}: ${text}` : words);
  mark(byId('pause'), 'aria-pressed', String(paused));
  write(byId('pause'), paused ? 'Resume' : 'Pause');
  // Not disabled, which would take the focus from them in the middle of a step.
  for (const id of ['step', 'step-to-impact']) mark(byId(id), 'aria-disabled', String(!paused));
}

/** Show what can be done with a live rig, with a recording, or by who only watches. */
function showMode({ hello, isLive, isInPage }) {
  const modes = { watches: !hello.steers, 'in-page': isInPage, playing: !isLive, designs: hello.designs, ros: hello.ros };
  for (const [name, on] of Object.entries(modes)) document.body.classList.toggle(name, Boolean(on));
  byId('rig-speed').disabled = !hello.steers;
}

/** Offer rigs to choose from; the one that is shown stays among them though it is gone. */
function offerRigs({ hello, isLive }) {
  const shown = isLive ? hello.rig : hello.bag;
  const names = isLive ? hello.rigs : [hello.bag];
  const all = names.includes(shown) || !shown ? names : [shown, ...names];
  const choice = byId('rig-choice');
  choice.replaceChildren(...(all.length ? all : ['no rig']).map((name) => element('option', { value: name, text: name })));
  if (shown) choice.value = shown;
  choice.disabled = all.length < 2;
}

/** Show the speed of the rig, which may be one of somebody else's choice. */
function showSpeed(factor) {
  const choice = byId('rig-speed');
  choice.querySelector('[data-own]')?.remove();
  if (![...choice.options].some(({ value }) => Number(value) === factor)) {
    choice.append(element('option', { value: String(factor), 'data-own': '', text: factor ? `${digits(factor, 2)}×` : 'free' }));
  }
  choice.value = String(factor);
}

async function copyLink(store) {
  if (store.isLive) store.keepWholeRig();
  else store.keepAddress();
  await new Promise((resolve) => { setTimeout(resolve, 200); });
  const { address } = store.hello;
  try {
    await navigator.clipboard.writeText(address ? new URL(location.hash, address).href : location.href);
    toast(address ? 'The address of this rig has been copied: who opens it elsewhere watches.' : 'The address of this rig has been copied.');
  } catch {
    toast('The address in the browser now holds the whole rig: copy it from there.');
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions, { player }) => {
  const press = (id, take) => byId(id).addEventListener('click', take);
  byId('rig-speed').addEventListener('change', () => actions.turn({ real_time_factor: Number(byId('rig-speed').value) }));
  byId('rig-choice').addEventListener('change', () => actions.join({ rig: byId('rig-choice').value }));
  press('pause', () => actions.service('pause'));
  press('reset', () => actions.service('reset'));
  press('step', () => actions.step('step'));
  press('step-to-impact', () => actions.step('step_to_impact'));
  press('record', () => actions.turn({ record: byId('record').getAttribute('aria-pressed') !== 'true' }));
  press('link', () => copyLink(store));
  press('large', () => switchLarge());
  store.on('status', ({ text }) => showStatus(store, text));
  store.on('hello', () => {
    showMode(store);
    offerRigs(store);
  });
  store.on('rigs', () => offerRigs(store));
  store.on('values', (values) => {
    if ('real_time_factor' in values) showSpeed(values.real_time_factor);
    if (!('record' in values)) return;
    mark(byId('record'), 'aria-pressed', String(values.record));
    byId('record').lastChild.textContent = values.record ? 'Recording' : 'Record';
  });
  store.on('drawn', () => write(byId('clock'), Number.isFinite(store.history.end) ? clock(store.history.end, store.status === 'paused') : ''));

  /** Large type, for a lecture hall, or as it was. */
  const switchLarge = () => {
    const on = document.documentElement.classList.toggle('large');
    mark(byId('large'), 'aria-pressed', String(on));
    store.keepView('large', on ? '1' : '');
    dispatchEvent(new Event('resize'));
  };
  if (store.address.view.large === '1') switchLarge();
  document.addEventListener('keydown', (event) => {
    const target = /** @type {Element} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey || target.closest(TYPED)) return;
    if (event.key === ' ') {
      if (target.closest('button, a, summary')) return;
      event.preventDefault();
      if (!store.isLive) player.toggle();
      else if (store.steers) actions.service('pause');
      return;
    }
    if (event.key.toLowerCase() === 'l') switchLarge();
    const key = `${event.shiftKey ? 'Shift+' : ''}${event.key}`;
    if (!store.isLive && key in JUMP_KEYS) player.jump(...JUMP_KEYS[key]);
    else if (store.steers && key in STEP_KEYS) actions.step(STEP_KEYS[key]);
  });
};
