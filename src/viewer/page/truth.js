// SPDX-License-Identifier: MIT
// truth.js - errors against the reference, times of the stages, metrics of a point: the panel below the view.
import { el } from './knobs.js';
import { plot } from './plot.js';
import { state } from './state.js';

const $ = (id) => document.getElementById(id);
const percent = (x, digits = 1) => (x === null || x === undefined ? '–' : `${(100 * x).toFixed(digits)} %`);
const signed = (x) => `${x > 0 ? '+' : ''}${(100 * x).toFixed(1)}`;
const rms = (x) => (x === null ? null : Math.sqrt(Math.max(x, 0)));

// The root, with the standard error derived from that of the square; if noise hides it, its upper bound.
function rootText(m) {
    const e = rms(m.rel_mse);
    if (e === null) return ['–', ''];
    if (!m.resolved) return [`under ${percent(Math.sqrt(Math.max(m.rel_mse, 0) + 2 * m.rel_mse_error))}`, ''];
    return [percent(e), m.rel_mse_error ? ` ± ${(100 * (m.rel_mse_error / (2 * e))).toFixed(1)}` : ''];
}

const rows = [
    ['Root mean square', (m) => rootText(m).join('')],
    ['FLIP', (m) => (m.flip === null ? '–' : m.flip.toFixed(4))],
    ['Bias, red', (m) => biasText(m, 0)],
    ['Bias, green', (m) => biasText(m, 1)],
    ['Bias, blue', (m) => biasText(m, 2)],
    ['SSIM', (m) => (m.ssim === null ? '–' : m.ssim.toFixed(4))],
];

function biasText(m, c) {
    if (m.bias[c] === null) return '–';
    return `${signed(m.bias[c])} %${m.bias_error[c] ? ` ± ${(100 * m.bias_error[c]).toFixed(1)}` : ''}`;
}

export function showTruth(t) {
    const box = $('errors');
    box.hidden = false;
    $('errors-title').textContent = `Error against ${t.method}`;
    const heads = ['', state.method, ...(t.b && state.other ? [state.other.method] : [])];
    const about = t.random
        ? `${t.batches} independent images of ${t.width} × ${t.height}, noise ${percent(t.noise, 2)}${t.done ? '' : ', getting sharper'}`
        : `${t.width} × ${t.height}; its own error of method is not included`;
    $('errors-body').replaceChildren(
        el('p', { className: 'big' }, rootText(t.a)[0], ' ', el('small', {}, `${rootText(t.a)[1]} relative error`)),
        el(
            'table',
            {},
            el('thead', {}, el('tr', {}, ...heads.map((h) => el('th', { scope: 'col' }, h)))),
            el(
                'tbody',
                {},
                ...rows.map(([name, text]) =>
                    el('tr', {}, el('td', {}, name), el('td', {}, text(t.a)), t.b && state.other ? el('td', {}, text(t.b)) : null),
                ),
            ),
        ),
        el('p', { className: 'note' }, about),
    );
}

export function waitForTruth() {
    $('errors').hidden = !state.truth;
    if (!state.truth) return;
    $('errors-title').textContent = `Error against ${state.truth}`;
    $('errors-body').replaceChildren(el('p', { className: 'note' }, 'The reference is rendered when nothing moves.'));
}

export function showStages(head) {
    const list = (head.stages ?? []).filter((s) => s.ms > 0.05);
    const most = Math.max(...list.map((s) => s.ms), 1e-3);
    $('stages').replaceChildren(
        ...list.map((s) => {
            const bar = el('i', {});
            bar.style.transform = `scaleX(${s.ms / most})`;
            return el(
                'div',
                { className: 'stage-row' },
                el('span', { title: s.name }, s.name),
                el('div', { className: 'track' }, bar),
                el('span', {}, `${s.ms.toFixed(1)} ms`),
            );
        }),
    );
}

export function showPicked(p) {
    $('picked').hidden = false;
    if (!p.at) {
        $('picked-body').replaceChildren(el('p', { className: 'note' }, 'There is no surface here.'));
        return;
    }
    const fact = (name, value) => el('tr', {}, el('td', {}, name), el('td', {}, value));
    $('picked-body').replaceChildren(
        el(
            'table',
            {},
            el(
                'tbody',
                {},
                fact('Material', p.preset || p.material || '–'),
                fact('Point, mm', p.at.map((x) => x.toFixed(2)).join(', ')),
                fact('Depth', `${p.depth_mm.toFixed(1)} mm`),
                p.profile
                    ? fact(
                          'Half of the light exits within',
                          p.profile.half_light_mm.map((x) => Number(x.toPrecision(2))).join(', ') + ' mm',
                      )
                    : null,
                p.profile ? fact('Reflectance', p.profile.total.map((x) => x.toFixed(3)).join(', ')) : null,
            ),
        ),
        p.profile ? (plot(p.profile.r_mm, p.profile.R) ?? '') : '',
    );
}

// A circle with the radius that encloses half the light, drawn to the scale of the image.
export function showRing(p, canvas) {
    const ring = $('ring');
    ring.hidden = !p?.profile;
    if (ring.hidden) return;
    const shown = canvas.clientWidth;
    const radius = Math.max(...p.profile.half_light_mm) / p.mm_per_pixel / p.width;
    ring.style.left = `${100 * p.x}%`;
    ring.style.top = `${100 * p.y}%`;
    ring.style.width = ring.style.height = `${Math.max(4, 2 * radius * shown)}px`;
}
