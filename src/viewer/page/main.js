// SPDX-License-Identifier: MIT
// main.js - assembles the page.
import * as bench from './bench.js';
import * as camera from './camera.js';
import * as connection from './connection.js';
import * as film from './film.js';
import * as handles from './handles.js';
import { controls, download, el, valueText } from './knobs.js';
import * as lights from './lights.js';
import * as materials from './materials.js';
import * as stage from './stage.js';
import { base, begin, canRedo, canUndo, changed, message, onChange, redo, state, undo } from './state.js';
import * as truth from './truth.js';

const $ = (id) => document.getElementById(id);
let hello = null;
let facts = null;
let started = false;
let latencies = [];
let times = [];
let measured = 0; // the id whose first picture was measured
let failedId = 0; // of the last view that failed to render
const wanted = new Map(); // purpose of each pick in progress

const methodRow = (name) => hello.methods.find((m) => m.name === name);

// --- Panels -----------------------------------------------------------------------------------------------------------------------

function methodSelect(id, value, set, filter = () => true, none = null) {
    const options = hello.methods.filter(filter).map((m) => el('option', { value: m.name }, m.title));
    const select = el('select', { id }, ...(none ? [el('option', { value: '' }, none)] : []), ...options);
    select.value = value ?? '';
    select.addEventListener('change', () => set(select.value));
    return select;
}

// Defaults of a row, or those of as=paper.
const usual = (knobs) => (row) => (knobs().as === 'paper' && row.paper !== undefined ? row.paper : undefined);

function ignoredText(row) {
    return row.ignores?.length ? el('p', { className: 'ignored' }, `Ignored material inputs: ${row.ignores.join(', ')}.`) : null;
}

function buildMethod() {
    const row = methodRow(state.method);
    const set = (name) => {
        state.method = name;
        state.knobs = {};
        changed('method');
        buildMethod();
    };
    const knobs = controls(
        row?.knobs ?? [],
        () => state.knobs,
        (all, moving) => {
            const paper = all.as !== state.knobs.as;
            state.knobs = all;
            changed('knobs', moving);
            if (paper) buildMethod();
        },
        usual(() => state.knobs),
    );
    $('panel-method').replaceChildren(
        el('div', { className: 'field' }, el('label', { htmlFor: 'method' }, 'Method'), methodSelect('method', state.method, set)),
        el('p', { className: 'cite' }, row?.citation ?? ''),
        el('p', { className: 'note' }, row?.limits ?? ''),
        ignoredText(row ?? {}) ?? '',
        el(
            'div',
            { className: 'group' },
            el(
                'button',
                {
                    type: 'button',
                    id: 'knobs-reset',
                    onclick: () => {
                        state.knobs = {};
                        changed('knobs');
                        buildMethod();
                    },
                },
                'Defaults',
            ),
            row?.knobs.some((k) => k.name === 'as')
                ? el(
                      'button',
                      {
                          type: 'button',
                          id: 'knobs-paper',
                          onclick: () => {
                              state.knobs = { as: 'paper' };
                              changed('knobs');
                              buildMethod();
                          },
                      },
                      'As in the paper',
                  )
                : '',
        ),
        ...knobs,
    );
}

function buildImage() {
    $('panel-image').replaceChildren(
        ...(facts?.animated ? [timeLine()] : []),
        ...controls(
            hello.settings,
            () => state.settings,
            (all, moving) => {
                state.settings = all;
                changed('settings', moving);
            },
        ),
    );
}

function timeLine() {
    const input = el('input', { type: 'range', id: 'time', min: 0, max: 10, step: 0.02, value: state.time ?? 0 });
    const go = (moving) => {
        state.time = Number(input.value);
        changed('time', moving);
    };
    input.addEventListener('input', () => go(true));
    input.addEventListener('change', () => go(false));
    return el('div', { className: 'field' }, el('label', { htmlFor: 'time' }, 'Time of the animation, 0 to 10 s'), input);
}

