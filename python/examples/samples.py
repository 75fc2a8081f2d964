#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Importance samples in the tangent plane: samples.py SCENE [OUT.png] (Mertens et al. 2003, figure 3)."""
import sys

from matplotlib import pyplot

import pellucid


def main(scene, out="samples.png"):
    with pellucid.Scene.load(scene, aspect=4 / 3) as loaded, pellucid.Renderer(loaded) as renderer:
        figure, axes = pyplot.subplots(1, 3, figsize=(12, 4))
        for axis, sampling in zip(axes, ("importance", "separate", "combined")):
            shown = renderer.render("image-space", size=(64, 48), samples=64, tile="1", sampling=sampling, intermediates=True).intermediates
            x, y, _ = shown["image-space.material-1.samples"].data.reshape(-1, 3).T
            axis.plot(x, y, ".", ms=4)
            axis.set(title=f"sampling={sampling}", xlabel="mm", aspect="equal", xlim=(-20, 20), ylim=(-20, 20))
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 3:
        sys.exit("usage: samples.py SCENE [OUT.png]")
    main(*sys.argv[1:])
