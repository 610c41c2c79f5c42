// SPDX-License-Identifier: Apache-2.0
// Before the first paint, so that the page does not flash: light, dark, or as the system.
globalThis.shade = (() => {
  'use strict';
  const { dataset } = document.documentElement;
  const system = matchMedia('(prefers-color-scheme: dark)');
  const shade = () => { dataset.shade = dataset.theme || (system.matches ? 'dark' : 'light'); };
  let kept = null;
  try {
    kept = new URLSearchParams(location.hash.slice(1)).get('theme') || localStorage.getItem('theme');
  } catch {
    // Storage may be switched off.
  }
  if (kept === 'light' || kept === 'dark') dataset.theme = kept;
  shade();
  return shade;
})();
