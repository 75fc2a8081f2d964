// SPDX-License-Identifier: MIT
// The image viewer: what is shown, how it is drawn and moved.

// --- Display --------------------------------------------------------------------------------------------------------------------

const MODES = [
  ['wipe', 'Wipe'],
  ['sides', 'Side by side'],
  ['signed', 'Signed error'],
  ['flip', 'FLIP'],
];
const RANGES = { signed: [0.02, 0.05, 0.1, 0.25, 0.5, 1, 2], flip: [0.05, 0.1, 0.25, 0.5, 1] };
const LEVELS = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32];
const state = {
  mode: 'wipe',
  view: 0,
  left: pictures.indexOf(methods[0]),
  right: pictures.indexOf(reference),
  stops: 0,
  wipe: 0.5,
  scale: 0,
  x: WIDTH / 2,
  y: HEIGHT / 2,
  hover: null,
  range: { signed: null, flip: null },
};
const stage = by('stage'),
  canvas = by('canvas'),
  context = canvas.getContext('2d');
const shown = [null, null].map(() => ({ canvas: document.createElement('canvas'), key: '', planes: null }));
const error = { canvas: document.createElement('canvas'), key: '', values: null, mask: null };
const isMap = () => state.mode === 'signed' || state.mode === 'flip';
// FLIP is measured against a reference: if the right image is none, against the first reference.
const against = () => (state.mode === 'flip' && pictures[state.right].role === 'method' ? reference : pictures[state.right]);
const flipOf = (p, r) =>
  p.flip && (data.kind === 'scene' ? p.flip[r.name] && p.flip[r.name][views[state.view].id] : p.flip[views[state.view].id]);

function image(target, fill) {
  target.width = WIDTH;
  target.height = HEIGHT;
  const c = target.getContext('2d'),
    pixels = c.createImageData(WIDTH, HEIGHT);
  fill(pixels.data);
  c.putImageData(pixels, 0, 0);
}

// The smallest range that contains 99 of 100 pixels.
function choose(values, mask, ranges) {
  const found = [];
  const step = Math.max(1, Math.floor(values.length / 40000));
  for (let i = 0; i < values.length; i += step) if (!mask || mask[i] > 127) found.push(Math.abs(values[i]));
  found.sort((a, b) => a - b);
  const most = found.length ? found[Math.floor(0.99 * (found.length - 1))] : 0;
  return ranges.find((r) => r >= most) || ranges[ranges.length - 1];
}

async function prepareMap(view, planes) {
  const mode = state.mode,
    b = against(),
    left = pictures[state.left],
    id = mode === 'flip' ? flipOf(left, b) : null;
  const compared = [mode, state.view, state.left, pictures.indexOf(b)].join();
  if (error.compared !== compared) {
    error.mask = view.mask ? await map(view.mask) : null;
    error.values = new Float32Array(WIDTH * HEIGHT);
    if (mode === 'signed') for (let i = 0; i < error.values.length; i++) error.values[i] = relative(view, planes[0], planes[1], i);
    else if (id)
      (await map(id)).forEach((v, i) => {
        error.values[i] = v / 255;
      });
    error.compared = compared;
    error.auto = choose(error.values, error.mask, RANGES[mode]);
  }
  const range = state.range[mode] || error.auto,
    key = compared + range;
  if (error.key !== key) {
    image(error.canvas, (out) =>
      mode === 'signed'
        ? paintMap(error.values, ramps.signed, 0.5 / range, 0.5, error.mask, out)
        : paintMap(error.values, ramps.flip, 1 / range, 0, error.mask, out),
    );
    error.key = key;
  }
  error.range = range;
}

// Computes everything that is missing, then draws; requests made meanwhile are handled next.
let busy = false,
  again = false;
