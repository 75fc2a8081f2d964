// SPDX-License-Identifier: MIT
// record_viewer.mjs CHROMIUM ADDRESS FOLDER: operates the viewer like a user, and keeps screenshots as FOLDER/NNN.png; NNN-rest.png
// is shown for longer. Run by record_viewer.py.
import { createRequire } from 'node:module';

const [executablePath, address, folder] = process.argv.slice(2);
const require = createRequire(new URL('../tests/browser/', import.meta.url));
const { chromium } = require('playwright-core');
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'] });
const context = await browser.newContext({
  viewport: { width: 1180, height: 660 },
  reducedMotion: 'reduce',
  colorScheme: 'dark',
  bypassCSP: true, // for the style below
});
const page = await context.newPage();
let frames = 0;
const keep = (rest = false) => page.screenshot({ path: `${folder}/${String(frames++).padStart(3, '0')}${rest ? '-rest' : ''}.png` });
const still = async () => {
  await page.waitForTimeout(150);
  await page.waitForFunction(() => document.getElementById('stage').dataset.still === 'true', null, { timeout: 120000 });
};

// Moves the mouse along a line while the button is down.
async function drag(from, to, steps) {
  const at = (t) => [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])];
  await page.mouse.move(...at(0));
  await page.mouse.down();
  for (let i = 1; i <= steps; i++) {
    await page.mouse.move(...at(i / steps));
    await page.waitForTimeout(160);
    await keep();
  }
  await page.mouse.up();
  await still();
  await keep(true);
}

async function material(name) {
  await page.click('#tab-material');
  await page.fill('#material-search', name);
  await keep();
  await page.click(`.swatch[data-material="${name}"]`);
  await still();
  await keep(true);
}

await page.goto(address);
await still();
await page.addStyleTag({ content: '.status, .under, .messages { display: none !important; }' });
const view = await page.locator('#canvas').boundingBox();
const on = (u, v) => [view.x + u * view.width, view.y + v * view.height];

await keep(true);
await drag(on(0.3, 0.5), on(0.48, 0.48), 10);
await material('skin1');
await material('jade');
await page.click('#tab-light');
await keep();
const light = await page.locator('.light-handle').first().boundingBox();
await drag([light.x + light.width / 2, light.y + light.height / 2], on(0.8, 0.25), 8);
await page.click('#tab-compare');
await page.selectOption('#other', 'none');
await still();
await keep(true);
const handle = await page.locator('#handle').boundingBox();
await drag([handle.x + handle.width / 2, handle.y + handle.height / 2], on(0.25, 0.5), 6);
await drag(on(0.25, 0.5), on(0.7, 0.5), 8);
await browser.close();
