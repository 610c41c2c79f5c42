// SPDX-License-Identifier: Apache-2.0
// The wiring of the page: what each message of the server and each control does.

import { Connection } from './connection.js';
import { Controller } from './controller.js';
import { byId, element, mark, toast, write } from './dom.js';
import { Drag } from './drag.js';
import { Drawing } from './drawing.js';
import { digits, TAU, withUnit } from './format.js';
import { startGlossary } from './glossary.js';
import { BASE, Knobs } from './knobs.js';
import { Player } from './player.js';
import { makePresets, markPreset } from './presets.js';
import { Recordings } from './recordings.js';
import { Requests } from './requests.js';
import { history, isInPage, isLive, keepAddress, keepView, keepWholeRig, opened, reproducible, state, steers, theory } from './state.js';
import { Structure } from './structure.js';
import { startTour } from './tour.js';
import { WINDOWS } from './traces.js';
import { Verdict } from './verdict.js';

/** Where the word for a state is not its name. */
const STATES = { gone: 'rig gone', offline: 'no server', doubled: 'several rigs', other_version: 'other version' };
/** Speeds of the rig that are offered. */
const SPEEDS = [[0.05, '1/20'], [0.2, '1/5'], [1, '1×'], [5, '5×']];
/** Keys that jump in a recording; those that go forwards move a paused rig, too. */
const JUMP_KEYS = {
  ArrowRight: ['impact', 1], ArrowLeft: ['impact', -1], 'Shift+ArrowRight': ['sample', 1], 'Shift+ArrowLeft': ['sample', -1],
};
const STEP_KEYS = { ArrowRight: 'step_to_impact', 'Shift+ArrowRight': 'step' };

const connection = new Connection();
const player = new Player(connection);
const verdict = new Verdict();
const requests = new Requests(connection, {
  onValues: (values) => knobs.take(values),
  onWhatIf: (on) => showWhatIf(on),
  onPreset: () => showPreset(),
});
const knobs = new Knobs((values) => requests.set(values));
const controller = new Controller((values) => requests.turn(values));
const drawing = new Drawing({ setGap: (gap) => requests.turn({ gap }), player });
const drag = new Drag(drawing.rig, () => history.state, {
  hold: (name) => knobs.hold(name),
  gap: (value) => knobs.turn('gap', value),
  release: (place) => requests.release(place, knobs.values()),
});
/** The best gap of a structure, and the values of its rig, as long as the rig is that one. */
let designed = null;
const structure = new Structure((message) => connection.ask(message), async (design, values) => {
  const answer = await connection.ask({ type: 'begin', values });
  if (!answer.ok) return answer;
  designed = { values };
  drawing.curve.markDesign(design.gap);
  Object.assign(state.address, { preset: '', values: reproducible(values) });
  showPreset();
  keepAddress();
  return answer;
});
const recordings = new Recordings(connection, (name) => requests.join({ bag: name }));

// Measurements: how much has come in, and of when the newest is.
const received = { frames: 0, latest: 0, epoch: 0 };
globalThis.impactDamper = { received, history, theory, drawing, requests };

// What is shown of the state

function setStatus(now, text = '') {
  state.status = now;
  const pill = byId('status');
  const words = STATES[now] ?? now;
  mark(pill, 'data-state', now);
  write(pill, words);
  const curtain = byId('curtain');
  const shown = {
    gone: 'The node does not answer; waiting for it.',
    offline: 'The page server does not answer; trying again.',
    doubled: text,
    other_version: text,
    paused: isLive() ? 'Paused' : '',
  }[now] ?? '';
  curtain.hidden = !shown;
  mark(curtain, 'data-state', now);
  write(curtain, shown);
  // A rig that lags says why in a tooltip and to a screen reader; it runs on.
  mark(pill, 'title', text || shown || words);
  mark(pill, 'aria-label', now === 'lagging' && text ? `${words}: ${text}` : words);
  const paused = now === 'paused';
  mark(byId('pause'), 'aria-pressed', String(paused));
  write(byId('pause'), paused ? 'Resume' : 'Pause');
  // Not disabled, which would take the focus from them in the middle of a step.
  for (const id of ['step', 'step-to-impact']) mark(byId(id), 'aria-disabled', String(!paused));
  drawing.rig.stale = true;
}

