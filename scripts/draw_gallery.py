#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Renders the images at the top of the README, and those of docs/gallery.md.

    scripts/draw_gallery.py build/src/cli/pellucid BUNNY.obj build/examples docs/images [NAME ...]
    scripts/draw_gallery.py build/src/cli/pellucid BUNNY.obj docs/gallery.md [NAME ...]

backlight.png: a backlit bunny of 70 mm, of whole milk, jade, wax, skimmed milk, soap and marble, by convolution;
methods.png: the one of wax without scattering, by screen-space, image-space and texture-space; by convolution, hierarchical and
path-trace; and veins below the skin of a head, by layered; material-sheet.png: that bunny of every material, in the order of their
names; gallery/beside.png: the models of the gallery by screen-space and by path-trace; or only the named ones. With the page:
every command of it that renders, or those of the named pictures, into images/gallery beside the page; a turntable becomes a film
(APNG). Standard library only.
"""
import json
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

from draw_layer_sheets import above, side_by_side, read_png, write_png

MATERIALS = ['wholemilk', 'jade', 'wax', 'skimmilk', 'soap', 'marble']
METHODS = [['none'], ['screen-space'], ['image-space', 'samples=64', 'views=eye+lights'], ['texture-space'], ['convolution'],
           ['hierarchical'], ['path-trace', 'samples=384']]
MODELS, TRUTH = ['portrait', 'hand', 'candle', 'fruit', 'vase', 'beech'], '128'
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
        samples = ['--msaa', '8'] + (['--denoise', 'on'] if method[0] == 'path-trace' else [])
        return self.render('scene.json', method, width, height, *samples, '--light-samples', '64', '--exposure', '1.3')

    def every_material(self):
        listed = subprocess.run([self.program, 'materials', '--json'], stdout=subprocess.PIPE, check=True)
        names = sorted(entry['name'] for entry in json.loads(listed.stdout)['materials'])
        options = ('--size', '70mm', '--studio', 'rim', '--msaa', '16', '--material')
        cells = [self.render('bunny.obj', ['screen-space'], 112, 98, *options, name) for name in names]
        cells += [[b'\xff' * len(cells[0][0])] * len(cells[0])] * (-len(cells) % 8)
        rows = [in_row(cells[i:i + 8]) for i in range(0, len(cells), 8)]
        sheet = rows[0]
        for row in rows[1:]:
            sheet = above(sheet, row)
        return sheet

    def next_to_reference(self, model):
        scene = str((self.examples / 'gallery' / f'{model}.json').resolve())
        done = subprocess.run([self.program, 'render', scene, '--width', '192', '--height', '216', '-q', '--json', '-o',
                               self.work / 'out.png'], cwd=self.work, stdout=subprocess.PIPE, check=True)
        fast = read_png(self.work / 'out.png')
        exposure = ('--exposure', str(json.loads(done.stdout)['exposure']))
        truth = self.render(scene, ['path-trace'], 192, 216, *exposure, '--samples', TRUTH, '--denoise', 'on')
        return above(fast, truth)

    def backlight(self):
        sheet = [self.bunny(name, ['convolution'], 400, 340) for name in MATERIALS]
        return above(in_row(sheet[:3]), in_row(sheet[3:]))

    def methods(self):
        sheet = [self.bunny('wax', method, 300, 255) for method in METHODS]
        sheet.append(self.render(str((self.examples / 'veins.json').resolve()), ['layered'], 300, 255, '--msaa', '8'))
        return above(in_row(sheet[:4]), in_row(sheet[4:]))

    def draw(self, names):
        for path, picture in {'backlight.png': self.backlight, 'methods.png': self.methods, 'material-sheet.png': self.every_material,
                              'gallery/beside.png': lambda: in_row([self.next_to_reference(model) for model in MODELS])}.items():
            if not names or Path(path).stem in names:
                write_png(self.images / path, picture())


def in_row(pictures):
    row = pictures[0]
    for picture in pictures[1:]:
        row = side_by_side(row, picture)
    return row


def parts_of(png):
    """(name, data) of each chunk."""
    at = 8
    while at < len(png):
        size, = struct.unpack('>I', png[at:at + 4])
        yield png[at + 4:at + 8], png[at + 8:at + 8 + size]
        at += 12 + size


def write_film(path, frames, milliseconds):
    """An APNG of PNG files of one size, whose pixels it keeps as they are packed."""
    def part(name, data):
        return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))

    header = next(data for name, data in parts_of(frames[0].read_bytes()) if name == b'IHDR')
    out, number = [b'\x89PNG\r\n\x1a\n', part(b'IHDR', header), part(b'acTL', struct.pack('>II', len(frames), 0))], 0
    for frame in frames:
        pixels = b''.join(data for name, data in parts_of(frame.read_bytes()) if name == b'IDAT')
        out.append(part(b'fcTL', struct.pack('>IIIIIHHBB', number, *struct.unpack('>II', header[:8]), 0, 0, milliseconds, 1000, 0, 0)))
        out.append(part(b'fdAT', struct.pack('>I', number + 1) + pixels) if frame is not frames[0] else part(b'IDAT', pixels))
        number += 2 if frame is not frames[0] else 1
    path.write_bytes(b''.join(out) + part(b'IEND', b''))


def draw_page(program, bunny, page, names):
    """Runs what the page says, from the folder above the build."""
    program, bunny, page = (Path(p).resolve() for p in (program, bunny, page))
    images = page.parent / 'images/gallery'
    images.mkdir(parents=True, exist_ok=True)
    for line in page.read_text('utf-8').splitlines():
        words = shlex.split(line) if line.startswith('    ./pellucid render') else []
        if not words or (names and Path(words[-1]).stem not in names):
            continue
        with tempfile.TemporaryDirectory() as work:
            output, start = Path(work) / words[-1], time.monotonic()
            words = [str(bunny) if word == 'bunny.obj' else word for word in words[1:-1]]
            subprocess.run([program, *words, output, '-q'], cwd=page.parent.parent, check=True)
            print(f'{output.name}: {time.monotonic() - start:.1f} s', flush=True)
            frames = sorted(Path(work).glob(f'{output.stem}_*.png'))
            if frames:
                write_film(images / output.name, frames, 120)
            else:
                shutil.copyfile(output, images / output.name)


def main():
    if len(sys.argv) > 3 and sys.argv[3].endswith('.md'):
        draw_page(*sys.argv[1:4], sys.argv[4:])
        return
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as work:
        Gallery(*sys.argv[1:5], work).draw(sys.argv[5:])


if __name__ == '__main__':
    main()
