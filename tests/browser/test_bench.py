#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_bench.py PROGRAM ROOT SOURCE [SHOTS]: builds the site with the profile bench, operates its page in a browser, and compares it
with the program. SOURCE is the folder of bench.mjs. Skipped where emcc, node, chromium, python3-markdown or `npm ci` are missing."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from cli_test import PROGRAM, ROOT

SOURCE = pathlib.Path(sys.argv[3]).resolve()
MOST_BYTES = 1 << 20


def skip(reason):
    print(f'1..0 # SKIP {reason}')
    sys.exit(0)


def main():
    node, chromium = shutil.which('node'), shutil.which('chromium')
    if not shutil.which('emcc'):
        skip('there is no emcc (package emscripten)')
    if not node or not chromium or not (SOURCE / 'node_modules/playwright-core').is_dir():
        skip('node, chromium or playwright-core are not there')
    with tempfile.TemporaryDirectory(prefix='pellucid-') as folder:
        folder = pathlib.Path(folder)
        env = os.environ | {'HOME': str(folder), 'XDG_RUNTIME_DIR': str(folder), 'DBUS_SESSION_BUS_ADDRESS': 'disabled:'}
        made = subprocess.run([ROOT / 'scripts/make_docs.sh', folder / 'site'], env=env, capture_output=True, text=True, check=False)
        if 'install python3-markdown' in made.stderr:
            skip('there is no Python with Markdown (python3-markdown)')
        if made.returncode != 0:
            print('1..1\nnot ok 1 - the site with the profile bench is made\n# ' + (made.stdout + made.stderr).replace('\n', '\n# '))
            return 1
        size = sum((folder / 'site' / name).stat().st_size for name in ('bench.html', 'bench.js', 'optics.js'))
        print(f'# the page and its scripts have {size} bytes', flush=True)
        if size > MOST_BYTES:
            print('1..1\nnot ok 1 - the profile bench has less than a MiB')
            return 1
        page = (folder / 'site/bench.html').as_uri()
        return subprocess.run([node, SOURCE / 'bench.mjs', chromium, page, PROGRAM, *sys.argv[4:]], env=env, check=False).returncode


if __name__ == '__main__':
    sys.exit(main())
