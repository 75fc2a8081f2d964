// SPDX-License-Identifier: MIT
// lights.js - every light as a point on a sphere round the object: azimuth and elevation to drag, distance, size, power, colour.
import { extent, middle } from './camera.js';
import { el } from './knobs.js';
import { changed, length, mm, state } from './state.js';

let file = [];
let box = null;
let chosen = 0;

const powers = { point: 'intensity', spot: 'intensity', directional: 'irradiance', rect: 'radiance', disc: 'radiance' };
const lights = () => state.lights ?? file;
const three = (p) => (Array.isArray(p) ? p : [p, p, p]);

// Azimuth from +z to +x, elevation and distance, relative to the centre of the object.
function polar(light) {
    const m = middle();
    const v = light.type === 'directional' ? three(light.direction).map((x) => -x) : light.at.map((x, i) => mm(x) - m[i]);
    const r = Math.hypot(...v) || 1;
    return { azimuth: Math.atan2(v[0], v[2]), elevation: Math.asin(v[1] / r), distance: r };
}

function place(light, { azimuth, elevation, distance }) {
    const m = middle();
    const v = [Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth) * Math.cos(elevation)];
    if (light.type === 'directional') return { ...light, direction: v.map((x) => Number((-x).toPrecision(9))) };
    const out = { ...light, at: v.map((x, i) => length(m[i] + distance * x)) };
    if (light.type !== 'point' || light.to) {
        out.to = m.map(length);
        delete out.up;
    }
    return out;
}

function put(index, light, moving) {
    state.lights = lights().map((l, i) => (i === index ? light : l));
    changed('lights', moving);
}

const power = (light) => three(light[powers[light.type]] ?? 1);
const hex = (rgb) => {
    const top = Math.max(...rgb, 1e-9);
    return `#${rgb
        .map((x) =>
            Math.round(255 * (x / top) ** (1 / 2.2))
                .toString(16)
                .padStart(2, '0'),
        )
        .join('')}`;
};
const unhex = (text) => [1, 3, 5].map((i) => (parseInt(text.slice(i, i + 2), 16) / 255) ** 2.2);

function slider(label, value, low, high, set, format = (x) => Number(x.toPrecision(3))) {
    const id = `light-${label.replace(/\W/g, '-').toLowerCase()}`;
    const output = el('output', { className: 'unit', htmlFor: id }, String(format(value)));
    const input = el('input', { type: 'range', id, min: 0, max: 1000, value: (1000 * (value - low)) / (high - low) });
    const go = (moving) => {
        const x = low + (input.value / 1000) * (high - low);
        output.textContent = String(format(x));
        set(x, moving);
    };
    input.addEventListener('input', () => go(true));
    input.addEventListener('change', () => go(false));
    return el(
        'div',
        { className: 'field' },
        el('div', { className: 'row' }, el('label', { htmlFor: id, className: 'label' }, label), output),
        input,
    );
}

// The light in a colour, its strongest channel with this power.
function colored(light, rgb, strength) {
    const top = Math.max(...rgb);
    return { ...light, [powers[light.type]]: rgb.map((x) => (top > 0 ? Number(((strength * x) / top).toPrecision(9)) : 0)) };
}

function details(index) {
    const light = lights()[index];
    const now = () => lights()[index];
    if (light.type === 'environment')
        return [
            slider(
                'Rotation, degrees',
                (((light.rotate_deg ?? 0) % 360) + 360) % 360,
                0,
                360,
                (x, m) => put(index, { ...now(), rotate_deg: x }, m),
                (x) => Math.round(x),
            ),
            slider('Brightness, stops', Math.log2(Math.max(light.scale ?? 1, 1e-6)), -6, 6, (x, m) =>
                put(index, { ...now(), scale: 2 ** x }, m),
            ),
        ];
    const p = polar(light),
        begun = Math.max(...power(light)) || 1;
    let strength = begun; // kept while the colour is black
    const out = [];
    const color = el('input', { type: 'color', id: 'light-color', value: hex(power(light)) });
    const paint = (moving) => put(index, colored(now(), unhex(color.value), strength), moving);
    color.addEventListener('input', () => paint(true));
    color.addEventListener('change', () => paint(false));
    out.push(el('div', { className: 'field' }, el('label', { htmlFor: 'light-color' }, 'Colour'), color));
    const begin = structuredClone(light);
    out.push(
        slider('Power, stops', 0, -6, 6, (x, m) => {
            strength = begun * 2 ** x;
            put(index, colored(now(), power(now()), strength), m);
        }),
    );
    if (light.type !== 'directional')
        out.push(
            slider(
                'Distance, object sizes',
                Math.log2(p.distance / extent()),
                -1,
                5,
                (x, m) => put(index, place(now(), { ...polar(now()), distance: extent() * 2 ** x }), m),
                (x) => Number((2 ** x).toPrecision(2)),
            ),
        );
    const sizes = ['width', 'height', 'radius'].filter((k) => begin[k]);
    if (sizes.length)
        out.push(
            slider(
                'Size',
                0,
                -4,
                4,
                (x, m) => put(index, { ...now(), ...Object.fromEntries(sizes.map((k) => [k, length(mm(begin[k]) * 2 ** x)])) }, m),
                (x) => `× ${Number((2 ** x).toPrecision(2))}`,
            ),
        );
    if (Math.max(...power(light)) === 0) out.push(el('p', { className: 'note' }, 'This light is off: choose a colour.'));
    return out;
}

