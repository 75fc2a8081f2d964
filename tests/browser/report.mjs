// SPDX-License-Identifier: MIT
// report.mjs CHROMIUM REPORT [SHOTS]: operates report.html like a reader, and prints TAP. The report is of a scene with at least two
// methods; its names are hostile. SHOTS: a folder for screenshots of the page.
import { createRequire } from 'node:module';
import { readFileSync } from 'node:fs';
import { resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

const [executablePath, report, shots] = process.argv.slice(2);
const require = createRequire(import.meta.url);
const { chromium } = require('playwright-core');
const axe = readFileSync(require.resolve('axe-core/axe.min.js'), 'utf-8');
const url = pathToFileURL(resolve(report)).href;
const tests = [];
const test = (title, body) => tests.push([title, body]);

function need(truth, ...about) {
  if (!truth) throw new Error(about.map((a) => (typeof a === 'string' ? a : JSON.stringify(a))).join(' '));
}

const browser = await chromium.launch({ executablePath, args: ['--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'] });
const faults = [],
  requests = [];

async function open(width, colorScheme = 'light', more = {}) {
  const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme, reducedMotion: 'reduce', ...more });
  const page = await context.newPage();
  // That pixels are read back often is this test's own doing.
  page.on('console', (m) => {
    if (['error', 'warning'].includes(m.type()) && !m.text().includes('willReadFrequently')) faults.push(m.text());
  });
  page.on('pageerror', (e) => faults.push(e.message));
  page.on('dialog', (d) => {
    faults.push(`dialog ${d.message()}`);
    d.dismiss();
  });
  page.on('request', (r) => requests.push(r.url()));
  await page.goto(url);
  await ready(page);
  return page;
}

// The drawn image is the requested one.
const ready = (page) =>
  page.waitForFunction(
    () => {
      const stage = document.getElementById('stage'),
        wanted = [state.mode, state.view, state.left, state.right, state.stops].join();
      return !busy && !again && stage.dataset.ready && stage.dataset.ready.startsWith(wanted);
    },
    null,
    { timeout: 15000 },
  );

// The pixels of the stage at some positions, as fractions of its size.
const look = (page) =>
  page.evaluate(() => {
    const c = document.getElementById('canvas'),
      pixels = c.getContext('2d').getImageData(0, 0, c.width, c.height).data,
      out = [];
    for (let v = 0.03; v < 1; v += 0.05)
      for (let u = 0.03; u < 1; u += 0.04)
        out.push(...pixels.slice(4 * (Math.floor(v * c.height) * c.width + Math.floor(u * c.width))).slice(0, 3));
    return out;
  });
// The stage, below the bar that stays at the top of the window.
async function boxOf(page) {
  await page.evaluate(() => stage.scrollIntoView({ block: 'end' }));
  return page.locator('#stage').boundingBox();
}
const differ = (a, b) => a.filter((v, i) => v !== b[i]).length;
const mean = (a) => a.reduce((s, v) => s + v, 0) / a.length;

let page = await open(1440);

test('loads, shows a picture, and its names are text', async () => {
  need(mean(await look(page)) > 5, 'the stage is black');
  need(await page.evaluate(() => window.hacked === undefined), 'a name ran');
  need((await page.locator('img, iframe, object, embed').count()) === 0, 'a name became an element');
  const title = await page.locator('#title').textContent();
  need(title.includes('<img') && title.includes('onerror'), 'the hostile title is not shown as it is:', title);
  need((await page.locator('#command').textContent()).includes('</script>'), 'the command lacks the hostile name');
  need(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'wider than the window');
});

