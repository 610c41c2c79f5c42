// SPDX-License-Identifier: Apache-2.0
// The page: what comes in, what is drawn, what is asked for.

import { isOwnAddress, readAddress, writeAddress } from './address.js';
import { readColours } from './chart.js';
import { Connection } from './connection.js';
import { Controller } from './controller.js';
import { byId, element, mark, toast, write } from './dom.js';
import { Drag } from './drag.js';
import { clock, digits, withUnit } from './format.js';
import { GapCurve } from './gap_curve.js';
import { startGlossary } from './glossary.js';
import { History } from './history.js';
import { Knobs } from './knobs.js';
import { Player } from './player.js';
import { makePresets, markPreset } from './presets.js';
import { ImpactMap, Multipliers, PhasePortrait } from './portraits.js';
import { Recordings } from './recordings.js';
import { RigDrawing } from './rig_drawing.js';
import { SlowMotion } from './slow_motion.js';
import { Clicks } from './sound.js';
import { Theory } from './theory.js';
import { startTour } from './tour.js';
import { Traces, WINDOWS } from './traces.js';
import { Verdict } from './verdict.js';

const SILENCE = 8000;
/** Buttons that move a paused rig. */
const STEPS = ['step', 'step-to-impact'];
/** Keys that jump in a recording; those that go forwards move a paused rig, too. */
const JUMP_KEYS = {
  '.': ['sample', 1], ',': ['sample', -1], ArrowRight: ['impact', 1], ArrowLeft: ['impact', -1],
};
/** Where the word for a state is not its name. */
const TEXTS = { gone: 'rig gone', offline: 'no server' };

readColours();
const history = new History();
const theory = new Theory();
const connection = new Connection();
const rig = new RigDrawing(byId('rig-canvas'));
const traces = new Traces(history, theory);
const portrait = new PhasePortrait(byId('portrait-canvas'), history, theory);
const map = new ImpactMap(byId('map-canvas'), history, theory);
const multipliers = new Multipliers(byId('multipliers-canvas'));
const slow = new SlowMotion(history);
const clicks = new Clicks();
const verdict = new Verdict();
const controller = new Controller((values) => turn(values));
const player = new Player(connection);
const knobs = new Knobs((values) => setValues(values));
const curve = new GapCurve(byId('curve-canvas'), theory, (gap) => turn({ gap }));
const drag = new Drag(rig, () => history.state, {
  hold: (name) => knobs.hold(name),
  gap: (value) => knobs.turn('gap', value),
  release: (place) => letGo(place),
});
const recordings = new Recordings(connection, (name) => join({ bag: name }));

/** What the address holds, and what of it still has to be sent to the rig. */
const asked = readAddress();
addEventListener('hashchange', () => location.reload());
let wanted = isOwnAddress() ? null : asked;
const shared = { rig: asked.rig ?? '', bag: asked.bag ?? '', preset: '', values: asked.bag ? asked.values : {}, view: { ...asked.view } };
let hello = { mode: 'live', parameters: [] };
let ghostValues = {};
let numbers = {};
/** Values of the rig itself; beside a recording the knobs hold those of the ghost. */
let rigValues = {};
let status = 'connecting';
/** What the server said of it last. */
let said = '';
let presetList = [];

// Measurements: times between frames and of drawing, how much has come in, and of when its newest is.
const counted = { frames: 0, bytes: 0, drawn: 0, work: [], latest: 0, epoch: 0 };
globalThis.impactDamper = { counted, history, theory, rig, curve, isStepping: () => stepping };

function setStatus(state, text = '') {
  if (status === 'paused' && state !== 'paused') reportLateImpact();
  status = state;
  const pill = byId('status');
  const words = TEXTS[state] ?? state;
  mark(pill, 'data-state', state);
  write(pill, words);
  const curtain = byId('curtain');
  const shown = {
    gone: 'The node does not answer; waiting for it.',
    offline: 'The page server does not answer; trying again.',
    paused: player.on ? '' : 'Paused',
  }[state] ?? '';
  curtain.hidden = !shown;
  mark(curtain, 'data-state', state);
  write(curtain, shown);
  // A rig that lags says why in a tooltip and to a screen reader; it runs on.
  mark(pill, 'title', text || shown || words);
  mark(pill, 'aria-label', state === 'lagging' && text ? `${words}: ${text}` : words);
  const paused = state === 'paused';
  mark(byId('pause'), 'aria-pressed', String(paused));
  write(byId('pause'), paused ? 'Resume' : 'Pause');
  // Not disabled, which would take the focus from them in the middle of a step.
  for (const id of STEPS) mark(byId(id), 'aria-disabled', String(!paused));
  rig.stale = true;
}