async function refresh() {
  if (busy) {
    again = true;
    return;
  }
  busy = true;
  do {
    again = false;
    const view = views[state.view],
      sides = [state.left, state.mode === 'flip' ? pictures.indexOf(against()) : state.right];
    const planes = await Promise.all(sides.map((k) => light(pictures[k].data[view.id])));
    if (isMap()) await prepareMap(view, planes);
    for (let k = 0; k < 2; k++) {
      const key = [sides[k], state.view, state.stops].join();
      shown[k].planes = planes[k];
      if (!isMap() && shown[k].key !== key) {
        image(shown[k].canvas, (out) => paint(view, planes[k], state.stops, out));
        shown[k].key = key;
      }
    }
  } while (again);
  busy = false;
  by('busy').hidden = true;
  stage.dataset.ready = [state.mode, state.view, state.left, state.right, state.stops, error.range].join();
  describe();
  draw();
}

// --- Drawing: one canvas, one scale and one centre for all panes -----------------------------------------------------------------

const ratio = () => window.devicePixelRatio || 1;

function panes() {
  const w = canvas.width,
    h = canvas.height,
    gap = 2 * ratio();
  if (state.mode !== 'sides') return [{ x: 0, y: 0, w, h }];
  return w >= h * 0.9
    ? [
        { x: 0, y: 0, w: (w - gap) / 2, h },
        { x: (w + gap) / 2, y: 0, w: (w - gap) / 2, h },
      ]
    : [
        { x: 0, y: 0, w, h: (h - gap) / 2 },
        { x: 0, y: (h + gap) / 2, w, h: (h - gap) / 2 },
      ];
}

const fitScale = () => Math.min(panes()[0].w / WIDTH, panes()[0].h / HEIGHT);
const scaleOf = () => state.scale || fitScale();

// Position of the image's corner on the canvas: whole pixels, so that a scale of one is exact.
function corner(pane) {
  const s = scaleOf();
  return [Math.round(pane.x + pane.w / 2 - state.x * s), Math.round(pane.y + pane.h / 2 - state.y * s)];
}

function drawPane(pane, source, clip) {
  const s = scaleOf(),
    [x, y] = corner(pane);
  context.save();
  context.beginPath();
  context.rect(clip.x, clip.y, clip.w, clip.h);
  context.clip();
  context.imageSmoothingEnabled = s < 2 && s % 1 !== 0;
  context.imageSmoothingQuality = 'high';
  context.drawImage(source, x, y, WIDTH * s, HEIGHT * s);
  context.restore();
}

function draw() {
  const all = panes(),
    w = canvas.width,
    h = canvas.height,
    line = Math.max(1, Math.round(1.5 * ratio())),
    cut = Math.round(state.wipe * w);
  context.fillStyle = '#1c1c1c';
  context.fillRect(0, 0, w, h);
  if (isMap()) {
    drawPane(all[0], error.canvas, all[0]);
  } else if (state.mode === 'sides') {
    all.forEach((pane, k) => drawPane(pane, shown[k].canvas, pane));
  } else {
    drawPane(all[0], shown[0].canvas, { x: 0, y: 0, w: cut, h });
    drawPane(all[0], shown[1].canvas, { x: cut, y: 0, w: w - cut, h });
    context.fillStyle = '#000000a0';
    context.fillRect(cut - line, 0, 2 * line, h);
    context.fillStyle = '#ffffff';
    context.fillRect(cut - line / 2, 0, line, h);
    context.beginPath();
    context.arc(cut, h / 2, 7 * ratio(), 0, 2 * Math.PI);
    context.fill();
    context.lineWidth = line;
    context.strokeStyle = '#000000a0';
    context.stroke();
  }
  if (state.hover && state.hover.keys) crosshair(all);
  by('zoom').textContent = percent(scaleOf() / size.factor).replace('.0 ', ' ');
  readout();
}

function crosshair(all) {
  const s = scaleOf(),
    r = 9 * ratio();
  for (const pane of all) {
    const [x, y] = corner(pane),
      cx = x + (state.hover.x + 0.5) * s,
      cy = y + (state.hover.y + 0.5) * s;
    for (const [color, width] of [
      ['#000', 3],
      ['#fff', 1],
    ]) {
      context.strokeStyle = color;
      context.lineWidth = width * ratio();
      context.beginPath();
      context.moveTo(cx - r, cy);
      context.lineTo(cx + r, cy);
      context.moveTo(cx, cy - r);
      context.lineTo(cx, cy + r);
      context.stroke();
    }
  }
}

