// SPDX-License-Identifier: Apache-2.0
// The page: a store, a connection that fills it, and panels that show it.

import { Actions } from './actions.js';
import { isOwnAddress, readAddress } from './address.js';
import { readColours } from './chart.js';
import { byId, toast } from './dom.js';
import { startGlossary } from './glossary.js';
import * as bar from './panels/bar.js';
import * as controller from './panels/controller.js';
import * as gapCurve from './panels/gap_curve.js';
import * as impactMap from './panels/impact_map.js';
import * as knobPanel from './panels/knobs.js';
import * as multipliers from './panels/multipliers.js';
import * as pictures from './panels/pictures.js';
import * as playerPanel from './panels/player.js';
import * as portraitPanel from './panels/portrait.js';
import * as presets from './panels/presets.js';
import * as recordings from './panels/recordings.js';
import * as rigPanel from './panels/rig.js';
import * as structure from './panels/structure.js';
import * as tour from './panels/tour.js';
import * as tracePanel from './panels/traces.js';
import * as verdict from './panels/verdict.js';
import { Connection } from './protocol.js';
import { Screen } from './screen.js';
import { Store } from './store.js';

const connection = new Connection();
const store = new Store(readAddress(), isOwnAddress());
const actions = new Actions(store, connection);
readColours();

const knobs = knobPanel.mount(byId('knobs'), store, actions);
const player = playerPanel.mount(byId('player'), store, actions);
const rig = rigPanel.mount(byId('rig'), store, actions, { knobs });
const traces = tracePanel.mount(byId('traces'), store, actions);
const plots = byId('plots');
const portrait = portraitPanel.mount(plots, store);
const map = impactMap.mount(plots, store);
const curve = gapCurve.mount(plots, store, actions);
const circle = multipliers.mount(byId('verdict'), store);
verdict.mount(byId('verdict'), store);
controller.mount(byId('controller'), store, actions);
presets.mount(byId('presets'), store, actions);
structure.mount(byId('structure'), store, actions);
recordings.mount(byId('recordings'), store, actions);
bar.mount(byId('bar'), store, actions, { player });
tour.mount(byId('tour'), store, actions);
startGlossary();
pictures.mount(byId('pictures'), store, actions, {
  rig: ['Rig', rig.rig, rig],
  motion: ['Motion', traces],
  phase_portrait: ['Phase portrait', portrait],
  impact_map: ['Impact map', map],
  gap_curve: ['Gap curve', curve],
  multipliers: ['Multipliers', circle],
});

const screen = new Screen(store, [rig, traces, portrait, map, curve, circle]);

connection.on('message', (detail) => {
  store.receive(detail);
  if (detail.type !== 'hello') return;
  store.emit('joined');
  if (store.steers && detail.rig && detail.parameters.length) actions.applyAddress();
});
connection.on('frame', (frame) => store.takeFrame(frame));
connection.on('lost', () => store.setStatus('offline'));
connection.on('missing', () => {
  toast(store.statusText || 'There is no such rig or recording.', 'bad');
  store.setStatus('gone');
  // What the server offers instead.
  if (store.address.rig || store.address.bag) actions.join({});
});
store.on('notice', ({ text }) => toast(text, 'bad'));
addEventListener('hashchange', () => {
  // Whoever wrote it, it is a link.
  history.replaceState(null, '');
  location.reload();
});
if (location.search === '?wrong_token') {
  history.replaceState(null, '', location.pathname + location.hash);
  toast('The token of this address is not that of this server, which makes a new one at each start: this page only watches.', 'bad');
}
// For tests and the console
Object.assign(globalThis, { impactDamper: { store, history: store.history, theory: store.theory, actions, screen, rig: rig.rig, traces, portrait, map, curve } });

connection.join(store.address);
screen.begin();