function join({ rig: name = '', bag = '' }) {
  // Those of a recording are the values of its what-if.
  if (bag || shared.bag) Object.assign(shared, { preset: '', values: {} });
  shared.rig = name;
  shared.bag = bag;
  wanted = null;
  // Its time is not that of what is joined.
  history.clear();
  connection.join({ rig: name, bag });
  keepAddress();
}

/** Parameters that are part of a link: of the rig, of its control and of its start, not of the node. */
const REPRODUCIBLE = new Set(['first', 'rig', 'forcing', 'control']);
function reproducible(name) {
  const known = hello.parameters.find((one) => one.name === name);
  return !known || (!known.read_only && (REPRODUCIBLE.has(known.group) || name.startsWith('initial_')));
}

/** `time` is that of a recording, which the last frame may not have reached yet. */
function keepAddress(time = history.end) {
  const values = Object.fromEntries(Object.entries(shared.values).filter(([name]) => reproducible(name)));
  writeAddress({ ...shared, values, time: shared.bag ? time : NaN });
}

// Requests

/** Send a request; return whether it was carried out, and show why if not. */
async function request(message) {
  const { ok, reason } = await connection.ask(message);
  if (!ok) toast(reason, 'bad');
  return ok;
}

/** Send values to the rig, or to the ghost beside a recording. */
async function setValues(values) {
  if (hello.mode === 'player') {
    const answer = await connection.ask({ type: 'what_if', values: { ...ghostValues, ...values } });
    if (answer.ok) {
      ghostValues = answer.values;
      byId('clear-ghost').hidden = false;
      shared.values = ghostValues;
      keepAddress();
    }
    return answer;
  }
  const answer = await connection.ask({ type: 'set', values });
  if (answer.ok) {
    Object.assign(shared.values, answer.values);
    keepAddress();
  }
  return answer;
}

/** Set values from elsewhere than a knob. */
async function turn(values) {
  const { ok, reason } = await setValues(values);
  if (ok) knobs.take(values);
  else toast(reason, 'bad');
}

async function loadPreset(name) {
  if (!await request({ type: 'preset', name })) return;
  shared.preset = name;
  shared.values = {};
  showPreset();
  keepAddress();
}

const service = (name) => request({ type: 'service', name });

/** Let M and m go at places of their own; the next reset is from where it was before. */
async function letGo({ x, y }) {
  const at = { initial_primary_position: x, initial_primary_velocity: 0, initial_damper_offset: y, initial_damper_velocity: 0 };
  const now = knobs.values();
  const before = Object.fromEntries(Object.keys(at).map((name) => [name, now[name]]));
  if (!await request({ type: 'set', values: at })) return;
  await service('reset');
  await connection.ask({ type: 'set', values: before });
}

/** Speeds of the rig that are offered. */
const SPEEDS = [[0.05, '1/20'], [0.2, '1/5'], [1, '1×'], [5, '5×']];
for (const [value, text] of SPEEDS) byId('rig-speed').append(element('option', { value: String(value), text }));

/** Show the speed of the rig, which may be one of somebody else's choice. */
function showSpeed(factor) {
  const choice = byId('rig-speed');
  choice.querySelector('[data-own]')?.remove();
  if (SPEEDS.every(([value]) => value !== factor)) {
    choice.append(element('option', { value: String(factor), 'data-own': '', text: factor ? `${digits(factor, 2)}×` : 'free' }));
  }
  choice.value = String(factor);
}

let stepping = false;
/** How many impacts were known when the next one was asked for, until the rig is seen moving. */
let known = -1;

