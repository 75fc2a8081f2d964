// SPDX-License-Identifier: MIT
// Data of the page: numbers as text, images as half floats, and the tone curve for display.
'use strict';

// The data that report.c wrote: names are arbitrary texts and go into the page as text only.
const data = JSON.parse(document.getElementById('data').textContent);
const by = (id) => document.getElementById(id);
const pictures = data.pictures,
  views = data.views,
  size = data.size;
const WIDTH = size.across,
  HEIGHT = size.down;
const references = pictures.filter((p) => p.role !== 'method'),
  methods = pictures.filter((p) => p.role === 'method');
const reference = references[0],
  truth = references[1];

function make(tag, attributes = {}, ...children) {
  const e = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === 'text') e.textContent = value;
    else if (name.startsWith('on')) e.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null && value !== undefined) e.setAttribute(name, value === true ? '' : value);
  }
  e.append(...children.filter((c) => c !== null && c !== undefined));
  return e;
}

// --- Number formatting ----------------------------------------------------------------------------------------------------------

const MINUS = '−';
const finite = (v) => typeof v === 'number' && Number.isFinite(v);
const sign = (text) => text.replace('-', MINUS);

function number(v, digits = 3) {
  if (!finite(v)) return '–';
  if (v === 0) return '0';
  const a = Math.abs(v);
  if (a >= 1e5 || a < 1e-4) return sign(v.toExponential(digits - 1).replace('e+', 'e'));
  return sign(a >= 10 ** digits ? v.toFixed(0) : v.toPrecision(digits));
}

function percent(v, signed = false) {
  if (!finite(v)) return '–';
  const p = 100 * v,
    a = Math.abs(p),
    text = sign(p.toFixed(a < 0.995 ? 2 : a < 99.5 ? 1 : 0));
  return (signed && p > 0 ? '+' : '') + text + ' %';
}

function seconds(s) {
  if (!finite(s)) return '–';
  if (s < 0.9995) return `${number(1000 * s)} ms`;
  return s < 100 ? `${number(s)} s` : s < 5400 ? `${number(s / 60)} min` : `${number(s / 3600)} h`;
}

const trim = (v) => sign(String(Number(v.toPrecision(3))));
const count = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, ' ');

// --- Pictures: from the page to light -------------------------------------------------------------------------------------------

const floats = new Float32Array(65536); // value of each half float
for (let i = 0; i < 65536; i++) {
  const e = (i >> 10) & 31,
    m = i & 1023;
  floats[i] = (i & 32768 ? -1 : 1) * (e === 0 ? m * 2 ** -24 : (1 + m / 1024) * 2 ** (e - 15));
}

const STEPS = 16384,
  srgb = new Uint8ClampedArray(STEPS + 1); // of light in [0, 1]
for (let i = 0; i <= STEPS; i++) {
  const x = i / STEPS;
  srgb[i] = Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
}

async function bytes(id) {
  const text = atob(by(id).textContent),
    packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const unpacked = new Map();
function once(id, unpack) {
  if (!unpacked.has(id)) unpacked.set(id, bytes(id).then(unpack));
  return unpacked.get(id);
}

// Undoes the row differences; the first pixel of a row is relative to the row above.
function undo(out, step) {
  for (let y = 0, at = 0; y < HEIGHT; y++) {
    let last = y ? out[at - WIDTH] : 0;
    for (let x = 0; x < WIDTH; x++, at++) out[at] = last = step(at) + last;
  }
  return out;
}

const light = (id) =>
  once(id, (raw) =>
    [0, 1, 2].map((c) => {
      const pixels = WIDTH * HEIGHT,
        high = 2 * c * pixels,
        low = high + pixels;
      return undo(new Uint16Array(pixels), (i) => (raw[high + i] << 8) | raw[low + i]);
    }),
  );
const map = (id) => once(id, (raw) => undo(new Uint8Array(WIDTH * HEIGHT), (i) => raw[i]));

const luminance = (p, i) => 0.2126 * floats[p[0][i]] + 0.7152 * floats[p[1][i]] + 0.0722 * floats[p[2][i]];

// Applies exposure and the tone curve that FLIP was measured with: see pell_compare.
function paint(view, planes, stops, out) {
  const e = view.exposure * 2 ** stops,
    ws = 1 / (view.white * view.white),
    [r, g, b] = planes,
    last = STEPS;
  const aces = (v) => {
    const x = v > 0 ? Math.min(v, 1e6) : 0;
    return (x * (0.36 * 2.51 * x + 0.018)) / (x * (0.36 * 2.43 * x + 0.354) + 0.14);
  };
  // The filmic curve of render (tone.h).
  const filmic = (v) => {
    const q = v < 1e6 ? v : 1e6;
    return (q * (q + 0.0245786) - 0.000090537) / (q * (0.983729 * q + 0.432951) + 0.238081);
  };
  const shade = (v) => srgb[v >= 1 ? last : v > 0 ? (v * last + 0.5) | 0 : 0];
  for (let i = 0, at = 0; i < r.length; i++, at += 4) {
    const x = floats[r[i]],
      y = floats[g[i]],
      z = floats[b[i]];
    if (view.tonemap === 'aces') {
      out[at] = shade(aces(e * x));
      out[at + 1] = shade(aces(e * y));
      out[at + 2] = shade(aces(e * z));
    } else if (view.tonemap === 'filmic') {
      const [p, q, s] = [x, y, z].map((v) => Math.max(0, 1.46193 * e * v));
      const u = filmic(0.59719 * p + 0.35458 * q + 0.04823 * s),
        v = filmic(0.076 * p + 0.90834 * q + 0.01566 * s),
        w = filmic(0.0284 * p + 0.13383 * q + 0.83777 * s);
      out[at] = shade(1.60475 * u - 0.53108 * v - 0.07367 * w);
      out[at + 1] = shade(-0.10208 * u + 1.10813 * v - 0.00605 * w);
      out[at + 2] = shade(-0.00327 * u - 0.07276 * v + 1.07602 * w);
    } else {
      const l = Math.max(0, e * (0.2126 * x + 0.7152 * y + 0.0722 * z));
      const k = view.tonemap === 'linear' ? e : (e * (1 + l * ws)) / (1 + l);
      out[at] = shade(k * x);
      out[at + 1] = shade(k * y);
      out[at + 2] = shade(k * z);
    }
    out[at + 3] = 255;
  }
}

function colors(text) {
  return Uint8Array.from({ length: 768 }, (_, i) => parseInt(text.slice(2 * i, 2 * i + 2), 16));
}
const ramps = { signed: colors(data.colors.signed), flip: colors(data.colors.flip) };

// Pixels outside the mask stay as dark as the background.
function paintMap(values, ramp, scale, shift, mask, out) {
  for (let i = 0, at = 0; i < values.length; i++, at += 4) {
    const on = !mask || mask[i] > 127,
      k = 3 * Math.max(0, Math.min(255, Math.round(255 * (values[i] * scale + shift))));
    out[at] = ramp[k];
    out[at + 1] = ramp[k + 1];
    out[at + 2] = ramp[k + 2];
    out[at + 3] = on ? 255 : 0;
  }
}

const relative = (view, a, b, i) => {
  const y = luminance(b, i);
  return (luminance(a, i) - y) / (Math.abs(y) + view.floor || 1);
};
