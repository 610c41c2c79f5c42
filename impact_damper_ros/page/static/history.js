// SPDX-License-Identifier: Apache-2.0
// The last stretch of the motion, as it comes: samples, impacts, turned knobs.

const ROOM = 2 ** 17;
const IMPACTS = 2 ** 12;
/** Changes of the rig within this time are one, s. */
const AT_ONCE = 0.5;
/** A state is known for so long after the last sample, s. */
const HELD = 0.1;
/** What a field is before the server has named it. */
const NOTHING = new Float64Array(0);
const KINDS = ['samples', 'impacts', 'measured', 'acts'];
/** Columns that count from the laboratory: places, and velocities. The base has both, too. */
const PLACES = ['x', 'z', 'stop_1', 'stop_2'];
const RATES = ['primary', 'damper'].flatMap((mass) => ['', '_before', '_after'].map((when) => `${mass}_velocity${when}`));

/** Rows of numbers of which the oldest are dropped; one typed array for each field. */
class Rows {
  constructor(room) {
    this.room = room;
    this.shape([]);
  }

  /** Take rows with these fields, of which the first is the time. */
  shape(fields) {
    if (fields.join() !== this.fields?.join()) {
      this.fields = fields;
      this.arrays = fields.map(() => new Float64Array(2 * this.room));
    }
    this.clear();
  }

  clear() {
    this.start = 0;
    this.end = 0;
  }

  get length() {
    return this.end - this.start;
  }

  /** Append rows of which the first field counts from an instant; return the place of the first of them. */
  push(rows, since) {
    const width = this.fields.length;
    for (let n = 0; n < rows.length; n += width) {
      if (this.end === 2 * this.room) {
        for (const array of this.arrays) array.copyWithin(0, this.room, this.end);
        [this.start, this.end] = [0, this.room];
      }
      this.arrays[0][this.end] = since + rows[n];
      for (let k = 1; k < width; k += 1) this.arrays[k][this.end] = rows[n + k];
      this.end += 1;
      if (this.length > this.room) this.start += 1;
    }
    return Math.max(this.start, this.end - rows.length / (width || 1));
  }

  field(name) {
    return this.arrays[this.fields.indexOf(name)] ?? NOTHING;
  }

  row(n) {
    return Object.fromEntries(this.fields.map((name, k) => [name, this.arrays[k][n]]));
  }

  /** Place of the first row that is later than an instant, or the end. */
  after(time) {
    const times = this.field('time');
    let [low, high] = [this.start, this.end];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] > time) high = middle;
      else low = middle + 1;
    }
    return low;
  }
}

/** Place on the cubic through two places with their velocities, each given as time, place and velocity. */
function between(/** @type {number[]} */ [t0, x0, v0], /** @type {number[]} */ [t1, x1, v1], t) {
  const length = Math.max(t1 - t0, 1e-12);
  const share = Math.min(1, Math.max(0, (t - t0) / length));
  const rest = 1 - share;
  return x0 * rest ** 2 * (1 + 2 * share) + x1 * share ** 2 * (1 + 2 * rest) + length * share * rest * (v0 * rest - v1 * share);
}

/** What is known of the motion of one rig. */
class Motion {
  /** Whether positions and velocities count from the base. */
  relative = false;

  constructor() {
    this.samples = new Rows(ROOM);
    this.impacts = new Rows(IMPACTS);
    this.measured = new Rows(ROOM);
    this.acts = new Rows(IMPACTS);
  }

  /** Take tables with these fields. */
  shape(tables) {
    for (const kind of KINDS) this[kind].shape(tables[kind] ?? []);
  }

  clear() {
    for (const kind of KINDS) this[kind].clear();
  }

  /** Take in rows of a kind, which count from the laboratory. */
  push(kind, rows, since) {
    const first = this[kind].push(rows, since);
    if (this.relative) this.count(this[kind], first, -1);
  }

  /** Let positions and velocities count from the base, or from the laboratory. */
  countFrom(relative) {
    if (relative === this.relative) return;
    this.relative = relative;
    for (const kind of KINDS) this.count(this[kind], this[kind].start, relative ? -1 : 1);
  }

  /** Let rows from a place on count from the base (sign -1), or from the laboratory again (1). */
  count(rows, first, sign) {
    const { samples } = this;
    const [times, base, rate] = ['time', 'base', 'base_velocity'].map((name) => samples.field(name));
    if (!samples.length || rows === this.acts) return;
    const moved = [[PLACES, base], [RATES, rate]].flatMap(([names, values]) => names.map((name) => [rows.field(name), values])).filter(([column]) => column.length);
    const instants = rows.field('time');
    for (let n = first; n < rows.end; n += 1) {
      const later = Math.min(Math.max(samples.after(instants[n]), samples.start + 1), samples.end - 1);
      const before = Math.max(samples.start, later - 1);
      const length = times[later] - times[before];
      const part = length > 0 ? Math.min(1, Math.max(0, (instants[n] - times[before]) / length)) : 0;
      for (const [column, values] of moved) column[n] += sign * (values[before] + part * (values[later] - values[before]));
    }
  }

