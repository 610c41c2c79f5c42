// SPDX-License-Identifier: Apache-2.0
// What page and server say to each other: the messages as types, and the connection, which comes back by itself.
//
// `requests.py` checks requests by the same fields, and `frames.py` packs the frames.

/**
 * A value of a parameter.
 * @typedef {number | boolean | string | number[]} Value
 * @typedef {Record<string, any>} Values
 */

/**
 * A parameter of the rig, of its control or of the node.
 * @typedef {object} Descriptor
 * @property {string} name
 * @property {string} type
 * @property {string} unit
 * @property {string} description
 * @property {number | null} min
 * @property {number | null} max
 * @property {[number, number] | null} usual
 * @property {string} zero What 0 stands for, if that is no number like others.
 * @property {string[]} units
 * @property {boolean} read_only
 * @property {string[]} choices
 * @property {string} group
 * @property {{ place: number, title: string, term: string, symbol: string } | null} first
 * @property {any} value
 */

/**
 * A recording of the list.
 * @typedef {object} ListedRecording
 * @property {string} name
 * @property {number | null} start
 * @property {number | null} duration
 * @property {number} size
 * @property {number} files
 * @property {boolean} whole
 */

/**
 * @typedef {{ name: string, title: string, description: string, values: Values }} Preset
 * @typedef {{ time: number | null, kind: 'stretch' | 'change' | 'reset', values: Values, preset: string }} Change
 * @typedef {{ text: string, level: string, age: number | null }} ControllerReport
 * @typedef {{ seconds: number, x_rms: number, x_max: number, impacts: number, actuator_energy: number }} Score
 * @typedef {{ kind: number, header: number, counts: number, instants: number, flags: Record<string, number>, tables: Record<string, string[]> }} Layout
 */

/**
 * Messages of the server. A field with `?` is there in some of its modes only.
 * @typedef {{ type: 'hello', version: string, mode: 'live' | 'player' | 'in_page', rig: string, bag: string, parameters: Descriptor[], preset?: string, frame: Layout, rigs: string[], recordings: ListedRecording[], presets: Preset[], ros?: boolean, designs?: boolean, address?: string, steers: boolean, start?: number, duration?: number, changes?: Change[] }} Hello
 * @typedef {{ type: 'status', state: 'running' | 'paused' | 'lagging' | 'doubled' | 'gone' | 'ended' | 'other_version', text: string, time?: number | null }} Status
 * @typedef {{ type: 'parameters', time: number | null, kind: 'stretch' | 'change' | 'reset', values: Values, preset: string }} Parameters
 * @typedef {{ type: 'diagnostics', level: string, kind: string, message: string, verdict: string, agreement: string, controller: ControllerReport | null }} Diagnostics
 * @typedef {{ type: 'numbers', natural_frequency_hz: number, damping_ratio: number, frequency_ratio: number, static_amplitude: number | null, mass_ratio: number, gap: number, impacts_per_cycle?: number | null, energy_per_cycle?: number | null, x_max_ratio?: number | null, score: Score | null }} Numbers
 * @typedef {{ type: 'orbit', found: boolean, text: string, kind: string, complete?: boolean, others?: object[], label?: string, stable?: boolean, viable?: boolean, reason?: string, x_max?: number, x_max_ratio?: number | null, multipliers?: [number, number][], cycles?: number, stops?: number[], period?: number, basis?: string, impacts?: { phase: number, x: number, stop: number, velocity_after: number, damper_velocity_after: number }[], t_zero?: number | null, t?: number[], phase?: number[], x?: number[], z?: number[], y?: number[], relative_velocity?: number[] }} Orbit
 * @typedef {{ label?: string, gap: number[], x_max_ratio: number[], stable: boolean[], viable: boolean[] }} Branch
 * @typedef {{ gap: number, x_max_ratio: number, kind: string, stable: boolean }} Special
 * @typedef {{ type: 'gap_curve', gap?: number, x_max_ratio?: number | null, branches: Branch[], special?: Special[], optimum?: { gap: number, x_max_ratio: number, bound: string } | null, text: string }} Curve
 * @typedef {{ type: 'theory_failed', text: string }} TheoryFailed
 * @typedef {{ type: 'rigs', list: string[] }} Rigs
 * @typedef {{ type: 'recordings', list: ListedRecording[] }} RecordingsList
 * @typedef {{ type: 'what_if', on: boolean, done: boolean, text: string, until?: number | null, values?: Values, totals?: Record<string, Record<string, number>> }} WhatIf
 * @typedef {{ type: 'compare_done', recording: string, ok: boolean, url: string, text: string }} CompareDone
 * @typedef {{ type: 'notice', text: string }} Notice
 * @typedef {{ type: 'seek_done', time: number }} SeekDone
 * @typedef {{ type: 'answer', id: number | string | null, ok: boolean, reason: string, values?: Values, field?: string, design?: Record<string, any> }} AnswerMessage
 * @typedef {Hello | Status | Parameters | Diagnostics | Numbers | Orbit | Curve | TheoryFailed | Rigs | RecordingsList | WhatIf | CompareDone | Notice | SeekDone | AnswerMessage} ServerMessage
 */

