// SPDX-License-Identifier: MIT
// plot.js - curves of three channels over a length, both logarithmic, as SVG.

const NS = 'http://www.w3.org/2000/svg';

export function node(tag, attributes, text) {
    const n = document.createElementNS(NS, tag);
    for (const [key, value] of Object.entries(attributes)) n.setAttribute(key, value);
    if (text !== undefined) n.textContent = text;
    return n;
}

const power = (k) => (k >= -2 && k <= 3 ? String(Number((10 ** k).toPrecision(2))) : `1e${k}`);

const REFLECTED = { x: 'r, mm', y: 'R(r), 1/mm²', about: 'R(r) of red, green and blue over the distance r' };

// `channels`: three lists of values at `radii`; `fit`: values of the same form, drawn dashed. null: no light.
export function plot(radii, channels, { fit = null, words = REFLECTED } = {}) {
    const width = 320,
        height = 180,
        left = 42,
        bottom = 28,
        top = 8,
        right = 8;
    const values = channels.flat().filter((v) => v > 0);
    if (!values.length) return null;
    const x0 = Math.log10(radii[0]),
        x1 = Math.log10(radii.at(-1));
    const y1 = Math.ceil(Math.log10(Math.max(...values))),
        y0 = Math.max(y1 - 7, Math.floor(Math.log10(Math.min(...values))));
    const x = (r) => left + ((Math.log10(r) - x0) / (x1 - x0)) * (width - left - right);
    const y = (v) => top + (1 - (Math.log10(v) - y0) / (y1 - y0)) * (height - top - bottom);
    const svg = node('svg', {
        viewBox: `0 0 ${width} ${height}`,
        class: 'plot',
        role: 'img',
        'aria-label': words.about,
    });
    for (let k = Math.ceil(x0); k <= x1; k++) {
        svg.append(
            node('line', { class: 'axis', x1: x(10 ** k), x2: x(10 ** k), y1: top, y2: height - bottom }),
            node('text', { x: x(10 ** k), y: height - bottom + 12, 'text-anchor': 'middle' }, power(k)),
        );
    }
    for (let k = y0; k <= y1; k += y1 - y0 > 4 ? 2 : 1) {
        svg.append(
            node('line', { class: 'axis', x1: left, x2: width - right, y1: y(10 ** k), y2: y(10 ** k) }),
            node('text', { x: left - 4, y: y(10 ** k) + 3, 'text-anchor': 'end' }, power(k)),
        );
    }
    svg.append(
        node('text', { x: width - right, y: height - 4, 'text-anchor': 'end' }, words.x),
        node('text', { x: 2, y: height - 4 }, words.y),
    );
    const curve = (values, className) => {
        const points = radii.map((r, i) => [r, values[i]]).filter(([, v]) => v !== null && Math.log10(v) >= y0);
        if (!points.length) return;
        const d = `M${points.map(([r, v]) => `${x(r).toFixed(1)} ${y(v).toFixed(1)}`).join('L')}`;
        svg.append(node('path', { class: className, d }));
    };
    ['r', 'g', 'b'].forEach((name, c) => {
        curve(channels[c], name);
        if (fit) curve(fit[c], `${name} fit`);
    });
    return svg;
}
