#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Renders the sheets of a head that the page of texture-space shows.

    scripts/draw_head_sheets.py build/src/cli/pellucid head.gltf docs/images [face|ear|grid|stretch|seams]

The head is "Infinite, 3D Head Scan" by Lee Perry-Smith, CC BY 3.0. head-face.png: with its maps, a light
at one side and a dim one at the other, as in the paper's figure 1: without scattering, by texture-space and by hierarchical. head-ear.png:
a backlit ear, by texture-space without transmission and complete, by hierarchical and by path-trace (it takes minutes).
head-grid.png: a projected grid, blurred without and with stretch correction, and by hierarchical. head-stretch.png: mm per texel along
u and v. head-seams.png: planar charts without and with borders, and the head's own layout. Standard library only.
"""
import json
import math
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from draw_layer_sheets import side_by_side, read_png, write_png  # noqa: E402

SIZE = 220
# Positions in mm on the head, which is 405 mm tall.
EAR = {'from': (420, 275, 330), 'to': (78, 268, -2), 'fov_deg': 10}
SIDE = {'from': (520, 290, 330), 'to': (20, 265, -10), 'fov_deg': 20}
HALF = {'from': (330, 290, 480), 'to': (35, 262, 30), 'fov_deg': 13}
BEHIND = {'type': 'point', 'at': (260, 330, -400), 'intensity': 0.35}
FRONT = {'from': (60, 270, 900), 'to': (0, 245, 0), 'fov_deg': 24}
KEY = {'type': 'point', 'at': (420, 420, 420), 'intensity': 0.95}
FILL = {'type': 'point', 'at': (-500, 260, 500), 'intensity': 0.22}
LAMP = {'type': 'point', 'at': (300, 600, 100), 'intensity': 0.45}


class Head:
    def __init__(self, program, mesh, work):
        self.program, self.mesh, self.work = str(Path(program).resolve()), Path(mesh).resolve(), Path(work)

    def picture(self, camera, light, method, knobs=(), exposure=3.0, material='skin1', scale=1.0, color='profile'):
        def placed(thing):
            return {k: [f'{scale * x}mm' for x in v] if k in ('from', 'to', 'at') else v for k, v in thing.items()}

        scene, lamps = self.work / 'scene.json', [placed(lamp) for lamp in (light if isinstance(light, list) else [light])]
        for lamp in lamps:
            lamp['intensity'] *= scale * scale
        scene.write_text(json.dumps({'pellucid': 1, 'meshes': [{'path': str(self.mesh), 'scale': scale}], 'camera': placed(camera),
                                     'lights': lamps, 'materials': {'*': {'preset': material, 'color_from': color}},
                                     'background': {'color': [0.02, 0.02, 0.02]}}))
        out = self.work / 'out.png'
        command = [self.program, 'render', str(scene), '--allow-outside', '-m', method, '--width', str(SIZE), '--height', str(SIZE),
                   '--msaa', '1' if method == 'path-trace' else '4', '--exposure', str(exposure), '-o', str(out)]
        for knob in knobs:
            command += ['--set', knob]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        return read_png(out)

    def face(self):
        return [self.picture(FRONT, [KEY, FILL], method, knobs, exposure=1.6, color='texture')
                for method, knobs in (('none', []), ('texture-space', []), ('hierarchical', ['points=400000']))]

    def ear(self):
        ours = [self.picture(EAR, BEHIND, 'texture-space', knobs) for knobs in (['tsm=off'], [])]
        return ours + [self.picture(EAR, BEHIND, 'hierarchical', ['points=100000']),
                       self.picture(EAR, BEHIND, 'path-trace', ['samples=24'])]

    def grid(self):
        lines = self.work / 'grid.png'
        write_png(lines, [b''.join((b'\0\0\0' if x % 16 < 3 or y % 16 < 3 else b'\xff\xff\xff') for x in range(256)) for y in range(256)])
        slide = {'type': 'spot', 'at': (100, 300, 700), 'to': (20, 265, 0), 'cone_deg': 26, 'intensity': 0.7, 'project': lines.name}
        ours = [self.picture(HALF, slide, 'texture-space', knobs) for knobs in (['stretch=off'], [])]
        return ours + [self.picture(HALF, slide, 'hierarchical', ['points=400000'])]

    def seams(self):
        """A head a quarter as tall: light spreads relatively further."""
        return [self.picture(SIDE, LAMP, 'texture-space', ['tsm=off'] + knobs, material='marble', scale=0.25)
                for knobs in (['charts=planar', 'border=0'], ['charts=planar'], [])]

    def stretch(self):
        """Grey is the mean; blue a third of it, red three times as much, by logarithm."""
        gltf = json.loads(self.mesh.read_text())
        data = (self.mesh.parent / gltf['buffers'][0]['uri']).read_bytes()

        def accessor(number):
            a = gltf['accessors'][number]
            view = gltf['bufferViews'][a['bufferView']]
            kind, width = {5126: 'f', 5125: 'I', 5123: 'H'}[a['componentType']], {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3}[a['type']]
            flat = struct.unpack_from(f'<{a["count"] * width}{kind}', data, view.get('byteOffset', 0) + a.get('byteOffset', 0))
            return flat if width == 1 else [flat[i:i + width] for i in range(0, len(flat), width)]

        part = gltf['meshes'][0]['primitives'][0]
        positions, uv = accessor(part['attributes']['POSITION']), accessor(part['attributes']['TEXCOORD_0'])
        index = accessor(part['indices'])
        maps = [[[None] * SIZE for _ in range(SIZE)] for _ in range(2)]
        for i in range(0, len(index), 3):
            corners = index[i:i + 3]
            t = [(uv[k][0] * SIZE, uv[k][1] * SIZE) for k in corners]
            e = [[positions[corners[k]][j] - positions[corners[0]][j] for j in range(3)] for k in (1, 2)]
            a, b, c, d = t[1][0] - t[0][0], t[2][0] - t[0][0], t[1][1] - t[0][1], t[2][1] - t[0][1]
            area = a * d - b * c
            if abs(area) < 1e-9:
                continue
            mm = [math.hypot(*(1000 * (p * d - q * c) / area for p, q in zip(*e))),
                  math.hypot(*(1000 * (q * a - p * b) / area for p, q in zip(*e)))]
            for y in range(max(int(min(p[1] for p in t)), 0), min(int(max(p[1] for p in t)) + 1, SIZE - 1) + 1):
                for x in range(max(int(min(p[0] for p in t)), 0), min(int(max(p[0] for p in t)) + 1, SIZE - 1) + 1):
                    px, py = x + 0.5 - t[0][0], y + 0.5 - t[0][1]
                    u, v = (px * d - py * b) / area, (py * a - px * c) / area
                    if u >= -1e-6 and v >= -1e-6 and u + v <= 1 + 1e-6:
                        maps[0][y][x], maps[1][y][x] = mm
        pictures = []
        for plane in maps:
            known = [v for row in plane for v in row if v]
            mean, rows = math.exp(sum(map(math.log, known)) / len(known)), []
            for row in plane:
                line = bytearray()
                for v in row:
                    f = max(-1.0, min(math.log(v / mean) / math.log(3.0), 1.0)) if v else 0.0
                    rgb = (128 + 120 * max(f, 0) - 100 * max(-f, 0), 128 - 110 * abs(f), 128 + 120 * max(-f, 0) - 100 * max(f, 0))
                    line += bytes(int(c) for c in rgb) if v else b'\x10\x10\x10'
                rows.append(bytes(line))
            pictures.append(rows)
        return pictures


def main():
    if len(sys.argv) not in (4, 5):
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as work:
        head = Head(sys.argv[1], sys.argv[2], work)
        for name in sys.argv[4:] or ('stretch', 'seams', 'grid', 'face', 'ear'):
            panels = getattr(head, name)()
            sheet = panels[0]
            for panel in panels[1:]:
                sheet = side_by_side(sheet, panel)
            write_png(Path(sys.argv[3]) / f'head-{name}.png', sheet)


if __name__ == '__main__':
    main()
