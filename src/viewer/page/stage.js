// SPDX-License-Identifier: MIT
// stage.js - draws the images: alone, side by side, behind a wipe, as a difference; and handles pointer input.
import * as camera from './camera.js';
import { changed, state } from './state.js';

const canvas = document.getElementById('canvas');
const stage = document.getElementById('stage');
const handle = document.getElementById('handle');
const context = canvas.getContext('2d');
const pictures = []; // A, B, reference, error of A, error of B: { bitmap, head }
let still = null;

export const KINDS = { A: 0, B: 1, REFERENCE: 2, ERROR_A: 3, ERROR_B: 4 };
export const picture = (kind) => pictures[kind];
export const stillFile = () => still;

export function forget(...kinds) {
    for (const kind of kinds) {
        pictures[kind]?.bitmap.close();
        pictures[kind] = undefined;
    }
}

export async function take(head, file, finished) {
    const bitmap = await createImageBitmap(file);
    pictures[head.picture]?.bitmap.close();
    pictures[head.picture] = { bitmap, head };
    if (head.picture === KINDS.A) still = finished ? file : null;
}

// The image to the right of A.
export const rightKind = () => (state.other ? KINDS.B : KINDS.REFERENCE);

function paint(bitmap, x0, x1) {
    const w = canvas.width,
        h = canvas.height;
    context.save();
    context.beginPath();
    context.rect(x0, 0, x1 - x0, h);
    context.clip();
    context.imageSmoothingQuality = 'high';
    context.drawImage(bitmap, 0, 0, w, h);
    context.restore();
}

const scratch = [new OffscreenCanvas(1, 1), new OffscreenCanvas(1, 1)];
function pixels(bitmap, index, w, h) {
    const c = scratch[index];
    c.width = w;
    c.height = h;
    const g = c.getContext('2d', { willReadFrequently: true });
    g.drawImage(bitmap, 0, 0, w, h);
    return g.getImageData(0, 0, w, h);
}

// Display values, A minus the other, times four: blue where A is darker, red where it is brighter.
function difference(a, b) {
    const w = Math.min(640, a.width),
        h = Math.round((w * a.height) / a.width);
    const x = pixels(a, 0, w, h),
        y = pixels(b, 1, w, h);
    for (let i = 0; i < x.data.length; i += 4) {
        let d = 0;
        for (let c = 0; c < 3; c++) d += x.data[i + c] - y.data[i + c];
        const s = Math.max(-1, Math.min(1, (4 * d) / 765));
        x.data[i] = s > 0 ? 221 - 41 * s : 221 + 163 * s;
        x.data[i + 1] = 221 - 217 * Math.abs(s) + (s < 0 ? 72 * -s : 0);
        x.data[i + 2] = s > 0 ? 221 - 183 * s : 221 - 29 * -s;
    }
    scratch[0].getContext('2d').putImageData(x, 0, 0);
    return scratch[0];
}

export function draw() {
    const a = pictures[KINDS.A]?.bitmap;
    const kind = rightKind();
    const other = pictures[kind]?.bitmap;
    const errors = pictures[KINDS.ERROR_A]?.bitmap;
    const mode = state.mode === 'error' ? (errors ? 'error' : 'single') : other ? state.mode : 'single';
    if (!a) return;
    const wanted = Number(state.settings.width ?? 1280),
        tall = Number(state.settings.height ?? 720);
    if (wanted > 0 && tall > 0 && (canvas.width !== wanted || canvas.height !== tall)) {
        canvas.width = Math.min(wanted, 4096);
        canvas.height = Math.min(tall, 4096);
    }
    const w = canvas.width,
        h = canvas.height;
    if (mode === 'single') paint(a, 0, w);
    if (mode === 'wipe') {
        paint(a, 0, state.wipe * w);
        paint(other, state.wipe * w, w);
    }
    if (mode === 'side') {
        context.fillStyle = '#191817';
        context.fillRect(0, 0, w, h);
        const s = 0.5;
        context.drawImage(a, 0, (h * (1 - s)) / 2, w * s, h * s);
        context.drawImage(other, w * s, (h * (1 - s)) / 2, w * s, h * s);
    }
    if (mode === 'difference') paint(difference(a, other), 0, w);
    if (mode === 'error') paint(errors, 0, w);
    handle.hidden = mode !== 'wipe';
    handle.style.left = `${100 * state.wipe}%`;
    stage.dataset.mode = mode;
}

