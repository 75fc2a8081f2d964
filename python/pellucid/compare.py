# SPDX-License-Identifier: MIT
"""The difference of an image from a reference (pellucid/compare.h)."""
from __future__ import annotations

import warnings
from typing import Any, Optional, Union

import numpy as np

from ._base import Context, PellucidWarning, ffi, lib, numbers, pointer, set_knobs, wrong
from .render import Picture

_NUMBERS = ("mse", "rel_mse", "mae", "ssim", "flip", "flip_hdr", "noise_mse", "noise_rel_mse", "floor", "pixels")


class Comparison(dict):
    """Metrics by name: mse, rel_mse, mae, bias (3,), rel_bias (3,), ssim, flip, flip_hdr, ... of the pixels that count: those of the mask
    that are finite in both images; `pixels` is their number. bad_test, bad_reference, bad_variance: numbers of bad pixels of the images
    (struct pell_comparison). `whole`: the metrics without a mask; `maps`: (height, width) float32 by name: relative (signed), ssim, flip,
    flip_hdr."""

    whole: dict[str, Any]
    maps: dict[str, np.ndarray]


def _planes(image: Any, what: str) -> list[np.ndarray]:
    if isinstance(image, Picture):
        found = [image.channels[c] for c in "RGB"]
        if all(p.strides == found[0].strides and p.strides[1] == 4 for p in found):
            return found
        image = image.rgb
    array = numbers(image, what)
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise wrong(what, f"has the shape {array.shape}, must have (height, width) or (height, width, 3)")
    planes = [np.ascontiguousarray(array[:, :, c], dtype=np.float32) for c in range(min(array.shape[2], 3))]
    return planes * 3 if len(planes) == 1 else planes


def _metrics(m) -> dict[str, Any]:
    found: dict[str, Any] = {name: getattr(m, name) for name in _NUMBERS}
    return {**found, "bias": np.array(list(m.bias)), "rel_bias": np.array(list(m.rel_bias)), "ssim_rgb": np.array(list(m.ssim_rgb))}


def _count(out, bad: dict[str, int]) -> None:
    """Warns of pixels that don't count; InvalidError where none does."""
    if out.whole.pixels == 0:
        raise wrong("", "no pixel is finite in both images" + (" and has a variance that is" if bad["bad_variance"] else ""))
    if out.masked.pixels == 0:
        raise wrong("mask", "has no pixel above 0.5 where both images are finite")
    for name, what in (("bad_test", "are not finite"), ("bad_reference", "are not finite, or have a bad variance")):
        if bad[name]:
            warnings.warn(f"{name[4:]}: {bad[name]} of {out.width * out.height} pixels {what}; they are left out of all numbers",
                          PellucidWarning, stacklevel=3)


def compare(test: Union[Picture, np.ndarray], reference: Union[Picture, np.ndarray], *, mask: Optional[np.ndarray] = None,
            variance: Optional[np.ndarray] = None, display: bool = False, **knobs: Any) -> Comparison:
    """Compares two images (a Picture each) or arrays (height, width, 3), linear Rec.709 in one unit of light. mask: (height, width), counts where > 0.5.
    variance: of the reference, as the images. display: values are display values in [0, 1]. knobs: pell_compare_knobs (ppd, exposure, ...).
    Pixels that are not finite don't count: PellucidWarning says how many; InvalidError where no pixel is left.
    """
    given, names = [_planes(test, "test"), _planes(reference, "reference")], ["test", "reference"]
    if variance is not None:
        given.append(_planes(variance, "variance"))
        names.append("variance")
    if mask is not None:
        given.append([numbers(mask, "mask", np.float32)])
        names.append("mask")
    shapes = {p.shape for group in given for p in group}
    if len(shapes) != 1:
        named = ", ".join(f"{name} {group[0].shape}" for name, group in zip(names, given))
        raise wrong("", f"the images have different shapes, must have one (height, width): {named}")
    if len({p.strides for group in given for p in group}) != 1:
        given = [[np.ascontiguousarray(p) for p in group] for group in given]
    first = given[0][0]
    fill = [pointer(p, "float *") for group in given for p in group]
    entry = ffi.new("struct pell_compare_input *", {"width": first.shape[1], "height": first.shape[0], "stride": first.strides[0] // 4,
                                                    "test": fill[:3], "reference": fill[3:6], "display": display})
    if variance is not None:
        entry.variance = fill[6:9]
    if mask is not None:
        entry.mask = fill[-1]
    context = Context()
    params, out = ffi.new("struct pell_compare_params *"), ffi.new("struct pell_comparison *")
    lib.pell_knobs_default(lib.pell_compare_knobs(), params)
    try:
        set_knobs(context, lib.pell_compare_knobs(), "compare", params, knobs)
        context.call(lib.pell_compare, context.c, entry, params, out)
        bad = {name: getattr(out, name) for name in ("bad_test", "bad_reference", "bad_variance")}
        _count(out, bad)
        result = Comparison({**_metrics(out.masked), **bad})
        result.whole = _metrics(out.whole)
        size = out.width * out.height
        result.maps = {name: np.frombuffer(ffi.buffer(getattr(out, name), 4 * size), np.float32).reshape(out.height, out.width).copy()
                       for name in ("relative", "ssim", "flip", "flip_hdr") if getattr(out, name)}
    finally:
        lib.pell_comparison_finish(context.c, out)
        context.close()
    return result