/** Show what can be done with a live rig, with a recording, or by who only watches. */
function showMode() {
  const live = isLive();
  const watches = !state.hello.steers;
  document.body.classList.toggle('watches', watches);
  byId('watching').hidden = !watches;
  byId('structure-open').hidden = !state.hello.designs;
  for (const id of ['pause', 'reset', 'rig-speed', 'step', 'step-to-impact', 'record', 'presets-open', 'tour-open']) byId(id).hidden = !live;
  byId('rig-speed').disabled = watches;
  byId('back-live').hidden = !state.hello.ros;
  document.body.classList.toggle('in-page', isInPage());
  drag.on = drawing.curve.settable = steers();
  knobs.locked = live && watches;
  write(byId('knobs-title'), live ? 'Knobs' : 'What if');
  if (!live) verdict.recorded();
}

function showWhatIf(on) {
  byId('clear-ghost').hidden = !on;
  if (!on) knobs.make(state.hello.parameters);
}

/** Show which preset the rig has. */
function showPreset() {
  const { presets } = state.hello;
  const { preset } = state.address;
  write(byId('preset-name'), isLive() ? (designed ? 'My structure' : presets.find((one) => one.name === preset)?.title ?? '') : 'as a ghost');
  markPreset(preset);
}

/** Offer rigs to choose from; the one that is shown stays among them though it is gone. */
function offer(names, shown) {
  const all = names.includes(shown) || !shown ? names : [shown, ...names];
  const choice = byId('rig-choice');
  choice.replaceChildren(...(all.length ? all : ['no rig']).map((name) => element('option', { value: name, text: name })));
  if (shown) choice.value = shown;
  choice.disabled = all.length < 2;
}

/** Whether positions count from the base, which moves. */
const isRelative = () => byId('relative').checked && !byId('relative-switch').hidden;

/** Theory is of X in the laboratory. */
function showFrom() {
  history.countFrom(isRelative());
  drawing.traces.showTheory = byId('theory').checked && !isRelative();
  drawing.rescale(NaN);
}

/** Show the speed of the rig, which may be one of somebody else's choice. */
function showSpeed(factor) {
  const choice = byId('rig-speed');
  choice.querySelector('[data-own]')?.remove();
  if (SPEEDS.every(([value]) => value !== factor)) {
    choice.append(element('option', { value: String(factor), 'data-own': '', text: factor ? `${digits(factor, 2)}×` : 'free' }));
  }
  choice.value = String(factor);
}

/** Take in values of the rig. */
function takeValues(values) {
  const all = Object.assign(state.values, values);
  // Some eight cycles of what shakes the rig, or more
  const frequency = drive(all).frequency / TAU;
  if ((values.force_frequencies || values.base_frequencies) && frequency > 0 && !state.address.view.window) chooseWindow(8 / frequency);
  if ('real_time_factor' in values) showSpeed(values.real_time_factor);
  if ('record' in values) {
    mark(byId('record'), 'aria-pressed', String(values.record));
    byId('record').lastChild.textContent = values.record ? 'Recording' : 'Record';
  }
  controller.take(all);
  // With a margin between the two, so that a knob that is dragged does not turn it to and fro
  const steep = document.body.classList.contains('steep') ? 0.6 : 0.8;
  document.body.classList.toggle('steep', Math.abs(all.angle) > steep);
  drawing.portrait.seconds = frequency > 0 ? Math.min(40, 8 / frequency) : 10;
  write(byId('rig-line'), described(all));
  const still = !(all.base_amplitudes ?? []).some((one) => one !== 0);
  if (byId('relative-switch').hidden !== still) {
    byId('relative-switch').hidden = still;
    showFrom();
  }
  drawing.rig.stale = true;
}

/** What shakes the rig first, the force or the base: amplitude, unit, and frequency in rad/s. */
function drive({ force_amplitudes: [force = 0] = [], force_frequencies: [ofForce] = [], base_amplitudes: [base = 0] = [], base_frequencies: [ofBase] = [], base_quantity: quantity }) {
  if (force === 0 && base !== 0) return { amplitude: Math.abs(base), unit: BASE[quantity], frequency: ofBase, word: 'base ' };
  return { amplitude: Math.abs(force), unit: 'N', frequency: ofForce, word: '' };
}

/** The rig in a line. */
function described({ force_amplitudes: forces = [], multisine_level: level, gap, gap_control: control, ...rest }) {
  const { amplitude, unit, frequency, word } = drive({ force_amplitudes: forces, ...rest });
  return [
    amplitude > 0 ? `${word}${withUnit(amplitude, unit)} at ${withUnit(frequency / TAU, 'Hz', 4)}` : level > 0 || forces.some(Boolean) ? '' : 'no force',
    forces.length > 1 ? `+${forces.length - 1} harmonic${forces.length > 2 ? 's' : ''}` : '',
    level > 0 ? `multisine ${withUnit(level, 'N')} rms` : '',
    `gap ${withUnit(gap, 'm')}`,
    control && control !== 'off' ? `${control} control` : '',
  ].filter(Boolean).join(' · ');
}

