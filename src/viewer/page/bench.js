// SPDX-License-Identifier: MIT
// bench.js - the profile bench: R(r) and T of the edited medium, its fit, what they look like, and the same as code.
import * as connection from './connection.js';
import { download, el } from './knobs.js';
import { crossSection, encode } from './layers.js';
import { plot } from './plot.js';

const LANGUAGES = [
    ['c', 'C', 'h'],
    ['glsl', 'GLSL', 'glsl'],
    ['hlsl', 'HLSL', 'hlsl'],
    ['json', 'JSON', 'json'],
];

let box = null;
let medium = null; // returns the coefficients, or null if there are none
let skin = null; // returns the composition of skin, or null
let profile = null; // the last answer
let model = 'dipole';
let gaussians = 4;
let asking = 0;

const short = (list) => list.map((x) => (x === null ? '–' : Number(x.toPrecision(3)))).join(', ');

const question = () => {
    const given = medium();
    const composition = skin();
    if (given) return { medium: { sigma_a: given.sigma_a, sigma_s_reduced: given.sigma_s_reduced, eta: given.eta }, gaussians };
    return composition ? { material: { skin: composition } } : null;
};

export function ask() {
    if (!box?.isConnected || !box.closest('details')?.open) return;
    clearTimeout(asking);
    asking = setTimeout(() => {
        const what = question();
        if (what) connection.ask({ type: 'profile', ...what });
    }, 80);
}

// --- Appearance ----------------------------------------------------------------------------------------------------------------

// Abramowitz and Stegun 7.1.26: error below 1.5e-7.
function erf(x) {
    const t = 1 / (1 + 0.3275911 * Math.abs(x));
    const y = 1 - ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t * Math.exp(-x * x);
    return x < 0 ? -y : y;
}

// Light of the fitted Gaussians at x mm from the edge of a half-lit plane, and at r mm from a beam; per channel.
const edge = (fit, c, x) =>
    fit.weight[c].reduce((sum, w, i) => sum + (w / 2) * (1 + erf(x / Math.sqrt(2 * fit.variance_mm2[c][i]))), 0);
const beam = (fit, c, r) =>
    fit.weight[c].reduce(
        (sum, w, i) => sum + (w / (2 * Math.PI * fit.variance_mm2[c][i])) * Math.exp((-r * r) / (2 * fit.variance_mm2[c][i])),
        0,
    );

function paint(width, height, title, color) {
    const image = new ImageData(width, height);
    for (let y = 0; y < height; y++)
        for (let x = 0; x < width; x++) {
            for (let c = 0; c < 3; c++) image.data[4 * (y * width + x) + c] = encode(color(x + 0.5, y + 0.5, c));
            image.data[4 * (y * width + x) + 3] = 255;
        }
    const canvas = el('canvas', { width, height, role: 'img', 'aria-label': title });
    canvas.getContext('2d').putImageData(image, 0, 0);
    return canvas;
}

// Half of a plane illuminated, and a beam of light on it, over the same length.
function looks(fit, across) {
    const w = 208,
        h = 72;
    const bright = Math.max(...[0, 1, 2].map((c) => beam(fit, c, across / 12)), 1e-9);
    const mm = (x, size) => (x / size - 0.5) * across;
    return el(
        'figure',
        { className: 'looks' },
        paint(w, h, 'A plane whose right half is illuminated', (x, _, c) => edge(fit, c, mm(x, w))),
        paint(h, h, 'A thin beam of light on the plane', (x, y, c) => beam(fit, c, Math.hypot(mm(x, h), mm(y, h))) / bright),
        el('figcaption', {}, `A half-lit plane and a laser dot, ${Number(across.toPrecision(2))} mm across`),
    );
}

// --- The panel -----------------------------------------------------------------------------------------------------------------

