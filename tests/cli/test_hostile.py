#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_hostile.py PROGRAM ROOT: wrong, broken and malicious scenes, from outside: messages, exit codes, remaining files."""
import base64
import json
import os
import re
import struct
import sys
import zlib

from cli_test import SMALL, main, names, need, one_object, run, test, text, works

CUBE = ('v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n'
        'usemtl m12\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nusemtl other\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n')


def cube(folder, name='s.json', **more):
    (folder / 'cube.obj').write_text(CUBE, 'ascii')
    scene = {'pellucid': 1, 'mesh': 'cube.obj', 'size': '10mm', 'materials': {'*': {'preset': 'marble'}}}
    (folder / name).write_text(json.dumps(scene | more), 'utf-8')


def flat(data):
    return ' '.join(text(data).split())


def picture(width=2, height=2):
    def chunk(kind, body):
        return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
    return (b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 2, 0, 0, 0)) +
            chunk(b'IDAT', zlib.compress((b'\0' + bytes(range(3 * width))) * height)) + chunk(b'IEND', b''))


# --- Messages ---------------------------------------------------------------------------------------------------------------------

@test('a material in another spelling: check has the nearest name, or lists those that there are')
def _(folder):
    cube(folder, materials={'M12': {'preset': 'marble'}, 'skin': {'preset': 'skin1'}})
    said = flat(works(folder, 'check', 's.json').stdout)
    for part in ('no material is called "M12": nothing is changed by it; did you mean "m12"?', 'the files have m12, other'):
        need(part in said, part, said)
    problems = {p['where']: p for p in one_object(works(folder, 'check', 's.json', '--json'))['problems']}
    need(problems['s.json:/materials/M12']['hint'] == 'did you mean "m12"?', problems)
    need(problems['s.json:/materials/M12']['severity'] == 'warning', problems)


@test('the nearest of more names than are listed is found, and the list says that it goes on')
def _(folder):
    cube(folder, materials={'material-0299': {'preset': 'marble'}, 'quite another': {'preset': 'marble'}})
    (folder / 'cube.obj').write_text(CUBE + ''.join(f'usemtl Material-{i:04}\nf 1 2 3\n' for i in range(300)), 'ascii')
    said = flat(works(folder, 'check', 's.json').stdout)
    need('did you mean "Material-0299"?' in said, said)
    need(re.search(r'Material-00\d\d and 2\d\d more', said), said)


@test('a mesh without area: that is said, not the camera')
def _(folder):
    (folder / 'flat.obj').write_text('v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n', 'ascii')
    for more in ([], ['--material', 'marble'], ['-m', 'none']):
        said = flat(works(folder, 'render', 'flat.obj', '--size', '10mm', *SMALL, *more, '-o', 'a.png').stderr)
        need('nothing is in view none of the scene\'s triangles has an area' in said and 'camera' not in said, said)
    need('no area: the object is invisible' in flat(works(folder, 'check', 'flat.obj', '--size', '10mm').stdout))


@test('a broken picture: left out where something stands in its place, else refused, once')
def _(folder):
    (folder / 'e.hdr').write_bytes(b'junk')
    rect = {'type': 'point', 'at': [0, 9, 0], 'intensity': [1, 1, 1], 'project': 'e.hdr'}
    for more in ({'lights': [{'type': 'environment', 'image': 'e.hdr'}]}, {'background': {'image': 'e.hdr'}}, {'lights': [rect]}):
        cube(folder, **more)
        for command in (['check', 's.json'], ['render', 's.json', *SMALL, '-o', 'a.png']):
            done = run(folder, *command)
            said = flat(done.stderr)
            need(done.returncode == 3 and said.count('error:') == 1 and 'left out' not in said, said)
            need('the first bytes' in said and 'the image "e.hdr" can\'t be read' in said, said)
    cube(folder, materials={'*': {'preset': 'marble', 'textures': {'baseColor': 'e.hdr'}}})
    need('is left out' in flat(works(folder, 'render', 's.json', *SMALL, '-o', 'a.png').stderr))