/** Move a paused rig on; a key that is held down waits for each step to be done. */
async function step(name) {
  if (status !== 'paused' || stepping) return;
  stepping = true;
  known = name === 'step_to_impact' ? history.impacts.end : -1;
  await service(name);
  stepping = false;
}

/** Report an impact that was asked for and has not come after a while of motion. */
function reportLateImpact() {
  const before = known;
  known = -1;
  if (before < 0) return;
  setTimeout(() => {
    if (status !== 'paused' && history.impacts.end === before) toast('No impact so far: the rig runs on to the next one. Pause holds it here.');
  }, 2000);
}

/** Show which preset the rig has. */
function showPreset() {
  write(byId('preset-name'), presetList.find((one) => one.name === shared.preset)?.title ?? '');
  markPreset(shared.preset);
}

/** Offer rigs to choose from; the one that is shown stays among them though it is gone. */
function offer(names, shown) {
  const all = names.includes(shown) || !shown ? names : [shown, ...names];
  const choice = byId('rig-choice');
  choice.replaceChildren(...(all.length ? all : ['no rig']).map((name) => element('option', { value: name, text: name })));
  if (shown) choice.value = shown;
  choice.disabled = all.length < 2;
}

// What comes in

connection.addEventListener('hello', ({ detail }) => {
  hello = detail;
  history.clear();
  theory.clear();
  for (const id of ['map-line', 'curve-line']) write(byId(id), '');
  multipliers.stale = true;
  rig.clear();
  slow.clear();
  verdict.clear();
  ghostValues = {};
  rigValues = {};
  byId('clear-ghost').hidden = true;
  history.window = Number(shared.view.window) || 30;
  presetList = detail.presets;
  player.begin(detail);
  const live = detail.mode !== 'player';
  for (const id of ['pause', 'reset', 'rig-speed', ...STEPS]) byId(id).hidden = !live;
  drag.on = live && detail.steers !== false;
  byId('record').hidden = !live;
  for (const id of ['presets-open', 'tour-open']) byId(id).hidden = !live;
  if (!live) verdict.recorded();
  write(byId('knobs-title'), live ? 'Knobs' : 'What if');
  write(byId('preset-name'), live ? '' : 'as a ghost');
  curve.settable = live;
  shared.bag = detail.bag;
  offer(live ? detail.rigs : [detail.bag], live ? detail.rig : detail.bag);
  makePresets(presetList, loadPreset);
  knobs.make(detail.parameters);
  controller.make(detail.parameters);
  controller.report(null);
  history.recorded = !live;
  for (const one of detail.changes ?? []) if (one.kind !== 'stretch') history.change(one.time, knobs.done(one));
  takeValues(Object.fromEntries(detail.parameters.map((one) => [one.name, one.value])));
  recordings.show(detail.recordings);
  counted.latest = performance.now();
  setStatus(detail.rig || !live ? 'running' : 'gone');
  sendView();
  if (detail.steers === false) wanted = null;
  if (live && detail.rig && detail.parameters.length) applyWanted();
  if (!live && asked.time && asked.bag === shared.bag) {
    player.seek(asked.time);
    // Once: a connection that is lost later goes on elsewhere.
    asked.time = NaN;
  }
  if (!live && Object.keys(shared.values).length) turn(shared.values);
  if (live) showPreset();
});

/** Bring the rig to what the address asks for, once. */
async function applyWanted() {
  const state = wanted;
  wanted = null;
  if (!state) {
    // Loaded anew: what this tab has set before still stands in the address.
    if (!asked.bag) Object.assign(shared, { preset: asked.preset ?? shared.preset, values: { ...asked.values, ...shared.values } });
    return;
  }
  if (state.preset) await loadPreset(state.preset);
  // Where the node records, and whether, is not for a link to say.
  const values = Object.fromEntries(Object.entries(state.values).filter(([name]) => reproducible(name)));
  if (Object.keys(values).length) await turn(values);
}

