# SPDX-License-Identifier: MIT
"""Shared by the tests of the program: running it, small scenes, and readers of its output files. Standard library only.
PYTHONPATH has this folder (tests/meson.build)."""
import base64
import json
import math
import os
import pathlib
import re
import signal
import struct
import subprocess
import sys
import tempfile
import traceback
import zlib

PROGRAM = os.path.abspath(sys.argv[1])
ROOT = pathlib.Path(sys.argv[2]).resolve()
SANITIZED = 'PELL_SANITIZED' in os.environ # everything takes some ten times as long; slow.h has the same for C
EVENTS = f'events={8 if SANITIZED else 32}' # of a walk of path-trace: it is cut short, any number of samples and parts has the same bits
SMALL = ['--width', '48', '--height', '27', '--msaa', '1', '--light-samples', '2', '--indirect-samples', '256']
TESTS = []


class Skip(Exception):
    """The reason is the argument."""


def release_only(why='numbers, which the release build judges'):
    """Skips a test under the sanitizers: long renderings whose code other tests execute."""
    if SANITIZED:
        raise Skip(why)


def test(title):
    """Registers a function that takes a new folder."""
    def listed(function):
        TESTS.append((title, function))
        return function
    return listed


def clean_environment(**more):
    env = {k: v for k, v in os.environ.items() if k not in ('NO_COLOR', 'PELL_SHADERS', 'PELL_SIMD', 'POSIXLY_CORRECT', 'TERM')}
    return env | {'TERM': 'xterm'} | more


def run(folder, *arguments, env=None, **options):
    """Signal handlers are reset to a shell's defaults: the caller may have ignored some."""
    options = {'capture_output': True, 'timeout': 300, 'stdin': subprocess.DEVNULL} | options
    return subprocess.run([PROGRAM, *arguments], cwd=folder, env=env or clean_environment(), check=False,
                          preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL), **options)


def text(data):
    return data.decode('utf-8', 'replace')


def need(truth, *about):
    if not truth:
        raise AssertionError(' '.join(text(a) if isinstance(a, bytes) else str(a) for a in about))


def works(folder, *arguments, **options):
    done = run(folder, *arguments, **options)
    need(done.returncode == 0, arguments, 'ended with', done.returncode, done.stderr)
    return done


def finite(value, json_path=''):
    if isinstance(value, float):
        need(math.isfinite(value), json_path, 'is not finite')
    for key, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        finite(part, f'{json_path}/{key}')


def one_object(done):
    """stdout as exactly one JSON object."""
    def refuse(constant):
        raise AssertionError(f'{constant} is no JSON')
    answer = json.loads(done.stdout.decode('utf-8'), parse_constant=refuse)
    need(isinstance(answer, dict), 'no object:', done.stdout)
    finite(answer)
    return answer


def names(folder):
    return sorted(p.name for p in pathlib.Path(folder).iterdir())


# --- Scenes -------------------------------------------------------------------------------------------------------------------------

def sphere(radius=20.0, rows=10, columns=16):
    """Vertices and triangles of a closed ball."""
    vertices = [(0.0, -radius, 0.0)]
    for i in range(1, rows):
        a = math.pi * (i / rows - 0.5)
        for j in range(columns):
            b = 2 * math.pi * j / columns
            vertices.append((radius * math.cos(a) * math.sin(b), radius * math.sin(a), radius * math.cos(a) * math.cos(b)))
    vertices.append((0.0, radius, 0.0))
    top, faces = len(vertices) - 1, []

    def at(i, j):
        return 1 + (i - 1) * columns + j % columns
    for j in range(columns):
        faces += [(0, at(1, j + 1), at(1, j)), (at(rows - 1, j), at(rows - 1, j + 1), top)]
        for i in range(1, rows - 1):
            faces += [(at(i, j), at(i, j + 1), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i + 1, j))]
    return vertices, faces


def write_obj(path, vertices, faces):
    pathlib.Path(path).write_text(''.join(f'v {x:.6f} {y:.6f} {z:.6f}\n' for x, y, z in vertices) +
                                  ''.join('f ' + ' '.join(str(i + 1) for i in f) + '\n' for f in faces), 'ascii')


