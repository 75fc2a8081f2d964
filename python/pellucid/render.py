# SPDX-License-Identifier: MIT
"""Renders scenes to arrays."""
from __future__ import annotations

import os
from typing import Any, Optional, Union

import numpy as np

from ._base import (Closing, InvalidError, Progress, Turns, choose, closed, doubles, encoded, ffi, knob_argument, knob_rows, knob_text, lib,
                    set_knobs, text, whole, wrong)
from .scene import LOAD_OPTIONS, Scene

DEFAULT_METHOD = "screen-space"
_ENGINES = ("auto", "cpu", "vulkan")
_COMMON = {"samples": ("samples", "most"), "time_limit": ("time-limit",), "target_error": ("error",)}


def methods() -> dict[str, dict[str, Any]]:
    """The methods by name: title, cite, limits, and knobs by name (unit, default, min, max, choices, help)."""
    found = {}
    for m in (lib.pell_method_at(i) for i in range(lib.pell_method_count())):
        knobs = {text(k.name): {"unit": text(k.unit), "default": getattr(k, "def")[0], "min": k.min,
                                "max": k.max, "help": text(k.help), "choices": _choices(k)} for k in knob_rows(m.knobs)}
        found[text(m.name)] = {"title": text(m.title), "cite": text(m.cite), "limits": text(m.limits), "knobs": knobs,
                               "reference": m.kind == lib.PELL_KIND_REFERENCE}
    return found


def _choices(knob) -> list[str]:
    names: list[str] = []
    while knob.choices and knob.choices[len(names)]:
        names.append(text(knob.choices[len(names)]))
    return names


def _pixels(size: Any) -> tuple[int, int]:
    """Width and height."""
    try:
        array = doubles(size, "size")
    except InvalidError:
        array = np.empty(0)
    if isinstance(size, str) or array.shape != (2,) or not ((array >= 1) & (array == np.floor(array)) & (array < 2 ** 31)).all():
        raise wrong("size", f"is {size!r:.60}, must be (width, height), two whole numbers of pixels")
    return int(array[0]), int(array[1])


def _engine(name: str) -> int:
    if name == "gpu":  # near "cpu" by its letters alone
        raise wrong("engine", f'is "gpu", must be one of {", ".join(_ENGINES)}', 'did you mean "vulkan"?')
    return choose("engine", name, _ENGINES)


class _Plane:
    """Memory of a renderer that lives as long as arrays over it."""

    def __init__(self, owner, address, shape, stride):
        self.owner = owner
        self.__array_interface__ = {"version": 3, "typestr": "<f4", "shape": shape, "strides": (4 * stride, 4),
                                    "data": (int(ffi.cast("uintptr_t", address)), True)}


class Intermediate:
    """What a method made on its way: `data`, (height, width) or (height, width, components) float32, in `unit`; `what` says what it is.
    `gaussians` of a blurred image: for each material its name, `material`, the `variance` in mm^2, and the `weight` of R, G, B in the
    method's result."""

    def __init__(self, data: np.ndarray, unit: str, what: str, gaussians: list[dict[str, Any]]):
        self.data, self.unit, self.what, self.gaussians = data, unit, what, gaussians

    def __repr__(self) -> str:
        return f"<Intermediate {self.data.shape}, {self.unit}: {self.what}>"


class _Shown:
    """What an observer of the renderer keeps."""

    def __init__(self, context):
        self.context = context
        self.images: dict[str, Intermediate] = {}


def _show_failed(_type, error, traceback):
    user = traceback.tb_frame.f_locals.get("user") if traceback else None
    if user:
        ffi.from_handle(user).context.raise_later(error)
    return lib.PELL_ERR_CANCELLED


@ffi.def_extern(onerror=_show_failed)
def _pellucid_show(user, image):
    planes = []
    for c in range(image.components):
        size = 4 * (image.stride * (image.height - 1) + image.width)
        flat = np.frombuffer(ffi.buffer(image.planes[c], size), np.float32)
        planes.append(np.lib.stride_tricks.as_strided(flat, (image.height, image.width), (4 * image.stride, 4)))
    data = planes[0].copy() if len(planes) == 1 else np.stack(planes, axis=-1)
    gaussians = [{"material": text(g.material), "variance": g.variance, "weight": tuple(g.weight)}
                 for g in (image.gaussians[i] for i in range(image.num_gaussians))]
    ffi.from_handle(user).images[text(image.name)] = Intermediate(data, text(image.unit), text(image.what), gaussians)
    return lib.PELL_OK


