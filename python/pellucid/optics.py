# SPDX-License-Identifier: MIT
"""From coefficients to profiles, fits and samples, over arrays."""
from __future__ import annotations

from typing import Any, Optional, Sequence, Union

import numpy as np

from ._base import (Value, bounded, called, channel_number, check, choose, doubles, encoded, enum_names, failure, fault_error, ffi, lib,
                    number, pointer, text, three, whole, wrong)

ArrayLike = Any
CHANNELS = ("r", "g", "b")


def models() -> dict[str, str]:
    """Names of the profile models, with their sources."""
    rows = [lib.pell_profile_model_at(i) for i in range(lib.pell_profile_model_count())]
    return {text(r.name): text(r.cite) for r in rows}


def _model(name: str) -> int:
    return choose("model", name, enum_names(lib.pell_profile_model_count(), lib.pell_profile_model_at))


def _params(roughness: float, A: float, without_single: bool):
    return ffi.new("struct pell_profile_params *", {"roughness": bounded(roughness, "roughness", 0, 1), "A": number(A, "A"),
                                                    "without_single": bool(without_single)})


def _least(values: np.ndarray) -> float:
    """NaN if one is; 0 of none."""
    return float(values) if values.ndim == 0 else values.min() if values.size else 0.0


def _from_zero(values: np.ndarray, what: str) -> None:
    """InvalidError if a number is below 0; NaN may be among them."""
    if _least(values) >= 0:
        return
    if (values < 0).any():
        raise wrong(what, f"has {values[values < 0][0]:g}, must be 0 or more" if values.ndim else f"is {values[()]:g}, must be 0 or more")


def _keep_nan(values: np.ndarray, out: np.ndarray) -> np.ndarray:
    """The function of NaN is NaN: `out` has the shape of something + that of `values`."""
    if np.isnan(_least(values)):
        out[..., np.isnan(values)] = np.nan
    return out


class Medium(Value):
    """A homogeneous medium behind a smooth boundary (pellucid/medium.h).

    sigma_a, sigma_s_reduced: one number or (R, G, B), 1/mm; or sigma_s, which is multiplied by 1 - g. g: mean cosine. eta: index of
    refraction inside over outside, 0.25 to 4.
    """

    _struct = "struct pell_medium"

    def __init__(self, sigma_a: ArrayLike, sigma_s_reduced: ArrayLike = None, *, sigma_s: ArrayLike = None, g: ArrayLike = 0.0,
                 eta: float = 1.3):
        if (sigma_s_reduced is None) == (sigma_s is None):
            raise wrong("sigma_s_reduced", "is missing: give it, or sigma_s") if sigma_s is None else \
                wrong("sigma_s", "is given beside sigma_s_reduced, must be left out")
        cosine = three(g, "g")
        reduced = three(sigma_s_reduced, "sigma_s_reduced") if sigma_s is None else three(sigma_s, "sigma_s") * (1.0 - cosine)
        self.c = ffi.new("struct pell_medium *", {"sigma_a": three(sigma_a, "sigma_a").tolist(), "sigma_s_reduced": reduced.tolist(),
                                                  "g": cosine.tolist(), "eta": number(eta, "eta")})
        fault = ffi.new("struct pell_medium_fault *")
        if not lib.pell_medium_valid(self.c, fault):
            raise fault_error(fault)

    @classmethod
    def _from(cls, medium) -> "Medium":
        self = cls.__new__(cls)
        self.c = ffi.new("struct pell_medium *", medium)
        return self

    @classmethod
    def material(cls, name: str) -> "Medium":
        """A built-in material that has coefficients: materials()."""
        entry = _entry(name)
        if entry.kind != lib.PELL_MATERIAL_MEDIUM:
            raise wrong("name", f'is "{name}", a material without the coefficients of one medium, must have them',
                        "pellucid.material gives what is known of it")
        return cls._from(entry.medium)

    @classmethod
    def from_color(cls, color: ArrayLike, radius: ArrayLike, *, kind: str = "mean-free-path", g: ArrayLike = 0.0, eta: float = 1.3,
                   model: str = "dipole") -> "Medium":
        """The medium whose profile under `model` has the total `color` ([0, 1]) and a length `radius` (mm) of a `kind`: mean-free-path,
        diffuse, extinction, burley, cycles, cycles-skin (pellucid/inversion.h has their sources)."""
        kinds = enum_names(lib.pell_radius_count(), lib.pell_scatter_radius_at)
        look = ffi.new("struct pell_color_and_radius *", {
            "color": three(color, "color").tolist(), "radius": three(radius, "radius").tolist(), "g": three(g, "g").tolist(),
            "eta": number(eta, "eta"), "kind": choose("kind", kind, kinds)})
        out, fault = ffi.new("struct pell_medium *"), ffi.new("struct pell_medium_fault *")
        code = lib.pell_medium_from_color_and_radius(look, _model(model), ffi.NULL, out, fault)
        if code != lib.PELL_OK:
            raise fault_error(fault, code)
        return cls._from(out[0])

    sigma_a = property(lambda self: np.array(list(self.c.sigma_a)), doc="(3,), 1/mm")
    sigma_s_reduced = property(lambda self: np.array(list(self.c.sigma_s_reduced)), doc="(3,), 1/mm")
    g = property(lambda self: np.array(list(self.c.g)), doc="(3,)")
    eta = property(lambda self: self.c.eta)

    @property
    def mean_free_path(self) -> np.ndarray:
        """(3,), mm: 1/(sigma_a + sigma_s_reduced)."""
        return np.array([lib.pell_mean_free_path(self.c, c) for c in range(3)])

    @property
    def diffuse_mean_free_path(self) -> np.ndarray:
        """(3,), mm: 1/sigma_tr; infinite without absorption."""
        return np.array([lib.pell_diffuse_mean_free_path(self.c, c) for c in range(3)])

    def _parts(self) -> tuple:
        return tuple(self.c.sigma_a), tuple(self.c.sigma_s_reduced), tuple(self.c.g), self.c.eta

    def __repr__(self) -> str:
        return f"Medium({self.sigma_a.tolist()}, {self.sigma_s_reduced.tolist()}, g={self.g.tolist()}, eta={self.eta})"


