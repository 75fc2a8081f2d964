#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_bake_layers.py PROGRAM ROOT: `pellucid bake-layers`: depths of boxes in a box, the order of layers, a render of its output,
and refusals."""
import json
import struct
import sys
import zlib

from cli_test import BOX_FACES, main, names, need, one_object, run, test, text, works, write_box

def read_exr(path):
    """Channels of floats of a file with ZIP of 16 rows, as the program writes it: {name: rows}."""
    data = path.read_bytes()
    at, channels, window, compression = 8, [], None, None
    while data[at]:
        name, kind = (data[at:].split(b'\0', 2)[k].decode() for k in (0, 1))
        at += len(name) + len(kind) + 2
        size, = struct.unpack_from('<i', data, at)
        value = data[at + 4:at + 4 + size]
        at += 4 + size
        if name == 'channels':
            while value[0]:
                channel, value = value.split(b'\0', 1)
                need(struct.unpack_from('<i', value)[0] == 2, 'is not of 32 bit', channel)
                channels.append(channel.decode())
                value = value[16:]
        elif name == 'dataWindow':
            window = struct.unpack('<4i', value)
        elif name == 'compression':
            compression = value[0]
    width, height = window[2] + 1, window[3] + 1
    need(compression == 3, compression)
    rows = {c: [] for c in channels}
    for block, in struct.iter_unpack('<Q', data[at + 1:at + 1 + 8 * ((height + 15) // 16)]):
        first, size = struct.unpack_from('<ii', data, block)
        count, packed = min(16, height - first), data[block + 8:block + 8 + size]
        whole = 4 * len(channels) * width * count
        if size < whole:
            raw = bytearray(zlib.decompress(packed))
            for i in range(1, len(raw)):
                raw[i] = (raw[i - 1] + raw[i] - 128) & 255
            half = (len(raw) + 1) // 2
            packed = bytes(raw[i // 2 + (half if i & 1 else 0)] for i in range(len(raw)))
        for row in range(count):
            for k, c in enumerate(sorted(channels)):
                rows[c].append(struct.unpack_from(f'<{width}f', packed, 4 * width * (len(channels) * row + k)))
    return rows


def at_face(rows, name, a, b):
    """The texel at fractions of a face's corners 0 -> 1 and 0 -> 3."""
    i, size = list(BOX_FACES).index(name), len(rows)
    u, v = i % 3 / 3 + 0.02 + 0.29 * a, i // 3 / 2 + 0.02 + 0.46 * b
    return rows[int((1 - v) * size)][int(u * size)]


def near(value, expected, what):
    need(abs(value - expected) < 1e-3, what, value, expected)


@test('a vessel in tissue: body, vessel, body, as deep as it lies from each side, and a render of it')
def _(folder):
    write_box(folder / 'arm.obj', (0, 0, 0), (20, 20, 6))
    write_box(folder / 'vein.obj', (-1, 8, 3), (21, 12, 5))  # a hole through the object, nearer to the top
    given = ['bake-layers', 'arm.obj', '--unit', '1mm', '--inner', 'vein=vein.obj', '-o', 'out', '--map-size', '96', '--json']
    answer = one_object(works(folder, *given))
    need([x['name'] for x in answer['layers']] == ['body', 'vein', 'body'], answer)
    need(answer['shared'] == 0 and answer['cut'] == 0 and answer['open'] == 0 and not answer['warnings'], answer)
    need(sorted(p.name for p in (folder / 'out').iterdir()) == ['layers-0.exr', 'scene.json'], names(folder))
    maps = read_exr(folder / 'out/layers-0.exr')
    for face, above, below in (('top', 1.0, 3.0), ('bottom', 3.0, 5.0)):
        near(at_face(maps['R'], face, 0.5, 0.5), above, face)
        near(at_face(maps['G'], face, 0.5, 0.5), below, face)
    near(at_face(maps['R'], 'front', 0.5, 4 / 6), 8.0, 'front')
    near(at_face(maps['G'], 'front', 0.5, 4 / 6), 12.0, 'front')
    near(at_face(maps['R'], 'left', 4 / 6, 0.5), 0.0, 'the vein begins at the surface')
    near(at_face(maps['G'], 'left', 4 / 6, 0.5), 20.0, 'and goes to the other side')
    for b in (0.1, 0.9):  # no vein: zero thickness, at the depth of the vein nearby
        near(at_face(maps['R'], 'top', 0.5, b), 2.0, 'beside the vein')
        near(at_face(maps['G'], 'top', 0.5, b), 2.0, 'beside the vein')
    scene = json.loads((folder / 'out/scene.json').read_text('utf-8'))
    layers = scene['materials']['*']['layers']
    need(scene['mesh'] == '../arm.obj' and scene['unit'] == '1mm' and scene['materials']['*']['depth_scale'] == '1mm', scene)
    need([x.get('depth') for x in layers] == ['layers-0.exr#r', 'layers-0.exr#g', None], layers)
    shown = text(works(folder, 'check', 'out/scene.json', '--allow-outside').stdout)
    need('0 problems' in shown, shown)
    works(folder, 'render', 'out/scene.json', '--allow-outside', '--width', '32', '--height', '18', '-o', 'arm.png', '-q')


