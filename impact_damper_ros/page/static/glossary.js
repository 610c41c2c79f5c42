// SPDX-License-Identifier: Apache-2.0
// A sentence behind every technical word: they stand in the dialog of the page, from which the documentation has its glossary.

import { all, byId, element } from './dom.js';

/** The word of a key, and its sentence. */
export function entry(key) {
  const word = byId(`term-${key}`);
  return [word.textContent, word.nextElementSibling.textContent];
}

/** Return a word that shows its meaning when pressed. */
export function term(key, text) {
  return element('button', { class: 'term', type: 'button', 'data-term': key, 'aria-description': entry(key)[1], text });
}

export function startGlossary() {
  for (const word of all('button.term')) word.setAttribute('aria-description', entry(word.dataset.term)[1]);
  byId('glossary-open').addEventListener('click', () => byId('glossary').showModal());
  const card = byId('term');
  const [title, sentence] = card.children;
  document.addEventListener('click', (event) => {
    const pressed = /** @type {any} */ (event.target).closest?.('button.term');
    if (!pressed) return;
    [title.textContent, sentence.textContent] = entry(pressed.dataset.term);
    card.showPopover({ source: pressed });
    const place = pressed.getBoundingClientRect();
    const { offsetWidth: width, offsetHeight: height } = card;
    const below = place.bottom + 6 + height < innerHeight;
    card.style.left = `${Math.max(8, Math.min(place.left, innerWidth - width - 8))}px`;
    card.style.top = `${below ? place.bottom + 6 : Math.max(8, place.top - height - 6)}px`;
  });
}
