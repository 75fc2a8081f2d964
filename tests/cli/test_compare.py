#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_compare.py PROGRAM ROOT: `compare` of two pictures: numbers of closed forms, masks, halves, layers, files, refusals."""
import json
import math
import random
import re
import struct
import sys
import zlib

from cli_test import ROOT, SMALL, main, names, need, one_object, png_pixels, run, test, text, works

KEYS = {'pixels', 'mse', 'rel_mse', 'mae', 'bias', 'rel_bias', 'ssim', 'ssim_rgb', 'flip', 'flip_hdr', 'noise_mse', 'noise_rel_mse'}


def write_pfm(path, value, width=40, height=30):
    """value(x, y) gives r, g, b; y counts from the top."""
    rows = [b''.join(struct.pack('<3f', *value(x, y)) for x in range(width)) for y in reversed(range(height))]
    path.write_bytes(f'PF\n{width} {height}\n-1\n'.encode('ascii') + b''.join(rows))


def write_png(path, value, width=40, height=30):
    """8 bit; value(x, y) gives 3 or 4 numbers."""
    lines = b''.join(b'\0' + b''.join(bytes(value(x, y)) for x in range(width)) for y in range(height))
    kind = 6 if len(value(0, 0)) == 4 else 2
    def chunk(name, body):
        return struct.pack('>I', len(body)) + name + body + struct.pack('>I', zlib.crc32(name + body))
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, kind, 0, 0, 0)) +
                     chunk(b'IDAT', zlib.compress(lines)) + chunk(b'IEND', b''))


def pictures(folder):
    write_pfm(folder / 'b.pfm', lambda x, y: (0.5, 0.25, 1.0))
    write_pfm(folder / 'a.pfm', lambda x, y: (0.75, 0.25, 0.5))
    write_png(folder / 'mask.png', lambda x, y: (255 if x < 10 else 0,) * 3)


def near(a, b, tolerance=1e-6):
    need(abs(a - b) <= tolerance * max(abs(b), 1e-9), a, 'should be', b)


@test('closed forms of constant pictures, and the keys that are promised')
def _(folder):
    pictures(folder)
    answer = one_object(works(folder, 'compare', 'a.pfm', 'b.pfm', '--floor', '1', '--json'))
    method, = answer['methods']
    need(set(method) == KEYS | {'name', 'against', 'bad_pixels', 'whole'} and set(method['whole']) == KEYS, sorted(method))
    need(answer['reference'] == {'name': 'b.pfm', 'rel_noise': None, 'bad_pixels': 0}, answer['reference'])
    need((answer['width'], answer['height'], answer['mask'], answer['layer']) == (40, 30, None, 'R,G,B'), answer)
    need(method['name'] == 'a.pfm' and method['against'] == 'reference' and method['pixels'] == 1200, method)
    mean = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722
    near(method['mse'], (0.0625 + 0.25) / 3)
    near(method['rel_mse'], (0.0625 / (0.25 + mean ** 2) + 0.25 / (1 + mean ** 2)) / 3)
    near(method['mae'], 0.25)
    for got, wanted in zip(method['bias'] + method['rel_bias'], (0.25, 0, -0.5, 0.5, 0, -0.5)):
        need(abs(got - wanted) < 1e-6, got, wanted)
    need(method['whole'] == {k: method[k] for k in KEYS}, 'whole differs without a mask')
    need(0.1 < method['flip'] < 1 and 0.1 < method['flip_hdr'] < 1 and 0 < method['ssim'] < 1, method)
    told = re.search(r'^\| `compare` \| (.*) \|$', (ROOT / 'docs/guide/command-line.md').read_text('utf-8'), re.MULTILINE)[1]
    told = set(re.findall(r'`([a-z_]+)`', told))
    keys = set(answer) | set(method) | set(answer['reference']) | set(answer['hdr_exposures'])
    need(keys <= told, 'the guide does not tell', sorted(keys - told))
    table = text(works(folder, 'compare', 'a.pfm', 'b.pfm').stdout)
    need('a.pfm against b.pfm, 40 x 30' in table and 'flip hdr' in table and 'masked' not in table, table)


@test('alike is 0 and 1, also of what a display shows; green against blue is FLIP 1')
def _(folder):
    pictures(folder)
    for name in ('a.pfm', 'mask.png'):
        m = one_object(works(folder, 'compare', name, name, '--json'))['methods'][0]
        need((m['mse'], m['rel_mse'], m['mae'], m['flip'], m['ssim']) == (0, 0, 0, 0, 1), m)
        need(m['flip_hdr'] == (None if name == 'mask.png' else 0), m)
    for name, rgb in (('green', (0, 255, 0)), ('blue', (0, 0, 255)), ('black', (0, 0, 0)), ('white', (255, 255, 255))):
        write_png(folder / f'{name}.png', lambda x, y, rgb=rgb: rgb)
    near(one_object(works(folder, 'compare', 'green.png', 'blue.png', '--json'))['methods'][0]['flip'], 1, 1e-5)
    near(one_object(works(folder, 'compare', 'white.png', 'black.png', '--json'))['methods'][0]['flip'], 0.967382, 1e-4)


