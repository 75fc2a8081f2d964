#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Scattering round a sphere, integrated before: preintegrated.py [OUT.png [MATERIAL]] (Penner 2011)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="preintegrated.png", material="skin1"):
    table = np.stack([pellucid.table_sphere(p, 1.0, 256, 128) / p.total for p in pellucid.profiles(pellucid.Medium.material(material))], -1)
    figure, axis = pyplot.subplots(figsize=(7, 4))
    axis.imshow(table.clip(0, 1) ** (1 / 2.2), origin="lower", extent=(-1, 1, 0, 1), aspect="auto")
    axis.set(xlabel="cosine between normal and light", ylabel="curvature, 1/mm", title=material)
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
