#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the table of the monte-carlo model (data/profiles/monte-carlo.json, made by pell-photon-table) and writes it as C.

    gen_profiles.py --header src/optics/photon/table.h --output photon_table_data.c data/profiles/monte-carlo.json
"""
import argparse
import json
import math
import re
import sys


def sizes(path):
    """The dimensions that the header states: the only home of them."""
    with open(path, encoding='ascii') as file:
        found = dict(re.findall(r'#define PELL_TABLE_(G|ETA|ALPHA|R) (\d+)', file.read()))
    return [int(found[key]) for key in ('G', 'ETA', 'ALPHA', 'R')]


def check(table, size):
    ng, ne, na, nr = size
    for key, n in (('g', ng), ('eta', ne), ('v', na), ('photons', ng)):
        axis = table[key]
        if len(axis) != n or not all(isinstance(x, (int, float)) and math.isfinite(x) for x in axis):
            return f'{key}: {n} finite numbers are needed'
        if key != 'photons' and any(a >= b for a, b in zip(axis, axis[1:])):
            return f'{key}: does not rise'
    if table['v'][0] != 0 or table['v'][-1] != 1:
        return 'v: must go from 0 to 1'
    if len(table['rows']) != ng * ne * na:
        return f'rows: {len(table["rows"])} of {ng * ne * na}'
    for i, (total, y, error) in enumerate(table['rows']):
        if len(total) != 2 or not 0 < total[0] <= 1 or not 0 <= total[1] <= 1:
            return f'rows[{i}]: total {total}'
        if len(y) != nr or not all(isinstance(v, int) and abs(v) <= 32767 for v in y):
            return f'rows[{i}]: {nr} whole numbers of 16 bits are needed'
        if len(error) != nr or not all(isinstance(v, int) and 0 <= v <= 255 for v in error):
            return f'rows[{i}]: {nr} errors of 0 to 255 are needed'
    return None


def block(name, values, per_row, size, form):
    ng, ne, na, _ = size
    out = [f'    .{name} = {{\n']
    for g in range(ng):
        out.append('        {\n')
        for e in range(ne):
            rows = values[(g * ne + e) * na:(g * ne + e + 1) * na]
            if per_row:
                out.append('            {\n')
                for row in rows:
                    line = '                { ' + ', '.join(map(form, row)) + ' },\n'
                    out.append(line)
                out.append('            },\n')
            else:
                out.append('            { ' + ', '.join(map(form, rows)) + ' },\n')
        out.append('        },\n')
    return ''.join(out) + '    },\n'


def main():
    parser = argparse.ArgumentParser(description='write the monte-carlo table as C')
    parser.add_argument('--header', required=True)
    parser.add_argument('--output', required=True)
    parser.add_argument('file')
    args = parser.parse_args()
    size = sizes(args.header)
    try:
        with open(args.file, encoding='utf-8') as file:
            table = json.load(file)
        problem = check(table, size)
    except (OSError, ValueError, KeyError, TypeError) as error:
        problem = repr(error)
    if problem:
        print(f'{args.file}: {problem}', file=sys.stderr)
        return 1
    rows = table['rows']
    with open(args.output, 'w', encoding='ascii') as file:
        file.write('/* SPDX-License-Identifier: MIT\n *\n'
                   ' * photon_table_data.c - made from data/profiles by scripts/gen_profiles.py: do not edit. */\n'
                   '#include "optics/photon/table.h"\n\nconst struct pell_photon_table pell_photon_table_data = {\n')
        for key in ('g', 'eta', 'v', 'photons'):
            file.write(f'    .{key} = {{ {", ".join(repr(float(x)) for x in table[key])} }},\n')
        file.write(block('total', [row[0][0] for row in rows], False, size, lambda x: f'{float(x)!r}f'))
        file.write(block('total_error', [row[0][1] for row in rows], False, size, lambda x: f'{float(x)!r}f'))
        file.write(block('y', [row[1] for row in rows], True, size, str))
        file.write(block('error', [row[2] for row in rows], True, size, str))
        file.write('};\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