function readout() {
  const p = state.hover,
    view = views[state.view],
    planes = shown.map((s) => s.planes);
  if (!p || !planes[0] || !planes[1]) {
    by('readout').textContent = 'Point at a pixel to read its values.\n ';
    return;
  }
  const i = p.y * WIDTH + p.x,
    rgb = (k) => planes[k].map((c) => number(floats[c[i]]).padStart(8)).join(' ');
  const names = [pictures[state.left].name, (state.mode === 'flip' ? against() : pictures[state.right]).name];
  const widest = Math.min(24, Math.max(...names.map((n) => n.length)));
  const lines = names.map((n, k) => `${n.slice(0, 24).padEnd(widest)} ${rgb(k)}`);
  const at = `x ${p.x * size.factor} y ${p.y * size.factor}`;
  lines.push(
    `${at}   left ${percent(relative(view, planes[0], planes[1], i), true)} of right` +
      (state.mode === 'flip' ? `   FLIP ${number(error.values[i])}` : ''),
  );
  by('readout').textContent = lines.join('\n');
}

function resize() {
  const width = stage.clientWidth,
    sides = state.mode === 'sides',
    stacked = sides && width < 560;
  const wanted = ((width * HEIGHT) / WIDTH) * (stacked ? 2 : sides ? 0.75 : 1);
  const height = Math.round(Math.max(220, Math.min(wanted, window.innerHeight * (stacked ? 1 : 0.74), 900)));
  stage.style.height = `${height}px`;
  stage.classList.toggle('stacked', stacked);
  canvas.width = Math.round(width * ratio());
  canvas.height = Math.round(height * ratio());
  draw();
}

// --- Moving ---------------------------------------------------------------------------------------------------------------------

function bound() {
  state.x = Math.max(0, Math.min(WIDTH, state.x));
  state.y = Math.max(0, Math.min(HEIGHT, state.y));
}

// The next zoom level up or down; the point `at` (canvas pixels) stays fixed.
function zoom(direction, at) {
  const fit = fitScale(),
    now = scaleOf();
  const levels = [
    ...new Set([fit, ...[fit / 4, fit / 2].filter((v) => v < 1), ...[0.25, 0.5, 0.75].filter((v) => v > fit * 1.1), ...LEVELS]),
  ].sort((a, b) => a - b);
  const next = direction > 0 ? levels.find((v) => v > now * 1.001) : levels.findLast((v) => v < now * 0.999);
  if (next) zoomTo(next, at);
}

function zoomTo(scale, at) {
  const pane = at ? paneAt(at) : panes()[0],
    before = scaleOf();
  const dx = at ? at[0] - pane.x - pane.w / 2 : 0,
    dy = at ? at[1] - pane.y - pane.h / 2 : 0;
  state.x += dx / before - dx / scale;
  state.y += dy / before - dy / scale;
  state.scale = scale;
  bound();
  follow();
}

function fit() {
  Object.assign(state, { scale: 0, x: WIDTH / 2, y: HEIGHT / 2 });
  follow();
}

const canvasPoint = (event) => {
  const box = canvas.getBoundingClientRect();
  return [((event.clientX - box.left) * canvas.width) / box.width, ((event.clientY - box.top) * canvas.height) / box.height];
};
const paneAt = (at) => panes().find((p) => at[0] >= p.x && at[0] < p.x + p.w && at[1] >= p.y && at[1] < p.y + p.h) || panes()[0];

function pixelAt(at) {
  const [x, y] = corner(paneAt(at)),
    s = scaleOf(),
    p = { x: Math.floor((at[0] - x) / s), y: Math.floor((at[1] - y) / s) };
  return p.x >= 0 && p.y >= 0 && p.x < WIDTH && p.y < HEIGHT ? p : null;
}

// With the keyboard, the pixel in the middle is read.
function follow() {
  if (state.hover && state.hover.keys)
    state.hover = { x: Math.min(WIDTH - 1, Math.floor(state.x)), y: Math.min(HEIGHT - 1, Math.floor(state.y)), keys: true };
  draw();
}