const MODES = [
    ['single', 'One'],
    ['wipe', 'Wipe'],
    ['side', 'Side'],
    ['difference', 'Difference'],
    ['error', 'Error'],
];

function buildCompare() {
    const setOther = (name) => {
        state.other = name ? { method: name, knobs: {} } : null;
        if (name && state.mode === 'single') state.mode = 'wipe';
        if (!name) stage.forget(stage.KINDS.B);
        changed('other');
        buildCompare();
    };
    const setTruth = (name) => {
        state.truth = name || null;
        if (name && state.mode === 'single') state.mode = 'wipe';
        stage.forget(stage.KINDS.REFERENCE, stage.KINDS.ERROR_A, stage.KINDS.ERROR_B);
        changed('truth');
        buildCompare();
    };
    const other = state.other ? methodRow(state.other.method) : null;
    const modes = MODES.map(([value, label]) => {
        const input = el('input', {
            type: 'radio',
            name: 'mode',
            value,
            checked: state.mode === value,
            disabled: (value === 'error' && !state.truth) || (value !== 'single' && !state.truth && !state.other),
        });
        input.addEventListener('change', () => {
            state.mode = value;
            changed('mode');
        });
        return el('label', {}, input, label);
    });
    $('panel-compare').replaceChildren(
        el('fieldset', { className: 'choice' }, el('legend', {}, 'Show'), ...modes),
        el(
            'div',
            { className: 'field' },
            el('label', { htmlFor: 'truth' }, 'Reference'),
            methodSelect('truth', state.truth, setTruth, (m) => m.kind === 'reference', 'no reference'),
        ),
        el(
            'p',
            { className: 'note' },
            'The reference is rendered while nothing moves, at 640 × 360 or less. A sampled one accumulates, and its noise decreases.',
        ),
        el(
            'div',
            { className: 'field' },
            el('label', { htmlFor: 'other' }, 'Other method'),
            methodSelect('other', state.other?.method, setOther, () => true, 'no other'),
        ),
        ...(other
            ? [
                  el(
                      'div',
                      { className: 'group' },
                      el(
                          'button',
                          {
                              type: 'button',
                              id: 'swap',
                              onclick: () => {
                                  const { method, knobs } = state.other;
                                  state.other = { method: state.method, knobs: state.knobs };
                                  state.method = method;
                                  state.knobs = knobs;
                                  changed('method');
                                  buildMethod();
                                  buildCompare();
                              },
                          },
                          'Swap',
                      ),
                  ),
                  ...controls(
                      other.knobs,
                      () => state.other.knobs,
                      (all, moving) => {
                          state.other = { ...state.other, knobs: all };
                          changed('other', moving);
                      },
                      usual(() => state.other.knobs),
                  ),
              ]
            : []),
    );
}

function tabs() {
    const list = [...document.querySelectorAll('[role="tab"]')];
    const choose = (tab) => {
        for (const t of list) {
            t.setAttribute('aria-selected', String(t === tab));
            t.tabIndex = t === tab ? 0 : -1;
            $(t.getAttribute('aria-controls')).hidden = t !== tab;
        }
        handles.show(tab.id === 'tab-light');
    };
    for (const tab of list) {
        tab.addEventListener('click', () => choose(tab));
        tab.addEventListener('keydown', (event) => {
            const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
            if (!step) return;
            const next = list[(list.indexOf(tab) + step + list.length) % list.length];
            choose(next);
            next.focus();
        });
    }
}

// --- News -------------------------------------------------------------------------------------------------------------------------

function say(level, where, what, hint, field = null) {
    const text = `${where}: ${what}`;
    for (const node of [...$('messages').children]) if (node.dataset.text === text) node.remove();
    const node = el(
        'div',
        { className: `message ${level}`, 'data-text': text },
        el('div', {}, where ? el('b', {}, `${where}: `) : '', what, field, hint ? el('div', { className: 'hint' }, hint) : ''),
        el('button', { type: 'button', 'aria-label': 'Dismiss', onclick: () => node.remove() }, '×'),
    );
    $('messages').append(node);
    while ($('messages').childElementCount > 4) $('messages').firstElementChild.remove();
}

