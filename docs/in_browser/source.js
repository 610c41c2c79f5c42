// SPDX-License-Identifier: Apache-2.0
// A rig in the page: it takes the place of the WebSocket to the page server, and sends the same
// messages and frames. The rig itself, its parameters and its numbers are translated Python.

const NAME = 'this browser';
/** Samples per second of rig time, and how many of them and of impacts are kept. */
const RATE = 200;
const MOST_SAMPLES = 70 * RATE;
const MOST_IMPACTS = 20000;
/** Longest time to compute between two frames, and longest time that a frame makes up for, s. */
const BUDGET = 0.012;
const LONGEST = 0.25;
/** From the start of a rig to the first question to theory, ms. */
const BEFORE_THEORY = 150;
/** Parameters of the node that mean something here. */
const SETTINGS = { real_time_factor: 1 };
/** What needs the node. */
const ELSEWHERE = new Set(['external']);

const load_presets = () => PRESETS;

Rig.prototype._reason = function reason() {
  return `the rig had ${this._run.in_period} events within one period, the last at ${$format(this.time, '.9g')} s: ${REMEDY}`;
};

const tables = { rig: RigParameters, control: GapControlParameters, initial: InitialConditions };
const finite = (value) => (Number.isFinite(value) ? value : null);

/** The place of the WebSocket to the page server: the page sends texts to it, and gets messages and frames. */
class Socket {
  constructor() {
    this.readyState = 0;
    const rig = new RigInPage((data) => this.onmessage?.({ data }));
    this.send = (text) => queueMicrotask(() => rig.receive(JSON.parse(text)));
    this.close = () => {
      this.readyState = 3;
      rig.end();
    };
    queueMicrotask(() => {
      this.readyState = 1;
      rig.begin();
    });
  }
}

/** What the page is shown, as `page/live.py` shows a rig of the network. */
class RigInPage extends Source {
  /** `out` takes messages as JSON, and frames as they are. */
  constructor(out) {
    super(() => ({ mode: 'in_page', rig: NAME, rigs: [NAME], recordings: [], steers: true }));
    this.clients = [{ put: (message) => out(JSON.stringify(message)) }];
    this.out = out;
    this.course = 0;
    this.theorist = null;
  }

  end() {
    clearInterval(this.timer);
    clearTimeout(this.first);
    this.theorist?.terminate();
  }

  // The rig

  begin() {
    const { rig, control, initial } = Object.values(PRESETS)[0];
    this.parts = { rig, control, initial };
    this.settings = { ...SETTINGS };
    this.rig = new Rig(rig, initial, 0, control);
    Object.assign(this, { k: 0, now: 0, wall: null, paused: false, replace: true, until: null, window: 30, reported: -Infinity, late: 0 });
    this.rows = { samples: [], impacts: [], measured: [], acts: [], ghost_samples: [], ghost_impacts: [] };
    this.fresh = this.none();
    this.sample();
    this.timer = setInterval(() => this.tick(performance.now() / 1000), 1000 / 60);
    this.send({
      ...this.hello(), parameters: this.knobs(), preset: preset_with(this.values()),
      presets: Object.values(PRESETS).map(({ name, title, description, values }) => ({ name, title, description, values })),
    });
    this.report();
    // The rig moves before its theory takes part of the processor.
    this.first = setTimeout(() => this.ask(), BEFORE_THEORY);
  }

  none() {
    return Object.fromEntries(Object.keys(this.rows).map((name) => [name, []]));
  }

  values() {
    const { rig, control, initial } = this.parts;
    return as_json({ ...rig, ...initial, ...control, ...this.settings });
  }

  knobs() {
    const known = knobs_of(this.values());
    return known.map((one) => ({ ...one, choices: one.choices.filter((choice) => !ELSEWHERE.has(choice)) }));
  }

  /** Phase of the first harmonic at an instant, in cycles; NaN without a force. */
  phase(time) {
    const { _run: run, _waves: [wave], _present: rig } = this.rig;
    const [amplitude, frequency] = rig.first_harmonic;
    return amplitude && frequency ? $modulo(FirstAngle.of(rig, run.time + run.time_low, wave.angle).at(time), 1) : NaN;
  }

  add(name, row) {
    this.rows[name].push(row);
    this.fresh[name].push(row);
  }

  sample() {
    const { rig, parts } = this;
    const s = rig.sample();
    const stop_2 = parts.rig.one_sided ? NaN : s.stop_2;
    this.add('samples', [s.time, s.x, s.primary_velocity, s.z, s.damper_velocity, s.stop_1, stop_2, parts.rig.angle, this.phase(s.time), s.base, s.base_velocity]);
  }