class Profile(Value):
    """R(r) of one channel: the share of the light, per mm^2, that leaves at a distance r from where it entered (pellucid/profile.h).

    medium: a Medium; channel: 0, 1, 2; model: a name of models(). roughness of the boundary, A and without_single: for the models that
    have them.
    """

    _struct = "struct pell_profile"

    def __init__(self, medium: Medium, channel: int = 0, model: str = "dipole", *, roughness: float = 0.0, A: float = 0.0,
                 without_single: bool = False):
        self.c = ffi.new("struct pell_profile *")
        if not isinstance(medium, Medium):
            raise wrong("medium", f"is {medium!r:.60}, must be a Medium")
        check(lib.pell_profile_make(_model(model), medium.c, channel_number(channel), _params(roughness, A, without_single), self.c),
              f"the model {model} does not take roughness {roughness!r:.20}, A {A!r:.20} or without_single {without_single!r:.20}, or has "
              "no profile of this medium")

    @classmethod
    def _empty(cls) -> "Profile":
        self = cls.__new__(cls)
        self.c = ffi.new("struct pell_profile *")
        return self

    @classmethod
    def table(cls, r: ArrayLike, R: ArrayLike) -> "Profile":
        """A table of your own: (n,) rising radii in mm and (n,) values in 1/mm^2, n >= 2; its light, Int 2 pi r R dr, is at most 1."""
        radii, values = doubles(r, "r"), doubles(R, "R")
        if radii.ndim != 1 or radii.shape != values.shape:
            raise wrong("r", f"has the shape {radii.shape} and R {values.shape}, both must have one (n,)")
        self, fault = cls._empty(), ffi.new("struct pell_profile_fault *")
        code = lib.pell_profile_from_table(pointer(radii), pointer(values), radii.size, self.c, fault)
        if code != lib.PELL_OK:
            raise failure(code, f"is {fault.value:g} in row {fault.row}, must be in [{fault.min:g}, {fault.max:g}]", text(fault.field), "",
                          called())
        return self

    def _parts(self) -> tuple:
        c, n = self.c, self.c.count
        return c.kind, c.total, tuple(c.parameter), tuple(c.r)[:n], tuple(c.value)[:n], tuple(c.slope)[:n], tuple(c.inside)[:n]

    def __repr__(self) -> str:
        return f"<Profile, total {self.total:.6g}>"

    @property
    def total(self) -> float:
        """The diffuse reflectance, Int 2 pi r R dr."""
        return lib.pell_profile_total(self.c)

    def _map(self, what: int, x: ArrayLike, name: str = "r"):
        values = doubles(x, name)
        _from_zero(values, name)
        out = np.empty_like(values)
        lib.pellpy_profile_map(self.c, what, pointer(values), pointer(out), values.size)
        return _keep_nan(values, out)[()]

    def __call__(self, r: ArrayLike):
        """R at radii r >= 0 in mm, any shape; 1/mm^2."""
        return self._map(0, r)

    def cdf(self, r: ArrayLike):
        """Share of the total inside r."""
        return self._map(1, r)

    def pdf(self, r: ArrayLike):
        """Density per mm^2 of the radii that sample() gives: R/total."""
        return self._map(2, r)

    def sample(self, xi: ArrayLike):
        """Radii in mm with the shares xi in [0, 1) of the light inside."""
        return self._map(3, xi, "xi")

    def transform(self, s: ArrayLike):
        """Two-dimensional Fourier (Hankel) transform at frequencies s in rad/mm; the total at 0."""
        return self._map(4, s, "s")


