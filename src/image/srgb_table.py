# SPDX-License-Identifier: MIT
"""Writes the tables of the sRGB transfer function (IEC 61966-2-1) as a C file: srgb_table.py OUT."""
import sys


def decode(x):
    return x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4


def rows(name, values):
    text = [f"const float {name}[{len(values)}] = {{\n"]
    for i in range(0, len(values), 6):
        text.append("    " + " ".join(f"{v:.9e}f," for v in values[i : i + 6]) + "\n")
    return "".join(text) + "};\n"


with open(sys.argv[1], "w", encoding="ascii") as out:
    out.write('/* Made by srgb_table.py. */\n#include "image/color.h"\n\n')
    out.write(rows("pell_srgb_u8", [decode(i / 255) for i in range(256)]))
    # The last entry is there twice, so that interpolation at 65535 needs no test.
    out.write(rows("pell_srgb_fine", [decode(min(i, 4096) / 4096) for i in range(4098)]))
