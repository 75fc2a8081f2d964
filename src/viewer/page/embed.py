# SPDX-License-Identifier: MIT
"""Writes the files of the page as a table in C: embed.py FILE... OUT. index.html is "/", others are "/" and their name."""
import pathlib
import re
import sys

TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8", ".js": "text/javascript; charset=utf-8",
         ".svg": "image/svg+xml"}


def read(path):
    """A source without its licence line: that is not the reader's affair."""
    text = path.read_text("utf-8")
    return re.sub(r"\A(/\*.*?\*/|//[^\n]*|<!--.*?-->)\n", "", text, flags=re.DOTALL) if path.suffix != ".html" else \
        re.sub(r"<!-- SPDX.*?-->\n", "", text)


def main():
    out = ["/* Made by embed.py. */\n#include \"viewer/viewer.h\"\n\n"]
    rows = []
    for i, path in enumerate(pathlib.Path(p) for p in sys.argv[1:-1]):
        data = read(path).encode("utf-8")
        out.append(f"static const unsigned char file_{i}[{len(data)}] = {{\n")
        out += ["    " + " ".join(f"{b}," for b in data[k:k + 28]) + "\n" for k in range(0, len(data), 28)]
        out.append("};\n\n")
        name = "/" if path.name == "index.html" else f"/{path.name}"
        rows.append(f'    {{ "{name}", "{TYPES[path.suffix]}", file_{i}, sizeof(file_{i}) }},\n')
    out += ["const struct viewer_file viewer_files[] = {\n", *rows, "};\n", f"const size_t viewer_num_files = {len(rows)};\n"]
    pathlib.Path(sys.argv[-1]).write_text("".join(out), "ascii")


main()
