#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Measures the fast methods against path-trace: the improvement by each stage, on scanned objects and on shapes with deep folds.

    measure_truth.py PROGRAM FOLDER [--meshes FOLDER] [--samples 200] [--size 96] [--scene NAME ...] [--methods A,B] [--threads N] [--ends]

FOLDER gets the scenes, the pictures and results.json; existing results are not rendered again. --meshes holds bunny.obj, bust.obj,
cow.obj and hand.obj; without it only the shapes that are made here are measured. --ends leaves out the rows without one stage. path-trace
is rendered as two halves, so that its noise does not count as error.
"""
import argparse
import json
import math
import os
import pathlib
import subprocess
import sys

# name: mesh, largest extent in mm, material, on a ground, lit from behind
SCENES = {
    'bunny-milk': ('bunny.obj', 70, 'wholemilk', False, False), 'bunny-milk-ground': ('bunny.obj', 70, 'wholemilk', True, False),
    'bust-marble': ('bust.obj', 80, 'marble', False, False), 'bust-marble-ground': ('bust.obj', 80, 'marble', True, False),
    'cow-skin': ('cow.obj', 80, 'skin1', False, False), 'cow-skin-ground': ('cow.obj', 80, 'skin1', True, False),
    'hand-skin': ('hand.obj', 190, 'skin1', False, False), 'hand-skin-backlit': ('hand.obj', 190, 'skin1', False, True),
    'star-marble': ('star.obj', 80, 'marble', False, False), 'column-milk': ('column.obj', 100, 'wholemilk', False, False),
    'knot-skin': ('knot.obj', 90, 'skin1', False, False), 'bowl-marble': ('bowl.obj', 90, 'marble', False, False),
}
STAGES = [('bounces', ['--bounces', '0']), ('angles', ['--angles', 'off']), ('curvature', ['--curvature', 'off']),
          ('single-scattering', ['--single-scattering', 'off']), ('opposed', ['--opposed', 'off'])]
METHODS = 'screen-space,image-space,texture-space,convolution,hierarchical,none'


def surface(path, rows, columns, point, ends):
    """A closed surface over rows x columns; point(u, v) with v periodic. ends: poles at both ends of u, else u is periodic, too."""
    lines, faces = [], []
    for i in range(rows):
        for j in range(columns):
            lines.append('v %.6f %.6f %.6f' % point((i + 0.5) / rows if ends else i / rows, j / columns))
    at = lambda i, j: (i % rows) * columns + j % columns + 1
    for i in range(rows - 1 if ends else rows):
        for j in range(columns):
            faces += [(at(i, j), at(i, j + 1), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i + 1, j))]
    for row, u in ((0, 0.0), (rows - 1, 1.0)) if ends else ():
        lines.append('v %.6f %.6f %.6f' % point(u, 0.0))
        for j in range(columns):
            faces.append((at(row, j + 1), at(row, j), len(lines)) if row == 0 else (at(row, j), at(row, j + 1), len(lines)))
    path.write_text('\n'.join(lines + ['f %d %d %d' % f for f in faces]) + '\n', 'utf-8')


def star(u, v):
    t, p = math.pi * u, 2 * math.pi * v
    r = 1.0 + 0.45 * math.sin(t) ** 2 * math.cos(7 * p) * math.cos(4 * (t - math.pi / 2))
    return r * math.sin(t) * math.cos(p), r * math.cos(t), r * math.sin(t) * math.sin(p)


def column(u, v):
    p = -2 * math.pi * v
    h = 2 * u - 1
    end = max(0.0, 1 - abs(h) ** 24) ** 0.5
    r = 0.5 * end * (1 - 0.35 * (0.5 + 0.5 * math.cos(9 * p)) ** 2)
    return r * math.cos(p), h, r * math.sin(p)


def knot(u, v):
    def middle(a):
        return (math.sin(a) + 2 * math.sin(2 * a), math.cos(a) - 2 * math.cos(2 * a), -math.sin(3 * a))
    a, b = 2 * math.pi * u, 2 * math.pi * v
    c, e = middle(a), middle(a + 1e-4)
    t = [y - x for x, y in zip(c, e)]
    length = math.sqrt(sum(x * x for x in t))
    t = [x / length for x in t]
    n = [c[0] * 0.3, c[1] * 0.3, 1.0]
    d = sum(x * y for x, y in zip(n, t))
    n = [x - d * y for x, y in zip(n, t)]
    length = math.sqrt(sum(x * x for x in n))
    n = [x / length for x in n]
    s = [t[1] * n[2] - t[2] * n[1], t[2] * n[0] - t[0] * n[2], t[0] * n[1] - t[1] * n[0]]
    return tuple(x + 0.62 * (math.cos(b) * y + math.sin(b) * z) for x, y, z in zip(c, n, s))


def bowl(u, v):
    p = -2 * math.pi * v
    # outer wall from the bottom to the rim, inner wall back: a deep cup
    w = 2 * u
    if w < 1:
        a = w * 0.62 * math.pi
        r, y = math.sin(a), -math.cos(a)
    else:
        a = (2 - w) * 0.62 * math.pi
        r, y = 0.82 * math.sin(a), -0.82 * math.cos(a)
    r *= 1 + 0.06 * math.cos(11 * p) * math.sin(a)
    return r * math.cos(p), y, r * math.sin(p)


SHAPES = {'star.obj': (96, 192, star, True), 'column.obj': (120, 180, column, True), 'knot.obj': (240, 40, knot, False),
          'bowl.obj': (120, 120, bowl, True)}


def make_scene(folder, name, size):
    mesh, extent, material, ground, back = SCENES[name]
    length = lambda *factors: [f'{f * extent}mm' for f in factors]
    rect = lambda at, wide, radiance: {'type': 'rect', 'at': length(*at), 'to': ['0mm'] * 3, 'width': f'{wide * extent}mm',
                                       'height': f'{wide * extent}mm', 'radiance': radiance}
    front = [rect((-1.6, 2.2, 1.8), 1.0, 20), rect((2.4, 1.2, 0.6), 1.0, 6)]
    scene = {'pellucid': 1, 'meshes': [{'path': mesh, 'size': f'{extent}mm'}], 'materials': {'*': {'preset': material}},
             'lights': [rect((0.8, 1.0, -2.4), 0.6, 60)] if back else front,
             'camera': {'side': '0,35' if mesh == 'bowl.obj' else 'front'}, 'background': 'black',
             'render': {'width': size, 'height': size, 'msaa': 1, 'boundary': 'smooth'}}
    if ground:
        scene['ground'] = True
    path = folder / f'{name}.json'
    path.write_text(json.dumps(scene, indent=1), 'utf-8')
    return path


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f'measure_truth.py: {" ".join(map(str, arguments))}\n{done.stderr}')
    return done.stdout


def render(options, scene, name, method, *more):
    path = options.folder / f'{scene.stem}-{name}.exr'
    seconds = None
    if not path.exists():
        answer = run(options.program, 'render', scene, '-m', method, '--threads', options.threads, '--json', '-o', path, *more)
        seconds = json.loads(answer)['seconds']
    return path, seconds


def measure(options, name):
    scene = make_scene(options.folder, name, options.size)
    halves = [render(options, scene, f'truth{i}', 'path-trace', '--samples', options.samples // 2, '--seed', i)[0] for i in (1, 2)]
    rows = {}
    for method in options.methods.split(','):
        knobs = ['--set', 'samples=64'] if method == 'image-space' else []
        ends = [('all', []), ('none of them', sum((o for _, o in STAGES), []))]
        for label, off in ends + ([(f'without {stage}', off) for stage, off in STAGES] if method != 'none' and not options.ends else []):
            picture, seconds = render(options, scene, f'{method}-{label.replace(" ", "-")}', method, *off, *knobs)
            answer = json.loads(run(options.program, 'compare', picture, halves[0], '--half', halves[1], '--mask', 'translucent', '--json'))
            m = answer['methods'][0]
            r = {'error': math.sqrt(m['rel_mse']) if m['rel_mse'] else None, 'bias': m['rel_bias'], 'seconds': seconds}
            rows[f'{method}, {label}'] = r
            print(f'{name:20} {method:13} {label:26}', f'{100 * r["error"]:6.2f} %' if r['error'] else '  below noise',
                  ' '.join(f'{100 * b:+6.2f}' for b in r['bias']), f'{seconds:8.2f} s' if seconds else '', flush=True)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program')
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--meshes', type=pathlib.Path)
    parser.add_argument('--samples', type=int, default=200)
    parser.add_argument('--size', type=int, default=96)
    parser.add_argument('--scene', action='append', choices=SCENES)
    parser.add_argument('--methods', default=METHODS)
    parser.add_argument('--threads', type=int, default=os.cpu_count())
    parser.add_argument('--ends', action='store_true')
    options = parser.parse_args()
    options.program = pathlib.Path(options.program).resolve()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, shape in SHAPES.items():
        surface(options.folder / name, *shape)
    results = {}
    for name in options.scene or SCENES:
        mesh = SCENES[name][0]
        if mesh not in SHAPES:
            if not options.meshes:
                continue
            (options.folder / mesh).write_bytes((options.meshes / mesh).read_bytes())
        results[name] = measure(options, name)
    (options.folder / 'results.json').write_text(json.dumps(results, indent=1), 'utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