class Picture:
    """A rendered image. `channels`: (height, width) float32 arrays by name ("R", "diffuse.multiple.G", "depth.Z"), linear, W/(m^2 sr);
    read-only views of the renderer's memory where it was not copied. picture["diffuse.multiple"] stacks a layer's, picture.rgb the image."""

    def __init__(self, renderer, image, method: str, copy: bool):
        shape = (image.height, image.width)

        def plane(address):
            array = np.asarray(_Plane(renderer, address, shape, image.stride))
            return array.copy() if copy else array

        self.width, self.height, self.method = image.width, image.height, method
        self.channels = {text(image.channels[i].name): plane(image.channels[i].data) for i in range(image.num_channels)}
        self._display = [plane(p) for p in image.display]
        self.intermediates: dict[str, Intermediate] = {}
        self.seconds, self.exposure, self.partial, self.invalid = image.seconds, image.exposure, image.partial, image.invalid
        self.stages = {text(image.stages[i].name): image.stages[i].ms for i in range(image.num_stages)}

    @property
    def layers(self) -> list[str]:
        """Names of the layers; "" is the image itself."""
        return list(dict.fromkeys(name.rpartition(".")[0] for name in self.channels))

    def __getitem__(self, layer: str) -> np.ndarray:
        """(height, width, channels): a copy of the channels of a layer; of one channel by its full name (height, width), no copy."""
        if layer in self.channels:
            return self.channels[layer]
        found = [data for name, data in self.channels.items() if name.rpartition(".")[0] == layer]
        if not found:
            choose("layer", layer, [*self.layers, *self.channels])
        return np.stack(found, axis=-1)

    @property
    def rgb(self) -> np.ndarray:
        """(height, width, 3): linear radiance without exposure."""
        return np.stack([self.channels[c] for c in "RGB"], axis=-1)

    @property
    def display(self) -> np.ndarray:
        """(height, width, 3): exposed, tone-mapped and sRGB-encoded, [0, 1]: what a PNG shows."""
        v = np.stack(self._display, axis=-1)
        return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055)

    def save(self, path: Union[str, os.PathLike]) -> None:
        """Writes png (exposed), or exr (all channels), hdr or pfm (linear), by the extension."""
        from .images import write_image, write_layers  # pylint: disable=import-outside-toplevel # only here
        if os.fspath(path).lower().endswith(".exr"):
            write_layers(path, self.channels)
        else:
            write_image(path, np.stack(self._display, axis=-1) if os.fspath(path).lower().endswith(".png") else self.rgb)

    def __repr__(self) -> str:
        return f"<Picture {self.width} x {self.height}, {self.method}, {self.seconds:.3g} s, layers {self.layers}>"


