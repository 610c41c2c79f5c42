// SPDX-License-Identifier: Apache-2.0
// Dialogs that are opened above the page, and closed by their button, a click beside them, or Escape.

import { all, byId } from '../dom.js';
import { startGlossary } from '../glossary.js';

export function mount() {
  startGlossary();
  for (const dialog of all('dialog')) {
    dialog.querySelector('[data-close]').addEventListener('click', () => dialog.close());
    dialog.addEventListener('click', (event) => {
      if (event.target === dialog) dialog.close();
    });
  }
  for (const name of ['recordings', 'glossary']) byId(`${name}-open`).addEventListener('click', () => byId(name).showModal());
  byId('report').addEventListener('close', () => byId('report-frame').removeAttribute('src'));
}
