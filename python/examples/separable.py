#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Separable kernels of rank 1 to 3 and what they lose: separable.py [OUT.png [MATERIAL]] (Jimenez et al. 2015)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="separable.png", material="skin1"):
    profiles = pellucid.profiles(pellucid.Medium.material(material))
    figure, axes = pyplot.subplots(1, 3, figsize=(12, 4), sharey=True)
    for rank, axis in enumerate(axes, 1):
        kernel = pellucid.separable(profiles, taps=41, rank=rank)
        for channel, color in enumerate(("tab:red", "tab:green", "tab:blue")):
            for part in kernel.weight[:, :, channel]:
                axis.plot(kernel.offset, part / np.gradient(kernel.offset), color)
        axis.set(title=f"rank {rank}", xlabel="mm")
        axis.axhline(0, color="grey", lw=0.5)
    axes[0].set_ylabel("a(x), 1/mm")
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
