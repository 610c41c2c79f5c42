// SPDX-License-Identifier: Apache-2.0
// What the page knows: what the server has sent of the rig, and what the address is to hold. Only this module writes it.
//
// Events have the name of what has changed: hello, status, values, change, frame, numbers, diagnostics,
// theory, preset, whatIf, rigs, recordings, view, and the messages compare_done, what_if, notice and seek_done; drawn, once
// for each picture of the screen: words that change with each frame are written then.

import { writeAddress } from './address.js';
import { History } from './history.js';
import { Reporter } from './protocol.js';
import { Theory } from './theory.js';
import { changeInWords, Units } from './words.js';

/** @import { Diagnostics, Frame, Hello, ListedRecording, Numbers, Parameters, ServerMessage, Values } from './messages.js' */

/** Parameters that are part of a link: of the rig, of its control and of its start, not of the node. */
const REPRODUCIBLE = new Set(['rig', 'forcing', 'control']);
const same = (one, other) => JSON.stringify(one) === JSON.stringify(other);

export class Store extends Reporter {
  /** `opened` is what the address held, `own` whether this page wrote it: then there is nothing to reproduce. */
  constructor(opened, own) {
    super();
    this.opened = opened;
    this.history = new History();
    this.theory = new Theory();
    this.units = new Units();
    /** @type {Hello} */
    this.hello = { type: 'hello', version: '', mode: 'live', rig: '', bag: '', parameters: [], presets: [], rigs: [], recordings: [], frame: null, steers: true };
    this.status = 'connecting';
    /** What the server has added to the last status. */
    this.statusText = '';
    this.numbers = /** @type {Partial<Numbers>} */ ({});
    this.diagnostics = /** @type {Diagnostics | null} */ (null);
    this.recordings = /** @type {ListedRecording[]} */ ([]);
    /** Values of the rig itself; beside a recording the knobs hold those of the what-if. */
    this.values = /** @type {Values} */ ({});
    this.whatIf = /** @type {Values} */ ({});
    /** The best gap of a structure, and the values of its rig, as long as the rig is that one. */
    this.design = /** @type {{ gap: number, values: Values } | null} */ (null);
    /** What of the address still has to be sent to the rig. */
    this.wanted = own ? null : opened;
    /** What the address is to hold. */
    this.address = { rig: opened.rig ?? '', bag: opened.bag ?? '', preset: '', values: opened.bag ? opened.values : {}, view: { ...opened.view } };
    /** The parameter that is dragged, and the number of the drag. */
    this.drag = { name: '', number: 0 };
    this.history.window = Number(this.address.view.window) || 30;
    /** Whether what theory predicts is drawn over the motion. */
    this.showTheory = true;
    /** Measurement: frames that have come in. */
    this.frames = 0;
  }

  /** Whether the rig is part of this page: it begins anew with the page, and nothing else can reach it. */
  get isInPage() { return this.hello.mode === 'in_page'; }

  get isLive() { return this.hello.mode !== 'player'; }

  /** Whether this page may change the rig. */
  get steers() { return this.isLive && this.hello.steers; }

  /** Take in a message of the server. */
  receive(/** @type {ServerMessage} */ message) {
    switch (message.type) {
      case 'hello': return this.begin(message);
      case 'status':
        this.statusText = message.text;
        this.setStatus(message.state, message.text, message.time ?? NaN);
        return undefined;
      case 'parameters': return this.takeChange(message);
      case 'numbers': case 'diagnostics':
        Object.assign(this, { [message.type]: message });
        return this.emit(message.type);
      case 'orbit': case 'gap_curve': case 'theory_failed':
        this.theory.take(message);
        return this.emit('theory');
      case 'recordings':
        this.recordings = message.list;
        return this.emit('recordings');
      case 'rigs':
        this.hello.rigs = message.list;
        return this.emit('rigs');
      case 'seek_done':
        return this.keepAddress(message.time);
      default:
        return this.emit(message.type, message);
    }
  }

  begin(/** @type {Hello} */ hello) {
    const live = hello.mode !== 'player';
    if (!live || hello.rig !== this.hello.rig) this.design = null;
    const values = Object.fromEntries(hello.parameters.map((one) => [one.name, one.value]));
    Object.assign(this, { hello, values, whatIf: {}, units: new Units(values), recordings: hello.recordings, numbers: {}, diagnostics: null });
    this.address.bag = hello.bag;
    this.history.shape(hello.frame.tables);
    this.history.window = Number(this.address.view.window) || 30;
    this.history.recorded = !live;
    this.theory.clear();
    for (const one of hello.changes ?? []) {
      if (one.kind !== 'stretch') this.history.change(one.time, changeInWords(one, {}, hello.parameters, this.units));
    }
    if (live && !this.steers) {
      // Who watches sees the rig as it is, whatever the address asks for.
      this.wanted = null;
      Object.assign(this.address, { preset: '', values: {} });
    }
    if (live && hello.preset) this.address.preset = this.presetOf(hello.preset);
    this.checkDesign(values);
    this.emit('hello');
    this.emit('theory');
    this.emit('values', values);
    this.emit('recordings');
    this.emit('preset');
    this.setStatus(hello.rig || !live ? 'running' : 'gone');
  }

