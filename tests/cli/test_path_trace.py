#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_path_trace.py PROGRAM ROOT: runs of a reference from outside: stopping criteria, Ctrl-C, kill -9, and resuming from a checkpoint."""
import json
import math
import os
import signal
import struct
import subprocess
import sys
import time

from cli_test import EVENTS, PROGRAM, clean_environment, exr_header, main, names, need, one_object, run, test, text, works

# A ball of 20 mm whose walks are truncated: fast, and reproducible like any other.
TRACE = ['render', 'bunny.obj', '--unit', '1mm', '--material', 'marble', '-m', 'path-trace', '--set', EVENTS, '--set',
         'acceleration=none', '--width', '40', '--height', '30', '--msaa', '2', '--light-samples', '1']
LONG = [*TRACE, '--samples', '100000000']


def start(folder, *arguments):
    return subprocess.Popen([PROGRAM, *arguments], cwd=folder, env=clean_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


def wait_for(truth, seconds=120):
    end = time.monotonic() + seconds
    while not truth():
        need(time.monotonic() < end, 'it takes too long')
        time.sleep(0.01)


def pfm_pixels(data):
    head, size, _, body = data.split(b'\n', 3)
    width, height = (int(n) for n in size.split())
    need(head == b'PF' and len(body) == 12 * width * height, head, size, len(body))
    return struct.unpack(f'<{3 * width * height}f', body)


@test('kill -9 on the way, twice: what goes on from the checkpoint ends with the bits of a run that was not killed')
def _(folder):
    few = [*TRACE, '--samples', '100']
    works(folder, *few, '-o', 'whole.pfm')
    before = set(names(folder))
    for _ in range(2):
        child = start(folder, *few, '--threads', '1', '--checkpoint', 'state.ckpt', '--checkpoint-every', '20ms', '-o', 'killed.pfm')
        last = os.stat(folder / 'state.ckpt').st_mtime_ns if (folder / 'state.ckpt').exists() else 0
        wait_for(lambda: child.poll() is not None or ((folder / 'state.ckpt').exists() and
                                                      os.stat(folder / 'state.ckpt').st_mtime_ns > last))
        need(child.poll() is None, 'it ended before')
        child.kill()
        child.communicate()
        need('killed.pfm' not in names(folder), names(folder))
    for path in set(names(folder)) - before - {'state.ckpt', 'state.ckpt.lock'}:
        need(path.startswith('.pellucid-') and path.endswith('.tmp'), path)  # killed while it was written
    works(folder, *few, '--threads', '3', '--checkpoint', 'state.ckpt', '-o', 'killed.pfm')
    need((folder / 'whole.pfm').read_bytes() == (folder / 'killed.pfm').read_bytes(), 'bits differ')


@test('a translucent ground has no other side: light in it is as a half-space returns it')
def _(folder):
    (folder / 'ground.json').write_text(json.dumps({
        'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm', 'materials': {'*': {'opaque': True, 'color': 0.5}}, 'ground': 'wax',
        'camera': {'from': ['60mm', '40mm', '90mm'], 'to': ['60mm', '-20mm', '60mm']},
        'lights': [{'type': 'directional', 'direction': [0, -1, 0], 'irradiance': [3, 3, 3]}]}))
    mean = {}
    for method, more in (('path-trace', ['--set', 'samples=64']), ('screen-space', [])):
        done = works(folder, 'render', 'ground.json', '--width', '12', '--height', '9', '--msaa', '1', '-m', method, *more, '-o', 'g.pfm')
        need(b'no material is translucent' not in done.stderr, done.stderr)
        rgb = pfm_pixels((folder / 'g.pfm').read_bytes())
        mean[method] = [sum(rgb[c::3]) / len(rgb[c::3]) for c in range(3)]
    need(mean['screen-space'][0] > 1.5 * mean['screen-space'][2] > 0, 'wax is orange', mean)
    need(all(abs(a / b - 1) < 0.05 for a, b in zip(mean['path-trace'], mean['screen-space'])), mean)


@test('Ctrl-C: exit 130, a whole picture of the samples so far, and a checkpoint to go on from')
def _(folder):
    begin = time.monotonic()
    works(folder, *TRACE, '--samples', '2', '-o', 'two.pfm')
    first = 1.0 + 2.0 * (time.monotonic() - begin)  # by then there is a sample, however slow the build
    for more in ([], ['--json'], ['--checkpoint', 'state.ckpt']):
        child = start(folder, *LONG, '-o', 'part.pfm', *more)
        time.sleep(first)
        need(child.poll() is None, 'it ended')
        child.send_signal(signal.SIGINT)
        begin = time.monotonic()
        out, err = child.communicate(timeout=60)
        need(child.returncode == 130 and time.monotonic() - begin < 20, child.returncode, err)
        if more == ['--json']:
            need(json.loads(out)['partial'] is True and json.loads(out)['image'] == 'part.pfm', out)
        else:
            need(b'the image was written with the samples that it had' in err, err)
        part, two = pfm_pixels((folder / 'part.pfm').read_bytes()), pfm_pixels((folder / 'two.pfm').read_bytes())
        need(all(math.isfinite(v) and v >= 0.0 for v in part), 'no radiance')
        need(0.5 < sum(part) / sum(two) < 2.0, sum(part), sum(two))
        (folder / 'part.pfm').unlink()
    need((folder / 'state.ckpt').stat().st_size > 1000, 'no checkpoint')
    need(not [n for n in names(folder) if n.endswith('.tmp')], names(folder))


@test('--time-limit, --target-error and --samples say when a run ends, with units; methods without the knob refuse them')
def _(folder):
    done = works(folder, *TRACE, '--time-limit', '300ms', '-o', 'a.pfm')
    need(b'samples per pixel' in done.stderr, done.stderr)
    done = works(folder, *TRACE, '--target-error', '80%', '-o', 'a.pfm')
    said = float(text(done.stderr).split('relative error ')[1].split(' %')[0])
    need(10 < said <= 80, said)
    need(b'6 samples per pixel' in works(folder, *TRACE, '--samples', '6', '-o', 'a.pfm').stderr)
    for option, value, word in (('--time-limit', '30', '30s'), ('--time-limit', '-1s', '30s'), ('--time-limit', '1e400s', '30s'),
                                ('--time-limit', '', '30s'), ('--target-error', '1', '1%'), ('--target-error', '0%', '1%'),
                                ('--target-error', 'nan%', '1%'), ('--samples', '1.5', ''), ('--samples', '-3', ''),
                                ('--checkpoint-every', '1', '')):
        done = run(folder, *TRACE, option + '=' + value, '-o', 'no.pfm', '--checkpoint', 'c.ckpt')
        need(done.returncode == 2 and option in text(done.stderr) and word in text(done.stderr), option, value, done.stderr)
    for method in ('screen-space', 'none', 'hierarchical'):
        for option in (['--time-limit', '1s'], ['--target-error', '1%'], ['--checkpoint', 'c.ckpt']):
            done = run(folder, 'render', 'bunny.obj', '--unit', '1mm', '-m', method, *option, '-o', 'no.pfm')
            need(done.returncode == 2 and option[0] in text(done.stderr) and method in text(done.stderr), done.returncode, done.stderr)
    done = run(folder, *TRACE, '-o', 'no.pfm', '--checkpoint', 'no.pfm')
    need(done.returncode == 2 and b'is where the image goes' in done.stderr and not (folder / 'no.pfm').exists(), done.stderr)
    done = run(folder, *TRACE, '--turntable', '3', '--checkpoint', 'c.ckpt', '-o', 'no.pfm')
    need(done.returncode == 2 and b'--turntable' in done.stderr, done.stderr)
    need('no.pfm' not in names(folder) and 'c.ckpt' not in names(folder), names(folder))
    # In a scene file, as any option.
    (folder / 'timed.json').write_text(json.dumps({'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm', 'render': {
        'method': 'path-trace', 'samples': 3, 'width': 20, 'height': 15, 'msaa': 1, 'knobs': {'events': 8}}}), 'ascii')
    need(b' 3 samples per pixel' in works(folder, 'render', 'timed.json', '-o', 'a.pfm').stderr)
    works(folder, 'render', 'timed.json', '-m', 'screen-space', '-o', 'a.pfm')


@test('a mean free path of a nanometre: that is said, not that surfaces cross')
def _(folder):
    for scale, said in ((1e6, b'positions on the object'), (1.0, b'')):
        (folder / 'm.json').write_text(json.dumps({'sigma_a': [1e-3 * scale] * 3, 'sigma_s_reduced': [scale] * 3, 'eta': 1.4}), 'ascii')
        done = works(folder, 'render', 'bunny.obj', '--unit', '1mm', '--material', 'm.json', '-m', 'path-trace', '--samples', '1',
                     '--width', '24', '--height', '16', '--msaa', '1', '-o', 'a.png')
        need(said in done.stderr and b'cross themselves' not in done.stderr, scale, done.stderr)
        need(said or b'positions on the object' not in done.stderr, done.stderr)


@test('a checkpoint of another run, or a damaged one, is refused by name and stays as it is')
def _(folder):
    few = [*TRACE, '--samples', '2', '--checkpoint', 'state.ckpt', '-o', 'no.pfm']
    works(folder, *few)
    (folder / 'no.pfm').unlink()
    good = (folder / 'state.ckpt').read_bytes()
    for more, word in ((['--seed', '1'], 'seed'), (['--width', '41'], '40 x 30'), (['--material', 'skin1'], 'scene')):
        done = run(folder, *few, *more)
        need(done.returncode == 3 and b'state.ckpt' in done.stderr and word in text(done.stderr), done.returncode, done.stderr)
    for bad in (good[:-1], good[:100], b'', good[:200] + bytes([good[200] ^ 1]) + good[201:], good + b'0'):
        (folder / 'state.ckpt').write_bytes(bad)
        done = run(folder, *few, '--json')
        need(done.returncode == 3 and 'state.ckpt' in one_object(done)['error']['where'], done.returncode, done.stdout)
        need((folder / 'state.ckpt').read_bytes() == bad, 'it was written over')
    need('no.pfm' not in names(folder), names(folder))


@test('EXR: light that was scattered once is a layer of its own, and its noise is known')
def _(folder):
    works(folder, *TRACE, '--samples', '2', '-o', 'a.exr')
    channels = [name for name, _ in exr_header((folder / 'a.exr').read_bytes())[1]]
    for layer in ('diffuse.multiple', 'diffuse.single', 'specular', 'variance'):
        need(all(f'{layer}.{c}' in channels for c in 'RGB'), layer, channels)


sys.exit(main())