@test('masks: a file, alpha, none')
def _(folder):
    write_pfm(folder / 'b.pfm', lambda x, y: (1, 1, 1))
    write_pfm(folder / 'a.pfm', lambda x, y: (2, 1, 1) if x < 10 else (1, 1, 1))
    write_png(folder / 'mask.png', lambda x, y: (255 if x < 10 else 0,) * 3)
    answer = one_object(works(folder, 'compare', 'a.pfm', 'b.pfm', '--mask', 'mask.png', '--json'))
    method = answer['methods'][0]
    need((answer['mask'], method['pixels'], method['whole']['pixels']) == ('mask.png', 300, 1200), answer)
    near(method['bias'][0], 1)
    near(method['whole']['bias'][0], 0.25)
    write_png(folder / 'a.png', lambda x, y: (9, 9, 9, 255))
    write_png(folder / 'b.png', lambda x, y: (9, 9, 9, 255 if y < 3 else 90))
    for mask, pixels in ((['--mask', 'alpha'], 120), ([], 120), (['--mask', 'none'], 1200)):
        need(one_object(works(folder, 'compare', 'a.png', 'b.png', *mask, '--json'))['methods'][0]['pixels'] == pixels, mask)


@test('what is not finite is counted, warned of, and left out')
def _(folder):
    pictures(folder)
    clean = one_object(works(folder, 'compare', 'a.pfm', 'b.pfm', '--json'))['methods'][0]
    write_pfm(folder / 'a.pfm', lambda x, y: (math.nan, math.inf, 0) if x == y else (0.75, 0.25, 0.5))
    done = works(folder, 'compare', 'a.pfm', 'b.pfm', '--json')
    answer = one_object(done)
    method = answer['methods'][0]
    need(method['bad_pixels'] == 30 and method['pixels'] == 1170 and answer['reference']['bad_pixels'] == 0, method)
    near(method['mse'], clean['mse'])
    need(any('30 pixels are not finite' in w for w in answer['warnings']), answer['warnings'])


