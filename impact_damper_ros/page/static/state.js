// SPDX-License-Identifier: Apache-2.0
// What the page knows: what the server has sent of the rig, and what the address holds.

import { isOwnAddress, readAddress, writeAddress } from './address.js';
import { History } from './history.js';
import { Theory } from './theory.js';

/** Parameters that are part of a link: of the rig, of its control and of its start, not of the node. */
const REPRODUCIBLE = new Set(['rig', 'forcing', 'control']);

export const history = new History();
export const theory = new Theory();
/** What the address held when the page was opened. */
export const opened = readAddress();

export const state = {
  /** The first message of the server. */
  hello: { mode: 'live', parameters: [], presets: [], steers: true },
  status: 'connecting',
  /** What the server has added to the last status. */
  statusText: '',
  numbers: {},
  /** Values of the rig itself; beside a recording the knobs hold those of the what-if. */
  values: {},
  whatIf: {},
  /** What of the address still has to be sent to the rig. */
  wanted: isOwnAddress() ? null : opened,
  /** What the address is to hold. */
  address: { rig: opened.rig ?? '', bag: opened.bag ?? '', preset: '', values: opened.bag ? opened.values : {}, view: { ...opened.view } },
};

/** Whether the rig is part of this page: it begins anew with the page, and nothing else can reach it. */
export const isInPage = () => state.hello.mode === 'in_page';
export const isLive = () => state.hello.mode !== 'player';
/** Whether this page may change the rig. */
export const steers = () => isLive() && state.hello.steers;

function isReproducible(name) {
  const known = state.hello.parameters.find((one) => one.name === name);
  return !known || (!known.read_only && (REPRODUCIBLE.has(known.group) || name.startsWith('initial_')));
}

/** Values of which a link consists. */
export const reproducible = (values) => Object.fromEntries(Object.entries(values).filter(([name]) => isReproducible(name)));

/** Write the address; `time` is that of a recording, which the last frame may not have reached yet. */
export function keepAddress(time = history.end) {
  const { address } = state;
  writeAddress({ ...address, values: reproducible(address.values), time: address.bag ? time : NaN });
}

/** Keep a choice of the view in the address, or none. */
export function keepView(name, value) {
  if (value) state.address.view[name] = value;
  else delete state.address.view[name];
  keepAddress();
}

/** What a link to the rig holds: all of it, or what differs from the preset that it started from. */
export function keepWholeRig(values) {
  const start = state.hello.presets.find((one) => one.name === state.address.preset)?.values ?? {};
  state.address.values = Object.fromEntries(Object.entries(reproducible(values)).filter(
    ([name, value]) => JSON.stringify(value) !== JSON.stringify(start[name]),
  ));
  keepAddress();
}
