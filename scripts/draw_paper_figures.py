#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws the figures of the papers with models of this repository, as docs/guide/paper-figures.md shows them.

    PYTHONPATH=build/python scripts/draw_paper_figures.py build/src/cli/pellucid build/examples docs/images/papers [NAME ...]

Models are those of `ninja -C build gallery`. Needs numpy and the module pellucid, which reads the intermediate images of `render --dump`.
Without names all sheets, in some minutes; those that path-trace is part of take most of them.
"""
import copy
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pellucid

from draw_layer_sheets import read_png, write_png

GAP = 6
WHITE = 255


def srgb(linear):
    x = np.clip(linear, 0.0, 1.0)
    return (255.0 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055) + 0.5).astype(np.uint8)


def ramp(values, known, low, high):
    """Blue, white, red by logarithm."""
    x = np.clip((np.log(np.maximum(values, 1e-9)) - np.log(low)) / (np.log(high) - np.log(low)), 0.0, 1.0)[..., None]
    cold, middle, hot = (np.array(c, float) for c in ((40, 70, 190), (235, 235, 235), (190, 40, 40)))
    color = np.where(x < 0.5, cold + (middle - cold) * 2 * x, middle + (hot - middle) * (2 * x - 1))
    return np.where(known[..., None], color, 24).astype(np.uint8)


def shrink(picture, size):
    """The mean of squares, as near to `size` on the longer side as whole squares come."""
    step = max(1, round(max(picture.shape[:2]) / size))
    h, w = picture.shape[0] // step * step, picture.shape[1] // step * step
    return picture[:h, :w].reshape(h // step, step, w // step, step, -1).mean((1, 3))


def fit(picture, width, height):
    """In the middle of a dark rectangle."""
    out = np.full((height, width, 3), 24, np.uint8)
    h, w = min(picture.shape[0], height), min(picture.shape[1], width)
    y, x = (height - h) // 2, (width - w) // 2
    out[y:y + h, x:x + w] = picture[:h, :w]
    return out


def grid(rows):
    def join(parts, axis):
        shape = list(parts[0].shape)
        shape[axis] = GAP
        gap = np.full(shape, WHITE, np.uint8)
        return np.concatenate([p for k, part in enumerate(parts) for p in ((gap, part) if k else (part,))], axis)
    return join([join(row, 1) for row in rows], 0)


class Figures:
    def __init__(self, program, examples, work):
        self.program, self.examples, self.work = str(Path(program).resolve()), Path(examples).resolve(), Path(work)
        self.gallery = self.examples / 'gallery'

    def portrait(self):
        return self.load('portrait.json')

    def load(self, name, folder=None):
        folder = folder or self.gallery
        scene = json.loads((folder / name).read_text())
        scene['_folder'] = folder
        return scene

    def face(self):
        """A head that is laid out by its own texture coordinates."""
        return self.load('face.json', self.examples)

    def render(self, scene, method, width, height, *options, knobs=(), dump=None):
        scene = copy.deepcopy(scene)
        folder = scene.pop('_folder')
        path = folder / '_figure.json'
        out = self.work / 'out.png'
        command = [self.program, 'render', str(path), '-m', method, '--width', str(width), '--height', str(height), '-o', str(out), '-q',
                   *options]
        for knob in knobs:
            command += ['--set', knob]
        if dump:
            command += ['--dump', str(dump)]
        try:
            path.write_text(json.dumps(scene))
            subprocess.run(command, check=True)
        finally:
            path.unlink(missing_ok=True)
        return np.array([np.frombuffer(row, np.uint8).reshape(-1, 3) for row in read_png(out)])

    def planes(self, folder):
        """Intermediate images by name."""
        index = json.loads((folder / 'index.json').read_text())
        return {i['name']: folder / i['file'] for i in index['images']}

    # --- d'Eon, Luebke and Enderton 2007 ---

    def deon_1(self):
        """Irradiance, albedo, the six blurs, their sum, the lobe, the image."""
        size = 200
        scene, folder = self.face(), self.work / 'deon-1'
        final = self.render(scene, 'texture-space', 2 * size, 2 * size, '--msaa', '1', knobs=['as=paper', 'tsm=off', 'size=1024'],
                            dump=folder)
        planes = self.planes(folder)
        maps = {name.removeprefix('texture-space.'): pellucid.read_image(path, data=True) for name, path in planes.items()
                if name.startswith('texture-space.') and '.light-' not in name}
        white = 1.0 / np.percentile(maps['irradiance'][maps['irradiance'] > 0], 97)
        panel = {name: fit(srgb(shrink(np.maximum(m, 0), size) * white), size, size) for name, m in maps.items() if m.shape[2] == 3}
        albedo = pellucid.read_image(self.examples / 'face-color.png')
        albedo = fit(srgb(shrink(albedo[..., :3], size)), size, size)
        blurs = [panel[n] for n in sorted((n for n in panel if n.startswith('blur-') and '.step-' not in n), key=lambda n: int(n[5:]))]
        blurs = [blurs[round(k * (len(blurs) - 1) / 4)] for k in range(5)]
        scene['materials']['*']['specular'] = {'rho_s': 0.0}
        plain = self.render(scene, 'texture-space', 2 * size, 2 * size, '--msaa', '1', knobs=['as=paper', 'tsm=off', 'size=1024'])
        lobe = np.maximum(final.astype(float) - plain, 0.0)
        last = [fit(shrink(p.astype(float), size).astype(np.uint8), size, size) for p in (lobe, final)]
        return grid([[panel['irradiance'], albedo, *blurs[:3]], [*blurs[3:], panel['exitance'], *last]])

    def deon_3(self):
        """A projected grid without stretch correction, with it, and by the sum over the surface."""
        lines = np.full((256, 256, 3), 255, np.uint8)
        lines[np.arange(256) % 16 < 3] = 0
        lines[:, np.arange(256) % 16 < 3] = 0
        scene = self.portrait()
        name = self.gallery / '_grid.png'
        scene['lights'] = [{'type': 'spot', 'at': [60, 20, 700], 'to': [0, -30, 30], 'cone_deg': 24, 'intensity': 0.9,
                            'project': name.name}]
        scene['materials']['Skin'].update(color_from='profile', preset='skin1')
        for key in ('textures', 'mix'):
            del scene['materials']['Skin'][key]
        try:
            write_png(name, [row.tobytes() for row in lines])
            return grid([[self.render(scene, method, 300, 340, '--msaa', '4', knobs=knobs) for method, knobs in
                          (('texture-space', ['stretch=off']), ('texture-space', []), ('hierarchical', ['points=400000']))]])
        finally:
            name.unlink(missing_ok=True)

    def deon_4(self):
        """Stretch along x and y of the layout, from the method's own plane; grey is the mean, red three times as long, blue a third."""
        folder = self.work / 'deon-4'
        self.render(self.face(), 'texture-space', 200, 220, '--msaa', '1', knobs=['size=1024'], dump=folder)
        lengths = np.stack(list(pellucid.read_exr(self.planes(folder)['texture-space.texel-size']).values()), -1)
        panels = []
        for k in range(2):
            values = lengths[..., k]
            known = values > 0
            mean = np.exp(np.log(values[known]).mean())
            panels.append(fit(shrink(ramp(values, known, mean / 3, 3 * mean).astype(float), 340).astype(np.uint8), 340, 340))
        return grid([panels])

    def deon_6(self):
        """An ear in front of an area light, spectral skin: without transmission, with it, by path-trace."""
        scene = self.portrait()
        scene['camera'] = {'from': [560, 20, 420], 'to': [84, -28, -6], 'fov_deg': 9}
        scene['lights'] = [{'type': 'rect', 'at': [260, 120, -360], 'to': [70, -30, -10], 'width': 120, 'height': 120,
                            'radiance': [170, 165, 155]}]
        scene['materials']['Skin'] = {'preset': 'skin-2layer', 'roughness': 0.45}
        panels = [self.render(scene, 'texture-space', 280, 320, '--exposure', '3', '--msaa', '4', knobs=knobs)
                  for knobs in (['tsm=off', 'as=paper', 'size=1024'], ['size=1024'])]
        panels.append(self.render(scene, 'path-trace', 280, 320, '--exposure', '3', '--denoise', 'on', knobs=['samples=32']))
        return grid([panels])

    def deon_7(self):
        """The three layers by six Gaussians, next to path-trace through the layers."""
        scene = self.portrait()
        scene['materials']['Skin'] = {'preset': 'skin-3layer', 'roughness': 0.45}
        panels = [self.render(scene, 'texture-space', 300, 340, '--msaa', '4', knobs=['size=1024', 'gaussians=6'])]
        panels.append(self.render(scene, 'path-trace', 300, 340, '--denoise', 'on', knobs=['samples=16']))
        return grid([panels])

    def deon_8(self):
        """Two points, an environment, two blooms; other skins by the same maps (figure 9)."""
        scene = self.portrait()
        scene['lights'] = [{'type': 'point', 'at': [-420, 330, 560], 'intensity': 1.6},
                           {'type': 'point', 'at': [420, 120, 380], 'intensity': 0.7},
                           {'type': 'environment', 'image': 'studio.pfm', 'scale': 0.6}]
        panels = []
        for color in ([1, 1, 1], [0.62, 0.5, 0.42], [0.3, 0.2, 0.15]):
            scene['materials']['Skin']['color'] = color
            panels.append(self.render(scene, 'texture-space', 280, 320, '--msaa', '4', '--bloom', '0.05', '--stops', '-0.6',
                                      knobs=['size=1024']))
        return grid([panels])

    # --- Jimenez and Gutierrez 2010 ---

    def jimenez_bumps(self):
        """Section 7.4: soft normals for a renderer without scattering, these with scattering, and bumpier ones with it."""
        scene = self.portrait()
        scene['camera'] = {'from': [120, -10, 520], 'to': [10, -52, 60], 'fov_deg': 13}
        panels = []
        for method, scale in (('none', 0.5), ('screen-space', 0.5), ('screen-space', 1.0), ('screen-space', 2.0)):
            scene['materials']['Skin']['normal_scale'] = scale
            panels.append(self.render(scene, method, 260, 260, '--msaa', '8'))
        return grid([panels])

    def jimenez_7_7(self):
        """Haloes at depth steps: the published edges, ours, texture-space; an ear from behind: `through` off, as it is, texture-space."""
        scene = self.portrait()
        scene['camera'] = {'from': [560, -20, 620], 'to': [14, -52, 70], 'fov_deg': 6.5}
        scene['lights'] = scene['lights'][:1]
        scene['materials']['Skin'] = {'preset': 'marble', 'roughness': 0.5}
        nose = [self.render(scene, method, 260, 240, '--msaa', '4', '--exposure', '2', knobs=knobs) for method, knobs in
                (('screen-space', ['as=paper', 'ssslevel=0']), ('screen-space', []), ('texture-space', []))]
        scene = self.portrait()
        scene['camera'] = {'from': [560, 20, 420], 'to': [84, -28, -6], 'fov_deg': 9}
        scene['materials']['Skin'] = {'preset': 'skin1', 'roughness': 0.5}
        scene['lights'] = scene['lights'][2:]
        ear = [self.render(scene, method, 260, 240, '--msaa', '4', '--exposure', '3', knobs=knobs) for method, knobs in
               (('screen-space', ['through=off']), ('screen-space', []), ('texture-space', []))]
        return grid([nose, ear])

    def jimenez_7_2(self):
        """Marble without scattering and with it, near, at medium distance and far."""
        scene = self.load('vase.json')
        scene['camera'] = {'from': [40, 200, 620], 'to': [0, 72, 0], 'fov_deg': 16}
        scene['lights'][0]['radiance'] = [40, 39, 36]
        rows = []
        for method in ('none', 'screen-space'):
            row = []
            for zoom in (1.0, 1.7, 3.0):
                scene['camera']['fov_deg'] = 16 * zoom
                row.append(self.render(scene, method, 260, 280, '--msaa', '8'))
            rows.append(row)
        return grid(rows)

    # --- Munoz et al. 2011 ---

    def munoz_1(self):
        """The light of four planes before and after the convolutions, and the image."""
        scene = {'pellucid': 1, '_folder': self.examples, 'mesh': 'bust.obj', 'size': '110mm', 'materials': {'*': {'preset': 'wholemilk'}},
                 'camera': {'from': ['90mm', '80mm', '330mm'], 'to': [0, '55mm', 0], 'fov_deg': 21},
                 'lights': [{'type': 'point', 'at': ['-200mm', '180mm', '260mm'], 'intensity': 0.35},
                            {'type': 'point', 'at': ['160mm', '90mm', '-220mm'], 'intensity': 0.35}]}
        folder = self.work / 'munoz-1'
        self.render(scene, 'convolution', 240, 270, '--msaa', '1', knobs=['planes=4', 'restore=response'], dump=folder)
        final = self.render(scene, 'convolution', 240, 270, '--msaa', '4', knobs=['planes=4'])
        planes = self.planes(folder)
        rows = []
        for what in ('irradiance', 'exitance'):
            images = [pellucid.read_image(path, data=True) for name, path in sorted(planes.items())
                      if name.startswith('convolution.') and name.endswith(what)]
            white = 1.0 / np.percentile(np.concatenate([i[i > 1e-6] for i in images]), 98)
            rows.append([fit(srgb(np.maximum(i, 0) * white), 170, 260) for i in images])
        rows[0].append(fit(final, 240, 260))
        rows[1].append(fit(self.render(scene, 'hierarchical', 240, 270, '--msaa', '4'), 240, 260))
        return grid(rows)

    def munoz_3(self):
        """Whole milk, eight planes, the full resolution, a half and a quarter of it."""
        scene = self.load('vase.json')
        scene['materials'] = {'*': {'preset': 'wholemilk'}}
        return grid([[self.render(scene, 'convolution', 300, 340, '--msaa', '4', knobs=['planes=8', f'resolution={r}'])
                      for r in ('1', '1/2', '1/4')]])

    def munoz_4(self):
        """Eight materials on eight shapes."""
        shapes = [(self.gallery, {'path': 'vase.ply', 'unit': '1mm'}), (self.gallery, {'path': 'apple.ply', 'unit': '1mm'}),
                  (self.gallery, {'path': 'candle.ply', 'unit': '1mm'}), (self.gallery, {'path': 'hand.ply', 'unit': '1mm'}),
                  (self.examples, {'path': 'fluted.obj', 'size': '90mm'}), (self.examples, {'path': 'bust.obj', 'size': '110mm'}),
                  (self.examples, {'path': 'torus.obj', 'size': '90mm'}), (self.examples, {'path': 'cube.obj', 'size': '60mm'})]
        materials = ('skimmilk', 'apple', 'wax', 'wholemilk', 'potato', 'marble', 'ketchup', 'soap')
        panels = [self.render({'pellucid': 1, '_folder': folder, 'meshes': [mesh], 'materials': {'*': {'preset': name}}}, 'convolution',
                              230, 230, '--msaa', '4', '--studio', 'rim') for (folder, mesh), name in zip(shapes, materials)]
        return grid([panels[:4], panels[4:]])

    # --- Mertens et al. 2003 ---

    def mertens_4(self):
        """Irradiance and the image; two lights; a stained glass; milk and marble."""
        scene, size = self.portrait(), (230, 250)
        scene['lights'] = scene['lights'][:1]
        folder = self.work / 'mertens-4'
        first = self.render(scene, 'image-space', *size, '--msaa', '1', knobs=['samples=64'], dump=folder)
        irradiance = pellucid.read_image(self.planes(folder)['frame.irradiance'], data=True)[..., :3]
        irradiance = srgb(irradiance / np.percentile(irradiance[irradiance > 0], 98))
        side = copy.deepcopy(scene)
        side['lights'][0]['at'] = [460, 60, 120]
        glass = copy.deepcopy(scene)
        (self.gallery / '_glass.png').write_bytes((self.examples / 'glass.png').read_bytes())
        glass['lights'] = [{'type': 'spot', 'at': [-60, 40, 700], 'to': [0, -30, 30], 'cone_deg': 24, 'intensity': 1.2,
                            'project': '_glass.png'}]
        panels = [irradiance, first, self.render(side, 'image-space', *size, '--msaa', '4', knobs=['samples=64'])]
        try:
            more = [self.render(glass, 'image-space', *size, '--msaa', '4', knobs=['samples=64'])]
        finally:
            (self.gallery / '_glass.png').unlink()
        for name in ('wholemilk', 'marble'):
            scene['materials']['Skin'] = {'preset': name, 'roughness': 0.4}
            more.append(self.render(scene, 'image-space', *size, '--msaa', '4', knobs=['samples=64']))
        return grid([panels, more])

    def mertens_5(self):
        """The sum over the whole surface (Jensen and Buhler 2002) next to the samples in the image, with the paper's settings and ours."""
        scene = self.portrait()
        scene['lights'] = scene['lights'][:1]
        scene['materials']['Skin'] = {'preset': 'skin1', 'roughness': 0.5}
        return grid([[self.render(scene, method, 270, 300, '--msaa', '4', knobs=knobs) for method, knobs in
                      (('hierarchical', []), ('image-space', ['as=paper', 'samples=50']), ('image-space', []))]])


NAMES = [n for n, f in vars(Figures).items() if n.startswith(('deon', 'jimenez', 'munoz', 'mertens')) and callable(f)]


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as work:
        figures = Figures(sys.argv[1], sys.argv[2], work)
        images = Path(sys.argv[3])
        images.mkdir(parents=True, exist_ok=True)
        for name in sys.argv[4:] or NAMES:
            if name not in NAMES:
                sys.exit(f'{name}: no figure; there are {", ".join(NAMES)}')
            sheet = getattr(figures, name)()
            write_png(images / f'{name.replace("_", "-")}.png', [row.tobytes() for row in np.ascontiguousarray(sheet)])
            print(f'{name}: {sheet.shape[1]} x {sheet.shape[0]}')


if __name__ == '__main__':
    main()