function tags() {
    const mode = document.getElementById('stage').dataset.mode;
    const right = state.other ? state.other.method : state.truth;
    $('tag-left').textContent =
        mode === 'difference'
            ? `${state.method} − ${right}, × 4`
            : mode === 'error'
              ? `${state.method}: relative error, ± 50 %`
              : state.method;
    $('tag-right').hidden = mode !== 'wipe' && mode !== 'side';
    $('tag-right').textContent = right ?? '';
}

const median = (list) => [...list].sort((a, b) => a - b)[Math.floor(list.length / 2)];

function measure(head) {
    const now = performance.now();
    times = [...times.filter((t) => now - t < 2000), now];
    if (head.sent !== undefined && head.id !== measured) latencies = [...latencies.slice(-30), now - head.sent];
    measured = head.id;
    window.pellucid = {
        frames: (window.pellucid?.frames ?? 0) + 1,
        latency: latencies.length ? median(latencies) : null,
        last: head,
    };
    $('status-size').textContent = `${head.width} × ${head.height}`;
    $('status-time').textContent =
        `${(head.ms + head.encode_ms).toFixed(0)} ms${times.length > 4 ? `, ${(times.length / 2).toFixed(0)} a second` : ''}`;
    $('status-latency').textContent = latencies.length ? `input to photon ${median(latencies).toFixed(0)} ms` : '';
}

async function show(head, file) {
    try {
        const finished = head.still && connection.isNewest(head.id);
        await stage.take(head, file, finished);
        stage.draw();
        tags();
        $('veil').hidden = true;
        if (head.picture === stage.KINDS.A) {
            if (head.id > failedId) for (const node of document.querySelectorAll('.message.error')) node.remove();
            measure(head);
            truth.showStages(head);
            const still = finished && connection.isNewest(head.id); // a view may have been requested while the file was decoded
            $('status-state').textContent = still ? 'Finished: same as pellucid render' : 'Refining';
            $('progress').hidden = still;
            $('stage').dataset.still = String(still);
            $('stage').dataset.id = String(head.id);
            if (still && film.filming()) await film.take(file);
        }
    } finally {
        connection.acknowledge(head.serial);
    }
}

function progress({ fraction }) {
    $('progress').hidden = false;
    $('progress').firstElementChild.style.transform = `scaleX(${fraction})`;
}

function start(given) {
    hello = given;
    $('title').textContent = `Pellucid  ${hello.input}`;
    document.title = `${hello.input} – Pellucid`;
    if (!started) {
        begin(hello.state);
        materials.build($('panel-material'), hello.materials);
        lights.build($('panel-light'));
        stage.listen({ onPick: (at) => pick(at, 'numbers'), onFocus: (at) => pick(at, 'focus') });
        onChange(apply);
        started = true;
    }
    buildMethod();
    buildImage();
    buildCompare();
    truth.waitForTruth();
    if (film.filming()) film.end();
    connection.view(() => message(), false);
}

function apply(what, moving) {
    $('undo').disabled = !canUndo();
    $('redo').disabled = !canRedo();
    if (what === 'all') {
        buildMethod();
        buildImage();
        buildCompare();
        materials.refresh(true);
        lights.refresh(true);
    }
    if (what === 'materials') materials.refresh(false);
    if (what === 'wipe' || what === 'mode') {
        stage.draw();
        tags();
        return;
    }
    for (const knob of document.querySelectorAll('.knob')) if (!knob.contains(document.activeElement) || !moving) knob.refresh();
    if (['camera', 'lights', 'materials', 'settings', 'time', 'all'].includes(what))
        stage.forget(stage.KINDS.REFERENCE, stage.KINDS.ERROR_A, stage.KINDS.ERROR_B);
    $('picked').hidden = true;
    truth.showRing(null, $('canvas'));
    truth.waitForTruth();
    $('status-state').textContent = moving ? 'Moving' : 'Refining';
    $('stage').dataset.still = 'false';
    if (['camera', 'lights', 'all'].includes(what)) handles.refresh();
    if (film.filming()) film.end();
    connection.view(() => message(), moving);
}

