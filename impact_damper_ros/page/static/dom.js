// SPDX-License-Identifier: Apache-2.0
// Elements built by hand: text is set as text, so that nothing received becomes markup.

import { digits, withUnit } from './format.js';

/** The element of an id, of whatever kind. */
export const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));

/** All elements of a selector. */
export const all = (/** @type {string} */ selector, root = document) => /** @type {any[]} */ ([...root.querySelectorAll(selector)]);

/** Return an element with attributes and children; strings become text nodes. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === 'text') made.textContent = value;
    else if (name.startsWith('on')) made.addEventListener(name.slice(2), value);
    else if (name === 'value' || name === 'checked' || name === 'disabled') made[name] = value;
    else made.setAttribute(name, value === true ? '' : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/** Return a copy of what a template holds. */
export const copyOf = (id) => byId(id).content.firstElementChild.cloneNode(true);

/** Set the text of an element if it is another one, so that nothing is laid out in vain. */
export function write(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** Set an attribute if it is another one. */
export function mark(target, name, value) {
  if (target.getAttribute(name) !== value) target.setAttribute(name, value);
}

/** Write a text, which is whole in its tooltip where there is no room for it. */
export function writeLine(target, text) {
  write(target, text);
  mark(target, 'title', text);
}

/** Write numbers into the elements that are for them, each with the unit and the digits that it has there. */
export function writeNumbers(selector, numbers) {
  for (const place of all(selector)) {
    const { number, unit, digits: count = '3' } = place.dataset;
    write(place, unit ? withUnit(numbers?.[number], unit, Number(count)) : digits(numbers?.[number], Number(count)));
  }
}

/** Show a share of 1 as a bar, with a text beside it. */
export function showShare(row, share, text) {
  row.querySelector('.fill').style.transform = `scaleX(${Math.min(1, share || 0).toFixed(4)})`;
  write(row.lastElementChild, text);
}

/** Let a checkbox hold a choice of the view, which the address keeps unless it is the usual one; return what applies it. */
export function viewSwitch(store, name, apply, usual = false) {
  const box = byId(name);
  box.checked = store.address.view[name] === (usual ? '0' : '1') ? !usual : usual;
  box.addEventListener('change', () => {
    store.keepView(name, box.checked === usual ? '' : String(Number(box.checked)));
    apply(box.checked);
  });
  return () => apply(box.checked);
}

/** Whether the reader asks for little motion. */
export const reducedMotion = () => matchMedia('(prefers-reduced-motion: reduce)').matches;

let vanish = 0;

/** Show a message for a while, above everything. */
export function toast(text, kind = 'note') {
  const place = byId('toast');
  // Above an open dialog, too
  place.hidePopover();
  place.showPopover();
  place.dataset.kind = kind;
  place.textContent = text;
  clearTimeout(vanish);
  vanish = setTimeout(() => {
    place.hidePopover();
  }, 3000 + 50 * text.length);
}