def profiles(medium: Medium, model: str = "dipole", **params) -> tuple[Profile, Profile, Profile]:
    """The profiles of R, G and B."""
    return Profile(medium, 0, model, **params), Profile(medium, 1, model, **params), Profile(medium, 2, model, **params)


def _broadcast(**values: ArrayLike) -> list[np.ndarray]:
    """Arrays of doubles of one shape, by the names of arguments."""
    arrays = [doubles(v, name) for name, v in values.items()]
    try:
        return [np.asarray(v, dtype=np.float64, order="C") for v in np.broadcast_arrays(*arrays)]
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in zip(values, arrays))
        raise wrong("", f"the shapes of the arguments do not go together, must broadcast: {shapes}") from None


def _media(sigma_a, sigma_s_reduced, g, eta):
    a, s, cosine, index = _broadcast(sigma_a=sigma_a, sigma_s_reduced=sigma_s_reduced, g=g, eta=eta)
    bad = ~((a >= 0) & (a <= lib.PELL_SIGMA_MAX) & (s >= 0) & (s <= lib.PELL_SIGMA_MAX) & (a + s >= lib.PELL_SIGMA_T_MIN) &
            (np.abs(cosine) <= lib.PELL_G_MAX) & (index >= lib.PELL_ETA_MIN) & (index <= lib.PELL_ETA_MAX))
    if bad.any():
        at = np.unravel_index(int(np.argmax(bad)), bad.shape)
        raise wrong(f"medium {[int(i) for i in at]}",
                    f"has sigma_a {a[at]:g}, sigma_s_reduced {s[at]:g}, g {cosine[at]:g}, eta {index[at]:g}, must have the coefficients in "
                    f"[0, {lib.PELL_SIGMA_MAX:g}] and their sum at least {lib.PELL_SIGMA_T_MIN:g}, g in [-{lib.PELL_G_MAX:g}, "
                    f"{lib.PELL_G_MAX:g}], eta in [{lib.PELL_ETA_MIN:g}, {lib.PELL_ETA_MAX:g}]")
    return a, s, cosine, index


def _profile_map(model, sigma_a, sigma_s_reduced, g, eta, r, total, params):
    for name in params:
        choose("parameter", name, ("roughness", "A", "without_single"))
    a, s, cosine, index = _media(sigma_a, sigma_s_reduced, g, eta)
    radii = doubles(r, "r")
    _from_zero(radii, "r")
    out = np.empty(a.shape + radii.shape)
    totals = np.empty(a.shape) if total else None
    result = ffi.new("int *")
    media = (pointer(a), pointer(s))
    to = pointer(totals) if total else ffi.NULL
    if model == "dipole" and not params:
        lib.pellpy_dipoles(*media, pointer(index), a.size, 0, pointer(radii), radii.size, pointer(out), to)
        return _keep_nan(radii, out), totals
    at = lib.pellpy_profiles(_model(model), *media, pointer(cosine), pointer(index), a.size,
                             _params(params.get("roughness", 0.0), params.get("A", 0.0), params.get("without_single", False)),
                             pointer(radii), radii.size, pointer(out), to, result)
    check(result[0], f"is none that the model {model} takes with these parameters", f"medium {at}")
    return _keep_nan(radii, out), totals