function setWipe(v) {
  state.wipe = Math.max(0, Math.min(1, v));
  by('wipe').value = Math.round(1000 * state.wipe);
  by('wipe').setAttribute('aria-valuetext', `${Math.round(100 * state.wipe)} % of ${pictures[state.left].name}`);
  draw();
}

const nearLine = (at) => state.mode === 'wipe' && Math.abs(at[0] - state.wipe * canvas.width) < 14 * ratio();
const pointers = new Map();
let drag = null,
  pinch = 0;

stage.addEventListener('pointerdown', (event) => {
  const at = canvasPoint(event);
  pointers.set(event.pointerId, at);
  stage.setPointerCapture(event.pointerId);
  pinch = 0;
  drag = { at, wipe: nearLine(at) };
});
stage.addEventListener('pointermove', (event) => {
  const at = canvasPoint(event),
    s = scaleOf();
  if (pointers.has(event.pointerId)) pointers.set(event.pointerId, at);
  state.hover = pixelAt(at);
  stage.classList.toggle('edge', nearLine(at) || Boolean(drag && drag.wipe));
  if (pointers.size === 2) {
    const [a, b] = [...pointers.values()],
      apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
    if (pinch && (apart > pinch * 1.2 || apart < pinch / 1.2)) {
      zoom(apart - pinch, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
      pinch = apart;
    }
    pinch = pinch || apart;
    return;
  }
  if (drag && drag.wipe) {
    setWipe(at[0] / canvas.width);
  } else if (drag) {
    state.x -= (at[0] - drag.at[0]) / s;
    state.y -= (at[1] - drag.at[1]) / s;
    drag.at = at;
    bound();
  }
  draw();
});
for (const kind of ['pointerup', 'pointercancel'])
  stage.addEventListener(kind, (event) => {
    pointers.delete(event.pointerId);
    drag = null;
  });
stage.addEventListener('pointerleave', () => {
  if (!drag) {
    state.hover = null;
    draw();
  }
});

let turned = 0;
stage.addEventListener(
  'wheel',
  (event) => {
    event.preventDefault();
    turned += event.deltaY * (event.deltaMode ? 30 : 1);
    if (Math.abs(turned) < 40) return;
    zoom(-turned, canvasPoint(event));
    turned = 0;
  },
  { passive: false },
);

stage.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const s = scaleOf(),
    step = (event.shiftKey ? 8 : 1) * Math.max(1, (40 * ratio()) / s);
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const keys = {
    '+': () => zoom(1),
    '=': () => zoom(1),
    '-': () => zoom(-1),
    0: fit,
    1: () => zoomTo(1),
    '[': () => setWipe(state.wipe - 0.02),
    ']': () => setWipe(state.wipe + 0.02),
  };
  if (!moves[event.key] && !keys[event.key]) return;
  event.preventDefault();
  state.hover = state.hover || {};
  state.hover.keys = true;
  if (moves[event.key]) {
    state.x = Math.round(state.x + moves[event.key][0] * step);
    state.y = Math.round(state.y + moves[event.key][1] * step);
    bound();
  } else {
    keys[event.key]();
  }
  follow();
});
stage.addEventListener('blur', () => {
  if (state.hover && state.hover.keys) {
    state.hover = null;
    draw();
  }
});

// --- Controls -------------------------------------------------------------------------------------------------------------------

function radios(box, name, items, chosen, change) {
  items.forEach(([value, text], k) => {
    const input = make('input', { type: 'radio', name, value, id: `${name}-${k}`, onchange: () => change(value) });
    input.checked = k === chosen;
    box.append(make('label', { for: input.id }, input, text));
  });
}

function ranges() {
  const list = RANGES[state.mode];
  by('range-field').hidden = !list;
  if (!list) return;
  const show = (v) => (state.mode === 'signed' ? `±${trim(100 * v)} %` : trim(v));
  by('range').replaceChildren(
    make('option', { value: '', text: 'Automatic' }),
    ...list.map((v) => make('option', { value: v, text: show(v) })),
  );
  by('range').value = state.range[state.mode] || '';
}

