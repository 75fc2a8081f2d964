#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Compiles a compute shader to SPIR-V, checks it, and writes it as a C file with what it declares (struct pell_shader, vulkan/gpu.h).

make_shader.py GLSLC SPIRV-VAL SOURCE NAME INCLUDE OUTPUT DEPFILE

SPIRV-VAL '' leaves the check out. A shader may have storage buffers, bindings 0 to n - 1 of set 0, each a block of its own that says
readonly or writeonly where it is; push constants of scalars of 4 bytes, and structs of them; specialisation constants.
"""
import pathlib
import struct
import subprocess
import sys
import tempfile

MEMBER_DECORATE, DECORATE, MODE, VARIABLE, POINTER, STRUCT = 72, 71, 16, 59, 32, 30
TYPE_INT, TYPE_FLOAT = 21, 22
NON_WRITABLE, NON_READABLE, BINDING, SET = 24, 25, 33, 34
PUSH_CONSTANT, STORAGE_BUFFER = 9, 12
MODE_ID, CONSTANT = 331, 43
LOCAL_SIZE, LOCAL_SIZE_ID = 17, 38
READS, WRITES = 1, 2
BINDINGS = 16


class Declared:
    """What a module of SPIR-V declares."""

    def __init__(self, words):
        self.decorations, self.members, self.pointers, self.structs, self.scalars = {}, {}, {}, {}, {}
        self.variables, self.constants, self.local, self.by_id = [], {}, None, False
        at = 5
        while at < len(words):
            count, op = words[at] >> 16, words[at] & 0xffff
            self.take(op, words[at + 1:at + count])
            at += count
        if self.by_id: # constants follow
            self.local = [self.constants[i] for i in self.local]

    def take(self, op, args):
        if op == DECORATE:
            self.decorations.setdefault(args[0], {})[args[1]] = args[2:]
        elif op == MEMBER_DECORATE:
            self.members.setdefault((args[0], args[1]), set()).add(args[2])
        elif op == POINTER:
            self.pointers[args[0]] = args[2]
        elif op == STRUCT:
            self.structs[args[0]] = args[1:]
        elif op in (TYPE_INT, TYPE_FLOAT):
            self.scalars[args[0]] = args[1] // 8
        elif op == VARIABLE:
            self.variables.append((args[0], args[1], args[2]))
        elif op == MODE and args[1] == LOCAL_SIZE:
            self.local = args[2:5]
        elif op == CONSTANT:
            self.constants[args[1]] = args[2]
        elif op == MODE_ID and args[1] == LOCAL_SIZE_ID:
            self.local = args[2:5]
            self.by_id = True

    def size(self, kind):
        if kind in self.structs:
            return sum(self.size(member) for member in self.structs[kind])
        if self.scalars.get(kind) != 4:
            raise ValueError("push constants are scalars of 4 bytes")
        return 4

    def access(self, variable, block):
        def said(what):
            return what in self.decorations.get(variable, {}) or \
                all(what in self.members.get((block, i), ()) for i in range(len(self.structs[block])))
        return (0 if said(NON_READABLE) else READS) | (0 if said(NON_WRITABLE) else WRITES)

    def buffers(self):
        found = {}
        for kind, variable, storage in self.variables:
            if storage != STORAGE_BUFFER:
                continue
            said = self.decorations.get(variable, {})
            if said.get(SET) != (0,):
                raise ValueError("a buffer is not of set 0")
            found[said[BINDING][0]] = self.access(variable, self.pointers[kind])
        if sorted(found) != list(range(len(found))) or not 0 < len(found) <= BINDINGS:
            raise ValueError(f"bindings {sorted(found)}, must be 0 to n - 1, at most {BINDINGS}")
        return [found[i] for i in range(len(found))]

    def push_size(self):
        return sum(self.size(self.pointers[kind]) for kind, _, storage in self.variables if storage == PUSH_CONSTANT)


def main():
    glslc, validator, source, name, include, output, depfile = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        binary = pathlib.Path(folder, "shader.spv")
        done = subprocess.run([glslc, "--target-env=vulkan1.3", "-Werror", "-O", "-I", include, "-MD", "-MF", depfile, "-MT", output,
                               "-fshader-stage=compute", source, "-o", str(binary)], check=False)
        if done.returncode == 0 and validator:
            done = subprocess.run([validator, "--target-env", "vulkan1.3", str(binary)], check=False)
        if done.returncode != 0:
            return 1
        data = binary.read_bytes()
    words = struct.unpack(f"<{len(data) // 4}I", data)
    try:
        declared = Declared(words)
        access, push = declared.buffers(), declared.push_size()
    except ValueError as why:
        print(f"{source}: {why}", file=sys.stderr)
        return 1
    rows = [", ".join(f"0x{w:08x}u" for w in words[i:i + 10]) for i in range(0, len(words), 10)]
    text = f"""/* SPDX-License-Identifier: MIT
 * Made by make_shader.py of {pathlib.Path(source).name}. */
#include "vulkan/gpu.h"

static const uint32_t words[] = {{
{chr(10).join(f"    {row}," for row in rows)}
}};

extern const struct pell_shader pell_{name}_shader;
const struct pell_shader pell_{name}_shader = {{
    .name = "{name}",
    .words = words,
    .size = sizeof(words),
    .num_bindings = {len(access)},
    .access = {{ {", ".join(map(str, access))} }},
    .push_size = {push},
    .local = {{ {", ".join(map(str, declared.local))} }},
}};
"""
    pathlib.Path(output).write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