@test('more things than a reader wants are counted')
def _(folder):
    tetrahedron = 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -2 -4 -1\n'
    (folder / 'many.obj').write_text(''.join(f'o thing{i}\n{tetrahedron}' for i in range(500)), 'ascii')
    done = works(folder, 'check', 'many.obj', '--size', '10mm')
    need(len(done.stdout.splitlines()) < 90, len(done.stdout.splitlines()))
    for part in ('and 480 more: --json lists them all', 'scene: 479 more objects that lie where another does'):
        need(part in flat(done.stdout), part, done.stdout)
    answer = one_object(works(folder, 'check', 'many.obj', '--size', '10mm', '--json'))
    need(len(answer['objects']) == 500 and len(answer['problems']) < 30, len(answer['problems']))
    need('and ' not in flat(works(folder, 'check', 'many.obj', '--size', '10mm', '--limit', 'warnings=500').stdout).split('Materials')[0])


@test('an open box is open: nothing is said of surfaces that cross')
def _(folder):
    (folder / 'open.obj').write_text(CUBE.replace('f 5 6 7 8\n', ''), 'ascii')
    said = flat(works(folder, 'render', 'open.obj', '--size', '10mm', '--material', 'marble', '-m', 'path-trace', '--samples', '4', *SMALL,
                      '-o', 'a.png').stderr)
    need('the surface is open' in said and 'cross' not in said, said)


@test('layered: a plain sum that would pass over a layer says so')
def _(folder):
    layers = [{'name': name, 'sigma_s': [1, 1, 1], 'sigma_t': [2, 2, 2], 'g': 0, 'depth': depth}
              for name, depth in (('skin', '0.1mm'), ('flesh', '4mm'))]
    cube(folder, materials={'*': {'layers': layers}})
    for knobs, warned in ((['march=sum'], True), (['march=sum', 'samples=50'], False), ([], False)):
        given = [a for k in knobs for a in ('--set', k)]
        said = flat(works(folder, 'render', 's.json', '-m', 'layered', *given, *SMALL, '-o', 'a.png').stderr)
        need(('skip layer "skin"' in said) == warned, knobs, said)
    need(run(folder, 'render', 's.json', '-m', 'layered', '--set', 'epsilon=1e-6', *SMALL, '-o', 'a.png').returncode == 2)


# --- Limits -----------------------------------------------------------------------------------------------------------------------

@test('nothing that was read is written over, by whatever name')
def _(folder):
    cube(folder, materials={'*': {'preset': 'marble', 'textures': {'baseColor': 'head.png'}}})
    (folder / 'head.png').write_bytes(picture())
    os.link(folder / 'cube.obj', folder / 'again.png')
    os.symlink('head.png', folder / 'link.png')
    (folder / 'head.json').write_bytes((folder / 's.json').read_bytes())
    before = {n: (folder / n).read_bytes() for n in names(folder)}
    for command in (['s.json', '-o', 'head.png'], ['s.json', '-o', './head.png'], ['s.json', '-o', 'link.png'],
                    ['s.json', '-o', 'again.png'], ['s.json', '--format', 'png', '-o', 'cube.obj'], ['head.json']):
        done = run(folder, 'render', *command, *SMALL)
        need(done.returncode == 2 and 'one of the files that were read' in flat(done.stderr), command, done.stderr)
    need({n: (folder / n).read_bytes() for n in names(folder)} == before, names(folder))
    works(folder, 'render', 's.json', *SMALL, '-o', 'errors.exr')
    works(folder, 'render', 's.json', *SMALL, '-m', 'none', '-o', 'plain.exr')
    before = (folder / 'errors.exr').read_bytes()
    done = run(folder, 'compare', 'errors.exr', 'plain.exr', '-o', '.')
    need(done.returncode == 2 and 'one of the files that were read' in flat(done.stderr), done.stderr)
    need((folder / 'errors.exr').read_bytes() == before and 'report.html' not in names(folder), names(folder))


@test('a full disk, a folder, no folder: refused, and nothing is left')
def _(folder):
    cube(folder)
    (folder / 'dir').mkdir()
    before = names(folder)
    for path, part in (('/dev/full', 'no space'), ('dir', 'is a folder'), ('none/x.png', 'its folder does not exist')):
        done = run(folder, 'render', 's.json', *SMALL, '--format', 'png', '-o', path)
        need(done.returncode == 3 and part in flat(done.stderr), path, done.stderr)
    need(names(folder) == before, names(folder))


# --- Reading ----------------------------------------------------------------------------------------------------------------------

