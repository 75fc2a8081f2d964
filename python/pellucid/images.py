# SPDX-License-Identifier: MIT
"""Image files (pellucid/image.h)."""
from __future__ import annotations

import os
from typing import Union

import numpy as np

from ._base import Context, encoded, ffi, lib, numbers, path_bytes, pointer, text, wrong

Path = Union[str, os.PathLike]


def read_image(path: Path, *, data: bool = False) -> np.ndarray:
    """(height, width, channels) float32, linear: of PNG, JPEG, HDR, EXR or PFM. data: the values are no colours (normals, lengths)."""
    context, image = Context(), ffi.new("struct pell_image *")
    try:
        context.call(lib.pell_image_read, context.c, path_bytes(path), lib.PELL_ROLE_DATA if data else lib.PELL_ROLE_COLOR, image)
        context.call(lib.pell_image_to_float, context.c, image)
        shape = (image.height, image.width, image.channels)
        return np.frombuffer(ffi.buffer(image.pixels, 4 * shape[0] * shape[1] * shape[2]), np.float32).reshape(shape).copy()
    finally:
        lib.pell_image_finish(context.c, image)
        context.close()


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """All channels of an OpenEXR file by name: (height, width) float32, as stored."""
    context, layers = Context(), ffi.new("struct pell_layers *")
    try:
        context.call(lib.pell_exr_read, context.c, path_bytes(path), layers)
        shape = (layers.height, layers.width)
        return {text(layers.layers[i].name): np.frombuffer(ffi.buffer(layers.layers[i].data, 4 * shape[0] * shape[1]),
                                                           np.float32).reshape(shape).copy() for i in range(layers.count)}
    finally:
        lib.pell_layers_finish(context.c, layers)
        context.close()


def write_layers(path: Path, channels: dict[str, np.ndarray], *, full_float: bool = True) -> None:
    """Writes channels by name as an OpenEXR file: (height, width) arrays, 32-bit or half floats."""
    planes = {k: v if isinstance(v, np.ndarray) and v.dtype == np.float32 else numbers(v, f'channels["{k}"]', np.float32) for k, v in channels.items()}
    planes = {k: v if v.ndim == 2 and v.strides[1] == 4 else np.ascontiguousarray(v) for k, v in planes.items()}
    shapes = {p.shape for p in planes.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise wrong("channels", "is empty, must have an array (height, width) for each name" if not planes else
                    f"has the shapes {sorted(shapes)}, all must have one (height, width)")
    height, width = next(iter(shapes))
    names = [ffi.new("char[]", encoded(k, "channels")) for k in planes]
    rows = ffi.new("struct pell_channel[]", [
        {"name": n, "data": pointer(p, "float *"), "stride": p.strides[0] // 4, "full_float": full_float}
        for n, p in zip(names, planes.values())])
    params = ffi.new("struct pell_write_params *", {"width": width, "height": height, "channels": rows, "num_channels": len(names)})
    context = Context()
    try:
        context.call(lib.pell_image_write, context.c, path_bytes(path), ffi.NULL, params)
    finally:
        context.close()


def write_image(path: Path, image: np.ndarray) -> None:
    """Writes png (linear display values in [0, 1], sRGB-encoded here), exr, hdr or pfm by the extension; (height, width[, 1, 3 or 4])."""
    array = numbers(image, "image", np.float32)
    array = array[:, :, None] if array.ndim == 2 else array
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise wrong("image", f"has the shape {array.shape}, must have (height, width) or (height, width, 1, 3 or 4)")
    names = "Y" if array.shape[2] == 1 else "RGBA"
    write_layers(path, {names[c]: array[:, :, c] for c in range(array.shape[2])})