function forgetDesign() {
  designed = null;
  drawing.curve.markDesign(NaN);
  showPreset();
}

/** Forget the best gap of a structure once the rig is another one. */
function checkDesign(values) {
  const same = ([name, value]) => name === 'gap' || !(name in designed.values) || JSON.stringify(value) === JSON.stringify(designed.values[name]);
  if (designed && !Object.entries(values).every(same)) forgetDesign();
}

/** Whether so much changes that the scales of before say nothing. */
function isAnotherRig({ preset, values }) {
  const factor = values.gap / state.values.gap;
  return Boolean(preset) || factor > 2 || factor < 0.5;
}

// What comes in

connection.addEventListener('hello', ({ detail }) => {
  const { address } = state;
  const live = detail.mode !== 'player';
  const other = detail.rig !== state.hello.rig || !live;
  Object.assign(state, { hello: detail, values: {}, whatIf: {} });
  history.shape(detail.frame.tables);
  history.window = Number(address.view.window) || 30;
  history.recorded = !live;
  theory.clear();
  for (const id of ['map-line', 'curve-line']) write(byId(id), '');
  drawing.clear();
  if (other) forgetDesign();
  verdict.clear();
  byId('clear-ghost').hidden = true;
  player.begin(detail);
  showMode();
  address.bag = detail.bag;
  offer(live ? detail.rigs : [detail.bag], live ? detail.rig : detail.bag);
  makePresets(detail.presets, (name) => requests.loadPreset(name));
  knobs.make(detail.parameters);
  controller.make(detail.parameters);
  controller.report(null);
  for (const one of detail.changes ?? []) if (one.kind !== 'stretch') history.change(one.time, knobs.done(one));
  const values = Object.fromEntries(detail.parameters.map((one) => [one.name, one.value]));
  takeValues(values);
  checkDesign(values);
  recordings.show(detail.recordings);
  received.latest = performance.now();
  setStatus(detail.rig || !live ? 'running' : 'gone');
  sendView();
  if (live) beginLive(detail);
  else beginPlaying();
});

function beginLive({ rig, parameters, preset }) {
  const { address } = state;
  // Who watches sees the rig as it is, whatever the address asks for.
  if (!steers()) {
    state.wanted = null;
    Object.assign(address, { preset: '', values: {} });
  }
  if (preset) address.preset = state.hello.presets.find((one) => one.title === preset).name;
  if (steers() && rig && parameters.length) applyWanted();
  showPreset();
}

function beginPlaying() {
  const { address } = state;
  showPreset();
  if (opened.time && opened.bag === address.bag) player.seek(opened.time);
  // Once
  opened.time = NaN;
  player.goOn(address.bag);
  if (Object.keys(address.values).length) requests.turn(address.values);
}

/** Bring the rig to what the address asks for, once. */
async function applyWanted() {
  const { address } = state;
  const wanted = isInPage() ? opened : state.wanted;
  state.wanted = null;
  if (!wanted) {
    // Loaded anew: what this tab has set before still stands in the address.
    if (!opened.bag) Object.assign(address, { preset: address.preset || (opened.preset ?? ''), values: { ...opened.values, ...address.values } });
    return;
  }
  if (wanted.preset) await requests.loadPreset(wanted.preset);
  // Where the node records, and whether, is not for a link to say.
  const values = reproducible(wanted.values);
  if (Object.keys(values).length) await requests.turn(values);
}