function takeValues(values) {
  Object.assign(rigValues, values);
  if (values.force_frequencies) {
    // Some eight cycles of the force, or more
    if (!shared.view.window) chooseWindow((16 * Math.PI) / values.force_frequencies[0]);
  }
  if ('real_time_factor' in values) showSpeed(values.real_time_factor);
  if ('record' in values) {
    mark(byId('record'), 'aria-pressed', String(values.record));
    byId('record').lastChild.textContent = values.record ? 'Recording' : 'Record';
  }
  const all = rigValues;
  controller.take(all);
  // With a margin between the two, so that a knob that is dragged does not turn it to and fro
  const steep = document.body.classList.contains('steep') ? 0.6 : 0.8;
  document.body.classList.toggle('steep', Math.abs(all.angle) > steep);
  const frequency = all.force_frequencies?.[0] / (2 * Math.PI);
  portrait.seconds = frequency > 0 ? Math.min(40, 8 / frequency) : 10;
  const force = Math.abs(all.force_amplitudes?.[0] ?? 0);
  write(byId('rig-line'), [
    force > 0 ? `${withUnit(force, 'N')} at ${withUnit(frequency, 'Hz', 4)}` : 'no single force',
    all.force_amplitudes?.length > 1 ? `+${all.force_amplitudes.length - 1} harmonic${all.force_amplitudes.length > 2 ? 's' : ''}` : '',
    all.multisine_level > 0 ? `multisine ${withUnit(all.multisine_level, 'N')} rms` : '',
    `gap ${withUnit(all.gap, 'm')}`,
    all.gap_control && all.gap_control !== 'off' ? `${all.gap_control} control` : '',
  ].filter(Boolean).join(' · '));
  rig.stale = true;
}

/** Whether so much has changed that the scales of before say nothing. */
function isAnotherRig({ preset, values }) {
  const factor = values.gap / rigValues.gap;
  return Boolean(preset) || factor > 2 || factor < 0.5;
}

/** Choose all scales anew, from what moves since an instant. */
function anotherRig(time) {
  if (Number.isFinite(time)) history.begun = time;
  for (const picture of [rig, slow.drawing, traces, portrait, map]) picture.rescale();
}

