#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Renders the images of the image-space method that its page shows, each next to `hierarchical`.

    scripts/draw_image_space_sheets.py build/src/cli/pellucid build/examples docs/images

image-space-face.png: the head of 100 mm with colour, normal and roughness maps, without scattering, by image-space, by hierarchical;
image-space-lights.png: milk, marble and skin under a moving light, the checkered light, the stained glass; the last column is hierarchical.
Standard library only.
"""
import json
import subprocess
from pathlib import Path

from draw_layer_sheets import above, side_by_side, draw_all, read_png, write_png

METHOD = ['-m', 'image-space', '--set', 'samples=64', '--set', 'views=eye+lights']
REFERENCE = ['-m', 'hierarchical', '--set', 'points=200000']
MOVING = {'pellucid': 1, 'meshes': [{'path': 'bust.obj', 'size': '100mm', 'material': 'marble'}, 'moving-light.gltf'],
          'camera': {'from': [0, '70mm', '420mm'], 'to': [0, '58mm', 0], 'fov_deg': 14},
          'background': {'color': [0.03, 0.033, 0.04]}, 'render': {'exposure': 1.5}}


class Sheets:
    def __init__(self, program, examples, images, work):
        self.program, self.images, self.work = str(Path(program).resolve()), Path(images), Path(work)
        for path in Path(examples).resolve().glob('*'):
            if path.is_file():
                (self.work / path.name).symlink_to(path)

    def picture(self, scene, size, options):
        if not isinstance(scene, str):
            (self.work / 'sheet.json').write_text(json.dumps(scene))
            scene = 'sheet.json'
        subprocess.run([self.program, 'render', scene, '--width', str(size), '--height', str(size), '-q', '--allow-outside', '-o',
                        'sheet.png', *options], cwd=self.work, check=True)
        return read_png(self.work / 'sheet.png')

    def draw(self):
        plain, method, reference = (self.picture('face.json', 320, options) for options in (['-m', 'none'], METHOD, REFERENCE))
        write_png(self.images / 'image-space-face.png', side_by_side(side_by_side(plain, method), reference))
        sheet = None
        for name in ('wholemilk', 'marble', 'skin1'):
            MOVING['meshes'][0]['material'] = name
            row = None
            for time, options in ((0.25, METHOD), (0.7, METHOD), (0.7, REFERENCE)):
                picture = self.picture({**MOVING, 'time': time}, 240, options)
                row = side_by_side(row, picture) if row else picture
            sheet = above(sheet, row) if sheet else row
        for name in ('checker.json', 'stained-glass.json'):
            plain, method, reference = (self.picture(name, 240, options) for options in (['-m', 'none'], METHOD, REFERENCE))
            sheet = above(sheet, side_by_side(side_by_side(plain, method), reference))
        write_png(self.images / 'image-space-lights.png', sheet)


if __name__ == '__main__':
    draw_all(Sheets, __doc__)