connection.addEventListener('parameters', ({ detail }) => {
  const { address, hello } = state;
  // A knob that makes the ghost another rig stays where it was turned to.
  const values = Object.fromEntries(Object.entries(detail.values).filter(([name]) => !(name in state.whatIf)));
  const line = knobs.done(detail);
  if (isAnotherRig(detail)) drawing.rescale(detail.time);
  knobs.take(values);
  takeValues(detail.values);
  checkDesign(detail.values);
  drawing.curve.stale = true;
  if (!isLive()) return;
  history.change(detail.time, line, knobs.dragOf(detail.values));
  const preset = hello.presets.find((one) => one.title === detail.preset)?.name ?? '';
  // Who steers knows which preset the rig started from; who watches, which one it is.
  if ((preset || !steers()) && preset !== address.preset) {
    // Chosen in another tab, or by hand
    Object.assign(address, { preset, values: {} });
    showPreset();
    keepAddress();
  }
});
connection.addEventListener('frame', ({ detail: frame }) => {
  history.add(frame);
  const now = performance.now();
  for (const { stop, impulse } of history.fresh) drawing.rig.flash(stop, impulse, now);
  received.frames += 1;
  received.epoch = frame.epoch;
  received.latest = now;
  const due = frame.paused ? 'paused' : 'running';
  if (isLive() && !['lagging', 'doubled', due].includes(state.status)) setStatus(due);
});
connection.addEventListener('status', ({ detail }) => {
  received.latest = performance.now();
  state.statusText = detail.text;
  player.status(detail);
  setStatus(detail.state, detail.text);
  if (detail.state === 'ended') player.show(detail.time);
});
connection.addEventListener('again', () => recordings.goOn());
connection.addEventListener('lost', () => {
  player.leave(state.address.bag, history.end);
  setStatus('offline');
});
connection.addEventListener('missing', () => {
  toast(state.statusText || 'There is no such rig or recording.', 'bad');
  setStatus('gone');
  // What the server offers instead.
  if (state.address.rig || state.address.bag) requests.join({});
});
connection.addEventListener('rigs', ({ detail }) => {
  if (isLive()) offer(detail.list, state.hello.rig);
});
connection.addEventListener('diagnostics', ({ detail }) => {
  state.diagnostics = detail;
  verdict.diagnostics(detail, theory);
  controller.report(detail.controller);
});
connection.addEventListener('numbers', ({ detail }) => {
  state.numbers = detail;
  verdict.numbers(detail, theory);
  controller.numbers(detail);
  drawing.curve.place(detail.gap, detail.x_max_ratio ?? NaN);
});
for (const type of ['orbit', 'gap_curve', 'theory_failed']) {
  connection.addEventListener(type, ({ detail }) => {
    theory.take(detail);
    drawing.redraw();
    verdict.numbers(state.numbers, theory);
    if (isLive() && state.diagnostics) verdict.diagnostics(state.diagnostics, theory);
    const { gap: best, basis } = theory.best;
    const sign = basis === 'part' ? '≈\u202f' : basis && `${basis} `;
    const lines = { 'curve-line': best > 0 ? `best gap ${sign}${withUnit(best, 'm')}` : '', 'map-line': theory.title };
    for (const [id, text] of Object.entries(lines)) {
      write(byId(id), text);
      // Where it is too long for its panel
      mark(byId(id), 'title', text);
    }
  });
}
connection.addEventListener('recordings', ({ detail }) => recordings.show(detail.list));
connection.addEventListener('compare_done', ({ detail }) => recordings.done(detail));
connection.addEventListener('what_if', ({ detail }) => {
  byId('clear-ghost').hidden = !detail.on;
  verdict.whatIf(detail);
  if (!detail.on && detail.text) toast(detail.text, 'bad');
});
connection.addEventListener('notice', ({ detail }) => toast(detail.text, 'bad'));
connection.addEventListener('seek_done', ({ detail }) => keepAddress(detail.time));

// What is pressed

