#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Colours of skin over melanin and haemoglobin: skin_colors.py [OUT.png] (Donner and Jensen 2006, figure 9)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="skin_colors.png"):
    melanin, blood = np.geomspace(0.005, 0.5, 9), np.linspace(0.002, 0.1, 7)
    image = np.array([[pellucid.skin_color(melanin=m, haemoglobin=h) for h in blood] for m in melanin])
    figure, axis = pyplot.subplots(figsize=(6, 6))
    axis.imshow(np.where(image <= 0.0031308, 12.92 * image, 1.055 * np.maximum(image, 1e-9) ** (1 / 2.4) - 0.055).clip(0, 1))
    axis.set(xticks=range(7), xticklabels=[f"{h:.3f}" for h in blood], yticks=range(9), yticklabels=[f"{m:.3f}" for m in melanin],
             xlabel="haemoglobin", ylabel="melanin")
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
