// SPDX-License-Identifier: Apache-2.0
// What the page asks the server for: values, services, presets, another rig or recording.

import { toast } from './dom.js';
import { history, isLive, keepAddress, state } from './state.js';

/** How long after a step to the next impact its absence is reported, ms. */
const LATE = 2000;

export class Requests {
  /** Called with values that the rig has taken, with whether there is a what-if, and for a preset. */
  constructor(connection, { onValues, onWhatIf, onPreset }) {
    this.connection = connection;
    this.onValues = onValues;
    this.onWhatIf = onWhatIf;
    this.onPreset = onPreset;
    this.stepping = false;
  }

  /** Send a request; return whether it was carried out, and show why if not. */
  async ask(message) {
    const { ok, reason } = await this.connection.ask(message);
    if (!ok) toast(reason, 'bad');
    return ok;
  }

  service(name) {
    return this.ask({ type: 'service', name });
  }

  /** Send values to the rig, or to the what-if beside a recording; return the answer. */
  async set(values) {
    const { address } = state;
    const answer = await this.connection.ask(
      isLive() ? { type: 'set', values } : { type: 'what_if', values: { ...state.whatIf, ...values } },
    );
    if (!answer.ok) return answer;
    if (isLive()) Object.assign(address.values, answer.values);
    else {
      address.values = state.whatIf = answer.values;
      this.onWhatIf(true);
    }
    keepAddress();
    return answer;
  }

  /** Set values from elsewhere than a knob; return whether they were taken. */
  async turn(values) {
    const { ok, reason } = await this.set(values);
    if (ok) this.onValues(values);
    else toast(reason, 'bad');
    return ok;
  }

  /** End the what-if. */
  clearWhatIf() {
    state.whatIf = {};
    state.address.values = {};
    keepAddress();
    this.connection.send({ type: 'what_if', values: null });
    this.onWhatIf(false);
  }

  async loadPreset(name) {
    const { values } = state.hello.presets.find((one) => one.name === name) ?? {};
    if (!values) toast(`There is no preset ${name}.`, 'bad');
    if (!values || !await this.ask({ type: 'begin', values })) return;
    Object.assign(state.address, { preset: name, values: {} });
    this.onPreset();
    keepAddress();
  }

  /** Show another rig or a recording. */
  join({ rig = '', bag = '' }) {
    const { address } = state;
    // Those of a recording are the values of its what-if.
    if (bag || address.bag) Object.assign(address, { preset: '', values: {} });
    Object.assign(address, { rig, bag });
    state.wanted = null;
    // Its time is not that of what is joined.
    history.clear();
    this.connection.join({ rig, bag });
    keepAddress();
  }

  /** Let M and m go at places of their own; the next reset is from where it was before. */
  async release({ x, y }, now) {
    const at = { initial_primary_position: x, initial_primary_velocity: 0, initial_damper_offset: y, initial_damper_velocity: 0 };
    const before = Object.fromEntries(Object.keys(at).map((name) => [name, now[name]]));
    if (!await this.ask({ type: 'set', values: at })) return;
    await this.service('reset');
    await this.connection.ask({ type: 'set', values: before });
  }

  /** Move a paused rig on; a key that is held down waits for each step to be done. */
  async step(name) {
    if (state.status !== 'paused' || this.stepping) return;
    this.stepping = true;
    const start = history.end;
    const moves = await this.service(name);
    this.stepping = false;
    if (moves && name === 'step_to_impact') this.reportNoImpact(start);
  }

  /** Report an impact that was asked for at a time of the rig and does not come for a while. */
  async reportNoImpact(start) {
    const standsStill = () => state.status === 'paused' && history.end <= start;
    // What the page shows may be older than the answer of the rig.
    do await new Promise((resolve) => { setTimeout(resolve, LATE); }); while (standsStill());
    const { impacts } = history;
    const hit = impacts.after(start) < impacts.end;
    if (state.status !== 'paused' && !hit) toast('No impact so far: the rig runs on to the next one. Pause holds it here.');
  }
}
