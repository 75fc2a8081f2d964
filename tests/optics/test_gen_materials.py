#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Broken material files are refused with the file, the field and the value. TAP; the arguments are the script and the schema."""
import copy
import json
import os
import subprocess
import sys
import tempfile

GEN, SCHEMA = sys.argv[1:3]
MEDIUM = {'name': 'milk', 'title': 'Milk', 'kind': 'medium', 'family': 'made up',
          'sigma_a': [0.001, 0.002, 0.01], 'sigma_s_reduced': [2, 3, 4], 'g': [0, 0, 0],
          'eta': 1.3, 'color': [0.9, 0.8, 0.7], 'roughness': 0.1, 'mix': 0.5, 'color_from': 'profile',
          'note': 'a "quoted" \\ note?? \u00b5', 'source': 'made up'}
SET = {'name': 'set', 'title': 'Set', 'kind': 'gaussians', 'family': 'made up',
       'variances': [0.1, 0.7, 2], 'weights': [[0.1, 0, 1], [0.3, 0.2, 0], [0.3, 0.7, 0]],
       'eta': 1.4, 'color': [1, 1, 1], 'roughness': 0.3, 'mix': 1, 'color_from': 'texture', 'note': '', 'source': 'made up'}
ALIAS = {key: value for key, value in SET.items() if key not in ('variances', 'weights')} | {'name': 'alias', 'same_profile_as': 'set'}

DILUTED = {key: value for key, value in MEDIUM.items() if key not in ('sigma_a', 'sigma_s_reduced', 'g')} \
    | {'name': 'diluted', 'same_medium_as': 'milk', 'concentration': 0.25}
LAYER = {'name': 'top', 'thickness_mm': 0.5, 'sigma_a': [1, 1, 1], 'sigma_s': [2, 3, 4], 'g': [0.25, 0.25, 0.25], 'phase': 'schlick'}
BOTTOM = {'name': 'bottom', 'thickness_mm': 'infinite', 'sigma_a': [1, 2, 3], 'sigma_s_reduced': [2, 3, 4], 'eta': 1.5}
STACK = {'name': 'stack', 'title': 'Stack', 'kind': 'layers', 'family': 'made up', 'layers': [LAYER, BOTTOM], 'variances': [0.1, 1],
         'weights': [[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]], 'eta': 1.4, 'color': [1, 1, 1], 'roughness': 0.3, 'mix': 1, 'color_from': 'profile',
         'note': '', 'source': 'made up'}


def layered(**fields):
    """A stack whose first layer is changed."""
    layer = {key: value for key, value in (LAYER | fields).items() if value is not None}
    return {'stack': STACK | {'layers': [layer, BOTTOM]}}


def run(materials, listed=None):
    """Exit code, stderr and the C text for {file name: text or object}."""
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for name, material in materials.items():
            path = os.path.join(folder, name + '.json')
            with open(path, 'w', encoding='utf-8') as file:
                file.write(material if isinstance(material, str) else json.dumps(material))
            if listed is None or name in listed:
                paths.append(path)
        output = os.path.join(folder, 'out.c')
        done = subprocess.run([sys.executable, GEN, '--schema', SCHEMA, '--output', output, *paths], capture_output=True, text=True)
        text = ''
        if os.path.exists(output):
            with open(output, encoding='ascii') as file:
                text = file.read()
        return done.returncode, done.stderr, text


def changed(base, **fields):
    material = copy.deepcopy(base)
    for key, value in fields.items():
        if value is None:
            del material[key]
        else:
            material[key] = value
    return {base['name']: material}


