#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_once.py STORE FOLDER SCRIPT [NAME ...] -- [OTHER ...]: copies the output of SCRIPT FOLDER NAME ... into FOLDER; the script runs
once for all folders.

STORE keeps the output by a hash of its input: the contents of SCRIPT and of the OTHER scripts that it imports, the NAMEs, and the version
of Python. An empty STORE: SCRIPT is run.
"""
import hashlib
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile


def key_of(script, names, others):
    key = hashlib.sha256(repr((sys.version, names)).encode())
    for path in [script, *others]:
        key.update(hashlib.sha256(pathlib.Path(path).read_bytes()).digest())
    return key.hexdigest()[:32]


def make(script, folder, names):
    subprocess.run([sys.executable, script, str(folder), *names], check=True)


def main():
    store, folder, script, *rest = sys.argv[1:]
    end = rest.index('--')
    names, others = rest[:end], rest[end + 1:]
    if not store:
        make(script, folder, names)
        return
    kept = pathlib.Path(store) / key_of(script, names, others)
    if not kept.is_dir():
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept.parent) as work:
            made = pathlib.Path(work) / 'made'
            make(script, made, names)
            try:
                os.rename(made, kept)  # whole, or not at all
            except OSError:
                if not kept.is_dir():  # another build was faster
                    raise
    for path in kept.iterdir():
        shutil.copy(path, folder)


if __name__ == '__main__':
    main()
