# SPDX-License-Identifier: MIT
"""Pellucid: subsurface scattering on numpy arrays.

Units everywhere: lengths mm, coefficients 1/mm, profiles 1/mm^2, irradiance W/m^2, radiance W/(m^2 sr), colour linear Rec.709 (channel
0, 1, 2 = R, G, B). The numbers are the C library's to the last bit. `lib` and `ffi` give the whole C interface where this one ends.
"""
from ._base import (CancelledError, DeviceError, Error, FileError, FormatError, InvalidError, OutOfMemoryError, PellucidWarning,
                    UnsupportedError, ffi, lib, version)
from .compare import Comparison, compare
from .images import read_exr, read_image, write_image
from .kernels import Separable, chain, gaussian_taps, separable, table_radius, table_ring, table_sphere, table_value
from .layers import Layer, Stack, skin_color, skin_layers
from .optics import (Gaussians, Medium, Phase, Profile, albedo_from_color, color_from_albedo, fit, fresnel, fresnel_diffuse,
                     half_space_albedo, material, materials, models, profile_at, profiles, sample_radii, total_reflectance)
from .passes import Pass
from .render import Intermediate, Picture, Renderer, methods, render
from .scene import Scene

__version__ = version()
__all__ = [
    "CancelledError", "Comparison", "DeviceError", "Error", "FileError", "FormatError", "Gaussians", "Intermediate", "InvalidError", "Layer",
    "Medium", "OutOfMemoryError", "Pass", "PellucidWarning", "Phase", "Picture", "Profile", "Renderer", "Scene", "Separable", "Stack",
    "UnsupportedError", "albedo_from_color", "chain", "color_from_albedo", "compare", "ffi", "fit", "fresnel", "fresnel_diffuse",
    "gaussian_taps", "half_space_albedo", "lib", "material", "materials", "methods", "models", "profile_at", "profiles", "read_exr",
    "read_image", "render", "sample_radii", "separable", "skin_color", "skin_layers", "table_radius", "table_ring", "table_sphere",
    "table_value", "total_reflectance", "version", "write_image",
]
