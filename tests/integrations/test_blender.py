#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_blender.py PROGRAM ROOT: the add-on in a Blender without a window. Each case of blender_cases.py is a Blender of its own."""
import json
import os
import pathlib
import shutil
import subprocess
import sys

from cli_test import PROGRAM, ROOT, Skip, clean_environment, main, need, one_object, test, text, works

BLENDER = shutil.which('blender')


def case(folder, name):
    if not BLENDER:
        raise Skip('there is no program blender')
    # Debian's Blender looks for its Python in PATH: its own stands first.
    env = clean_environment(PYTHONDONTWRITEBYTECODE='1', PATH=os.path.dirname(BLENDER) + os.pathsep + os.environ['PATH'])
    cases = pathlib.Path(__file__).parent / 'blender_cases.py'
    done = subprocess.run([BLENDER, '-b', '--factory-startup', '--python-exit-code', '7', '-P', cases, '--', ROOT / 'integrations/blender',
                           PROGRAM, folder, name], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True,
                          timeout=200, check=False, env=env)
    found = [line[6:] for line in text(done.stdout).splitlines() if line.startswith('found ')]
    need(done.returncode == 0 and found, name, 'ended with', done.returncode, done.stdout[-3000:], done.stderr[-1000:])
    return json.loads(found[0])


def close(a, b, limit, *about):
    """Numbers, or lists of numbers."""
    a, b = (v if isinstance(v, list) else [v] for v in (a, b))
    need(len(a) == len(b) and all(abs(x - y) <= limit * max(abs(y), 1e-9) for x, y in zip(a, b)), *about, a, 'expected', b)


def millimetres(entry):
    return [float(r.removesuffix('mm')) for r in entry['radius']]


@test('objects, lights and camera are a scene file with a unit that check reads without a problem')
def _(folder):
    made = case(folder, 'sent')
    need(len(made['said']) == 1 and 'Stone' in made['said'][0], made['said'])
    close(float(made['unit'].removesuffix('mm')), 10, 1e-6, 'unit')
    need([li['type'] for li in made['lights']] == ['point', 'rect', 'directional', 'spot', 'environment'], made['lights'])
    answer = one_object(works(folder, 'check', 'scene.json', '--json'))
    need([p for p in answer['problems'] if p['severity'] != 'note'] == [], answer['problems'])


@test('a material without subsurface light is opaque, and said once')
def _(folder):
    made = case(folder, 'opaque')
    need(made == {'said': ['Material "Stone": has Subsurface 0 and is opaque: raise it, or choose "Built-in" under Material, Pellucid'],
                  'chosen': []}, made)


@test('only selected objects are sent, and stay selected')
def _(folder):
    made = case(folder, 'selection')
    need(made['selected'] == ['Suzanne'] and list(made['materials']) == ['Wax'], made)


@test('a Principled node becomes colour, radius in mm and the kind of its method')
def _(folder):
    made = case(folder, 'rule')
    for method, kind, eta in (('BURLEY', 'cycles', 1.45), ('RANDOM_WALK_FIXED_RADIUS', 'cycles', 1.45),
                              ('RANDOM_WALK', 'cycles-skin', 1.4)):
        need(made[method]['radius_kind'] == kind, method, made[method])
        close(made[method]['eta'], eta, 1e-6, method)
    close(millimetres(made['BURLEY']), [10, 5, 2.5], 1e-6, 'radius')
    # 0.75 base + 0.25 subsurface colour; a quarter of the radius
    close(made['share']['color'], [0.5, 0.45, 0.4], 1e-6, 'colour')
    close(millimetres(made['share']), [2.5, 1.25, 0.625], 1e-6, 'radius of a share')
    close(made['image']['materials']['Wax']['color'], [0.5, 0.375, 0.25], 1e-6, 'mean of an image, mixed')
    need(any('mean' in line for line in made['image']['said']), made['image']['said'])
    need(made['none'] == {} and made['preset'] == {'Wax': {'preset': 'skin'}}, made)


@test('presets and methods are those of the program')
def _(folder):
    made = case(folder, 'presets')
    rows = one_object(works(folder, 'materials', '--json'))['materials']
    need(made['rows'] == sorted(r['name'] for r in rows if 'milk' in r['name']) and 'wholemilk' in made['rows'], made['rows'])
    methods = one_object(works(folder, 'methods', '--json'))['methods']
    need(made['methods'] == sorted(m['name'] for m in methods), made['methods'])
    need(max(made['milk']) - min(made['milk']) < 0.1, 'milk is white', made['milk'])


@test('the picture is a linear image with the light of Cycles')
def _(folder):
    made = case(folder, 'picture')
    need(made['float'] and made['size'] == [96, 72], made)
    close(*made['sky'], 1e-5, 'sky')
    close(*made['means'], 0.12, 'the mean of the picture')
    close(*made['face'], 0.12, 'the mean of the face')


@test('each kind of light gives the floor the light that Cycles gives it')
def _(folder):
    for kind, (ours, theirs) in case(folder, 'lights').items():
        close(ours, theirs, 0.04, kind)


@test('an image around the world is seen where Cycles sees it')
def _(folder):
    made = case(folder, 'world')
    for ours, theirs in zip(made['ours'], made['theirs']):
        close(ours, theirs, 0.005, 'sky')


@test('a transparent film gives alpha')
def _(folder):
    made = case(folder, 'transparent')
    need(made['corner'] == 0 and made['most'] == 1, made)
    close(*made['means'], 0.02, 'the covered share')


@test('orthographic cameras and lenses are sent, panoramic ones are refused')
def _(folder):
    made = case(folder, 'lens')
    close(made['flat']['ortho_height'], 6, 1e-6, 'height of 8 by 6 units') # the scale is the wider side
    # A diameter of lens / 2 thousandths of a unit of 10 mm, in the scene file f / N with f = 12 mm / tan(fov / 2) = lens 24 / 27
    close(made['deep']['f_number'], 24 / 27 * 2 / 0.01, 1e-5, 'f-number')
    close(made['deep']['focus'], 15, 1e-6, 'focus')
    need(any('shift' in line for line in made['said']), made['said'])
    need('panoramic' in made['refused'], made['refused'])


@test('what a user can put right is reported with its place')
def _(folder):
    made = case(folder, 'errors')
    for name, words in (('wrong path', ['/nowhere/pellucid', 'Preferences']), ('not in PATH', ['not found in PATH', 'Preferences']),
                        ('wrong preset', ['marbel', 'did you mean "marble"', 'exit code 3']),
                        ('wrong method', ['screenspace', 'screen-space']),
                        ('no camera', ['has no camera']), ('nothing', ['nothing to send'])):
        need(all(word in made[name] for word in words), name, made[name])
        need('error:' not in made[name], name, made[name])
    need('"; did you mean "screen-space"?' in made['wrong method'], made['wrong method'])


@test('the viewer is opened, and ends with the add-on')
def _(folder):
    if b'view ' not in works(folder, '--help').stdout:
        raise Skip('the program has no viewer')
    made = case(folder, 'view')
    need(made == {'alive': True, 'ended': True, 'left': False}, made)


if __name__ == '__main__':
    sys.exit(main())
