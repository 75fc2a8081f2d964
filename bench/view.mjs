// SPDX-License-Identifier: MIT
// view.mjs CHROMIUM ADDRESS SECONDS: rotates the object in a browser and prints its measurements as one JSON object. Run by view.py.
import { createRequire } from 'node:module';

const [executablePath, address, seconds] = process.argv.slice(2);
const require = createRequire(new URL('../tests/browser/', import.meta.url));
const { chromium } = require('playwright-core');
const browser = await chromium.launch({
  executablePath,
  args: ['--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--disable-background-networking', '--disable-component-update'],
});
const page = await (await browser.newContext({ viewport: { width: 1440, height: 900 } })).newPage();
await page.goto(address);
await page.waitForFunction(() => document.getElementById('stage').dataset.id, null, { timeout: 120000 });
const box = await page.locator('#canvas').boundingBox();

// Each image of A, as it is drawn; the latency is from the input to the end of its drawing.
await page.evaluate(() => {
  window.seen = [];
  let last = window.pellucid;
  Object.defineProperty(window, 'pellucid', {
    get: () => last,
    set: (value) => {
      last = value;
      window.seen.push({ ...value.last, at: performance.now() });
    },
  });
});
const at = (i) => [box.x + box.width * (0.5 + 0.2 * Math.sin(i / 40)), box.y + box.height * (0.5 + 0.06 * Math.sin(i / 25))];
await page.mouse.move(...at(0));
await page.mouse.down();
const begin = Date.now();
for (let i = 1; Date.now() - begin < 1000 * Number(seconds); i++) {
  await page.mouse.move(...at(i));
  await page.waitForTimeout(8);
}
const seen = await page.evaluate(() => window.seen);
await page.mouse.up();

const moving = seen.filter((s) => s.sent !== undefined && !s.still);
const sorted = (values) => values.toSorted((a, b) => a - b);
const percentile = (values, fraction) => sorted(values)[Math.min(values.length - 1, Math.floor(fraction * values.length))];
const first = moving[0];
const last = moving.at(-1);
const latencies = moving.map((s) => s.at - s.sent);
console.log(
  JSON.stringify({
    pictures_per_second: ((moving.length - 1) / (last.at - first.at)) * 1000,
    input_to_photon_ms: percentile(latencies, 0.5),
    input_to_photon_95_ms: percentile(latencies, 0.95),
    render_ms: percentile(moving.map((s) => s.ms), 0.5),
    encode_ms: percentile(moving.map((s) => s.encode_ms), 0.5),
    width: last.width,
    height: last.height,
  }),
);
await browser.close();