// The text around the images.
function describe() {
  const view = views[state.view],
    left = pictures[state.left].name,
    right = against().name,
    mode = state.mode,
    range = error.range;
  const low = mode === 'signed' ? -range : 0;
  by('tag-left').textContent = mode === 'signed' ? `${left} − ${right}` : mode === 'flip' ? `FLIP of ${left} and ${right}` : left;
  by('tag-right').textContent = right;
  by('tag-right').hidden = isMap();
  by('wipe-field').hidden = mode !== 'wipe';
  by('exposure-field').hidden = isMap();
  by('bar').hidden = !isMap();
  by('right-name').textContent = isMap() ? 'Against' : 'Right';
  by('left-name').textContent = isMap() ? 'Error of' : 'Left';
  by('stops').textContent = `${state.stops > 0 ? '+' : ''}${sign(String(state.stops))} stops`;
  by('shown').textContent =
    `${view.text} ` +
    (data.display
      ? 'Values are display values.'
      : `Displayed with exposure ${number(view.exposure)} and the tone curve ${view.tonemap}` +
        `${view.tonemap === 'reinhard' ? ` with white at ${number(view.white)}` : ''}: ` +
        `the exposure of ${reference.name}, for all images.`) +
    (size.factor > 1
      ? ` Images are reduced here to 1/${size.factor} of ${size.width} × ${size.height}; metrics are of the full size.`
      : '');
  if (isMap()) {
    const show = (v) => (mode === 'signed' ? `${v > 0 ? '+' : ''}${trim(100 * v)} %` : trim(v));
    by('ticks').replaceChildren(...[0, 1, 2, 3, 4].map((k) => make('span', { text: show(low + ((range - low) * k) / 4) })));
    by('bar-text').textContent =
      mode === 'signed'
        ? `Luminance of ${left}, relative to ${right}: blue is too dark, red too bright, grey equal. ` +
          'Values beyond the ends have their colour.'
        : `The perceived difference when ${left} and ${right} alternate on a screen: 0 is equal, 1 the largest.` +
          (flipOf(pictures[state.left], against()) ? '' : ' The two are one image, or were not compared with each other.');
    image256(ramps[mode]);
  }
  stage.setAttribute('aria-label', isMap() ? by('tag-left').textContent : `${left} on the left, ${right} on the right`);
}

function image256(ramp) {
  const c = by('gradient').getContext('2d'),
    pixels = c.createImageData(256, 1);
  for (let i = 0; i < 256; i++) pixels.data.set([ramp[3 * i], ramp[3 * i + 1], ramp[3 * i + 2], 255], 4 * i);
  c.putImageData(pixels, 0, 0);
}

function controls() {
  radios(by('modes'), 'mode', MODES, 0, (v) => {
    state.mode = v;
    ranges();
    resize();
    refresh();
  });
  radios(
    by('views'),
    'view',
    views.map((v, k) => [k, v.title]),
    0,
    (k) => {
      state.view = k;
      table();
      summary();
      refresh();
    },
  );
  by('views').hidden = views.length < 2;
  for (const side of ['left', 'right']) {
    by(side).append(
      ...pictures.map((p, k) => make('option', { value: k, text: p.name + (p.role === 'method' ? '' : ' (reference)') })),
    );
    by(side).value = state[side];
    by(side).addEventListener('change', () => {
      state[side] = Number(by(side).value);
      setWipe(state.wipe);
      refresh();
    });
  }
  by('swap').addEventListener('click', () => {
    [state.left, state.right] = [state.right, state.left];
    by('left').value = state.left;
    by('right').value = state.right;
    setWipe(state.wipe);
    refresh();
  });
  by('exposure').addEventListener('input', () => {
    state.stops = Number(by('exposure').value);
    describe();
    refresh();
  });
  by('exposure').addEventListener('dblclick', () => {
    by('exposure').value = state.stops = 0;
    refresh();
  });
  by('range').addEventListener('change', () => {
    state.range[state.mode] = Number(by('range').value) || null;
    refresh();
  });
  by('wipe').addEventListener('input', () => setWipe(Number(by('wipe').value) / 1000));
  by('zoom-in').addEventListener('click', () => zoom(1));
  by('zoom-out').addEventListener('click', () => zoom(-1));
  by('zoom-fit').addEventListener('click', fit);
  by('zoom-one').addEventListener('click', () => zoomTo(1));
}
