#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Light of planes through an object, before and after the convolutions: planes.py SCENE [OUT.png] (Munoz et al. 2011, figure 1)."""
import sys

from matplotlib import pyplot

import pellucid


def main(scene, out="planes.png"):
    with pellucid.Scene.load(scene, aspect=4 / 3) as loaded, pellucid.Renderer(loaded) as renderer:
        picture = renderer.render("convolution", size=(320, 240), planes=4, visible=False, intermediates=True)
    brightest = max(i.data.max() for name, i in picture.intermediates.items() if name.startswith("convolution."))
    figure, axes = pyplot.subplots(2, 4, figsize=(12, 5))
    for row, kind in enumerate(("irradiance", "exitance")):
        for plane, axis in enumerate(axes[row], 1):
            image = picture.intermediates.get(f"convolution.plane-{plane}.{kind}")
            axis.axis("off")
            if image:
                axis.imshow((image.data / brightest).clip(0, 1) ** (1 / 2.2))
                axis.set_title(f"plane {plane}: {kind}")
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 3:
        sys.exit("usage: planes.py SCENE [OUT.png]")
    main(*sys.argv[1:])
