# SPDX-License-Identifier: MIT
"""Profiles in forms for convolution in a renderer (pellucid/kernel.h): weights include the profile's total."""
from __future__ import annotations

from typing import NamedTuple, Sequence

import numpy as np

from ._base import bounded, check, ffi, lib, number, pointer, whole, wrong
from .optics import Gaussians, Profile, _three_profiles


class Separable(NamedTuple):
    """A separable kernel: Sum_k sign[k, c] a_kc(x) a_kc(y)."""
    offset: np.ndarray  # (taps,), mm
    weight: np.ndarray  # (rank, taps, 3)
    sign: np.ndarray  # (rank, 3)
    total: np.ndarray  # (3,)
    outside: np.ndarray  # (3,): share of the light outside the square
    error: np.ndarray  # (3,): of the rank, as a fraction
    extent: float  # mm


def _odd(taps: int) -> int:
    count = whole(taps, "taps", 3, lib.PELL_KERNEL_TAPS_MAX)
    if count % 2 == 0:
        raise wrong("taps", f"is {taps}, must be odd, 3 to {lib.PELL_KERNEL_TAPS_MAX}")
    return count


def _positive(value: float, what: str) -> float:
    found = number(value, what)
    if not 0 < found < float("inf"):
        raise wrong(what, f"is {value!r:.60}, must be above 0 and finite")
    return found


def gaussian_taps(variance: float, taps: int = 7) -> tuple[np.ndarray, np.ndarray]:
    """Offsets in mm and weights, (taps,) each, of a one-dimensional Gaussian of a variance in mm^2; taps odd, 3 to 65."""
    count = _odd(taps)
    offset, weight = np.empty(count), np.empty(count)
    check(lib.pell_kernel_gaussian_taps(_positive(variance, "variance"), count, pointer(offset), pointer(weight)),
          f"is {variance!r:.60}, no variance of a kernel", "variance")
    return offset, weight


def chain(gaussians: Gaussians) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Blurs after one another: steps (n,) in mm^2, blends (n, 3), total (3,) (d'Eon et al. 2007, section 5.4)."""
    if not isinstance(gaussians, Gaussians):
        raise wrong("gaussians", f"is {gaussians!r:.60}, must be Gaussians")
    out = ffi.new("struct pell_kernel_chain *")
    check(lib.pell_kernel_chain_make(gaussians.c, out),
          "has falling variances or negative weights: variances must rise, weights be 0 or more", "gaussians")
    n = out.count
    return np.array(list(out.step_mm2)[:n]), np.array([list(b) for b in out.blend][:n]), np.array(list(out.total))


def separable(profiles: Sequence[Profile], *, taps: int = 25, rank: int = 1, extent: float = 0.0, spread: float = 2.0) -> Separable:
    """The best separable kernel of its rank (1 to 3) for three profiles (Jimenez et al. 2015, section 4). extent in mm: half its width, 0:
    98 % of the light inside; spread [1, 4]: how dense the taps are near the centre."""
    out = ffi.new("struct pell_separable *")
    params = ffi.new("struct pell_separable_params *", {
        "taps": _odd(taps), "rank": whole(rank, "rank", 1, lib.PELL_KERNEL_RANK_MAX), "extent_mm": bounded(extent, "extent", 0, 1e30),
        "spread": bounded(spread, "spread", 1, 4)})
    check(lib.pell_separable_make(_three_profiles(profiles), params, out),
          "has no light in a channel, or none inside the extent", "profiles")
    weight = np.array([[list(w) for w in k][:out.taps] for k in out.weight][:out.rank])
    return Separable(np.array(list(out.offset_mm)[:out.taps]), weight, np.array([list(s) for s in out.sign][:out.rank]),
                     np.array(list(out.total)), np.array(list(out.outside)), np.array(list(out.error)), out.extent_mm)


def _profile(profile: Profile):
    if not isinstance(profile, Profile):
        raise wrong("profile", f"is {profile!r:.60}, must be a Profile")
    return profile.c


def _table(function, texels, *args) -> np.ndarray:
    out = np.empty(whole(texels, "texels", 1, 2 ** 31 - 1), dtype=np.float32)
    check(function(*args, pointer(out, "float *"), out.size), "gives no table: it has no light", "profile")
    return out


def table_value(profile: Profile, r_max: float, texels: int) -> np.ndarray:
    """(texels,) float32 means of R over rings of equal width out to r_max mm, 1/mm^2."""
    return _table(lib.pell_kernel_table_value, texels, _profile(profile), _positive(r_max, "r_max"))


def table_ring(profile: Profile, r_max: float, texels: int) -> np.ndarray:
    """(texels,) float32: the light in each of these rings."""
    return _table(lib.pell_kernel_table_ring, texels, _profile(profile), _positive(r_max, "r_max"))


def table_radius(profile: Profile, texels: int) -> np.ndarray:
    """(texels,) float32 radii in mm with equal light between them."""
    return _table(lib.pell_kernel_table_radius, texels, _profile(profile))


def table_sphere(profile: Profile, curvature_max: float, width: int, height: int) -> np.ndarray:
    """(height, width) float32: pre-integrated scattering (Penner 2011); columns cos theta from -1 to 1, rows curvature up to
    curvature_max in 1/mm."""
    out = np.empty((whole(height, "height", 1, 2 ** 16), whole(width, "width", 1, 2 ** 16)), dtype=np.float32)
    check(lib.pell_kernel_table_sphere(_profile(profile), _positive(curvature_max, "curvature_max"), pointer(out, "float *"), width, height),
          "gives no table: it has no light", "profile")
    return out
