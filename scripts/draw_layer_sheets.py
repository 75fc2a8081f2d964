#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Renders the images of painted layers for the guide.

    scripts/draw_layer_sheets.py build/src/cli/pellucid build/examples docs/images [single-scatter]

fish-lights.png: the fish under its light behind, beneath, in front, and all three; fish-cross-section.png: the layers below a line on it;
painted-layers.png: a backlit leaf, a gecko, and veins below the skin of a head; fish-settings.png: the three lamps, by the
fish's own coefficients and with skin and blood four times as clear (the paper's figure 13); fish-samples.png: 10, 20, 50, 100 and 400
samples, below 16 times their difference to 400, as best and as the paper (figure 14). Standard library only.
With single-scatter, fish-single-scatter.png alone, which takes many minutes: the relative error against that reference of one even layer,
of painted ones, and of these seen from so near that a pixel is about a texel.
"""
import json
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path


def chunks(data):
    at = 8
    while at < len(data):
        size, = struct.unpack('>I', data[at:at + 4])
        yield data[at + 4:at + 8], data[at + 8:at + 8 + size]
        at += 12 + size


def read_png(path):
    """Rows of red, green, blue of an 8-bit image written by the program."""
    head, body = b'', b''
    for name, data in chunks(path.read_bytes()):
        head = data if name == b'IHDR' else head
        body += data if name == b'IDAT' else b''
    width, height, bits, kind = struct.unpack('>IIBB', head[:10])
    if bits != 8 or kind != 2:
        sys.exit(f'{path}: {bits} bits of kind {kind}, 8-bit colour is read')
    raw, stride, above, rows = zlib.decompress(body), 3 * width, bytes(3 * width), []
    for y in range(height):
        filter_type, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            a, b, c = line[i - 3] if i > 2 else 0, above[i], above[i - 3] if i > 2 else 0
            p = a + b - c
            near = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            line[i] = (line[i] + (0, a, b, (a + b) // 2, near)[filter_type]) & 255
        above = bytes(line)
        rows.append(above)
    return rows


def write_png(path, rows):
    def chunk(name, data):
        return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))

    stride, above, packed = len(rows[0]), bytes(len(rows[0])), b''
    for row in rows:
        packed += b'\2' + bytes((a - b) & 255 for a, b in zip(row, above))
        above = row
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', stride // 3, len(rows), 8, 2, 0, 0, 0)) +
                     chunk(b'sRGB', b'\0') + chunk(b'IDAT', zlib.compress(packed, 9)) + chunk(b'IEND', b''))


def side_by_side(left, right, gap=6):
    return [a + b'\xff' * (3 * gap) + b for a, b in zip(left, right)]


def above(top, bottom, gap=6):
    return top + [b'\xff' * len(top[0])] * gap + bottom


class Sheets:
    def __init__(self, program, examples, images, work):
        self.program, self.examples = str(Path(program).resolve()), Path(examples).resolve()
        self.images, self.work = Path(images), Path(work)

    def picture(self, name, width, height, lights=None, exposure=1.0, clear=1.0, knobs=()):
        """`lights`: indices of the active lights; exposure: a factor of the scene's; clear: divisor of the upper two layers'
        coefficients."""
        scene = json.loads((self.examples / f'{name}.json').read_text('utf-8'))
        scene['lights'] = [scene['lights'][i] for i in lights] if lights else scene['lights']
        scene['render']['exposure'] *= exposure
        for layer in next(iter(scene['materials'].values()))['layers'][:2 if clear != 1.0 else 0]:
            for key in ('sigma_s', 'sigma_t'):
                layer[key] = [x / clear for x in layer[key]]
        self.furnish()
        (self.work / 'sheet.json').write_text(json.dumps(scene))
        subprocess.run([self.program, 'render', 'sheet.json', '--width', str(width), '--height', str(height), '--msaa', '8', '-q',
                        '--allow-outside', '-o', 'sheet.png', *(word for knob in knobs for word in ('--set', knob))],
                       cwd=self.work, check=True)
        return read_png(self.work / 'sheet.png')

    def samples(self):
        """Differences are of display values, in steps of 1/255."""
        rows = []
        for form, exposure in (('as=best', 1.0), ('as=paper', 0.3)):
            of = {n: self.picture('fish', 240, 130, exposure=exposure, knobs=(form, f'samples={n}')) for n in (10, 20, 50, 100, 400)}
            differences = {n: [bytes(min(255, 16 * abs(a - b)) for a, b in zip(x, y)) for x, y in zip(of[n], of[400])] for n in of}
            for pictures in (of, differences):
                row = pictures[10]
                for n in (20, 50, 100, 400):
                    row = side_by_side(row, pictures[n])
                rows.append(row)
        sheet = rows[0]
        for row in rows[1:]:
            sheet = above(sheet, row)
        return sheet

    def settings(self):
        rows = []
        for clear in (1.0, 4.0):
            row = [self.picture('fish', 330, 177, [k], exposure, clear) for k, exposure in ((0, 1.3), (1, 2.2), (2, 1.2))]
            rows.append(side_by_side(side_by_side(row[0], row[1]), row[2]))
        return above(rows[0], rows[1])

    def error(self, scene, most=0.5):
        """Blue where `layered` is too dark, red where it is too bright, at full saturation for this fraction of the reference; 10 x 10
        for each pixel."""
        (self.work / 'sheet.json').write_text(json.dumps(scene))
        lights = []
        for method, knobs in (('layered', ()), ('single-scatter', ('error=0.06', 'most=4096'))):
            subprocess.run([self.program, 'render', 'sheet.json', '-m', method, '--width', '72', '--height', '40', '--msaa', '1', '-q',
                            '--allow-outside', '-o', 'sheet.pfm', *(word for knob in knobs for word in ('--set', knob))],
                           cwd=self.work, check=True)
            values = struct.unpack(f'<{72 * 40 * 3}f', (self.work / 'sheet.pfm').read_bytes()[-72 * 40 * 12:])
            lights.append([sum(values[i:i + 3]) for i in range(0, len(values), 3)])
        rows = []
        for y in range(39, -1, -1):  # PFM rows start at the bottom
            row = b''
            for mine, other in zip(*(light[72 * y:72 * y + 72] for light in lights)):
                error = max(-1.0, min(1.0, (mine / other - 1) / most)) if other > 0 else 0.0
                end = (180, 4, 38) if error > 0 else (59, 76, 192)
                row += bytes(round(221 + abs(error) * (c - 221)) for c in end) * 10
            rows += [row] * 10
        return rows

    def single_scatter(self):
        fish = json.loads((self.examples / 'fish.json').read_text('utf-8'))
        fish['background'] = {'color': [0, 0, 0]}
        body = fish['materials']['Fish']
        body['layers'] = body['layers'][:3]
        body['specular']['rho_s'] = 0.0
        del body['textures']
        one, near = (json.loads(json.dumps(fish)) for _ in range(2))
        body = one['materials']['Fish']
        body.update(layers=body['layers'][:1], below='last')
        del body['depths'], body['depth_scale']
        near['camera'].update({'from': [20, 6, 420], 'to': [38, 1, 0], 'fov_deg': 0.9})
        self.furnish()
        return above(above(self.error(one), self.error(fish)), self.error(near))

    def furnish(self):
        for path in self.examples.glob('*'):
            if path.is_file() and not (self.work / path.name).exists():
                (self.work / path.name).symlink_to(path)

    def draw(self):
        if len(sys.argv) > 4:
            write_png(self.images / 'fish-single-scatter.png', self.single_scatter())
            return
        write_png(self.images / 'fish-samples.png', self.samples())
        write_png(self.images / 'fish-settings.png', self.settings())
        behind, beneath, front, every = (self.picture('fish', 470, 252, lights, exposure) for lights, exposure in
                                         (([0], 1.3), ([1], 2.2), ([2], 1.2), (None, 1.0)))
        write_png(self.images / 'fish-lights.png', above(side_by_side(behind, beneath), side_by_side(front, every)))
        leaf, gecko = (self.picture(name, 560, 300) for name in ('leaf', 'gecko'))
        write_png(self.images / 'painted-layers.png', side_by_side(above(leaf, gecko), self.picture('veins', 606, 606)))
        subprocess.run([self.program, 'check', str(self.examples / 'fish.json'), '-q', '--cross-section',
                        str(self.images / 'fish-cross-section.png'), '--line', '0.33,0.12,0.33,0.85', '--down-to', '1.5mm'],
                       check=True, stdout=subprocess.DEVNULL)


def draw_all(sheets, usage, more=()):
    """`more`: optional words after the three arguments."""
    if len(sys.argv) not in (4, 4 + bool(more)) or any(word not in more for word in sys.argv[4:]):
        sys.exit(usage)
    with tempfile.TemporaryDirectory() as work:
        sheets(*sys.argv[1:4], work).draw()


if __name__ == '__main__':
    draw_all(Sheets, __doc__, ('single-scatter',))