def profile_at(r: ArrayLike, sigma_a: ArrayLike, sigma_s_reduced: ArrayLike, *, g: ArrayLike = 0.0, eta: ArrayLike = 1.3,
               model: str = "dipole", **params) -> np.ndarray:
    """R(r) of many media at many radii, in one call: coefficients of any shapes that broadcast (1/mm), r of any shape (mm) -> the media's
    shape + r's shape, 1/mm^2. `params` as in Profile."""
    return _profile_map(model, sigma_a, sigma_s_reduced, g, eta, r, False, params)[0]


def total_reflectance(sigma_a: ArrayLike, sigma_s_reduced: ArrayLike, *, g: ArrayLike = 0.0, eta: ArrayLike = 1.3,
                      model: str = "dipole", **params) -> np.ndarray:
    """The diffuse reflectance of many media, in one call; the shape that the coefficients broadcast to."""
    return _profile_map(model, sigma_a, sigma_s_reduced, g, eta, np.empty(0), True, params)[1][()]


def sample_radii(xi: ArrayLike, sigma_a: ArrayLike, sigma_s_reduced: ArrayLike, *, eta: ArrayLike = 1.3) -> np.ndarray:
    """Radii in mm, distributed as 2 pi r R(r), of the dipoles of many media by random numbers xi in [0, 1) (Mertens et al. 2003, section
    4); the media's shape + xi's shape."""
    a, s, _, index = _media(sigma_a, sigma_s_reduced, 0.0, eta)
    numbers = doubles(xi, "xi")
    _from_zero(numbers, "xi")
    out = np.empty(a.shape + numbers.shape)
    lib.pellpy_dipoles(pointer(a), pointer(s), pointer(index), a.size, 3, pointer(numbers), numbers.size, pointer(out), ffi.NULL)
    return _keep_nan(numbers, out)


class Gaussians(Value):
    """R_c(r) = Sum_i weight[i, c] exp(-r^2/(2 variance[i]))/(2 pi variance[i]): variance (n,) in mm^2, rising; weight (n, 3)."""

    _struct = "struct pell_gaussians"

    def __init__(self, variance: ArrayLike, weight: ArrayLike):
        v, w = doubles(variance, "variance"), doubles(weight, "weight")
        if w.ndim == 1:
            w = np.repeat(w[:, None], 3, axis=1)
        if v.ndim != 1 or w.shape != (v.size, 3) or not 1 <= v.size <= lib.PELL_GAUSSIANS_MAX:
            raise wrong("variance", f"has the shape {v.shape} and weight {w.shape}, must have (n,) and (n, 3), n from 1 to "
                        f"{lib.PELL_GAUSSIANS_MAX}")
        self.c = ffi.new("struct pell_gaussians *", {"count": v.size, "variance": v.tolist(), "weight": w.tolist()})
        self.error = np.full(3, np.nan)

    @classmethod
    def _from(cls, c, error=None) -> "Gaussians":
        self = cls.__new__(cls)
        self.c = c
        self.error = np.full(3, np.nan) if error is None else error
        return self

    def __len__(self) -> int:
        return self.c.count

    def _parts(self) -> tuple:
        return tuple(self.variance), tuple(self.weight.ravel())

    def __repr__(self) -> str:
        return f"Gaussians({self.variance.tolist()}, {self.weight.tolist()})"

    @property
    def variance(self) -> np.ndarray:
        """(n,), mm^2."""
        return np.array(list(self.c.variance)[:self.c.count])

    @property
    def weight(self) -> np.ndarray:
        """(n, 3)."""
        return np.array([list(row) for row in self.c.weight][:self.c.count]).reshape(-1, 3)

    @property
    def total(self) -> np.ndarray:
        """(3,): the diffuse reflectance."""
        return np.array([lib.pell_gaussians_total(self.c, c) for c in range(3)])

    def __call__(self, r: ArrayLike, channel: int = 0):
        """R_channel at radii in mm, any shape; 1/mm^2."""
        values = doubles(r, "r")
        _from_zero(values, "r")
        out = np.empty_like(values)
        lib.pellpy_gaussians(self.c, channel_number(channel), pointer(values), pointer(out), values.size)
        return _keep_nan(values, out)[()]

    def profile(self, channel: int = 0) -> Profile:
        """One channel as a Profile, in closed form."""
        out = Profile._empty()
        check(lib.pell_profile_from_gaussians(self.c, channel_number(channel), out.c),
              f"the weights of channel {channel} must be in [0, 1], and their sum, too; variances in [{lib.PELL_GAUSSIANS_VARIANCE_MIN:g}, "
              f"{lib.PELL_GAUSSIANS_VARIANCE_MAX:g}] mm^2")
        return out


