#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Broken tables of spectra are refused with the file and the line. TAP; the arguments are the script and data/spectra."""
import os
import subprocess
import sys
import tempfile

GEN, FOLDER = sys.argv[1:3]
NAMES = ('cie1931.csv', 'd65.csv', 'haemoglobin.csv')
TEXTS = {}
for table in NAMES:
    with open(os.path.join(FOLDER, table), encoding='ascii') as source:
        TEXTS[table] = source.read()

CASES = {
    'the tables as they are': ({}, None),
    'a wavelength twice': ({'d65.csv': ('385,', '380,')}, 'd65.csv:6: wavelength 380, not 385'),
    'a negative power': ({'d65.csv': ('385,', '385,-')}, 'd65.csv:6: a number is negative'),
    'a NaN': ({'d65.csv': ('385,52.3118', '385,nan')}, 'd65.csv:6: a number is negative or not finite'),
    'a word': ({'d65.csv': ('385,52.3118', '385,much')}, 'd65.csv:6: could not convert'),
    'a cell too many': ({'d65.csv': ('385,', '385,1,')}, 'd65.csv:6: 3 numbers for 2 columns'),
    'columns swapped': ({'haemoglobin.csv': ('HbO2,Hb', 'Hb,HbO2')}, 'the columns are wavelength_nm,Hb,HbO2'),
    'a row that is missing': ({'cie1931.csv': ('400,0.01431,0.000396,0.06785001\n', '')}, 'cie1931.csv:9: wavelength 405, not 400'),
    'a table that is missing': ({'d65.csv': None}, 'd65.csv: is missing'),
}


def run(changes):
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for name, text in TEXTS.items():
            change = changes.get(name, ('', ''))
            if change is None:
                continue
            paths.append(os.path.join(folder, name))
            with open(paths[-1], 'w', encoding='ascii') as file:
                file.write(text.replace(*change, 1) if change[0] else text)
        output = os.path.join(folder, 'out.c')
        done = subprocess.run([sys.executable, GEN, '--output', output, *paths], capture_output=True, text=True)
        return done.returncode, done.stderr, os.path.exists(output)


def main():
    failed = 0
    print(f'1..{len(CASES)}')
    for number, (name, (changes, wanted)) in enumerate(CASES.items(), 1):
        code, errors, written = run(changes)
        good = (code, errors, written) == (0, '', True) if wanted is None else code == 1 and not written and wanted in errors
        failed += not good
        print(f'{"ok" if good else "not ok"} {number} - {name}')
        if not good:
            print('# ' + errors.replace('\n', '\n# '))
    return 1 if failed else 0


sys.exit(main())
