#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The shaders that scripts/export_shaders.py writes for other programs are complete: HLSL compiles and declares what the SPIR-V does,
MSL has a kernel with every buffer; TAP. Skipped without spirv-cross or glslangValidator.

    test_export.py ROOT
"""
import json
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(sys.argv[1])
sys.path.insert(0, str(ROOT / "scripts"))
from make_shader import Declared # noqa: E402

number = 0


def result(good, what, why=""):
    global number
    number += 1
    print(f"{'ok' if good else 'not ok'} {number} - {what}")
    for line in why.splitlines()[:0 if good else 8]:
        print(f"# {line}")


def compiled(source, folder):
    """Declarations of an HLSL file's SPIR-V: buffers by binding, without the constant buffer; the workgroup."""
    output = folder / "hlsl.spv"
    done = subprocess.run(["glslangValidator", "-D", "-V", "-S", "comp", "-e", "main", "--target-env", "vulkan1.3", str(source), "-o",
                           str(output)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return None, done.stdout
    data = output.read_bytes()
    declared = Declared(struct.unpack(f"<{len(data) // 4}I", data))
    return declared, ""


def check(shader, folder, work):
    name = f"{folder.name} {shader['shader']}"
    declared, why = compiled(folder / f"{shader['shader']}.hlsl", work)
    result(declared is not None and list(declared.local) == shader["workgroup"], f"{name}: HLSL compiles, with the same workgroup", why)
    hlsl = (folder / f"{shader['shader']}.hlsl").read_text("utf-8")
    registers = {int(n): kind for kind, n in re.findall(r"register\(([tu])(\d+), space0\)", hlsl)}
    wanted = {b["binding"]: "t" if b["access"] == "read" else "u" for b in shader["buffers"]}
    used = {n: kind for n, kind in registers.items() if wanted.get(n) == kind}
    result(used == registers and set(registers) <= set(wanted) and "cbuffer Push : register(b0)" in hlsl,
           f"{name}: a register for each binding", f"{registers}, should be {wanted}")
    kernel = re.search(r"^kernel void main0\((.*)\)$", (folder / f"{shader['shader']}.metal").read_text("utf-8"), re.M)
    bindings = sorted(int(n) for n in re.findall(r"\[\[buffer\((\d+)\)\]\]", kernel[1] if kernel else ""))
    result(len(set(bindings)) == len(bindings) and bindings[-1:] == [len(wanted)] and set(bindings[:-1]) <= set(wanted),
           f"{name}: an MSL kernel with its buffers and, behind them, its push constants", str(bindings))
    offsets = [member["offset"] for member in shader["push_constants"]]
    result(offsets == list(range(0, 4 * len(offsets), 4)) and all(b["holds"] for b in shader["buffers"]) and shader["purpose"] != "",
           f"{name}: passes.json says what is in each buffer and where each push constant is")


def main():
    for tool in ("glslc", "spirv-cross", "glslangValidator"):
        if not shutil.which(tool):
            print(f"1..0 # SKIP {tool} is not installed")
            return
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        done = subprocess.run([sys.executable, str(ROOT / "scripts/export_shaders.py"), str(work / "out")], capture_output=True, text=True,
                              check=False)
        result(done.returncode == 0, "every method's shaders are written", done.stderr)
        sources = list((ROOT / "src/methods").glob("*/*.comp"))
        lists = {path.parent.name: json.loads(path.read_text("utf-8")) for path in sorted((work / "out").glob("*/passes.json"))}
        result(sum(map(len, lists.values())) == len(sources) > 0, "passes.json has all of them")
        for method, shaders in lists.items():
            for shader in shaders:
                check(shader, work / "out" / method, work)
        done = subprocess.run([sys.executable, str(ROOT / "scripts/export_shaders.py"), str(work / "out"), "dipole"], capture_output=True,
                              text=True, check=False)
        result(done.returncode == 1 and "dipole has no shaders; there are those of image_space" in done.stderr,
               "a method without shaders is refused, with those that have some", done.stderr)
    print(f"1..{number}")


main()