@test('the last of meshes in each other counts; a mesh of several parts has several pairs; --down-to ends all')
def _(folder):
    write_box(folder / 'arm.obj', (0, 0, 0), (20, 20, 6))
    write_box(folder / 'bone.obj', (2, 2, 1), (18, 18, 5))
    write_box(folder / 'marrow.obj', (4, 4, 2), (16, 16, 4))
    given = ['bake-layers', 'arm.obj', '--unit', '1mm', '--map-size', '96', '--json']
    answer = one_object(works(folder, *given, '--inner', 'bone=bone.obj', '--inner', 'marrow=marrow.obj', '-o', 'two'))
    need([x['name'] for x in answer['layers']] == ['body', 'bone', 'marrow', 'bone', 'body'], answer)
    maps = read_exr(folder / 'two/layers-0.exr')
    for channel, depth in zip('RGBA', (1, 2, 4, 5)):
        near(at_face(maps[channel], 'top', 0.5, 0.5), depth, channel)
    one = (folder / 'bone.obj').read_text()
    write_box(folder / 'marrow.obj', (2, 2, 5.25), (18, 18, 5.5))
    other = (folder / 'marrow.obj').read_text()
    shift = 8

    def moved(line):
        return 'f ' + ' '.join(str(int(w.split('/')[0]) + shift) for w in line.split()[1:]) if line.startswith('f') else line
    (folder / 'both.obj').write_text('\n'.join(x.split('/')[0] if x.startswith('v ') else x for x in one.splitlines() if x[:2] != 'vt' and
                                               not x.startswith('f')) + '\n' +
                                     '\n'.join(x for x in other.splitlines() if x.startswith('v ')) + '\n' +
                                     '\n'.join('f ' + ' '.join(w.split('/')[0] for w in x.split()[1:])
                                               for x in one.splitlines() if x.startswith('f')) + '\n' +
                                     '\n'.join(moved(x) for x in other.splitlines() if x.startswith('f')) + '\n')
    answer = one_object(works(folder, *given, '--inner', 'bone=both.obj', '-o', 'pairs', '--down-to', '3mm'))
    need([x['name'] for x in answer['layers']] == ['body', 'bone', 'body', 'bone', 'body'], answer)
    maps = read_exr(folder / 'pairs/layers-0.exr')
    for channel, depth in zip('RGBA', (0.5, 0.75, 1, 3)):
        near(at_face(maps[channel], 'top', 0.5, 0.5), depth, channel)


@test('what is wrong is refused by name, and nothing is left behind')
def _(folder):
    write_box(folder / 'arm.obj', (0, 0, 0), (20, 20, 6))
    write_box(folder / 'vein.obj', (-1, 8, 3), (21, 12, 5))
    write_box(folder / 'bare.obj', (0, 0, 0), (20, 20, 6), uv=False)
    write_box(folder / 'wide.obj', (0, 0, 0), (20, 20, 6), size=1.5)
    (folder / 'broken.obj').write_bytes(b'f 1 2 9999999999\nv nan 1\n\xff')
    (folder / 'scene.json').write_text('{}')
    arm = ['bake-layers', 'arm.obj', '--unit', '1mm']
    vein = ['--inner', 'vein=vein.obj']
    for words, code, message in (
            ([*arm, '-o', 'out'], 2, '--inner'), ([*arm, *vein], 2, '--output'), ([*arm, '--inner', 'vein.obj', '-o', 'out'], 2, '--inner'),
            ([*arm, *vein, *vein, '-o', 'out'], 2, 'twice'), ([*arm, '--inner', 'body=vein.obj', '-o', 'out'], 2, 'body'),
            ([*arm, '--inner', '=vein.obj', '-o', 'out'], 2, '--inner'), ([*arm, *vein, '--map-size', '1e9', '-o', 'out'], 2, 'map-size'),
            ([*arm, *vein, '--down-to', '3', '-o', 'out'], 2, 'unit'), ([*arm, '--inner', 'vein=none.obj', '-o', 'out'], 3, 'none.obj'),
            ([*arm, '--inner', 'vein=broken.obj', '-o', 'out'], 3, 'broken.obj'), ([*arm, *vein, '-o', 'arm.obj'], 3, 'not a folder'),
            (['bake-layers', 'arm.obj', *vein, '-o', 'out'], 2, 'unit'), (['bake-layers', 'scene.json', *vein, '-o', 'out'], 2, 'scene'),
            (['bake-layers', 'bare.obj', '--unit', '1mm', *vein, '-o', 'out'], 3, 'texture coordinates'),
            (['bake-layers', 'wide.obj', '--unit', '1mm', *vein, '-o', 'out'], 3, 'texture coordinate'),
            ([*arm, *vein, '--map-size', '4096', '--limit', 'memory-bytes=67108864', '-o', 'out'], 5, 'memory')):
        done = run(folder, *words)
        need(done.returncode == code and message in text(done.stderr) and not done.stdout, words, done.returncode, text(done.stderr))
    need(not [n for n in names(folder) if n.startswith('out') or 'partial' in n], names(folder))
    write_box(folder / 'far.obj', (50, 0, 0), (60, 10, 6))
    answer = one_object(works(folder, *arm, '--inner', 'far=far.obj', '--map-size', '32', '-o', 'none', '--json'))
    need([x['name'] for x in answer['layers']] == ['body'] and any('no ray hits' in w for w in answer['warnings']), answer)
    works(folder, 'check', 'none/scene.json', '--allow-outside')
    whole = (folder / 'arm.obj').read_text()
    (folder / 'arm.obj').write_text(whole[:whole.rindex('f ')])  # without its front
    answer = one_object(works(folder, *arm, *vein, '--map-size', '32', '-o', 'out', '--json'))
    need(answer['open'] > 0 and any('not closed' in w for w in answer['warnings']), answer)


if __name__ == '__main__':
    sys.exit(main())
