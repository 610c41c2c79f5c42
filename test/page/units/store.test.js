// SPDX-License-Identifier: Apache-2.0
// What the page knows after messages of the server, what it asks for, and what its address holds.

import assert from 'node:assert/strict';
import { test } from 'node:test';

Object.assign(globalThis, {
  location: { hash: '', protocol: 'http:', host: 'rig:8088' },
  history: { state: null, replaceState(state, _title, hash) { [this.state, globalThis.location.hash] = [state, hash]; } },
});
const { isOwnAddress, readAddress } = await import('../../../impact_damper_ros/page/static/address.js');
const { Actions } = await import('../../../impact_damper_ros/page/static/actions.js');
const { Store } = await import('../../../impact_damper_ros/page/static/store.js');
const { Connection, readFrame } = await import('../../../impact_damper_ros/page/static/protocol.js');

const FRAME = { kind: 3, header: 32, counts: 2, instants: 16, flags: { paused: 1, replace: 2, replace_ghost: 4 }, tables: { samples: ['time', 'x'], impacts: ['time'], ghost_samples: ['time'], ghost_impacts: [] } };
const GAP = { name: 'gap', type: 'double', unit: 'm', group: 'rig', read_only: false, choices: [], first: { symbol: 'd' }, value: 0.024 };
const FOLDER = { ...GAP, name: 'bag_directory', type: 'string', group: 'run', first: null, value: '/tmp' };
const PRESETS = [{ name: 'bench', title: 'Bench rig', description: '', values: { gap: 0.024 } }];
const HELLO = { type: 'hello', mode: 'live', rig: '/sim_node', bag: '', parameters: [GAP, FOLDER], rigs: ['/sim_node'], recordings: [], presets: PRESETS, preset: 'Bench rig', steers: true, frame: FRAME };

/** Return a store that a server has greeted, and the events that it sends. */
function greeted(hash = '', hello = {}) {
  globalThis.location.hash = hash;
  const store = new Store(readAddress(), false);
  const events = [];
  for (const kind of ['status', 'values', 'change', 'preset', 'theory', 'rescale', 'units']) store.on(kind, () => events.push(kind));
  store.receive({ ...HELLO, ...hello });
  return { store, events };
}

const written = () => new Promise((resolve) => { setTimeout(() => resolve(globalThis.location.hash), 170); });

test('an address is read and written again', async () => {
  const { store } = greeted('#bag=run_1&time=4.5&gap=0.02&force_amplitudes=[1,2]&window=3&relative=1&gap_control=timed&bad%20name=1', { mode: 'player', bag: 'run_1', start: 0, duration: 9 });
  assert.ok(!isOwnAddress());
  assert.deepEqual(store.opened.values, { gap: 0.02, force_amplitudes: [1, 2], gap_control: 'timed' });
  assert.deepEqual([store.opened.time, store.history.window, store.isLive, store.steers], [4.5, 3, false, false]);
  store.receive({ type: 'seek_done', time: 6.25 });
  assert.equal(await written(), '#bag=run_1&time=6.25&gap=0.02&force_amplitudes=[1,2]&gap_control=timed&window=3&relative=1');
  assert.ok(isOwnAddress());
});

test('a change is a line in the traces, and another preset the end of the one before', async () => {
  const { store, events } = greeted('#preset=bench');
  assert.equal(store.address.preset, 'bench');
  events.length = 0;
  store.receive({ type: 'parameters', time: 3, kind: 'change', values: { gap: 0.03 }, preset: '' });
  assert.deepEqual(events, ['values', 'change']);
  assert.deepEqual([store.values.gap, store.history.changes.at(-1).text, store.address.preset], [0.03, 'd = 30 mm', 'bench']);
  // A link holds what differs from the preset, and nothing of the node.
  store.takeValues({ bag_directory: '/secret' });
  store.keepWholeRig();
  assert.equal(await written(), '#preset=bench&gap=0.03');
});

test('who watches asks for nothing, and sees which preset the rig is', () => {
  const { store } = greeted('#preset=chaos&gap=0.1', { steers: false });
  assert.deepEqual([store.wanted, store.address.preset, store.steers], [null, 'bench', false]);
  store.receive({ type: 'parameters', time: 1, kind: 'change', values: { gap: 0.02 }, preset: '' });
  assert.equal(store.address.preset, '');
});

test('a design is forgotten once another parameter than the gap changes', () => {
  const { store } = greeted();
  store.setDesign(0.02, { gap: 0.02, damper_mass: 0.1 });
  store.receive({ type: 'parameters', time: 1, kind: 'change', values: { gap: 0.025 }, preset: '' });
  assert.equal(store.design.gap, 0.02);
  store.receive({ type: 'parameters', time: 2, kind: 'change', values: { damper_mass: 0.2 }, preset: '' });
  assert.equal(store.design, null);
});

