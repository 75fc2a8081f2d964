#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""What a picture in texture space is made of: blurs.py SCENE [OUT.png] (d'Eon et al. 2007, figure 1)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(scene, out="blurs.png"):
    with pellucid.Scene.load(scene, aspect=4 / 3) as loaded, pellucid.Renderer(loaded) as renderer:
        picture = renderer.render("texture-space", size=(640, 480), intermediates=True, lights="sum")
    images = {name.partition(".")[2]: i.data for name, i in picture.intermediates.items() if name.startswith("texture-space.")
              and i.data.ndim == 3 and i.data.shape[2] == 3}
    scale = np.quantile(images["exitance"], 0.995)
    figure, axes = pyplot.subplots(3, 3, figsize=(10, 10))
    for axis in axes.flat:
        axis.axis("off")
    for axis, (name, data) in zip(axes.flat, [*list(images.items())[:7], ("exitance", images["exitance"])]):
        axis.imshow((data / scale).clip(0, 1) ** (1 / 2.2))
        axis.set_title(name)
    axes[2, 2].imshow(picture.display)
    axes[2, 2].set_title("picture")
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 3:
        sys.exit("usage: blurs.py SCENE [OUT.png]")
    main(*sys.argv[1:])
