#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_report.py PROGRAM SOURCE [SHOTS]: makes a report of a small scene whose names are hostile and looks at it in a browser. SOURCE is
the folder of report.mjs, below which `npm ci` has put its modules; without them, or without node or chromium, it is skipped."""
import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

PROGRAM, SOURCE = os.path.abspath(sys.argv[1]), pathlib.Path(sys.argv[2]).resolve()
# As an argument this is a path, "<" a folder in it; in a page it would end a script and begin an element.
NAME = '</script><img src=x onerror="hacked=1">&amp;\'.obj'


def skip(reason):
    print(f'1..0 # SKIP {reason}')
    sys.exit(0)


def ball(path, rows=12, columns=20):
    """A closed ball of 40 mm, its material hostile too."""
    points, faces = [(0, -20, 0)], []
    for i in range(1, rows):
        a = math.pi * (i / rows - 0.5)
        points += [(20 * math.cos(a) * math.sin(2 * math.pi * j / columns), 20 * math.sin(a),
                    20 * math.cos(a) * math.cos(2 * math.pi * j / columns)) for j in range(columns)]
    points.append((0, 20, 0))

    def at(i, j):
        return 2 + (i - 1) * columns + j % columns
    for j in range(columns):
        faces += [(1, at(1, j + 1), at(1, j)), (at(rows - 1, j), at(rows - 1, j + 1), len(points))]
        for i in range(1, rows - 1):
            faces += [(at(i, j), at(i, j + 1), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i + 1, j))]
    text = ''.join('v %.5f %.5f %.5f\n' % p for p in points) + 'usemtl </script><b>--><!--\n' + ''.join('f %d %d %d\n' % f for f in faces)
    path.write_text(text, 'utf-8')


def main():
    node = shutil.which('node')
    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    if not node or not chromium:
        skip('node or chromium is not there')
    if not all((SOURCE / 'node_modules' / m).is_dir() for m in ('playwright-core', 'axe-core')):
        skip('playwright-core and axe-core are not there: npm ci in tests/browser')
    with tempfile.TemporaryDirectory(prefix='pellucid-') as folder:
        folder = pathlib.Path(folder)
        (folder / '<').mkdir()
        ball(folder / NAME)
        made = subprocess.run([PROGRAM, 'compare', NAME, '--size', '40mm', '--material', 'marble', '--methods', 'all,none', '-o', 'out/',
                               '-q', '--width', '160', '--height', '90', '--msaa', '1', '--light-samples', '4'],
                              cwd=folder, capture_output=True, text=True, check=False)
        if made.returncode:
            print(f'1..1\nnot ok 1 - the report is made\n# {made.stderr.strip()}')
            return 1
        # Configuration folders of dconf and the like; the test's own folder serves.
        env = os.environ | {'HOME': str(folder), 'XDG_RUNTIME_DIR': str(folder), 'DBUS_SESSION_BUS_ADDRESS': 'disabled:'}
        return subprocess.run([node, SOURCE / 'report.mjs', chromium, folder / 'out/report.html', *sys.argv[3:]], env=env,
                              check=False).returncode


if __name__ == '__main__':
    sys.exit(main())
