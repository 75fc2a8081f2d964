#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_layer_film.py PROGRAM ROOT: a sequence in which a layer grows from nothing to its full depth, by a sequence of depth maps."""
import json
import struct
import sys
import zlib

from cli_test import main, names, need, test, works

FRAMES = 5
PICTURE = ['--width', '40', '--height', '24', '--msaa', '1', '-q']
DARK = {'name': 'dark', 'sigma_s': [0, 0, 0], 'sigma_a': [2.5, 3.0, 4.0]}  # absorbs more than the medium that it replaces, everywhere
BRIGHT = {'name': 'bright', 'sigma_s': [2.0, 1.5, 1.0], 'sigma_a': [0.1, 0.1, 0.1]}


def write_grey(path, value):
    """4 x 4 texels of 16 bit."""
    def chunk(kind, body):
        return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
    rows = (b'\0' + struct.pack('>H', round(65535 * value)) * 4) * 4
    head = struct.pack('>IIBBBBB', 4, 4, 16, 0, 0, 0, 0)
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', head) + chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b''))


def write_layers(path, layers):
    path.write_text(json.dumps({
        'pellucid': 1, 'mesh': 'arm.obj', 'unit': '1mm', 'image_rate': FRAMES - 1,
        'camera': {'from': [10, -20, 60], 'to': [10, 10, 3], 'fov_deg': 30},
        'lights': [{'type': 'point', 'at': at, 'intensity': [5, 5, 5]} for at in ([-30, 40, 60], [20, 10, -40])],
        'materials': {'*': {'eta': 1.3, 'specular': {'rho_s': 0}, 'layers': layers}}, 'background': {'color': [0, 0, 0]},
        'render': {'method': 'layered'}}), 'utf-8')


def read_pfm(path):
    data = path.read_bytes()
    head = data.split(b'\n', 3)
    need(head[0] == b'PF' and float(head[2]) < 0, head[:3])
    return [v for v, in struct.iter_unpack('<f', head[3])]


def largest_difference(a, b):
    """The largest difference over the mean."""
    return max(abs(p - q) for p, q in zip(a, b)) * len(b) / sum(b)


@test('its first frame has no such layer, its last the whole, and every frame less light than the one before')
def _(folder):
    for i in range(FRAMES):
        write_grey(folder / f'depth_{i:04d}.png', i / (FRAMES - 1))
    write_layers(folder / 'film.json', [{**DARK, 'depth': 'depth_%04d.png#r', 'depth_scale': '2mm'}, BRIGHT])
    write_layers(folder / 'none.json', [BRIGHT])
    write_layers(folder / 'whole.json', [{**DARK, 'depth': '2mm'}, BRIGHT])
    works(folder, 'render', 'film.json', '--frames', f'0:1:{1 / (FRAMES - 1)}', '-o', 'film.pfm', *PICTURE)
    for name in ('none', 'whole'):
        works(folder, 'render', f'{name}.json', '-o', f'{name}.pfm', *PICTURE)
    need(len([n for n in names(folder) if n.startswith('film_')]) == FRAMES, names(folder))
    film = [read_pfm(folder / f'film_{i:04d}.pfm') for i in range(FRAMES)]
    none, whole = (read_pfm(folder / f'{name}.pfm') for name in ('none', 'whole'))
    need(largest_difference(film[0], none) < 1e-4, 'the first', largest_difference(film[0], none))
    need(largest_difference(film[-1], whole) < 1e-3, 'the last', largest_difference(film[-1], whole))
    need(largest_difference(none, whole) > 0.5, largest_difference(none, whole))
    for a, b in zip(film, film[1:]):
        need(sum(b) < 0.97 * sum(a), sum(a), sum(b))
        worst = max((q - p for p, q in zip(a, b)), default=0)
        need(worst <= 1e-3 * sum(a) / len(a), 'a pixel is brighter', worst)
    works(folder, 'render', 'film.json', '--frames', f'0:1:{1 / (FRAMES - 1)}', '--frame-range', '3:5', '-o', 'part.pfm', *PICTURE)
    need((folder / 'part_0004.pfm').read_bytes() == (folder / 'film_0004.pfm').read_bytes(), 'a part differs')


if __name__ == '__main__':
    sys.exit(main())
