// SPDX-License-Identifier: Apache-2.0
// What the page asks the server for: values, services, presets, a place in a recording, another rig.

import { toast } from './dom.js';
import { lengthHint } from './words.js';

/** @import { Request, ServiceRequest } from './messages.js' */

/** How long after a step to the next impact its absence is reported, ms. */
const LATE = 2000;

export class Actions {
  constructor(/** @type {import('./store.js').Store} */ store, /** @type {import('./protocol.js').Connection} */ connection) {
    this.store = store;
    this.connection = connection;
    this.stepping = false;
  }

  /** Send a request; return whether it was carried out, and show why if not. */
  async ask(/** @type {Request} */ message) {
    const { ok, reason } = await this.connection.ask(message);
    if (!ok) toast(reason, 'bad');
    return ok;
  }

  service(/** @type {ServiceRequest['name']} */ name) {
    return this.ask({ type: 'service', name });
  }

  /** Send values to the rig, or to the what-if beside a recording; return the answer. */
  async set(values) {
    const { store } = this;
    const live = store.isLive;
    const answer = await this.connection.ask(live ? { type: 'set', values } : { type: 'what_if', values: { ...store.whatIf, ...values } });
    if (!answer.ok) return answer;
    if (live) {
      Object.assign(store.address.values, answer.values);
      store.keepAddress();
    } else store.setWhatIf(answer.values);
    return answer;
  }

  /** Set values from elsewhere than a knob; return whether they were taken. */
  async turn(values) {
    const { ok, reason, values: taken } = await this.set(values);
    if (ok) this.store.emit('turned', taken);
    else toast(reason, 'bad');
    return ok;
  }

  clearWhatIf() {
    this.store.setWhatIf({});
    this.connection.send({ type: 'what_if', values: null });
  }

  async loadPreset(name) {
    const { values } = this.store.hello.presets.find((one) => one.name === name) ?? {};
    if (!values) toast(`There is no preset ${name}.`, 'bad');
    else if (await this.ask({ type: 'begin', values })) this.store.setPreset(name);
  }

  /** Set the rig to a structure with its best gap; return the answer. */
  async beginDesign(design, values) {
    const answer = await this.connection.ask({ type: 'begin', values });
    if (answer.ok) this.store.setDesign(design.gap, values);
    return answer;
  }

  /** Show another rig or a recording. */
  join({ rig = '', bag = '' }) {
    this.store.join({ rig, bag });
    this.connection.join({ rig, bag });
  }

  /** Say what of the motion is in view. */
  view() {
    this.connection.send({ type: 'view', window: this.store.history.window, rate: document.hidden ? 1 : 60 });
  }

  /** Let M and m go at places of their own; the next reset is from where it was before. */
  async release({ x, y }) {
    const at = { initial_primary_position: x, initial_primary_velocity: 0, initial_damper_offset: y, initial_damper_velocity: 0 };
    const before = Object.fromEntries(Object.keys(at).map((name) => [name, this.store.values[name]]));
    if (!await this.ask({ type: 'set', values: at })) return;
    await this.service('reset');
    await this.connection.ask({ type: 'set', values: before });
  }

  /** Move a paused rig on; a key that is held down waits for each step to be done. */
  async step(/** @type {'step' | 'step_to_impact'} */ name) {
    if (this.store.status !== 'paused' || this.stepping) return;
    this.stepping = true;
    const start = this.store.history.end;
    const moves = await this.service(name);
    this.stepping = false;
    if (moves && name === 'step_to_impact') this.reportNoImpact(start);
  }

  /** Report an impact that was asked for at a time of the rig and does not come for a while. */
  async reportNoImpact(start) {
    const { store } = this;
    // What the page shows may be older than the answer of the rig.
    do await new Promise((resolve) => { setTimeout(resolve, LATE); }); while (store.status === 'paused' && store.history.end <= start);
    const { impacts } = store.history;
    const hit = impacts.after(start) < impacts.end;
    if (store.status !== 'paused' && !hit) toast('No impact so far: the rig runs on to the next one. Pause holds it here.');
  }

  /** Bring the rig to what the address asks for, once. */
  async applyAddress() {
    const { store } = this;
    const { address, opened } = store;
    const wanted = store.isInPage ? opened : store.wanted;
    store.wanted = null;
    if (!wanted) {
      // Loaded anew: what this tab has set before still stands in the address.
      if (!opened.bag) Object.assign(address, { preset: address.preset || (opened.preset ?? ''), values: { ...opened.values, ...address.values } });
      store.emit('preset');
      return;
    }
    if (wanted.preset) await this.loadPreset(wanted.preset);
    // Where the node records, and whether, is not for a link to say.
    const values = store.reproducible(wanted.values);
    const { hello: { parameters }, units } = store;
    const hint = lengthHint(values, parameters, units);
    for (const { name, type, unit } of parameters) {
      // A number with its unit is read as one that is typed.
      if (typeof values[name] === 'string' && type !== 'string') values[name] = { text: values[name], unit };
    }
    if (Object.keys(values).length && await this.turn(values) && hint) toast(hint);
  }
}