CASES = {
    'a valid medium, set and alias pass': ({'milk': MEDIUM, 'set': SET, 'alias': ALIAS}, None),
    'a negative coefficient': (changed(MEDIUM, sigma_a=[0.1, -0.2, 0.3]), ['milk.json: sigma_a[1]: -0.2']),
    'a coefficient that is not finite': ({'milk': json.dumps(MEDIUM).replace('0.002', '1e999')}, ['milk.json: sigma_a[1]: inf']),
    'a NaN': ({'milk': json.dumps(MEDIUM).replace('0.002', 'NaN')}, ['milk.json: sigma_a[1]: nan']),
    'two channels for three': (changed(MEDIUM, sigma_a=[0.1, 0.2]), ['milk.json: sigma_a: 2 items']),
    'a text for a number': (changed(MEDIUM, eta='1.3'), ['milk.json: eta: "1.3" is no number']),
    'a truth value for a number': (changed(MEDIUM, eta=True), ['milk.json: eta: true is no number']),
    'an index below 1': (changed(MEDIUM, eta=0.9), ['milk.json: eta: 0.9 is not in [1, 4]']),
    'a roughness of 0': (changed(MEDIUM, roughness=0), ['milk.json: roughness: 0 is not in (0, 1]']),
    'nothing there at all': (changed(MEDIUM, sigma_a=[0, 1, 1], sigma_s_reduced=[0, 1, 1]),
                             ['milk.json: sigma_s_reduced[0]: sigma_a + sigma_s_reduced = 0']),
    'a missing field': (changed(MEDIUM, source=None), ['milk.json: source: is missing']),
    'an unknown field': (changed(MEDIUM, sigma_t=[1, 1, 1]), ['milk.json: sigma_t: does not belong here']),
    'an unknown kind': (changed(MEDIUM, kind='stone'), ['milk.json: kind: "stone" is none of "medium", "gaussians", "layers"']),
    'a medium with variances': (changed(MEDIUM, variances=[1]), ['milk.json: variances: does not belong here (as a medium)']),
    'a name that is not the file\'s': ({'milk': MEDIUM | {'name': 'cream'}}, ['milk.json: name: "cream"']),
    'a name with a space': ({'my milk': MEDIUM | {'name': 'my milk'}}, ['my milk.json: name: "my milk" does not match']),
    'variances that fall': (changed(SET, variances=[0.1, 2, 0.7]), ['set.json: variances[2]: 0.7 is not above 2']),
    'a weight row too few': (changed(SET, weights=SET['weights'][:2]), ['set.json: weights: 2 rows for 3 variances']),
    'a negative weight': (changed(SET, weights=[[0.1, 0, 1], [-0.3, 0.2, 0], [0.3, 0.7, 0]]), ['set.json: weights[1][0]: -0.3']),
    'a channel without weight': (changed(SET, weights=[[0.1, 0, 0], [0.3, 0.2, 0], [0.3, 0.7, 0]]), ['set.json: weights: column 2']),
    'an alias of nothing': ({'alias': ALIAS}, ['alias.json: same_profile_as: "set"']),
    'an alias of a medium': ({'alias': ALIAS | {'same_profile_as': 'milk'}, 'milk': MEDIUM}, ['alias.json: same_profile_as: "milk"']),
    'an alias of an alias': ({'alias': ALIAS, 'set': SET, 'deep': ALIAS | {'name': 'deep', 'same_profile_as': 'alias'}},
                             ['deep.json: same_profile_as: "alias"']),
    'a diluted medium and a stack pass': ({'milk': MEDIUM, 'diluted': DILUTED, 'stack': STACK}, None),
    'no family': (changed(MEDIUM, family=None), ['milk.json: family: is missing']),
    'a concentration of 0': (changed(MEDIUM, concentration=0), ['milk.json: concentration: 0 is not in (0, 1000]']),
    'a dilution below 1': (changed(MEDIUM, dilution=0.5), ['milk.json: dilution: 0.5 is not in [1, 1000000.0]']),
    'a concentration that leaves nothing': (changed(MEDIUM, concentration=1e-9),
                                            ['milk.json: sigma_s_reduced[0]: sigma_a + sigma_s_reduced']),
    'both kinds of scattering': (changed(MEDIUM, sigma_s=[1, 1, 1]), ['milk.json: sigma_s']),
    'a borrower of a set': ({'set': SET, 'diluted': DILUTED | {'same_medium_as': 'set'}},
                            ['diluted.json: same_medium_as: "set" is no medium']),
    'a borrower of a borrower': ({'milk': MEDIUM, 'diluted': DILUTED, 'third': DILUTED | {'name': 'third', 'same_medium_as': 'diluted'}},
                                 ['third.json: same_medium_as: "diluted"']),
    'a stack with coefficients': (changed(STACK, sigma_a=[1, 1, 1]), ['stack.json: sigma_a: does not belong here (as a stack of layers)']),
    'a stack without its profile': (changed(STACK, weights=None), ['stack.json: weights: is missing']),
    'a stack that gives light': (changed(STACK, weights=[[0.6, 0.2, 0.3], [0.6, 0.2, 0.3]]), ['stack.json: weights: column 0 sums to 1.2']),
    'nine layers': (changed(STACK, layers=[LAYER] * 9), ['stack.json: layers: 9 items; 1 to 8 are allowed']),
    'an infinite layer on another': (layered(thickness_mm='infinite'), ['stack.json: layers[0].thickness_mm: only the last']),
    'a layer of no thickness': (layered(thickness_mm=0), ['stack.json: layers[0].thickness_mm: 0 is not in [1e-06']),
    'a thickness in words': (layered(thickness_mm='thin'), ['stack.json: layers[0].thickness_mm: "thin"']),
    'a layer with plain scattering and no g': (layered(g=None), ['stack.json: layers[0].g: is missing']),
    'a g for Rayleigh': (layered(phase='rayleigh'), ['stack.json: layers[0].g: does not belong']),
    'a phase function that is not there': (layered(phase='mie'), ['stack.json: layers[0].phase: "mie" is none of']),
    'a layer of nothing': (layered(sigma_a=[0, 1, 1], sigma_s=[0, 1, 1]),
                           ['stack.json: layers[0].sigma_s_reduced[0]: sigma_a + sigma_s_reduced']),
    'no JSON': ({'milk': '{"name": '}, ['milk.json: Expecting value']),
    'a key twice': ({'milk': '{"name": "milk", "name": "milk"}'}, ['milk.json: the key "name" stands twice']),
    'a list instead of an object': ({'milk': '[]'}, ['milk.json: [] is no object']),
    'several problems at once': (changed(MEDIUM, eta=9, mix=2), ['milk.json: eta: 9', 'milk.json: mix: 2']),
}


def check(materials, wanted):
    code, errors, text = run(materials)
    if wanted is None:
        names = [line.split('"')[1] for line in text.splitlines() if '.name = ' in line]
        return code == 0 and not errors and names == sorted(materials) and '\\042quoted\\042 \\134 note\\077\\077 \\302\\265' in text
    return code == 1 and not text and 'Traceback' not in errors and all(part in errors for part in wanted)


def main():
    print(f'1..{len(CASES) + 1}')
    failed = 0
    for number, (name, (materials, wanted)) in enumerate(CASES.items(), 1):
        good = check(materials, wanted)
        failed += not good
        print(f'{"ok" if good else "not ok"} {number} - {name}')
        if not good:
            print('\n'.join('# ' + line for line in str(run(materials)[:2]).splitlines()))
    code, errors, _ = run({'milk': MEDIUM, 'forgotten': MEDIUM | {'name': 'forgotten'}}, listed=['milk'])
    good = code == 1 and 'forgotten.json: is not in the list' in errors
    print(f'{"ok" if good else "not ok"} {len(CASES) + 1} - a file that the build does not list')
    return 1 if failed or not good else 0


sys.exit(main())
