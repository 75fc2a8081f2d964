#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_animation.py PROGRAM ROOT: frames of an animation in which objects shrink to nothing."""
import base64
import json
import struct
import sys

from cli_test import main, need, png_pixels, run, test, text, works

QUICK = ['--width', '48', '--height', '32', '--msaa', '1', '--light-samples', '1', '--indirect-samples', '256']


def flat(data):
    return ' '.join(text(data).split())


def growing(scales, above):
    """A glTF of a tetrahedron whose scale is animated over two seconds, or that of the node above it."""
    data = struct.pack('<12f', 0, 0, 0, 0.02, 0, 0, 0, 0.02, 0, 0, 0, 0.02) + struct.pack('<12H', 0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2)
    data += struct.pack('<3f', 0, 1, 2) + struct.pack('<9f', *(s for s in scales for _ in range(3)))
    accessors = [{'componentType': 5126, 'count': 4, 'type': 'VEC3', 'min': [0, 0, 0], 'max': [0.02] * 3},
                 {'componentType': 5123, 'count': 12, 'type': 'SCALAR'},
                 {'componentType': 5126, 'count': 3, 'type': 'SCALAR', 'min': [0], 'max': [2]},
                 {'componentType': 5126, 'count': 3, 'type': 'VEC3'}]
    uri = 'data:application/octet-stream;base64,' + base64.b64encode(data).decode()
    return {'asset': {'version': '2.0'}, 'buffers': [{'byteLength': len(data), 'uri': uri}],
            'bufferViews': [{'buffer': 0, 'byteOffset': a, 'byteLength': n} for a, n in ((0, 48), (48, 24), (72, 12), (84, 36))],
            'accessors': [a | {'bufferView': i} for i, a in enumerate(accessors)],
            'meshes': [{'primitives': [{'attributes': {'POSITION': 0}, 'indices': 1}]}],
            'nodes': [{'mesh': 0, 'name': 'leaf'}, {'name': 'branch', 'children': [0]}], 'scenes': [{'nodes': [1]}], 'scene': 0,
            'animations': [{'samplers': [{'input': 2, 'output': 3}],
                            'channels': [{'sampler': 0, 'target': {'node': int(above), 'path': 'scale'}}]}]}


@test('where all shrinks to nothing, the frame is the background, and the others follow; a still is an error')
def _(folder):
    small = ['--material', 'wholemilk', '--background', 'grey', *QUICK]
    for above, name in ((False, 'leaf'), (True, 'branch')):
        (folder / 'g.gltf').write_text(json.dumps(growing([0, 1, 1e-6], above)))
        for method in ('screen-space', 'path-trace'):
            more = ['--samples', '1'] if method == 'path-trace' else []
            said = flat(works(folder, 'render', 'g.gltf', *small, '-m', method, *more, '--frames', '0:2:1', '-o', 'g.png').stderr)
            need(f"/nodes/{int(above)}: the node's scale is 0" in said and f'shrunk to nothing ({name})' in said, said)
            frames = [png_pixels((folder / f'g_000{i}.png').read_bytes())[3] for i in range(3)]
            need(frames[0] == frames[2] and len(set(frames[0])) == 1 < len(set(frames[1])), method, len(set(frames[0])))
        still = growing([0, 1, 1], above)
        still['nodes'][int(above)]['scale'] = [0, 0, 0]
        (folder / 'still.gltf').write_text(json.dumps(still))
        for size in ([], ['--size', '40mm']):
            done = run(folder, 'render', 'still.gltf', *small, *size, '-o', 's.png')
            need(done.returncode == 3 and f'the scale of "{name}" is 0' in flat(done.stderr), done.returncode, done.stderr)
    works(folder, 'render', 'g.gltf', '--ground', '--size', '40mm', *QUICK, '--frames', '0:1:1', '-o', 'g.png')


@test('--bounces with path-trace, which has a knob of that name, is said')
def _(folder):
    (folder / 'g.gltf').write_text(json.dumps(growing([1, 1, 1], False)))
    trace = ['render', 'g.gltf', '-m', 'path-trace', *QUICK, '--samples', '1', '-o', 'g.png']
    need('has no effect on method path-trace' in flat(works(folder, *trace, '--bounces', '0').stderr))
    for more in ([], ['--bounces', '0', '--set', 'bounces=0']):
        need('has no effect' not in flat(works(folder, *trace, *more).stderr), more)


if __name__ == '__main__':
    sys.exit(main())
