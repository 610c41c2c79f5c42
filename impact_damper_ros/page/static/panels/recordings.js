// SPDX-License-Identifier: Apache-2.0
// The recordings: play, download, compare with theory.

import { byId, copyOf, mark, toast, write } from '../dom.js';
import { bytes, clock } from '../format.js';

/** Day and time of a recording; a simulated run begins at zero and has none. */
function dated(start) {
  return start > 1e9 ? new Date(1000 * start).toLocaleString('sv-SE', { dateStyle: 'short', timeStyle: 'short' }) : null;
}

class Recordings {
  constructor(connection, play) {
    this.connection = connection;
    this.play = play;
    // Comparisons under way by recording, and when each began, ms.
    this.busy = new Map();
    setInterval(() => { if (this.busy.size) this.show(this.list); }, 1000);
    this.list = [];
  }

  show(list) {
    this.list = list;
    byId('recordings-none').hidden = list.length > 0;
    const place = byId('recordings-list');
    // Rows stay where they are, and the same: somebody may be about to press a button.
    const known = Object.fromEntries([...place.children].map((row) => [row.dataset.name, row]));
    const rows = list.map((one) => this.row(one, known[one.name] ?? this.made(one.name)));
    if (rows.length !== place.children.length || rows.some((row, n) => row !== place.children[n])) place.replaceChildren(...rows);
  }

  /** Return the row of a recording with what is known of it now. */
  row(one, row) {
    const about = [dated(one.start), clock(one.duration ?? NaN), bytes(one.size), one.files > 1 ? `${one.files} files: to copy them, copy the directory` : null, one.whole ? null : 'not ended'];
    write(row.querySelector('strong'), one.name);
    write(row.querySelector('p'), about.filter((text) => text !== null && text !== '–').join(' · '));
    row.querySelector('[download]').hidden = one.files !== 1;
    const compare = row.querySelector('[data-compare]');
    const busy = this.busy.get(one.name);
    write(compare, busy === undefined ? 'Compare' : `Cancel (${Math.round((performance.now() - busy) / 1000)} s)`);
    mark(compare, 'aria-label', busy === undefined ? `Compare ${one.name} with theory` : `Cancel the comparison of ${one.name}`);
    return row;
  }

  made(name) {
    const row = copyOf('recording');
    const [play, download, compare] = row.querySelectorAll('.buttons > *');
    row.dataset.name = name;
    download.href = `/recordings/${encodeURIComponent(name)}/download`;
    mark(play, 'aria-label', `Play ${name}`);
    mark(download, 'aria-label', `Download ${name}`);
    play.addEventListener('click', () => {
      byId('recordings').close();
      this.play(name);
    });
    compare.addEventListener('click', () => this.compare(name));
    return row;
  }

  /** Compare a recording with theory, or cancel that. */
  async compare(name, on = !this.busy.has(name)) {
    if (on) this.busy.set(name, this.busy.get(name) ?? performance.now());
    this.show(this.list);
    const { ok, reason } = await this.connection.ask({ type: 'compare', recording: name, on });
    if (ok) return;
    this.busy.delete(name);
    this.show(this.list);
    toast(`No comparison of ${name}: ${reason}`, 'bad');
  }

  /** Ask again for what is under way, as its end may have been missed without a connection. */
  goOn() {
    for (const name of this.busy.keys()) this.compare(name, true);
  }

  /** A comparison has ended; its report opens in the page. */
  done({ recording, ok, url, text }) {
    const asked = this.busy.delete(recording);
    this.show(this.list);
    if (!asked) return;
    if (!ok) {
      toast(text || `No comparison of ${recording}`, 'bad');
      return;
    }
    byId('recordings').close();
    byId('report-title').textContent = `${recording}: comparison with theory`;
    // Only pages of this server are opened, whatever the message says.
    const place = new URL(url, location.href);
    if (place.origin !== location.origin) return;
    byId('report-alone').href = place.pathname;
    byId('report-frame').src = place.pathname;
    byId('report').showModal();
  }
}

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const panel = new Recordings(actions.connection, (name) => actions.join({ bag: name }));
  store.on('recordings', () => panel.show(store.recordings));
  store.on('compare_done', (message) => panel.done(message));
  actions.connection.on('again', () => panel.goOn());
  byId('recordings-open').addEventListener('click', () => byId('recordings').showModal());
  byId('report').addEventListener('close', () => byId('report-frame').removeAttribute('src'));
};
