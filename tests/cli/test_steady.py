#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Usage: test_steady.py PELLUCID ROOT

Sequences of a skinned glTF are temporally stable: only the shading of moving parts changes from frame to frame, not the maps of
texture-space. TAP."""
import base64
import json
import math
import struct
import sys

from cli_test import main, need, test, works

RINGS, SIDES, HIGH, RADIUS = 24, 16, 0.080, 0.010  # a finger, m
FRAMES, WIDTH, HEIGHT = 5, 48, 36


def finger():
    """A closed tube along y whose upper half a joint bends back and forth; each vertex follows two joints by its height."""
    position, normal, joints, weights, index = [], [], [], [], []
    for r in range(RINGS + 1):
        round_end = min(r, RINGS - r)
        radius = RADIUS * (math.sin(math.pi / 2 * min(round_end / 4, 1.0)) if round_end < 4 else 1.0)
        y = HIGH * r / RINGS
        w = min(max((y / HIGH - 0.35) / 0.3, 0.0), 1.0)
        for s in range(SIDES):
            a = 2 * math.pi * s / SIDES
            position += [max(radius, 1e-4) * math.cos(a), y, max(radius, 1e-4) * math.sin(a)]
            up = (-1 if r < RINGS / 2 else 1) * max(1 - round_end / 4, 0.0)
            n = math.hypot(1.0, up)
            normal += [math.cos(a) / n, up / n, math.sin(a) / n]
            joints += [0, 1, 0, 0]
            weights += [1 - w, w, 0.0, 0.0]
    for r in range(RINGS):
        for s in range(SIDES):
            a, b = r * SIDES + s, r * SIDES + (s + 1) % SIDES
            index += [a, a + SIDES, b + SIDES, a, b + SIDES, b]
    for r in (0, RINGS):
        for s in range(1, SIDES - 1):
            ring = [r * SIDES, r * SIDES + s, r * SIDES + s + 1]
            index += ring if r == 0 else ring[::-1]
    times = [0.1 * i for i in range(11)]
    turns = []
    for t in times:
        half = 0.35 * math.sin(2 * math.pi * t)
        turns += [math.sin(half), 0.0, 0.0, math.cos(half)]
    identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
    bind = identity + [0, 0, 0, 1] + identity + [0, -HIGH / 2, 0, 1]
    views, accessors, data = [], [], b''

    def put(values, code, component, kind, bounds=False):
        nonlocal data
        width = {'SCALAR': 1, 'VEC3': 3, 'VEC4': 4, 'MAT4': 16}[kind]
        raw = struct.pack(f'<{len(values)}{code}', *values)
        views.append({'buffer': 0, 'byteOffset': len(data), 'byteLength': len(raw)})
        accessor = {'bufferView': len(views) - 1, 'componentType': component, 'count': len(values) // width, 'type': kind}
        if bounds:
            accessor |= {'min': [min(values[i::width]) for i in range(width)], 'max': [max(values[i::width]) for i in range(width)]}
        accessors.append(accessor)
        data += raw + bytes(-len(raw) % 4)
        return len(accessors) - 1

    attributes = {'POSITION': put(position, 'f', 5126, 'VEC3', True), 'NORMAL': put(normal, 'f', 5126, 'VEC3'),
                  'JOINTS_0': put(joints, 'B', 5121, 'VEC4'), 'WEIGHTS_0': put(weights, 'f', 5126, 'VEC4')}
    indices, inverse = put(index, 'H', 5123, 'SCALAR'), put(bind, 'f', 5126, 'MAT4')
    clock, rotation = put(times, 'f', 5126, 'SCALAR', True), put(turns, 'f', 5126, 'VEC4')
    return {'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0, 1]}],
            'nodes': [{'mesh': 0, 'skin': 0}, {'children': [2]}, {'translation': [0, HIGH / 2, 0]}],
            'meshes': [{'primitives': [{'attributes': attributes, 'indices': indices}]}],
            'skins': [{'joints': [1, 2], 'inverseBindMatrices': inverse}],
            'animations': [{'samplers': [{'input': clock, 'output': rotation}],
                            'channels': [{'sampler': 0, 'target': {'node': 2, 'path': 'rotation'}}]}],
            'accessors': accessors, 'bufferViews': views,
            'buffers': [{'byteLength': len(data), 'uri': 'data:application/octet-stream;base64,' + base64.b64encode(data).decode()}]}


def read_pfm(path):
    values = struct.unpack(f'<{3 * WIDTH * HEIGHT}f', path.read_bytes().split(b'\n', 3)[3])
    return [values[i:i + 3] for i in range(0, len(values), 3)]


def film(folder, method):
    works(folder, 'render', 'finger.gltf', '--material', 'skin1', '-m', method, '--frames', f'0.5:{0.5 + 0.001 * (FRAMES - 1)}:0.001',
          '--width', str(WIDTH), '--height', str(HEIGHT), '--msaa', '1', '--light-samples', '2', '--indirect-samples', '256', '--from',
          '35,15', '--studio', 'back', '--background', 'black', '-q', '-o', f'{method}.pfm')
    return [read_pfm(folder / f'{method}_{i:04d}.pfm') for i in range(FRAMES)]


def inside(frames):
    """Pixels that all frames cover, with all their neighbours: silhouettes change from frame to frame whatever the maps are."""
    covered = [all(max(f[i]) > 0.0 for f in frames) for i in range(WIDTH * HEIGHT)]
    around = (0, 1, -1, WIDTH, -WIDTH)
    return [i for i in range(WIDTH + 1, WIDTH * (HEIGHT - 1) - 1) if all(covered[i + k] for k in around)]


def changes(frames, pixels):
    """Mean second difference of frames a thousandth of a second apart, and the change from first to last, relative to the mean."""
    mean = sum(sum(frames[0][i]) for i in pixels)
    second = sum(abs(a - 2 * b + c) for f in zip(frames, frames[1:], frames[2:]) for i in pixels for a, b, c in zip(*(g[i] for g in f)))
    first = sum(abs(a - b) for i in pixels for a, b in zip(frames[0][i], frames[-1][i]))
    return second / (FRAMES - 2) / mean, first / mean


@test('a skinned mesh lit from behind changes smoothly with texture-space')
def steady(folder):
    (folder / 'finger.gltf').write_text(json.dumps(finger()))
    plain, scattered = film(folder, 'none'), film(folder, 'texture-space')
    pixels = inside(plain)
    plain, scattered = changes(plain, pixels), changes(scattered, pixels)
    print(f'# of {len(pixels)} pixels: second difference {scattered[0]:.5f} of the mean, without scattering {plain[0]:.5f}; from the first '
          f'frame to the last {scattered[1]:.4f}, {plain[1]:.4f}')
    need(plain[1] > 0.005, 'nothing moves')
    need(scattered[0] < 0.0008, scattered, plain)


if __name__ == '__main__':
    sys.exit(main())