test('the wipe moves pixels: by its slider, by dragging, by keys', async () => {
  await page.evaluate(() => {
    state.left = pictures.findIndex((p) => p.name === 'none');
    refresh();
  });
  await ready(page);
  const middle = await look(page);
  await page.locator('#wipe').fill('100');
  const left = await look(page);
  await page.locator('#wipe').fill('900');
  const right = await look(page);
  need(differ(middle, left) > 0 && differ(left, right) > differ(middle, left) / 4, differ(middle, left), differ(left, right));
  const box = await boxOf(page);
  await page.mouse.move(box.x + 0.9 * box.width, box.y + 0.3 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.25 * box.width, box.y + 0.3 * box.height, { steps: 3 });
  await page.mouse.up();
  const value = Number(await page.locator('#wipe').inputValue());
  need(Math.abs(value - 250) < 10, 'dragged to', value);
  await page.locator('#stage').focus();
  await page.keyboard.press(']');
  need(Number(await page.locator('#wipe').inputValue()) > value, 'the key ] does not wipe');
});

test('exposure changes light, by the right amount', async () => {
  const before = await look(page);
  await page.locator('#exposure').fill('2');
  await ready(page);
  const brighter = await look(page);
  need(mean(brighter) > 1.1 * mean(before), mean(before), mean(brighter));
  need(
    brighter.every((v, i) => v >= before[i] - 1),
    'a pixel got darker',
  );
  // One pixel through the curve, by hand: the tone curve is Reinhard's on luminance.
  const [shown, wanted] = await page.evaluate(() => {
    const view = views[state.view],
      planes = (window.planes = shown_planes()),
      at = brightest(planes);
    function shown_planes() {
      return shown[1].planes;
    }
    function brightest(p) {
      let best = 0;
      for (let i = 0; i < p[1].length; i++) if (luminance(p, i) > luminance(p, best)) best = i;
      return best;
    }
    const rgb = planes.map((p) => floats[p[at]]),
      e = view.exposure * 4,
      l = e * luminance(planes, at),
      white = view.white;
    const k = (e * (1 + l / white ** 2)) / (1 + l);
    const code = (x) => {
      const v = Math.min(1, k * x);
      return 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
    };
    const c = shown[1].canvas,
      pixel = c.getContext('2d').getImageData(at % c.width, Math.floor(at / c.width), 1, 1).data;
    return [[...pixel.slice(0, 3)], rgb.map(code)];
  });
  need(
    shown.every((v, i) => Math.abs(v - wanted[i]) < 1.01),
    shown,
    wanted,
  );
  await page.locator('#exposure').fill('0');
  await ready(page);
  need(differ(before, await look(page)) === 0, 'back at 0 it is another picture');
});

test('pictures in the page are the EXR files, within a half', async () => {
  const sum = await page.evaluate(async () => {
    const planes = await light(reference.data.whole);
    return planes.map((p) => p.reduce((s, h) => s + floats[h], 0) / p.length);
  });
  need(
    sum.every((v) => Number.isFinite(v) && v > 0),
    sum,
  );
  const bias = await page.evaluate(async () => {
    const m = methods[0],
      a = await light(m.data.part),
      b = await light(reference.data.part),
      mask = await map(views[0].mask);
    return [0, 1, 2].map((c) => {
      let d = 0,
        n = 0;
      for (let i = 0; i < mask.length; i++)
        if (mask[i] > 127) {
          d += floats[a[c][i]] - floats[b[c][i]];
          n++;
        }
      return [d / n, m.metrics.part.bias[c], m.metrics.part.mae];
    });
  });
  for (const [page_s, stated, mae] of bias) need(Math.abs(page_s - stated) < 0.02 * mae + 1e-6, bias);
});

test('side by side, signed error and FLIP: other pixels, a colour bar with numbers', async () => {
  const seen = [await look(page)];
  for (const [k, bar] of [
    [1, false],
    [2, true],
    [3, true],
  ]) {
    await page.locator(`#mode-${k}`).check();
    await ready(page);
    seen.push(await look(page));
    need((await page.locator('#bar').isVisible()) === bar, 'colour bar of mode', k);
    for (let i = 0; i < k; i++) need(differ(seen[i], seen[k]) > 10, 'modes', i, k, 'look alike');
    if (bar) need((await page.locator('#ticks span').allTextContents()).length === 5, 'ticks');
  }
  const before = await look(page);
  await page.locator('#range').selectOption({ index: 1 });
  await page.waitForFunction(() => !busy);
  need(differ(before, await look(page)) > 10, 'the range of colours changes nothing');
  await page.locator('#mode-0').check();
  await ready(page);
});

