#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the tables of data/spectra and writes them as C.

    gen_spectra.py --output spectra_data.c cie1931.csv d65.csv haemoglobin.csv

A table has comments (#), a line of column names, and rows of numbers over evenly spaced wavelengths. Standard library only. Every problem
is printed as FILE:LINE: what is wrong; the exit code is then 1.
"""
import argparse
import math
import os
import sys

FIRST, LAST = 380, 780  # nm
TABLES = {'cie1931': (5, ['xbar', 'ybar', 'zbar']), 'd65': (5, ['power']), 'haemoglobin': (2, ['HbO2', 'Hb'])}


def read(path, problems):
    """Rows of numbers without the wavelength, or None."""
    name = os.path.basename(path).removesuffix('.csv')
    before = len(problems)
    if name not in TABLES:
        problems.append(f'{path}: is none of {", ".join(TABLES)}')
        return name, None
    step, columns = TABLES[name]
    rows, head = [], None
    with open(path, encoding='ascii') as file:
        for number, line in enumerate(file, 1):
            line = line.strip()
            if line.startswith('#') or not line:
                continue
            cells = line.split(',')
            if head is None:
                head = cells
                if head != ['wavelength_nm'] + columns:
                    problems.append(f'{path}:{number}: the columns are {line}, not wavelength_nm,{",".join(columns)}')
                    return name, None
                continue
            try:
                values = [float(cell) for cell in cells]
            except ValueError as error:
                problems.append(f'{path}:{number}: {error}')
                continue
            if len(values) != len(head):
                problems.append(f'{path}:{number}: {len(values)} numbers for {len(head)} columns')
            elif values[0] != FIRST + step * len(rows):
                problems.append(f'{path}:{number}: wavelength {values[0]:g}, not {FIRST + step * len(rows)}')
            elif not all(math.isfinite(v) and v >= 0 for v in values[1:]):
                problems.append(f'{path}:{number}: a number is negative or not finite')
            rows.append(values[1:])
    if len(rows) != (LAST - FIRST) // step + 1:
        problems.append(f'{path}: {len(rows)} rows, not {(LAST - FIRST) // step + 1}')
    return name, rows if len(problems) == before else None


def main():
    parser = argparse.ArgumentParser(description='check data/spectra and write it as C')
    parser.add_argument('--output', required=True, help='the C file to write')
    parser.add_argument('files', nargs='+')
    args = parser.parse_args()

    problems, text = [], ''
    found = dict(read(path, problems) for path in args.files)
    problems += [f'{name}.csv: is missing' for name in TABLES if name not in found]
    if problems:
        print('\n'.join(problems), file=sys.stderr)
        return 1
    for name, (step, columns) in TABLES.items():
        text += f'\nconst double pell_{name}[{len(found[name])}][{len(columns)}] = {{\n'
        text += ''.join('    { ' + ', '.join(format(v, '.17g') for v in row) + ' },\n' for row in found[name]) + '};\n'
    with open(args.output, 'w', encoding='ascii') as file:
        file.write('/* SPDX-License-Identifier: MIT\n *\n'
                   ' * spectra_data.c - made from data/spectra by scripts/gen_spectra.py: do not edit. */\n'
                   '#include "optics/medium/spectra.h"\n' + text)
    return 0


if __name__ == '__main__':
    sys.exit(main())
