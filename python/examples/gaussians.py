#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The dipole of marble and its best sums of Gaussians: gaussians.py [OUT.png [MATERIAL]] (d'Eon et al. 2007, section 4)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="gaussians.png", material="marble"):
    medium, r = pellucid.Medium.material(material), np.linspace(0, 8, 500)
    green = pellucid.Profile(medium, 1)
    figure, axis = pyplot.subplots(figsize=(7, 4.5))
    axis.plot(r, r * green(r), "k", lw=2, label="dipole")
    for count in (1, 2, 4, 6):
        sums = pellucid.fit(medium, count)
        axis.plot(r, r * sums(r, 1), label=f"{count} Gaussian{'s' if count > 1 else ''}, error {100 * sums.error[1]:.1f} %")
    axis.set(xlabel="r, mm", ylabel="r R(r), 1/mm", title=f"{material}, green")
    axis.legend()
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