def gltf(**more):
    points = base64.b64encode(struct.pack('<9f', 0, 0, 0, 1, 0, 0, 0, 1, 0)).decode('ascii')
    return json.dumps({'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0]}], 'nodes': [{'mesh': 0}],
                       'meshes': [{'primitives': [{'attributes': {'POSITION': 0}}]}],
                       'buffers': [{'byteLength': 36, 'uri': 'data:application/octet-stream;base64,' + points}],
                       'bufferViews': [{'buffer': 0, 'byteLength': 36}],
                       'accessors': [{'bufferView': 0, 'componentType': 5126, 'count': 3, 'type': 'VEC3'}]} | more)


def ply(header, body=b''):
    return ('ply\nformat binary_little_endian 1.0\n' + header + 'end_header\n').encode('ascii') + body


PLACES = 'property float x\nproperty float y\nproperty float z\n'
SCENE = '{"pellucid":1,"mesh":"cube.obj","size":"10mm"'
READ = {
    'bom.obj': '\ufeff' + CUBE, 'crlf.obj': CUBE.replace('\n', '\r\n'), 'cr.obj': CUBE.replace('\n', '\r'),
    'bom.json': '\ufeff' + SCENE + '}', 'long.obj': CUBE + '#' + 'x' * 1000000, 'na me ü.obj': CUBE,
    'self.obj': 'mtllib self.obj\n' + CUBE,
    'polygon.obj': 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf ' + '1 2 3 ' * 2000 + '\n', 'ok.gltf': gltf(),
}
REFUSED = { # and the required message
    'empty.obj': ('', 'holds no faces'), 'empty.glb': ('', 'empty file'), 'nul.obj': (CUBE.replace('v 1 0', 'v 1\0 0'), ':2:'),
    'nan.obj': (CUBE.replace('v 1 1 1', 'v nan inf 1e999'), 'must be a finite number'), 'faces.obj': ('f 1 2 3\n', 'before there is one'),
    'behind.obj': (CUBE + 'f -999999999999 1 2\n', '-999999999999'),
    'deep.json': ('{"pellucid":1,"mesh":' + '[' * 100000, 'nested deeper'),
    'twice.json': (SCENE + ',"mesh":"s.json"}', 'duplicate'),
    'itself.json': ('{"pellucid":1,"mesh":"itself.json"}', 'a mesh file is needed'),
    'big.json': (SCENE + ',"time":1e999}', 'overflow'), 'folder.json': (SCENE.replace('cube.obj', 'dir') + '}', 'is a folder'),
    'pipe.json': (SCENE.replace('cube.obj', 'pipe') + '}', 'is a pipe'),
    'loop.json': (SCENE.replace('cube.obj', 'loop') + '}', 'leads to itself'),
    'out.json': (SCENE.replace('cube.obj', 'out') + '}', 'leads out of'),
    'cycle.gltf': (gltf(nodes=[{'mesh': 0, 'children': [1]}, {'children': [0]}]), 'its own ancestor'),
    'tree.gltf': (gltf(nodes=[{'children': [i + 1, i + 1]} for i in range(40)] + [{'mesh': 0}]), 'a child'),
    'stride.gltf': (gltf(bufferViews=[{'buffer': 0, 'byteLength': 36, 'byteStride': -12}]), 'byteStride'),
    'count.gltf': (gltf(accessors=[{'bufferView': 0, 'componentType': 5126, 'count': 4294967295, 'type': 'VEC3'}]), 'count'),
    'matrix.gltf': (gltf(nodes=[{'mesh': 0, 'matrix': [1e38] * 16}]), '1e+38'),
    'pipe.gltf': (gltf(buffers=[{'byteLength': 36, 'uri': 'pipe'}]), 'is a pipe'),
    'escaped.gltf': (gltf(buffers=[{'byteLength': 36, 'uri': '%2e%2e/%2e%2e/etc/passwd'}]), 'leads out of'),
    'rows.ply': (ply('element vertex 4000000000\n' + PLACES), '4000000000'),
    'nothing.ply': (ply('element vertex 100000000\n'), 'must have x, y and z'),
    'list.ply': (ply('element vertex 3\n' + PLACES + 'element face 1\nproperty list uint int vertex_indices\n',
                     struct.pack('<9fI', *range(9), 4294967295)), 'a list has the length'),
    'short.glb': (b'glTF' + struct.pack('<III', 2, 0xffffffff, 0xfffffff0) + b'JSON', 'bytes'),
}
PICTURES = {
    'big.png': picture(2)[:16] + struct.pack('>II', 2**31 - 1, 2**31 - 1) + picture(2)[24:], 'short.png': picture()[:60],
    'sizes.pfm': b'PF\n99999999 99999999\n-1.0\n', 'scale.pfm': b'PF\n2 2\nnan\n' + bytes(48), 'minus.pfm': b'PF\n-4 4\n-1.0\n',
    'short.hdr': b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 16\n\x02\x02\x00\x10\xff',
    'junk.exr': b'\x76\x2f\x31\x01\x02\0\0\0' + b'\xff' * 500,
}