for (const [value, text] of SPEEDS) byId('rig-speed').append(element('option', { value: String(value), text }));
byId('rig-speed').addEventListener('change', () => requests.turn({ real_time_factor: Number(byId('rig-speed').value) }));
byId('pause').addEventListener('click', () => requests.service('pause'));
byId('reset').addEventListener('click', () => requests.service('reset'));
byId('step').addEventListener('click', () => requests.step('step'));
byId('step-to-impact').addEventListener('click', () => requests.step('step_to_impact'));
byId('record').addEventListener('click', async () => {
  const on = byId('record').getAttribute('aria-pressed') !== 'true';
  if (await requests.ask({ type: 'set', values: { record: on } })) takeValues({ record: on });
});
byId('rig-choice').addEventListener('change', () => requests.join({ rig: byId('rig-choice').value }));
byId('back-live').addEventListener('click', () => requests.join({}));
byId('clear-ghost').addEventListener('click', () => requests.clearWhatIf());
byId('structure-open').addEventListener('click', () => {
  byId('presets').hidePopover();
  structure.open();
});
byId('slow').addEventListener('change', () => {
  drawing.slow.switch(byId('slow').checked);
  keepView('slow', byId('slow').checked ? '1' : '');
});
byId('relative').addEventListener('change', () => {
  keepView('relative', byId('relative').checked ? '1' : '');
  showFrom();
});
byId('theory').addEventListener('change', () => {
  const on = byId('theory').checked;
  drawing.showTheory(on);
  showFrom();
  keepView('theory', on ? '' : '0');
});
byId('link').addEventListener('click', async () => {
  if (isLive()) keepWholeRig(knobs.values());
  else keepAddress();
  await new Promise((resolve) => { setTimeout(resolve, 200); });
  const { address } = state.hello;
  try {
    await navigator.clipboard.writeText(address ? new URL(location.hash, address).href : location.href);
    toast(address ? 'The address of this rig has been copied: who opens it elsewhere watches.' : 'The address of this rig has been copied.');
  } catch {
    toast('The address in the browser now holds the whole rig: copy it from there.');
  }
});
for (const dialog of document.querySelectorAll('dialog')) {
  dialog.querySelector('[data-close]').addEventListener('click', () => dialog.close());
  dialog.addEventListener('click', (event) => {
    if (event.target === dialog) dialog.close();
  });
}
byId('report').addEventListener('close', () => byId('report-frame').removeAttribute('src'));
byId('glossary-open').addEventListener('click', () => byId('glossary').showModal());
document.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest('input, select, textarea, dialog, canvas, [role="dialog"], [tabindex="0"], :popover-open')) return;
  if (event.key === ' ') {
    if (event.target.closest('button, a, summary')) return;
    event.preventDefault();
    if (!isLive()) player.play(!player.playing);
    else if (steers()) requests.service('pause');
    return;
  }
  const key = `${event.shiftKey ? 'Shift+' : ''}${event.key}`;
  if (!isLive() && key in JUMP_KEYS) player.jump(...JUMP_KEYS[key]);
  else if (steers() && key in STEP_KEYS) requests.step(STEP_KEYS[key]);
});

// The view

function sendView() {
  connection.send({ type: 'view', window: history.window, rate: document.hidden ? 1 : 60 });
}

function setWindow(seconds) {
  history.window = seconds;
  for (const button of byId('windows').querySelectorAll('button')) {
    mark(button, 'aria-pressed', String(Number(button.value) === seconds));
  }
  sendView();
}

/** Of the windows, the shortest one with so many seconds. */
function chooseWindow(least) {
  const seconds = [...WINDOWS].reverse().find((one) => one >= least) ?? WINDOWS[0];
  if (seconds !== history.window) setWindow(seconds);
}

for (const seconds of WINDOWS) {
  byId('windows').append(element('button', {
    type: 'button', value: String(seconds), text: `${seconds} s`, 'aria-pressed': 'false', onclick: () => {
      setWindow(seconds);
      keepView('window', String(seconds));
    },
  }));
}
document.addEventListener('visibilitychange', sendView);
addEventListener('hashchange', () => location.reload());

/** Gap control before the tour switched it on; null if it has not. */
let toured = null;
startGlossary();
startTour({
  records: () => !isInPage(),
  preset: (part) => {
    const found = state.hello.presets.find((one) => one.name.includes(part));
    if (found) requests.loadPreset(found.name);
  },
  window: setWindow,
  widen: (factor) => {
    const gap = knobs.values().gap * factor;
    if (gap > 0) requests.turn({ gap: Number(gap.toPrecision(3)) });
  },
  optimum: () => {
    const best = theory.curve?.optimum?.gap;
    if (best > 0) requests.turn({ gap: Number(best.toPrecision(4)) });
    else toast('No best gap is known for this rig.');
  },
  control: (law) => {
    toured ??= state.values.gap_control;
    requests.turn({ gap_control: law });
  },
  end: () => {
    if (toured !== null) requests.turn({ gap_control: toured });
    toured = null;
  },
});

// Where there is room for it, all parameters are in view.
byId('more-knobs').open = matchMedia('(min-width: 110rem) and (min-height: 50rem)').matches;
byId('theory').checked = state.address.view.theory !== '0';
drawing.showTheory(byId('theory').checked);
byId('relative').checked = state.address.view.relative === '1';
byId('slow').checked = state.address.view.slow === '1';
drawing.slow.switch(byId('slow').checked);
history.window = Number(state.address.view.window) || 30;
setWindow(history.window);
if (location.search === '?wrong_token') {
  globalThis.history.replaceState(null, '', location.pathname + location.hash);
  toast('The token of this address is not that of this server, which makes a new one at each start: this page only watches.', 'bad');
}
connection.join(state.address);
drawing.begin();
