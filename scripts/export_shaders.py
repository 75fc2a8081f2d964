#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Writes the compute shaders of the methods for other programs: SPIR-V, HLSL (shader model 6.0) and MSL, and passes.json, which says what
each takes. Needs glslc and spirv-cross.

export_shaders.py OUTPUT [METHOD ...]   into OUTPUT/METHOD/; without a METHOD those of all

In HLSL the binding n of a buffer is the register tn where it is only read, un where not, and push constants are the constant buffer b0. In
MSL it is buffer(n), and push constants are the buffer after the last. A specialisation constant is the macro SPIRV_CROSS_CONSTANT_ID_n in
HLSL, function_constant(n) in MSL.
"""
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

from make_shader import READS, WRITES, Declared

ROOT = pathlib.Path(__file__).resolve().parent.parent
ACCESS = {READS: "read", WRITES: "write", READS | WRITES: "read and write"}


def run(*command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except FileNotFoundError:
        sys.exit(f"{command[0]} is not installed: apt install {'glslc' if command[0] == 'glslc' else 'spirv-cross'}")
    except subprocess.CalledProcessError as why:
        sys.exit(f"{' '.join(command)}: {why.stderr.strip()}")


def purpose(source):
    """The comment at the head of a shader, as one line, and its description of each buffer."""
    head = re.search(r"// \w+\.comp - (.*?)\n(?!//)", source, re.S)
    lines = head[1].split("\n// ")
    first = next((i for i, line in enumerate(lines) if re.match(r" +(in|out|in/out) +\d", line)), len(lines))
    buffers = {}
    for line in lines[first:]:
        row = re.match(r" +(?:in|out|in/out) +(\d+) \w+ +(.*)", line)
        if row:
            last = int(row[1])
            buffers[last] = row[2]
        else:
            buffers[last] += " " + line.strip()
    return " ".join(line.strip() for line in lines[:first]), buffers


def facts(name, source, declared, reflected):
    about, said = purpose(source)
    types, push = reflected["types"], reflected.get("push_constants")
    names = {b["binding"]: b["name"].lower() for b in reflected["ssbos"]}
    members = types[types[push[0]["type"]]["members"][0]["type"]]["members"] if push else []
    return {"shader": name, "purpose": about, "workgroup": list(declared.local),
            "buffers": [{"binding": i, "name": names[i], "access": ACCESS[access], "holds": said.get(i, "")}
                        for i, access in enumerate(declared.buffers())],
            "push_constants": [{"name": m["name"].lstrip("_"), "type": m["type"], "offset": m["offset"]} for m in members],
            "constants": [{"id": c["id"], "name": c["name"], "type": c["type"], "default": c["default_value"]}
                          for c in reflected.get("specialization_constants", [])]}


def export(path, folder, work):
    name, text = path.stem, path.read_text("utf-8")
    named, binary = work / "named.spv", folder / f"{path.stem}.spv"
    common = ["--target-env=vulkan1.3", "-Werror", "-I", str(ROOT / "src"), "-fshader-stage=compute", str(path), "-o"]
    run("glslc", "-O", *common, str(binary))
    run("glslc", "-O0", *common, str(named)) # with names, for people to read
    data = binary.read_bytes()
    declared = Declared(struct.unpack(f"<{len(data) // 4}I", data))
    found = facts(name, text, declared, json.loads(run("spirv-cross", str(named), "--reflect")))
    head = f"// SPDX-License-Identifier: MIT\n// Made of {path.relative_to(ROOT)}: {found['purpose']}\n"
    hlsl = run("spirv-cross", str(named), "--hlsl", "--shader-model", "60")
    hlsl = re.sub(r"^cbuffer Push$", "cbuffer Push : register(b0)", hlsl, flags=re.M)
    (folder / f"{name}.hlsl").write_text(head + hlsl, "utf-8")
    msl = run("spirv-cross", str(named), "--msl", "--msl-decoration-binding")
    msl = re.sub(r"(constant Push& \w+ \[\[buffer)\(0\)\]\]", rf"\1({len(found['buffers'])})]]", msl)
    (folder / f"{name}.metal").write_text(head + msl, "utf-8")
    return found


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    methods = sorted({path.parent.name for path in (ROOT / "src/methods").glob("*/*.comp")})
    wanted = [name.replace("-", "_") for name in sys.argv[2:]] or methods
    for method in wanted:
        if method not in methods:
            sys.exit(f"{method} has no shaders; there are those of {', '.join(methods)}")
        folder = pathlib.Path(sys.argv[1]) / method.replace("_", "-")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as work:
            passes = [export(path, folder, pathlib.Path(work)) for path in sorted((ROOT / "src/methods" / method).glob("*.comp"))]
        (folder / "passes.json").write_text(json.dumps(passes, indent=2) + "\n", "utf-8")
        print(f"{folder}: {', '.join(p['shader'] for p in passes)}")


if __name__ == "__main__":
    main()
