// SPDX-License-Identifier: MIT
// knobs.js - elements of the page, and controls from rows of tables: name, unit, type, range, default, help. The rows come from the
// program.

export function el(tag, attributes = {}, ...children) {
    const node = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) {
        if (key.startsWith('on')) node.addEventListener(key.slice(2), value);
        else if (key in node && key !== 'list' && key !== 'form') node[key] = value;
        else if (value !== null && value !== undefined && value !== false) node.setAttribute(key, value);
    }
    node.append(...children.filter((c) => c !== null && c !== undefined));
    return node;
}

export function download(file, name) {
    const link = el('a', { href: URL.createObjectURL(file), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

let numbers = 0;

export const valueText = (value) =>
    Array.isArray(value) ? value.join(',') : value === true ? 'on' : value === false ? 'off' : String(value);
const isOn = (value) => ['on', 'true', 'yes', '1'].includes(value);

// Wide ranges get a logarithmic slider.
function scaleOf(row) {
    const { min, max } = row;
    const whole = row.type === 'int';
    const wide = min >= 0 && max / Math.max(min, whole ? 1 : 1e-4) > 500;
    const low = Math.max(min, whole ? 1 : Math.min(1e-4, max * 1e-6));
    const zero = min === 0;
    const round = (x) => (whole ? Math.round(x) : Number(x.toPrecision(3)));
    if (!wide) return { from: (x) => (x - min) / (max - min), to: (t) => round(min + t * (max - min)) };
    return {
        from: (x) => (x <= (zero ? low / 2 : low) ? 0 : Math.min(1, 0.03 + (0.97 * Math.log(x / low)) / Math.log(max / low))),
        to: (t) => (t < 0.02 ? min : round(low * (max / low) ** ((Math.max(t, 0.03) - 0.03) / 0.97))),
    };
}

// get() returns the text that is set, or undefined; set(text | undefined, moving).
export function control(row, get, set, fallback) {
    const id = `knob-${++numbers}`;
    const usual = () => fallback ?? valueText(row.default);
    const value = () => get() ?? usual();
    const head = el('div', { className: 'head' });
    const box = el('div', { className: 'knob', 'data-knob': row.name }, head);
    const name = el('label', { className: 'name', htmlFor: id }, row.name);
    const reset = el(
        'button',
        { type: 'button', className: 'reset', title: `Default: ${usual()}`, 'aria-label': `Reset ${row.name}` },
        '↺',
    );
    const parts = [];
    let show;

    head.append(name, reset);
    if (row.type === 'enum') {
        const select = el('select', { id }, ...row.choices.map((c) => el('option', { value: c }, c)));
        select.addEventListener('change', () => set(select.value, false));
        show = () => (select.value = value());
        head.append(select);
    } else if (row.type === 'bool') {
        const check = el('input', { type: 'checkbox', id });
        check.addEventListener('change', () => set(check.checked ? 'on' : 'off', false));
        show = () => (check.checked = isOn(value()));
        head.append(check);
    } else {
        const field = el('input', { type: 'text', id, inputMode: 'decimal', autocomplete: 'off', spellcheck: false });
        field.addEventListener('change', () => set(field.value.trim() || undefined, false));
        head.append(field);
        if (row.unit !== '1') head.append(el('span', { className: 'unit' }, row.unit));
        if (row.type !== 'rgb' && row.min !== null) {
            const scale = scaleOf(row);
            const slider = el('input', { type: 'range', min: 0, max: 1000, step: 1, 'aria-label': row.name });
            slider.addEventListener('input', () => set(String(scale.to(slider.value / 1000)), true));
            slider.addEventListener('change', () => set(String(scale.to(slider.value / 1000)), false));
            parts.push([slider, () => (slider.value = 1000 * scale.from(Number(value())))]);
            box.append(slider);
        }
        show = () => {
            field.value = value();
            for (const [, update] of parts) update();
        };
    }
    box.append(el('p', { className: 'help' }, row.help + (row.paper !== undefined ? ` (paper: ${row.paper})` : '')));
    reset.addEventListener('click', () => set(undefined, false));
    box.refresh = () => {
        show();
        const own = get() !== undefined && get() !== usual();
        box.classList.toggle('changed', own);
        reset.hidden = !own;
    };
    box.refresh();
    return box;
}

// Controls for rows whose values are texts in an object.
export function controls(rows, values, onSet, fallback = () => undefined) {
    return rows.map((row) =>
        control(
            row,
            () => values()[row.name],
            (value, moving) => {
                const all = { ...values() };
                if (value === undefined) delete all[row.name];
                else all[row.name] = value;
                onSet(all, moving);
            },
            fallback(row),
        ),
    );
}
