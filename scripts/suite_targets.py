#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""suite_targets.py FOLDER SUITE: prints the files that the tests of a suite run or read, for Ninja."""
import json
import os
import subprocess
import sys


def listed(folder, what):
    return json.loads(subprocess.run(["meson", "introspect", what, folder], check=True, capture_output=True, text=True).stdout)


def main():
    folder, suite = sys.argv[1:]
    files = {t["id"]: t["filename"] for t in listed(folder, "--targets")}
    tests = [t for t in listed(folder, "--tests") if suite in [s.split(":")[-1] for s in t["suite"]]]
    if not tests:
        sys.exit(f"no test is in the suite {suite}")
    needed = {os.path.relpath(f, os.path.abspath(folder)) for t in tests for d in t["depends"] for f in files.get(d, [])}
    print(" ".join(sorted(needed)))


if __name__ == "__main__":
    main()