  take(events) {
    for (const e of events) if (e.kind === IMPACT) this.add('impacts', [...IMPACT_COLUMNS.slice(0, -1).map((name) => e[name]), this.phase(e.time)]);
    for (const act of this.rig.acts) {
      const command = act.action === Action.COMMAND;
      this.add('acts', [act.time, Number(command), act.target_1, act.target_2, act.force, act.energy_1 + act.energy_2]);
    }
  }

  /** Run to an instant, sample by sample. */
  advance(time) {
    while ((this.k + 1) / RATE <= time) {
      this.k += 1;
      if (this.k / RATE < this.rig.time) continue;
      this.take(this.rig.advance(this.k / RATE));
      this.sample();
    }
  }

  tick(wall) {
    const since = Math.min(LONGEST, wall - (this.wall ?? wall));
    this.wall = wall;
    if (!this.paused) this.go(since * this.settings.real_time_factor);
    if (this.paused && !this.replace && !this.fresh.samples.length && this.reported > wall - 1) return;
    if (this.rows.samples.length > MOST_SAMPLES) this.rows.samples.splice(0, MOST_SAMPLES / 7);
    for (const name of ['impacts', 'acts']) if (this.rows[name].length > MOST_IMPACTS) this.rows[name].splice(0, MOST_IMPACTS / 4);
    if (wall > this.reported + 1) {
      this.reported = wall;
      this.report();
    }
    this.frame();
  }

  /** Run on by some time, as far as the device is fast enough. */
  go(time) {
    const begun = performance.now() / 1000;
    const end = this.now + time;
    try {
      while (this.k / RATE < end && !this.paused) {
        this.advance((this.k + 1) / RATE);
        if (this.until?.()) Object.assign(this, { until: null, paused: true });
        if (performance.now() / 1000 > begun + BUDGET) break;
      }
      this.late = 0.95 * this.late + (this.k / RATE < end ? 1 : 0);
      this.now = this.paused ? this.k / RATE : Math.min(end, this.k / RATE);
    } catch (error) {
      if (!(error instanceof RunawayError)) throw error;
      Object.assign(this, { paused: true, until: null, now: this.rig.time });
      this.send({ type: 'notice', text: error.message });
      this.report();
    }
    if (this.paused) this.report();
  }

  // To the page

  frame() {
    const { replace } = this;
    const start = this.now - this.window;
    const parts = replace ? Object.fromEntries(Object.entries(this.rows).map(([name, rows]) => [name, rows.filter(([time]) => time > start)])) : this.fresh;
    [this.replace, this.fresh] = [false, this.none()];
    const tables = Object.entries(parts).map(([name, rows]) => [name, rows.flatMap(([time, ...rest]) => [time - this.now, ...rest])]);
    this.out({ paused: this.paused, replace, replace_ghost: replace, end: this.now, epoch: Date.now() / 1000, ...Object.fromEntries(tables) });
  }

  report() {
    const lags = !this.paused && this.late > 5;
    const state_ = this.paused ? 'paused' : lags ? 'lagging' : 'running';
    this.send({ type: 'status', state: state_, text: lags ? 'this device computes the rig more slowly than asked for' : '', time: this.now });
    const { samples, impacts, acts } = this.rows;
    const table = (rows, width) => new Matrix([rows.length, width], rows.flatMap((row) => row.slice(0, width)));
    // Of the many samples, numbers need times and X.
    const motion = { samples: table(samples, 2), impacts: table(impacts, IMPACT_COLUMNS.length), acts: table(acts, LAYOUT.tables.acts.length) };
    this.send(numbers_of(this.parts.rig, motion, this.now));
  }

  // Theory

  /** Ask for the theory of the rig as it is now; the answers replace what is known of the one before. */
  ask() {
    const { parts: { rig, control }, rig: { _run: run, _waves: waves } } = this;
    if (!this.theorist) {
      this.theorist = new Worker(URL.createObjectURL(new Blob([`'use strict';(${program})()`])));
      this.theorist.onmessage = ({ data }) => this.answer(data);
    }
    this.course += 1;
    this.theorist.postMessage({ course: this.course, rig: rig.as_dict(), control: control.gap_control, run: { ...run }, angles: waves.map(({ angle }) => angle) });
  }

  answer({ course, document }) {
    if (course !== this.course) return;
    this.send_theory(document);
    const { orbit, theory_failed: failed } = document;
    const verdict = orbit?.found ? `${orbit.label}, ${orbit.stable ? 'stable' : 'unstable'}` : failed ? 'No theory' : orbit ? 'No periodic motion' : '';
    this.send({ type: 'diagnostics', level: 'none', kind: '', message: '', verdict, agreement: '', controller: null });
  }

  // From the page

  receive(message) {
    let answer = { ok: true, reason: '' };
    try {
      answer = { ...answer, ...this.handle(message) };
    } catch (error) {
      if (!(error instanceof Exception)) throw error;
      answer = { ok: false, reason: error.message };
    }
    if ('id' in message) this.send({ type: 'answer', id: message.id, ...answer });
  }