test('zoom is exact to the pixel, pan moves both pictures, the pointer reads light', async () => {
  await page.locator('#mode-1').check();
  await ready(page);
  await page.locator('#zoom-one').click();
  need((await page.locator('#zoom').textContent()).startsWith('100'), await page.locator('#zoom').textContent());
  const exact = () =>
    page.evaluate(() => {
      const p = panes()[0],
        [x, y] = corner(p),
        s = scaleOf(),
        ratio = 1,
        px = Math.floor(state.x),
        py = Math.floor(state.y);
      const at = canvas.getContext('2d').getImageData(x + px * s + Math.floor(s / 2), y + py * s + Math.floor(s / 2), ratio, 1).data;
      const own = shown[0].canvas.getContext('2d').getImageData(px, py, 1, 1).data;
      return [[...at.slice(0, 3)], [...own.slice(0, 3)]];
    });
  for (let k = 0; k < 4; k++) {
    const [at, own] = await exact();
    need(at.join() === own.join(), 'scale', await page.locator('#zoom').textContent(), at, own);
    await page.locator('#zoom-in').click();
  }
  const box = await boxOf(page),
    before = await look(page),
    x = await page.evaluate(() => state.x);
  await page.mouse.move(box.x + 0.2 * box.width, box.y + 0.5 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.2 * box.width + 24, box.y + 0.5 * box.height + 12, { steps: 2 });
  await page.mouse.up();
  need(differ(before, await look(page)) > 10 && (await page.evaluate((v) => state.x < v, x)), 'dragging does not pan');
  need(
    /x \d+ y \d+ +left [+−]?[\d.]+ % of right/.test(await page.locator('#readout').textContent()),
    await page.locator('#readout').textContent(),
  );
  const scale = await page.evaluate(() => scaleOf());
  await page.mouse.wheel(0, -120);
  need(await page.evaluate((v) => scaleOf() > v, scale), 'the wheel does not zoom');
  await page.locator('#stage').focus();
  const from = await page.evaluate(() => [state.x, state.y]);
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowUp');
  const to = await page.evaluate(() => [state.x, state.y]);
  need(to[0] > from[0] && to[1] < from[1], from, to);
  await page.keyboard.press('0');
  need(await page.evaluate(() => state.scale === 0), 'the key 0 does not fit');
  await page.locator('#mode-0').check();
  await ready(page);
});

test('sorting sorts: by click, by keyboard, and says so', async () => {
  const column = (k) => page.locator(`#rows tr > :nth-child(${k})`).allTextContents();
  need((await page.locator('th[aria-sort]').count()) === 1, 'one column is sorted by');
  const names = await column(1);
  need(names.length > 1, names);
  await page.locator('button[data-column="seconds"]').click();
  const times = await page.evaluate(() =>
    [...document.querySelectorAll('#rows th')].map((t) => methods.find((m) => m.name === t.textContent).seconds),
  );
  need(
    times.every((t, i) => !i || t >= times[i - 1]),
    times,
  );
  need((await page.locator('th:has(button[data-column="seconds"])').getAttribute('aria-sort')) === 'ascending', 'aria-sort');
  await page.keyboard.press('Enter'); // the heading kept the focus
  need(
    (await page.locator('th:has(button[data-column="seconds"])').getAttribute('aria-sort')) === 'descending',
    'aria-sort after Enter',
  );
  need((await page.locator('#sorted').textContent()).includes('largest first'), 'the order is not said');
  await page.locator('button[data-column="name"]').click();
  const sorted = await column(1);
  need(
    sorted.join() ===
      sorted
        .slice()
        .sort((a, b) => a.localeCompare(b))
        .join(),
    sorted,
  );
  const flip = await page.locator('#rows tr').first().textContent();
  await page.locator('#view-1').check();
  await ready(page);
  need((await page.locator('#rows tr').first().textContent()) !== flip, 'the whole picture has the numbers of its part');
  await page.locator('#view-0').check();
  await ready(page);
});

