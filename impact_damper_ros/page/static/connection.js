// The WebSocket: joins a rig or a recording, reads frames, comes back by itself.

const HEADER = 36;
/** Code of a connection to a rig or recording that is not there. */
const NOT_THERE = 4404;
const FIRST_WAIT = 400;
const LONGEST_WAIT = 5000;

/** Read a binary frame; see the protocol in docs/page.md. */
export function readFrame(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEADER || view.getUint8(0) !== 1) return null;
  const flags = view.getUint8(1);
  const columns = view.getUint16(2, true);
  const impacts = view.getUint16(4, true);
  const samples = view.getUint16(6, true);
  const ghostColumns = view.getUint16(8, true);
  const ghostSamples = view.getUint16(10, true);
  let place = HEADER;
  const next = (count) => {
    const values = new Float32Array(buffer, place, count);
    place += 4 * count;
    return values;
  };
  return {
    paused: (flags & 1) !== 0,
    replace: (flags & 4) !== 0,
    replaceGhost: (flags & 8) !== 0,
    end: view.getFloat64(12, true),
    epoch: view.getFloat64(28, true),
    state: next(10),
    ghost: (flags & 2) !== 0 ? next(10) : null,
    columns: next(8 * columns),
    impacts: next(8 * impacts),
    samples: next(6 * samples),
    ghostColumns: next(8 * ghostColumns),
    ghostSamples: next(6 * ghostSamples),
    bytes: buffer.byteLength,
  };
}

export class Connection extends EventTarget {
  constructor() {
    super();
    this.socket = null;
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
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = new WebSocket(`${scheme}://${location.host}/ws${this.query ? `?${this.query}` : ''}`);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.wait = FIRST_WAIT;
      this.dispatchEvent(new CustomEvent('open'));
    };
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = ({ code, reason }) => {
      this.forget('The page server does not answer.');
      if (code === NOT_THERE) {
        this.dispatchEvent(new CustomEvent('missing', { detail: { reason } }));
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
      const frame = readFrame(data);
      if (frame) this.dispatchEvent(new CustomEvent('frame', { detail: frame }));
      return;
    }
    const message = JSON.parse(data);
    if ((message.type === 'set_result' || message.type === 'service_result') && this.pending.has(message.id)) {
      this.pending.get(message.id)(message);
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
