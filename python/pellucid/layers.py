# SPDX-License-Identifier: MIT
"""Slabs and stacks of slabs (pellucid/layers.h), and skin made of its composition (pellucid/skin.h)."""
from __future__ import annotations

import math
from typing import Any, NamedTuple, Sequence

import numpy as np

from ._base import Value, channel_number, check, choose, doubles, fault_error, ffi, lib, number, pointer, set_fields, text, wrong
from .optics import Medium, Profile, _from_zero, _keep_nan

PARTS = ("R+", "T+", "R-", "T-")


class Layer(NamedTuple):
    """A medium (its eta is the layer's own index of refraction) and its thickness in mm; infinite: a last half-space."""
    medium: Medium
    thickness: float = math.inf


class Stack(Value):
    """Layers from top to bottom, 1 to 32. Parts of its response: R+, T+ for light from above, R-, T- from below.

    eta_above, eta_below: indices outside. roughness: of every boundary (one number, or one more than there are layers), [0, 1].
    """

    _struct = "struct pell_stack"

    def __init__(self, layers: Sequence[Layer], *, eta_above: float = 1.0, eta_below: float = 1.0, roughness: Any = 0.0):
        if isinstance(layers, (str, bytes, Layer)) or not hasattr(layers, "__len__"):
            raise wrong("layers", f"is {layers!r:.60}, must be a list of Layers")
        if not 1 <= len(layers) <= lib.PELL_LAYERS_MAX:
            raise wrong("layers", f"has {len(layers)}, must have 1 to {lib.PELL_LAYERS_MAX}")
        self.c = ffi.new("struct pell_stack *", {"count": len(layers), "eta_above": number(eta_above, "eta_above"),
                                                 "eta_below": number(eta_below, "eta_below")})
        for i, layer in enumerate(layers):
            if not isinstance(layer, (tuple, list)) or len(layer) != 2 or not isinstance(layer[0], Medium):
                raise wrong(f"layers[{i}]", f"is {layer!r:.60}, must be a Layer: a Medium and its thickness in mm")
            out, medium, thickness = self.c.layer[i], layer[0], number(layer[1], f"layers[{i}].thickness")
            out.sigma_a, out.sigma_s_reduced, out.g = list(medium.c.sigma_a), list(medium.c.sigma_s_reduced), list(medium.c.g)
            out.eta, out.thickness = medium.eta, thickness
        rough = doubles(roughness, "roughness")
        if rough.shape not in ((), (1,), (len(layers) + 1,)):
            raise wrong("roughness", f"has the shape {rough.shape}, must be one number or {len(layers) + 1}: one for each boundary")
        for i, value in enumerate(np.broadcast_to(rough, (len(layers) + 1,))):
            self.c.roughness[i] = value
        self._check()

    @classmethod
    def _from_layers(cls, layers) -> "Stack":
        self = cls.__new__(cls)
        self.c = ffi.new("struct pell_stack *")
        lib.pell_material_stack(layers, self.c)
        self._check()
        return self

    def _check(self):
        fault = ffi.new("struct pell_stack_fault *")
        if not lib.pell_stack_valid(self.c, fault):
            raise wrong(f"{text(fault.field)} of layer {fault.layer}, channel {fault.channel},",
                        f"is {fault.value:g}, must be in [{fault.min:g}, {fault.max:g}]")

    def __len__(self) -> int:
        return self.c.count

    def _parts(self) -> tuple:
        c, n = self.c, self.c.count
        rows = tuple((tuple(x.sigma_a), tuple(x.sigma_s_reduced), tuple(x.g), x.eta, x.thickness) for x in c.layer[0:n])
        return rows, c.eta_above, c.eta_below, c.fresnel, tuple(c.roughness)[:n + 1], tuple(tuple(a) for a in c.A[0:n])

    def __repr__(self) -> str:
        thickness = ", ".join(f"{x.thickness:g}" for x in self.c.layer[0:self.c.count])
        return f"<Stack of {self.c.count}, thickness {thickness} mm>"

    def totals(self) -> np.ndarray:
        """(4, 3): the total of each part in each channel."""
        out = np.empty((3, 4))
        for c in range(3):
            check(lib.pell_stack_totals(self.c, c, pointer(out[c]), ffi.NULL))
        return out.T.copy()

    def transforms(self, s: float, channel: int = 0) -> np.ndarray:
        """(4,): Hankel transforms of the parts at a frequency in rad/mm."""
        out = np.empty(4)
        check(lib.pell_stack_transforms(self.c, channel_number(channel), number(s, "s"), pointer(out)),
              f"is {s!r:.60}, must be a frequency of 0 or more, in rad/mm", "s")
        return out

    def __call__(self, r: Any, channel: int = 0) -> np.ndarray:
        """(4,) + r's shape: the parts' profiles at radii in mm by the Hankel solver, 1/mm^2."""
        radii = doubles(r, "r")
        _from_zero(radii, "r")
        known, radii = radii, np.nan_to_num(radii, nan=0.0, posinf=np.inf)
        out = np.empty((4,) + radii.shape)
        rows = ffi.new("double *[4]", [ffi.cast("double *", out.ctypes.data + k * radii.size * 8) for k in range(4)])
        check(lib.pell_stack_hankel(self.c, channel_number(channel), pointer(radii), radii.size, rows, ffi.NULL),
              "has a negative or infinite radius, must have radii of 0 or more, in mm", "r")
        return _keep_nan(known, out)

    def profile(self, part: str = "R+", channel: int = 0) -> Profile:
        """A part of a channel as a Profile."""
        out = Profile._empty()
        check(lib.pell_stack_profile(self.c, channel_number(channel), choose("part", part, PARTS), out.c, ffi.NULL),
              f"the part {part} has no profile")
        return out

    def profiles(self, part: str = "R+") -> tuple[Profile, Profile, Profile]:
        """The three channels of a part."""
        return self.profile(part, 0), self.profile(part, 1), self.profile(part, 2)


def _skin(composition: dict):
    skin = ffi.new("struct pell_skin *", lib.pell_skin_default())
    set_fields(skin, composition, "skin")
    fault = ffi.new("struct pell_medium_fault *")
    if not lib.pell_skin_valid(skin, fault):
        raise fault_error(fault)
    return skin


def skin_color(**composition: float) -> np.ndarray:
    """(3,): the colour of skin of a composition (melanin, melanin_blend, haemoglobin, oxygenation, epidermis_mm, eta; pell_skin_default)
    without surface reflection (Donner and Jensen 2006)."""
    out = np.empty(3)
    check(lib.pell_skin_color(_skin(composition), pointer(out)))
    return out


def skin_layers(**composition: float) -> Stack:
    """Epidermis on dermis with coefficients per channel, of that colour."""
    out = ffi.new("struct pell_material_layers *")
    check(lib.pell_skin_layers(_skin(composition), out))
    return Stack._from_layers(out)
