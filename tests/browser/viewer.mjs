// SPDX-License-Identifier: MIT
// viewer.mjs CHROMIUM ADDRESS PROGRAM [SHOTS]: operates `pellucid view` like a user, and prints TAP. The scene is a ball of marble on
// 160 x 90 pixels. SHOTS: a folder for screenshots of the page.
import { createRequire } from 'node:module';
import { execFileSync, spawn } from 'node:child_process';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, delimiter } from 'node:path';

const [executablePath, address, program, shots] = process.argv.slice(2);
const require = createRequire(import.meta.url);
const { chromium } = require('playwright-core');
const axe = readFileSync(require.resolve('axe-core/axe.min.js'), 'utf-8');
const tests = [];
const test = (title, body) => tests.push([title, body]);
const PATIENCE = 60000;

function need(truth, ...about) {
  if (!truth) throw new Error(about.map((a) => (typeof a === 'string' ? a : JSON.stringify(a))).join(' '));
}

const browser = await chromium.launch({
  executablePath,
  args: [
    '--no-sandbox',
    '--disable-gpu',
    '--disable-dev-shm-usage',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--no-first-run',
  ],
});
const faults = [];
const requests = [];

// A page, and the views that it sends.
async function open(width = 1440, colorScheme = 'light', url = address, more = {}, before = null) {
  const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme, reducedMotion: 'reduce', ...more });
  const page = await context.newPage();
  if (before) await page.addInitScript(before);
  page.sent = [];
  page.cuts = [];
  page.on('console', (m) => {
    if (['error', 'warning'].includes(m.type()) && !/WebSocket|willReadFrequently/.test(m.text())) faults.push(m.text());
  });
  page.on('pageerror', (e) => faults.push(e.message));
  page.on('request', (r) => requests.push(r.url()));
  await page.routeWebSocket(/./, (socket) => {
    const server = socket.connectToServer();
    page.cuts.push(() => socket.close());
    socket.onMessage((message) => {
      page.sent.push(JSON.parse(message));
      server.send(message);
    });
  });
  await page.goto(url);
  await finished(page);
  return page;
}

// The image of the last view that was sent is shown, as render draws it.
async function finished(page) {
  await page.waitForTimeout(120); // typed or dragged input has been sent
  await page.waitForFunction(() => document.getElementById('stage').dataset.still === 'true', null, { timeout: PATIENCE });
}

const look = (page) =>
  page.evaluate(() => {
    const c = document.getElementById('canvas');
    return [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data];
  });
const differ = (a, b) => a.filter((v, i) => v !== b[i]).length;
const last = (page) => page.sent.filter((m) => m.type === 'view').at(-1).state;
// Input is sent a moment later.
async function says(page, wanted, ...about) {
  for (let i = 0; i < 500; i++) {
    if (wanted(last(page))) return;
    await page.waitForTimeout(20);
  }
  need(false, ...about, last(page));
}
const tab = (page, name) => page.click(`#tab-${name}`);
const complaints = (page) => page.locator('.message.error').allTextContents();

let page = await open();

test('opens, shows the ball, fetches nothing from elsewhere', async () => {
  const pixels = await look(page);
  need(new Set(pixels).size > 40, 'one flat colour');
  need(
    requests.every((r) => new URL(r).origin === new URL(address).origin || r.startsWith('data:') || r.startsWith('blob:')),
    requests,
  );
  need((await page.locator('#status-size').textContent()) === '160 × 90', await page.locator('#status-size').textContent());
});

test('dragging, the wheel and keys turn, move and come closer', async () => {
  const box = await page.locator('#canvas').boundingBox();
  const at = (u, v) => [box.x + u * box.width, box.y + v * box.height];
  let before = await look(page);
  const moves = async (what, act) => {
    await act();
    await finished(page);
    const now = await look(page);
    need(differ(before, now) > 100, what, 'changes', differ(before, now), 'values');
    before = now;
  };
  const drag = async (button) => {
    await page.mouse.move(...at(0.5, 0.5));
    await page.mouse.down({ button });
    await page.mouse.move(...at(0.6, 0.45), { steps: 4 });
    await page.mouse.up({ button });
  };
  await moves('a drag', () => drag('left'));
  await moves('a drag with the right button', () => drag('right'));
  await moves('the wheel', async () => {
    await page.mouse.move(...at(0.5, 0.5));
    await page.mouse.wheel(0, -240);
  });
  await page.locator('#stage').focus();
  for (const key of ['ArrowLeft', 'Shift+ArrowUp', '+', '3', '0']) await moves(key, () => page.keyboard.press(key));
  need(!last(page).camera, 'the camera of the file is not back');
  need((await complaints(page)).length === 0, await complaints(page));
});

