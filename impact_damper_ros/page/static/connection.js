// SPDX-License-Identifier: Apache-2.0
// The connection: joins a rig or a recording, reads frames, comes back by itself.

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

/** Read a binary frame, given the layout that the server has described. */
function readFrame(buffer, layout) {
  const view = new DataView(buffer);
  if (!layout || buffer.byteLength < layout.header || view.getUint8(0) !== layout.kind) return null;
  const frame = {};
  const set = view.getUint8(1);
  for (const [name, flag] of Object.entries(layout.flags)) frame[name] = (set & flag) !== 0;
  let place = layout.header;
  Object.entries(layout.tables).forEach(([name, columns], n) => {
    const count = columns.length * view.getUint16(layout.counts + 2 * n, true);
    frame[name] = new Float32Array(buffer, place, count);
    place += 4 * count;
  });
  [frame.end, frame.epoch] = [0, 8].map((more) => view.getFloat64(layout.instants + more, true));
  return frame;
}

export class Connection extends EventTarget {
  constructor() {
    super();
    this.socket = null;
    this.layout = null;
    this.wait = FIRST_WAIT;
    this.timer = 0;
    this.ids = 0;
    /** Requests without an answer by their number: the message, and what takes the answer. */
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
        this.dispatchEvent(new CustomEvent('missing'));
        return;
      }
      this.lost = true;
      this.dispatchEvent(new CustomEvent('lost'));
      this.timer = setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(LONGEST_WAIT, 1.6 * this.wait);
    };
    this.socket = socket;
  }

  receive(data) {
    if (typeof data !== 'string') {
      // A rig of this page hands over its frames as they are.
      const frame = data instanceof ArrayBuffer ? readFrame(data, this.layout) : data;
      if (frame) this.dispatchEvent(new CustomEvent('frame', { detail: frame }));
      return;
    }
    const message = JSON.parse(data);
    let again = [];
    if (message.type === 'hello') {
      this.layout = message.frame;
      this.wait = FIRST_WAIT;
      if (!this.joined) again = [...this.pending.values()];
      this.joined = true;
    }
    if (message.type === 'answer') {
      this.pending.get(message.id)?.resolve(message);
      this.pending.delete(message.id);
    }
    this.dispatchEvent(new CustomEvent(message.type, { detail: message }));
    for (const { message: asked } of again) this.send(asked);
    if (message.type === 'hello' && this.lost) {
      this.lost = false;
      this.dispatchEvent(new CustomEvent('again'));
    }
  }

  /** Give up requests, all or some of them. */
  forget(reason, which = () => true) {
    for (const [id, { message, resolve }] of this.pending) {
      if (!which(message)) continue;
      this.pending.delete(id);
      resolve({ ok: false, reason });
    }
  }

  /** Send a message; without a connection nothing is kept for later. */
  send(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** Send a message that is answered, and return the answer {ok, reason}; see REPEATED. */
  ask(asked) {
    const again = REPEATED.has(asked.type);
    if (!this.joined && !again) return Promise.resolve({ ok: false, reason: NOT_ASKED });
    this.ids += 1;
    const message = { ...asked, id: this.ids };
    return new Promise((resolve) => {
      this.pending.set(message.id, { message, resolve });
      if (this.joined) this.send(message);
    });
  }
}