def fill(folder, files):
    cube(folder)
    (folder / 'dir').mkdir()
    os.mkfifo(folder / 'pipe')
    os.symlink('loop', folder / 'loop')
    os.symlink('/etc/passwd', folder / 'out')
    for name, content in files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode('utf-8'))


@test('a folder, a pipe, a picture or nothing in place of a file: the error names the place in the JSON, and what is there')
def _(folder):
    fill(folder, {})
    (folder / 'buffer.png').write_bytes(picture())
    for name, part in (('dir', '"dir" is a folder'), ('pipe', '"pipe" is a pipe'), ('none', '"none" can\'t be found'),
                       ('buffer.png', 'byteLength is 3600, but only')):
        cube(folder, mesh=name)
        (folder / 'b.gltf').write_text(json.dumps({
            'asset': {'version': '2.0'}, 'meshes': [{'primitives': [{'attributes': {'POSITION': 0}}]}], 'nodes': [{'mesh': 0}],
            'scenes': [{'nodes': [0]}], 'accessors': [{'bufferView': 0, 'componentType': 5126, 'count': 300, 'type': 'VEC3'}],
            'bufferViews': [{'buffer': 0, 'byteLength': 3600}], 'buffers': [{'byteLength': 3600, 'uri': name}]}), 'ascii')
        for file, json_path in (('s.json', '/mesh'), ('b.gltf', '/buffers/0')):
            said = flat(run(folder, 'check', file, timeout=60).stderr)
            need(name == 'buffer.png' and file == 's.json' or (f'{file}:{json_path}' in said and part in said), said)


@test('odd files that hold a mesh are read')
def _(folder):
    fill(folder, READ)
    for name in READ:
        works(folder, 'check', name, *([] if name.endswith(('.json', '.gltf')) else ['--size', '10mm']), timeout=60)


@test('files made to harm are refused with their reason, by check and render, and nothing is written')
def _(folder):
    fill(folder, {name: content for name, (content, _) in REFUSED.items()})
    before = names(folder)
    for name, (_, part) in REFUSED.items():
        size = ['--size', '10mm'] if name.endswith(('.obj', '.ply')) else []
        for command in (['check'], ['render', *SMALL, '-o', 'a.png']):
            done = run(folder, *command, name, *size, timeout=60)
            need(done.returncode == 3 and part in flat(done.stderr), name, done.returncode, done.stderr)
    need(names(folder) == before, names(folder))


@test('pictures made to harm are refused with their reason')
def _(folder):
    fill(folder, PICTURES)
    for name in PICTURES:
        cube(folder, lights=[{'type': 'environment', 'image': name}])
        done = run(folder, 'check', 's.json', timeout=60)
        need(done.returncode == 3 and f'the image "{name}" can\'t be read' in flat(done.stderr), name, done.stderr)
        need(run(folder, 'compare', name, name, timeout=60).returncode == 3, name)



@test('many objects share the texels of texture-space, and one line tells how they were laid out')
def _(folder):
    mesh, corners = '', [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    for i in range(27):
        mesh += f'o cube{i}\n' + ''.join(f'v {x + 2 * (i % 3)} {y + 2 * (i // 3 % 3)} {z + 2 * (i // 9)}\n' for x, y, z in corners)
        mesh += ''.join('f ' + ' '.join(str(k - 8) for k in f) + '\n' for f in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3),
                                                                               (0, 4, 6, 2), (1, 3, 7, 5)))
    (folder / 'cubes.obj').write_text(mesh, 'ascii')
    done = works(folder, 'render', 'cubes.obj', '--size', '30mm', '--material', 'marble', '-m', 'texture-space', '--set', 'size=512',
                 *SMALL, '--limit', 'memory-bytes=100000000', '-o', 'a.png')
    need(done.stderr.count(b'planar charts') == 1 and b'; so are 26 other objects' in done.stderr, done.stderr)


sys.exit(main())
