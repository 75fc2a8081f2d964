#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_check_layers.py PROGRAM ROOT MAKE EXAMPLES: `check --cross-section` against known layers, and the solids that
make_layer_assets.py (MAKE) generated in the build's folder EXAMPLES."""
import json
import pathlib
import struct
import subprocess
import sys
import zlib

from cli_test import main, need, one_object, png_pixels, release_only, run, test, text, works

MAKE, EXAMPLES = sys.argv[3], pathlib.Path(sys.argv[4]).resolve()
MEDIUM = {'sigma_s': [2, 1, 1], 'sigma_t': [2.6, 1.6, 1.6]}


def write_png(path, width, height, texel):
    """texel(x, y) -> four 8-bit numbers."""
    def chunk(name, data):
        return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))
    rows = b''.join(b'\0' + bytes(v for x in range(width) for v in texel(x, y)) for y in range(height))
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 6, 0, 0, 0)) +
                     chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b''))


def write_box(path, width=40, height=20, depth=6):
    """A closed box, its front unfolded over the whole texture, its back mirrored, its sides in one corner."""
    corners = [(x * width, y * height, z * depth) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    coordinates = ['0 0', '1 0', '1 1', '0 1', '0 0.01']
    front, back = (1, 5, 7, 3), (4, 0, 2, 6)
    sides = [(0, 1, 3, 2), (5, 4, 6, 7), (0, 4, 5, 1), (3, 7, 6, 2)]
    lines = [f'v {x} {y} {z}' for x, y, z in corners] + [f'vt {p}' for p in coordinates] + ['o box', 'usemtl Skin']
    lines.append('f ' + ' '.join(f'{c + 1}/{k + 1}' for k, c in enumerate(front)))
    lines.append('f ' + ' '.join(f'{c + 1}/{(1, 0, 3, 2)[k] + 1}' for k, c in enumerate(back)))
    lines += ['f ' + ' '.join(f'{c + 1}/{(1, 5, 1, 5)[k]}' for k, c in enumerate(side)) for side in sides]
    path.write_text('\n'.join(lines) + '\n')


def furnish(folder, **more):
    """Depths at scale 2.55 mm: red 0.5 mm, green 1 mm on the left and 1.5 mm on the right, blue 2 mm."""
    write_box(folder / 'box.obj')
    write_png(folder / 'depths.png', 64, 4, lambda x, y: (50, 100 if x < 32 else 150, 200, 255))
    layers = [dict(MEDIUM, name=name) for name in ('dermis', 'blood', 'organs')]
    (folder / 'painted.json').write_text(json.dumps({
        'pellucid': 1, 'mesh': 'box.obj', 'unit': '1mm',
        'materials': {'Skin': {'layers': layers, 'depths': ['depths.png'], 'depth_scale': '2.55mm', **more}}}))


def section(folder, *arguments, scene='painted.json', picture='layers.svg'):
    return one_object(works(folder, 'check', scene, '--cross-section', picture, '--json', *arguments))['cross_section']


def near(a, b, tolerance):
    need(abs(a - b) <= tolerance, a, 'is not', b)


@test('depths along a line are those of the map, lengths those of the surface')
def _(folder):
    furnish(folder)
    got = section(folder, '--line', '0.05,0.5,0.45,0.5')
    need(got['file'] == 'layers.svg' and got['material'] == 'Skin', got)
    near(got['length_mm'], 16.0, 1e-3)
    need([layer['name'] for layer in got['layers']] == ['dermis', 'blood', 'organs'], got)
    for layer, depth in zip(got['layers'], (0.5, 1.0, 2.0)):
        for key in ('min', 'mean', 'max'):
            near(layer['depth_mm'][key], depth, 1e-5)
    blood = section(folder, '--line', '0.05,0.5,0.95,0.5')['layers'][1]['depth_mm']
    near(blood['min'], 1.0, 1e-5)
    near(blood['max'], 1.5, 1e-5)
    near(blood['mean'], 1.25, 0.01)
    blood = section(folder, '--line', '0.75,0.1,0.75,0.9')
    near(blood['length_mm'], 16.0, 1e-3)  # of 20 mm
    near(blood['layers'][1]['depth_mm']['min'], 1.5, 1e-5)


@test('the picture holds the layers from the surface down, and the curves end where the surface does')
def _(folder):
    furnish(folder, below='stop')
    got = section(folder, '--line', '-0.5,0.5,1.5,0.5', '--down-to', '4mm', picture='layers.png')
    near(got['length_mm'], 40.0, 0.1)
    near(got['down_to_mm'], 4.0, 1e-9)
    width, height, channels, data = png_pixels((folder / 'layers.png').read_bytes())

    def at(x, y):
        return tuple(data[channels * (y * width + x):channels * (y * width + x) + 3])
    # Down a column left of the middle, off the axis' lines: dermis, blood, organs, nothing.
    column = [at(int(0.44 * width), y) for y in range(height)]
    runs = []
    for color in column:
        if runs and runs[-1][0] == color:
            runs[-1][1] += 1
        else:
            runs.append([color, 1])
    bands = [r for r in runs if r[1] > 20 and min(r[0]) < 240]
    need(len({tuple(b[0]) for b in bands}) >= 4, bands)
    seen = [b[0] for k, b in enumerate(bands) if k == 0 or b[0] != bands[k - 1][0]]
    need(len(seen) == 4, 'bands', seen)
    depth = [sum(b[1] for b in bands if b[0] == color) for color in seen]
    near(depth[0] / depth[1], 1.0, 0.1)  # 0.5 mm each
    near(depth[2] / depth[1], 2.0, 0.15)  # 1 mm
    furnish(folder)
    need(b'<svg' in (section(folder), (folder / 'layers.svg').read_bytes())[1][:400], 'no SVG')


@test('layers that are the same everywhere, and a medium without a bottom, need no line')
def _(folder):
    layers = [dict(MEDIUM, name='skin', depth='0.5mm'), dict(MEDIUM, name='flesh')]
    (folder / 'even.json').write_text(json.dumps({'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm',
                                                  'materials': {'*': {'layers': layers}}}))
    got = section(folder, scene='even.json')
    need(got['layers'] == [{'name': 'skin', 'depth_mm': {'min': 0.5, 'mean': 0.5, 'max': 0.5}}, {'name': 'flesh'}], got)
    need(len(section(folder, scene='scene.json')['layers']) == 1, 'marble')
    shown = text(works(folder, 'check', 'even.json', '--cross-section', 'even.pdf').stdout)
    need('bottom at 0.5 to 0.5 mm' in shown and 'without a bottom' in shown and 'even.pdf' in shown, shown)


@test('what can not be meant is refused by name')
def _(folder):
    furnish(folder)
    for arguments, code, words in (
            (['--cross-section', 'layers.jpg'], 2, '.svg, .pdf or .png'), (['--line', '0,0,1,1'], 2, 'needs --cross-section'),
            (['--down-to', '2mm'], 2, 'needs --cross-section'),
            (['--layers-of', 'Skin'], 2, 'cross-section'), (['--cross-section', 'painted.json'], 2, 'must end'),
            (['--cross-section', 'a.png', '--line', '0,0,1'], 2, 'four numbers'),
            (['--cross-section', 'a.png', '--line', '0,0,0,0'], 2, 'different'),
            (['--cross-section', 'a.png', '--line', '0,0,nan,1'], 2, 'four numbers'),
            (['--cross-section', 'a.png', '--line', ''], 2, 'four numbers'),
            (['--cross-section', 'a.png', '--line', '0,0,1,1,1'], 2, 'four numbers'),
            (['--cross-section', 'a.png', '--down-to', '2'], 2, 'unit'), (['--cross-section', 'a.png', '--layers-of', 'Bone'], 2, 'Bone'),
            (['--cross-section', 'a.png', '--line', '3,3,4,4'], 2, 'crosses no surface'),
            (['--cross-section', 'none/a.png'], 3, 'none/a.png')):
        done = run(folder, 'check', 'painted.json', *arguments)
        need(done.returncode == code and words in text(done.stderr), arguments, done.returncode, done.stderr)
        need(not (folder / 'a.png').exists(), arguments, 'a picture is there')
    (folder / 'plain.json').write_text(json.dumps({'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm',
                                                   'materials': {'*': {'opaque': True}}}))
    done = run(folder, 'check', 'plain.json', '--cross-section', 'a.png')
    need(done.returncode == 2 and b'no material is translucent' in done.stderr, done.returncode, done.stderr)


@test('the painted solids are closed, outward, of one piece, of the size they should be')
def _(folder):
    subprocess.run([sys.executable, MAKE, folder, 'fish-1400'], check=True)
    for name, vertices, low, high in (('fish', (4000, 5000), 95, 105), ('fish-1400', (1200, 1500), 95, 105),
                                      ('gecko', (9000, 16000), 100, 110), ('leaf', (15000, 25000), 100, 110),
                                      ('veined-head', (20000, 30000), 295, 305)):
        path = (folder if name == 'fish-1400' else EXAMPLES) / f'{name}.obj'
        got = one_object(works(folder, 'check', str(path), '--unit', '1mm', '--json'))
        body = got['objects'][0]
        need(vertices[0] <= body['triangles'] / 2 + 2 <= vertices[1], name, body['triangles'])
        need(low <= max(b - a for a, b in zip(*got['bounds_mm'])) <= high, name, got['bounds_mm'])
        for part in got['objects']:
            need(part['closed'] and part['outward'] and part['components'] == 1 and part['degenerate_triangles'] == 0 and
                 part['nonmanifold_edges'] == 0 and part['flipped_edges'] == 0, name, part)
    subprocess.run([sys.executable, MAKE, folder / 'again', 'fish-1400'], check=True)
    need((folder / 'fish-1400.obj').read_bytes() == (folder / 'again/fish-1400.obj').read_bytes(), 'not the same again')


@test('a coarse fish sends as much light as a fine one: a claim of the paper')
def _(folder):
    release_only()
    subprocess.run([sys.executable, MAKE, folder, 'fish-1400', 'fish-20000'], check=True)
    scene = json.loads((EXAMPLES / 'fish.json').read_text('utf-8'))
    scene['background'] = {'color': [0, 0, 0]}
    body = scene['materials']['Fish']
    body['depths'] = [str(EXAMPLES / 'fish-layers.png')]
    body['specular']['rho_s'] = 0
    del body['textures']
    lights = scene['lights']
    for shine, most in ((lights, 0.01), (lights[2:], 0.01), (lights[:1], 0.025)):
        scene['lights'], sums = shine, []
        for name in ('fish-1400', 'fish-20000'):
            (folder / 'fish.json').write_text(json.dumps(dict(scene, mesh=f'{name}.obj')))
            works(folder, 'render', 'fish.json', '--width', '400', '--height', '216', '--msaa', '1', '--allow-outside', '-q', '-o',
                  'fish.pfm')
            values = struct.unpack(f'<{400 * 216 * 3}f', (folder / 'fish.pfm').read_bytes()[-400 * 216 * 12:])
            sums.append(sum(values))
            lit = [v for v in values if v > 0]
            # From behind: no fireflies. A light path that gets shorter with depth made single pixels 100 times too bright.
            need(len(shine) > 1 or shine == lights[2:] or max(lit) < 15 * sum(lit) / len(lit), name, max(lit))
        need(abs(sums[0] / sums[1] - 1) < most, [light['name'] for light in shine], sums)


@test('the painted scenes have no problems, and their cross-sections show all their layers')
def _(folder):
    for name, material, layers in (('fish', 'Fish', 4), ('leaf', 'Leaf', 4), ('gecko', 'Gecko', 4), ('veins', 'Skin', 4)):
        got = one_object(works(folder, 'check', str(EXAMPLES / f'{name}.json'), '--cross-section', 'cut.svg', '--json'))
        need(not [p for p in got['problems'] if p['severity'] != 'note'], name, got['problems'])
        cut = got['cross_section']
        need(cut['material'] == material and len(cut['layers']) == layers and cut['length_mm'] > 80, name, cut)
        means = [layer['depth_mm']['mean'] for layer in cut['layers']]
        need(means == sorted(means) and means[0] > 0.02, name, means)


sys.exit(main())