@test('halves of a reference: its noise is stated and taken off')
def _(folder):
    sample = random.Random(1).random
    for half in (1, 2):
        write_pfm(folder / f'h{half}.pfm', lambda x, y: (0.95 + 0.1 * sample(), 1, 0.95 + 0.1 * sample()), 100, 100)
    write_pfm(folder / 'a.pfm', lambda x, y: (1, 1, 1), 100, 100)
    answer = one_object(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--half', 'h2.pfm', '--json'))
    method = answer['methods'][0]
    near(method['noise_mse'], 0.01 / 24 * 2 / 3, 0.1)  # uniform numbers, in two channels of three
    need(method['mse'] < 0.1 * method['noise_mse'], method)
    near(answer['reference']['rel_noise'], math.sqrt(method['noise_rel_mse']))
    alone = one_object(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--json'))['methods'][0]
    near(alone['mse'], 0.01 / 12 * 2 / 3, 0.1)
    need('noise, mse' in text(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--half', 'h2.pfm').stdout))


@test('layers of a picture from here: alpha is the mask, the exposure is that of its PNG')
def _(folder):
    for method, name in (('none', 'plain.exr'), ('screen-space', 'milk.exr')):
        works(folder, 'render', 'bunny.obj', '--material', 'wholemilk', '--size', '40mm', *SMALL, '-m', method, '-o', name)
    answer = one_object(works(folder, 'compare', 'plain.exr', 'milk.exr', '--layer', 'diffuse.multiple', '--json'))
    m = answer['methods'][0]
    need(answer['mask'] == 'alpha' and answer['layer'] == 'diffuse.multiple' and 20 < m['pixels'] < m['whole']['pixels'], answer)
    need(m['mse'] > 0 and 0 < m['flip'] < 1, m)
    exposure = one_object(works(folder, 'render', 'bunny.obj', '--material', 'wholemilk', '--size', '40mm', *SMALL, '--json'))['exposure']
    near(answer['exposure'], exposure, 1e-5)
    one_object(works(folder, 'compare', 'milk.exr', 'milk.exr', '--layer', 'depth', '--json'))
    one_object(works(folder, 'compare', 'milk.exr', 'milk.exr', '--layer', 'normal', '--mask', 'none', '--json'))
    done = run(folder, 'compare', 'plain.exr', 'milk.exr', '--layer', 'diffuse.single')
    need(done.returncode == 3 and b'diffuse.multiple' in done.stderr, done.stderr)


@test('-o writes maps and the numbers, the same bytes for any number of threads, over what was there')
def _(folder):
    pictures(folder)
    (folder / 'out').mkdir()
    (folder / 'out/flip.png').write_text('old', 'ascii')
    for threads, out in (('1', 'out'), ('3', 'more/')):
        done = works(folder, 'compare', 'a.pfm', 'b.pfm', '--mask', 'mask.png', '-o', out, '--threads', threads, '--json')
        need(names(folder / out) == ['errors.exr', 'flip.png', 'flip_hdr.png', 'metrics.json', 'relative.png'], names(folder / out))
        need(json.loads((folder / out / 'metrics.json').read_text('utf-8'))['methods'][0]['mse'] > 0)
        need(abs(one_object(done)['methods'][0]['mae'] - 0.25) < 1e-6)
    for name in ('flip.png', 'flip_hdr.png', 'relative.png'):
        data = (folder / 'out' / name).read_bytes()
        need(data == (folder / 'more' / name).read_bytes(), name)
        need(png_pixels(data)[:3] == (40, 30, 3), name)
    # (0.2126 x 0.25 - 0.0722 x 0.5)/(Y + 1 %) = 0.047: a tenth of the way to red
    r, g, b = png_pixels((folder / 'out/relative.png').read_bytes())[3][:3]
    need(221 <= r <= 242 and r > g > b > 190, r, g, b)
    works(folder, 'compare', 'mask.png', 'mask.png', '-o', 'display')
    need(names(folder / 'display') == ['errors.exr', 'flip.png', 'metrics.json', 'relative.png'], names(folder / 'display'))


REFUSALS = {  # arguments: exit code, what is said
    ('a.pfm',): (2, "can't be compared in one go yet"),
    ('scene.json', '--methods', 'all'): (2, "can't be compared in one go yet"),
    ('a.pfm', 'b.pfm', 'c.pfm'): (2, 'one argument too many'),
    ('a.pfm', 'no.pfm'): (3, 'no such file'),
    ('a.pfm', 'wide.pfm'): (3, '40 x 30 pixels, but wide.pfm is 41 x 30'),
    ('a.pfm', 'mask.png'): (3, 'what a display shows'),
    ('mask.png', 'a.pfm'): (3, 'what a display shows'),
    ('a.pfm', 'cut.pfm'): (3, 'cut.pfm'),
    ('a.pfm', 'bunny.obj'): (3, 'bunny.obj'),
    ('a.pfm', '.'): (3, ''),
    ('a.pfm', 'b.pfm', '--layer', 'depth'): (3, 'only OpenEXR files have layers'),
    ('a.pfm', 'b.pfm', '--mask', 'alpha'): (3, 'no alpha'),
    ('a.pfm', 'b.pfm', '--mask', 'black.png'): (3, 'no pixel is in the mask'),
    ('a.pfm', 'b.pfm', '--mask', 'wide.pfm'): (3, 'wide.pfm'),
    ('a.pfm', 'b.pfm', '--mask', 'no.png'): (3, 'no.png'),
    ('a.pfm', 'b.pfm', '--half', 'wide.pfm'): (3, 'wide.pfm'),
    ('a.pfm', 'b.pfm', '--half', 'mask.png'): (3, 'half of a reference'),
    ('nan.pfm', 'b.pfm'): (3, 'no pixel of both pictures is finite'),
    ('a.pfm', 'b.pfm', '--ppd', '0'): (2, '[1, 400]'),
    ('a.pfm', 'b.pfm', '--ppd', 'nan'): (2, 'nan'),
    ('a.pfm', 'b.pfm', '--floor', '0'): (2, 'floor'),
    ('a.pfm', 'b.pfm', '--tonemap', 'acse'): (2, 'aces'),
    ('a.pfm', 'b.pfm', '--threads', '257'): (2, '[0, 256]'),
    ('a.pfm', 'b.pfm', '--limit', 'image-pixels=1199'): (3, 'image-pixels'),
    ('a.pfm', 'b.pfm', '--limit', 'memory-bytes=1048576'): (5, 'memory'),
    ('a.pfm', 'b.pfm', '-o', 'b.pfm'): (3, 'is no folder'),
    ('a.pfm', 'b.pfm', '-o', 'no/such'): (3, "can't be made"),
    ('a.pfm', 'b.pfm', '-o', 'x' * 5000): (2, 'too long'),
}


@test('what is refused, with its exit code and reason, and that nothing is written then')
def _(folder):
    pictures(folder)
    write_pfm(folder / 'wide.pfm', lambda x, y: (1, 1, 1), 41)
    write_pfm(folder / 'nan.pfm', lambda x, y: (math.nan, 0, 0))
    write_png(folder / 'black.png', lambda x, y: (0, 0, 0))
    (folder / 'cut.pfm').write_bytes((folder / 'a.pfm').read_bytes()[:-5])
    before = names(folder)
    for arguments, (code, what) in REFUSALS.items():
        done = run(folder, 'compare', *arguments)
        said = ' '.join(text(done.stderr).split())
        need(done.returncode == code and what in said and not done.stdout, arguments, done.returncode, said)
        need(said.count('error:') == 1, arguments, said)
        error = one_object(run(folder, 'compare', *arguments, '--json'))['error']
        need(error['what'], arguments, error)
    need(names(folder) == before, names(folder))


sys.exit(main())
