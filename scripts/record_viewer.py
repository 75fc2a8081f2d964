#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""record_viewer.py PROGRAM OUT.webp INPUT [OPTION...]: a short film of `pellucid view`: someone turns the object, tries materials, drags a
light and compares two methods. Needs node, chromium, img2webp (Debian's webp), and `npm ci` in tests/browser."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests/support"))
PROGRAM, OUT, ARGUMENTS = sys.argv[1], pathlib.Path(sys.argv[2]).resolve(), sys.argv[3:]
sys.argv = [sys.argv[0], PROGRAM, str(HERE.parent)]  # as the tests have them


def main():
    from viewer_test import Viewer  # reads sys.argv
    node, chromium = shutil.which("node"), shutil.which("chromium") or shutil.which("chromium-browser")
    modules = HERE.parent / "tests/browser/node_modules/playwright-core"
    if not node or not chromium or not shutil.which("img2webp") or not modules.is_dir():
        sys.exit("node, chromium, img2webp and `npm ci` in tests/browser are needed")
    with tempfile.TemporaryDirectory(prefix="pellucid-") as folder, Viewer(os.getcwd(), *ARGUMENTS) as viewer:
        address = f"http://{viewer.host}:{viewer.port}/?token={viewer.token}"
        subprocess.run([node, HERE / "record_viewer.mjs", chromium, address, folder], check=True)
        frames = sorted(pathlib.Path(folder).glob("*.png"))
        arguments = []
        for frame in frames:
            arguments += ["-lossy", "-q", "80", "-d", "1100" if frame.stem.endswith("-rest") else "90", str(frame)]
        subprocess.run(["img2webp", "-loop", "0", "-m", "6", *arguments, "-o", str(OUT)], check=True, stdout=subprocess.DEVNULL)
    print(f"{OUT}: {len(frames)} frames, {OUT.stat().st_size} bytes")


main()
