#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks that clang-format would change no C file; one test in TAP.

check_format.py [ROOT]        checks the tree
check_format.py --fix [ROOT]  formats it

Versions of clang-format break lines differently, so only the one of Debian 12 counts; where another or none is installed the test is
skipped.
"""
import pathlib
import re
import shutil
import subprocess
import sys

VERSION = "14"
FOLDERS = ["bench", "examples", "fuzz", "include", "src", "tests", "tools"]


def main():
    fix = "--fix" in sys.argv
    roots = [a for a in sys.argv[1:] if not a.startswith("--")]
    root = pathlib.Path(roots[0] if roots else ".")
    program = shutil.which(f"clang-format-{VERSION}") or shutil.which("clang-format")
    version = subprocess.run([program, "--version"], capture_output=True, text=True).stdout if program else ""
    print("1..1")
    if not re.search(rf"version {VERSION}\.", version):
        print(f"ok 1 - clang-format # SKIP clang-format {VERSION} is not installed")
        return 0
    files = sorted(str(p) for folder in FOLDERS for p in (root / folder).rglob("*")
                   if p.suffix in (".c", ".h") and "node_modules" not in p.parts)
    done = subprocess.run([program, "-i", *files] if fix else [program, "--dry-run", "-Werror", *files], capture_output=True, text=True)
    errors = re.findall(r"^(\S+?:\d+):\d+: error", done.stderr, re.MULTILINE)
    print("ok 1 - clang-format changes no file" if done.returncode == 0 else "not ok 1 - clang-format changes no file")
    for error in errors[:20]:
        print(f"# {error}")
    if errors:
        print(f"# {len(errors)} errors; scripts/check_format.py --fix corrects them")
    return 0 if done.returncode == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
