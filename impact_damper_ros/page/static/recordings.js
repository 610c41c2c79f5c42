// The recordings: play, download, compare with theory.

import { byId, element, toast } from './dom.js';
import { bytes, clock } from './format.js';

/** Day and time of a recording, from seconds or as it is. */
function dated(start) {
  if (typeof start !== 'number') return start;
  const date = new Date(1000 * start);
  const two = (value) => String(value).padStart(2, '0');
  const day = [date.getFullYear(), two(date.getMonth() + 1), two(date.getDate())].join('-');
  return `${day} ${two(date.getHours())}:${two(date.getMinutes())}`;
}

export class Recordings {
  constructor(play) {
    this.play = play;
    this.busy = new Set();
    this.list = [];
    byId('recordings-open').addEventListener('click', () => {
      this.refresh();
      byId('recordings').showModal();
    });
  }

  async refresh() {
    try {
      const answer = await fetch('/recordings');
      if (answer.ok) this.show(await answer.json());
    } catch {
      // The list that came with the connection stays.
    }
  }

  show(list) {
    this.list = Array.isArray(list) ? list : list.list ?? [];
    // What has not changed stays as it is: somebody may be about to press it.
    const shown = JSON.stringify([this.list, [...this.busy]]);
    if (shown === this.shown) return;
    this.shown = shown;
    byId('recordings-none').hidden = this.list.length > 0;
    byId('recordings-list').replaceChildren(...this.list.map((one) => this.row(one)));
  }

  row(one) {
    const about = [dated(one.start), clock(one.duration), bytes(one.size), one.whole ? null : 'cut short'];
    const path = encodeURIComponent(one.name);
    const compare = element('button', {
      type: 'button', text: this.busy.has(one.name) ? 'Comparing…' : 'Compare', disabled: this.busy.has(one.name),
      'aria-label': `Compare ${one.name} with theory`, onclick: () => this.compare(one.name),
    });
    return element(
      'div',
      { class: 'recording', 'data-name': one.name },
      element('div', {}, element('strong', { text: one.title ?? one.name }), element('p', { class: 'quiet', text: about.filter((text) => text !== null && text !== undefined && text !== '–').join(' · ') })),
      element('div', { class: 'buttons' },
        element('button', { type: 'button', class: 'primary', text: 'Play', 'aria-label': `Play ${one.name}`, onclick: () => {
          byId('recordings').close();
          this.play(one.name);
        } }),
        element('a', { class: 'button', href: `/recordings/${path}/download`, download: '', text: 'Download', 'aria-label': `Download ${one.name}` }),
        compare),
    );
  }

  async compare(name) {
    this.busy.add(name);
    this.show(this.list);
    try {
      const answer = await fetch(`/recordings/${encodeURIComponent(name)}/compare`, { method: 'POST' });
      if (!answer.ok) throw new Error((await answer.text()) || answer.statusText);
    } catch (error) {
      this.busy.delete(name);
      this.show(this.list);
      toast(`No comparison of ${name}: ${error.message}`, 'bad');
    }
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
