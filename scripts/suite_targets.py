#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""suite_targets.py FOLDER SUITE[,-OTHER]: prints the files that the tests of a suite run or read, without those of another, for Ninja."""
import json
import os
import subprocess
import sys


def listed(folder, what):
    return json.loads(subprocess.run(["meson", "introspect", what, folder], check=True, capture_output=True, text=True).stdout)


def suites(test):
    return {s.split(":")[-1] for s in test["suite"]}


def main():
    folder, (suite, *without) = sys.argv[1], sys.argv[2].split(",-")
    files = {t["id"]: t["filename"] for t in listed(folder, "--targets")}
    tests = [t for t in listed(folder, "--tests") if suite in suites(t) and not suites(t) & set(without)]
    if not tests:
        sys.exit(f"no test is in the suite {suite}")
    needed = {os.path.relpath(f, os.path.abspath(folder)) for t in tests for d in t["depends"] for f in files.get(d, [])}
    print(" ".join(sorted(needed)))


if __name__ == "__main__":
    main()
