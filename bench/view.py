#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""view.py PROGRAM INPUT [OPTION...]: responsiveness of `pellucid view` in headless Chromium on the same machine. Prints one JSON object:
images per second while the object is rotated, milliseconds from input to the end of drawing (median, 95 %), the size that was reached
in time, memory, and the idle load as a fraction of a core. OPTIONs are those of `pellucid view`. Needs node, chromium, and `npm ci`
in tests/browser."""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / 'tests/support'))
PROGRAM, ARGUMENTS = sys.argv[1], sys.argv[2:]
sys.argv = [sys.argv[0], PROGRAM, str(HERE.parent)]  # as the tests have them
SECONDS = 6


def main():
    from viewer_test import Viewer  # reads sys.argv
    node, chromium = shutil.which('node'), shutil.which('chromium') or shutil.which('chromium-browser')
    if not node or not chromium or not (HERE.parent / 'tests/browser/node_modules/playwright-core').is_dir():
        sys.exit('node, chromium and `npm ci` in tests/browser are needed')
    with Viewer(os.getcwd(), *ARGUMENTS) as viewer:
        address = f'http://{viewer.host}:{viewer.port}/?token={viewer.token}'
        done = subprocess.run([node, HERE / 'view.mjs', chromium, address, str(SECONDS)], check=True, capture_output=True, text=True)
        answer = json.loads(done.stdout)
        before, start = viewer.cpu_seconds(), time.monotonic()
        time.sleep(3.0)  # the page is closed: nothing is left to do
        answer['rest_share_of_core'] = (viewer.cpu_seconds() - before) / (time.monotonic() - start)
        status = pathlib.Path(f'/proc/{viewer.process.pid}/status').read_text('ascii')
        answer['memory_most_bytes'] = 1024 * int(re.search(r'VmHWM:\s+(\d+) kB', status)[1])
    print(json.dumps({'bench': 'view', 'threads': os.cpu_count(), **answer}, indent=2))


main()
