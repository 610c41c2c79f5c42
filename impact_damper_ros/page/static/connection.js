// SPDX-License-Identifier: Apache-2.0
// The connection: joins a rig or a recording, reads frames, comes back by itself.

/** Code of a connection to a rig or recording that is not there. */
const NOT_THERE = 4404;
const FIRST_WAIT = 400;
const LONGEST_WAIT = 5000;

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
  const frame = { bytes: buffer.byteLength };
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
    this.pending = new Map();
  }

  /** Join a rig, a recording, or what the server offers first. */
  join({ rig = '', bag = '' }) {
    this.query = new URLSearchParams(bag ? { bag } : rig ? { rig } : {}).toString();
    this.wait = FIRST_WAIT;
    this.open();
  }

  open() {
    clearTimeout(this.timer);
    if (this.socket) {
      this.socket.onclose = null;
      this.socket.close();
    }
    this.forget('The connection was closed.');
    const socket = openSource(this.query);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.wait = FIRST_WAIT;
      this.dispatchEvent(new CustomEvent('open'));
    };
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = ({ code }) => {
      this.forget('The page server does not answer.');
      if (code === NOT_THERE) {
        this.dispatchEvent(new CustomEvent('missing'));
        return;
      }
      this.dispatchEvent(new CustomEvent('lost', { detail: { wait: this.wait } }));
      this.timer = setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(LONGEST_WAIT, 1.6 * this.wait);
    };
    this.socket = socket;
  }

  receive(data) {
    if (typeof data !== 'string') {
      const frame = readFrame(data, this.layout);
      if (frame) this.dispatchEvent(new CustomEvent('frame', { detail: frame }));
      return;
    }
    const message = JSON.parse(data);
    if (message.type === 'hello') this.layout = message.frame;
    if (message.type === 'answer') {
      this.pending.get(message.id)?.(message);
      this.pending.delete(message.id);
    }
    this.dispatchEvent(new CustomEvent(message.type, { detail: message }));
  }

  forget(reason) {
    for (const answer of this.pending.values()) answer({ ok: false, reason });
    this.pending.clear();
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Send a message; without a connection nothing is kept for later. */
  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }

  /** Send a message that is answered, and return the answer {ok, reason}. */
  ask(message) {
    if (!this.isOpen) return Promise.resolve({ ok: false, reason: 'The page server does not answer.' });
    this.ids += 1;
    const id = this.ids;
    return new Promise((resolve) => {
      this.pending.set(id, resolve);
      this.send({ ...message, id });
    });
  }
}
