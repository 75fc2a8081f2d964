# SPDX-License-Identifier: MIT
"""The difference of an image from a reference (pellucid/compare.h)."""
from __future__ import annotations

from typing import Any, Optional, Union

import numpy as np

from ._base import Context, InvalidError, ffi, lib, pointer, set_knobs
from .render import Picture

_NUMBERS = ("mse", "rel_mse", "mae", "ssim", "flip", "flip_hdr", "noise_mse", "noise_rel_mse", "floor", "pixels")


class Comparison(dict):
    """Metrics by name: mse, rel_mse, mae, bias (3,), rel_bias (3,), ssim, flip, flip_hdr, ... of the pixels that the mask counts; `whole`:
    the same without a mask; `maps`: (height, width) float32 by name: relative (signed), ssim, flip, flip_hdr."""

    whole: dict[str, Any]
    maps: dict[str, np.ndarray]


def _planes(image: Any, what: str) -> list[np.ndarray]:
    if isinstance(image, Picture):
        found = [image.channels[c] for c in "RGB"]
        if all(p.strides == found[0].strides and p.strides[1] == 4 for p in found):
            return found
        image = image.rgb
    array = np.asarray(image)
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InvalidError(f"has shape {array.shape}, must be (height, width) or (height, width, 3)", what)
    planes = [np.ascontiguousarray(array[:, :, c], dtype=np.float32) for c in range(min(array.shape[2], 3))]
    return planes * 3 if len(planes) == 1 else planes


def _metrics(m) -> dict[str, Any]:
    found: dict[str, Any] = {name: getattr(m, name) for name in _NUMBERS}
    return {**found, "bias": np.array(list(m.bias)), "rel_bias": np.array(list(m.rel_bias)), "ssim_rgb": np.array(list(m.ssim_rgb))}


def compare(test: Union[Picture, np.ndarray], reference: Union[Picture, np.ndarray], *, mask: Optional[np.ndarray] = None,
            variance: Optional[np.ndarray] = None, display: bool = False, **knobs: Any) -> Comparison:
    """Compares two pictures or arrays (height, width, 3), linear Rec.709 in one unit of light. mask: (height, width), counts where > 0.5.
    variance: of the reference, as the images. display: values are display values in [0, 1]. knobs: pell_compare_knobs (ppd, exposure, ...).
    """
    given = [_planes(test, "test"), _planes(reference, "reference")]
    if variance is not None:
        given.append(_planes(variance, "variance"))
    if mask is not None:
        given.append([np.ascontiguousarray(mask, dtype=np.float32)])
    shapes = {p.shape for group in given for p in group}
    if len(shapes) != 1:
        raise InvalidError(f"images have the shapes {sorted(shapes)}, must be equal", "compare")
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
        result = Comparison(_metrics(out.masked))
        result.whole = _metrics(out.whole)
        size = out.width * out.height
        result.maps = {name: np.frombuffer(ffi.buffer(getattr(out, name), 4 * size), np.float32).reshape(out.height, out.width).copy()
                       for name in ("relative", "ssim", "flip", "flip_hdr") if getattr(out, name)}
        lib.pell_comparison_finish(context.c, out)
    finally:
        context.close()
    return result
