#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Compiles the headers of src/shared as GLSL for Vulkan 1.3; TAP.

check_glsl.py ROOT GLSLC   each header alone, then shared.comp, which must call all that they define; skips where GLSLC is ''
"""
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

# Of struct pell_light_data, as lights.c asserts it in C.
OFFSETS = {"position": 0, "direction": 16, "right": 32, "up": 48, "power": 64, "spot_scale": 80, "spot_offset": 84, "type": 88,
           "samples": 92, "environment": 96, "light": 100, "image": 104, "flags": 108}
STRIDE = 112
HEAD = "#version 460\n#extension GL_GOOGLE_include_directive : require\n"


def run(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode == 0, (done.stdout + done.stderr).strip()


class Compiler:
    def __init__(self, root, glslc, folder):
        self.root, self.glslc, self.folder = root, glslc, folder

    def file(self, source, output):
        good, said = run(self.glslc, "--target-env=vulkan1.3", "-Werror", "-O0", "-fshader-stage=compute", "-I", str(self.root / "src"),
                         str(source), "-o", str(output))
        if good and shutil.which("spirv-val"):
            good, said = run("spirv-val", "--target-env", "vulkan1.3", str(output))
        return good, said

    def text(self, text):
        source = self.folder / "text.comp"
        source.write_text(HEAD + text + "\nlayout(local_size_x = 1) in;\nvoid main()\n{\n}\n", "utf-8")
        return self.file(source, self.folder / "text.spv")


def defined(text):
    """Functions and macros with arguments that a header gives its readers; the language's own words are not counted."""
    functions = re.findall(r"^PELL_SHARED [\w() ]+?\b(\w+)\((?:PELL_STRUCT|float|int32_t)", text, re.M)
    return functions + re.findall(r"^#define (\w+)\(", text, re.M)


def layout_faults(assembly):
    """Differences between the disassembly and OFFSETS and STRIDE. The struct occurs twice: only that of the buffer has a layout."""
    offsets, strides = {}, set()
    for struct in re.findall(r'OpName (%\w+) "pell_light_data"$', assembly, re.M):
        members = dict(re.findall(rf'OpMemberName {struct} (\d+) "(\w+)"', assembly))
        offsets.update((members[i], int(at)) for i, at in re.findall(rf"OpMemberDecorate {struct} (\d+) Offset (\d+)", assembly))
        for array in re.findall(rf"^ *(%\w+) = OpTypeRuntimeArray {struct}$", assembly, re.M):
            strides |= set(re.findall(rf"OpDecorate {array} ArrayStride (\d+)", assembly))
    return [] if offsets == OFFSETS and strides == {str(STRIDE)} else [f"offsets {offsets}, strides {strides}"]


def main():
    root, glslc = pathlib.Path(sys.argv[1]), sys.argv[2]
    headers = sorted((root / "src/shared").glob("*.h"))
    shader = root / "tests/shared/shared.comp"
    if not glslc:
        print("1..0 # SKIP glslc (package glslc) is not here")
        return 0
    results = []
    with tempfile.TemporaryDirectory() as folder:
        compiler = Compiler(root, glslc, pathlib.Path(folder))
        for header in headers:
            good, said = compiler.text(f'#include "shared/{header.name}"')
            results.append((f"{header.name} is GLSL by itself", good, said))
        spirv = pathlib.Path(folder, "shared.spv")
        good, said = compiler.file(shader, spirv)
        results.append(("a shader that calls all of them is valid SPIR-V", good, said))
        text = shader.read_text("utf-8")
        # Functions called by another header are called by the shader, too.
        inside = {h: h.read_text("utf-8") for h in headers}
        names = [n for h, t in inside.items() if h.name != "language.h" for n in defined(t)]
        uncalled = [n for n in names if len(re.findall(rf"\b{n}\b", text + "".join(inside.values()))) < 2]
        results.append((f"all {len(names)} functions and macros are called", len(names) > 20 and not uncalled, f"not called: {uncalled}"))
        if shutil.which("spirv-dis"):
            faults = layout_faults(run("spirv-dis", str(spirv))[1])
            results.append(("lights have the layout that C asserts", not faults, "; ".join(faults)))
        good, _ = compiler.text("float f(const float *p)\n{\n    return *p;\n}")
        results.append(("a pointer is refused", not good, "it compiles"))
    print(f"1..{len(results)}")
    for i, (what, good, said) in enumerate(results, 1):
        print(f"{'ok' if good else 'not ok'} {i} - {what}")
        if not good:
            print("\n".join(f"# {line}" for line in said.splitlines()))
    return 0 if all(good for _, good, _ in results) else 1


if __name__ == "__main__":
    sys.exit(main())