// --- Pointer input --------------------------------------------------------------------------------------------------------------

const pointers = new Map();
let dragged = 0;
let pinch = null;
let button = 0;

function spread() {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, d: Math.hypot(a.x - b.x, a.y - b.y) };
}

const position = (event) => {
    const r = canvas.getBoundingClientRect();
    return { x: (event.clientX - r.left) / r.width, y: (event.clientY - r.top) / r.height };
};

function move(event) {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before.x,
        dy = event.clientY - before.y;
    const height = canvas.clientHeight || 1;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    dragged += Math.abs(dx) + Math.abs(dy);
    if (pointers.size === 2) {
        const now = spread();
        if (pinch) {
            camera.pan((now.x - pinch.x) / height, (now.y - pinch.y) / height);
            camera.dolly(Math.log(pinch.d / Math.max(now.d, 1)));
        }
        pinch = now;
    } else if (dragged > 3) {
        if (button !== 0 || event.shiftKey) camera.pan(dx / height, dy / height);
        else camera.orbit((dx / height) * 3, (dy / height) * 3);
    }
    if (dragged > 3) changed('camera', true);
}

export function listen({ onPick, onFocus }) {
    stage.addEventListener('pointerdown', (event) => {
        if (event.target === handle) return;
        stage.focus({ preventScroll: true });
        stage.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
        if (pointers.size === 1) {
            dragged = 0;
            button = event.button;
        }
        pinch = pointers.size === 2 ? spread() : null;
    });
    stage.addEventListener('pointermove', move);
    const end = (event) => {
        if (!pointers.delete(event.pointerId)) return;
        pinch = null;
        if (pointers.size) return;
        if (dragged > 3) changed('camera', false);
        else if (event.type === 'pointerup' && event.button === 0) onPick(position(event));
    };
    stage.addEventListener('pointerup', end);
    stage.addEventListener('pointercancel', end);
    stage.addEventListener('contextmenu', (event) => event.preventDefault());
    stage.addEventListener('dblclick', (event) => onFocus(position(event)));
    let rest = 0;
    stage.addEventListener(
        'wheel',
        (event) => {
            event.preventDefault();
            camera.dolly(Math.max(-0.3, Math.min(0.3, event.deltaY * (event.deltaMode ? 0.05 : 0.0015))));
            changed('camera', true);
            clearTimeout(rest);
            rest = setTimeout(() => changed('camera', false), 160);
        },
        { passive: false },
    );
    handle.addEventListener('pointerdown', (event) => {
        event.stopPropagation();
        handle.setPointerCapture(event.pointerId);
    });
    handle.addEventListener('pointermove', (event) => {
        if (!handle.hasPointerCapture(event.pointerId)) return;
        state.wipe = Math.max(0, Math.min(1, position(event).x));
        changed('wipe', true);
    });
    handle.addEventListener('pointerup', () => changed('wipe', false));
    keys();
}

function keys() {
    let rest = 0;
    stage.addEventListener('keydown', (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey) return;
        const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
        if (arrows && event.shiftKey) camera.pan(0.05 * arrows[0], 0.05 * arrows[1]);
        else if (arrows) camera.orbit(0.12 * arrows[0], 0.12 * arrows[1]);
        else if (event.key === '+' || event.key === '=') camera.dolly(-0.12);
        else if (event.key === '-' || event.key === '_') camera.dolly(0.12);
        else if (event.key === '0' || event.key === 'Home') camera.reset();
        else if (/^[1-6]$/.test(event.key)) camera.place(Number(event.key));
        else if (event.key === '[' || event.key === ']') {
            state.wipe = Math.max(0, Math.min(1, state.wipe + (event.key === ']' ? 0.03 : -0.03)));
            changed('wipe', false);
            return;
        } else return;
        event.preventDefault();
        changed('camera', true);
        clearTimeout(rest);
        rest = setTimeout(() => changed('camera', false), 160);
    });
}
