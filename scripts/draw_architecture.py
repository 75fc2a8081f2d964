#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws docs/images/architecture.svg from the code: the rooms of src/ in their order, and which of the others each includes.

draw_architecture.py [ROOT]          writes the picture
draw_architecture.py --check [ROOT]  one test in TAP: the committed picture is the one that the code makes
"""
import pathlib
import re
import sys

sys.dont_write_bytecode = True
from check_src import ROOMS  # noqa: E402

HOLDS = {
    "shared": "formulas in C and GLSL",
    "base": "memory, log, files, threads, knobs",
    "math": "vectors, transforms, sampling",
    "optics": "media, profiles, layers, fits",
    "image": "formats, colour",
    "scene": "meshes, materials, importers",
    "visibility": "rays, rasters, light grids",
    "lights": "light sources, environments",
    "transport": "solids, layers, refraction",
    "vulkan": "Vulkan devices",
    "render": "frame, stages, engines",
    "methods": "one folder per method",
    "compare": "metrics, error maps",
    "cli": "commands, reports",
    "viewer": "server, page",
}
ROW, LEFT, TOP, CELL = 30, 330, 96, 46


def find_includes(root):
    """{(room, other room)}: who includes whom"""
    uses = set()
    for path in sorted((root / "src").rglob("*")):
        if path.suffix not in (".c", ".h", ".inc"):
            continue
        room = path.relative_to(root / "src").parts[0]
        for other in re.findall(r'^\s*#\s*include\s+"(\w+)/', path.read_text("utf-8"), re.MULTILINE):
            if other != room and other in ROOMS:
                uses.add((room, other))
    return uses


def draw(root):
    uses = find_includes(root)
    rooms = [r for r in ROOMS if (root / "src" / r).is_dir()]
    width, height = LEFT + CELL * len(rooms) + 20, TOP + ROW * len(rooms) + 46
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="DejaVu Sans, sans-serif" font-size="13">',
           "<!-- SPDX-License-Identifier: MIT; made by scripts/draw_architecture.py -->",
           f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
           '<text x="16" y="26" font-size="16" font-weight="bold" fill="#1b1f24">Rooms of src/ and what they include</text>',
           '<text x="16" y="46" fill="#57606a">Row: the room that includes. Column: the room that is included.</text>']
    for i, room in enumerate(rooms):
        x = LEFT + CELL * i + CELL / 2
        out.append(f'<text transform="translate({x + 4:g} {TOP - 8}) rotate(-40)" font-size="11" fill="#1b1f24">{room}</text>')
    for i, room in enumerate(rooms):
        y = TOP + ROW * i
        out.append(f'<rect x="8" y="{y}" width="{width - 16}" height="{ROW}" fill="{"#f6f8fa" if i % 2 else "#ffffff"}"/>')
        out.append(f'<text x="16" y="{y + 20}" font-weight="bold" fill="#1b1f24">{room}</text>')
        out.append(f'<text x="112" y="{y + 20}" fill="#57606a">{HOLDS[room]}</text>')
        for k, other in enumerate(rooms):
            x = LEFT + CELL * k
            if k == i or (room, other) in uses:
                fill = "#d0d7de" if k == i else "#54aeff"
                out.append(f'<rect x="{x + 4}" y="{y + 4}" width="{CELL - 8}" height="{ROW - 8}" rx="3" fill="{fill}"/>')
    out.append(f'<text x="16" y="{TOP + ROW * len(rooms) + 26}" fill="#57606a">Nothing stands right of the grey squares: '
               "a room includes only rooms above it.</text>")
    return "\n".join(out + ["</svg>", ""])


def main():
    roots = [a for a in sys.argv[1:] if not a.startswith("--")]
    root = pathlib.Path(roots[0]) if roots else pathlib.Path(__file__).resolve().parent.parent
    path, text = root / "docs/images/architecture.svg", draw(root)
    if "--check" not in sys.argv:
        path.write_text(text, "utf-8")
        return 0
    same = path.is_file() and path.read_text("utf-8") == text
    print("1..1")
    print(f"{'ok' if same else 'not ok'} 1 - docs/images/architecture.svg is the picture of the code")
    if not same:
        print("# run scripts/draw_architecture.py")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
