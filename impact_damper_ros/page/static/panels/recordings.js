// SPDX-License-Identifier: Apache-2.0
// The recordings: play, download, compare with theory.

import { byId, copyOf, mark, toast, write } from '../dom.js';
import { clock, withUnit } from '../format.js';

/** @type {import('../screen.js').Mount} */
export const mount = (root, store, actions) => {
  const { connection } = actions;
  /** Comparisons under way by recording, and when each began, ms. */
  const busy = new Map();

  const made = (name) => {
    const row = copyOf('recording');
    const [play, download, compareButton] = row.querySelectorAll('.buttons > *');
    row.dataset.name = name;
    download.href = `/recordings/${encodeURIComponent(name)}/download`;
    mark(play, 'aria-label', `Play ${name}`);
    mark(download, 'aria-label', `Download ${name}`);
    play.addEventListener('click', () => {
      root.close();
      actions.join({ bag: name });
    });
    compareButton.addEventListener('click', () => compare(name));
    return row;
  };

  /** Return the row of a recording with what is known of it now. */
  const rowOf = (one, row) => {
    write(row.querySelector('strong'), one.name);
    write(row.querySelector('p'), [
      // A simulated run begins at zero and has no day.
      one.start > 1e9 ? new Date(1000 * one.start).toLocaleString('sv-SE', { dateStyle: 'short', timeStyle: 'short' }) : '',
      one.duration === null ? '' : clock(one.duration), withUnit(one.size, 'B', 2),
      one.files > 1 ? `${one.files} files: to copy them, copy the directory` : '', one.whole ? '' : 'not ended',
    ].filter(Boolean).join(' · '));
    row.querySelector('[download]').hidden = one.files !== 1;
    const since = busy.get(one.name);
    const button = row.querySelector('[data-compare]');
    write(button, since === undefined ? 'Compare' : `Cancel (${Math.round((performance.now() - since) / 1000)} s)`);
    mark(button, 'aria-label', since === undefined ? `Compare ${one.name} with theory` : `Cancel the comparison of ${one.name}`);
    return row;
  };

  const show = () => {
    const list = store.recordings;
    byId('recordings-none').hidden = list.length > 0;
    const place = byId('recordings-list');
    // Rows stay where they are, and the same: somebody may be about to press a button.
    const known = Object.fromEntries([...place.children].map((row) => [row.dataset.name, row]));
    const rows = list.map((one) => rowOf(one, known[one.name] ?? made(one.name)));
    for (const row of [...place.children]) if (!rows.includes(row)) row.remove();
    rows.forEach((row, n) => { if (row !== place.children[n]) place.insertBefore(row, place.children.item(n)); });
  };

  /** Compare a recording with theory, or cancel that. */
  const compare = async (name, on = !busy.has(name)) => {
    if (on) busy.set(name, busy.get(name) ?? performance.now());
    show();
    const { ok, reason } = await connection.ask({ type: 'compare', recording: name, on });
    if (ok) return;
    busy.delete(name);
    show();
    toast(`No comparison of ${name}: ${reason}`, 'bad');
  };

  setInterval(() => { if (busy.size) show(); }, 1000);
  store.on('recordings', show);
  // A comparison has ended; its report opens in the page.
  store.on('compare_done', ({ recording, ok, url, text }) => {
    const asked = busy.delete(recording);
    show();
    if (!asked) return;
    if (!ok) {
      toast(text || `No comparison of ${recording}`, 'bad');
      return;
    }
    root.close();
    byId('report-title').textContent = `${recording}: comparison with theory`;
    // Only pages of this server are opened, whatever the message says.
    const place = new URL(url, location.href);
    if (place.origin !== location.origin) return;
    byId('report-alone').href = place.pathname;
    byId('report-frame').src = place.pathname;
    byId('report').showModal();
  });
  // The end of what is under way may have been missed without a connection.
  connection.on('again', () => { for (const name of busy.keys()) compare(name, true); });
  byId('recordings-open').addEventListener('click', () => root.showModal());
  byId('report').addEventListener('close', () => byId('report-frame').removeAttribute('src'));
};
