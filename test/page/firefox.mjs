// Opens pages in Firefox by puppeteer-core and WebDriver BiDi, and prints as JSON what each shows and complains of.
// node firefox.mjs BROWSER ADDRESS...

import { readFileSync } from 'node:fs';
import { setTimeout as sleep } from 'node:timers/promises';
import puppeteer from 'puppeteer-core';

const [executablePath, ...addresses] = process.argv.slice(2);
const beside = (name) => readFileSync(new URL(name, import.meta.url), 'utf8');
// As the usual size: `setViewport` of the newest puppeteer asks Firefox ESR for what it does not know.
const defaultViewport = { width: 1280, height: 800 };
// Few processes: each takes half a second of processor to start.
const extraPrefsFirefox = { 'fission.autostart': false, 'dom.ipc.processPrelaunch.enabled': false, 'extensions.webextensions.remote': false };
const browser = await puppeteer.launch({ browser: 'firefox', executablePath, defaultViewport, extraPrefsFirefox, protocolTimeout: 400_000 });
const page = await browser.newPage();
let complaints = [];
/** How long to wait, ms, and what a failure says of the page. */
const LONGEST = 100_000;
const STATE = 'JSON.stringify([location.href, document.querySelector("#status")?.textContent, document.activeElement.id, document.hidden, impactDamper.store.frames, impactDamper.history.impacts.length, impactDamper.store.values.gap, impactDamper.history.changes])';
page.on('console', (message) => complaints.push(`${message.type()}: ${message.text()}`));
page.on('pageerror', (error) => complaints.push(`exception: ${error.message}`));
page.on('requestfailed', (request) => complaints.push(`failed: ${request.url()}`));

/** Wait until an expression is true; the policy of the page forbids `waitForFunction`, which makes functions of texts. */
const until = async (expression) => {
  const tried = `(() => { try { return Boolean(${expression}); } catch { return false; } })()`;
  for (const end = Date.now() + LONGEST; !await page.evaluate(tried); await sleep(100)) {
    if (Date.now() > end) throw new Error(`in vain: ${expression}; the page has ${await page.evaluate(STATE)}`);
  }
};
const paused = (yes) => until(`document.querySelector('#status').dataset.state ${yes ? '===' : '!=='} 'paused'`);

await page.evaluateOnNewDocument(beside('slow_screen.js'));
const shown = [];
for (const address of addresses) {
  complaints = [];
  await page.goto(address);
  // Keys go to the page, not to what had the focus in the process of the page before.
  await page.bringToFront();
  // Firefox clicks on nothing that it has not drawn yet.
  await until('impactDamper.store.frames > 3 && impactDamper.history.impacts.length > 2 && document.querySelector("#knob-gap")');
  // Not `page.click`, which may look in the document before.
  const { x, y } = JSON.parse(await page.evaluate('JSON.stringify(document.querySelector("h1").getBoundingClientRect())'));
  await page.mouse.click(x + 4, y + 4);
  await until('document.hasFocus()');
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
