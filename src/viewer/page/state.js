// SPDX-License-Identifier: MIT
// state.js - the state of the page: one object, its history, and its text in the address.

const listeners = new Set();
let history = [];
let future = [];
let committed = '';
let writing = 0;

export const state = {
    method: 'none',
    knobs: {},
    settings: {},
    camera: null,
    lights: null,
    materials: null,
    time: null,
    other: null,
    truth: null,
    mode: 'single',
    wipe: 0.5,
};
export let base = {}; // the initial state

// what: the part that changed; moving: more changes of the same part follow soon.
export function changed(what, moving = false) {
    if (!moving) commit();
    for (const listener of listeners) listener(what, moving);
}

export const onChange = (listener) => listeners.add(listener);

function commit() {
    const text = JSON.stringify(state);
    if (text === committed) return;
    if (committed) history.push(committed);
    if (history.length > 200) history.shift();
    committed = text;
    future = [];
    clearTimeout(writing);
    writing = setTimeout(writeAddress, 300);
}

function adopt(text) {
    committed = text;
    Object.assign(state, JSON.parse(text));
    clearTimeout(writing);
    writing = setTimeout(writeAddress, 300);
    for (const listener of listeners) listener('all', false);
}

export const canUndo = () => history.length > 0;
export const canRedo = () => future.length > 0;
export function undo() {
    if (!history.length) return;
    future.push(committed);
    adopt(history.pop());
}
export function redo() {
    if (!future.length) return;
    history.push(committed);
    adopt(future.pop());
}

// The parts that differ from the initial state, to keep links short.
function difference() {
    const out = {};
    for (const [key, value] of Object.entries(state)) if (JSON.stringify(value) !== JSON.stringify(base[key])) out[key] = value;
    return out;
}

const encode = (text) =>
    btoa(String.fromCharCode(...new TextEncoder().encode(text)))
        .replaceAll('+', '-')
        .replaceAll('/', '_');
const decode = (text) =>
    new TextDecoder().decode(Uint8Array.from(atob(text.replaceAll('-', '+').replaceAll('_', '/')), (c) => c.charCodeAt(0)));

function writeAddress() {
    const out = difference();
    const hash = Object.keys(out).length ? `#view=${encode(JSON.stringify(out))}` : '';
    window.history.replaceState(null, '', location.pathname + location.search + hash);
}

// The shapes that the page relies on, in a link that anybody may have written. The program checks the values.
const isObject = (x) => typeof x === 'object' && x !== null && !Array.isArray(x);
const isText = (x) => typeof x === 'string';
const isPoint = (x) => Array.isArray(x) && x.length === 3;
const isOptions = (x) => isObject(x) && Object.values(x).every((value) => typeof value !== 'object');
const isPlaced = (light) => light.type === 'environment' || isPoint(light.type === 'directional' ? light.direction : light.at);
const shapes = {
    method: isText,
    knobs: isOptions,
    settings: isOptions,
    camera: (x) => isObject(x) && [x.from, x.to, x.up].every(isPoint),
    lights: (x) => Array.isArray(x) && x.every((light) => isObject(light) && isText(light.type) && isPlaced(light)),
    materials: (x) => isObject(x) && Object.values(x).every(isObject),
    time: Number.isFinite,
    other: (x) => isObject(x) && isText(x.method) && isOptions(x.knobs),
    truth: isText,
    mode: isText,
    wipe: Number.isFinite,
};
const fits = (key, value) => (value === null && base[key] === null) || shapes[key](value);

// The initial state, overridden by the address; null: the address holds no view that can be read.
function addressed() {
    const out = structuredClone(base);
    const found = /^#view=([\w=-]+)$/.exec(location.hash);
    try {
        const saved = found ? JSON.parse(decode(found[1])) : {};
        for (const key of Object.keys(shapes)) {
            if (!Object.hasOwn(saved, key)) continue;
            if (!fits(key, saved[key])) throw new TypeError(key);
            out[key] = saved[key];
        }
    } catch {
        console.info('the address holds no view');
        return null;
    }
    return out;
}

// A link to another view of this page is opened in it.
function readAddress() {
    const next = addressed();
    const text = next && JSON.stringify(next);
    if (!next || text === committed) return;
    history.push(committed);
    future = [];
    adopt(text);
}

export function begin(given) {
    base = { ...structuredClone(state), ...given };
    Object.assign(state, addressed() ?? structuredClone(base));
    addEventListener('hashchange', readAddress);
    committed = JSON.stringify(state);
    history = [];
    future = [];
}

export const mm = (text) => (typeof text === 'number' ? text : parseFloat(text));
export const length = (x) => `${Number(x.toPrecision(9))}mm`;

function cameraMessage(c) {
    const out = { from: c.from.map(length), to: c.to.map(length), up: c.up };
    if (c.ortho_height) out.ortho_height = length(c.ortho_height);
    else out.fov_deg = c.fov_deg;
    if (c.focus) out.focus = length(c.focus);
    if (c.f_number) out.f_number = c.f_number;
    return out;
}

// The message to the program for a state.
export function message(of = state) {
    const out = { method: of.method, knobs: of.knobs, settings: of.settings };
    if (of.camera) out.camera = cameraMessage(of.camera);
    for (const key of ['lights', 'materials', 'other', 'truth', 'time']) if (of[key] !== null) out[key] = of[key];
    return out;
}