  presetOf(title) {
    return this.hello.presets.find((one) => one.title === title)?.name ?? '';
  }

  takeChange(/** @type {Parameters} */ message) {
    const { time, values } = message;
    const factor = values.gap / this.values.gap;
    // So much changes that the scales of before say nothing.
    const another = Boolean(message.preset) || factor > 2 || factor < 0.5;
    const words = changeInWords(message, this.values, this.hello.parameters, this.units);
    this.takeValues(values);
    this.emit('change', { another, time });
    if (!this.isLive) return;
    this.history.change(time, words, this.drag.name in values ? this.drag.number : 0);
    const preset = this.presetOf(message.preset);
    // Who steers knows which preset the rig started from; who watches, which one it is.
    if ((preset || !this.steers) && preset !== this.address.preset) this.setPreset(preset);
  }

  /** Take in values of the rig that have changed. */
  takeValues(values) {
    Object.assign(this.values, values);
    const rescaled = this.units.take(values, this.values);
    this.checkDesign(values);
    this.emit('values', values);
    if (rescaled) this.emit('units');
  }

  takeFrame(/** @type {Frame} */ frame) {
    this.frames += 1;
    this.history.add(frame);
    this.emit('frame');
    const due = frame.paused ? 'paused' : 'running';
    if (this.isLive && !['lagging', 'doubled', 'other_version', due].includes(this.status)) this.setStatus(due);
  }

  setStatus(status, text = '', time = NaN) {
    this.status = status;
    this.emit('status', { text, time });
  }

  /** Begin with something else: its time is not that of what is shown. */
  join({ rig = '', bag = '' }) {
    // Those of a recording are the values of its what-if.
    if (bag || this.address.bag) Object.assign(this.address, { preset: '', values: {} });
    Object.assign(this.address, { rig, bag });
    this.wanted = null;
    this.history.clear();
    this.keepAddress();
  }

  setPreset(name) {
    Object.assign(this.address, { preset: name, values: {} });
    this.emit('preset');
    this.keepAddress();
  }

  /** Keep the values of a what-if, or none. */
  setWhatIf(values) {
    this.address.values = this.whatIf = values;
    this.keepAddress();
    this.emit('whatIf');
  }

  // The best gap of a structure

  setDesign(gap, values) {
    this.design = { gap, values };
    this.emit('preset');
    Object.assign(this.address, { preset: '', values: this.reproducible(values) });
    this.keepAddress();
  }

  /** Forget the best gap of a structure once the rig is another one. */
  checkDesign(values) {
    const { design } = this;
    const isOf = ([name, value]) => name === 'gap' || !(name in design.values) || same(value, design.values[name]);
    if (!design || Object.entries(values).every(isOf)) return;
    this.design = null;
    this.emit('preset');
  }

  // Drags

  /** Begin to drag a parameter, or end with none. */
  grab(name) {
    this.drag = { name, number: this.drag.number + 1 };
  }

  // The address

  isReproducible(name) {
    const known = this.hello.parameters.find((one) => one.name === name);
    return !known || (!known.read_only && (REPRODUCIBLE.has(known.group) || name.startsWith('initial_')));
  }

  /** Values of which a link consists. */
  reproducible(values) {
    return Object.fromEntries(Object.entries(values).filter(([name]) => this.isReproducible(name)));
  }

  /** Write the address; `time` is that of a recording, which the last frame may not have reached yet. */
  keepAddress(time = this.history.end) {
    const { address } = this;
    writeAddress({ ...address, values: this.reproducible(address.values), time: address.bag ? time : NaN });
  }

  /** Keep a choice of the view in the address, or none. */
  keepView(name, value) {
    const { view } = this.address;
    if ((view[name] ?? '') === value) return;
    if (value) view[name] = value;
    else delete view[name];
    this.keepAddress();
  }

  /** Keep all of the rig in the address, or what differs from the preset that it started from. */
  keepWholeRig() {
    const start = this.hello.presets.find((one) => one.name === this.address.preset)?.values ?? {};
    this.address.values = Object.fromEntries(Object.entries(this.reproducible(this.values)).filter(([name, value]) => !same(value, start[name])));
    this.keepAddress();
  }

  /** Show traces of so many seconds. */
  setWindow(seconds) {
    this.history.window = seconds;
    this.emit('view');
  }
}
