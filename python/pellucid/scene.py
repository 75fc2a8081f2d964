# SPDX-License-Identifier: MIT
"""Scenes: from files, from dicts and from arrays."""
from __future__ import annotations

import contextlib
import json
import math
import os
import re
import threading
from typing import Any, Iterable, Mapping, Optional, Union

import numpy as np

from ._base import (Closing, Context, Progress, choose, closed, doubles, encoded, ffi, lib, number, numbers, path_bytes, pointer, set_fields,
                    text, three, wrong)

Length = Union[float, int, str]
_UNITS = {"nm": 1e-6, "um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "km": 1e6, "in": 25.4}
_LIGHTS = ("point", "spot", "directional", "rect", "disc", "environment")
_PIXELS = {np.dtype(np.uint8): "PELL_PIXEL_U8", np.dtype(np.uint16): "PELL_PIXEL_U16", np.dtype(np.float32): "PELL_PIXEL_F32"}

# What Scene.load takes, with defaults.
LOAD_OPTIONS: dict[str, Any] = {
    "size": None, "unit": None, "material": None, "camera": None, "time": None, "animation": None, "aspect": 0.0, "allow_outside": False,
    "bare": False, "up": None, "normals": None, "thicken": None, "from_": None, "studio": None, "environment": None,
    "environment_scale": 1.0, "environment_rotate": 0.0, "background": None, "ground": False}
_MESH = ("vertices", "triangles", "normals", "uv", "name", "material")


def millimetres(value: Optional[Length], where: str) -> float:
    """A length in mm: a number is in mm already, text carries its unit ("7cm")."""
    if value is None:
        return 0.0
    if isinstance(value, str):
        match = re.fullmatch(r"\s*([-+0-9.eE]+)\s*([a-z]+)\s*", value)
        try:
            length = float(match[1]) * _UNITS[match[2]] if match else math.nan
        except (KeyError, ValueError):
            length = math.nan
    else:
        length = number(value, where)
    if not (length > 0 and math.isfinite(length)):
        raise wrong(where, f"is {value!r:.60}, must be a length above 0 with its unit: {', '.join(_UNITS)}",
                    'as "70mm", "7cm" or "0.07m"; a number is in mm')
    return length


def _load_params(keep: list, **options: Any):
    for key in options:
        choose("option", key, LOAD_OPTIONS)
    given = {**LOAD_OPTIONS, **options}

    def name(key):
        value = given[key]
        if value is None:
            return ffi.NULL
        keep.append(ffi.new("char[]", path_bytes(str(value), key)))
        return keep[-1]

    return ffi.new("struct pell_load_params *", {
        "mm_per_unit": millimetres(given["unit"], "unit"), "size_mm": millimetres(given["size"], "size"), "material": name("material"),
        "camera": name("camera"), "time": 0.0 if given["time"] is None else number(given["time"], "time"),
        "timed": given["time"] is not None, "animation": name("animation"), "aspect": number(given["aspect"], "aspect"),
        "allow_outside": bool(given["allow_outside"]), "bare": bool(given["bare"]), "up": name("up"), "normals": name("normals"),
        "thicken_mm": millimetres(given["thicken"], "thicken"),
        "from": name("from_"), "studio": name("studio"), "environment": name("environment"),
        "environment_scale": number(given["environment_scale"], "environment_scale") if given["environment"] else 0.0,
        "environment_rotate_deg": number(given["environment_rotate"], "environment_rotate"), "background": name("background"),
        "ground": bool(given["ground"])})


class Scene(Closing):
    """Meshes, materials, lights and a camera, in mm. Use the class methods. After close() or `with` it is of no more use; its memory is
    freed when no renderer uses it."""

    def __init__(self, progress: Optional[Progress] = None):
        self._closed, self._users, self._lock, self._process = False, 0, threading.RLock(), os.getpid()
        self._scene = ffi.new("struct pell_scene **")
        self.context = Context(progress, "Scene")

    @property
    def c(self):
        """The C struct pell_scene."""
        if self._closed or not self._scene[0]:
            raise closed("Scene")
        return self._scene[0]

    @classmethod
    def load(cls, path: Union[str, os.PathLike], *, progress: Optional[Progress] = None, **options: Any) -> "Scene":
        """Reads glTF, OBJ, PLY, STL or a scene file.

        options: size (largest extent) or unit (of the file) as lengths ("70mm"; a number is in mm), material (name or file), camera
        (name), time (s), animation, aspect (width/height, for framing), allow_outside, bare (no default lights, camera, ground),
        up ("y" or "z"), normals ("file", "smooth", "flat"), thicken (thickness of open surfaces: "1mm"), from_ (side of the camera:
        "front", "34", "35,15"), studio ("soft", "rim", "back", "window"), environment (an image that lights the object) with
        environment_scale and environment_rotate (degrees), background ("#f4f1ec", "white", "transparent", "environment"), ground (True:
        the object stands on a grey floor, or table in an environment).
        """
        keep: list = []
        params = _load_params(keep, **options)
        self = cls(progress)
        self.context.call(lib.pell_scene_load, self.context.c, path_bytes(path), params, self._scene)
        return self

    @classmethod
    def from_dict(cls, scene: dict, *, folder: Union[str, os.PathLike] = ".", progress: Optional[Progress] = None,
                  **options: Any) -> "Scene":
        """A scene file's content (docs/guide/scene-file.md) as a dict; names of files in it are looked up in `folder`."""
        keep: list = []
        params = _load_params(keep, **options)
        try:
            data = json.dumps(scene, allow_nan=False, default=_plain).encode()
        except (TypeError, ValueError) as e:
            raise wrong("scene", f"is no content of a scene file: {e}", "a dict of texts, numbers, lists and dicts") from None
        self = cls(progress)
        self.context.call(lib.pell_scene_load_memory, self.context.c, path_bytes(os.path.join(folder, "dict.json")), data, len(data),
                          params, self._scene)
        return self

    @classmethod
    def from_arrays(cls, meshes: Iterable[dict], materials: Iterable[dict] = (), lights: Iterable[dict] = (),
                    camera: Optional[dict] = None, *, background: Any = None, aspect: float = 0.0,
                    progress: Optional[Progress] = None) -> "Scene":
        """A scene made in memory. Arrays are copied into it once.

        meshes: dicts with vertices (n, 3) mm; triangles (m, 3), counter-clockwise from outside; optionally normals (n, 3), uv (n, 2),
            name, material (index into materials).
        materials: dicts with `preset` (a built-in name) or sigma_a, sigma_s_reduced, g (1/mm, one number or three) and eta; besides any
            member of struct pell_material (roughness, base_color, mix, ...); a member called ..._map is an image (h, w) or (h, w, channels)
            of uint8, uint16 (sRGB-encoded where it is a colour) or float32.
        lights: dicts with type (point, spot, directional, rect, disc, environment) and members of struct pell_light: position mm,
            direction, power (W/sr, W/m^2 or W/(m^2 sr); of an environment a factor of its image, 1), image (as a map's), width, height,
            radius. Without any: a studio of three.
        camera: position mm, `to` mm or forward, up, fov_deg (vertical) or ortho_height mm. None: frames the meshes.
        background: a colour (3,), or None for grey with a soft shadow below the objects.
        """
        self = cls(progress)
        context = self.context
        context.check(lib.pell_scene_create(context.c, self._scene))
        for values in _dicts(materials, "materials"):
            self._add_material(values)
        for i, values in enumerate(_dicts(meshes, "meshes")):
            for key in values:
                choose("member", key, _MESH, f"meshes[{i}]")
            for key in _MESH[:2]:
                if key not in values:
                    raise wrong(f"meshes[{i}].{key}", "is missing")
            self._add_mesh(**values)
        for values in _dicts(lights, "lights"):
            self._add_light(values)
        if camera is not None:
            self._add_camera(*_dicts([camera], "camera"))
        if background is not None:
            self.c.background = lib.PELL_BACKGROUND_COLOR
            self.c.background_color = three(background, "background").tolist()
        self.c.contact_shadow = background is None
        params = _load_params([], aspect=aspect)
        context.call(lib.pell_scene_complete, self.c, params)
        return self

    def _add(self, function, name: str) -> int:
        index = ffi.new("size_t *")
        self.context.check(function(self.c, encoded(name, "name"), index))
        return index[0]

    def _add_mesh(self, vertices, triangles, normals=None, uv=None, name: str = "mesh", material: int = 0):
        name = str(name)
        points, faces = numbers(vertices, f"{name}.vertices", np.float32), numbers(triangles, f"{name}.triangles")
        if points.ndim != 2 or points.shape[1] != 3:
            raise wrong(f"{name}.vertices", f"has the shape {points.shape}, must have (n, 3)")
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise wrong(f"{name}.triangles", f"has the shape {faces.shape} of {faces.dtype}, must have (m, 3) of whole numbers")
        if faces.size and (faces.min() < 0 or faces.max() >= len(points)):
            raise wrong(f"{name}.triangles", f"has the vertex {faces.min() if faces.min() < 0 else faces.max()}, "
                        f"must be in [0, {len(points) - 1}]")
        if not 0 <= number(material, f"{name}.material") < max(self.c.num_materials, 1):
            raise wrong(f"{name}.material", f"is {material!r:.60}, must be in [0, {max(self.c.num_materials, 1) - 1}]: an index into materials")
        index = self._add(lib.pell_scene_add_mesh, name)
        self.context.check(lib.pell_mesh_allocate(self.c, index, len(points), len(faces)))
        mesh = self.c.meshes[index]
        mesh.object = index
        mesh.material = int(material) if self.c.num_materials else -1
        _fill(mesh.position, points, "float")
        _fill(mesh.index, faces.astype(np.uint32), "uint32_t")
        if normals is not None:
            _fill(mesh.normal, _shaped(normals, points.shape, f"{name}.normals"), "float")
        if uv is not None:
            self.context.check(lib.pell_mesh_allocate_uv(self.c, index, 0))
            _fill(self.c.meshes[index].uv[0], _shaped(uv, (len(points), 2), f"{name}.uv"), "float")

    def _add_material(self, values: dict):
        name = str(values.pop("name", f"material {self.c.num_materials}"))
        index = self._add(lib.pell_scene_add_material, name)
        preset = values.pop("preset", None)
        medium = {k: values.pop(k) for k in ("sigma_a", "sigma_s_reduced", "g", "eta") if k in values}
        if preset is not None:
            self.context.check(lib.pell_material_apply(self.c, index, encoded(name, "name"), encoded(str(preset), f"{name}.preset")))
        material = self.c.materials[index]
        if medium:
            if "sigma_a" in medium and "sigma_s_reduced" in medium:
                material.gaussians.count = 0
                material.opaque = False
                material.color_from = lib.PELL_COLOR_FROM_PROFILE
            for key, value in medium.items():
                if key == "eta":
                    material.medium.eta = number(value, f"{name}.eta")
                else:
                    setattr(material.medium, key, three(value, f"{name}.{key}").tolist())
        maps = {k: values.pop(k) for k in list(values) if k.endswith("_map")}
        set_fields(material, values, name)
        for key, image in maps.items():
            choose("map", key, [n for n, _ in ffi.typeof("struct pell_material").fields if n.endswith("_map")], name)
            target = getattr(material, key)
            target.texture = self._add_texture(f"{name}.{key}", image, key in ("base_color_map", "specular_color_map", "emissive_map"))
            target.matrix = [1, 0, 0, 0, 1, 0]

    def _add_texture(self, name: str, image, color: bool):
        pixels = numbers(image, name)
        pixels = pixels[:, :, None] if pixels.ndim == 2 else pixels
        if pixels.ndim != 3 or pixels.dtype not in _PIXELS:
            raise wrong(name, f"has the shape {pixels.shape} of {pixels.dtype}, must have (h, w) or (h, w, channels) of uint8, uint16 or float32")
        out = ffi.new("struct pell_texture **")
        self.context.check(lib.pell_scene_add_texture(self.c, encoded(name, "name"), out))
        height, width, channels = pixels.shape
        self.context.check(lib.pell_texture_allocate(self.c, out[0], width, height, channels, getattr(lib, _PIXELS[pixels.dtype])))
        ffi.memmove(out[0].image.pixels, pointer(pixels, "char *"), pixels.nbytes)
        out[0].image.srgb = color and pixels.dtype != np.float32
        return out[0]

    def _add_light(self, values: dict):
        kind = choose("type of light", values.pop("type", "point"), _LIGHTS)
        index = self._add(lib.pell_scene_add_light, str(values.pop("name", _LIGHTS[kind])))
        light = self.c.lights[index]
        light.type = kind
        power = values.pop("power", 1.0 if kind == _LIGHTS.index("environment") else None)
        if power is not None:
            light.power = three(power, "light.power").tolist()
        towards = values.pop("to", None)
        if towards is not None:
            values["direction"] = _vector(towards, "light.to") - _vector(values.get("position", (0, 0, 0)), "light.position")
        if "direction" in values:
            direction = _unit(values["direction"], "light.direction")
            values["direction"] = direction
            values.setdefault("up", _perpendicular(direction))
        image = values.pop("image", None)
        set_fields(light, values, "light")
        if image is not None:
            light.image = self._add_texture("light.image", image, True)

    def _add_camera(self, values: dict):
        index = self._add(lib.pell_scene_add_camera, str(values.pop("name", "camera")))
        camera = self.c.cameras[index]
        position = _vector(values.get("position", (0, 0, 0)), "camera.position")
        to = values.pop("to", None)
        forward = _unit(values.get("forward", (0, 0, -1)) if to is None else _vector(to, "camera.to") - position, "camera.forward")
        up = _vector(values.get("up", (0, 1, 0)), "camera.up")
        across = up - forward * float(up @ forward)
        if "up" not in values and np.linalg.norm(across) < 1e-4:
            across = _perpendicular(forward)
        values["forward"] = forward
        values["up"] = _unit(across, "camera.up")
        degrees = values.pop("fov_deg", None)
        values["fov"] = values.get("fov", math.radians(20.0)) if degrees is None else math.radians(number(degrees, "camera.fov_deg"))
        set_fields(camera, values, "camera")

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3), mm: the least and the largest corner, without a generated ground."""
        with self._read() as c:
            return np.array([list(c.bounds_min), list(c.bounds_max)], dtype=np.float32)

    @property
    def materials(self) -> list[str]:
        """Names of the materials."""
        with self._read() as c:
            return [text(c.materials[i].name) for i in range(c.num_materials)]

    @property
    def triangles(self) -> int:
        """Number of triangles."""
        with self._read() as c:
            return sum(c.meshes[i].num_triangles for i in range(c.num_meshes))

    @property
    def hash(self) -> int:
        """A 64-bit hash of the content, independent of the location of files."""
        with self._read() as c:
            return lib.pell_scene_hash(c)

    def check(self) -> list[tuple[str, str, str]]:
        """Problems of the scene: (severity, where, what)."""
        report = ffi.new("struct pell_scene_report *")
        with self._read() as c:
            try:
                self.context.call(lib.pell_scene_check, c, report)
                return [(("note", "warning", "error")[p.severity], text(p.where), text(p.what))
                        for p in (report.problems[i] for i in range(report.num_problems))]
            finally:
                lib.pell_scene_report_finish(self.context.c, report)

    def _hold(self):
        """The C struct pell_scene, which stays until _release()."""
        with self._lock:
            scene = self.c
            self._users += 1
            return scene

    def _release(self, step: int = 1) -> None:
        """Ends a _hold(). The last one after close() frees it."""
        with self._lock:
            self._users -= step
            if not self._closed or self._users:
                return
            if os.getpid() == self._process:
                lib.pell_scene_destroy(self._scene)
            self._scene[0] = ffi.NULL
            self.context.free()

    @contextlib.contextmanager
    def _read(self):
        """The C struct pell_scene, which a close() of another thread leaves until the end of the block."""
        scene = self._hold()
        try:
            yield scene
        finally:
            self._release()

    def close(self) -> None:
        """Frees the scene, or lets its last renderer do so."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._release(0)