const where = (p) => [50 + (50 * p.azimuth) / Math.PI, 50 - (100 * p.elevation) / Math.PI];

function dot(light, index, pad) {
    const name = light.name || light.type;
    const node = el(
        'button',
        {
            type: 'button',
            className: 'dot',
            'aria-pressed': String(index === chosen),
            'aria-label': `${index + 1}, ${name}: arrow keys move it`,
            title: name,
        },
        String(index + 1),
    );
    const show = () => {
        const [x, y] = where(polar(lights()[index]));
        node.style.left = `${x}%`;
        node.style.top = `${y}%`;
        node.style.background = hex(power(lights()[index]));
    };
    const go = (azimuth, elevation, moving) => {
        const p = polar(lights()[index]);
        const wrapped = ((((azimuth + Math.PI) % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI)) - Math.PI;
        put(
            index,
            place(lights()[index], { ...p, azimuth: wrapped, elevation: Math.max(-1.55, Math.min(1.55, elevation)) }),
            moving,
        );
        show();
    };
    node.addEventListener('pointerdown', (event) => {
        node.setPointerCapture(event.pointerId);
        choose(index);
    });
    const drag = (event, moving) => {
        if (!node.hasPointerCapture(event.pointerId)) return;
        const r = pad.getBoundingClientRect();
        go(((event.clientX - r.left) / r.width - 0.5) * 2 * Math.PI, (0.5 - (event.clientY - r.top) / r.height) * Math.PI, moving);
    };
    node.addEventListener('pointermove', (event) => drag(event, true));
    node.addEventListener('pointerup', (event) => {
        drag(event, false);
        node.releasePointerCapture(event.pointerId);
    });
    node.addEventListener('focus', () => choose(index));
    node.addEventListener('keydown', (event) => {
        const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
        if (!step) return;
        event.preventDefault();
        const p = polar(lights()[index]);
        go(p.azimuth + 0.1 * step[0], p.elevation + 0.1 * step[1], false);
    });
    show();
    return node;
}

// Lights that have a direction relative to the object.
export const aimable = () =>
    lights()
        .map((light, index) => ({ index, name: light.name || light.type, type: light.type }))
        .filter(({ type }) => type !== 'environment');
export const color = (index) => hex(power(lights()[index]));
export function direction(index) {
    const { azimuth, elevation } = polar(lights()[index]);
    return [Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth) * Math.cos(elevation)];
}
export function aim(index, [x, y, z], moving) {
    const light = lights()[index];
    const elevation = Math.max(-1.55, Math.min(1.55, Math.asin(Math.max(-1, Math.min(1, y)))));
    put(index, place(light, { ...polar(light), azimuth: Math.atan2(x, z), elevation }), moving);
    refresh(true);
}

export function choose(index) {
    if (chosen === index && box.querySelector('#light-details').childElementCount) return;
    chosen = index;
    for (const [i, d] of [...box.querySelectorAll('.dot')].entries())
        d.setAttribute('aria-pressed', String(Number(d.textContent) - 1 === index && i >= 0));
    const select = box.querySelector('#light-choice');
    if (select) select.value = String(index);
    box.querySelector('#light-details').replaceChildren(...details(index));
}

export function build(panel) {
    box = panel;
}

export function setFile(list) {
    file = list;
    refresh(true);
}

export function refresh(force) {
    if (!box || (!force && box.contains(document.activeElement) && document.activeElement !== document.body)) return;
    const list = lights();
    if (!list.length) {
        box.replaceChildren(el('p', { className: 'note' }, 'The scene has no lights.'));
        return;
    }
    chosen = Math.min(chosen, list.length - 1);
    const pad = el('div', { className: 'pad', role: 'group', 'aria-label': 'Lights around the object' });
    pad.append(...list.map((l, i) => (l.type === 'environment' ? null : dot(l, i, pad))).filter(Boolean));
    const select = el(
        'select',
        { id: 'light-choice' },
        ...list.map((l, i) => el('option', { value: String(i) }, `${i + 1}  ${l.name || l.type}`)),
    );
    select.addEventListener('change', () => choose(Number(select.value)));
    const back = el(
        'button',
        {
            type: 'button',
            onclick: () => {
                state.lights = null;
                changed('lights');
                refresh(true);
            },
        },
        'As in the file',
    );
    box.replaceChildren(
        pad,
        el(
            'div',
            { className: 'padlabels' },
            el('span', {}, 'behind'),
            el('span', {}, 'left'),
            el('span', {}, 'front'),
            el('span', {}, 'right'),
            el('span', {}, 'behind'),
        ),
        el('div', { className: 'field' }, el('label', { htmlFor: 'light-choice' }, 'Light'), select),
        el('div', { id: 'light-details' }),
        back,
    );
    select.value = String(chosen);
    box.querySelector('#light-details').replaceChildren(...details(chosen));
}
