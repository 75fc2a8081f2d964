#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Albedo from the colour that is wanted, and back: colors.py [OUT.png] (what artists' parameters are made of)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="colors.png"):
    albedo = np.linspace(0.0, 1.0, 300)
    figure, axis = pyplot.subplots(figsize=(6, 4.5))
    for eta in (1.0, 1.3, 1.5):
        axis.plot(pellucid.color_from_albedo(albedo, eta=eta), albedo, label=f"index of refraction {eta}")
    axis.set(xlabel="diffuse colour", ylabel="reduced albedo")
    axis.legend()
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
