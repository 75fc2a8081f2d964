#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_viewer.py PROGRAM ROOT SOURCE [SHOTS]: shows a ball of marble with `pellucid view` and drives its page in a browser. SOURCE is the
folder of viewer.mjs, below which `npm ci` has put its modules; without them, or without node or chromium, it is skipped."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from cli_test import PROGRAM, sphere, write_obj
from viewer_test import Viewer

SOURCE = pathlib.Path(sys.argv[3]).resolve()
SCENE = ['ball.obj', '--unit', '1mm', '--material', 'marble', '--width', '160', '--height', '90', '--msaa', '1', '--light-samples', '2',
         '--indirect-samples', '256']


def skip(reason):
    print(f'1..0 # SKIP {reason}')
    sys.exit(0)


def main():
    node = shutil.which('node')
    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    if not node or not chromium:
        skip('node or chromium is not there')
    if not all((SOURCE / 'node_modules' / m).is_dir() for m in ('playwright-core', 'axe-core')):
        skip('playwright-core and axe-core are not there: npm ci in tests/browser')
    with tempfile.TemporaryDirectory(prefix='pellucid-') as folder:
        folder = pathlib.Path(folder)
        (folder / 'scene').mkdir()
        write_obj(folder / 'scene' / 'ball.obj', *sphere())
        env = os.environ | {'HOME': str(folder), 'XDG_RUNTIME_DIR': str(folder), 'DBUS_SESSION_BUS_ADDRESS': 'disabled:'}
        with Viewer(folder / 'scene', *SCENE) as viewer:
            address = f'http://{viewer.host}:{viewer.port}/?token={viewer.token}'
            return subprocess.run([node, SOURCE / 'viewer.mjs', chromium, address, PROGRAM, *sys.argv[4:]], cwd=folder / 'scene', env=env,
                                  check=False).returncode


if __name__ == '__main__':
    sys.exit(main())
