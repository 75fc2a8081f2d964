// SPDX-License-Identifier: MIT
// connection.js - the WebSocket: sends views, receives images and messages; reconnects when the connection is lost.

const handlers = new Map();
let socket = null;
let wait = 500;
let ids = 0;
let pending = null;
let scheduled = false;
let newest = 0; // the id of the last view that was sent; 0 while one waits
const sentAt = new Map();

export const on = (type, handler) => handlers.set(type, handler);
const tell = (type, ...about) => handlers.get(type)?.(...about);

export function connect() {
    const token = new URLSearchParams(location.search).get('token') ?? '';
    socket = new WebSocket(`ws://${location.host}/?token=${encodeURIComponent(token)}`, 'pellucid');
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
        wait = 500;
    };
    socket.onmessage = (event) => (typeof event.data === 'string' ? receive(JSON.parse(event.data)) : receiveFile(event.data));
    socket.onclose = (event) => {
        socket = null;
        tell('closed', event.reason);
        setTimeout(connect, wait);
        wait = Math.min(wait * 1.6, 8000);
    };
}

function receive(head) {
    tell(head.type, head);
}

function receiveFile(data) {
    const length = new DataView(data).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const file = new Blob([new Uint8Array(data, 4 + length)], { type: head.mime ?? 'application/octet-stream' });
    if (head.type === 'picture') {
        head.sent = sentAt.get(head.id);
        for (const id of sentAt.keys()) if (id < head.id) sentAt.delete(id);
    }
    tell(head.type, head, file);
}

function send(message) {
    if (socket?.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify(message));
    return true;
}

// Whether an image shows the currently requested view: one of an older view may still arrive.
export const isNewest = (id) => id === newest;

export const acknowledge = (serial) => send({ type: 'ack', serial });

// At most one view per refresh of the display; `makeState` returns the newest state then.
export function view(makeState, moving) {
    pending = { makeState, moving };
    newest = 0;
    if (scheduled) return;
    scheduled = true;
    requestAnimationFrame(() => {
        scheduled = false;
        const next = pending;
        const id = ++ids;
        newest = id;
        sentAt.set(id, performance.now());
        send({ type: 'view', id, moving: next.moving, state: next.makeState() });
    });
}

export function ask(message) {
    const id = ++ids;
    send({ ...message, id });
    return id;
}
