#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""record.py [PROGRAM] [--repeats N]: measures this commit and adds it to docs/site/speed.json, which the site draws.

The figure of a method is the time of a warm frame of bench/screen-space.json, 1280 x 720 with one sample a pixel, over that of Embree's
camera rays alone in the same run: a machine that is twice as fast, or busy, changes it little. Run it on a quiet machine.
"""
import argparse
import json
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
HISTORY = ROOT / 'docs/site/speed.json'
METHODS = ('none', 'screen-space', 'image-space', 'texture-space', 'convolution', 'layered')
REFERENCE = 'camera rays alone'


def measure(program, method, repeats):
    """Milliseconds of the bench's rows by name, and the bench's description of the machine."""
    done = subprocess.run([program, 'bench', 'screen-space', '-m', method, '--repeats', str(repeats), '--json', '-q'],
                          check=True, capture_output=True, text=True)
    report = json.loads(done.stdout)
    return {row['name']: row['ms'] for row in report['rows']}, report


def git(tree, *words):
    return subprocess.run(['git', '-C', tree, *words], check=True, capture_output=True, text=True).stdout.strip()


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('program', nargs='?', type=pathlib.Path, default=ROOT / 'pellucid')
    parser.add_argument('--repeats', type=int, default=15)
    parser.add_argument('--note', default='', help='what has changed since the entry before')
    parser.add_argument('--tree', type=pathlib.Path, default=ROOT, help='the tree that the program was built from')
    args = parser.parse_args()

    frames = {}
    for method in METHODS:
        ms, report = measure(args.program, method, args.repeats)
        frames[method] = round(ms['frame'] / ms[REFERENCE], 3)
        print(f'{method:14} {ms["frame"]:8.1f} ms, {frames[method]:6.2f} of {REFERENCE}')
    commit, date = git(args.tree, 'log', '-1', '--format=%h %cs').split()
    entry = {'commit': commit, 'date': date, 'threads': report['threads'], 'note': args.note, 'frames': frames}
    history = [e for e in json.loads(HISTORY.read_text('utf-8')) if e['commit'] != commit] if HISTORY.exists() else []
    history = sorted(history + [entry], key=lambda e: e['date'])
    HISTORY.write_text('[\n' + ',\n'.join(f'  {json.dumps(e)}' for e in history) + '\n]\n', 'utf-8')


if __name__ == '__main__':
    main()
