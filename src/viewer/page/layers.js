// SPDX-License-Identifier: MIT
// layers.js - layers below a surface: drawn as a cross-section, and skin by its composition.
import { el } from './knobs.js';
import { node } from './plot.js';

// The sRGB byte of linear light.
export const encode = (x) => Math.round(255 * Math.min(1, Math.max(0, x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055)));

// Reflectance of a half-space of the layer: Jensen and Buhler 2002, equation 15, for an index of refraction of 1.4.
function reflected(absorption, scattering) {
    const albedo = scattering / Math.max(absorption + scattering, 1e-12);
    const depth = Math.sqrt(3 * (1 - albedo));
    return (albedo / 2) * (1 + Math.exp(-4.3 * depth)) * Math.exp(-depth);
}

const colorOf = (layer) => `rgb(${[0, 1, 2].map((c) => encode(reflected(layer.sigma_a[c], layer.sigma_s_reduced[c]))).join(' ')})`;

// Each layer is at least as tall as its name; the rest of the height is shared by thickness. A last layer without a bottom gets half of it.
export function crossSection(layers) {
    const width = 320,
        height = 150,
        least = 22;
    const finite = layers.map((l) => l.thickness_mm ?? 0);
    const total = finite.reduce((sum, x) => sum + x, 0) || 1;
    const bottomless = layers.at(-1).thickness_mm === null;
    const room = Math.max(0, (bottomless && layers.length > 1 ? height / 2 : height) - least * (layers.length - (bottomless ? 1 : 0)));
    const svg = node('svg', { viewBox: `0 0 ${width} ${height}`, class: 'section', role: 'img', 'aria-label': 'Layers below the surface' });
    let y = 0;
    layers.forEach((layer, i) => {
        const tall = i + 1 === layers.length ? height - y : least + (room * finite[i]) / total;
        const thickness = layer.thickness_mm === null ? 'without a bottom' : `${Number(layer.thickness_mm.toPrecision(3))} mm`;
        const text = `${layer.name}, ${thickness}`;
        svg.append(
            node('rect', { x: 0, y, width, height: tall, fill: colorOf(layer) }),
            node('rect', { x: 6, y: y + 4, width: 8 + 6.2 * text.length, height: 15, rx: 3, class: 'plate' }),
            node('text', { x: 10, y: y + 15 }, text),
        );
        y += tall;
    });
    return svg;
}

// Ranges of human skin (Donner and Jensen 2006); the allowed ranges are wider.
const PARTS = [
    { key: 'melanin', title: 'Melanin', low: 0.005, high: 0.45, usual: 0.025 },
    { key: 'melanin_blend', title: 'Eumelanin, fraction of the melanin', low: 0, high: 1, usual: 0.2 },
    { key: 'haemoglobin', title: 'Haemoglobin', low: 0.002, high: 0.1, usual: 0.012 },
    { key: 'oxygenation', title: 'Oxygenation', low: 0, high: 1, usual: 0.75 },
    { key: 'epidermis_mm', title: 'Epidermis, mm', low: 0.05, high: 0.25, usual: 0.1 },
];

// `set(skin, moving)`.
export function skinEditor(skin, set) {
    return PARTS.map(({ key, title, low, high, usual }) => {
        const id = `skin-${key.replaceAll('_', '-')}`;
        const log = low > 0;
        const from = (x) => 1000 * (log ? Math.log(Math.max(x, low) / low) / Math.log(high / low) : (x - low) / (high - low));
        const to = (t) => Number((log ? low * (high / low) ** (t / 1000) : low + (t / 1000) * (high - low)).toPrecision(3));
        const value = () => skin()[key] ?? usual;
        const output = el('output', { className: 'unit', htmlFor: id }, String(value()));
        const slider = el('input', { type: 'range', id, min: 0, max: 1000, value: from(value()) });
        const go = (moving) => {
            const x = to(slider.value);
            output.textContent = String(x);
            set({ ...skin(), [key]: x }, moving);
        };
        slider.addEventListener('input', () => go(true));
        slider.addEventListener('change', () => go(false));
        return el(
            'div',
            { className: 'field' },
            el('div', { className: 'row' }, el('label', { htmlFor: id, className: 'label' }, title), output),
            slider,
        );
    });
}