test('a click shows numbers and a ring, a double click looks at the point', async () => {
  const box = await page.locator('#canvas').boundingBox();
  await page.mouse.click(box.x + 0.5 * box.width, box.y + 0.45 * box.height);
  await page.waitForSelector('#picked:not([hidden]) .plot', { timeout: PATIENCE });
  need((await page.locator('#picked').textContent()).includes('marble'), await page.locator('#picked').textContent());
  need(await page.locator('#ring').isVisible(), 'no ring');
  await page.mouse.dblclick(box.x + 0.55 * box.width, box.y + 0.4 * box.height);
  await page.waitForFunction(() => document.getElementById('ring').hidden, null, { timeout: PATIENCE });
  await finished(page);
  const camera = last(page).camera;
  need(camera?.focus && camera.to.some((x) => Math.abs(parseFloat(x)) > 1), camera);
  await page.locator('#stage').focus();
  await page.keyboard.press('0');
  await finished(page);
});

test('every knob of every method reaches the renderer', async () => {
  await tab(page, 'method');
  const names = await page.locator('#method option').evaluateAll((list) => list.map((o) => o.value));
  need(names.length >= 10, names);
  for (const name of names) {
    await page.selectOption('#method', name);
    const knobs = await page.locator('#panel-method .knob').evaluateAll((list) => list.map((k) => k.dataset.knob));
    for (const knob of knobs) {
      if (knob === 'as') continue; // its button follows
      const box = page.locator(`#panel-method .knob[data-knob="${knob}"]`);
      const select = box.locator('select');
      const check = box.locator('input[type="checkbox"]');
      if (await select.count()) await select.selectOption({ index: 1 });
      else if (await check.count()) await check.click();
      else
        await box.evaluate((node) => {
          const slider = node.querySelector('input[type="range"]');
          const field = slider ?? node.querySelector('input[type="text"]');
          field.value = slider ? '400' : '0.5,0.5,0.5';
          field.dispatchEvent(new Event('change'));
        });
      await says(page, (said) => said.method === name && knob in said.knobs, name, knob);
    }
    await page.click('#knobs-reset');
    await says(page, (said) => Object.keys(said.knobs).length === 0, 'defaults');
    if (await page.locator('#knobs-paper').count()) {
      await page.click('#knobs-paper');
      await says(page, (said) => said.knobs.as === 'paper', 'as in the paper');
    }
  }
  await page.selectOption('#method', 'screen-space');
  await finished(page);
  need((await complaints(page)).length === 0, await complaints(page));
});

test('a wrong value is said in the page, the image stays, and undo takes it back', async () => {
  const before = await look(page);
  await page.locator('[data-knob="gaussians"] input[type="text"]').fill('99');
  await page.keyboard.press('Tab');
  await page.waitForSelector('.message.error', { timeout: PATIENCE });
  need((await complaints(page)).some((c) => c.includes('99') && c.includes('10')), await complaints(page));
  need(differ(before, await look(page)) === 0, 'the image is gone');
  await page.click('#undo');
  await finished(page);
  need((await page.locator('[data-knob="gaussians"] input[type="text"]').inputValue()) === '4', 'undo');
  need((await complaints(page)).length === 0, 'the error stays');
});