def fit(what: Union[Medium, Profile, Sequence[Profile]], count: int = 4, *, free_energy: bool = False, r_max: float = 0.0) -> Gaussians:
    """The best sum of `count` (1 to 10) Gaussians: of a Medium's dipoles or three Profiles with shared variances, or of one Profile
    (weight[:, 0]). free_energy: totals may change. r_max in mm: where the error's integrals end; 0: nowhere. `.error` (3,) of the result
    is error (10) of d'Eon et al. 2007, as a fraction."""
    out, report = ffi.new("struct pell_gaussians *"), ffi.new("struct pell_fit_report *")
    if not number(r_max, "r_max") >= 0:
        raise wrong("r_max", f"is {r_max!r:.60}, must be a length in mm, or 0: no end")
    params = ffi.new("struct pell_fit_params *", {
        "count": whole(count, "count", 1, lib.PELL_GAUSSIANS_MAX), "free_energy": free_energy, "r_max_mm": r_max})
    if isinstance(what, Medium):
        code = lib.pell_fit_medium(what.c, params, out, report)
    elif isinstance(what, Profile):
        code = lib.pell_fit_profile(what.c, params, out, report)
    elif isinstance(what, (str, bytes)) or not hasattr(what, "__len__"):
        raise wrong("what", f"is {what!r:.60}, must be a Medium, a Profile or three Profiles")
    else:
        code = lib.pell_fit_profiles(_three_profiles(what), params, out, report)
    check(code, f"no fit of {count} Gaussians is found out to r_max {r_max:g} mm")
    return Gaussians._from(out, np.array(list(report.error)))


def _three_profiles(items: Sequence[Profile]):
    if not hasattr(items, "__len__"):
        raise wrong("profiles", f"is {items!r:.60}, must be three Profiles (R, G, B)")
    if len(items) != 3:
        raise wrong("profiles", f"has {len(items)}, must have three (R, G, B)")
    for p in items:
        if not isinstance(p, Profile):
            raise wrong("profiles", f"has {p!r:.60}, must have three Profiles (R, G, B)")
    array = ffi.new("struct pell_profile[3]")
    for i, p in enumerate(items):
        array[i] = p.c[0]
    return array


# --- Inversion --------------------------------------------------------------------------------------------------------------------

def albedo_from_color(color: ArrayLike, *, model: Optional[str] = None, map: Optional[str] = None, g: ArrayLike = 0.0,  # noqa: A002
                      eta: ArrayLike = 1.3) -> np.ndarray:
    """The reduced albedo of a half-space of this colour (total diffuse reflectance, [0, 1]), any shape: by numeric inversion of a profile
    model (to 1e-9; default dipole) or by a closed map: van-de-hulst, chiang, dipole."""
    if model and map:
        raise wrong("map", "is given beside model, must be left out, or model")
    if map:
        return _albedo_map(map, True, color, eta)
    c, cosine, index = _broadcast(color=color, g=g, eta=eta)
    out, fault, result = np.empty(c.shape), ffi.new("struct pell_medium_fault *"), ffi.new("int *")
    lib.pellpy_albedos(_model(model or "dipole"), ffi.NULL, pointer(c), pointer(cosine), pointer(index), c.size, pointer(out), fault, result)
    if result[0] != lib.PELL_OK:
        raise fault_error(fault, result[0])
    return out[()]


def color_from_albedo(albedo_reduced: ArrayLike, *, map: str = "van-de-hulst", eta: ArrayLike = 1.3) -> np.ndarray:  # noqa: A002
    """The colour of a half-space of this reduced albedo by a closed map; of a model: total_reflectance(1 - a, a)."""
    return _albedo_map(map, False, albedo_reduced, eta)


def _albedo_map(name, invert, x, eta):
    rows = enum_names(lib.pell_albedo_map_count(), lib.pell_albedo_map_at)
    values, index = _broadcast(**{"color" if invert else "albedo_reduced": x, "eta": eta})
    out = np.empty(values.shape)
    lib.pellpy_albedo_map(choose("map", name, rows), invert, pointer(values), pointer(index), values.size, pointer(out))
    return out[()]


