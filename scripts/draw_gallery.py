#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Renders the pictures that the README opens with.

    scripts/draw_gallery.py build/src/cli/pellucid BUNNY.obj build/examples docs/images

backlight.png: a bunny of 70 mm with a lamp behind it, of whole milk, jade, wax, skimmed milk, soap and marble, by convolution;
methods.png: the one of wax without scattering, by screen-space, image-space and texture-space; by convolution, hierarchical and
path-trace; and veins below the skin of a head, by layered. Standard library only.
"""
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from draw_layer_sheets import above, beside, read_png, write_png

MATERIALS = ['wholemilk', 'jade', 'wax', 'skimmilk', 'soap', 'marble']
METHODS = [['none'], ['screen-space'], ['image-space', 'samples=64', 'views=eye+lights'], ['texture-space'], ['convolution'],
           ['hierarchical'], ['path-trace', 'samples=384']]
LIGHTS = [{'type': 'rect', 'at': ['90mm', '150mm', '-170mm'], 'to': [0, '30mm', 0], 'width': '50mm', 'height': '50mm',
           'radiance': [360, 320, 265]},
          {'type': 'rect', 'at': ['-260mm', '190mm', '190mm'], 'to': [0, '30mm', 0], 'width': '120mm', 'height': '120mm',
           'radiance': [3.0, 3.4, 4.0]}]
CAMERA = {'from': ['40mm', '60mm', '330mm'], 'to': ['2mm', '33mm', 0], 'fov_deg': 14.5}
BACKGROUND = {'color': [0.02, 0.022, 0.027], 'ground': {'opaque': True, 'color': [0.08, 0.085, 0.095], 'roughness': 0.5}}


class Gallery:
    def __init__(self, program, bunny, examples, images, work):
        self.program, self.examples, self.images, self.work = str(Path(program).resolve()), Path(examples), Path(images), Path(work)
        corners = [list(map(float, line.split()[1:4])) for line in Path(bunny).read_text('utf-8').splitlines() if line.startswith('v ')]
        low, high = ([side(c[k] for c in corners) for k in range(3)] for side in (min, max))
        self.mesh = {'path': 'bunny.obj', 'size': '70mm', 'translate': [-0.5 * (low[0] + high[0]), -low[1], -0.5 * (low[2] + high[2])]}
        shutil.copyfile(bunny, self.work / 'bunny.obj')

    def render(self, scene, method, width, height, *options):
        knobs = [word for knob in method[1:] for word in ('--set', knob)]
        subprocess.run([self.program, 'render', scene, '-m', method[0], *knobs, '--width', str(width), '--height', str(height), '-q',
                        *options, '-o', self.work / 'out.png'], cwd=self.work, check=True)
        return read_png(self.work / 'out.png')

    def bunny(self, material, method, width, height):
        scene = {'pellucid': 1, 'meshes': [self.mesh], 'camera': CAMERA, 'lights': LIGHTS, 'background': BACKGROUND,
                 'materials': {'*': {'preset': material}}}
        (self.work / 'scene.json').write_text(json.dumps(scene))
        samples = '1' if method[0] == 'path-trace' else '8'
        return self.render('scene.json', method, width, height, '--msaa', samples, '--light-samples', '64', '--exposure', '1.3')

    def draw(self):
        sheet = [self.bunny(name, ['convolution'], 400, 340) for name in MATERIALS]
        write_png(self.images / 'backlight.png', above(in_row(sheet[:3]), in_row(sheet[3:])))
        sheet = [self.bunny('wax', method, 300, 255) for method in METHODS]
        sheet.append(self.render(str((self.examples / 'veins.json').resolve()), ['layered'], 300, 255, '--msaa', '8'))
        write_png(self.images / 'methods.png', above(in_row(sheet[:4]), in_row(sheet[4:])))


def in_row(pictures):
    row = pictures[0]
    for picture in pictures[1:]:
        row = beside(row, picture)
    return row


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as work:
        Gallery(*sys.argv[1:], work).draw()


if __name__ == '__main__':
    main()