def write_gltf(path, vertices, faces):
    """In metres."""
    points = b''.join(struct.pack('<3f', *(0.001 * c for c in v)) for v in vertices)
    indices = b''.join(struct.pack('<3H', *f) for f in faces)
    low, high = ([0.001 * f(v[c] for v in vertices) for c in range(3)] for f in (min, max))
    uri = 'data:application/octet-stream;base64,' + base64.b64encode(points + indices).decode('ascii')
    pathlib.Path(path).write_text(json.dumps({
        'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0]}], 'nodes': [{'mesh': 0, 'name': 'ball'}],
        'meshes': [{'primitives': [{'attributes': {'POSITION': 0}, 'indices': 1, 'material': 0}]}], 'materials': [{'name': 'Skin'}],
        'accessors': [{'bufferView': 0, 'componentType': 5126, 'count': len(vertices), 'type': 'VEC3', 'min': low, 'max': high},
                      {'bufferView': 1, 'componentType': 5123, 'count': 3 * len(faces), 'type': 'SCALAR'}],
        'bufferViews': [{'buffer': 0, 'byteOffset': 0, 'byteLength': len(points)},
                        {'buffer': 0, 'byteOffset': len(points), 'byteLength': len(indices)}],
        'buffers': [{'byteLength': len(points) + len(indices), 'uri': uri}]}), 'ascii')


def write_scene(path, **render):
    pathlib.Path(path).write_text(json.dumps({'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm', 'materials': {'*': {'preset': 'marble'}},
                                              'render': render}), 'ascii')


# Corners of a box by bits x, y, z, and its faces, counter-clockwise seen from outside.
BOX_FACES = {'top': (4, 5, 7, 6), 'bottom': (0, 2, 3, 1), 'left': (0, 4, 6, 2), 'right': (1, 3, 7, 5), 'back': (2, 6, 7, 3),
             'front': (0, 1, 5, 4)}


def write_box(path, low, high, uv=True, size=1.0):
    """Each face has a third by a half of the map, with a margin."""
    lines, corners = [], [[(high if k >> d & 1 else low)[d] for d in range(3)] for k in range(8)]
    lines += ['v {:g} {:g} {:g}'.format(*c) for c in corners]
    for i in range(6):
        x, y = i % 3 / 3, i // 3 / 2
        for a, b in ((0.02, 0.02), (0.31, 0.02), (0.31, 0.48), (0.02, 0.48)):
            lines.append(f'vt {size * (x + a):.6f} {size * (y + b):.6f}')
    for i, face in enumerate(BOX_FACES.values()):
        words = [f'{c + 1}/{4 * i + k + 1}' if uv else str(c + 1) for k, c in enumerate(face)]
        lines.append('f ' + ' '.join(words))
    path.write_text('\n'.join(lines) + '\n')


