#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The reflectance profile of layered skin: skin_layers.py [OUT.png] (d'Eon et al. 2007, figure 2 a; Donner and Jensen 2006)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(out="skin_layers.png"):
    skin, r = pellucid.skin_layers(), np.geomspace(0.02, 20, 300)
    figure, axis = pyplot.subplots(figsize=(7, 4.5))
    sums = pellucid.fit(skin.profiles(), 6)
    for channel, name in enumerate(("red", "green", "blue")):
        color = f"tab:{name}"
        axis.loglog(r, skin(r, channel)[0], color, label=f"{name}, total {skin.totals()[0, channel]:.3f}")
        axis.loglog(r, sums(r, channel), color, ls=":", lw=1)
    axis.set(xlabel="r, mm", ylabel="R(r), 1/mm$^2$", ylim=(1e-6, 10), title="epidermis on dermis, and six Gaussians (dotted)")
    axis.legend()
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
