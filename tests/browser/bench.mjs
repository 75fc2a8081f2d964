// SPDX-License-Identifier: MIT
// bench.mjs CHROMIUM PAGE PROGRAM [SHOTS]: operates the site's profile bench like a user, compares it with `pellucid profile`, and prints
// TAP. SHOTS: a folder for screenshots of the page.
import { createRequire } from 'node:module';
import { execFileSync } from 'node:child_process';

const [executablePath, address, program, shots] = process.argv.slice(2);
const require = createRequire(import.meta.url);
const { chromium } = require('playwright-core');
const MODELS = ['dipole', 'better-dipole', 'normalized-diffusion', 'photon-beam', 'monte-carlo'];
const printed = (...words) => JSON.parse(execFileSync(program, ['profile', ...words, '--json'], { encoding: 'utf-8' }));

function need(truth, ...about) {
  if (!truth) throw new Error(about.map((a) => (typeof a === 'string' ? a : JSON.stringify(a))).join(' '));
}

const browser = await chromium.launch({ executablePath, args: ['--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'] });
const faults = [];

async function open(query, width = 1440, colorScheme = 'light') {
  const page = await (await browser.newContext({ viewport: { width, height: 900 }, colorScheme })).newPage();
  page.on('pageerror', (e) => faults.push(String(e)));
  page.on('request', (r) => r.url().startsWith('file:') || r.url().startsWith('data:') || faults.push(`asks for ${r.url()}`));
  await page.goto(`${address}?${query}`);
  await page.waitForSelector('html[data-bench=ready]', { timeout: 60000 });
  return page;
}

// The numbers of a row of the page's table, in three channels.
const cells = (page, name) => page.$$eval(`[data-${name}]`, (all, n) => all.map((c) => Number(c.dataset[n])), name);
// The page does not round; the program prints nine digits, and math libraries differ in the last.
const near = (a, b, most) => Math.abs(a - b) <= most * Math.max(Math.abs(a), Math.abs(b));

const tests = [
  [
    'profiles, totals and paths of every model are those of the program',
    async () => {
      for (const [i, model] of MODELS.entries()) {
        const material = ['marble', 'wholemilk', 'ketchup', 'skin1', 'apple'][i];
        const page = await open(`material=${material}&model=${model}&gaussians=0`);
        const totals = await cells(page, 'total');
        const [radii, values] = await page.$eval('#curves', (e) => [e.dataset.r, e.dataset.values]);
        const at = radii.split(' ').map(Number), curves = values.split(';').map((v) => v.split(' ').map(Number));
        const profile = printed(material, '--model', model, '--gaussians', '0', '--points', String(at.length), '--from', `${at[0]}mm`,
          '--to', `${at.at(-1)}mm`);
        need(curves.length === 3 && at.length > 50, at.length);
        profile.channels.forEach((channel, c) => {
          need(near(totals[c], channel.rd_total, 2e-8), material, model, totals, channel.rd_total);
          channel.r_mm.forEach((r, i) => need(near(r, at[i], 2e-8), 'radius', r, at[i]));
          channel.R.forEach((R, i) => need(near(R, curves[c][i], 2e-7), material, model, 'R', at[i], R, curves[c][i]));
        });
        await page.context().close();
      }
    },
  ],
  [
    'fits have the error and the Gaussians of the program',
    async () => {
      for (const [material, model, count] of [['marble', 'dipole', 4], ['wholemilk', 'dipole', 6], ['skin1', 'better-dipole', 3]]) {
        const profile = printed(material, '--model', model, '--gaussians', String(count));
        const page = await open(`material=${material}&model=${model}&gaussians=${count}`);
        const errors = await cells(page, 'error'), variances = await cells(page, 'variance');
        profile.channels.forEach(({ fit }, c) => {
          need(near(errors[c], 100 * fit.error, 1e-5), material, model, errors[c], 100 * fit.error);
          fit.gaussians.forEach((g, i) => need(near(variances[3 * i + c], g.variance_mm2, 1e-3), material, model, i, variances, g));
        });
        await page.context().close();
      }
    },
  ],
  [
    'numbers that are typed change the curves, and a medium that can not be is told',
    async () => {
      const page = await open('material=marble');
      const before = await cells(page, 'total');
      await page.fill('#a0', '1');
      const after = await cells(page, 'total');
      need(after[0] < 0.6 * before[0] && after[1] === before[1], before, after);
      need((await page.inputValue('#material')) === '', 'a material that was changed keeps its name');
      await page.fill('#s0', '-1');
      need(await page.isVisible('#fault'), 'no fault is shown');
      await page.selectOption('#material', 'wholemilk');
      need(!(await page.isVisible('#fault')) && (await cells(page, 'total'))[0] > 0.9, 'whole milk');
      await page.context().close();
    },
  ],
  [
    'the page fits 1440 and 400 pixels, light and dark',
    async () => {
      for (const [width, scheme] of [[1440, 'light'], [400, 'dark']]) {
        const page = await open('material=marble', width, scheme);
        const wide = await page.evaluate(() => document.documentElement.scrollWidth);
        need(wide <= width, 'the page is', wide, 'wide in', width);
        if (shots) await page.screenshot({ path: `${shots}/bench-${width}.png`, fullPage: true });
        await page.context().close();
      }
      need(faults.length === 0, faults);
    },
  ],
];

console.log(`1..${tests.length}`);
let failed = 0;
for (const [i, [title, body]] of tests.entries()) {
  try {
    await body();
    console.log(`ok ${i + 1} - ${title}`);
  } catch (fault) {
    failed += 1;
    console.log(`not ok ${i + 1} - ${title}\n# ${String(fault.stack).replaceAll('\n', '\n# ')}`);
  }
}
await browser.close();
process.exit(failed ? 1 : 0);