def furnish(folder):
    """The files that the examples of the help name."""
    folder = pathlib.Path(folder)
    write_obj(folder / 'bunny.obj', *sphere())
    write_gltf(folder / 'head.gltf', *sphere())
    write_scene(folder / 'scene.json')
    write_box(folder / 'arm.obj', (0, 0, 0), (20, 20, 6))
    write_box(folder / 'vein.obj', (-1, 8, 3), (21, 12, 5))
    (folder / 'studio.hdr').write_bytes(b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n' + bytes((90, 100, 120, 128)) * 32)
    (folder / 'wax.json').write_text('{"sigma_a": [0.006, 0.03, 0.12], "sigma_s_reduced": [1.4, 1.25, 1.1], "eta": 1.44}', 'ascii')


# --- Images -------------------------------------------------------------------------------------------------------------------------

def png_chunks(data):
    need(data[:8] == b'\x89PNG\r\n\x1a\n', 'no PNG')
    chunks, at = [], 8
    while at < len(data):
        size, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        need(zlib.crc32(kind + body) == struct.unpack('>I', data[at + 8 + size:at + 12 + size])[0], kind, 'has a wrong check sum')
        chunks.append((kind.decode('ascii'), body))
        at += 12 + size
    need(chunks[-1][0] == 'IEND', 'the PNG is not whole')
    return chunks


def paeth(a, b, c):
    p = a + b - c
    da, db, dc = abs(p - a), abs(p - b), abs(p - c)
    return a if da <= db and da <= dc else b if db <= dc else c


def unfiltered(mode, line, above, channels):
    """A row of a PNG file without its filter, one of types 1 to 4."""
    if mode == 2:
        return bytes([(x + b) & 255 for x, b in zip(line, above)])
    done = bytearray(channels) + line  # the pixel on the left of a row is 0
    if mode == 1:
        for x in range(channels, len(done)):
            done[x] = (done[x] + done[x - channels]) & 255
    elif mode == 3:
        for x, b in enumerate(above, channels):
            done[x] = (done[x] + (done[x - channels] + b) // 2) & 255
    elif mode == 4:
        for x, (b, c) in enumerate(zip(above, bytes(channels) + above), channels):
            done[x] = (done[x] + paeth(done[x - channels], b, c)) & 255
    return bytes(done[channels:])


def png_pixels(data):
    """Width, height, channels, and the rows' bytes."""
    chunks = png_chunks(data)
    width, height, bits, kind = struct.unpack('>IIBB', chunks[0][1][:10])
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[kind]
    need(bits == 8, f'{bits} bits')
    raw = zlib.decompress(b''.join(body for name, body in chunks if name == 'IDAT'))
    stride, rows, above = width * channels, [], bytes(width * channels)
    for y in range(height):
        mode, line = raw[y * (stride + 1)], raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)]
        need(mode <= 4, f'a row has filter {mode}')
        above = unfiltered(mode, line, above, channels) if mode else line
        rows.append(above)
    return width, height, channels, b''.join(rows)


def png_text(data):
    """Text attributes by name."""
    found = {}
    for kind, body in png_chunks(data):
        if kind == 'tEXt':
            name, value = body.split(b'\0', 1)
            found[name.decode('latin-1')] = value.decode('latin-1')
        elif kind == 'iTXt':
            name, rest = body.split(b'\0', 1)
            found[name.decode('latin-1')] = rest[2:].split(b'\0', 2)[2].decode('utf-8')
    return found


def exr_header(data):
    """Attributes by name, channel names, and where the header ends."""
    need(struct.unpack('<I', data[:4])[0] == 20000630, 'no EXR')
    attributes, channels, at = {}, [], 8
    while data[at]:
        end = data.index(0, at)
        name, at = text(data[at:end]), end + 1
        end = data.index(0, at)
        kind, at = text(data[at:end]), end + 1
        size, = struct.unpack('<i', data[at:at + 4])
        body, at = data[at + 4:at + 4 + size], at + 4 + size
        if kind == 'string':
            attributes[name] = text(body)
        elif kind == 'chlist':
            while body[0]:
                channel, body = body.split(b'\0', 1)
                channels.append((text(channel), struct.unpack('<i', body[:4])[0]))
                body = body[16:]
    return attributes, channels, at + 1


# --- TAP ----------------------------------------------------------------------------------------------------------------------------

def main():
    print(f'1..{len(TESTS)}')
    failed = 0
    for number, (title, function) in enumerate(TESTS, 1):
        with tempfile.TemporaryDirectory(prefix='pellucid-') as folder:
            furnish(folder)
            try:
                function(pathlib.Path(folder))
                print(f'ok {number} - {title}')
            except Skip as reason:
                print(f'ok {number} - {title} # SKIP {reason}')
            except Exception as fault:  # any exception in a test is a failure of that test
                failed += 1
                print(f'not ok {number} - {title}')
                shown = str(fault) if isinstance(fault, AssertionError) and str(fault) else traceback.format_exc()
                print('# ' + re.sub(r'[^\n -~]', '?', shown).strip().replace('\n', '\n# '))
        sys.stdout.flush()
    return 1 if failed else 0