/**
 * Requests of the page.
 * @typedef {{ type: 'view', window: number, rate: number }} ViewRequest
 * @typedef {{ type: 'set', values: Values }} SetRequest
 * @typedef {{ type: 'begin', values: Values }} BeginRequest
 * @typedef {{ type: 'service', name: 'pause' | 'reset' | 'step' | 'step_to_impact' }} ServiceRequest
 * @typedef {{ type: 'structure', values: Values }} StructureRequest
 * @typedef {{ type: 'compare', recording: string, on: boolean }} CompareRequest
 * @typedef {{ type: 'play', speed: number }} PlayRequest
 * @typedef {{ type: 'seek', time: number }} SeekRequest
 * @typedef {{ type: 'jump', to: string, direction: number }} JumpRequest
 * @typedef {{ type: 'what_if', values: Values | null }} WhatIfRequest
 * @typedef {ViewRequest | SetRequest | BeginRequest | ServiceRequest | StructureRequest | CompareRequest | PlayRequest | SeekRequest | JumpRequest | WhatIfRequest} Request
 * @typedef {{ ok: boolean, reason: string, values?: Values, field?: string, design?: Record<string, any> }} Answer
 */

/**
 * What is new of the motion: rows of each table one after the other, with times from the end of the frame on.
 * @typedef {{ end: number, epoch: number, paused: boolean, replace: boolean, replace_ghost: boolean } & Record<string, any>} Frame
 */

/** Code of a connection to a rig or recording that is not there. */
const NOT_THERE = 4404;
const FIRST_WAIT = 400;
const LONGEST_WAIT = 5000;
/** Requests that are asked again where the connection is lost before the answer: those that change no rig. */
const REPEATED = new Set(['structure', 'what_if', 'compare']);
const NOT_ASKED = 'The page server does not answer: nothing was changed.';
const LOST = 'The connection was lost before the answer: the change may or may not have been made.';

/** Return what sends messages and frames: the rig that is part of this page, if there is one, or the page server. */
function openSource(query) {
  if (globalThis.rigInPage) return globalThis.rigInPage();
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  return new WebSocket(`${scheme}://${location.host}/ws${query ? `?${query}` : ''}`);
}

/**
 * Read a binary frame, given the layout that the server has described.
 * @param {ArrayBuffer} buffer
 * @param {Layout | null} layout
 * @returns {Frame | null}
 */
export function readFrame(buffer, layout) {
  const view = new DataView(buffer);
  if (!layout || buffer.byteLength < layout.header || view.getUint8(0) !== layout.kind) return null;
  const set = view.getUint8(1);
  const [end, epoch] = [0, 8].map((more) => view.getFloat64(layout.instants + more, true));
  const has = (flag) => (set & layout.flags[flag]) !== 0;
  /** @type {Frame} */
  const frame = { end, epoch, paused: has('paused'), replace: has('replace'), replace_ghost: has('replace_ghost') };
  let place = layout.header;
  Object.entries(layout.tables).forEach(([name, columns], n) => {
    const count = columns.length * view.getUint16(layout.counts + 2 * n, true);
    frame[name] = new Float32Array(buffer, place, count);
    place += 4 * count;
  });
  return frame;
}