test('all can be reached with Tab, and the focus is seen', async () => {
  await page.locator('.skip').focus();
  const seen = new Set();
  let unseen = '';
  for (let k = 0; k < 80; k++) {
    await page.keyboard.press('Tab');
    const [id, visible] = await page.evaluate(() => {
      const e = document.activeElement,
        of = e.closest('.choice label') || e,
        style = getComputedStyle(of);
      return [e.id || e.dataset.column || e.tagName, style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2];
    });
    if (id === 'BODY') break;
    seen.add(id);
    if (!visible) unseen = id;
  }
  for (const id of [
    'theme',
    'mode-0',
    'view-0',
    'left',
    'swap',
    'right',
    'exposure',
    'zoom-in',
    'stage',
    'wipe',
    'flip',
    'same',
    'copy',
  ])
    need(seen.has(id), id, 'is not reached; reached are', [...seen]);
  need(!unseen, unseen, 'has no outline when it has the focus');
});

test('times, command and theme', async () => {
  need((await page.locator('.stack').count()) > 1 && (await page.locator('.segment').count()) > 4, 'no bars');
  const width = () =>
    page
      .locator('.stack')
      .last()
      .locator('.segment')
      .evaluateAll((all) => all.reduce((s, e) => s + e.getBoundingClientRect().width, 0));
  const own = await width();
  await page.locator('#same').check();
  need((await width()) < own, 'one scale for all changes nothing');
  await page.locator('#copy').click();
  await page.waitForFunction(() => document.getElementById('copied').textContent !== '');
  const color = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const light = await color();
  await page.locator('#theme').click();
  need((await color()) !== light, 'the theme stays');
  await page.reload();
  await ready(page);
  need((await color()) !== light, 'the theme is forgotten');
});

for (const width of [1440, 400])
  for (const scheme of ['light', 'dark'])
    test(`no serious fault of accessibility: ${width} pixels, ${scheme}`, async () => {
      await page.context().close();
      page = await open(width, scheme);
      need(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'wider than the window');
      for (const mode of [0, 2]) {
        await page.locator(`#mode-${mode}`).check();
        await ready(page);
        await page.evaluate(axe);
        const found = await page.evaluate(() => window.axe.run(document, { resultTypes: ['violations'] }));
        const bad = found.violations.filter((v) => ['serious', 'critical'].includes(v.impact));
        need(
          bad.length === 0,
          bad.map(
            (v) => `${v.id}: ${v.nodes.map((n) => `${n.html.slice(0, 120)} ${n.any.map((a) => a.message).join('; ')}`).join(' | ')}`,
          ),
        );
      }
      if (shots) await page.screenshot({ path: `${shots}/${width}-${scheme}.png`, fullPage: true });
    });

test('nothing but the file was asked for, and the console stayed empty', async () => {
  need(
    requests.every((r) => r === url || r.startsWith('data:') || r.startsWith('blob:')),
    requests,
  );
  need(faults.length === 0, faults);
});

console.log(`1..${tests.length}`);
let failed = 0;
for (const [k, [title, body]] of tests.entries()) {
  try {
    await body();
    console.log(`ok ${k + 1} - ${title}`);
  } catch (fault) {
    failed = 1;
    console.log(
      `not ok ${k + 1} - ${title}\n# ${String(fault.stack || fault)
        .split('\n')
        .slice(0, 6)
        .join('\n# ')}`,
    );
  }
}
await browser.close();
process.exit(failed);
