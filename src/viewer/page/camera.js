// SPDX-License-Identifier: MIT
// camera.js - rotates, moves and places the camera. Positions in mm.
import { mm, state } from './state.js';

let file = null; // the camera of the file
let bounds = [0, 0, 0, 0, 0, 0];

const add = (a, b) => a.map((x, i) => x + b[i]);
const sub = (a, b) => a.map((x, i) => x - b[i]);
const mul = (a, k) => a.map((x) => x * k);
const dot = (a, b) => a.reduce((s, x, i) => s + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => mul(a, 1 / (length(a) || 1));

// Rodrigues' rotation.
const turn = (v, axis, angle) =>
    add(add(mul(v, Math.cos(angle)), mul(cross(axis, v), Math.sin(angle))), mul(axis, dot(axis, v) * (1 - Math.cos(angle))));

export function setFile(camera, box) {
    file = { ...camera, from: camera.from.map(mm), to: camera.to.map(mm), up: [...camera.up] };
    for (const key of ['ortho_height', 'focus']) if (camera[key]) file[key] = mm(camera[key]);
    bounds = box;
}

export const current = () => (state.camera ??= structuredClone(file));
export const now = () => structuredClone(state.camera ?? file);
export const middle = () => [0, 1, 2].map((i) => (bounds[2 * i] + bounds[2 * i + 1]) / 2);
export const extent = () => Math.max(...[0, 1, 2].map((i) => bounds[2 * i + 1] - bounds[2 * i]));

// The axis that stays upright: the one nearest to the camera's up.
function pole(c) {
    const up = (file ?? c).up;
    const k = up.map(Math.abs).indexOf(Math.max(...up.map(Math.abs)));
    return [0, 1, 2].map((i) => (i === k ? Math.sign(up[k]) : 0));
}

export function orbit(dx, dy) {
    const c = current();
    const axis = pole(c);
    let out = turn(sub(c.from, c.to), axis, -dx);
    const right = unit(cross(axis, out));
    const elevation = Math.asin(Math.max(-1, Math.min(1, dot(unit(out), axis))));
    const more = Math.max(-1.55 - elevation, Math.min(1.55 - elevation, dy));
    out = turn(out, right, -more);
    c.from = add(c.to, out);
    c.up = axis;
}

// Rotates a camera around the object by an angle.
export function turned(c, angle) {
    const axis = pole(c);
    return { ...c, from: add(c.to, turn(sub(c.from, c.to), axis, angle)), up: axis };
}

// Projects a point to the image, in fractions of its size, and back to rays. `aspect`: width over height.
export function projection(aspect) {
    const c = state.camera ?? file;
    const forward = unit(sub(c.to, c.from));
    const right = unit(cross(forward, c.up));
    const up = cross(right, forward);
    const half = c.ortho_height ? c.ortho_height / 2 : Math.tan((c.fov_deg * Math.PI) / 360);
    return {
        project(point) {
            const v = sub(point, c.from);
            const depth = c.ortho_height ? 1 : Math.max(dot(v, forward), 1e-6);
            return [0.5 + dot(v, right) / (2 * half * aspect * depth), 0.5 - dot(v, up) / (2 * half * depth)];
        },
        ray(x, y) {
            const off = add(mul(right, (2 * x - 1) * half * aspect), mul(up, (1 - 2 * y) * half));
            return c.ortho_height ? { from: add(c.from, off), along: forward } : { from: c.from, along: unit(add(forward, off)) };
        },
        toward: (point) => (c.ortho_height ? mul(forward, -1) : unit(sub(c.from, point))),
    };
}

// In fractions of the image's height.
export function pan(dx, dy) {
    const c = current();
    const back = sub(c.from, c.to);
    const right = unit(cross(c.up, back));
    const up = unit(cross(back, right));
    const height = c.ortho_height ?? 2 * length(back) * Math.tan((c.fov_deg * Math.PI) / 360);
    const by = add(mul(right, -dx * height), mul(up, dy * height));
    c.from = add(c.from, by);
    c.to = add(c.to, by);
}

export function dolly(amount) {
    const c = current();
    const k = Math.exp(amount);
    if (c.ortho_height) {
        c.ortho_height *= k;
        return;
    }
    const back = sub(c.from, c.to);
    const distance = Math.max(length(back) * k, 0.02 * extent());
    c.from = add(c.to, mul(unit(back), Math.min(distance, 100 * extent())));
}

export function lookAt(point) {
    const c = current();
    const back = sub(c.from, c.to);
    const forward = unit(mul(back, -1));
    c.to = point;
    c.focus = Math.max(dot(sub(point, c.from), forward), 1e-3);
    c.from = add(point, back);
}

export function place(number) {
    const directions = [
        [0, 0, 1],
        [1, 0, 0],
        [0, 0, -1],
        [-1, 0, 0],
        [0, 1, 0.001],
        [0, -1, 0.001],
    ];
    const c = current();
    const distance = length(sub(c.from, c.to));
    c.to = middle();
    c.from = add(c.to, mul(unit(directions[number - 1]), distance));
    c.up = [0, 1, 0];
}

export function reset() {
    state.camera = null;
}