test('materials, coefficients and lights change the picture', async () => {
  await tab(page, 'material');
  let before = await look(page);
  await page.fill('#material-search', 'ketch');
  need((await page.locator('.swatch:visible').count()) === 1, 'search');
  await page.click('.swatch:visible');
  await finished(page);
  let now = await look(page);
  need(differ(before, now) > 1000 && last(page).materials['*'].preset === 'ketchup', last(page));
  before = now;
  await page.click('#material-editor summary');
  await page.waitForSelector('#profile-plot path.fit', { state: 'attached', timeout: PATIENCE });
  need((await page.locator('#profile-model option').count()) >= 4, 'models of the profile bench');
  await page.waitForSelector('#profile-slab .plot', { state: 'attached', timeout: PATIENCE });
  need((await page.locator('#profile-looks canvas').count()) === 2, 'the half-lit plane and the laser dot');
  let waiting = page.waitForEvent('download');
  await page.click('#profile-export [data-language="glsl"]');
  const code = await waiting;
  need(code.suggestedFilename() === 'material.glsl', code.suggestedFilename());
  need(/const vec3 material_/.test(readFileSync(await code.path(), 'utf-8')), 'no GLSL');
  await page.locator('#concentration').fill('120');
  await finished(page);
  now = await look(page);
  need(differ(before, now) > 500 && last(page).materials['*'].sigma_a.length === 3, last(page));
  before = now;
  await page.fill('#material-search', '');
  await tab(page, 'light');
  need((await page.locator('.dot').count()) === 3, 'the studio has three lights');
  const pad = await page.locator('.pad').boundingBox();
  const dot = await page.locator('.dot').first().boundingBox();
  await page.mouse.move(dot.x + dot.width / 2, dot.y + dot.height / 2);
  await page.mouse.down();
  await page.mouse.move(pad.x + 0.7 * pad.width, pad.y + 0.2 * pad.height, { steps: 5 });
  await page.mouse.up();
  await finished(page);
  now = await look(page);
  need(differ(before, now) > 500, 'the light changes', differ(before, now));
  before = now;
  await page.locator('.dot').first().focus();
  await page.keyboard.press('ArrowDown');
  await finished(page);
  now = await look(page);
  need(differ(before, now) > 100, 'arrow keys do not move a light');
  before = now;
  const handle = await page.locator('.light-handle').first().boundingBox();
  const view = await page.locator('#canvas').boundingBox();
  const old = JSON.stringify(last(page).lights);
  await page.mouse.move(handle.x + handle.width / 2, handle.y + handle.height / 2);
  await page.mouse.down();
  await page.mouse.move(view.x + 0.6 * view.width, view.y + 0.3 * view.height, { steps: 5 });
  await page.mouse.up();
  await finished(page);
  need(JSON.stringify(last(page).lights) !== old && differ(before, await look(page)) > 100, 'a light is not dragged in the view');
  const moved = await page.locator('.light-handle').first().boundingBox();
  const off = Math.hypot(moved.x + moved.width / 2 - view.x - 0.6 * view.width, moved.y + moved.height / 2 - view.y - 0.3 * view.height);
  need(off < 12, 'the handle is not where the hand left it', off);
  need((await complaints(page)).length === 0, await complaints(page));
  if (shots) await page.screenshot({ path: `${shots}/light.png` });
});

test('skin is made of melanin and blood, and its layers are drawn', async () => {
  await tab(page, 'material');
  await page.fill('#material-search', 'skin-6');
  await page.click('.swatch:visible');
  await page.click('#skin-begin');
  await finished(page);
  const light = await look(page);
  await page.waitForSelector('#profile-layers svg', { state: 'attached', timeout: PATIENCE });
  need((await page.locator('#profile-layers').textContent()).includes('epidermis'), 'no layers');
  await page.locator('#skin-melanin').fill('900');
  await finished(page);
  need(last(page).materials['*'].skin.melanin > 0.2, last(page).materials);
  need(differ(light, await look(page)) > 1000, 'melanin changes nothing');
  if (shots) await page.screenshot({ path: `${shots}/skin.png` });
  await page.fill('#material-search', 'marble');
  await page.click('.swatch[data-material="marble"]');
  await finished(page);
  await page.fill('#material-search', '');
  need((await complaints(page)).length === 0, await complaints(page));
});

