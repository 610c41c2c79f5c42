// Opens a page in a browser by puppeteer-core, and prints as JSON what it shows and complains of.
// node engines.mjs ENGINE BROWSER ADDRESS
// Firefox is driven by WebDriver BiDi.

import { setTimeout as sleep } from 'node:timers/promises';
import puppeteer from 'puppeteer-core';

const [engine, executablePath, address] = process.argv.slice(2);
const browser = await puppeteer.launch({
  browser: engine, executablePath, args: engine === 'chrome' ? ['--no-sandbox', '--disable-gpu'] : [], protocolTimeout: 400_000,
});
const page = await browser.newPage();
const complaints = [];
page.on('console', (message) => complaints.push(`${message.type()}: ${message.text()}`));
page.on('pageerror', (error) => complaints.push(`exception: ${error.message}`));
page.on('requestfailed', (request) => complaints.push(`failed: ${request.url()}`));

/** Wait until an expression is true; the policy of the page forbids `waitForFunction`, which makes functions of texts. */
const until = async (expression) => {
  const tried = `(() => { try { return Boolean(${expression}); } catch { return false; } })()`;
  while (!await page.evaluate(tried)) await sleep(100);
};
const paused = (yes) => until(`document.querySelector('#status').dataset.state ${yes ? '===' : '!=='} 'paused'`);

await page.setViewport({ width: 1280, height: 800 });
await page.goto(address);
await until('impactDamper.store.frames > 3 && impactDamper.history.impacts.length > 2 && document.querySelector("#knob-gap")');
await page.keyboard.press(' ');
await paused(true);
await page.keyboard.press(' ');
await paused(false);
await page.evaluate('document.querySelector("#knob-gap").focus(); document.querySelector("#knob-gap").select()');
await page.keyboard.type('26');
await page.keyboard.press('Enter');
await until('impactDamper.store.values.gap === 0.026');
await until('impactDamper.history.changes.length > 0');
// Canvases that are seen, and how many colours are in each
const drawn = await page.evaluate(`Object.fromEntries([...document.querySelectorAll('canvas')].filter((one) => one.width && one.offsetParent).map((one) => {
  const { data } = one.getContext('2d').getImageData(0, 0, one.width, one.height);
  return [one.id || one.parentElement.className, new Set(new Uint32Array(data.buffer)).size];
}))`);
console.log(JSON.stringify({ engine: await browser.version(), drawn, complaints }));
await browser.close();
