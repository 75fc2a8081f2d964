// SPDX-License-Identifier: MIT
// film.js - a turntable of the view: one turn around the object, of final-quality images.
import { animate } from './apng.js';
import * as camera from './camera.js';
import * as connection from './connection.js';
import { message, state } from './state.js';

const FRAMES = 36;
const MS = 80;
const WIDTH = 480; // pixels, at most

let film = null; // the one in progress

// The size of a frame, and the exposure of the first image for all.
function settings(exposure) {
    const width = Number(state.settings.width ?? 1280),
        height = Number(state.settings.height ?? 720),
        scale = Math.min(1, WIDTH / width);
    const out = { ...state.settings, width: String(Math.round(width * scale)), height: String(Math.max(1, Math.round(height * scale))) };
    return exposure > 0 ? { ...out, exposure: String(exposure) } : out;
}

function ask() {
    const { start, exposure } = film;
    const turned = camera.turned(start, (2 * Math.PI * film.files.length) / FRAMES);
    connection.view(() => message({ ...state, camera: turned, settings: settings(exposure), other: null, truth: null }), false);
}

export const filming = () => film !== null;

// onProgress(fraction), onDone(file | null): null if it was cancelled.
export function begin(exposure, onProgress, onDone) {
    if (film) return;
    film = { start: camera.now(), exposure, files: [], onProgress, onDone };
    ask();
}

export async function end() {
    const done = film;
    film = null;
    if (!done) return;
    done.onDone(done.files.length === FRAMES ? await animate(done.files, MS) : null);
}

// A finished image of those requested.
export async function take(file) {
    film.files.push(file);
    film.onProgress(film.files.length / FRAMES);
    if (film.files.length < FRAMES) ask();
    else await end();
}
