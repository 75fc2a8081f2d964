// SPDX-License-Identifier: MIT
// materials.js - the built-in materials as swatches, and editing of coefficients.
import * as bench from './bench.js';
import { el } from './knobs.js';
import { crossSection, encode, skinEditor } from './layers.js';
import { changed, state } from './state.js';

let all = [];
let facts = null;
let target = '*';
let box = null;

const colorOf = (m) => m.diffuse_reflectance ?? m.color;
// 1/mm: decay rate of light in the medium; for published Gaussians, from the widest.
function decay(m) {
    if (m.diffuse_mean_free_path) return m.diffuse_mean_free_path.map((d) => 1 / Math.max(d, 1e-4));
    const wide = Math.sqrt(Math.max(...(m.gaussians ?? []).map((g) => g.variance_mm2), 0.04));
    return [1 / wide, 1.6 / wide, 2.2 / wide];
}

// A sphere of 20 mm lit from the left, and next to it a backlit slab of 2 mm behind a slit.
function draw(canvas, m) {
    const w = (canvas.width = 84),
        h = (canvas.height = 48),
        image = new ImageData(w, h);
    const color = colorOf(m),
        sigma = decay(m),
        radius = 22;
    for (let y = 0; y < h; y++)
        for (let x = 0; x < w; x++) {
            const u = (x - 24 + 0.5) / radius,
                v = (y - 24 + 0.5) / radius,
                r2 = u * u + v * v,
                at = 4 * (y * w + x);
            if (r2 < 1) {
                const facing = -0.62 * u - 0.5 * v + 0.6 * Math.sqrt(1 - r2);
                for (let c = 0; c < 3; c++) {
                    const soft = Math.min(0.9, 2 / (sigma[c] * 10)),
                        lit = Math.max(0, (facing + soft) / (1 + soft)) ** (1 + soft);
                    const through = 0.75 * Math.exp(-sigma[c] * 20 * Math.sqrt(1 - r2)) * (1 - color[c]);
                    image.data[at + c] = encode(1.15 * color[c] * lit + through + 0.015);
                }
                image.data[at + 3] = Math.round(255 * Math.min(1, (1 - Math.sqrt(r2)) * radius));
            } else if (x >= 54 && x < 82 && y >= 3 && y < 45) {
                const off = Math.max(0, Math.abs(x - 68) - 1.5) * 0.45;
                for (let c = 0; c < 3; c++)
                    image.data[at + c] = encode(
                        (0.75 * (1 - Math.sqrt(color[c])) + 1.6 * Math.sqrt(color[c])) *
                            Math.exp(-sigma[c] * 2) *
                            Math.exp(-off * Math.min(sigma[c], 4)) +
                            0.012,
                    );
                image.data[at + 3] = 255;
            }
        }
    canvas.getContext('2d').putImageData(image, 0, 0);
}

function assign(value, moving = false) {
    const materials = { ...(state.materials ?? facts?.said ?? {}) };
    if (target === '*') for (const key of Object.keys(materials)) delete materials[key];
    if (value) materials[target] = value;
    else delete materials[target];
    state.materials = value || Object.keys(materials).length ? materials : null;
    changed('materials', moving);
}

const current = () => (state.materials ?? facts?.said ?? {})[target];
function currentPreset() {
    const own = current();
    if (own) return own.preset ?? '';
    const shown = (facts?.materials ?? []).filter((m) => target === '*' || m.name === target);
    return shown[0]?.preset ?? '';
}

// The coefficients used, if known.
function coefficients() {
    const own = current();
    if (own?.sigma_a) return own;
    if (own?.skin) return null;
    const entry = all.find((m) => m.name === currentPreset() && m.kind === 'medium');
    return entry ? { sigma_a: entry.sigma_a, sigma_s_reduced: entry.sigma_s_reduced, eta: entry.eta } : null;
}

function channelRows(title, key, unit, low, high) {
    const given = coefficients();
    if (!given) return [];
    const rows = [];
    ['r', 'g', 'b'].forEach((channel, c) => {
        const name = `${title}, ${['red', 'green', 'blue'][c]}`;
        const at = (x) => (1000 * Math.log(Math.max(x, low) / low)) / Math.log(high / low);
        const slider = el('input', { type: 'range', min: 0, max: 1000, 'aria-label': name, value: at(given[key][c]) });
        const field = el('input', { type: 'text', inputMode: 'decimal', 'aria-label': `${name} in ${unit}`, value: given[key][c] });
        const put = (x, moving) => {
            const now = coefficients();
            const values = [...now[key]];
            values[c] = x;
            assign({ sigma_a: now.sigma_a, sigma_s_reduced: now.sigma_s_reduced, eta: now.eta, [key]: values }, moving);
            field.value = x;
        };
        const value = () => Number((low * (high / low) ** (slider.value / 1000)).toPrecision(3));
        slider.addEventListener('input', () => put(value(), true));
        slider.addEventListener('change', () => put(value(), false));
        field.addEventListener('change', () => {
            const x = Number(field.value);
            if (x >= 0) put(x, false);
        });
        rows.push(el('span', { className: 'unit' }, channel), slider, field);
    });
    return [el('h3', {}, title, ' ', el('span', { className: 'unit' }, unit)), el('div', { className: 'rgb' }, ...rows)];
}

