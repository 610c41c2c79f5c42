// Opens pages in Firefox by puppeteer-core and WebDriver BiDi, and prints as JSON what each shows and complains of.
// node firefox.mjs BROWSER ADDRESS...

import { readFileSync } from 'node:fs';
import { setTimeout as sleep } from 'node:timers/promises';
import puppeteer from 'puppeteer-core';

const [executablePath, ...addresses] = process.argv.slice(2);
const beside = (name) => readFileSync(new URL(name, import.meta.url), 'utf8');
// As the usual size: `setViewport` of the newest puppeteer asks Firefox ESR for what it does not know.
const defaultViewport = { width: 1280, height: 800 };
const browser = await puppeteer.launch({ browser: 'firefox', executablePath, defaultViewport, protocolTimeout: 400_000 });
const page = await browser.newPage();
let complaints = [];
page.on('console', (message) => complaints.push(`${message.type()}: ${message.text()}`));
page.on('pageerror', (error) => complaints.push(`exception: ${error.message}`));
page.on('requestfailed', (request) => complaints.push(`failed: ${request.url()}`));

/** Wait until an expression is true; the policy of the page forbids `waitForFunction`, which makes functions of texts. */
const until = async (expression) => {
  const tried = `(() => { try { return Boolean(${expression}); } catch { return false; } })()`;
  while (!await page.evaluate(tried)) await sleep(100);
};
const paused = (yes) => until(`document.querySelector('#status').dataset.state ${yes ? '===' : '!=='} 'paused'`);

await page.evaluateOnNewDocument(beside('slow_screen.js'));
const shown = [];
for (const address of addresses) {
  complaints = [];
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
  shown.push({ canvases: await page.evaluate(beside('canvases.js')), complaints });
}
console.log(JSON.stringify({ version: await browser.version(), shown }));
await browser.close();