/** Events: `message` and `frame` with what has come in, `lost`, `missing` and `again`. */
export class Connection extends EventTarget {
  /** Call a function with the detail of events. */
  on(kind, take) {
    this.addEventListener(kind, (event) => take(/** @type {CustomEvent} */ (event).detail));
  }

  constructor() {
    super();
    this.socket = null;
    /** @type {Layout | null} */
    this.layout = null;
    this.wait = FIRST_WAIT;
    this.timer = 0;
    this.ids = 0;
    this.query = '';
    /**
     * Requests without an answer by their number: the message, and what takes the answer.
     * @type {Map<any, { message: Request, resolve: (answer: Answer) => void }>}
     */
    this.pending = new Map();
    /** Whether the server has begun to show what was joined. */
    this.joined = false;
    /** Whether the connection was lost, and is not there again. */
    this.lost = false;
  }

  /** Join a rig, a recording, or what the server offers first. */
  join({ rig = '', bag = '' }) {
    this.query = new URLSearchParams(bag ? { bag } : rig ? { rig } : {}).toString();
    this.wait = FIRST_WAIT;
    this.forget('Something else is shown now.');
    this.open();
  }

  open() {
    clearTimeout(this.timer);
    if (this.socket) {
      this.socket.onclose = null;
      this.socket.close();
    }
    this.joined = false;
    const socket = openSource(this.query);
    socket.binaryType = 'arraybuffer';
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = ({ code }) => {
      this.joined = false;
      this.forget(LOST, ({ type }) => !REPEATED.has(type));
      if (code === NOT_THERE) {
        this.forget('There is no such rig or recording.');
        this.emit('missing');
        return;
      }
      this.lost = true;
      this.emit('lost');
      this.timer = setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(LONGEST_WAIT, 1.6 * this.wait);
    };
    this.socket = socket;
  }

  /** @param {string} kind */
  emit(kind, detail = null) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }

  receive(data) {
    if (typeof data !== 'string') {
      // A rig of this page hands over its frames as they are.
      const frame = data instanceof ArrayBuffer ? readFrame(data, this.layout) : data;
      if (frame) this.emit('frame', frame);
      return;
    }
    /** @type {ServerMessage} */
    const message = JSON.parse(data);
    if (message.type === 'answer') {
      this.pending.get(message.id)?.resolve(message);
      this.pending.delete(message.id);
      return;
    }
    const anew = message.type === 'hello' && !this.joined;
    const again = anew ? [...this.pending.values()] : [];
    if (message.type === 'hello') {
      this.layout = message.frame;
      this.wait = FIRST_WAIT;
      this.joined = true;
    }
    this.emit('message', message);
    for (const { message: asked } of again) this.send(asked);
    if (anew && this.lost) {
      this.lost = false;
      this.emit('again');
    }
  }

  /** Give up requests, all or some of them. */
  forget(reason, which = /** @param {Request} _ */ (_) => true) {
    for (const [id, { message, resolve }] of this.pending) {
      if (!which(message)) continue;
      this.pending.delete(id);
      resolve({ ok: false, reason });
    }
  }

  /**
   * Send a message; without a connection nothing is kept for later.
   * @param {Request} message
   */
  send(message) {
    if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(message));
  }

  /**
   * Send a message that is answered; see REPEATED.
   * @param {Request} asked
   * @returns {Promise<Answer>}
   */
  ask(asked) {
    if (!this.joined && !REPEATED.has(asked.type)) return Promise.resolve({ ok: false, reason: NOT_ASKED });
    this.ids += 1;
    const message = { ...asked, id: this.ids };
    return new Promise((resolve) => {
      this.pending.set(message.id, { message, resolve });
      if (this.joined) this.send(message);
    });
  }
}
