#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_bench.py PROGRAM ROOT: `pellucid-bench`, the benches of the papers: what they print and refuse, and that pages name them right."""
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from cli_test import PROGRAM, ROOT, clean_environment, main, need, one_object, release_only, run, test, text, works

NAMES = ['profiles', 'truth', 'truth-gap', 'mertens', 'munoz-2', 'munoz-3', 'munoz-5', 'deon-1', 'jimenez-7.2', 'francois-2']
TINY = ['--width', '48', '--height', '27', '--light-samples', '2', '--threads', '2']


@test('help lists every bench, and each has a page of its own')
def _(folder):
    shown = text(works(folder, '--help').stdout)
    need(re.findall(r'^  ([a-z0-9.-]+) +[a-z]', shown, re.MULTILINE)[:len(NAMES)] == NAMES, shown)
    for name in NAMES:
        page = text(works(folder, name, '--help').stdout)
        need(f'usage: pellucid-bench {name} [OPTIONS]' in page and f'  pellucid-bench {name} --repeats 1' in page, page)
        need((name == 'profiles') == ('--threads' not in page) and '--method' not in page and '--set' not in page, page)


@test('pages name benches that are there')
def _(folder):
    pages = [*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md'), *(ROOT / 'src').rglob('*.md'), *(ROOT / 'bench').glob('*.md')]
    found = [(p.name, name) for p in pages for name in re.findall(r'pellucid-bench ([a-z0-9-]+(?:\.[0-9]+)?)', p.read_text('utf-8'))]
    need(len(found) > 10, found)
    for page, name in found:
        need(name in [*NAMES, '--help'], page, 'names', name)
    table = re.findall(r'^\| `([a-z0-9.-]+)`', (ROOT / 'bench/README.md').read_text('utf-8'), re.MULTILINE)
    need(table == NAMES, table)


@test('options that a bench would not obey are refused')
def _(folder):
    for name in NAMES:
        for idle in (['--method', 'none'], ['--set', 'lod=1'], ['--samples', '3'], ['--msaa', '2']):
            done = run(folder, name, *idle)
            need(done.returncode == 2 and idle[0].encode() in done.stderr and not done.stdout, name, idle, done.stderr)
    for name, option in (('profiles', '--width'), ('profiles', '--threads'), ('mertens', '--width'), ('deon-1', '--height'),
                         ('francois-2', '--width'), ('truth', '--seed'), ('truth-gap', '--bounces')):
        done = run(folder, name, option, '64')
        need(done.returncode == 2 and option.encode() in done.stderr and not done.stdout, name, option, done.stderr)
    done = run(folder, 'profils')
    need(done.returncode == 2 and b'pellucid-bench profiles' in done.stderr, done.stderr)


@test('francois-2 has a second scene beside its own, with all that it names')
def _(folder):
    beside = Path(PROGRAM).resolve().parent
    scenes = [json.loads((beside / f'francois-2{name}.json').read_text('utf-8')) for name in ('', '-gecko')]
    for scene, body, layers in zip(scenes, ('Fish', 'Gecko'), (3, 4)):
        need(len(scene['lights']) == 4 and len(scene['materials'][body]['layers']) == layers, body, scene['materials'][body])
        need((beside / scene['mesh']).is_file() and (beside / f'{body.lower()}-layers.png').is_file(), body, scene['mesh'])


@test('profiles: rows of fits, layers and evaluation, with ratios and errors')
def _(folder):
    answer = one_object(works(folder, 'profiles', '--repeats', '2', '--json'))
    rows = {r['name']: r for r in answer['rows']}
    need(answer['bench'] == 'profiles' and answer['repeats'] == 2, answer)
    for name in ('fit by appendix A, RGB', 'fit of 6 Gaussians, RGB, shared', 'three layers, Hankel', 'three layers, Gaussians',
                 'R(r) of dipole, one by one', 'R(r) of dipole, vectorised'):
        need(name in rows and rows[name]['ms'] > 0, name, sorted(rows))
    row = rows['three layers, Gaussians']
    need(abs(row['ratio'] * rows[row['ratio_to']]['ms'] / row['ms'] - 1) < 1e-6 and 0 < row['error'] < 0.5, row)
    need(rows['fit of 6 Gaussians, RGB, shared']['error'] < rows['fit of 4 Gaussians, RGB, shared']['error'] < 0.1, rows)
    need(rows['R(r) of dipole, vectorised']['each_ns'] > 0, rows)
    shown = text(works(folder, 'profiles', '--repeats', '1').stdout)
    need('three layers, Hankel' in shown and ' x ' in shown and 'one thread' in shown, shown)


@test('truth-gap on a tiny picture: links, lights and frames, with ratios')
def _(folder):
    release_only()
    answer = one_object(works(folder, 'truth-gap', *TINY, '--repeats', '1', '--json'))
    rows = {r['name']: r for r in answer['rows']}
    need(all(rows[f'first frame: links, {n} samples']['ms'] > 0 for n in (4096, 16384, 65536)), rows)
    need(rows['lights moved: 8 bounces']['ratio_to'] == '1 bounce' and rows['lights moved: 64 bounces']['ms'] > 0, rows)
    need(rows['every frame: irradiance with it']['ratio'] > 0, rows)


@test('munoz-3 on a tiny picture: its stages, resolutions, radii and errors')
def _(folder):
    release_only()
    answer = one_object(works(folder, 'munoz-3', *TINY, '--repeats', '1', '--json'))
    need((answer['width'], answer['height'], answer['threads'], answer['engine']) == (48, 27, 2, 'cpu'), answer)
    rows = {r['name'].split(', filled')[0]: r for r in answer['rows']}
    for planes in (4, 8):
        for resolution in ('1', '1/2', '1/4'):
            row = rows[f'{planes} planes, resolution {resolution}']
            need(row['frame_ms'] > row['ms'] > 0 and row['pixels'] > 100, row)
    need(0 < rows['8 planes, resolution 1']['error'] < 0.5 and 'error' not in rows['radius x 4'], rows)
    need(rows['radius x 1']['ratio'] == 1 and rows['radius x 4']['ratio'] > 0, rows)
    need(0 < rows['dense, t 0.05, resolution 1/2']['error'] < 1, rows)


@test('Ctrl-C during profiles: exit 130 before the repeats are over')
def _(folder):
    child = subprocess.Popen([PROGRAM, 'profiles', '--repeats', '10000'], cwd=folder, env=clean_environment(),
                             stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    time.sleep(0.5)
    child.send_signal(signal.SIGINT)
    begin = time.monotonic()
    out, err = child.communicate(timeout=60)
    need(child.returncode == 130 and not out, child.returncode, out, err)
    need(time.monotonic() - begin < 5, time.monotonic() - begin) # all rows would take most of a minute


if __name__ == '__main__':
    sys.exit(main())
