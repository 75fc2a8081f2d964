#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_compare.py PROGRAM ROOT: `compare` of two images and of methods on a scene: numbers against closed forms, masks, halves, layers,
files, the report, refusals."""
import base64
import json
import math
import random
import re
import signal
import struct
import subprocess
import sys
import time
import zlib

from cli_test import (PROGRAM, ROOT, SANITIZED, SMALL, clean_environment, exr_header, main, names, need, one_object, png_pixels,
                      release_only, run, test, text, works)

KEYS = {'pixels', 'mse', 'rel_mse', 'mae', 'bias', 'rel_bias', 'ssim', 'ssim_rgb', 'flip', 'flip_hdr', 'noise_mse', 'noise_rel_mse',
        'mse_error', 'rel_mse_error', 'bias_error', 'rel_bias_error', 'not_resolved', 'agreement'}


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
    need(method['not_resolved'] is method['agreement'] is method['mse_error'] is None, method)
    need(method['whole'] == {k: method[k] for k in KEYS}, 'whole differs without a mask')
    need(0.1 < method['flip'] < 1 and 0.1 < method['flip_hdr'] < 1 and 0 < method['ssim'] < 1, method)
    documented = re.search(r'^\| `compare` \| (.*) \|$', (ROOT / 'docs/guide/command-line.md').read_text('utf-8'), re.MULTILINE)[1]
    documented = set(re.findall(r'`([a-z_]+)`', documented))
    keys = set(answer) | set(method) | set(answer['reference']) | set(answer['hdr_exposures'])
    need(keys <= documented, 'the guide does not tell', sorted(keys - documented))
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


def write_exr(path, values, width=16, height=16):
    """Uncompressed, 32 bit; values: {channel: number}."""
    def attribute(name, kind, body):
        return name + b'\0' + kind + b'\0' + struct.pack('<I', len(body)) + body
    box, channels = struct.pack('<4i', 0, 0, width - 1, height - 1), sorted(values)
    head = struct.pack('<II', 20000630, 2) + attribute(b'channels', b'chlist', b''.join(
        c.encode('ascii') + b'\0' + struct.pack('<iiii', 2, 0, 1, 1) for c in channels) + b'\0')
    head += attribute(b'compression', b'compression', b'\0') + attribute(b'dataWindow', b'box2i', box)
    head += attribute(b'displayWindow', b'box2i', box) + attribute(b'lineOrder', b'lineOrder', b'\0')
    head += attribute(b'pixelAspectRatio', b'float', struct.pack('<f', 1))
    head += attribute(b'screenWindowCenter', b'v2f', struct.pack('<2f', 0, 0))
    head += attribute(b'screenWindowWidth', b'float', struct.pack('<f', 1)) + b'\0'
    row = b''.join(struct.pack('<f', values[c]) * width for c in channels)
    lines = b''.join(struct.pack('<ii', y, len(row)) + row for y in range(height))
    start = len(head) + 8 * height
    path.write_bytes(head + struct.pack(f'<{height}Q', *(start + y * (8 + len(row)) for y in range(height))) + lines)


@test('variances of files: taken off, of both pictures in the Z-test, refused where they are negative everywhere')
def _(folder):
    def light(v):
        return {**dict.fromkeys('RGB', v), **{f'variance.{c}': 0.01 for c in 'RGB'}}
    write_exr(folder / 'a.exr', light(1.0))
    write_exr(folder / 'b.exr', light(1.5))
    m = one_object(works(folder, 'compare', 'a.exr', 'b.exr', '--json'))['methods'][0]
    near(m['mse'], 0.25 - 0.01)
    near(m['bias_error'][0], math.sqrt(0.02 / 256))
    need(m['agreement'] == {'agrees': False, 'p': 0.0, 'beyond_3': 1.0, 'pixels': 256, 'blocks': 1}, m['agreement'])
    m = one_object(works(folder, 'compare', 'a.exr', 'a.exr', '--json'))['methods'][0]
    need(m['mse'] is None and m['agreement']['agrees'] and m['agreement']['beyond_3'] == 0, m)
    write_exr(folder / 'b.exr', {**light(1.5), 'variance.G': -0.01})
    for arguments in (('a.exr', 'b.exr'), ('a.exr', 'b.exr', '--json')):
        done = run(folder, 'compare', *arguments)
        said = text(done.stdout if done.stdout else done.stderr)
        need(done.returncode == 3 and 'variance is negative or not finite in every pixel' in said and 'no pixel of both' not in said, said)
    write_exr(folder / 'b.exr', {**light(math.nan), 'variance.G': -0.01})
    need('no pixel of both images is finite' in text(run(folder, 'compare', 'a.exr', 'b.exr').stderr), 'nothing is said of NaN')


@test('every tone curve of render is one of compare')
def _(folder):
    write_pfm(folder / 'a.pfm', lambda x, y: (1 + x, 1, 1), 16, 16)
    write_pfm(folder / 'b.pfm', lambda x, y: (1, 1 + y, 1), 16, 16)
    said = text(run(folder, 'render', 'no.obj', '--tonemap', 'none-such').stderr)
    curves = re.search(r'must be one of (.*)', said)[1].split(', ')
    need({'reinhard', 'linear', 'filmic'} <= set(curves), curves)
    given = ['compare', 'a.pfm', 'b.pfm', '--white', '8', '--json', '--tonemap']
    flips = [one_object(works(folder, *given, curve, '-o', curve))['methods'][0]['flip'] for curve in curves]
    need(len(set(flips)) == len(curves), 'two curves are one', flips)
    for curve in curves:
        need(f'"tonemap": "{curve}"' in (folder / curve / 'report.html').read_text('utf-8') or
             f'"tonemap":"{curve}"' in (folder / curve / 'report.html').read_text('utf-8'), curve)


@test('halves of a reference: its noise is stated and taken off')
def _(folder):
    sample = random.Random(1).random
    for half in (1, 2):
        write_pfm(folder / f'h{half}.pfm', lambda x, y: (0.95 + 0.1 * sample(), 1, 0.95 + 0.1 * sample()), 100, 100)
    write_pfm(folder / 'a.pfm', lambda x, y: (1, 1, 1), 100, 100)
    answer = one_object(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--half', 'h2.pfm', '--json'))
    method = answer['methods'][0]
    near(method['noise_mse'], 0.01 / 24 * 2 / 3, 0.1)  # uniform numbers, in two channels of three
    hidden = method['not_resolved']
    need(method['mse'] is None and abs(hidden['mse']) < 0.1 * method['noise_mse'] and 'samples' in hidden['reason'], method)
    need(method['agreement']['agrees'] and method['agreement']['beyond_3'] is None, method)  # no variance
    need(all(abs(b) <= 4 * e for b, e in zip(method['bias'], method['bias_error'])), method)
    near(answer['reference']['rel_noise'], math.sqrt(method['noise_rel_mse']))
    alone = one_object(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--json'))['methods'][0]
    near(alone['mse'], 0.01 / 12 * 2 / 3, 0.1)
    shown = text(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--half', 'h2.pfm').stdout)
    need('noise, mse' in shown and 'error not resolved (noise ' in shown and 'agree within their noise' in shown, shown)
    write_pfm(folder / 'a.pfm', lambda x, y: (1.03, 1, 1), 100, 100)
    method = one_object(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--half', 'h2.pfm', '--json'))['methods'][0]
    need(method['not_resolved'] is None and abs(method['mse'] - 0.0003) < 4 * method['mse_error'], method)
    need(not method['agreement']['agrees'] and method['agreement']['p'] < 1e-6, method)
    shown = text(works(folder, 'compare', 'a.pfm', 'h1.pfm', '--half', 'h2.pfm').stdout)
    need('differ by more than noise' in shown and 'not resolved' not in shown, shown)


@test('layers of a picture from here: translucent pixels are the mask, the exposure is that of its PNG')
def _(folder):
    bunny = ('render', 'bunny.obj', '--material', 'wholemilk', '--size', '40mm', *SMALL, '--single-scattering', 'off')
    for method, name in (('none', 'plain.exr'), ('screen-space', 'milk.exr')):
        works(folder, *bunny, '-m', method, '-o', name)
    answer = one_object(works(folder, 'compare', 'plain.exr', 'milk.exr', '--layer', 'diffuse.multiple', '--json'))
    m = answer['methods'][0]
    need(answer['mask'] == 'translucent' and answer['layer'] == 'diffuse.multiple' and 20 < m['pixels'] < m['whole']['pixels'], answer)
    need(m['mse'] > 0 and 0 < m['flip'] < 1, m)
    exposure = one_object(works(folder, *bunny, '--json'))['exposure']
    near(answer['exposure'], exposure, 1e-5)
    one_object(works(folder, 'compare', 'milk.exr', 'milk.exr', '--layer', 'depth', '--json'))
    one_object(works(folder, 'compare', 'milk.exr', 'milk.exr', '--layer', 'normal', '--mask', 'none', '--json'))
    # Separately: the light that passed through the material, next to all light.
    sums = one_object(works(folder, 'compare', 'plain.exr', 'milk.exr', '--json'))
    need(sums['layer'] == 'subsurface' and sums['mask'] == 'translucent', sums)
    beauty = one_object(works(folder, 'compare', 'plain.exr', 'milk.exr', '--layer', 'R,G,B', '--json'))['methods'][0]
    need(sums['methods'][0]['whole'] == beauty['whole'] and sums['methods'][0]['mse'] != m['mse'], 'transmission is missing, or the whole')
    parts = [one_object(works(folder, 'compare', 'plain.exr', 'milk.exr', '--layer', layer, '--json'))['methods'][0]['bias']
             for layer in ('diffuse.multiple', 'transmission')]
    for c in range(3):
        near(sums['methods'][0]['bias'][c], parts[0][c] + parts[1][c], 1e-4)
    alpha = one_object(works(folder, 'compare', 'plain.exr', 'milk.exr', '--mask', 'alpha', '--json'))
    need(alpha['mask'] == 'alpha' and alpha['methods'][0]['pixels'] >= m['pixels'], alpha)
    done = run(folder, 'compare', 'plain.exr', 'milk.exr', '--layer', 'diffuse.single')
    need(done.returncode == 3 and b'diffuse.multiple' in done.stderr, done.stderr)


@test('--decompose: parts whose biases add up, without bounces where there are none, against path-trace alone')
def _(folder):
    (folder / 'scene.json').write_text(json.dumps({
        'pellucid': 1, 'mesh': 'bunny.obj', 'size': '40mm', 'materials': {'*': {'preset': 'marble'}}, 'ground': True}), 'ascii')
    scene = ('compare', 'scene.json', *SMALL, '--boundary', 'smooth', '--decompose')
    samples = 16 if SANITIZED else 64
    answer = one_object(works(folder, *scene, '--methods', 'none', '--reference', f'hierarchical,path-trace:samples={samples}', '--json'))
    documented = re.search(r'^\| `compare` \| (.*) \|$', (ROOT / 'docs/guide/command-line.md').read_text('utf-8'), re.MULTILINE)[1]
    need(all(0 < fraction < 0.5 for fraction in answer['interreflection']), answer['interreflection'])
    for m, total in ((answer['methods'][0], answer['methods'][0]['total_error']), (answer['model_error'], answer['model_error'])):
        parts = m['parts']
        need(set(parts) | {'parts'} <= set(re.findall(r'`([a-z_]+)`', documented)), sorted(parts))
        for c in range(3):
            near(parts['method']['rel_bias'][c] + parts['interreflection']['rel_bias'][c], parts['total']['rel_bias'][c], 1e-5)
            need(abs(parts['total']['rel_bias'][c] - total['rel_bias'][c]) < 1e-4, parts, total)
        need(all(parts['total'][key] == total[key] for key in parts['total']), parts, total)
    own = answer['methods'][0]['parts']['method']
    need(SANITIZED or own['rel_mse'] > 2 * own['rel_mse_error'] > 0, own)
    table = text(works(folder, *scene, '--methods', 'none', '--reference', 'path-trace:samples=4:bounces=0', '--bounces', '0').stdout)
    need('interreflection is 0.00, 0.00, 0.00 %' in table, table)
    need('0.00 %  +0.00 %' in table.split('interreflection')[-1], table)
    refused = run(folder, *scene, '--reference', 'hierarchical')
    need(refused.returncode == 2 and b'must be path-trace' in refused.stderr, refused)


@test('-o writes maps and the numbers, the same bytes for any number of threads, over what was there')
def _(folder):
    pictures(folder)
    (folder / 'out').mkdir()
    (folder / 'out/flip.png').write_text('old', 'ascii')
    for threads, out in (('1', 'out'), ('3', 'more/')):
        done = works(folder, 'compare', 'a.pfm', 'b.pfm', '--mask', 'mask.png', '-o', out, '--threads', threads, '--json')
        need(names(folder / out) == ['errors.exr', 'flip.png', 'flip_hdr.png', 'metrics.json', 'relative.png', 'report.html'],
             names(folder / out))
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
    need(names(folder / 'display') == ['errors.exr', 'flip.png', 'metrics.json', 'relative.png', 'report.html'],
         names(folder / 'display'))
    data = report(folder / 'more')
    need([p['name'] for p in data['pictures']] == ['b.pfm', 'a.pfm'])
    need([v['title'] for v in data['views']] == ['Masked pixels', 'Whole image'])
    need(light(data, 'b.pfm', 'whole')[1][:3] == [0.5, 0.25, 1.0], data['views'])
    need(abs(data['views'][1]['floor'] - 0.01 * 0.3573) < 1e-6, data['views'])


# --- Methods on a scene -------------------------------------------------------------------------------------------------------------

TINY = ['--size', '40mm', '--material', 'marble', *SMALL]
KEYS_OF_RUN = {'name', 'engine', 'seconds', 'cpu_seconds', 'stages', 'settings'}


def report(folder):
    """The content of report.html, with its images still encoded, by their names."""
    page = (folder / 'report.html').read_text('utf-8')
    scripts = re.findall(r'<script(.*?)>(.*?)</script>', page, re.DOTALL)
    need(page.count('<script') == len(scripts) == page.count('</script'), 'a script is not closed')
    data = json.loads(next(body for kind, body in scripts if 'id="data"' in kind))
    data['packed'] = {re.search(r'id="(data-\d+)"', kind)[1]: body for kind, body in scripts if 'octet-stream' in kind}
    need("default-src 'none'" in page and not re.search(r'(?:src|href)="(?!#|data:,)', page), 'the page asks for something')
    return data


def unpack(data, name):
    return zlib.decompress(base64.b64decode(data['packed'][name]))


def light(data, picture, view):
    """Planes of an image in the report, and its first pixel."""
    width, height = data['size']['across'], data['size']['down']
    raw, all_, planes = unpack(data, next(p for p in data['pictures'] if p['name'] == picture)['data'][view]), width * height, []
    need(len(raw) == 6 * all_, len(raw))
    for c in range(3):
        bits = []
        for i in range(all_):
            above = bits[i - width] if i >= width else 0
            step = raw[2 * c * all_ + i] << 8 | raw[(2 * c + 1) * all_ + i]
            bits.append((step + (bits[-1] if i % width else above)) & 0xffff)
        planes.append(struct.unpack(f'<{all_}e', struct.pack(f'<{all_}H', *bits)))
    return planes, [p[0] for p in planes]


@test('methods on a scene: one exposure, the promised keys and files, the same numbers as from the pictures')
def _(folder):
    done = works(folder, 'compare', 'bunny.obj', *TINY, '--methods', 'all,none,screen-space:gaussians=6', '-o', 'out/', '--json')
    answer = one_object(done)
    metrics = json.loads((folder / 'out/metrics.json').read_text('utf-8'))
    need(metrics == answer, 'metrics.json is not the answer')
    need(set(answer['reference']) == KEYS_OF_RUN | {'rel_noise'} and answer['reference']['name'] == 'hierarchical', answer['reference'])
    methods = {m['name']: m for m in answer['methods']}
    need({'screen-space', 'none', 'screen-space:gaussians=6'} <= set(methods), sorted(methods))
    documented = re.search(r'^\| `compare` \| (.*) \|$', (ROOT / 'docs/guide/command-line.md').read_text('utf-8'), re.MULTILINE)[1]
    documented = set(re.findall(r'`([a-z_]+)`', documented))
    for m in methods.values():
        need(set(m) == KEYS | KEYS_OF_RUN | {'against', 'whole'} and set(m['whole']) == KEYS and m['against'] == 'reference', sorted(m))
        need(m['pixels'] == answer['translucent_pixels'] < m['whole']['pixels'] == 48 * 27 and m['seconds'] > 0, m)
        need(set(answer) | set(m) | set(answer['reference']) <= documented, 'the guide does not tell', set(answer) - documented)
    need(0 < methods['screen-space']['mse'] < methods['none']['mse'], 'scattering is no nearer to the reference than none')
    need(methods['screen-space']['mse'] != methods['screen-space:gaussians=6']['mse'], 'a knob in --methods has no effect')
    exrs = ['hierarchical.exr', 'none.exr', 'screen-space-gaussians-6.exr', 'screen-space.exr']
    need(set(exrs) | {'metrics.json', 'none.errors.exr', 'report.html'} <= set(names(folder / 'out')), names(folder / 'out'))
    exposures = set()
    for name in exrs:
        attributes, channels, _ = exr_header((folder / 'out' / name).read_bytes())
        exposures.add(attributes['pellucid.exposure'])
        need('diffuse.multiple.R' in dict(channels), channels)
        need(attributes['pellucid.method'] == name.split('-gaussians')[0].split('.')[0], attributes)
    need(len(exposures) == 1, 'exposures differ:', exposures)
    alone = one_object(works(folder, 'compare', 'out/screen-space.exr', 'out/hierarchical.exr', '--json'))
    need(alone['layer'] == 'subsurface' and alone['mask'] == 'translucent', alone)
    for key in ('mse', 'rel_mse', 'mae', 'flip', 'ssim'):  # EXR holds halves; FLIP of a dark background is mostly their rounding
        near(alone['methods'][0][key], methods['screen-space'][key], 0.02)
        near(alone['methods'][0]['whole'][key], methods['screen-space']['whole'][key], 0.04 if key == 'flip' else 0.02)
    table = text(works(folder, 'compare', 'bunny.obj', *TINY).stdout)
    need('against hierarchical' in table and 'Whole image' in table and re.search(r'^screen-space +\d', table, re.MULTILINE), table)


@test('the report holds the light that was measured, and nothing that could run')
def _(folder):
    works(folder, 'compare', 'bunny.obj', *TINY, '--methods', 'none', '-o', 'out')
    data = report(folder / 'out')
    need([p['role'] for p in data['pictures']] == ['reference', 'method'] and data['size']['factor'] == 1, data['pictures'])
    mask, width = unpack(data, data['views'][0]['mask']), data['size']['across']
    on, above = [], 0
    for i, step in enumerate(mask):
        on.append((step + (on[-1] if i % width else on[i - width] if i else 0)) & 255)
    inside = [i for i, v in enumerate(on) if v > 127]
    method = data['pictures'][1]
    need(len(inside) == method['metrics']['part']['pixels'], len(inside))
    a, b = light(data, 'none', 'part')[0], light(data, 'hierarchical', 'part')[0]
    for c in range(3):
        bias, mean = (sum(of(i) for i in inside) / len(inside) for of in (lambda i: a[c][i] - b[c][i], lambda i: b[c][i]))
        need(abs(bias - method['metrics']['part']['bias'][c]) < 5e-4 * mean, bias, mean, method['metrics']['part']['bias']) # of 16 bits
        need(all(a[c][i] == b[c][i] == 0 for i in range(len(on)) if on[i] == 0), 'light outside of what is translucent')
    need(all(s['ms'] >= 0 for p in data['pictures'] for s in p['stages']), data['pictures'])
    need(data['command'].startswith('pellucid compare bunny.obj'), data['command'])


@test('two references: error of the methods, of the model, and both; the noise that a reference tells is taken off')
def _(folder):
    few = ['--width', '20', '--height', '12', '--msaa', '1', '--light-samples', '2', '--ambient-samples', '1', '--size', '40mm',
           '--material', 'marble', '--methods', 'screen-space']
    answer = one_object(works(folder, 'compare', 'bunny.obj', *few, '--reference', 'hierarchical,dipole:error=0.2', '-o', 'out', '--json'))
    need(answer['truth']['name'] == 'dipole:error=0.2' and answer['reference']['rel_noise'] is None, answer['truth'])
    need(0.02 < answer['truth']['rel_noise'] < 0.6, answer['truth'])
    need((answer['model_error']['name'], answer['model_error']['against']) == ('hierarchical', 'dipole:error=0.2'), answer['model_error'])
    method, = answer['methods']
    need(method['mse'] != method['total_error']['mse'] and method['total_error']['noise_rel_mse'] > 0 == method['noise_rel_mse'], method)
    need(set(answer['model_error']) == KEYS | {'name', 'against', 'whole'} and set(method['total_error']) == KEYS | {'whole'}, method)
    release_only()
    # Its standard error is correct: without noise, the remaining difference of two runs is small.
    for seed in ('1', '2'):
        works(folder, 'render', 'bunny.obj', *few[:-2], '-m', 'dipole', '--set', 'error=0.2', '--seed', seed, '-o', f'{seed}.exr')
    channels = dict(exr_header((folder / '1.exr').read_bytes())[1])
    need(channels['variance.R'] == 2 and 'translucent.Y' in channels, channels)
    m = one_object(works(folder, 'compare', '1.exr', '2.exr', '--json'))['methods'][0]
    need(m['noise_mse'] > 0, m)
    need(m['agreement']['agrees'] and m['agreement']['beyond_3'] < 0.05, m)
    ratio = (m['mse'] + m['noise_mse']) / m['noise_mse']  # both have the noise: 2 in the mean
    need(1.2 < ratio < 3.2, 'the difference of two runs is', ratio, 'times the variance that one tells')
    data = report(folder / 'out')
    need([p['role'] for p in data['pictures']] == ['reference', 'truth', 'method'], 'roles')
    need(data['pictures'][0]['model']['part']['mae'] > 0, 'no error of the model')
    shown = text(works(folder, 'compare', 'bunny.obj', *few, '--reference', 'hierarchical,dipole:error=0.5').stdout)
    need('its own reference: dipole:error=0.5' in shown and 'Error of the model' in shown and 'subtracted from the errors' in shown, shown)


@test('a sampled reference is two halves; what is below its noise is not resolved, and other samples of the same agree with it')
def _(folder):
    release_only()
    few = ['--width', '24', '--height', '18', '--msaa', '1', '--light-samples', '2', '--ambient-samples', '1', '--size', '40mm',
           '--material', 'wholemilk']
    sampled = 'path-trace:samples=8'
    done = works(folder, 'compare', 'bunny.obj', *few, '--methods', 'none,path-trace:samples=16', '--reference', sampled, '-o', 'out',
                 '--json')
    none, other = one_object(done)['methods']
    need(none['rel_mse'] is None and 'exceeds the error' in none['not_resolved']['reason'], none)
    need(none['not_resolved']['least_error'] > 0 and none['rel_mse_error'] > 0 and all(e > 0 for e in none['rel_bias_error']), none)
    need(other['agreement']['agrees'] and 0 < other['agreement']['pixels'] <= other['pixels'], other)
    need(set(none['agreement']) == {'agrees', 'p', 'beyond_3', 'pixels', 'blocks'}, none)
    shown = text(works(folder, 'compare', 'bunny.obj', *few, '--methods', 'none', '--reference', sampled).stdout)
    need('as the mean of two halves' in shown and 'none: error not resolved (noise ' in shown and 'within noise' in shown, shown)
    # The image that is written is the mean of the halves, which differ.
    for half in ('1', '2'):
        works(folder, 'render', 'bunny.obj', *few, '-m', 'path-trace', '--set', 'samples=8', '--set', f'half={half}', '-o', f'{half}.exr')
    m = one_object(works(folder, 'compare', 'out/path-trace-samples-8.exr', '1.exr', '--half', '2.exr', '--json'))['methods'][0]
    need(m['mae'] < 1e-3 and m['noise_mse'] > 1e-3 and m['agreement']['beyond_3'] == 0, m)


@test('of a scene file: its options and knobs hold, the ground does not count as translucent')
def _(folder):
    scene = {'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm', 'ground': True, 'materials': {'*': {'preset': 'marble'}},
             'render': {'width': 48, 'height': 27, 'msaa': 1, 'light-samples': 2, 'indirect-samples': 256, 'method': 'screen-space',
                        'knobs': {'gaussians': 2}}}
    (folder / 'own.json').write_text(json.dumps(scene), 'ascii')
    answer = one_object(works(folder, 'compare', 'own.json', '--methods', 'screen-space,screen-space:gaussians=4', '-o', 'out', '--json'))
    scene['render'] = {k: v for k, v in scene['render'].items() if k not in ('method', 'knobs')}
    (folder / 'plain.json').write_text(json.dumps(scene), 'ascii')
    other = one_object(works(folder, 'compare', 'plain.json', '--methods', 'screen-space,screen-space:gaussians=2', '--json'))
    need((answer['width'], answer['height']) == (48, 27), answer)
    own, four = answer['methods']
    default, two = other['methods']
    need(own['mse'] == two['mse'] != four['mse'] == default['mse'], own['mse'], two['mse'], four['mse'], default['mse'])
    alpha = one_object(works(folder, 'compare', 'out/screen-space.exr', 'out/hierarchical.exr', '--mask', 'alpha', '--json'))['methods'][0]
    need(100 < own['pixels'] < 0.7 * alpha['pixels'], own['pixels'], alpha['pixels'])
    for exr in ('none', 'screen-space'):  # the layer is the scene's, whatever the method
        works(folder, 'render', 'own.json', '-m', exr, '-o', f'{exr}.exr')
        m = one_object(works(folder, 'compare', f'{exr}.exr', f'{exr}.exr', '--layer', 'translucent', '--mask', 'translucent', '--json'))
        need(m['methods'][0]['pixels'] == own['pixels'] and m['methods'][0]['mse'] == 0, exr, m)


@test('a method that gives finished pictures is compared by all light of translucent pixels')
def _(folder):
    answer = one_object(works(folder, 'compare', 'bunny.obj', *TINY, '--methods', 'screen-space:as=paper', '-o', 'out', '--json'))
    method, = answer['methods']
    need(method['light'] == 'all of translucent pixels' and method['name'] == 'screen-space:as=paper', method)
    alone = one_object(works(folder, 'compare', 'out/screen-space-as-paper.exr', 'out/hierarchical.exr', '--layer', 'R,G,B', '--json'))
    near(method['mse'], alone['methods'][0]['mse'], 0.02)
    published = 'angles=off curvature=off single-scattering=off opposed=off unscattered=off profile=dipole'
    need(method['settings'] == f'bounces=0 {published}' and answer['reference']['settings'] == '', method)
    release_only()
    both = one_object(works(folder, 'compare', 'bunny.obj', *TINY, '--bounces', '1', '--methods', 'screen-space:as=paper,none', '--json'))
    need([m['settings'] for m in both['methods']] == [published, ''], both['methods'])
    every = one_object(works(folder, 'compare', 'bunny.obj', *TINY, '--methods', 'all:as=paper,none', '--json'))
    names = [m['name'] for m in one_object(works(folder, 'methods', '--json'))['methods'] if m['kind'] == 'method']
    need([m['name'] for m in every['methods']] == [n + ':as=paper' for n in names] + ['none'], every['methods'])
    need('finished images' in text(works(folder, 'compare', 'bunny.obj', *TINY, '--methods', 'screen-space', '--set', 'as=paper').stdout),
         '--set has no effect')


@test('large pictures are shown reduced, which is said; numbers are of the full size')
def _(folder):
    row = struct.pack('<6f', 0.5, 0.25, 1, 0.7, 0.25, 1)
    (folder / 'big.pfm').write_bytes(b'PF\n1200 900\n-1\n' + row * (600 * 900))
    works(folder, 'compare', 'big.pfm', 'big.pfm', '-o', 'out', '--mask', 'none', '--exposures', '2')
    data = report(folder / 'out')
    need(data['size'] == {'width': 1200, 'height': 900, 'factor': 2, 'across': 600, 'down': 450}, data['size'])
    need(data['views'][0]['pixels'] == 1080000, data['views'])
    raw = unpack(data, data['pictures'][0]['data']['whole'])
    value, = struct.unpack('>e', bytes((raw[0], raw[600 * 450])))
    near(value, 0.6, 1e-3)


@test('pictures are compared band by band: memory does not grow with their height')
def _(folder):
    width, height = 4100, 900
    row = b''.join(struct.pack('<3f', 0.5 + 0.4 * ((x * 37) % 101) / 101, 0.25, 0.5) for x in range(width))
    other = b''.join(struct.pack('<3f', 0.5 + 0.4 * ((x * 37) % 101) / 101, 0.25, 0.6) for x in range(width))
    for name, body in (('b', row), ('a', other)):
        (folder / f'{name}.pfm').write_bytes(f'PF\n{width} {height}\n-1\n'.encode('ascii') + body * height)
    few = ('--mask', 'none', '--exposures', '1', '--ppd', '5', '--threads', '2', '--json')
    # the files have 44 MB each, as much as their planes would take
    answer = one_object(works(folder, 'compare', 'a.pfm', 'b.pfm', *few, '--limit', 'memory-bytes=60000000'))
    m = answer['methods'][0]
    need(m['pixels'] == width * height, m)
    near(m['mse'], (0.6 - 0.5) ** 2 / 3, 1e-5)
    near(m['bias'][2], 0.1, 1e-5)


@test('a PNG of more than 64 MiB is read')
def _(folder):
    write_png(folder / 'a.png', lambda x, y: (255, 0, 0))
    data, junk = (folder / 'a.png').read_bytes(), b'teSt' + bytes(65 << 20)
    end = data.index(b'IDAT') - 4
    (folder / 'big.png').write_bytes(data[:end] + struct.pack('>I', 65 << 20) + junk + struct.pack('>I', zlib.crc32(junk)) + data[end:])
    need(one_object(works(folder, 'compare', 'big.png', 'a.png', '--json'))['methods'][0]['mse'] == 0, 'another picture')


@test('Ctrl-C leaves nothing; a folder that was there keeps what it had until all is there')
def _(folder):
    (folder / 'out').mkdir()
    (folder / 'out/report.html').write_text('old', 'ascii')
    (folder / 'out/mine.txt').write_text('mine', 'ascii')
    for out in ('out', 'new'):
        before = names(folder), names(folder / 'out')
        with subprocess.Popen([PROGRAM, 'compare', 'bunny.obj', '--size', '40mm', '--material', 'marble', '--msaa', '16', '-o', out],
                              cwd=folder, env=clean_environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              stdin=subprocess.DEVNULL, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)) as child:
            end = time.monotonic() + 60
            while not any('.partial-' in str(p) for p in folder.rglob('*')) and time.monotonic() < end:
                time.sleep(0.02)
            child.send_signal(signal.SIGINT)
            said = child.communicate(timeout=60)[1]
        need(child.returncode == 130 and b'interrupted; nothing was written' in said, child.returncode, said)
        need((names(folder), names(folder / 'out')) == before, names(folder), names(folder / 'out'))
        need((folder / 'out/report.html').read_text('ascii') == 'old', 'the report that was there is gone')
    works(folder, 'compare', 'bunny.obj', *TINY, '-o', 'out')
    need('mine.txt' in names(folder / 'out') and (folder / 'out/report.html').stat().st_size > 10000, names(folder / 'out'))
    need(not [n for n in names(folder / 'out') if n.startswith('.')], names(folder / 'out'))


SCENE = ('bunny.obj', '--size', '40mm', '--material', 'marble')
REFUSALS = {  # arguments: exit code, message
    ('a.pfm',): (2, 'its reference is missing'),
    ('no.json',): (3, 'no.json'),
    ('bunny.obj', '--material', 'marble'): (2, '--size'),
    (*SCENE, '--methods', 'screen-spce'): (2, 'did you mean "screen-space"?'),
    (*SCENE, '--methods', 'screen-space,,none'): (2, 'a name is missing'),
    (*SCENE, '--methods', ''): (2, 'a name is missing'),
    (*SCENE, '--methods', 'all,screen-space'): (2, 'named twice'),
    (*SCENE, '--methods', 'hierarchical'): (2, 'is the reference'),
    (*SCENE, '--methods', 'screen-space:gausians=6'): (2, 'gaussians'),
    (*SCENE, '--methods', 'screen-space:gaussians'): (2, 'must be NAME=VALUE'),
    (*SCENE, '--methods', 'screen-space:gaussians=99'): (2, '[1, 10]'),
    (*SCENE, '--methods', 'none:a=b'): (2, 'has no knob'),
    (*SCENE, '--methods', 'x' * 400): (2, ''),
    (*SCENE, '--reference', 'hierarchicl'): (2, 'did you mean "hierarchical"?'),
    (*SCENE, '--reference', 'none'): (2, "can't be the reference"),
    (*SCENE, '--reference', 'hierarchical,dipole,hierarchical:error=0.1'): (2, 'must be one or two'),
    (*SCENE, '--set', 'gausians=6'): (2, 'did you mean "gaussians"?'),
    (*SCENE, '--set', 'density=6'): (2, '--reference hierarchical:density=6'),
    (*SCENE, '--layer', 'R,G,B'): (2, 'goes with two images'),
    (*SCENE, '--mask', 'alpha'): (2, 'goes with two images'),
    (*SCENE, '--engine', 'vulkan'): (4, ''),
    (*SCENE, '-o', 'b.pfm'): (3, 'is not a folder'),
    (*SCENE, '--width', '8', '--height', '8', '--msaa', '1', '--light-samples', '1', '-o', 'no/such'): (3, "can't be made"),
    ('a.pfm', 'b.pfm', '--methods', 'all'): (2, 'two images are given'),
    ('a.pfm', 'b.pfm', '--width', '40'): (2, 'two images are given'),
    ('a.pfm', 'b.pfm', '--set', 'gaussians=6'): (2, 'two images are given'),
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
    ('nan.pfm', 'b.pfm'): (3, 'no pixel of both images is finite'),
    ('a.pfm', 'b.pfm', '--ppd', '0'): (2, '[1, 400]'),
    ('a.pfm', 'b.pfm', '--ppd', 'nan'): (2, 'nan'),
    ('a.pfm', 'b.pfm', '--floor', '0'): (2, 'floor'),
    ('a.pfm', 'b.pfm', '--tonemap', 'acse'): (2, 'aces'),
    ('a.pfm', 'b.pfm', '--threads', '257'): (2, '[0, 256]'),
    ('a.pfm', 'b.pfm', '--limit', 'image-pixels=1199'): (3, 'image-pixels'),
    ('a.pfm', 'b.pfm', '--limit', 'memory-bytes=1048576'): (5, 'memory'),
    ('a.pfm', 'b.pfm', '-o', 'b.pfm'): (3, 'is not a folder'),
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