function swatch(m) {
    const canvas = el('canvas', { 'aria-hidden': 'true' });
    const button = el(
        'button',
        {
            type: 'button',
            className: 'swatch',
            'data-material': m.name,
            'aria-pressed': 'false',
            title: m.source,
            onclick: () => assign({ preset: m.name }),
        },
        canvas,
        el('span', {}, m.title),
    );
    draw(canvas, m);
    return button;
}

const composition = () => current()?.skin ?? null;

// For a material without coefficients: its layers, and what it can be replaced by.
function published() {
    const entry = all.find((m) => m.name === currentPreset());
    const begin = el(
        'button',
        {
            type: 'button',
            id: 'skin-begin',
            onclick: () => {
                assign({ skin: {} });
                refresh(true);
            },
        },
        'Skin by melanin and blood',
    );
    return el(
        'div',
        {},
        el('p', { className: 'note' }, 'Its profile is published as a sum of Gaussians, or in layers: it has no coefficients to change.'),
        entry?.layers
            ? crossSection(entry.layers.map((l) => ({ ...l, thickness_mm: l.thickness_mm === 'infinite' ? null : l.thickness_mm })))
            : '',
        el('div', { className: 'group' }, begin),
    );
}

function editor() {
    const given = coefficients();
    const source = { medium: coefficients, skin: composition };
    if (composition())
        return el('div', {}, ...skinEditor(composition, (skin, moving) => assign({ skin }, moving)), bench.panel(source));
    if (!given) return published();
    const scale = el('input', { type: 'range', min: -300, max: 300, value: 0, id: 'concentration', 'aria-label': 'Concentration' });
    const begin = structuredClone(given);
    const put = (moving) => {
        const k = 10 ** (scale.value / 100);
        assign(
            { sigma_a: begin.sigma_a.map((x) => x * k), sigma_s_reduced: begin.sigma_s_reduced.map((x) => x * k), eta: begin.eta },
            moving,
        );
    };
    scale.addEventListener('input', () => put(true));
    scale.addEventListener('change', () => put(false));
    return el(
        'div',
        {},
        el(
            'div',
            { className: 'field' },
            el('label', { htmlFor: 'concentration' }, 'Concentration, a thousandth to a thousand times'),
            scale,
        ),
        ...channelRows('Absorption', 'sigma_a', '1/mm', 1e-5, 10),
        ...channelRows('Reduced scattering', 'sigma_s_reduced', '1/mm', 1e-3, 100),
        bench.panel(source),
    );
}

export function build(panel, materials) {
    all = materials;
    box = panel;
    const search = el('input', { type: 'search', id: 'material-search', autocomplete: 'off' });
    const families = new Map();
    for (const m of all) families.set(m.family || 'other', [...(families.get(m.family || 'other') ?? []), m]);
    const groups = [...families].map(([family, list]) =>
        el('section', {}, el('h3', {}, family), el('div', { className: 'swatches' }, ...list.map(swatch))),
    );
    search.addEventListener('input', () => {
        const words = search.value.toLowerCase();
        for (const group of groups) {
            let any = false;
            for (const b of group.querySelectorAll('.swatch')) {
                b.hidden = !`${b.dataset.material} ${b.textContent}`.toLowerCase().includes(words);
                any ||= !b.hidden;
            }
            group.hidden = !any;
        }
    });
    const select = el('select', { id: 'material-target' });
    select.addEventListener('change', () => {
        target = select.value;
        refresh(true);
    });
    panel.append(
        el(
            'div',
            { className: 'field', id: 'material-target-field', hidden: true },
            el('label', { htmlFor: 'material-target' }, 'Of'),
            select,
        ),
        el(
            'details',
            { id: 'material-editor', ontoggle: bench.ask },
            el('summary', {}, 'Coefficients, layers, profile'),
            el('div', { id: 'material-coefficients' }),
        ),
        el('div', { className: 'field' }, el('label', { htmlFor: 'material-search' }, 'Find'), search),
        ...groups,
    );
}

export function setFacts(given) {
    facts = given;
    const select = box.querySelector('#material-target');
    const names = [...new Set(facts.materials.map((m) => m.name))];
    select.replaceChildren(el('option', { value: '*' }, 'all objects'), ...names.map((n) => el('option', { value: n }, n)));
    if (target !== '*' && !names.includes(target)) target = '*';
    select.value = target;
    box.querySelector('#material-target-field').hidden = names.length < 2;
    refresh(false);
}

export function refresh(rebuild) {
    const preset = currentPreset();
    for (const b of box.querySelectorAll('.swatch')) b.setAttribute('aria-pressed', String(b.dataset.material === preset));
    const editing = box.querySelector('#material-coefficients');
    if (rebuild || !editing.contains(document.activeElement)) {
        editing.replaceChildren(editor());
        bench.draw();
    }
    bench.ask();
}
