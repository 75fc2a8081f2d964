#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The albedo that gives a wanted colour, by model and by a closed map: colors.py [OUT.png] (what artists' parameters are made of)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="colors.png"):
    albedo = 1.0 - np.linspace(1.0, 0.0, 300) ** 2  # colours change most near 1
    figure, axis = pyplot.subplots(figsize=(6, 4.5))
    for model in pellucid.models():
        color = pellucid.total_reflectance(1 - albedo, albedo, eta=1.3, model=model)
        axis.plot(color, albedo, "--" if model == "monte-carlo" else "-", label=model)
    axis.plot(pellucid.color_from_albedo(albedo), albedo, "k:", label="map van-de-hulst, index 1")
    axis.set(xlabel="diffuse colour", ylabel="reduced albedo", title="index of refraction 1.3")
    axis.legend()
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