connection.addEventListener('parameters', ({ detail }) => {
  // A knob that makes the ghost another rig stays where it was turned to.
  const values = Object.fromEntries(Object.entries(detail.values).filter(([name]) => !(name in ghostValues)));
  const line = knobs.done(detail);
  if (isAnotherRig(detail)) anotherRig(detail.time);
  knobs.take(values);
  takeValues(detail.values);
  if (!history.recorded) {
    history.change(detail.time, line, knobs.dragOf(detail.values));
    const preset = presetList.find((one) => one.title === detail.preset)?.name;
    if (preset && preset !== shared.preset) {
      // Chosen in another tab, or by hand
      Object.assign(shared, { preset, values: {} });
      showPreset();
      keepAddress();
    }
  }
  curve.stale = true;
});
connection.addEventListener('frame', ({ detail: frame }) => {
  history.add(frame);
  const now = performance.now();
  for (const { stop, impulse } of history.fresh) {
    rig.flash(stop, impulse, now);
    clicks.play(stop, impulse);
  }
  counted.frames += 1;
  counted.bytes += frame.bytes;
  counted.epoch = frame.epoch;
  counted.latest = now;
  const due = frame.paused ? 'paused' : 'running';
  if (!player.on && status !== 'lagging' && status !== due) setStatus(due);
});
connection.addEventListener('status', ({ detail }) => {
  counted.latest = performance.now();
  said = detail.text;
  player.status(detail);
  setStatus(detail.state, detail.text);
  if (detail.state === 'ended') player.show(detail.time);
});
connection.addEventListener('lost', () => setStatus('offline'));
connection.addEventListener('missing', () => {
  toast(said || 'There is no such rig or recording.', 'bad');
  setStatus('gone');
  // What the server offers instead.
  if (shared.rig || shared.bag) join({});
});
connection.addEventListener('rigs', ({ detail }) => {
  if (hello.mode !== 'player') offer(detail.list, hello.rig);
});
connection.addEventListener('diagnostics', ({ detail }) => {
  verdict.diagnostics(detail);
  controller.report(detail.controller);
});
connection.addEventListener('numbers', ({ detail }) => {
  numbers = detail;
  verdict.numbers(detail, theory);
  controller.numbers(detail);
  curve.place(detail.gap, detail.x_max_ratio_measured ?? NaN);
});
for (const type of ['orbit', 'gap_curve', 'theory_failed']) {
  connection.addEventListener(type, ({ detail }) => {
    theory.take(detail);
    curve.stale = true;
    multipliers.stale = true;
    redraw();
    verdict.numbers(numbers, theory);
    const { gap: best, basis } = theory.best;
    const sign = basis === 'part' ? '≈\u202f' : basis && `${basis} `;
    write(byId('curve-line'), best > 0 ? `best gap ${sign}${withUnit(best, 'm')}` : '');
    write(byId('map-line'), theory.orbit?.label ?? '');
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

byId('pause').addEventListener('click', () => service('pause'));
byId('reset').addEventListener('click', () => service('reset'));
byId('rig-speed').addEventListener('change', () => turn({ real_time_factor: Number(byId('rig-speed').value) }));
byId('step').addEventListener('click', () => step('step'));
byId('step-to-impact').addEventListener('click', () => step('step_to_impact'));
byId('record').addEventListener('click', async () => {
  const on = byId('record').getAttribute('aria-pressed') !== 'true';
  if (await request({ type: 'set', values: { record: on } })) takeValues({ record: on });
});
byId('rig-choice').addEventListener('change', () => join({ rig: byId('rig-choice').value }));
byId('back-live').addEventListener('click', () => join({}));
byId('clear-ghost').addEventListener('click', () => {
  ghostValues = {};
  shared.values = {};
  keepAddress();
  connection.send({ type: 'what_if', values: null });
  knobs.make(hello.parameters);
  byId('clear-ghost').hidden = true;
});
byId('slow').addEventListener('change', () => {
  slow.switch(byId('slow').checked);
  keepView('slow', byId('slow').checked ? '1' : '');
});
byId('sound').addEventListener('change', () => clicks.switch(byId('sound').checked));
byId('theory').addEventListener('change', () => {
  const on = byId('theory').checked;
  for (const picture of [traces, portrait, map]) picture.showTheory = on;
  redraw();
  keepView('theory', on ? '' : '0');
});
byId('link').addEventListener('click', async () => {
  if (hello.mode === 'live') {
    // The whole rig, or what differs from the preset that it started from, whoever turned it.
    const start = presetList.find((one) => one.name === shared.preset)?.values ?? {};
    shared.values = Object.fromEntries(Object.entries(knobs.values()).filter(
      ([name, value]) => reproducible(name) && JSON.stringify(value) !== JSON.stringify(start[name]),
    ));
  }
  keepAddress();
  await new Promise((resolve) => { setTimeout(resolve, 200); });
  try {
    await navigator.clipboard.writeText(hello.token ? `${location.origin}/?token=${hello.token}${location.hash}` : location.href);
    toast(hello.token ? 'A link to watch this rig has been copied; the one that steers it is in the terminal.' : 'The address of this rig has been copied.');
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
  if (event.target.closest('input, select, textarea, dialog, canvas, [role="dialog"], :popover-open')) return;
  if (event.key === ' ') {
    if (event.target.closest('button, a, summary')) return;
    event.preventDefault();
    if (player.on) player.play(!player.playing);
    else service('pause');
  } else if (event.key === 'r' && !player.on) service('reset');
  else if (player.on) {
    const [to, direction] = JUMP_KEYS[event.key] ?? [];
    if (to) player.jump(to, direction);
  } else if (event.key === '.') step('step');
  else if (event.key === 'ArrowRight') step('step_to_impact');
});

// The view

function keepView(name, value) {
  if (value) shared.view[name] = value;
  else delete shared.view[name];
  keepAddress();
}

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

const SHADES = ['', 'light', 'dark'];
const SHADE_NAMES = { '': 'Auto', light: 'Light', dark: 'Dark' };
function recolour() {
  globalThis.shade();
  readColours();
  traces.make();
  for (const picture of [rig, portrait, map, multipliers, curve, slow.drawing]) picture.stale = true;
  player.marks();
}
function setTheme(shade) {
  if (shade) document.documentElement.dataset.theme = shade;
  else delete document.documentElement.dataset.theme;
  write(byId('theme'), SHADE_NAMES[shade]);
  try {
    localStorage.setItem('theme', shade);
  } catch {
    // Storage may be switched off.
  }
  recolour();
}
byId('theme').addEventListener('click', () => {
  const now = document.documentElement.dataset.theme ?? '';
  const next = SHADES[(SHADES.indexOf(now) + 1) % SHADES.length];
  setTheme(next);
  keepView('theme', next);
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', recolour);
write(byId('theme'), SHADE_NAMES[document.documentElement.dataset.theme ?? '']);
let size = 0;
addEventListener('resize', () => {
  const now = parseFloat(getComputedStyle(document.documentElement).fontSize);
  if (now !== size) recolour();
  size = now;
});

/** Whether the tour has switched the gap control on. */
let toured = false;
startGlossary();
startTour({
  preset: (part) => {
    const found = presetList.find((one) => one.name.includes(part));
    if (found) loadPreset(found.name);
  },
  window: setWindow,
  widen: (factor) => {
    const gap = knobs.values().gap * factor;
    if (gap > 0) turn({ gap: Number(gap.toPrecision(3)) });
  },
  optimum: () => {
    const best = theory.curve?.optimum?.gap;
    if (best > 0) turn({ gap: Number(best.toPrecision(4)) });
    else toast('No best gap is known for this rig.');
  },
  control: (law) => {
    toured = true;
    turn({ gap_control: law });
  },
  // Without control the rig has a verdict. Whether it is on yet, the page may not know.
  end: () => {
    if (toured) turn({ gap_control: 'off' });
    toured = false;
  },
});

// Drawing: once for each frame of the screen, and only what has changed.

let drawn = -1;
let drawnImpacts = -1;

/** Draw the motion anew though nothing moves: theory is another one. */
function redraw() {
  drawn = -1;
  map.stale = true;
}

let spoken = 0;
function draw(now) {
  requestAnimationFrame(draw);
  const begun = performance.now();
  const anew = history.version !== drawn;
  const driven = (rigValues.force_amplitudes?.[0] ?? 1) !== 0;
  if ((anew || rig.stale || rig.flashing) && history.state) {
    const extent = history.reach(history.end - 4);
    const oneSided = !Number.isFinite(history.state.stop2);
    rig.draw(history.state, { extent, ghost: history.ghost, driven, oneSided, now });
    slow.options = { extent, oneSided };
  } else if (!history.state && rig.stale) rig.begin();
  slow.draw(now, slow.options);
  if (anew) {
    traces.draw();
    portrait.draw(now);
    write(byId('clock'), Number.isFinite(history.end) ? clock(history.end, status === 'paused') : '');
    player.show(history.end);
    drawn = history.version;
    counted.drawn += 1;
  } else if (portrait.stale) portrait.draw(now);
  if (player.canvas.stale) player.marks();
  if (history.impacts.end !== drawnImpacts || map.stale) {
    map.draw(now);
    drawnImpacts = history.impacts.end;
  }
  if (curve.stale) curve.draw();
  if (multipliers.stale) multipliers.draw(theory.orbit?.multipliers);
  // A server that is there says once a second how the rig is.
  if (status === 'running' && !player.on && now - counted.latest > SILENCE) setStatus('offline');
  if (now - spoken > 2000 && history.state) {
    spoken = now;
    const { x, angle } = history.state;
    mark(byId('rig-canvas'), 'aria-label', `The rig: M at ${withUnit(x, 'm')}, inclined by ${digits((angle * 180) / Math.PI, 3)} degrees, ${history.impacts.length} impacts in view`);
  }
  if (anew) {
    counted.work.push(performance.now() - begun);
    if (counted.work.length > 600) counted.work.shift();
  }
}

// Where there is room for it, all parameters are in view.
byId('more-knobs').open = matchMedia('(min-width: 110rem) and (min-height: 50rem)').matches;
byId('theory').checked = shared.view.theory !== '0';
for (const picture of [traces, portrait, map]) picture.showTheory = byId('theory').checked;
byId('slow').checked = shared.view.slow === '1';
slow.switch(byId('slow').checked);
history.window = Number(shared.view.window) || 30;
setWindow(history.window);
connection.join(shared);
requestAnimationFrame(draw);