  /** The state at an instant: between samples and impacts by cubics through places and velocities. */
  at(time) {
    const { samples, impacts } = this;
    const n = samples.after(time) - 1;
    if (n < samples.start) return null;
    const state = samples.row(n);
    if (this.relative) state.base = 0;
    if (n + 1 === samples.end) return time > state.time + HELD ? null : state;
    const next = samples.row(n + 1);
    let [left, right] = [state, next].map((one) => [[one.time, one.x, one.primary_velocity], [one.time, one.z, one.damper_velocity]]);
    const hit = impacts.after(time);
    if (hit > impacts.start && impacts.arrays[0][hit - 1] > state.time) {
      const { time: t, x, y, primary_velocity_after: xRate, damper_velocity_after: zRate } = impacts.row(hit - 1);
      left = [[t, x, xRate], [t, x + y, zRate]];
    }
    if (hit < impacts.end && impacts.arrays[0][hit] < next.time) {
      const { time: t, x, y, primary_velocity_before: xRate, damper_velocity_before: zRate } = impacts.row(hit);
      right = [[t, x, xRate], [t, x + y, zRate]];
    }
    const [x, z] = [0, 1].map((k) => between(left[k], right[k], time));
    const base = this.relative ? 0 : state.base + ((next.base - state.base) * (time - state.time)) / (next.time - state.time);
    const turned = (((next.phase - state.phase) % 1) + 1) % 1;
    const phase = (state.phase + (turned * (time - state.time)) / (next.time - state.time)) % 1;
    // The stops ride on M.
    return { ...state, x, z, stop_1: state.stop_1 + x - state.x, stop_2: state.stop_2 + x - state.x, phase, base };
  }
}

export class History {
  constructor() {
    this.window = 30;
    this.own = new Motion();
    // The what-if beside a recording
    this.other = new Motion();
    /** Whether all that was done is known from the start. */
    this.recorded = false;
    this.clear();
  }

  clear() {
    this.own.clear();
    this.other.clear();
    this.changes = [];
    this.end = NaN;
    /** Since when the rig is the one that it is. */
    this.begun = -Infinity;
    this.state = null;
    this.ghost = null;
    this.version = 0;
  }

  get impacts() {
    return this.own.impacts;
  }

  /** Begin with the tables that a server sends. */
  shape(/** @type {Record<string, string[]>} */ { ghost_samples: samples, ghost_impacts: impacts, ...tables }) {
    this.own.shape(tables);
    this.other.shape({ samples, impacts });
    this.clear();
  }

  /** Take in a frame. */
  add(frame) {
    const { end } = frame;
    if (frame.replace) this.own.clear();
    if (frame.replace_ghost) this.other.clear();
    for (const kind of KINDS) this.own.push(kind, frame[kind], end);
    for (const kind of ['samples', 'impacts']) this.other.push(kind, frame[`ghost_${kind}`], end);
    this.end = end;
    this.look();
    this.paused = frame.paused;
    while (!this.recorded && this.changes.length && this.changes[0].time < end - 120) this.changes.shift();
    this.version += 1;
  }

  /** Look at the state at the end. */
  look() {
    this.state = this.own.at(this.end) ?? this.state;
    this.ghost = this.other.samples.length ? this.other.at(this.end) : null;
  }

  /** Let positions and velocities count from the base, or from the laboratory. */
  countFrom(relative) {
    for (const motion of [this.own, this.other]) motion.countFrom(relative);
    this.look();
    this.version += 1;
  }

  /** Keep what was done to the rig as a line in the traces; `name` is the parameter if it is a single one. */
  change(time, { text, name }, drag = 0) {
    if (!Number.isFinite(time) || !text) return;
    const last = this.changes.at(-1);
    const soon = last && Math.abs(time - last.time) < AT_ONCE;
    // A preset is set, and then the rig is reset.
    if (text === 'reset' && soon) return;
    // A knob that is dragged is turned once: to where it is left.
    const same = soon || (drag && drag === last?.drag);
    if (name && same && last.name === name) this.changes.pop();
    this.changes.push({ time, text, name, drag });
    if (last && last.time > time) this.changes.sort((a, b) => a.time - b.time);
    if (!this.recorded && this.changes.length > 60) this.changes.shift();
    this.version += 1;
  }

  /** When a knob was turned last, or minus infinity. */
  get lastChange() {
    return this.changes.findLast((change) => !(change.time > this.end))?.time ?? -Infinity;
  }

  /** From where to where masses and stops were since an instant, the largest |X|, |Y| and motion of the base; the what-if too. */
  reach(since) {
    let [low, high, lower, upper, swing, apart, shaken] = [0, 0, 0, 0, 0, 0, 0];
    const from = Math.max(since, this.begun);
    for (const { samples } of [this.own, this.other]) {
      const [x, z, stop_1, stop_2, base] = ['x', 'z', 'stop_1', 'stop_2', 'base'].map((name) => samples.field(name));
      for (let n = samples.after(from); n < samples.end; n += 1) {
        low = Math.min(low, x[n], z[n]);
        high = Math.max(high, x[n], z[n]);
        // Without stop 2 it is NaN.
        lower = Math.min(lower, stop_1[n], stop_2[n] || 0);
        upper = Math.max(upper, stop_1[n], stop_2[n] || 0);
        swing = Math.max(swing, Math.abs(x[n]));
        apart = Math.max(apart, Math.abs(z[n] - x[n]));
        if (!this.own.relative) shaken = Math.max(shaken, Math.abs(base[n]));
      }
    }
    return { low, high, lower, upper, swing, apart, shaken };
  }
}
