#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_binding.py COMPILER INCLUDE BUILT-INCLUDE LOOPS.C OUT.C: the C source of the extension module _pellucid.

Everything that the public headers declare is bound, so that they stay the only list: the compiler's preprocessor reads them without the
system's headers, and cffi (API mode) parses what is left. LOOPS.C holds the loops over arrays; its functions marked LOOP are bound, too.
"""
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

import cffi

HEADERS = ["pellucid/pellucid.h"]


def preprocess(compiler, folders, *options):
    with tempfile.TemporaryDirectory() as scratch:
        empty = pathlib.Path(scratch)
        for name in ("stdbool.h", "stddef.h", "stdint.h"):
            (empty / name).write_text("", "utf-8")
        text = "".join(f"#include <{name}>\n" for name in HEADERS)
        command = [*shlex.split(compiler), "-E", "-P", "-U__GNUC__", "-nostdinc", f"-I{empty}", *(f"-I{f}" for f in folders), *options]
        done = subprocess.run([*command, "-xc", "-"], input=text, check=True, capture_output=True, text=True)
    return done.stdout


def constants(compiler, folders):
    """Lines of cdef for the numeric macros: whole numbers as such, others as doubles."""
    lines = []
    for name, value in re.findall(r"^#define (PELL_\w+)[ \t]+(\S.*)$", preprocess(compiler, folders, "-dM"), re.MULTILINE):
        if re.fullmatch(r"-?(\d+\.\d*|\d+)(e[-+]?\d+)?f?", value) and not re.fullmatch(r"-?\d+", value):
            lines.append(f"static const double {name};")
        elif not value.startswith('"') and "__" not in value:
            lines.append(f"#define {name} ...")
    return sorted(lines)


def main():
    compiler, *folders, loops, out = sys.argv[1:]
    declared = preprocess(compiler, folders)
    declared = re.sub(r"static inline[^;{]*\{.*?\n\}", "", declared, flags=re.DOTALL)
    source = pathlib.Path(loops).read_text("utf-8")
    found = re.findall(r"^LOOP ([^{;]*?\))\n\{", source, re.MULTILINE)
    callbacks = """
        extern "Python" void _pellucid_log(void *user, const struct pell_message *message);
        extern "Python" void _pellucid_progress(void *user, const char *task, double fraction);
        extern "Python" enum pell_result _pellucid_show(void *user, const struct pell_intermediate *image);
    """
    ffi = cffi.FFI()
    ffi.cdef("\n".join([declared, *constants(compiler, folders), *(f"{f};" for f in found), callbacks]))
    includes = "".join(f"#include <{name}>\n" for name in HEADERS)
    ffi.set_source("pellucid._pellucid", includes + source)
    ffi.emit_c_code(out)


if __name__ == "__main__":
    main()