function exporting() {
    const what = question();
    return what?.medium
        ? el(
              'div',
              { className: 'group', id: 'profile-export' },
              ...LANGUAGES.map(([id, title]) => {
                  const onclick = () => connection.ask({ type: 'profile', ...question(), export: id });
                  return el('button', { type: 'button', 'data-language': id, onclick }, title);
              }),
              el(
                  'button',
                  {
                      type: 'button',
                      id: 'profile-save',
                      onclick: () => {
                          const text = `${JSON.stringify(question().medium, null, 2)}\n`;
                          download(new Blob([text], { type: 'application/json' }), 'material.json');
                      },
                  },
                  'material.json',
              ),
          )
        : '';
}

// `of`: functions that return the coefficients, and the composition of skin.
export function panel(of) {
    ({ medium, skin } = of);
    const models = el('select', { id: 'profile-model' });
    models.addEventListener('change', () => {
        model = models.value;
        draw();
    });
    const count = el(
        'select',
        { id: 'profile-gaussians' },
        ...Array.from({ length: 10 }, (_, i) => el('option', { value: String(i + 1) }, String(i + 1))),
    );
    count.value = String(gaussians);
    count.addEventListener('change', () => {
        gaussians = Number(count.value);
        ask();
    });
    const fitted = medium()
        ? el('div', { className: 'field' }, el('label', { htmlFor: 'profile-gaussians' }, 'Gaussians of the fit (dashed)'), count)
        : '';
    box = el(
        'div',
        { id: 'profile-bench' },
        el('h3', {}, 'Profile R(r)'),
        el('div', { id: 'profile-layers' }),
        el('div', { className: 'field' }, el('label', { htmlFor: 'profile-model' }, 'Model'), models),
        el('div', { id: 'profile-plot' }),
        fitted,
        el('div', { id: 'profile-looks' }),
        el('div', { id: 'profile-numbers' }),
        el('div', { id: 'profile-slab' }),
        exporting(),
    );
    return box;
}

export function draw() {
    const find = (id) => box?.querySelector(id);
    if (!profile || !find('#profile-model') || Boolean(profile.layers) !== !medium()) return;
    find('#profile-model').replaceChildren(...profile.models.map((m) => el('option', { value: m.name }, m.title)));
    const shown = profile.models.find((m) => m.name === model) ?? profile.models[0];
    if (!shown) return;
    find('#profile-model').value = shown.name;
    const { fit } = profile;
    const fitted = fit && shown === profile.models[0] ? fit.R : null; // the fit is for the dipole
    const row = (name, value) => el('tr', {}, el('td', {}, name), el('td', {}, value));
    find('#profile-plot').replaceChildren(plot(profile.r_mm, shown.R, { fit: fitted }) ?? '');
    find('#profile-layers').replaceChildren(profile.layers ? crossSection(profile.layers) : '');
    find('#profile-looks').replaceChildren(fit && fit.weight.every((w) => w.length) ? looks(fit, 0.6 * profile.r_mm.at(-1)) : '');
    find('#profile-numbers').replaceChildren(
        el(
            'table',
            {},
            el(
                'tbody',
                {},
                row('Reflectance', short(shown.total)),
                profile.mean_free_path ? row('Mean free path, mm', short(profile.mean_free_path)) : null,
                profile.diffuse_mean_free_path ? row('Diffuse mean free path, mm', short(profile.diffuse_mean_free_path)) : null,
                fit ? row('Error of the dipole’s fit, %', short(fit.error.map((e) => (e === null ? null : 100 * e)))) : null,
            ),
        ),
        el('p', { className: 'note' }, shown.limits),
    );
    const words = { x: 'thickness, mm', y: 'T of a slab', about: 'Fraction of the light that a slab transmits, over its thickness' };
    find('#profile-slab').replaceChildren(
        ...(profile.slab ? [el('h3', {}, 'Through a slab'), plot(profile.slab.thickness_mm, profile.slab.T, { words }) ?? ''] : []),
    );
}

export function set(given) {
    profile = given;
    draw();
}

export function saveCode(language, file) {
    const row = LANGUAGES.find(([id]) => id === language);
    if (row) download(file, `material.${row[2]}`);
}