// --- Points -----------------------------------------------------------------------------------------------------------------------

function pick(at, why) {
    wanted.set(connection.ask({ type: 'pick', x: Math.max(0, Math.min(1, at.x)), y: Math.max(0, Math.min(1, at.y)) }), why);
}

function picked(p) {
    const why = wanted.get(p.id);
    for (const id of wanted.keys()) if (id <= p.id) wanted.delete(id);
    if (why === 'focus') {
        if (!p.at) return;
        camera.lookAt(p.at);
        changed('camera');
        return;
    }
    truth.showPicked(p);
    truth.showRing(p, $('canvas'));
}

// --- Files ------------------------------------------------------------------------------------------------------------------------

const stem = () => hello.input.replace(/\.[^.]*$/, '');
const quote = (text) => (/^[\w./:=,+@%-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

// What was taken back to its default, though the scene file sets it, must be said.
const said = (now, before, rows, usual = () => undefined) => ({
    ...Object.fromEntries(rows.filter((r) => r.name in before).map((r) => [r.name, usual(r) ?? valueText(r.default)])),
    ...now,
});

const savedName = () => `${hello.path.slice(0, hello.path.length - hello.input.length)}${stem()}-view.json`;
const mustBeSaved = (preset) => Boolean(state.camera || state.lights || (state.materials && !preset) || state.time !== null);
const chosenPreset = () =>
    state.materials && Object.keys(state.materials).length === 1 ? state.materials['*']?.preset : undefined;

// The method, its knobs and the settings; exposure and white as they were measured for this view.
function look() {
    const knobs = methodRow(state.method)?.knobs ?? [];
    const before = state.method === base.method ? base.knobs : {};
    const settings = said(state.settings, base.settings, hello.settings);
    const head = stage.picture(stage.KINDS.A)?.head;
    for (const key of ['exposure', 'white']) if (!(Number(settings[key]) > 0) && head?.[key] > 0) settings[key] = String(head[key]);
    return [
        ['-m', state.method],
        ...Object.entries(said(state.knobs, before, knobs, usual(() => state.knobs))).map(([key, value]) => ['--set', `${key}=${value}`]),
        ...Object.entries(settings).map(([key, value]) => [`--${key}`, value]),
    ];
}

// The command that renders this view. What no option can say is in the saved scene.
function command() {
    const preset = chosenPreset();
    const saved = mustBeSaved(preset);
    const options = hello.options.filter((o) => !(saved && o.saved) && !(state.materials && o.name === 'material'));
    const words = [
        'pellucid',
        'render',
        saved ? savedName() : hello.path,
        ...options.flatMap((o) => (o.value === null ? [`--${o.name}`] : [`--${o.name}`, o.value])),
        ...(preset && !saved ? ['--material', preset] : []),
        ...(saved ? [] : look().flat()),
    ];
    return [...words, '-o', `${stem()}.png`].map(quote).join(' ');
}

// One turn around the object. Any change during it cancels it.
function turntable() {
    const exposure = stage.picture(stage.KINDS.A)?.head.exposure ?? 0;
    if (film.filming()) return;
    say('', 'turntable', '36 images of a turn are drawn. Any change of the view ends it.', '');
    film.begin(
        exposure,
        (fraction) => progress({ fraction }),
        (file) => {
            if (file) download(file, `${stem()}-turntable.png`);
            else say('warning', 'turntable', 'ended before the turn was complete', '');
            $('progress').hidden = true;
            connection.view(() => message(), false);
        },
    );
}

// Browsers give no clipboard to pages of other machines without encryption, and may refuse it elsewhere: then the text can be copied by
// hand.
async function copy(text, what, hint = '') {
    try {
        await navigator.clipboard.writeText(text);
        say('', '', `${what} copied: ${text}`, hint);
    } catch {
        const field = el('input', { type: 'text', className: 'copy', readOnly: true, value: text, 'aria-label': what });
        say('', '', `${what}: the browser gives no access to the clipboard. Ctrl+C copies it:`, hint, field);
        field.focus();
        field.select();
    }
}

function copyCommand() {
    const hint = mustBeSaved(chosenPreset()) ? `It renders the scene that Save, Scene stores: keep it as ${savedName()}.` : '';
    copy(command(), 'Command line', hint);
}

function menu() {
    const item = (id, act) =>
        $(id).addEventListener('click', () => {
            $('save').open = false;
            act();
        });
    item('save-scene', () => connection.ask({ type: 'save', format: 'scene' }));
    item('save-exr', () => connection.ask({ type: 'save', format: 'exr' }));
    item('save-png', () => {
        const file = stage.stillFile();
        if (file) download(file, `${stem()}.png`);
        else say('', '', 'The image is not finished yet: try again when the status says so.', '');
    });
    item('save-film', turntable);
    item('save-report', () => connection.ask({ type: 'save', format: 'report' }));
    item('copy-command', copyCommand);
    item('copy-link', () => copy(location.href, 'Link'));
    $('undo').addEventListener('click', undo);
    $('redo').addEventListener('click', redo);
    $('help-button').addEventListener('click', () => $('help').showModal());
    document.addEventListener('click', (event) => {
        if (!$('save').contains(event.target)) $('save').open = false;
    });
    document.addEventListener('keydown', (event) => {
        const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(document.activeElement?.tagName) && document.activeElement.type !== 'range';
        if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === 'z' && !typing) {
            event.preventDefault();
            (event.shiftKey ? redo : undo)();
        } else if (event.key === '?' && !typing && !$('help').open) $('help').showModal();
        else if (event.key === 'Escape') $('save').open = false;
    });
    $('undo').disabled = $('redo').disabled = true;
}

connection.on('hello', start);
// One after the other: a small image is decoded faster than the large one before it, and must not be replaced by it.
let shown = Promise.resolve();
connection.on('picture', (head, file) => {
    shown = shown.then(() => show(head, file)).catch((fault) => say('error', 'image', fault.message, ''));
});
connection.on('progress', progress);
connection.on('message', (m) => say(m.level, m.where, m.what, m.hint));
connection.on('failed', ({ id }) => {
    failedId = id;
    $('status-state').textContent = 'The last valid image is kept';
    $('progress').hidden = true;
});
connection.on('rest', () => {
    $('progress').hidden = true;
});
connection.on('scene', (given) => {
    facts = given;
    camera.setFile(facts.camera, facts.bounds);
    materials.setFacts(facts);
    lights.setFile(facts.lights);
    handles.refresh();
    if (facts.animated) buildImage();
});
connection.on('truth', (t) => {
    truth.showTruth(t);
    stage.draw();
    tags();
});
connection.on('picked', picked);
connection.on('profile', bench.set);
const endings = { exr: '.exr', scene: '-view.json', report: '-report.html' };
connection.on('file', (head, file) =>
    endings[head.format] ? download(file, stem() + endings[head.format]) : bench.saveCode(head.format, file),
);
connection.on('unsaved', () => say('error', 'save', 'the file could not be made: see the messages', ''));
connection.on('closed', (reason) => {
    $('veil').hidden = false;
    $('veil').textContent = reason || 'The program has ended, or cannot be reached. Trying again.';
    $('status-state').textContent = 'Not connected';
});

tabs();
menu();
connection.connect();
$('stages-card').open = matchMedia('(min-width: 56rem)').matches;