class Renderer(Closing):
    """Renders one scene any number of times, with what can be kept kept. threads 0: one per core; engine: auto, cpu, vulkan. Calls of
    several threads wait for each other; renderers of one scene work at the same time."""

    def __init__(self, scene: Scene, *, threads: int = 0, engine: str = "auto"):
        self._turns, self._held = Turns("Renderer"), False
        self._renderer = ffi.new("struct pell_renderer **")
        self._device = ffi.new("struct pell_device **")
        if not isinstance(scene, Scene):
            raise wrong("scene", f"is {scene!r:.60}, must be a Scene")
        data = scene._hold()
        self.scene = scene
        self._held = True
        context = self.context = scene.context
        params = ffi.new("struct pell_device_params *", {"threads": whole(threads, "threads", 0, 256),
                                                         "engine": _engine(engine)})
        context.check(lib.pell_device_create(context.c, params, self._device))
        context.check(lib.pell_renderer_create(self._device[0], self._renderer))
        context.call(lib.pell_renderer_set_scene, self._renderer[0], data)
        self._threads = self._turns.threads = lib.pell_device_threads(self._device[0])
        self._method: Any = None

    def _configure(self, method: Optional[str], given: dict[str, Any]):
        """The method, its knobs, and the settings of the scene file and the caller, in this order."""
        context, scene = self.context, self.scene._scene[0]
        rows = {text(k.name) for k in knob_rows(lib.pell_settings_knobs())}
        own = {text(o.name): text(o.value) for o in (scene.options[i] for i in range(scene.num_options))}
        name: str = method or own.get("method") or DEFAULT_METHOD
        settings = {option: value for option, value in own.items() if option in rows}
        knobs = {k[6:]: v for k, v in own.items() if k.startswith("knobs/")} if name == own.get("method", DEFAULT_METHOD) else {}
        if name == "none":
            found, table = ffi.NULL, set()
        else:
            found = lib.pell_method_find(context.c, b"method", encoded(name, "method"))
            context.check(lib.PELL_OK if found else lib.PELL_ERR_INVALID)
            table = {text(k.name) for k in knob_rows(found.knobs)}
        for key, value in given.items():
            if key in ("width", "height"):
                raise wrong(key, "is not an argument, must be given as size=(width, height)")
            option = key.rstrip("_").replace("_", "-")
            option = next((k for k in _COMMON.get(key, ()) if k in table), option)
            if option in table:
                knobs[option] = value
            elif option in rows:
                settings[option] = value
            else:
                owners = [other for other, row in methods().items() if option in row["knobs"]]
                if owners:
                    raise wrong(f"method {name}", f'has no knob "{key}"', f"it is a knob of {', '.join(owners)}")
                choose("knob", key, sorted(knob_argument(k) for k in (table | rows) - {"width", "height", "layers"}), f"method {name}")
        return name, found, knobs, settings

    def render(self, method: Optional[str] = None, *, size: Optional[tuple[int, int]] = None, layers: bool = True, copy: bool = True,
               intermediates: bool = False, **knobs: Any) -> Picture:
        """One image. method: a name of methods(), or "none"; default: the scene file's, else screen-space. size: (width, height).
        knobs: those of the method and of `pellucid render` (msaa, bounces, seed, ...), with underscores, and one at the end where the
        name is Python's or an argument: as_="paper" is the published form, with the paper's settings where none are given, size_=1024
        the map of texture-space. copy False: the arrays are views of the renderer's memory, valid until its next call.
        intermediates: also keeps what the method makes on its way (blurs, stretch, thickness, ...), in Picture.intermediates."""
        with self._turns:
            if not self._held:
                raise closed("Renderer")
            return self._render(method, size, layers, copy, intermediates, knobs)

    def _render(self, method, size, layers, copy, intermediates, knobs) -> Picture:
        settings = ffi.new("struct pell_settings *")
        name, found, values, options = self._configure(method, knobs)
        if size is not None:
            options |= dict(zip(("width", "height"), _pixels(size)))
        memory = ffi.NULL
        if found:
            memory = ffi.new("double[]", found.knobs_size // 8 + 1)
            strings = [[ffi.new("char[]", encoded(s, k)) for s in (k, knob_text(v, k), k)] for k, v in values.items()]
            array = ffi.new("struct pell_setting[]", [dict(zip(("name", "value", "where"), s)) for s in strings])
            self.context.check(lib.pell_method_configure(self.context.c, found, array, len(strings), memory))
        lib.pell_settings_default(found, memory, settings)
        settings.layers = layers
        set_knobs(self.context, lib.pell_settings_knobs(), "render", settings, options)
        if self._method != (name, values):
            self.context.check(lib.pell_renderer_set_method(self._renderer[0], found, memory))
            self._method = (name, dict(values))
        image = ffi.new("struct pell_render_result *")
        shown = _Shown(self.context)
        handle = ffi.new_handle(shown)
        if intermediates:
            lib.pell_renderer_set_observer(self._renderer[0], ffi.new("struct pell_observer *", {"show": lib._pellucid_show, "user": handle}))
        try:
            self.context.call(lib.pell_renderer_render, self._renderer[0], settings, image)
        finally:
            if intermediates:
                lib.pell_renderer_set_observer(self._renderer[0], ffi.NULL)
        picture = Picture(self, image, name, copy)
        picture.intermediates = shown.images
        return picture

    @property
    def threads(self) -> int:
        """Number of threads in use."""
        self._turns.check()
        if not self._held:
            raise closed("Renderer")
        return self._threads

    def close(self) -> None:
        """Frees the renderer, after a call that another thread is in; an open scene stays. Arrays that render(copy=False) gave are invalid
        after it."""
        if not self._turns.forked:
            with self._turns:
                lib.pell_renderer_destroy(self._renderer)
                lib.pell_device_destroy(self._device)
                held, self._held = self._held, False
        else:
            held, self._held = self._held, False
        if held:
            self.scene._release()


def render(scene: Union[Scene, dict, str, os.PathLike], method: Optional[str] = None, *, size: Optional[tuple[int, int]] = None,
           threads: int = 0, engine: str = "auto", layers: bool = True, progress: Optional[Progress] = None,
           load: Optional[dict[str, Any]] = None, **knobs: Any) -> Picture:
    """Renders a Scene, a scene dict or a file; see Renderer.render. load: options of Scene.load or Scene.from_dict, as {"size": "70mm",
    "material": "wholemilk"}. The arrays of the result are not copied: they keep the renderer's memory."""
    if load is not None and not isinstance(load, dict):
        raise wrong("load", f"is {load!r:.60}, must be a dict of options", 'as {"size": "70mm"}')
    if not isinstance(scene, Scene):
        options = dict(load or {})
        for name in options:
            choose("option", name, [*LOAD_OPTIONS, *(["folder"] if isinstance(scene, dict) else [])], "load")
        if size is not None:
            width, height = _pixels(size)
            options.setdefault("aspect", width / height)
        scene = Scene.from_dict(scene, progress=progress, **options) if isinstance(scene, dict) else \
            Scene.load(scene, progress=progress, **options)
    elif load:
        raise wrong("load", "is for files and dicts, must be left out: this scene is loaded already")
    elif progress is not None:
        raise wrong("progress", "is for files and dicts, must be left out: this scene has that of Scene.load")
    return Renderer(scene, threads=threads, engine=engine).render(method, size=size, layers=layers, copy=False, **knobs)
