#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The methods side by side, with their error against `hierarchical`: methods.py SCENE [OUT.png] (docs/guide/compare.md says how)."""
import sys

import numpy as np
from matplotlib import pyplot

import pellucid


def main(scene, out="methods.png"):
    names = ["none", "screen-space", "image-space", "texture-space", "convolution"]
    with pellucid.Scene.load(scene, aspect=4 / 3) as loaded, pellucid.Renderer(loaded) as renderer:
        truth = renderer.render("hierarchical", size=(320, 240))
        shown = [(name, renderer.render(name, size=(320, 240), exposure=truth.exposure)) for name in names]
    figure, axes = pyplot.subplots(2, 3, figsize=(12, 6.5))
    mask = truth["translucent"][..., 0] if "translucent" in truth.layers else np.ones(truth.rgb.shape[:2])
    for axis, (name, picture) in zip(axes.flat, [("hierarchical", truth), *shown]):
        error = pellucid.compare(picture["diffuse.multiple"] + picture["transmission"], truth["diffuse.multiple"] + truth["transmission"],
                                 mask=(mask > 0.5).astype(np.float32))["rel_mse"]
        axis.imshow(picture.display)
        axis.set_title(f"{name}" if picture is truth else f"{name}, error {100 * error ** 0.5:.1f} %")
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 3:
        sys.exit("usage: methods.py SCENE [OUT.png]")
    main(*sys.argv[1:])
