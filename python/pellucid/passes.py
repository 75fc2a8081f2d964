# SPDX-License-Identifier: MIT
"""A method on the caller's own planes, without copies (pellucid/method.h)."""
from __future__ import annotations

from typing import Any, Optional, Sequence

import numpy as np

from ._base import (Closing, Context, Turns, choose, closed, encoded, ffi, knob_argument, knob_rows, knob_text, lib, number, pointer, text,
                    whole, wrong)
from .optics import Gaussians, Medium

_FORMATS = {lib.PELL_PLANE_F32: (np.float32, "float *"), lib.PELL_PLANE_U16: (np.uint16, "uint16_t *"),
            lib.PELL_PLANE_U32: (np.uint32, "uint32_t *")}


class Pass(Closing):
    """Everything that a method keeps between frames of one shape.

    method: a name of methods(); shape: (height, width) px; media: a Medium or Gaussians for each material number from 1 on;
    px_per_mm: orthographic scale, or, with perspective=True, the pixels per mm at a depth of 1 mm; stride: floats from row to row of every
    plane (default width). threads 0: one per core. knobs: the method's, as Renderer.render takes them. Calls of several threads wait for each
    other.
    """

    def __init__(self, method: str, shape: tuple[int, int], media: Sequence[Any], px_per_mm: float, *, perspective: bool = False,
                 stride: Optional[int] = None, object_height: float = 0.0, threads: int = 0, **knobs: Any):
        self._turns = Turns("Pass")
        self._pass, self._device, self._knobs = ffi.new("struct pell_pass **"), ffi.new("struct pell_device **"), ffi.new("void **")
        context = self.context = Context(owner="Pass")
        found = lib.pell_method_find(context.c, b"method", encoded(method, "method"))
        context.check(lib.PELL_OK if found else lib.PELL_ERR_INVALID)
        known = [text(k.name) for k in knob_rows(found.knobs)]
        words = []
        for name, value in knobs.items():
            knob, said = name.rstrip("_").replace("_", "-"), knob_text(value, name)
            if knob not in known:
                choose("knob", name, map(knob_argument, known), f"method {method}")
            if not said or any(c.isspace() for c in said):
                raise wrong(name, f"is {value!r:.60}, must have no spaces" if said else "is empty")
            words.append(f"{knob}={said}")
        context.check(lib.pell_method_knobs_create(context.c, found, encoded(" ".join(words), "knobs"), self._knobs))
        params = ffi.new("struct pell_device_params *", {"threads": whole(threads, "threads", 0, 256)})
        context.check(lib.pell_device_create(context.c, params, self._device))
        self._turns.threads = lib.pell_device_threads(self._device[0])
        if isinstance(media, (Medium, Gaussians)) or not hasattr(media, "__len__"):
            raise wrong("media", f"is {media!r:.60}, must be a list of Medium or Gaussians objects")
        if len(media) == 0:
            raise wrong("media", "is empty, must have a medium for each material number from 1 on")
        self._name = ffi.new("char[]", b"pass")
        self._materials = ffi.new("struct pell_frame_material[]", len(media))
        for target, m in zip(self._materials, media):
            target.name = self._name
            if isinstance(m, Medium):
                target.medium = m.c[0]
            elif isinstance(m, Gaussians):
                target.gaussians = m.c[0]
                target.medium = Medium(0.01, 1.0).c[0]
            else:
                raise wrong("media", f"has {m!r:.60}, must have Medium or Gaussians objects")
        if not hasattr(shape, "__len__") or len(shape) != 2:
            raise wrong("shape", f"is {shape!r:.60}, must be (height, width)")
        height, width = (whole(n, "shape", 1, 2 ** 31 - 1) for n in shape)
        self.shape, self.stride = (height, width), width if stride is None else whole(stride, "stride", width, 2 ** 31 - 1)
        self._shape = ffi.new("struct pell_frame_shape *", {
            "width": width, "height": height, "stride": self.stride, "orthographic": not perspective, "focal_px": number(px_per_mm, "px_per_mm"),
            "object_height": number(object_height, "object_height"), "materials": self._materials, "num_materials": len(media)})
        context.call(lib.pell_pass_create, self._device[0], found, self._knobs[0], self._shape, self._pass)

    def _plane(self, info, array, index: int, writable: bool):
        dtype, kind = _FORMATS[info.format]
        name = text(info.name) + (f"[{index}]" if info.components > 1 else "")
        if isinstance(array, np.ma.MaskedArray):
            raise wrong(name, "is a masked array, must be a plain one: planes are not copied")
        if not isinstance(array, np.ndarray) or array.dtype != dtype or array.shape != self.shape:
            seen = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            raise wrong(name, f"is {seen}, must be an array of {np.dtype(dtype)} of shape {self.shape}: planes are not copied")
        size = array.dtype.itemsize
        if array.strides != (self.stride * size, size) or (writable and not array.flags.writeable):
            raise wrong(name, f"has the strides {array.strides}, must have {(self.stride * size, size)}, and be writable for output")
        if info.name == lib.pell_plane_at(lib.PELL_PLANE_MATERIAL).name and array.size and array.max() > self._shape.num_materials:
            raise wrong(name, f"has {array.max()}, must be in [0, {self._shape.num_materials}]: 0 or 1 + an index into media")
        return pointer(array, kind)

    def render(self, out: dict[str, Any], **planes: Any) -> None:
        """Runs the method on the caller's memory. planes: material uint16 (0: not translucent; i + 1: media[i]), depth float32 mm, and
        what the method needs: irradiance, shaded, normal, position (three planes each), strength. out: {"light": three float32 planes}, and
        "single", "surface" for methods that have them. A plane is an array (height, width); three are a sequence or an array (3, height,
        width)."""
        with self._turns:
            if not self._pass[0]:
                raise closed("Pass")
            self._render(out, planes)

    def _render(self, out, planes) -> None:
        frame = ffi.new("struct pell_frame *", {"shape": self._shape[0], "rect": {"x1": self.shape[1], "y1": self.shape[0]}})
        light = ffi.new("struct pell_frame_light *")
        infos = {text(i.name): i for i in (lib.pell_plane_at(p) for p in range(lib.PELL_PLANES))}
        for target, given, of_light in ((frame, planes, False), (light, out, True)):
            for name, value in given.items():
                info = infos.get(name)
                if info is None or info.of_light != of_light:
                    choose("plane", name, [n for n, i in infos.items() if i.of_light == of_light], "out" if of_light else "")
                if info.components == 1:
                    setattr(target, name, self._plane(info, value, 0, of_light))
                    continue
                if not hasattr(value, "__len__"):
                    raise wrong(name, f"is {value!r:.60}, must be {info.components} planes")
                if len(value) != info.components:
                    raise wrong(name, f"has {len(value)} planes, must have {info.components}")
                for c in range(info.components):
                    getattr(target, name)[c] = self._plane(info, value[c], c, of_light)
        self.context.call(lib.pell_pass_render, self._pass[0], frame, light)

    def close(self) -> None:
        """Frees what the pass keeps, after a call that another thread is in."""
        if self._turns.forked:
            self._pass[0] = ffi.NULL
            return
        with self._turns:
            if not self.context._out[0]:
                return
            lib.pell_pass_destroy(self._pass)
            lib.pell_method_knobs_destroy(self.context.c, self._knobs)
            lib.pell_device_destroy(self._device)
            self.context.free()
