// The last stretch of the motion: columns of the traces, impacts, samples, turned knobs.

const ROOM = 16384;
const IMPACTS = 4000;
const SAMPLES = 6000;
/** Changes of the rig within this time are one, s. */
const AT_ONCE = 0.5;
const LINE = ['time', 'x', 'z', 'stop1', 'stop2'];
const SAMPLE = ['time', 'x', 'xv', 'z', 'zv', 'phase'];

/** Rows of numbers of which the oldest are dropped; one typed array for each field. */
class Rows {
  constructor(fields, room) {
    this.fields = fields;
    this.room = room;
    this.arrays = fields.map(() => new Float64Array(2 * room));
    this.clear();
  }

  clear() {
    this.start = 0;
    this.end = 0;
  }

  get length() {
    return this.end - this.start;
  }

  push(...values) {
    if (this.end === 2 * this.room) {
      const start = Math.max(this.start, this.end - this.room);
      for (const array of this.arrays) array.copyWithin(0, start, this.end);
      this.end -= start;
      this.start = 0;
    }
    for (let n = 0; n < values.length; n += 1) this.arrays[n][this.end] = values[n];
    this.end += 1;
    if (this.length > this.room) this.start += 1;
  }

  /** Drop rows whose first field is below a value. */
  dropBefore(value) {
    while (this.start < this.end && this.arrays[0][this.start] < value) this.start += 1;
  }

  field(name) {
    return this.arrays[this.fields.indexOf(name)];
  }
}

export class History {
  constructor() {
    this.window = 30;
    this.line = new Rows(LINE, ROOM);
    this.impacts = new Rows(['time', 'stop', 'x', 'primary', 'damper', 'impulse', 'phase', 'y'], IMPACTS);
    this.samples = new Rows(SAMPLE, SAMPLES);
    // Those of the what-if beside a recording
    this.ghostLine = new Rows(LINE, ROOM);
    this.ghostSamples = new Rows(SAMPLE, SAMPLES);
    this.changes = [];
    /** Whether all that was done is known from the start. */
    this.recorded = false;
    this.clear();
  }

  clear() {
    this.line.clear();
    this.impacts.clear();
    this.samples.clear();
    this.clearGhost();
    this.changes = [];
    this.end = NaN;
    this.state = null;
    this.fresh = [];
    this.version = 0;
    this.impactVersion = 0;
  }

  clearGhost() {
    this.ghostLine.clear();
    this.ghostSamples.clear();
    this.ghost = null;
  }

  /** Take in a frame. */
  add(frame) {
    if (frame.replace || frame.end < this.end - 1e-9) {
      const changes = this.changes;
      this.clear();
      this.changes = changes;
    }
    const { end, columns, impacts, samples } = frame;
    if (frame.replaceGhost) this.clearGhost();
    this.addColumns(this.line, end, columns);
    this.addColumns(this.ghostLine, end, frame.ghostColumns);
    this.fresh = [];
    for (let n = 0; n < impacts.length; n += 8) {
      const [offset, stop, x, primary, damper, impulse, phase, y] = impacts.subarray(n, n + 8);
      this.impacts.push(end + offset, stop, x, primary, damper, impulse, phase, y);
      if (!frame.replace) this.fresh.push({ stop, impulse });
    }
    if (impacts.length) this.impactVersion += 1;
    this.addSamples(this.samples, end, samples);
    this.addSamples(this.ghostSamples, end, frame.ghostSamples);
    this.end = end;
    this.state = frame.state;
    this.ghost = frame.ghost;
    this.paused = frame.paused;
    for (const line of [this.line, this.ghostLine]) line.dropBefore(end - this.window - 1);
    while (!this.recorded && this.changes.length && this.changes[0].time < end - 120) this.changes.shift();
    this.version += 1;
  }

  /** Two points of a line through each column, in the order that follows on from the one before. */
  addColumns(line, end, columns) {
    const [xs, zs] = [line.field('x'), line.field('z')];
    for (let n = 0; n < columns.length; n += 8) {
      const [xLow, xHigh, zLow, zHigh, stop1, stop2, from, to] = columns.subarray(n, n + 8);
      const first = end + from + 0.25 * (to - from);
      const second = end + from + 0.75 * (to - from);
      const [lastX, lastZ] = [xs[line.end - 1] ?? 0, zs[line.end - 1] ?? 0];
      const [xa, xb] = Math.abs(lastX - xLow) <= Math.abs(lastX - xHigh) ? [xLow, xHigh] : [xHigh, xLow];
      const [za, zb] = Math.abs(lastZ - zLow) <= Math.abs(lastZ - zHigh) ? [zLow, zHigh] : [zHigh, zLow];
      line.push(first, xa, za, xa + stop1, xa + stop2);
      line.push(second, xb, zb, xb + stop1, xb + stop2);
    }
  }

  addSamples(rows, end, samples) {
    for (let n = 0; n < samples.length; n += 6) {
      const [offset, x, xv, z, zv, phase] = samples.subarray(n, n + 6);
      rows.push(end + offset, x, xv, z, zv, phase);
    }
  }

  /** Keep what was done to the rig as a line in the traces. */
  change(time, text) {
    if (!Number.isFinite(time) || !text) return;
    const last = this.changes.at(-1);
    const soon = last && Math.abs(time - last.time) < AT_ONCE;
    // A preset is set, and then the rig is reset.
    if (text === 'reset' && soon) return;
    // A knob that is dragged is turned once: to where it is left.
    const knob = /^([^=,]+) = [^=]+$/.exec(text)?.[1];
    if (knob && soon && last.text.startsWith(`${knob} = `)) this.changes.pop();
    this.changes.push({ time, text });
    if (last && last.time > time) this.changes.sort((a, b) => a.time - b.time);
    if (!this.recorded && this.changes.length > 60) this.changes.shift();
    this.version += 1;
  }

  /** When a knob was turned last, or minus infinity. */
  get lastChange() {
    const past = this.changes.filter((change) => !(change.time > this.end));
    return past.length ? past.at(-1).time : -Infinity;
  }

  /** Largest |X| and |Y| of the last seconds, from the samples, those of the what-if too. */
  extent(seconds) {
    let [swing, apart] = [0, 0];
    for (const samples of [this.samples, this.ghostSamples]) {
      const [time, x, z] = [samples.field('time'), samples.field('x'), samples.field('z')];
      for (let n = samples.end - 1; n >= samples.start && time[n] >= this.end - seconds; n -= 1) {
        swing = Math.max(swing, Math.abs(x[n]));
        apart = Math.max(apart, Math.abs(z[n] - x[n]));
      }
    }
    return { swing, apart };
  }
}