test('a second method stands behind the wipe; the reference gives an error that sharpens', async () => {
  await tab(page, 'compare');
  await page.selectOption('#other', 'none');
  await finished(page);
  await page.waitForSelector('#handle:not([hidden])', { timeout: PATIENCE });
  const middle = await look(page);
  await page.locator('#stage').focus();
  for (let i = 0; i < 6; i++) await page.keyboard.press('[');
  need(differ(middle, await look(page)) > 50, 'the wipe moves nothing');
  await page.check('input[name="mode"][value="difference"]', { force: true });
  need(differ(middle, await look(page)) > 1000, 'the difference');
  await page.selectOption('#truth', 'path-trace');
  await page.waitForFunction(() => /±|under/.test(document.querySelector('#errors .big')?.textContent ?? ''), null, { timeout: PATIENCE });
  need((await page.locator('#errors tbody tr').count()) >= 5, 'numbers');
  await page.check('input[name="mode"][value="error"]', { force: true });
  if (shots) await page.screenshot({ path: `${shots}/error.png` });
  const waiting = page.waitForEvent('download');
  await page.click('#save summary');
  await page.click('#save-report');
  const report = readFileSync(await (await waiting).path(), 'utf-8');
  const data = JSON.parse(/<script type="application\/json" id="data">(.*?)<\/script>/s.exec(report)[1]);
  need(data.pictures.map((p) => p.role).join() === 'reference,method,method' && data.pictures[2].name === 'none', data.pictures);
  await page.selectOption('#truth', '');
  await page.selectOption('#other', '');
  need(await page.locator('#errors').isHidden(), 'the error stays');
  await finished(page);
});

test('the scene is saved, the link shows the same view', async () => {
  const waiting = page.waitForEvent('download');
  await page.click('#save summary');
  await page.click('#save-scene');
  const file = await waiting;
  const scene = JSON.parse(readFileSync(await file.path(), 'utf-8'));
  need(file.suggestedFilename() === 'ball-view.json' && scene.pellucid === 1 && scene.lights.length === 3 && scene.render.exposure, scene);
  await page.waitForTimeout(500);
  const url = page.url();
  need(url.includes('#view='), url);
  const other = await open(1440, 'light', url);
  need(differ(await look(page), await look(other)) === 0, 'the link shows another view');
  await other.context().close();
});

// The program with other options, below this folder, and its address.
async function start(...options) {
  const viewer = spawn(program, ['view', ...options, '--no-open'], { stdio: ['ignore', 'pipe', 'inherit'] });
  const line = await new Promise((done, fail) => {
    viewer.stdout.once('data', (text) => done(String(text).trim()));
    viewer.once('exit', (code) => fail(new Error(`${options.join(' ')} ended with ${code}`)));
  });
  return { line, end: () => viewer.kill('SIGINT') };
}

// Runs a command line as a shell does, and returns the image that it writes.
function run(command) {
  execFileSync('sh', ['-c', command], { env: { ...process.env, PATH: dirname(program) + delimiter + process.env.PATH }, stdio: 'pipe' });
  return readFileSync(/ -o (\S+)$/.exec(command)[1]);
}

const decoded = (page, png) =>
  page.evaluate(async (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
    context.drawImage(bitmap, 0, 0);
    return [bitmap.width, bitmap.height, ...context.getImageData(0, 0, bitmap.width, bitmap.height).data];
  }, png.toString('base64'));

async function save(page, what) {
  const waiting = page.waitForEvent('download');
  await page.click('#save summary');
  await page.click(`#save-${what}`);
  return readFileSync(await (await waiting).path());
}

async function copied(page) {
  await page.click('#save summary');
  await page.click('#copy-command');
  await page.waitForFunction(() => /Command line/.test(document.getElementById('messages').textContent));
  return page.evaluate(() => navigator.clipboard.readText());
}

