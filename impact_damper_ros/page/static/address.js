// SPDX-License-Identifier: Apache-2.0
// The whole state in the address: a link reproduces rig, settings and view.

const VIEW = ['window', 'theory', 'slow', 'relative', 'large'];

/** Read the state that an address holds. */
export function readAddress() {
  const given = new URLSearchParams(location.hash.slice(1));
  const state = { values: {}, view: {} };
  for (const [name, text] of given) {
    if (name === 'rig' || name === 'bag' || name === 'preset') state[name] = text;
    else if (name === 'time') state.time = Number(text);
    else if (VIEW.includes(name)) state.view[name] = text;
    else if (/^[a-z][a-z0-9_]{0,60}$/.test(name)) {
      try {
        state.values[name] = JSON.parse(text);
      } catch {
        state.values[name] = text;
      }
    }
  }
  return state;
}

/** Whether the page itself wrote this address in this tab: then there is nothing to reproduce. */
export const isOwnAddress = () => Boolean(history.state?.own);

let due = 0;

/** Write the state into the address, a little later, once. */
export function writeAddress(state) {
  clearTimeout(due);
  due = setTimeout(() => {
    const kept = new URLSearchParams();
    for (const name of ['rig', 'bag', 'preset']) if (state[name]) kept.set(name, state[name]);
    if (Number.isFinite(state.time)) kept.set('time', state.time.toFixed(2));
    for (const [name, value] of Object.entries(state.values)) {
      kept.set(name, typeof value === 'string' ? value : JSON.stringify(value));
    }
    for (const [name, value] of Object.entries(state.view)) kept.set(name, value);
    // Slashes and brackets are legal in a fragment, and easier to read.
    const hash = `#${kept.toString().replace(/%2F/g, '/').replace(/%5B/g, '[').replace(/%5D/g, ']').replace(/%2C/g, ',')}`;
    history.replaceState({ own: true }, '', hash);
  }, 150);
}
