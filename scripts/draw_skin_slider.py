#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws the colours that tests/optics/skin_slider prints.

    ninja -C build tests/optics/skin_slider
    scripts/draw_skin_slider.py build/tests/optics/skin_slider docs/images/skin-slider.png

Two sheets, one per thickness of the epidermis: melanin rises downwards, haemoglobin to the right; right of each the published skins (left
halves) next to the nearest colours of the model (right halves). Standard library only.
"""
import struct
import subprocess
import sys
import zlib

CELL, GAP, TOP, LEFT = 44, 3, 58, 60
GREY = (118, 118, 118)
# Glyphs of 3 x 5 dots, rows from the top.
FONT = {
    '0': (7, 5, 5, 5, 7), '1': (2, 6, 2, 2, 7), '2': (7, 1, 7, 4, 7), '3': (7, 1, 7, 1, 7), '4': (5, 5, 7, 1, 1), '5': (7, 4, 7, 1, 7),
    '6': (7, 4, 7, 5, 7), '7': (7, 1, 1, 2, 2), '8': (7, 5, 7, 5, 7), '9': (7, 5, 7, 1, 7), '.': (0, 0, 0, 0, 2), ' ': (0, 0, 0, 0, 0),
    'a': (2, 5, 7, 5, 5), 'b': (6, 5, 6, 5, 6), 'd': (6, 5, 5, 5, 6), 'e': (7, 4, 6, 4, 7), 'g': (3, 4, 5, 5, 3), 'h': (5, 5, 7, 5, 5),
    'i': (7, 2, 2, 2, 7), 'l': (4, 4, 4, 4, 7), 'm': (5, 7, 7, 5, 5), 'n': (6, 5, 5, 5, 5), 'o': (2, 5, 5, 5, 2), 'p': (6, 5, 6, 4, 4),
    'r': (6, 5, 6, 5, 5), 's': (3, 4, 2, 1, 6), 'u': (5, 5, 5, 5, 7),
}


def encode(linear):
    v = min(max(linear, 0.0), 1.0)
    return round(255 * (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055))


class Picture:
    def __init__(self, width, height):
        self.width, self.height, self.rows = width, height, [bytearray(bytes(GREY) * width) for _ in range(height)]

    def box(self, x, y, w, h, color):
        for row in self.rows[y:y + h]:
            row[3 * x:3 * (x + w)] = bytes(color) * w

    def text(self, x, y, words, scale=3):
        for letter in words:
            for j, bits in enumerate(FONT[letter]):
                for i in range(3):
                    if bits >> (2 - i) & 1:
                        self.box(x + i * scale, y + j * scale, scale, scale, (255, 255, 255))
            x += 4 * scale

    def save(self, path):
        def chunk(kind, data):
            return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
        data = zlib.compress(b''.join(b'\0' + bytes(row) for row in self.rows), 9)
        with open(path, 'wb') as file:
            file.write(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', self.width, self.height, 8, 2, 0, 0, 0))
                       + chunk(b'sRGB', b'\0') + chunk(b'IDAT', data) + chunk(b'IEND', b''))


def main():
    lines = subprocess.run([sys.argv[1]], capture_output=True, text=True, check=True).stdout.splitlines()
    sheets = [[float(v) for v in line.split()[1:]] for line in lines if line.startswith('sheet')]
    published = [[float(v) for v in line.split('#')[0].split()[1:]] for line in lines if line.startswith('published')]
    thicknesses = sorted({s[0] for s in sheets})
    melanin, blood = sorted({s[1] for s in sheets}), sorted({s[2] for s in sheets})
    panel = LEFT + len(blood) * (CELL + GAP) + 40 + 2 * CELL + 30
    p = Picture(panel * len(thicknesses) + 10, TOP + len(melanin) * (CELL + GAP) + 40)
    for k, thickness in enumerate(thicknesses):
        x0 = k * panel
        p.text(x0 + LEFT, 8, f'epidermis {thickness:g} mm')
        p.text(x0 + LEFT + len(blood) * (CELL + GAP) + 40, 34, 'published', 2)
        p.text(x0 + LEFT, TOP + len(melanin) * (CELL + GAP) + 20, 'haemoglobin', 2)
        p.text(x0 + 6, TOP - 14, 'melanin', 2)
        for i, m in enumerate(melanin):
            p.text(x0 + 10, TOP + i * (CELL + GAP) + 16, f'{m:g}', 2)
        for j, h in enumerate(blood):
            p.text(x0 + LEFT + j * (CELL + GAP), TOP + len(melanin) * (CELL + GAP) + 4, f'{h:g}', 2)
        for t, m, h, *rgb in sheets:
            if t == thickness:
                p.box(x0 + LEFT + blood.index(h) * (CELL + GAP), TOP + melanin.index(m) * (CELL + GAP), CELL, CELL, list(map(encode, rgb)))
        for i, (_, *rgb) in enumerate([row for row in published if row[0] == thickness]):
            x, y = x0 + LEFT + len(blood) * (CELL + GAP) + 40, TOP + i * (CELL + GAP)
            p.box(x, y, CELL, CELL, list(map(encode, rgb[:3])))
            p.box(x + CELL, y, CELL, CELL, list(map(encode, rgb[3:])))
    p.save(sys.argv[2])


if __name__ == '__main__':
    main()
