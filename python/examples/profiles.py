#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""R(r) of a material by every model: profiles.py [OUT.png [MATERIAL]] (Jensen et al. 2001, figure 5, has the first)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="profiles.png", material="marble"):
    medium, r = pellucid.Medium.material(material), np.geomspace(0.02, 20, 400)
    figure, axes = pyplot.subplots(1, 3, figsize=(12, 4), sharey=True)
    for channel, axis in enumerate(axes):
        for model in pellucid.models():
            axis.loglog(r, pellucid.Profile(medium, channel, model)(r), label=model)
        axis.set(title=f"{material}, {'red green blue'.split()[channel]}", xlabel="r, mm", ylim=(1e-7, 10))
    axes[0].set_ylabel("R(r), 1/mm$^2$")
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
