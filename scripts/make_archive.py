#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_archive.py OUT.a ARCHIVE [--lto COMPILER OPTION...]: a copy of the static library ARCHIVE whose global names all begin with pell_.

Hidden names of the rooms (mesh_fan, pt_step) are global in an archive, where a user's program could have the same: each gets
PREFIX in front. The objects stay apart, so that the linker takes only those that a program uses. With --lto the objects hold the compiler's
own code, which only that compiler could link: it makes one object of machine code of them.
"""
import pathlib
import subprocess
import sys
import tempfile

PREFIX = "pell_internal_"


def run(*command):
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout


def whole(archive, folder):
    """The archive itself, or one with the objects that a thin archive has only the paths of."""
    if archive.read_bytes()[:8] != b"!<thin>\n":
        return archive
    full = folder / "full.a"
    run("ar", "qcS", full, *(archive.parent / name for name in run("ar", "t", archive).splitlines()))
    return full


def foreign(path):
    """Global names that an object or archive defines and that do not begin with pell_."""
    lines = run("nm", "-g", "-P", "--defined-only", path).splitlines()
    names = {line.split()[0] for line in lines if not line.endswith(":") and line}
    return sorted(name for name in names if not name.startswith("pell_"))


def main():
    out, archive, *rest = sys.argv[1:]
    out, archive = pathlib.Path(out).resolve(), pathlib.Path(archive).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        if rest[:1] == ["--lto"]:
            one, whole_archive = folder / "pellucid.o", ["-Wl,--whole-archive", archive, "-Wl,--no-whole-archive"]
            run(*rest[1:], "-r", "-nostdlib", *whole_archive, "-o", one)
            full = folder / "full.a"
            run("ar", "qcS", full, one)
        else:
            full = whole(archive, folder)
        names = folder / "names"
        names.write_text("".join(f"{name} {PREFIX}{name}\n" for name in foreign(full)), "utf-8")
        run("objcopy", "-D", f"--redefine-syms={names}", full, out)
        run("ranlib", "-D", out)


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit(f"{' '.join(error.cmd[:3])} ...: {error.stderr}")