test('the command line that is copied renders what is shown, whatever options the program was started with', async () => {
  mkdirSync('be low', { recursive: true });
  writeFileSync('be low/ball.obj', readFileSync('ball.obj'));
  writeFileSync(
    'be low/file.json',
    JSON.stringify({
      pellucid: 1,
      mesh: 'ball.obj',
      size: '30mm',
      materials: { '*': { preset: 'marble' } },
      render: { width: 96, height: 54, msaa: 2, method: 'image-space', knobs: { samples: 20 }, bloom: 0.3, stops: 0.5 },
    }),
  );
  const small = ['--width', '96', '--height', '54', '--msaa', '1'];
  const cases = [
    ['be low/ball.obj', '--size', '7cm', '--from', '34', '--studio', 'rim', '--background', '#203040', '--ground', ...small],
    ['be low/ball.obj', '--unit', '2mm', '--normals', 'flat', '--material', 'marble', '--up', 'z', '--threads', '1', ...small],
    ['be low/file.json', '--studio', 'back', '--from', '20,30'],
  ];
  const settings = await page.evaluate(async () => (await import('./state.js')).base.settings);
  need(settings.width === '160', settings);
  for (const [i, options] of cases.entries()) {
    const viewer = await start(...options);
    const other = await open(1440, 'light', viewer.line, { permissions: ['clipboard-read', 'clipboard-write'] });
    const compare = async (when) => {
      const command = await copied(other);
      need(differ(await decoded(page, await save(other, 'png')), await decoded(page, run(command))) === 0, when, command);
    };
    await compare('as it begins');
    if (i === 2) {
      // what the file sets is taken back
      await other.click('#knobs-reset');
      await tab(other, 'image');
      for (const name of ['msaa', 'bloom', 'stops']) if (name in last(other).settings) await other.click(`[data-knob="${name}"] .reset`);
      await finished(other);
      await compare('with the defaults');
    }
    await tab(other, 'material');
    await other.fill('#material-search', 'ketch');
    await other.click('.swatch:visible');
    await finished(other);
    await compare('with another material');
    await other.locator('#stage').focus();
    await other.keyboard.press('2');
    await finished(other);
    writeFileSync(`be low/${options[0].includes('file') ? 'file' : 'ball'}-view.json`, await save(other, 'scene'));
    await compare('from another side');
    await other.context().close();
    viewer.end();
  }
});

test('without a clipboard the command line is selected in a field', async () => {
  const other = await open(400, 'light', address, {}, () => Object.defineProperty(navigator, 'clipboard', { value: undefined }));
  await other.click('#save summary');
  await other.click('#copy-command');
  await other.waitForSelector('.message input');
  const [text, chosen] = await other.evaluate(() => {
    const { value, selectionStart, selectionEnd } = document.activeElement;
    return [document.querySelector('.message input').value, value.slice(selectionStart, selectionEnd)];
  });
  need(text.startsWith('pellucid render ball.obj') && chosen === text, text, chosen);
  need(await other.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'wider than the window');
  await other.context().close();
});

test('the power of a light keeps its new colour, and black is no dead end', async () => {
  const other = await open();
  await tab(other, 'light');
  const choose = (id, value) =>
    other.evaluate(
      ([at, to]) => {
        const input = document.getElementById(at);
        input.value = to;
        for (const type of ['input', 'change']) input.dispatchEvent(new Event(type));
      },
      [id, value],
    );
  const radiance = async () => (await finished(other), last(other).lights[0].radiance);
  await choose('light-color', '#ff0000');
  const red = await radiance();
  need(red[0] > 0 && red[1] === 0 && red[2] === 0, red);
  await choose('light-power--stops', '1000');
  const more = await radiance();
  need(Math.abs(more[0] / red[0] - 64) < 1e-3 && more[1] === 0 && more[2] === 0, more, red);
  await choose('light-color', '#000000');
  need((await radiance()).every((x) => x === 0), 'black');
  await choose('light-color', '#0000ff');
  const blue = await radiance();
  need(Math.abs(blue[2] / more[0] - 1) < 1e-3 && blue[0] === 0, blue);
  await other.context().close();
});

test('a link that is pasted into an open page shows its view there', async () => {
  const other = await open();
  const plain = await look(other);
  await other.locator('#stage').focus();
  await other.keyboard.press('3');
  await finished(other);
  await other.waitForTimeout(500);
  const turned = await look(other);
  const link = other.url();
  const third = await open();
  const paste = async (url) => {
    const before = third.sent.length;
    await third.evaluate((to) => {
      location.href = to;
    }, url);
    for (let i = 0; i < 500 && third.sent.length === before; i++) await third.waitForTimeout(20);
    await finished(third);
  };
  await paste(link);
  need(differ(turned, await look(third)) === 0, 'the view of the link is not shown');
  await third.click('#undo');
  await finished(third);
  need(differ(plain, await look(third)) === 0, 'undo');
  await paste(`${address}#view=damaged!`);
  need((await complaints(third)).length === 0 && differ(plain, await look(third)) === 0, 'a damaged link changes the view');
  const wrong = [5, [], { camera: 5 }, { camera: { from: [0, 0, 9] } }, { lights: [{ type: 'point' }] }, { lights: {} }, { knobs: null }];
  wrong.push({ method: 7 }, { other: {} }, { materials: [1] }, { time: 'late' }, { wipe: null }, { settings: { width: {} } });
  for (const view of wrong) {
    const before = faults.length;
    const fourth = await open(1440, 'light', `${address}#view=${Buffer.from(JSON.stringify(view)).toString('base64url')}`);
    need(faults.length === before && differ(plain, await look(fourth)) === 0, view, faults);
    await fourth.context().close();
  }
  await third.context().close();
  await other.context().close();
});