  handle({ type: kind, name, values, window: seconds }) {
    if (kind === 'view') Object.assign(this, { window: seconds, replace: true });
    else if (kind === 'set') return { values: this.set(read_values(values)) };
    else if (kind === 'begin') this.restart(this.values(), this.parted(read_values(values)));
    else if (kind !== 'service') throw new RequestError(`${kind} needs the installed package`);
    else if (name === 'reset') this.reset();
    else if (name === 'pause') {
      Object.assign(this, { paused: !this.paused, until: null });
      this.report();
    } else {
      if (!this.paused) throw new RequestError('the rig runs: pause it first');
      const { k, rows: { impacts: { length } } } = this;
      this.until = name === 'step' ? () => this.k > k : () => this.rows.impacts.length > length;
      this.paused = false;
    }
    return {};
  }

  /** Return the parts of the rig with values; what is wrong with one says the table of parameters. */
  parted(values) {
    const before = this.values();
    for (const name of Object.keys(values)) {
      if (name in before) continue;
      if (name in ALL_SPECS || STRUCTURE.includes(name)) throw new RequestError(`${name} needs the installed package`);
      const near = similar_names(name, ALL_SPECS);
      throw new RequestError(`${name} is not a parameter of this rig: ${near ? `did you mean ${near}?` : 'the documentation has a table of all parameters'}`);
    }
    const parts = { ...this.parts };
    for (const [part, kind] of Object.entries(tables)) {
      const own = Object.fromEntries(Object.entries(values).filter(([name]) => name in kind.specs));
      if (Object.keys(own).length) parts[part] = parts[part].replace(own);
    }
    if ('initial' in parts && parts.initial !== this.parts.initial) parts.initial.check_within(parts.rig);
    return parts;
  }

  /** Set values, all or none of them. */
  set(values) {
    const before = this.values();
    const parts = this.parted(values);
    for (const name of Object.keys(SETTINGS)) if (name in values) this.settings[name] = ALL_SPECS[name].checked(values[name]) || 1;
    const wait = this.rig.wait_for_change(parts.rig);
    if (wait > 0 && wait < Infinity) {
      this.advance(this.rig.time + wait);
      this.take(this.rig.advance(this.rig.time + wait));
      this.now = Math.max(this.now, this.rig.time);
    }
    this.parts = parts;
    this.take(this.rig.change(parts.rig, parts.control));
    this.say(before, 'change');
    return values;
  }

  reset() {
    this.restart(this.values(), this.parts);
  }

  /** A rig from its start on; time goes on. */
  restart(before, parts) {
    this.parts = parts;
    const { rig, control, initial } = parts;
    this.rig = new Rig(rig, initial, this.rig.time, control);
    this.say(before, 'reset');
  }

  /** Report a change or a reset at the present time. */
  say(before, kind) {
    // The newest sample is one after what has been done.
    const { samples } = this.rows;
    if (samples.length && samples.at(-1)[0] === this.rig.time) {
      samples.pop();
      this.fresh.samples = [];
      this.sample();
      this.replace = true;
    }
    const change = change_between(before, this.values(), this.rig.time, kind);
    if (change !== null) this.send({ type: 'parameters', ...change });
    this.ask();
    this.report();
  }
}

/** In a worker: answer the newest request, in parts between which another one may come; after an answer that has some time. */
function theorist() {
  const [LONGEST_PART, QUIET] = [15, 200];
  let [asked, before, working, wake] = [null, null, false, () => {}];
  const wait = (time) => new Promise((resolve) => {
    wake = resolve;
    setTimeout(resolve, time);
  });
  const work = async () => {
    working = true;
    for (let request = asked; request; request = asked === request ? null : asked) {
      let begun = performance.now();
      for (const answer of theoryOf({ ...request, parameters: RigParameters.$of(request.rig), before })) {
        if (answer) {
          const { expected, ...document } = answer;
          before = expected ?? before;
          postMessage({ course: request.course, document });
        }
        if (answer || performance.now() > begun + LONGEST_PART) {
          await wait(answer ? QUIET : 0);
          begun = performance.now();
        }
        if (asked !== request) break;
      }
    }
    working = false;
  };
  globalThis.onmessage = ({ data }) => {
    asked = data;
    wake();
    if (!working) work();
  };
}

if (globalThis.WorkerGlobalScope) theorist();
else globalThis.rigInPage = () => new Socket();
// For the console, and for the comparison with Python
globalThis.impactDamperRig = { Rig, RigParameters, InitialConditions, GapControlParameters, presets: PRESETS, read_values, numbers_of, Matrix, theoryOf, eigenvalues };