def _plain(value: Any) -> Any:
    """An array as JSON has it."""
    if not hasattr(value, "tolist"):
        raise TypeError(f"it holds {value!r:.60}")
    return value.tolist()


def _dicts(values: Any, what: str) -> list[dict]:
    """Copies of the dicts of a list."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise wrong(what, f"is {values!r:.60}, must be a list of dicts")
    rows = list(values)
    for i, row in enumerate(rows):
        if not isinstance(row, Mapping):
            raise wrong(what if what == "camera" else f"{what}[{i}]", f"is {row!r:.60}, must be a dict")
    return [dict(row) for row in rows]


def _fill(target, array: np.ndarray, kind: str) -> None:
    data = np.ascontiguousarray(array)
    ffi.memmove(ffi.cast(f"{kind} *", target), pointer(data, "char *"), data.nbytes)


def _shaped(values, shape, what: str) -> np.ndarray:
    array = numbers(values, what, np.float32)
    if array.shape != shape:
        raise wrong(what, f"has the shape {array.shape}, must have {shape}")
    return array


def _vector(values, what: str) -> np.ndarray:
    v = doubles(values, what)
    if v.shape != (3,):
        raise wrong(what, f"has the shape {v.shape}, must be three numbers")
    return v


def _unit(vector, what: str) -> np.ndarray:
    v = _vector(vector, what)
    length = float(np.linalg.norm(v))
    if not (length > 0 and math.isfinite(length)):
        raise wrong(what, f"is {v.tolist()}, must have a direction: a finite length above 0")
    return v / length


def _perpendicular(direction: np.ndarray) -> np.ndarray:
    up = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) < 0.99 else np.array([0.0, 0.0, -1.0])
    return _unit(up - direction * float(up @ direction), "up")
