#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_pictures.py PROGRAM ROOT MAKE_ASSETS SLOW_LIBRARY: the output of `pellucid render`: formats, layers, metadata, numbering,
precedence, atomicity."""
import json
import os
import pathlib
import resource
import runpy
import shutil
import signal
import struct
import subprocess
import sys
import time

from cli_test import (PROGRAM, SANITIZED, SMALL, Skip, clean_environment, exr_header, main, names, need, one_object, png_pixels, png_text,
                      run, sphere, test, text, works, write_obj, write_scene)

MAKE_ASSETS = os.path.abspath(sys.argv[3])
SLOW_LIBRARY = os.path.abspath(sys.argv[4])
MESH = ['render', 'bunny.obj', '--size', '70mm', '--material', 'wholemilk', *SMALL]
LAYERS = [f'{layer}.{c}' for layer in ('diffuse.multiple', 'diffuse.single', 'transmission', 'specular', 'irradiance') for c in 'RGB']
MAGIC = {'png': b'\x89PNG\r\n\x1a\n', 'exr': b'\x76\x2f\x31\x01', 'hdr': b'#?RADIANCE', 'pfm': b'PF'}


@test('-o - writes each format to stdout, the same as to a file')
def _(folder):
    before = names(folder)
    for kind, magic in MAGIC.items():
        works(folder, *MESH, '-o', f'a.{kind}')
        done = works(folder, *MESH, '-o', '-', '--format', kind)
        need(done.stdout.startswith(magic) and b'stdout: 48 x 27' in done.stderr, kind, done.stderr)
        whole = (folder / f'a.{kind}').read_bytes()
        if kind == 'png':
            need(png_pixels(done.stdout) == png_pixels(whole), 'pixels differ')
        elif kind != 'exr':
            need(done.stdout == whole, kind, 'differs')
    need(sorted(names(folder)) == sorted([*before, *(f'a.{k}' for k in MAGIC)]), names(folder))


@test('without -o: the name of the input with .png, in the current folder')
def _(folder):
    (folder / 'sub').mkdir()
    shutil.copy(folder / 'bunny.obj', folder / 'sub/two.dots.obj')
    shutil.copy(folder / 'bunny.obj', folder / 'plain')
    works(folder, 'render', 'sub/two.dots.obj', '--size', '7cm', *SMALL)
    works(folder, 'render', 'plain', '--size', '0.07m', *SMALL)
    works(folder, 'render', '--format', 'pfm', 'bunny.obj', '--size', '7cm', *SMALL)
    need({'two.dots.png', 'plain.png', 'bunny.png'} <= set(names(folder)) and names(folder / 'sub') == ['two.dots.obj'], names(folder))
    need((folder / 'bunny.png').read_bytes().startswith(b'PF'), '--format wins over the ending')


@test('--environment is a scene file\'s environment light, in front of it, turned and scaled; --background is shown as it is given')
def _(folder):
    sky = b''.join(bytes((40 + 20 * x, 120, 200 - 15 * x, 129)) for x in range(8)) * 4
    (folder / 'sky.hdr').write_bytes(b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n' + sky)
    (folder / 'sky.json').write_text(json.dumps({
        'pellucid': 1, 'mesh': 'bunny.obj', 'size': '70mm', 'materials': {'*': {'preset': 'wholemilk'}},
        'lights': [{'type': 'environment', 'image': 'sky.hdr', 'scale': 2, 'rotate_deg': 90}]}), 'utf-8')
    works(folder, 'render', 'sky.json', *SMALL, '-o', 'file.pfm')
    sky = ['--environment', 'sky.hdr', '--environment-scale', '2']
    works(folder, *MESH, *sky, '--environment-rotate', '90', '-o', 'a.pfm')
    works(folder, *MESH, *sky, '-o', 'b.pfm')
    file, a, b = ((folder / f'{n}.pfm').read_bytes() for n in ('file', 'a', 'b'))
    need(file == a and a != b, 'same as the scene file', file == a, 'turned', a != b)
    works(folder, 'render', 'sky.json', *SMALL, '--studio', 'back', '-o', 'studio.pfm')
    works(folder, *MESH, '--studio', 'back', '-o', 'plain.pfm')
    need((folder / 'studio.pfm').read_bytes() == (folder / 'plain.pfm').read_bytes(), 'a studio leaves nothing of the environment')
    for given, shown in (('#f4f1ec', (0xf4, 0xf1, 0xec)), ('white', (255, 255, 255)), ('black', (0, 0, 0)), ('transparent', (0, 0, 0, 0))):
        works(folder, *MESH, *sky, '--background', given, '-o', 'c.png')
        width, height, channels, pixels = png_pixels((folder / 'c.png').read_bytes())
        need(channels == len(shown), given, channels)
        # Output is dithered by less than one step.
        need(all(abs(x - y) <= 1 for x, y in zip(pixels[:channels], shown)), given, tuple(pixels[:channels]))
        need(max(pixels[channels * (13 * 48 + 24):][:3]) > 60, given, 'the object is lit')


@test('a scene file whose background is the environment takes that of the command line, and a ground is a table before any background')
def _(folder):
    sky = b''.join(bytes((40 + 20 * x, 120, 200 - 15 * x, 129)) for x in range(8)) * 4
    (folder / 'sky.hdr').write_bytes(b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n' + sky)
    scene = {'pellucid': 1, 'mesh': 'bunny.obj', 'size': '70mm', 'materials': {'*': {'preset': 'wholemilk'}}, 'background': 'environment'}
    (folder / 'bare.json').write_text(json.dumps(scene), 'utf-8')
    (folder / 'full.json').write_text(json.dumps(scene | {'lights': [{'type': 'environment', 'image': 'sky.hdr'}]}), 'utf-8')
    done = run(folder, 'render', 'bare.json', *SMALL, '-o', 'no.pfm')
    need(done.returncode == 3 and b'--environment FILE' in done.stderr and not (folder / 'no.pfm').exists(), done.stderr)
    works(folder, 'render', 'bare.json', *SMALL, '--environment', 'sky.hdr', '-o', 'bare.pfm')
    works(folder, 'render', 'full.json', *SMALL, '-o', 'full.pfm')
    need((folder / 'bare.pfm').read_bytes() == (folder / 'full.pfm').read_bytes(), 'another image than with the environment in the file')
    works(folder, 'render', 'bare.json', *SMALL, '--background', 'white', '-o', 'white.pfm')
    works(folder, *MESH, '--environment', 'sky.hdr', '--background', 'white', '--ground', '-o', 'table.png')
    width, _, channels, pixels = png_pixels((folder / 'table.png').read_bytes())
    need(width == 48 and tuple(pixels[:3]) == (255, 255, 255), 'a backdrop hides the background', tuple(pixels[:channels]))


@test('light that is negligible is told of, once')
def _(folder):
    (folder / 'dim.pfm').write_bytes(b'PF\n2 1\n-1.0\n' + struct.pack('<6f', *6 * [1e-30]))
    said = text(works(folder, *MESH, '--environment', 'dim.pfm', '-o', 'dim.png').stderr)
    need(said.count('the light on the visible surfaces is negligible') == 1 and '--environment-scale' in said, said)
    said = text(works(folder, *MESH, '--environment', 'dim.pfm', '--environment-scale', '1e5', '-o', 'dim.png').stderr)
    need('negligible' not in said and 'black' not in said, said)


@test('textures on a mesh without texture coordinates are told of; one number is a colour for all channels')
def _(folder):
    (folder / 't.pfm').write_bytes(b'Pf\n1 1\n-1.0\n' + struct.pack('<f', 0.5))
    (folder / 'ball.ply').write_text('ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n'
                                     'element face 4\nproperty list uchar int vertex_indices\nend_header\n'
                                     '0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n', 'utf-8')
    for material, warned in (({'color': 0.5, 'mean_free_path': '0.1mm'}, False),
                           ({'preset': 'marble', 'textures': {'roughness': 't.pfm'}}, True)):
        scene = {'pellucid': 1, 'mesh': 'ball.ply', 'unit': '1cm', 'materials': {'*': material}}
        (folder / 't.json').write_text(json.dumps(scene), 'utf-8')
        done = works(folder, 'render', 't.json', *SMALL, '-o', 'a.png')
        need((b'has no texture coordinates (UV set 0)' in done.stderr) == warned, warned, done.stderr)


@test('a picture shows the thing lit before its backdrop, and -m none differs')
def _(folder):
    works(folder, *MESH, '-o', 'a.png')
    works(folder, *MESH, '-o', 'b.png', '-m', 'none')
    (width, height, channels, a), (*_, b) = (png_pixels((folder / n).read_bytes()) for n in ('a.png', 'b.png'))
    need((width, height, channels) == (48, 27, 3), width, height, channels)
    middle, corner = a[3 * (13 * 48 + 24)], a[0]
    need(middle > 60 and abs(middle - corner) > 20, 'middle', middle, 'corner', corner)
    need(a != b, 'scattering changes nothing')


@test('the same physical size in mm, cm and m gives the same pixels')
def _(folder):
    found = set()
    vertices, faces = sphere()
    for name, scale, unit in (('mm', 1.0, '1mm'), ('cm', 0.1, '1cm'), ('m', 0.001, '1m')):
        write_obj(folder / f'{name}.obj', [[scale * c for c in v] for v in vertices], faces)
        works(folder, 'render', f'{name}.obj', '--unit', unit, '--material', 'skin1', *SMALL, '-o', f'{name}.pfm')
        found.add((folder / f'{name}.pfm').read_bytes())
    sizes = [struct.unpack(f'<{48 * 27 * 3}f', f[-48 * 27 * 12:]) for f in found]
    need(all(abs(x - y) < 2e-3 * (1e-3 + abs(x)) for other in sizes for x, y in zip(sizes[0], other)), 'pictures differ')


@test('EXR: the layers of the guide and all metadata, without a path of this machine')
def _(folder):
    output = folder / 'with space.exr'
    works(folder, 'render', str(folder / 'bunny.obj'), '--size', '70mm', '--material', 'wholemilk', '--set', 'lod=2', *SMALL,
          f'--output={output}')
    data = output.read_bytes()
    attributes, channels, _ = exr_header(data)
    wanted = ['A', 'B', 'G', 'R', *LAYERS, 'normal.X', 'normal.Y', 'normal.Z', 'albedo.R', 'albedo.G', 'albedo.B', 'depth.Z',
              'translucent.Y']
    need(sorted(c for c, _ in channels) == sorted(wanted), channels)
    need(dict(channels)['depth.Z'] == 2 and dict(channels)['R'] == 1, channels)
    need(str(folder).encode() not in data and os.environ.get('HOME', 'none').encode() + b'/' not in data, 'a path of this machine')
    for key in 'version command method knobs settings engine device seed exposure units scene materials seconds load_seconds'.split():
        need(attributes.get(f'pellucid.{key}'), key, attributes)
    need(attributes['pellucid.command'] == "pellucid render bunny.obj --size 70mm --material wholemilk --set lod=2 --width 48 --height 27 "
         "--msaa 1 --light-samples 2 --indirect-samples 256 '--output=with space.exr'", attributes['pellucid.command'])
    need('lod=2' in attributes['pellucid.knobs'] and 'width=48' in attributes['pellucid.settings'], attributes)
    need(float(attributes['pellucid.exposure']) > 0 and float(attributes['pellucid.seconds']) > 0, attributes)


@test('PNG keeps what made it, and no time: the same command gives the same bytes')
def _(folder):
    works(folder, *MESH, '-o', 'a.png')
    first = (folder / 'a.png').read_bytes()
    works(folder, *MESH, '-o', 'a.png')
    need(first == (folder / 'a.png').read_bytes(), 'bytes differ')
    kept = png_text(first)
    need(kept['pellucid.method'] == 'screen-space' and kept['pellucid.command'].startswith('pellucid render bunny.obj'), kept)
    need('pellucid.seconds' not in kept, kept)


@test('the hashes follow the content, not its name or place')
def _(folder):
    def hashes(*arguments):
        works(folder, 'render', *arguments, *SMALL, '-o', 'h.exr')
        attributes = exr_header((folder / 'h.exr').read_bytes())[0]
        return attributes['pellucid.scene'], attributes['pellucid.materials']
    (folder / 'sub').mkdir()
    shutil.copy(folder / 'bunny.obj', folder / 'sub/other.obj')
    vertices, faces = sphere()
    vertices[5] = (vertices[5][0], vertices[5][1], vertices[5][2] + 0.1)
    write_obj(folder / 'moved.obj', vertices, faces)
    milk = hashes('bunny.obj', '--unit', '1mm', '--material', 'wholemilk')
    need(milk == hashes('sub/other.obj', '--unit', '1mm', '--material', 'wholemilk', '-m', 'none'), 'the place counts')
    marble = hashes('bunny.obj', '--unit', '1mm', '--material', 'marble')
    need(milk[0] != marble[0] and milk[1] != marble[1], 'the material does not count')
    moved = hashes('moved.obj', '--unit', '1mm', '--material', 'wholemilk')
    need(milk[0] != moved[0] and milk[1] == moved[1], 'a vertex does not count')
    for found in milk + marble + moved:
        need(len(found) == 16 and int(found, 16) != 0, found)


@test('options of a scene file apply, those of the command line win')
def _(folder):
    def rendered(*arguments):
        return one_object(works(folder, 'render', *arguments, '--json', '-o', 'o.exr')), exr_header((folder / 'o.exr').read_bytes())[0]
    write_scene(folder / 's.json', width=40, height=30, msaa=1, bounces=0, seed=7, exposure=2.5, tonemap='linear',
                knobs={'lod': 0.5, 'gaussians': 2})
    answer, kept = rendered('s.json')
    need((answer['width'], answer['height'], answer['exposure']) == (40, 30, 2.5), answer)
    need(kept['pellucid.seed'] == '7' and 'tonemap=linear' in kept['pellucid.settings'], kept)
    need('lod=0.5' in kept['pellucid.knobs'] and 'gaussians=2' in kept['pellucid.knobs'], kept)
    answer, kept = rendered('s.json', '--width', '44', '--exposure', '1', '--set', 'lod=3', '--seed', '8')
    need((answer['width'], answer['height'], answer['exposure']) == (44, 30, 1), answer)
    need(kept['pellucid.seed'] == '8' and 'lod=3' in kept['pellucid.knobs'] and 'gaussians=2' in kept['pellucid.knobs'], kept)
    answer, _ = rendered('s.json', '-m', 'none')
    need(answer['method'] == 'none', 'knobs of the scene file fell to another method', answer)
    write_scene(folder / 'n.json', width=40, height=30, msaa=1, bounces=0, method='none')
    need(rendered('n.json')[0]['method'] == 'none' and rendered('n.json', '-m', 'screen-space')[0]['method'] == 'screen-space')


@test('exposure is metered of light that arrives, not of what clear media hold')
def _(folder):
    def exposure(method):
        mesh = ['bunny.obj', '--size', '70mm', '--material', 'merlot', '--studio', 'window', *SMALL]
        return one_object(works(folder, 'render', *mesh, '-m', method, '--json', '-o', 'e.exr'))['exposure']
    need(2 / 3 < exposure('screen-space') / exposure('none') < 1.5, exposure('screen-space'), exposure('none'))


@test('--set as=paper takes the paper\'s knobs, whatever the order')
def _(folder):
    found = []
    for order in (['--set', 'as=paper', '--set', 'lod=3'], ['--set', 'lod=3', '--set', 'as=paper']):
        works(folder, *MESH, *order, '-o', 'p.exr')
        found.append(exr_header((folder / 'p.exr').read_bytes())[0]['pellucid.knobs'])
    need(found[0] == found[1] and 'as=paper' in found[0] and 'lod=3' in found[0] and 'edges=paper' in found[0], found)


@test('as=paper renders with the settings of the paper, unless others are given')
def _(folder):
    def settings(*more):
        works(folder, 'render', *more, '-o', 'p.exr')
        return exr_header((folder / 'p.exr').read_bytes())[0]['pellucid.settings'].split()

    paper = ['-m', 'convolution', '--set', 'as=paper']
    found = settings(*MESH[1:], *paper)
    need({'exit=published', 'bounces=0', 'angles=off', 'curvature=off', 'specular=phong'} <= set(found), found)
    found = settings(*MESH[1:], *paper, '--exit', 'balanced', '--bounces', '2', '--specular', 'kelemen')
    need({'exit=balanced', 'bounces=2', 'angles=off', 'specular=kelemen'} <= set(found), found)
    write_scene(folder / 's.json', width=40, height=30, msaa=1, method='convolution', knobs={'as': 'paper'}, bounces=1)
    found = settings('s.json')
    need({'exit=published', 'bounces=1', 'angles=off'} <= set(found), found)
    need({'exit=balanced', 'bounces=8', 'specular=material'} <= set(settings(*MESH[1:], '-m', 'convolution')))


@test('--dump writes every intermediate image with an index, changes no picture, and appears whole or not at all')
def _(folder):
    works(folder, *MESH, '-o', 'plain.pfm')
    works(folder, *MESH, '--dump', 'stages', '-o', 'p.pfm')
    need((folder / 'p.pfm').read_bytes() == (folder / 'plain.pfm').read_bytes(), '--dump changes the picture')
    index = json.loads((folder / 'stages/index.json').read_text('utf-8'))
    files = [image['file'] for image in index['images']]
    need(sorted(files + ['index.json']) == names(folder / 'stages'), names(folder / 'stages'))
    need(index['method'] == 'screen-space' and 'as=best' in index['knobs'] and 'bounces=8' in index['settings'], index)
    for image in index['images']:
        attributes, channels = exr_header((folder / 'stages' / image['file']).read_bytes())[:2]
        need(attributes['pellucid.unit'] == image['unit'] and attributes['pellucid.what'] == image['what'], attributes)
        need(len(channels) == image['components'], channels)
    blurs = [image for image in index['images'] if '.blur-' in image['name']]
    need(blurs and all(image['gaussians'][0]['material'] == 'wholemilk' and image['gaussians'][0]['variance_mm2'] > 0 and
                       len(image['gaussians'][0]['weight']) == 3 for image in blurs), blurs)
    need(all(('gaussians' in image) == (image in blurs) for image in index['images']), index)
    need({image['name']: image['unit'] for image in index['images']}['frame.light'] == 'W/m^2', index)
    need({'frame.depth', 'frame.irradiance', 'screen-space.blur-4', 'frame.light'} <= {image['name'] for image in index['images']}, index)
    for wrong, reason in ((('--turntable', '2'), b'does not go with --turntable'), (('--frames', '0:1:1'), b'does not go with --frames')):
        done = run(folder, *MESH, '--dump', 'other', *wrong, '-o', 'q.png')
        need(done.returncode == 2 and reason in done.stderr and not (folder / 'other').exists(), done.stderr)
    done = run(folder, *MESH, '--dump', '', '-o', 'q.png')
    need(done.returncode == 2 and b'--dump: is empty' in done.stderr and not (folder / 'q.png').exists(), done)
    done = run(folder, *MESH, '--dump', 'none/there', '-o', 'q.png')
    need(done.returncode == 3 and b'none/there' in done.stderr and not (folder / 'q.png').exists(), done)


@test('--dump replaces an earlier dump, and only that')
def _(folder):
    stages = folder / 'stages'

    def listed():
        return [image['file'] for image in json.loads((stages / 'index.json').read_text('utf-8'))['images']]

    def dumps(*more):
        return works(folder, *MESH, '--bounces', '0', *more, '--dump', 'stages', '-o', 'p.pfm')

    dumps()
    (stages / '99-mine.exr').write_bytes(b'mine')
    (stages / 'notes.txt').write_bytes(b'notes')
    first = listed()
    (stages / '09-texture-space.texel-size.exr').mkdir()
    done = run(folder, *MESH, '-m', 'texture-space', '--set', 'size=64', '--dump', 'stages', '-o', 'p.pfm')
    need(done.returncode == 3 and set(first) <= set(names(stages)), 'a dump that fails removes nothing', done, names(stages))
    (stages / '09-texture-space.texel-size.exr').rmdir()
    for file in stages.glob('[01]*.exr'):
        file.unlink()
    dumps()
    dumps('-m', 'texture-space', '--set', 'size=64')
    need('09-texture-space.texel-size.exr' in listed(), listed())
    need(names(stages) == sorted([*listed(), 'index.json', '99-mine.exr', 'notes.txt']), names(stages))
    second = names(stages)
    whole = (stages / 'index.json').read_text('utf-8')
    index = json.loads(whole)
    wrong = [whole[:-20], json.dumps({**index, 'images': index['images'][1:]}), json.dumps({**index, 'knobs': 3}), '[' * 100000,
             whole + ' ' * (2 << 20)]
    for file in ('../p.pfm', 'notes.txt', None):
        wrong.append(json.dumps({**index, 'images': [*index['images'][:-1], {**index['images'][-1], 'file': file}]}))
    for content in wrong:
        (stages / 'index.json').write_text(content, 'utf-8')
        done = dumps('-m', 'none')
        need(names(stages) == second and listed() == [], content[:80], names(stages))
    need(b'no intermediate images: -m none renders without a method' in done.stderr, done.stderr)
    (stages / 'index.json').unlink()
    os.mkfifo(stages / 'index.json')
    dumps('-m', 'none')
    need(names(stages) == second, 'a pipe is no index', names(stages))
    dumps()
    second = [file for file in second if file not in listed()]
    (stages / 'index.json').write_text(json.dumps({**index, 'images': [
        {'file': '00-frame.irradiance.exr', 'name': 'frame.irradiance'}, {'file': '01-linked.exr', 'name': 'linked'},
        {'file': '02-p.exr', 'name': 'p'}, {'file': '03-gone.exr', 'name': 'gone'}]}), 'utf-8')
    shutil.copy(stages / '04-frame.irradiance.exr', stages / '00-frame.irradiance.exr')
    (stages / '01-linked.exr').symlink_to('notes.txt')
    (stages / '02-p.exr').write_bytes(b'of the earlier dump')
    (stages / '03-gone.exr').write_bytes(b'of the earlier dump')
    before = names(stages)
    works(folder, *MESH, '-m', 'none', '--environment', 'stages/00-frame.irradiance.exr', '--dump', 'stages', '-o', 'stages/02-p.exr')
    need(names(stages) == [file for file in before if file != '03-gone.exr'], 'read, written or linked files stay', before, names(stages))


@test('--turntable numbers its pictures, starts at the front, turns, and keeps the exposure')
def _(folder):
    vertices, faces = sphere()
    write_obj(folder / 'bunny.obj', [(x + 15 * (y > 0), y, z) for x, y, z in vertices], faces)
    works(folder, *MESH, '-o', 'plain.png')
    (folder / 'v1.0').mkdir()
    answer = one_object(works(folder, *MESH, '--turntable', '3', '-o', 'v1.0/turn.png', '--json'))
    need(names(folder / 'v1.0') == [f'turn_{i:04d}.png' for i in range(3)], names(folder / 'v1.0'))
    need(answer['images'] == [f'v1.0/turn_{i:04d}.png' for i in range(3)] and answer['image'] == answer['images'][-1], answer)
    frames = [(folder / 'v1.0' / n).read_bytes() for n in names(folder / 'v1.0')]
    need(png_pixels(frames[0]) == png_pixels((folder / 'plain.png').read_bytes()), 'the first is not the front')
    need(len({png_pixels(f)[3] for f in frames}) == 3, 'it does not turn')
    need(len({png_text(f)['pellucid.exposure'] for f in frames}) == 1, 'the exposure flickers')
    works(folder, *MESH, '--turntable', '2', '-o', 'v1.0/noending', '--format', 'pfm')
    need({'noending_0000', 'noending_0001'} <= set(names(folder / 'v1.0')), names(folder / 'v1.0'))


@test('a file that can not be written whole leaves the old one as it was')
def _(folder):
    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    for kind in MAGIC:
        old = folder / f'old.{kind}'
        old.write_bytes(b'precious')
        before = names(folder)
        done = subprocess.run([PROGRAM, *MESH, '-o', old.name], cwd=folder, env=clean_environment(), capture_output=True, check=False,
                              preexec_fn=small_files)
        need(done.returncode == 3 and b'too large' in done.stderr, kind, done.returncode, done.stderr)
        need(old.read_bytes() == b'precious' and names(folder) == before, names(folder))
        works(folder, *MESH, '-o', old.name)
        need(old.read_bytes().startswith(MAGIC[kind]) and names(folder) == before, names(folder))


@test('--engine vulkan gives the picture of the cpu engine, on the device that --device names')
def _(folder):
    engines = one_object(works(folder, 'info', '--json'))['engines']
    device = next((e['device'] for e in engines if e['name'] == 'vulkan'), None)
    if device is None:
        raise Skip('there is no Vulkan device')
    floats, plain = {}, ['--size', '70mm', '--material', 'wholemilk', *SMALL, '--format', 'pfm']
    for name, more in {'cpu': [], 'vulkan': ['--engine', 'vulkan', '--device', device[:8].upper()], 'none': ['-m', 'none']}.items():
        stages = one_object(works(folder, 'render', 'bunny.obj', *plain, *more, '-o', f'{name}.pfm', '--json'))['stages']
        need(any(s['name'].endswith('download') for s in stages) == (name == 'vulkan'), stages)
        data = (folder / f'{name}.pfm').read_bytes()
        floats[name] = struct.unpack(f'<{3 * 48 * 27}f', data[-4 * 3 * 48 * 27:])
    total = sum(abs(v) for v in floats['cpu'])
    differ = {name: sum(abs(a - b) for a, b in zip(floats['cpu'], values)) / total for name, values in floats.items()}
    need(differ['vulkan'] < 1e-4 and differ['none'] > 1e-3, differ)


@test('1, 2 and 3 threads, and every SIMD level, give the same bits')
def _(folder):
    write_obj(folder / 'fluted.obj', *runpy.run_path(MAKE_ASSETS)['fluted'](120.0, 42.0, rows=70, columns=120))
    mesh = ['render', 'fluted.obj', '--size', '60mm', '--material', 'skin1', '--width', '141', '--height', '79', '--msaa', '2',
            '--indirect-samples', '512']
    levels = one_object(works(folder, 'info', '--json'))['engines'][0]['simd_levels']
    for more in ([],) if SANITIZED else ([], ['--set', 'as=paper'], ['-m', 'none']): # differs only in C code that tests/methods covers
        first, pixels = None, None
        for threads, level in [*((t, levels[-1]) for t in ((1, 3) if SANITIZED else (1, 2, 3))), *((2, lv) for lv in levels[:-1])]:
            env = clean_environment(PELL_SIMD=level)
            works(folder, *mesh, *more, '--threads', str(threads), '-o', 'a.pfm', env=env)
            data = (folder / 'a.pfm').read_bytes()
            first = first or data
            need(data == first, f'{more}: {threads} threads, {level}')
        works(folder, *mesh, *more, '--threads', '1', '-o', 'a.exr')
        works(folder, *mesh, *more, '--threads', '3', '-o', 'b.exr')
        for name in ('a.exr', 'b.exr'):
            data = (folder / name).read_bytes()
            end = exr_header(data)[2]
            blocks = (79 + 31) // 32
            chunks = data[end + 8 * blocks:]
            pixels = pixels or chunks
            need(chunks == pixels, f'{more}: layers of {name}')


# --- Ctrl-C -------------------------------------------------------------------------------------------------------------------------

def start(folder, *arguments, **more):
    return subprocess.Popen([PROGRAM, *arguments], cwd=folder, env=clean_environment(**more), stdin=subprocess.DEVNULL,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


def wait_for(truth, seconds=120):
    end = time.monotonic() + seconds
    while not truth():
        need(time.monotonic() < end, 'it takes too long')
        time.sleep(0.01)


@test('Ctrl-C before every pixel has a path keeps the picture that was there')
def _(folder):
    (folder / 'there.png').write_bytes(b'as it was')
    child = start(folder, 'render', 'bunny.obj', '--size', '70mm', '--material', 'wholemilk', '-m', 'path-trace', '--samples', '64',
                  '--width', '2000', '--height', '1500', '--msaa', '1', '--light-samples', '1', '--bounces', '0', '--threads', '1', '-o',
                  'there.png')
    time.sleep(2 if SANITIZED else 1)
    need(child.poll() is None, 'it ended before')
    child.send_signal(signal.SIGINT)
    error = child.communicate(timeout=60)[1]
    need(child.returncode == 130 and b'nothing was written' in error, child.returncode, error)
    need((folder / 'there.png').read_bytes() == b'as it was', 'the picture is another')


@test('Ctrl-C during a picture: exit 130 soon, no file, one object with --json')
def _(folder):
    before = names(folder)
    large = ['render', 'bunny.obj', '--size', '70mm', '--width', '2000', '--height', '1500', '--msaa', '64', '--light-samples', '1024']
    for delay, more in ((0.3, []), (0.6, ['--json']), (1.0, ['--quiet'])):
        child = start(folder, *large, '-o', 'big.png', *more)
        time.sleep(delay)
        need(child.poll() is None, 'it ended before', delay)
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
        need(child.returncode == 130, child.returncode, err)
        need(names(folder) == before, names(folder))
        if more == ['--json']:
            error = json.loads(out)['error']
            need(error['code'] == 'cancelled' and not err, error, err)
        need((b'nothing was written' in err) == (more == []), err)


@test('Ctrl-C during a turntable: pictures so far are whole, nothing else is left; before that a line of progress every 5 s')
def _(folder):
    before = set(names(folder))
    child = start(folder, *MESH, '--turntable', '100000', '-o', 't.png')
    line = b''
    while b'% ' not in line and b'%' not in line:
        line = child.stderr.readline()
        need(line, 'it ended')
    need(b'render: ' in line and b'%/s' in line and b's left' in line and b'\r' not in line, line)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    need(child.returncode == 130, child.returncode)
    new = sorted(set(names(folder)) - before)
    need(new and f'written before: {len(new)} images' in text(err), len(new), err)
    need(new == [f't_{i:05d}.png' for i in range(len(new))], new[:3], new[-3:])
    for name in new:
        png_pixels((folder / name).read_bytes())


@test('a second Ctrl-C ends it at once, and one ends a wait for a pipe\'s reader')
def _(folder):
    os.mkfifo(folder / 'pipe.pfm')
    child = start(folder, *MESH, '-o', 'pipe.pfm')
    time.sleep(1.5)
    need(child.poll() is None, 'it did not wait for a reader')
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=20)
    need(child.returncode == 130, child.returncode)
    child = start(folder, 'render', 'bunny.obj', '--size', '70mm', '--width', '4000', '--height', '3000', '-o', 'big.png')
    time.sleep(0.3)
    begin = time.monotonic()
    for _ in range(2):
        child.send_signal(signal.SIGINT)
        time.sleep(0.02)
    child.communicate(timeout=20)
    need(child.returncode == 130 and time.monotonic() - begin < 5, child.returncode)
    need('big.png' not in names(folder), names(folder))


def slow_start(folder, said, *arguments):
    """Until a library is in a call that cannot be interrupted."""
    if SANITIZED:
        raise Skip('a sanitizer wants to be loaded first')
    child = start(folder, *arguments, LD_PRELOAD=SLOW_LIBRARY)
    while (line := child.stderr.readline()) != said:
        need(line, 'it ended before')
    return child


@test('Ctrl-C is answered within half a second where a library builds and can not be asked to end')
def _(folder):
    before = names(folder)
    for number, more in ((signal.SIGINT, []), (signal.SIGINT, ['--json']), (signal.SIGTERM, ['--quiet'])):
        child = slow_start(folder, b'it builds\n', *MESH, '-o', 'a.png', *more)
        begin = time.monotonic()
        child.send_signal(number)
        out, err = child.communicate(timeout=60)
        seconds = time.monotonic() - begin
        need(child.returncode == 130 and names(folder) == before, child.returncode, names(folder))
        need(seconds < 2, 'it took', seconds)  # 0.3 s plus other load of the machine; the library takes 5 s
        if more == ['--json']:
            need(json.loads(out)['error'] == {'code': 'cancelled', 'where': '', 'what': 'stopped before it was done', 'hint': ''}, out)
        need((b'interrupted; nothing was written\n' in err) == (more == []), err)


@test('Ctrl-C while a file goes to the disk leaves no part of it, however long that takes')
def _(folder):
    (folder / 'a.png').write_bytes(b'old')
    child = slow_start(folder, b'it writes\n', *MESH, '-o', 'a.png')
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=60)
    need(not [n for n in names(folder) if n.endswith('.tmp')], names(folder))
    need((folder / 'a.png').read_bytes()[:8] == MAGIC['png'] or (folder / 'a.png').read_bytes() == b'old', 'half of a picture')


@test('an ignored Ctrl-C stays ignored, as for a job in the background')
def _(folder):
    child = subprocess.Popen([PROGRAM, *MESH, '--width', '640', '--height', '360', '-o', 'a.png'], cwd=folder, env=clean_environment(),
                             stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=120)
    need(child.returncode == 0 and 'a.png' in names(folder), child.returncode)


# --- Files of other programs ----------------------------------------------------------------------------------------------------------

def shared(path):
    root = os.environ.get('PELL_SHARED')
    if not root or not (pathlib.Path(root) / path).exists():
        raise Skip(f'shared/{path} is not there')
    return str(pathlib.Path(root) / path)


@test('a scanned head with textures: checked, rendered, loaded quickly')
def _(folder):
    head = shared('assets/head_lps/head.gltf')
    answer = one_object(works(folder, 'check', head, '--material', 'skin', '--json'))
    need(answer['triangles'] > 1000 and answer['textures'] > 0, answer['triangles'], answer['textures'])
    done = one_object(works(folder, 'render', head, '--material', 'skin', *SMALL, '-o', 'head.exr', '--json'))
    need(done['load_seconds'] < 60, done)
    need(len(exr_header((folder / 'head.exr').read_bytes())[1]) == 24, 'layers')


@test('the backs of single-sided faces are not seen, whatever the sign of a scale: Khronos\' case shows checks and no cross')
def _(folder):
    case = shared('assets/khronos/NegativeScaleTest/NegativeScaleTest.glb')
    works(folder, 'render', case, '--unit', '1m', '-m', 'none', '--width', '160', '--height', '120', '--msaa', '4', '-o', 'a.png')
    width, height, channels, rows = png_pixels((folder / 'a.png').read_bytes())
    pixels = [rows[i:i + 3] for i in range(0, len(rows), channels)]
    green = sum(g > 1.3 * max(r, b) for r, g, b in pixels)
    red = sum(r > 1.8 * max(g, b) and r > 80 for r, g, b in pixels)
    need(green > 40 and red == 0, green, 'green and', red, 'red pixels')


@test('a bunny of milk')
def _(folder):
    works(folder, 'render', shared('assets/bunny/bunny.obj'), '--size', '70mm', '--material', 'wholemilk', *SMALL, '-o', 'bunny.png')
    need(len(set(png_pixels((folder / 'bunny.png').read_bytes())[3])) > 20, 'one colour')


sys.exit(main())
