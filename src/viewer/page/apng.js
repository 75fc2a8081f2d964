// SPDX-License-Identifier: MIT
// apng.js - combines PNG files of one size into one animated PNG that loops for ever (W3C, Portable Network Graphics, third edition).

const HEAD = 8; // bytes of the signature

const table = new Uint32Array(256).map((_, n) => {
    for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
    return n;
});
const crc = (bytes) => (bytes.reduce((c, byte) => table[(c ^ byte) & 255] ^ (c >>> 8), 0xffffffff) ^ 0xffffffff) >>> 0;

function chunk(type, ...parts) {
    const size = parts.reduce((sum, part) => sum + part.length, 0);
    const out = new Uint8Array(size + 12);
    const view = new DataView(out.buffer);
    view.setUint32(0, size);
    [...type].forEach((letter, i) => (out[4 + i] = letter.charCodeAt(0)));
    let at = 8;
    for (const part of parts) {
        out.set(part, at);
        at += part.length;
    }
    view.setUint32(at, crc(out.subarray(4, at)));
    return out;
}

function numbers(...fields) {
    const out = new Uint8Array(fields.reduce((sum, [bytes]) => sum + bytes, 0));
    const view = new DataView(out.buffer);
    let at = 0;
    for (const [bytes, value] of fields) {
        if (bytes === 4) view.setUint32(at, value);
        else if (bytes === 2) view.setUint16(at, value);
        else view.setUint8(at, value);
        at += bytes;
    }
    return out;
}

// [type, content, whole chunk] of each.
function* chunks(file) {
    const view = new DataView(file.buffer, file.byteOffset);
    for (let at = HEAD; at + 12 <= file.length; ) {
        const size = view.getUint32(at);
        const type = String.fromCharCode(...file.subarray(at + 4, at + 8));
        yield [type, file.subarray(at + 8, at + 8 + size), file.subarray(at, at + 12 + size)];
        at += size + 12;
    }
}

// `ms`: duration of each frame.
export async function animate(files, ms) {
    const frames = await Promise.all(files.map(async (file) => new Uint8Array(await file.arrayBuffer())));
    const size = new DataView(frames[0].buffer, HEAD + 8);
    const [width, height] = [size.getUint32(0), size.getUint32(4)];
    const out = [frames[0].subarray(0, HEAD)];
    let sequence = 0;
    let begun = false;
    const control = () =>
        chunk('fcTL', numbers([4, sequence++], [4, width], [4, height], [4, 0], [4, 0], [2, Math.round(ms)], [2, 1000], [1, 0], [1, 0]));
    for (const [type, , whole] of chunks(frames[0])) {
        if (type === 'IEND') break;
        if (type === 'IDAT' && !begun) {
            out.push(chunk('acTL', numbers([4, frames.length], [4, 0])), control());
            begun = true;
        }
        out.push(whole);
    }
    for (const frame of frames.slice(1)) {
        out.push(control());
        for (const [type, content] of chunks(frame)) if (type === 'IDAT') out.push(chunk('fdAT', numbers([4, sequence++]), content));
    }
    out.push(chunk('IEND'));
    return new Blob(out, { type: 'image/png' });
}
