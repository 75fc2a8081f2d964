// SPDX-License-Identifier: MIT
// handles.js - the lights in the view: each as a handle on a sphere round the object, which the hand drags. A handle on the far side is
// hollow; dragged over the rim it goes to the other side.
import * as camera from './camera.js';
import { el } from './knobs.js';
import * as lights from './lights.js';

const layer = document.getElementById('handles');
const canvas = document.getElementById('canvas');
let shown = false;

const radius = () => 0.62 * camera.extent();
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const unit = (a) => a.map((x) => x / (Math.hypot(...a) || 1));

function place(node, index) {
    const view = camera.projection(canvas.width / canvas.height);
    const direction = lights.direction(index);
    const [x, y] = view.project(camera.middle().map((m, i) => m + radius() * direction[i]));
    const back = dot(direction, view.toward(camera.middle())) < 0;
    node.style.left = `${(100 * Math.max(0.02, Math.min(0.98, x))).toFixed(2)}%`;
    node.style.top = `${(100 * Math.max(0.03, Math.min(0.97, y))).toFixed(2)}%`;
    node.classList.toggle('back', back);
    node.style.setProperty('--light', lights.color(index));
}

// The direction from the centre of the object to the point of the sphere under the pointer; outside its rim the nearest point of it.
function aimed(event, drag) {
    const box = canvas.getBoundingClientRect();
    const view = camera.projection(canvas.width / canvas.height);
    const ray = view.ray((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    const to = ray.from.map((x, i) => x - camera.middle()[i]);
    const along = dot(to, ray.along);
    const near = to.map((x, i) => x - along * ray.along[i]); // where the ray is closest to the centre
    const distance = Math.hypot(...near);
    if (distance >= radius()) {
        drag.outside = true;
        return unit(near);
    }
    if (drag.outside) drag.back = !drag.back;
    drag.outside = false;
    const deep = Math.sqrt(radius() ** 2 - distance ** 2) * (drag.back ? 1 : -1);
    return unit(near.map((x, i) => x + deep * ray.along[i]));
}

function handle(index, name) {
    const about = { type: 'button', className: 'light-handle', tabIndex: -1, title: name, 'aria-hidden': 'true' };
    const node = el('button', about, String(index + 1));
    let drag = null;
    node.addEventListener('pointerdown', (event) => {
        event.stopPropagation();
        node.setPointerCapture(event.pointerId);
        drag = { back: node.classList.contains('back'), outside: false };
        lights.choose(index);
    });
    const move = (event, moving) => {
        if (!drag) return;
        lights.aim(index, aimed(event, drag), moving);
        place(node, index);
    };
    node.addEventListener('pointermove', (event) => move(event, true));
    node.addEventListener('pointerup', (event) => {
        move(event, false);
        drag = null;
    });
    place(node, index);
    return node;
}

// A handle being dragged is kept: it holds the pointer.
export function refresh() {
    if (!shown || layer.querySelector('.light-handle:active')) return;
    layer.replaceChildren(...lights.aimable().map(({ index, name }) => handle(index, name)));
}

export function show(on) {
    shown = on;
    layer.hidden = !on;
    refresh();
}
