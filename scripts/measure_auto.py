#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Judges `render --max-error` by `compare`: random scenes, the method that is chosen for a bound, and its error in a larger image.

    measure_auto.py PROGRAM FOLDER [--count 24] [--first 0] [--bound 8] [--samples 128] [--size 160]

Shapes, sizes, materials, lights and cameras are drawn by the scene's number. FOLDER gets the scenes and results.json; existing results are
not measured again. Prints for all scenes: the method, the predicted error and the one that `compare` finds with its noise.
"""
import argparse
import json
import pathlib
import random

from measure_truth import SHAPES, run, surface

MATERIALS = ('wholemilk', 'skimmilk', 'marble', 'skin1', 'skin2', 'ketchup', 'cream', 'potato', 'apple', 'wax', 'jade', 'soap')


def make_scene(folder, number):
    draw = random.Random(number)
    shape = draw.choice(sorted(SHAPES))
    if not (folder / shape).exists():
        surface(folder / shape, *SHAPES[shape])
    extent = 10 ** draw.uniform(1.0, 2.3)
    mm = lambda *at: [f'{x * extent}mm' for x in at]
    lights = []
    for _ in range(draw.randint(1, 3)):
        at = [draw.gauss(0, 1) for _ in range(3)]
        far = 2.6 / sum(x * x for x in at) ** 0.5
        lights.append({'type': 'rect', 'at': mm(*(far * x for x in at)), 'to': ['0mm'] * 3, 'width': f'{extent * draw.uniform(0.2, 1.2)}mm',
                       'height': f'{extent * draw.uniform(0.2, 1.2)}mm', 'radiance': draw.uniform(5, 40)})
    scene = {'pellucid': 1, 'meshes': [{'path': shape, 'size': f'{extent}mm'}], 'materials': {'*': {'preset': draw.choice(MATERIALS)}},
             'lights': lights, 'camera': {'side': f'{draw.randint(-180, 180)},{draw.randint(-20, 50)}'}, 'background': 'black',
             'render': {'boundary': 'smooth', 'msaa': 1}}
    if draw.random() < 0.3:
        scene['ground'] = True
    path = folder / f'scene{number}.json'
    path.write_text(json.dumps(scene, indent=1), 'utf-8')
    return path, f'{shape[:-4]} {extent:.0f} mm, {scene["materials"]["*"]["preset"]}'


def measure(options, path):
    size = ['--width', options.size, '--height', options.size * 3 // 4]
    choice = json.loads(run(options.program, 'render', path, '--max-error', f'{options.bound}%', *size, '--json', '-o',
                            path.with_suffix('.pfm')))
    row = {'method': choice['method'], 'tried': choice['auto']['tried'], 'measured': {}}
    labels = [t['method'] for t in choice['auto']['tried']]
    compared = json.loads(run(options.program, 'compare', path, '--methods', ','.join(labels), '--reference',
                              f'path-trace:samples={options.samples}', *size, '--json'))
    for m in compared['methods']:
        row['measured'][m['name']] = [m['rel_mse'] ** 0.5 if m['rel_mse'] else None, m.get('rel_mse_error')]
    return row


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('program')
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--count', type=int, default=24)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--bound', type=float, default=8.0)
    parser.add_argument('--samples', type=int, default=128)
    parser.add_argument('--size', type=int, default=160)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    kept = options.folder / 'results.json'
    results = json.loads(kept.read_text()) if kept.exists() else {}
    right, off = [], []
    for number in range(options.first, options.first + options.count):
        path, what = make_scene(options.folder, number)
        key = f'{number} {options.bound}'
        if key not in results:
            try:
                results[key] = measure(options, path)
            except SystemExit as error:  # of a camera below the ground, say
                print(f'{number:3} {what:28} {error}', flush=True)
                continue
            kept.write_text(json.dumps(results, indent=1), 'utf-8')
        row = results[key]
        for t in row['tried']:
            found = row['measured'].get(t['method'], [None])[0]
            if found is not None:
                off.append(t['error'] - found)
        predicted, found = row['tried'][-1]['error'], row['measured'].get(row['tried'][-1]['method'], [None])[0]
        good = row['method'] == 'path-trace' or found is None or found <= 0.01 * options.bound  # None: hidden by noise
        right.append(good)
        shown = '-' if found is None else f'{100 * found:5.1f} %'
        print(f'{number:3} {what:28} {row["method"]:14} foretold {100 * predicted:5.1f} %, '
              f'found {shown}{"" if good else "  over the bound"}',
              flush=True)
    print(f'{sum(right)} of {len(right)} within {options.bound:g} %; foretold less found: mean {100 * sum(off) / len(off):+.2f} %, '
          f'mean size {100 * sum(map(abs, off)) / len(off):.2f} %, of {len(off)} methods')


if __name__ == '__main__':
    main()
