#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Renders the images of the convolution method for the guide, and measures the change from frame to frame of a rotating object.

    scripts/draw_convolution_sheets.py build/src/cli/pellucid BUNNY.obj docs/images
    scripts/draw_convolution_sheets.py --turn build/src/cli/pellucid BUNNY.obj

convolution-materials.png: the eight materials of figure 4 of the paper, on shapes of scripts/make_assets.py and a bunny;
convolution-hierarchical.png: apple, marble and orange juice as in its figure 6, then whole milk and jade: convolution above, hierarchical
below, and their difference four times as strong on grey;
convolution-truth.png: whole milk, marble and jade, convolution above, path-trace below.
--turn: 16 frames of a bunny that rotates by half a degree from one to the next. Standard library only.
"""
import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from draw_layer_sheets import above, side_by_side, read_png, write_png

LIGHTS = [{'type': 'point', 'at': ['-330mm', '450mm', '570mm'], 'intensity': [2.2, 2.1, 2.0]},
          {'type': 'point', 'at': ['400mm', '300mm', '-500mm'], 'intensity': [3.0, 3.0, 3.0]}]
FIGURE_4 = ['skimmilk', 'potato', 'apple', 'wholemilk', 'wax', 'ketchup', 'orange-juice', 'soap']
FIGURE_6 = ['apple', 'marble', 'orange-juice', 'wholemilk', 'jade']
FRAMES = 16
REFERENCE = ['-m', 'hierarchical', '--set', 'points=200000']
TRUTH = ['-m', 'path-trace', '--samples', '96', '--msaa', '1']
CONVOLUTION = ['-m', 'convolution']


class Studio:
    def __init__(self, program, work):
        self.program, self.work = str(Path(program).resolve()), Path(work)

    def render(self, mesh, material, options, width, height, form='png', turn=0.0):
        path = Path(mesh).resolve()
        link = self.work / path.name
        if not link.exists():
            link.symlink_to(path)
        corners = [list(map(float, line.split()[1:4])) for line in path.read_text('utf-8').splitlines() if line.startswith('v ')]
        middle = [-0.5 * (min(c[k] for c in corners) + max(c[k] for c in corners)) for k in range(3)]
        mesh = {'path': path.name, 'size': '70mm', 'translate': middle, 'rotate_deg': [0, turn, 0]}
        scene = {'pellucid': 1, 'meshes': [mesh], 'lights': LIGHTS, 'ground': False, 'materials': {'*': {'preset': material}},
                 'camera': {'from': [0, '60mm', '400mm'], 'to': [0, 0, 0], 'fov_deg': 12},
                 'render': {'width': width, 'height': height, 'msaa': 1 if form == 'pfm' else 4}}
        (self.work / 'scene.json').write_text(json.dumps(scene))
        subprocess.run([self.program, 'render', 'scene.json', *options, '--exposure', '1.2', '-q', '--allow-outside', '-o', f'out.{form}'],
                       cwd=self.work, check=True)
        return self.work / f'out.{form}'


def difference(a, b):
    return [bytes(min(max(128 + 4 * (x - y), 0), 255) for x, y in zip(p, q)) for p, q in zip(a, b)]


def in_row(pictures):
    row = pictures[0]
    for picture in pictures[1:]:
        row = side_by_side(row, picture, 3)
    return row


def draw(studio, bunny, images):
    shapes = ['bust', 'torus', 'fluted', 'cube']
    subprocess.run([sys.executable, str(Path(__file__).parent / 'make_assets.py'), str(studio.work), *shapes], check=True,
                   stdout=subprocess.DEVNULL)
    things = [bunny if i % 5 == 1 else studio.work / f'{shapes[i % 4]}.obj' for i in range(len(FIGURE_4))]
    sheet = [read_png(studio.render(thing, name, CONVOLUTION, 200, 200)) for thing, name in zip(things, FIGURE_4)]
    write_png(images / 'convolution-materials.png', above(in_row(sheet[:4]), in_row(sheet[4:]), 3))
    ours = [read_png(studio.render(bunny, name, CONVOLUTION, 180, 180)) for name in FIGURE_6]
    truth = [read_png(studio.render(bunny, name, REFERENCE, 180, 180)) for name in FIGURE_6]
    parts = [in_row(ours), in_row(truth), in_row([difference(a, b) for a, b in zip(ours, truth)])]
    write_png(images / 'convolution-hierarchical.png', above(above(parts[0], parts[1], 3), parts[2], 3))
    draw_truth(studio, bunny, images)


def draw_truth(studio, bunny, images):
    rows = [in_row([read_png(studio.render(bunny, name, options, 180, 180)) for name in ('wholemilk', 'marble', 'jade')])
            for options in (CONVOLUTION, TRUTH)]
    write_png(images / 'convolution-truth.png', above(rows[0], rows[1], 3))


def read_pfm(path):
    data = path.read_bytes()
    kind, size, scale = data.split(b'\n', 3)[:3]
    width, height = map(int, size.split())
    if kind != b'PF' or float(scale) >= 0:
        sys.exit(f'{path}: not three little-endian channels')
    return struct.unpack(f'<{3 * width * height}f', data[-12 * width * height:])


def turn(studio, bunny):
    """Change of the error against hierarchical while the object rotates: motion and glitter common to both cancel."""
    def frames(options):
        return [read_pfm(studio.render(bunny, 'wholemilk', options, 160, 160, 'pfm', 20 + 0.5 * i)) for i in range(FRAMES)]

    truth = frames(['-m', 'hierarchical', '--set', 'points=100000'])
    back = truth[0][0:3]
    there = [i + c for i in range(0, len(truth[0]), 3) if all(f[i:i + 3] != back for f in truth) for c in range(3)]
    level = sum(f[i] for f in truth for i in there) / (len(there) * FRAMES)
    for planes in (2, 4, 8):
        ours = frames(CONVOLUTION + ['--set', f'planes={planes}'])
        error = [[a[i] - b[i] for i in there] for a, b in zip(ours, truth)]
        size = [sum(map(abs, e)) / (len(e) * level) for e in error]
        steps = [sum(abs(y - x) for x, y in zip(a, b)) / (len(a) * level) for a, b in zip(error, error[1:])]
        means = [sum(e) / (len(e) * level) for e in error]
        print(f'{planes} planes: error {100 * sum(size) / FRAMES:.2f} % of the mean light; from frame to frame it changes by '
              f'{100 * sum(steps) / len(steps):.2f} %, at most {100 * max(steps):.2f} %; its mean by at most '
              f'{100 * max(abs(b - a) for a, b in zip(means, means[1:])):.3f} %')


def main():
    with tempfile.TemporaryDirectory() as work:
        if len(sys.argv) == 4 and sys.argv[1] == '--turn':
            turn(Studio(sys.argv[2], work), sys.argv[3])
        elif len(sys.argv) == 4:
            draw(Studio(sys.argv[1], work), sys.argv[2], Path(sys.argv[3]))
        else:
            sys.exit(__doc__)


if __name__ == '__main__':
    main()