test('a turntable is an animated PNG; what is changed meanwhile ends it', async () => {
  await page.click('#save summary');
  await page.click('#save-film');
  await page.waitForTimeout(300);
  await page.locator('#stage').focus();
  await page.keyboard.press('1');
  await page.waitForSelector('.message.warning', { timeout: PATIENCE });
  await finished(page);
  const waiting = page.waitForEvent('download', { timeout: 2 * PATIENCE });
  await page.click('#save summary');
  await page.click('#save-film');
  const file = readFileSync(await (await waiting).path());
  const types = [];
  for (let at = 8; at < file.length; at += file.readUInt32BE(at) + 12) types.push(file.toString('latin1', at + 4, at + 8));
  need(types[0] === 'IHDR' && types.at(-1) === 'IEND' && types.indexOf('acTL') < types.indexOf('IDAT'), types);
  need(types.filter((t) => t === 'fcTL').length === 36 && types.filter((t) => t === 'fdAT').length >= 35, types);
  const first = file.indexOf('acTL');
  need(file.readUInt32BE(first + 4) === 36, 'frames');
  await finished(page);
  need(last(page).camera && (await page.locator('#status-size').textContent()) === '160 × 90', 'the view is not back');
});

test('two pages at once; a connection that is cut comes back', async () => {
  const other = await open(1440, 'dark');
  const mine = await look(page);
  await other.locator('#stage').focus();
  await other.keyboard.press('2');
  await finished(other);
  need(differ(mine, await look(page)) === 0, 'one page turns the other');
  other.cuts.at(-1)();
  await other.waitForSelector('#veil:not([hidden])', { timeout: PATIENCE });
  await other.waitForSelector('#veil', { state: 'hidden', timeout: PATIENCE });
  await finished(other);
  need(last(other).camera, 'the view is lost');
  await other.context().close();
});

test('keys, help and tabs work without a mouse', async () => {
  await page.locator('#stage').focus();
  await page.keyboard.press('?');
  need(await page.locator('#help').isVisible(), 'no help');
  await page.keyboard.press('Escape');
  await page.locator('#tab-compare').focus();
  await page.keyboard.press('ArrowRight');
  need(await page.locator('#panel-image').isVisible(), 'the tab did not change');
  need((await page.evaluate(() => document.activeElement.id)) === 'tab-image', 'the focus');
});

for (const [width, scheme] of [
  [1440, 'light'],
  [1440, 'dark'],
  [400, 'light'],
  [400, 'dark'],
])
  test(`${width} px, ${scheme}: nothing is cut off, and axe finds nothing serious`, async () => {
    const other = await open(width, scheme);
    need(await other.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'wider than the window');
    await other.evaluate(axe);
    for (const name of ['method', 'material', 'light', 'compare', 'image']) {
      await tab(other, name);
      const found = await other.evaluate(() => window.axe.run(document, { resultTypes: ['violations'] }));
      const serious = found.violations.filter((v) => ['serious', 'critical'].includes(v.impact));
      need(serious.length === 0, name, serious.map((v) => [v.id, v.nodes.slice(0, 3).map((n) => n.html)]));
      if (shots) await other.screenshot({ path: `${shots}/${width}-${scheme}-${name}.png` });
    }
    await other.context().close();
  });

test('the console is silent', async () => {
  need(faults.length === 0, faults);
});

console.log(`1..${tests.length}`);
let failed = 0;
for (const [i, [title, body]] of tests.entries()) {
  try {
    await body();
    console.log(`ok ${i + 1} - ${title}`);
  } catch (fault) {
    failed++;
    console.log(`not ok ${i + 1} - ${title}\n# ${String(fault.stack).replaceAll('\n', '\n# ')}`);
  }
}
await browser.close();
process.exit(failed ? 1 : 0);