def _pairs(what: int, **values: ArrayLike):
    x, y = _broadcast(**values)
    out = np.empty(x.shape)
    lib.pellpy_pairs(what, pointer(x), pointer(y), pointer(out), x.size)
    return out[()]


def fresnel(eta: ArrayLike, cos_i: ArrayLike):
    """Unpolarised reflectance of a smooth dielectric; eta = n_transmitted/n_incident, cos_i in [0, 1]."""
    return _pairs(0, eta=eta, cos_i=cos_i)


def fresnel_diffuse(eta: ArrayLike, roughness: ArrayLike = 0.0):
    """Fdr: reflectance averaged over a diffuse hemisphere; eta > 1: light from inside. roughness in [0, 1], GGX."""
    return _pairs(2 if np.any(roughness) else 1, eta=eta, roughness=roughness)


def half_space_albedo(albedo: ArrayLike, eta: ArrayLike = 1.3):
    """Share of light at normal incidence that leaves a half-space of isotropic scattering again, by exact transport; NaN out of range."""
    return _pairs(4, albedo=albedo, eta=eta)


class Phase(Value):
    """A phase function: kind henyey-greenstein, schlick (g is k), rayleigh, two-lobe (g two numbers, weight of the first).

    cos_theta is the cosine between the directions toward light and viewer: -1 is unscattered light (pellucid/phase.h)."""

    _struct = "struct pell_phase"
    KINDS = ("henyey-greenstein", "schlick", "rayleigh", "two-lobe")

    def __init__(self, kind: str = "henyey-greenstein", g: ArrayLike = 0.0, weight: float = 0.5):
        lobes = np.atleast_1d(doubles(g, "g")).tolist()
        if len(lobes) > 2:
            raise wrong("g", f"has {len(lobes)} numbers, must have one or two")
        self.c = ffi.new("struct pell_phase *", {"kind": choose("kind", kind, self.KINDS), "g": lobes, "weight": number(weight, "weight")})
        fault = ffi.new("struct pell_medium_fault *")
        if not lib.pell_phase_valid(self.c, fault):
            raise fault_error(fault)

    def _parts(self) -> tuple:
        return self.c.kind, tuple(self.c.g), self.c.weight

    def __repr__(self) -> str:
        return f'Phase("{self.KINDS[self.c.kind]}", {list(self.c.g)}, {self.c.weight})'

    def _map(self, what, x, name: str = "cos_theta"):
        values = doubles(x, name)
        out = np.empty_like(values)
        lib.pellpy_phase(self.c, what, pointer(values), pointer(out), values.size)
        return _keep_nan(values, out)[()]

    def __call__(self, cos_theta: ArrayLike):
        """1/sr; integrates to 1 over the sphere."""
        return self._map(0, cos_theta)

    def cdf(self, cos_theta: ArrayLike):
        """Share of the light that is scattered by a larger angle."""
        return self._map(1, cos_theta)

    def sample(self, xi: ArrayLike):
        """cos_theta with the share xi of the light at larger angles."""
        return self._map(2, xi, "xi")

    @property
    def mean_cosine(self) -> float:
        """What the literature calls g."""
        return lib.pell_phase_mean_cosine(self.c)


# --- Materials --------------------------------------------------------------------------------------------------------------------

def _entry(name: str):
    entry = lib.pell_material_find(encoded(str(name), "name"))
    if not entry:
        choose("material", name, materials())
    return entry


def materials() -> list[str]:
    """Names of the built-in materials."""
    return enum_names(lib.pell_material_count(), lib.pell_material_at)


def material(name: str) -> dict[str, Any]:
    """What is known about a built-in material, and the source of its numbers: title, medium (or None), gaussians (or None), color,
    roughness, note, source."""
    e = _entry(name)
    sums = ffi.new("struct pell_gaussians *", e.gaussians)
    return {"name": text(e.name), "title": text(e.title), "family": text(e.family),
            "medium": Medium._from(e.medium) if e.kind == lib.PELL_MATERIAL_MEDIUM else None,
            "gaussians": Gaussians._from(sums) if sums.count else None, "eta": e.medium.eta, "color": np.array(list(e.color)),
            "roughness": e.roughness, "note": text(e.note), "source": text(e.source)}
