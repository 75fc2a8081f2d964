#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the files of data/materials against their schema and writes them as a C table, sorted by name.

    gen_materials.py --schema data/materials/schema.json --output materials_data.c data/materials/*.json
    gen_materials.py --schema data/materials/schema.json --check data/materials/*.json

The schema is the home of all rules that a JSON Schema can state; the few that it can't are in check_material. Standard library only.
Every problem is printed as FILE: FIELD: what is wrong; the exit code is then 1.
"""
import argparse
import json
import math
import os
import re
import sys

TYPES = {'object': dict, 'array': list, 'string': str, 'boolean': bool}
KNOWN = {'$schema', '$comment', '$defs', '$ref', 'title', 'description', 'type', 'required', 'additionalProperties', 'properties', 'items',
         'enum', 'const', 'pattern', 'minLength', 'maxLength', 'minItems', 'maxItems', 'minimum', 'maximum', 'exclusiveMinimum', 'oneOf',
         'anyOf'}


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def join(where, key):
    return f'{where}[{key}]' if isinstance(key, int) else f'{where}.{key}' if where else key


def validate(value, schema, root, where=''):
    """The problems of `value` under `schema`, as (JSON path, text): the subset of draft 2020-12 that our schema uses."""
    if schema is True:
        return []
    if schema is False:
        return [(where, 'does not belong here')]
    unknown = set(schema) - KNOWN
    if unknown:
        raise SystemExit(f'schema: keyword {sorted(unknown)[0]!r} is not known to this script')
    if '$ref' in schema:
        target = root
        for part in schema['$ref'].removeprefix('#/').split('/'):
            target = target[part]
        return validate(value, target, root, where)

    found = []
    kind = schema.get('type')
    if kind and not (is_number(value) if kind == 'number' else isinstance(value, TYPES[kind])):
        return [(where, f'{json.dumps(value)} is no {kind}')]
    if 'enum' in schema and value not in schema['enum']:
        found.append((where, f'{json.dumps(value)} is none of {", ".join(map(json.dumps, schema["enum"]))}'))
    if 'const' in schema and value != schema['const']:
        found.append((where, f'{json.dumps(value)} is not {json.dumps(schema["const"])}'))
    if is_number(value):
        if not math.isfinite(value):
            found.append((where, f'{value} is not finite'))
        elif value < schema.get('minimum', -math.inf) or value > schema.get('maximum', math.inf) \
                or value <= schema.get('exclusiveMinimum', -math.inf):
            low = schema.get('minimum', schema.get('exclusiveMinimum'))
            found.append((where, f'{value} is not in {"(" if "exclusiveMinimum" in schema else "["}{low}, {schema.get("maximum")}]'))
    elif isinstance(value, str):
        if not schema.get('minLength', 0) <= len(value) <= schema.get('maxLength', math.inf):
            found.append((where, f'{len(value)} characters; {schema.get("minLength", 0)} to {schema.get("maxLength")} are allowed'))
        if 'pattern' in schema and not re.search(schema['pattern'], value):
            found.append((where, f'{json.dumps(value)} does not match {schema["pattern"]}'))
    elif isinstance(value, list):
        if not schema.get('minItems', 0) <= len(value) <= schema.get('maxItems', math.inf):
            found.append((where, f'{len(value)} items; {schema.get("minItems", 0)} to {schema.get("maxItems")} are allowed'))
        for i, item in enumerate(value):
            found += validate(item, schema.get('items', True), root, join(where, i))
    elif isinstance(value, dict):
        found += [(join(where, key), 'is missing') for key in schema.get('required', []) if key not in value]
        properties = schema.get('properties', {})
        for key, item in value.items():
            found += validate(item, properties.get(key, schema.get('additionalProperties', True)), root, join(where, key))
    if 'anyOf' in schema:
        tries = [validate(value, sub, root, where) for sub in schema['anyOf']]
        if all(tries):
            found += tries[0]
    if 'oneOf' in schema:
        tries = [validate(value, sub, root, where) for sub in schema['oneOf']]
        if sum(not t for t in tries) != 1:
            # Of several valid forms the nearest one gives the best message; a wrong kind is reported above already.
            best = min(tries, key=len)
            title = schema['oneOf'][tries.index(best)].get('title', 'any of the forms')
            found += [(p, f'{text} (as {title})') for p, text in best] or [(where, 'fits several forms at once')]
    return found


def check_material(material, name):
    """Rules that a JSON Schema cannot state. `material` is valid under the schema."""
    found = []
    if material['name'] != name:
        found.append(('name', f'{json.dumps(material["name"])} is not the file\'s name {json.dumps(name)}'))
    if material['kind'] == 'medium' and 'sigma_a' in material:
        for c in range(3):
            total = (material['sigma_a'][c] + reduced(material)[c]) * material.get('concentration', 1)
            if total < 1e-6:
                found.append((f'sigma_s_reduced[{c}]', f'sigma_a + sigma_s_reduced = {total}; at least 1e-06 is needed'))
    elif 'variances' in material:
        variances, weights = material['variances'], material['weights']
        for i in range(1, len(variances)):
            if variances[i] <= variances[i - 1]:
                found.append((f'variances[{i}]', f'{variances[i]} is not above {variances[i - 1]}'))
        if len(weights) != len(variances):
            found.append(('weights', f'{len(weights)} rows for {len(variances)} variances'))
        for c in range(3):
            if sum(row[c] for row in weights) <= 0:
                found.append(('weights', f'column {c} has no positive weight'))
            if material['kind'] == 'layers' and sum(row[c] for row in weights) > 1:
                found.append(('weights', f'column {c} sums to {sum(row[c] for row in weights)}; a stack reflects at most 1'))
        found += check_layers(material.get('layers', []))
    return found


def check_layers(layers):
    found = []
    for i, layer in enumerate(layers):
        where = f'layers[{i}]'
        if layer['thickness_mm'] == 'infinite' and i + 1 < len(layers):
            found.append((f'{where}.thickness_mm', 'only the last layer may be infinite'))
        if layer.get('phase') == 'rayleigh' and 'g' in layer:
            found.append((f'{where}.g', 'does not belong to the phase function "rayleigh"'))
        elif 'sigma_s' in layer and 'g' not in layer and layer.get('phase') != 'rayleigh':
            found.append((f'{where}.g', 'is missing: sigma_s is not reduced'))
        if not found:
            for c in range(3):
                total = layer['sigma_a'][c] + reduced(layer)[c]
                if total < 1e-6:
                    found.append((f'{where}.sigma_s_reduced[{c}]', f'sigma_a + sigma_s_reduced = {total}; at least 1e-06 is needed'))
    return found


def schlick_mean_cosine(k):
    """Mean cosine of Schlick's phase function (1 - k^2) / (4 pi (1 - k cos)^2), peak forward; a series where the closed form cancels."""
    if abs(k) < 0.05:
        return k * (2 / 3 + k * k * (2 / 15 + k * k * (2 / 35 + k * k * (2 / 63 + k * k * 2 / 99))))
    return 1 / k - (1 - k * k) / (2 * k * k) * (math.log1p(k) - math.log1p(-k))


def reduced(m):
    """sigma_s (1 - mean cosine) of a medium or a layer, 1/mm."""
    if 'sigma_s_reduced' in m:
        return m['sigma_s_reduced']
    g = m.get('g', [0, 0, 0])
    if m.get('phase') == 'schlick':
        g = [schlick_mean_cosine(k) for k in g]
    return [s * (1 - x) for s, x in zip(m['sigma_s'], g)]


def no_duplicates(pairs):
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(f'the key {json.dumps(key)} stands twice')
    return dict(pairs)


def read(path, schema, problems):
    def problem(where, text):
        problems.append(f'{path}: {where + ": " if where else ""}{text}')

    try:
        with open(path, encoding='utf-8') as file:
            material = json.load(file, object_pairs_hook=no_duplicates)
    except (OSError, ValueError) as error:
        problem('', str(error))
        return None
    found = validate(material, schema, schema) \
        or check_material(material, os.path.basename(path).removesuffix('.json'))
    for where, text in found:
        problem(where, text)
    return None if found else material


def resolve(materials, paths, problems):
    """Resolves borrowed profiles and media; a lender has its own, so there are no chains."""
    for name, material in materials.items():
        other = material.get('same_medium_as')
        if other is None:
            continue
        if other not in materials or materials[other]['kind'] != 'medium' or 'same_medium_as' in materials[other]:
            problems.append(f'{paths[name]}: same_medium_as: {json.dumps(other)} is no medium with coefficients of its own')
            continue
        lender = materials[other]
        scale = lender.get('concentration', 1)
        material['sigma_a'], material['sigma_s_reduced'] = [x * scale for x in lender['sigma_a']], [x * scale for x in reduced(lender)]
        material['g'], material['eta'], material['dilution'] = lender['g'], material.get('eta', lender['eta']), lender.get('dilution', 0)
    for name, material in materials.items():
        other = material.get('same_profile_as')
        if other is None:
            continue
        if other not in materials or materials[other]['kind'] != 'gaussians' or 'same_profile_as' in materials[other]:
            problems.append(f'{paths[name]}: same_profile_as: {json.dumps(other)} is no material with variances and weights of its own')
        else:
            material['variances'], material['weights'] = materials[other]['variances'], materials[other]['weights']


def normalised(column):
    """The column normalised such that adding the doubles in order gives exactly 1."""
    column = [w / math.fsum(column) for w in column]
    largest = column.index(max(column))
    for _ in range(100):
        total = 0.0
        for w in column:
            total += w
        if total == 1.0:
            return column
        column[largest] += 1.0 - total
    raise SystemExit('weights: no doubles found that sum to 1')


def number(value):
    return format(float(value), '.17g')


def triple(values):
    return '{ ' + ', '.join(map(number, values)) + ' }'


def string(text):
    """A C string literal: everything except plain ASCII as octal escapes, which end after three digits."""
    return '"' + ''.join(chr(b) if 32 <= b < 127 and b not in b'"\\?' else f'\\{b:03o}' for b in text.encode()) + '"'


def layer_text(layer, eta):
    thickness, phase, g = layer['thickness_mm'], layer.get('phase', 'hg'), layer.get('g', [0, 0, 0])
    kind = {'hg': 'HENYEY_GREENSTEIN', 'schlick': 'SCHLICK', 'rayleigh': 'RAYLEIGH'}[phase]
    mean = [schlick_mean_cosine(k) for k in g] if phase == 'schlick' else g
    phases = ', '.join(f'{{ PELL_PHASE_{kind}, {{ {number(k)}, 0 }}, 0 }}' for k in g)
    return (f'{{ {string(layer["name"])}, {"INFINITY" if thickness == "infinite" else number(thickness)}, {{ {triple(layer["sigma_a"])}, '
            f'{triple(reduced(layer))}, {triple(mean)}, {number(layer.get("eta", eta))} }}, {{ {phases} }} }}')


def entry(m):
    medium, concentration = m['kind'] == 'medium', m.get('concentration', 1)
    lines = [f'.name = {string(m["name"])}', f'.title = {string(m["title"])}', f'.kind = PELL_MATERIAL_{m["kind"].upper()}',
             f'.family = {string(m["family"])}']
    if medium:
        sigma_a, sigma_s = [x * concentration for x in m['sigma_a']], [x * concentration for x in reduced(m)]
        lines.append(f'.medium = {{ {triple(sigma_a)}, {triple(sigma_s)}, {triple(m["g"])}, {number(m["eta"])} }}')
        lines.append(f'.concentration = {number(concentration)}')
        lines.append(f'.dilution = {number(m.get("dilution", 0))}')
    else:
        columns = [[row[c] for row in m['weights']] for c in range(3)]
        if m['kind'] == 'gaussians':
            columns = [normalised(column) for column in columns]
        rows = ', '.join(triple(row) for row in zip(*columns))
        lines.append(f'.medium = {{ .eta = {number(m["eta"])} }}')
        lines.append(f'.gaussians = {{ {len(m["variances"])}, {{ {", ".join(map(number, m["variances"]))} }}, {{ {rows} }} }}')
    if 'layers' in m:
        rows = ', '.join(layer_text(layer, m['eta']) for layer in m['layers'])
        lines.append(f'.layers = {{ {len(m["layers"])}, {{ {rows} }} }}')
    lines += [f'.color = {triple(m["color"])}', f'.roughness = {number(m["roughness"])}', f'.mix = {number(m["mix"])}',
              f'.color_from_texture = {"true" if m["color_from"] == "texture" else "false"}',
              f'.note = {string(m["note"])}', f'.source = {string(m["source"])}']
    return '    {\n' + ''.join(f'        {line},\n' for line in lines) + '    },\n'


def main():
    parser = argparse.ArgumentParser(description='check data/materials and write it as a C table')
    parser.add_argument('--schema', required=True)
    parser.add_argument('--output', help='the C file to write')
    parser.add_argument('--check', action='store_true', help='write nothing')
    parser.add_argument('files', nargs='+')
    args = parser.parse_args()
    if bool(args.output) == args.check:
        parser.error('one of --output and --check is needed')

    with open(args.schema, encoding='utf-8') as file:
        schema = json.load(file)
    problems, materials, paths = [], {}, {}
    args.files = [path for path in args.files if os.path.realpath(path) != os.path.realpath(args.schema)]
    for path in args.files:
        material = read(path, schema, problems)
        if material is None:
            continue
        materials[material['name']], paths[material['name']] = material, path
    if not problems:
        resolve(materials, paths, problems)
    # A file that is not listed would silently not be shipped.
    for folder in {os.path.dirname(path) for path in args.files}:
        listed = {os.path.basename(path) for path in args.files} | {os.path.basename(args.schema)}
        problems += [f'{os.path.join(folder, name)}: is not in the list of materials of the build'
                     for name in sorted(os.listdir(folder or '.')) if name.endswith('.json') and name not in listed]
    if problems:
        print('\n'.join(problems), file=sys.stderr)
        return 1
    if args.output:
        with open(args.output, 'w', encoding='ascii') as file:
            file.write('/* SPDX-License-Identifier: MIT\n *\n'
                       ' * materials_data.c - made from data/materials by scripts/gen_materials.py: do not edit. */\n'
                       '#include "optics/material/materials.h"\n\n#include <math.h>\n#include <stddef.h>\n\n'
                       'const struct pell_material_entry pell_materials_data[] = {\n')
            file.write(''.join(entry(materials[name]) for name in sorted(materials)))
            file.write(f'}};\n\nconst size_t pell_materials_data_count = {len(materials)};\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
