// SPDX-License-Identifier: Apache-2.0
// The connection to the page server, which comes back by itself. `messages.d.ts` has the messages, `frames.py` packs frames.

/** @import { Answer, Frame, Layout, Request, ServerMessage } from './messages.js' */

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

/** Read a binary frame, given the layout that the server has described; null if it is none. */
export function readFrame(/** @type {ArrayBuffer} */ buffer, /** @type {Layout | null} */ layout) {
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

/** What reports events by name. */
export class Reporter extends EventTarget {
  /** Call a function with the detail of events. */
  on(kinds, take) {
    for (const kind of kinds.split(' ')) this.addEventListener(kind, (event) => take(/** @type {CustomEvent} */ (event).detail));
  }

  emit(/** @type {string} */ kind, detail = null) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }
}

/** Events: `message` and `frame` with what has come in, `lost`, `missing`, and `again` once a server is there, again or at last. */
export class Connection extends Reporter {
  constructor() {
    super();
    this.socket = null;
    /** @type {Layout | null} */
    this.layout = null;
    this.wait = FIRST_WAIT;
    this.timer = 0;
    this.ids = 0;
    this.query = '';
    /** Requests without an answer by their number: the message, and what takes the answer. */
    this.pending = /** @type {Map<any, { message: Request, resolve: (answer: Answer) => void }>} */ (new Map());
    /** Whether the server has begun to show what was joined. */
    this.joined = false;
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
      // What is still on its way from there is of something else.
      this.socket.onclose = this.socket.onmessage = null;
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
      this.emit('lost');
      this.timer = setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(LONGEST_WAIT, 1.6 * this.wait);
    };
    this.socket = socket;
  }

  receive(data) {
    if (typeof data !== 'string') {
      // A rig of this page hands over its frames as they are.
      const frame = data instanceof ArrayBuffer ? readFrame(data, this.layout) : data;
      if (frame) this.emit('frame', frame);
      return;
    }
    const message = /** @type {ServerMessage} */ (JSON.parse(data));
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
    if (anew) this.emit('again');
  }

  /** Give up requests, all or some of them. */
  forget(reason, which = /** @param {Request} _ */ (_) => true) {
    for (const [id, { message, resolve }] of this.pending) {
      if (!which(message)) continue;
      this.pending.delete(id);
      resolve({ ok: false, reason });
    }
  }

  /** Send a message; without a connection nothing is kept for later. */
  send(/** @type {Request} */ message) {
    if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(message));
  }

  /** Send a message, and return the answer; see REPEATED. */
  async ask(/** @type {Request} */ asked) {
    if (!this.joined && !REPEATED.has(asked.type)) return /** @type {Answer} */ ({ ok: false, reason: NOT_ASKED });
    this.ids += 1;
    const message = { ...asked, id: this.ids };
    return new Promise((/** @type {(answer: Answer) => void} */ resolve) => {
      this.pending.set(message.id, { message, resolve });
      if (this.joined) this.send(message);
    });
  }
}