test('the best gap is that of the curve, or beyond its end', () => {
  const { store } = greeted();
  const curve = { type: 'gap_curve', branches: [], text: '', optimum: { gap: 0.03, x_max_ratio: 0.1, bound: '' } };
  store.receive(curve);
  assert.deepEqual(store.theory.best, curve.optimum);
  store.receive({ ...curve, optimum: { ...curve.optimum, bound: 'at least' } });
  assert.equal(store.theory.best.bound, 'at least');
  store.receive({ type: 'orbit', found: false, text: 'why not', kind: 'chaotic' });
  assert.deepEqual([store.theory.failed, store.theory.title], ['why not', 'chaotic']);
});

test('frames of a running rig end a state that has passed, and no other one', () => {
  const { store } = greeted();
  const frame = { end: 1, epoch: 0, paused: false, replace: false, replace_ghost: false, samples: [], impacts: [], measured: [], acts: [], ghost_samples: [], ghost_impacts: [] };
  for (const [state, after] of [['gone', 'running'], ['lagging', 'lagging'], ['other_version', 'other_version'], ['doubled', 'doubled']]) {
    store.receive({ type: 'status', state, text: '', time: null });
    store.takeFrame(frame);
    assert.equal(store.status, after);
  }
});

test('a step to an impact that has come is not called in vain once the rig runs on', async (t) => {
  t.mock.timers.enable({ apis: ['setTimeout'] });
  const place = { dataset: {}, textContent: '', hidePopover() {}, showPopover() {} };
  globalThis.document = { getElementById: () => place };
  const { store } = greeted();
  const actions = new Actions(store, null);
  const frame = { end: 2, paused: false, samples: [0, 0], impacts: [-0.5], measured: [], acts: [], ghost_samples: [], ghost_impacts: [] };
  store.takeFrame(frame);
  for (const [start, said] of [[1, /^$/], [1.5, /^No impact so far/]]) {
    const reported = actions.reportNoImpact(start);
    t.mock.timers.tick(2000);
    await reported;
    assert.match(place.textContent, said);
  }
});

test('a binary frame is taken apart', () => {
  const view = new DataView(new ArrayBuffer(32 + 4 * 5));
  view.setUint8(0, 3);
  view.setUint8(1, 3);
  [2, 1].forEach((count, n) => view.setUint16(2 + 2 * n, count, true));
  view.setFloat64(16, 12.5, true);
  view.setFloat64(24, 1e9, true);
  [-1, 2, 0, 4, -0.5].forEach((value, n) => view.setFloat32(32 + 4 * n, value, true));
  const frame = readFrame(view.buffer, FRAME);
  assert.deepEqual({ ...frame, samples: [...frame.samples], impacts: [...frame.impacts] }, {
    end: 12.5, epoch: 1e9, paused: true, replace: true, replace_ghost: false, samples: [-1, 2, 0, 4], impacts: [-0.5], ghost_samples: new Float32Array(0), ghost_impacts: new Float32Array(0),
  });
  assert.equal(readFrame(view.buffer, { ...FRAME, kind: 4 }), null);
});

/** A socket that a test opens, answers and closes. */
class Socket {
  static made = [];

  readyState = 1;

  sent = [];

  constructor(url) {
    this.url = url;
    Socket.made.push(this);
  }

  send(text) { this.sent.push(JSON.parse(text)); }

  close() { this.readyState = 3; }

  say(message) { this.onmessage({ data: JSON.stringify(message) }); }
}

test('what only computes is asked again after the connection was lost, and a change is not', async (t) => {
  t.mock.timers.enable({ apis: ['setTimeout'] });
  globalThis.WebSocket = Socket;
  const connection = new Connection();
  const seen = [];
  for (const kind of ['lost', 'again', 'missing']) connection.on(kind, () => seen.push(kind));
  connection.join({ rig: '/a b' });
  const first = Socket.made.at(-1);
  assert.equal(first.url, 'ws://rig:8088/ws?rig=%2Fa+b');
  assert.match((await connection.ask({ type: 'set', values: {} })).reason, /nothing was changed/);
  first.say(HELLO);
  const [change, design] = [connection.ask({ type: 'set', values: { gap: 1 } }), connection.ask({ type: 'structure', values: {} })];
  assert.deepEqual(first.sent.map(({ type }) => type), ['set', 'structure']);
  first.onclose({ code: 1006 });
  assert.match((await change).reason, /may or may not/);
  t.mock.timers.tick(400);
  const second = Socket.made.at(-1);
  assert.notEqual(second, first);
  second.say(HELLO);
  assert.deepEqual(second.sent, [{ type: 'structure', values: {}, id: first.sent[1].id }]);
  second.say({ type: 'answer', id: first.sent[1].id, ok: true, reason: '' });
  assert.deepEqual(await design, { type: 'answer', id: first.sent[1].id, ok: true, reason: '' });
  // What was on its way from a rig that is left is not taken for the other one.
  connection.join({ bag: 'run' });
  assert.equal(second.onmessage, null);
  Socket.made.at(-1).onclose({ code: 4404 });
  assert.deepEqual(seen, ['again', 'lost', 'again', 'missing']);
});
