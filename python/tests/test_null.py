# SPDX-License-Identifier: MIT
"""Every function of the library that returns a result refuses NULL, except where its header allows it, and none crashes.

All functions are found in the library itself: a new one is tested without a line here."""
import faulthandler
import os
import signal

import pytest

from pellucid._pellucid import ffi, lib

# What headers say may be NULL: an argument of a function, or, below, all of a type.
ALLOWED = {
    ("pell_context_create_for", 1), ("pell_device_create", 1), ("pell_image_write", 2), ("pell_method_knobs_create", 2),
    ("pell_method_configure", 0), ("pell_method_knobs_set_text", 0), ("pell_method_knobs_set_number", 0),
    ("pell_pass_create", 2), ("pell_renderer_set_method", 1), ("pell_renderer_set_method", 2),
    ("pell_renderer_set_scene", 1), ("pell_renderer_set_checkpoint", 1), ("pell_scene_add_camera", 1), ("pell_scene_add_light", 1),
    ("pell_scene_add_material", 1), ("pell_scene_add_mesh", 1), ("pell_scene_add_texture", 1), ("pell_slab_poles", 7),
    ("pell_vulkan_pass_create", 3), ("pell_scene_load", 2), ("pell_scene_load_memory", 4), ("pell_scene_complete", 1),
    ("pell_separable_make", 1), ("pell_stack_gaussians", 2), ("pell_knob_set", 0), ("pell_knob_set", 3), ("pell_knob_set_number", 0),
    ("pell_knob_set_number", 3), ("pell_knob_set_rgb", 0), ("pell_knob_set_rgb", 3), ("pell_knobs_check", 0),
}
OPTIONAL = {"struct pell_profile_params *", "struct pell_fit_report *", "struct pell_medium_fault *", "struct pell_profile_fault *",
            "unsigned int *", "struct pell_compare_params *"}
OBJ = b"v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def results():
    kind = ffi.typeof("enum pell_result")
    for name in sorted(dir(lib)):
        if name.startswith("pell_") and callable(getattr(lib, name)) and ffi.typeof(getattr(lib, name)).result is kind:
            yield name


def kinds(name):
    return ffi.typeof(getattr(lib, name)).args


def must(result):
    assert result == lib.PELL_OK


class Values:
    """Valid values by type; zeros, and 1, where a type says nothing."""

    def __init__(self):
        self.kept = []
        self.ctx = self.made("struct pell_context **", lambda out: lib.pell_context_create_for(lib.PELL_VERSION_NUMBER, ffi.NULL, out))
        self.device = self.made("struct pell_device **", lambda out: lib.pell_device_create(self.ctx, self.new("struct pell_device_params *",
                                                                                                             {"threads": 1}), out))
        load = self.new("struct pell_load_params *", {"mm_per_unit": 1, "aspect": 1})
        self.scene = self.made("struct pell_scene **", lambda out: lib.pell_scene_load_memory(self.ctx, b"a.obj", OBJ, len(OBJ), load, out))
        self.renderer = self.made("struct pell_renderer **", lambda out: lib.pell_renderer_create(self.device, out))
        self.method = lib.pell_method_find(self.ctx, b"test", b"screen-space")
        self.knobs = self.made("void **", lambda out: lib.pell_method_knobs_create(self.ctx, self.method, ffi.NULL, out))
        must(lib.pell_renderer_set_scene(self.renderer, self.scene))
        must(lib.pell_renderer_set_method(self.renderer, self.method, ffi.NULL))
        self.settings = self.new("struct pell_settings *")
        lib.pell_settings_default(self.method, self.knobs, self.settings)
        self.settings.width = self.settings.height = 16
        self.medium = self.new("struct pell_medium *", lib.pell_material_find(b"marble").medium)
        self.profile = self.new("struct pell_profile[3]")
        for c in range(3):
            must(lib.pell_profile_make(lib.PELL_PROFILE_DIPOLE, self.medium, c, ffi.NULL, self.profile + c))
        self.gaussians = self.new("struct pell_gaussians *")
        must(lib.pell_fit_medium(self.medium, self.new("struct pell_fit_params *", {"count": 4}), self.gaussians, ffi.NULL))
        self.stack = self.new("struct pell_stack *")
        lib.pell_stack_of_medium(self.medium, 1, self.stack)

    def new(self, *words):
        self.kept.append(ffi.new(*words))
        return self.kept[-1]

    def made(self, kind, make):
        out = self.new(kind)
        must(make(out))
        return out[0]

    def pass_(self):
        material = self.new("struct pell_frame_material *", {"medium": self.medium[0], "gaussians": self.gaussians[0]})
        shape = self.new("struct pell_frame_shape *",
                         {"width": 8, "height": 8, "stride": 16, "focal_px": 1, "orthographic": True, "num_materials": 1, "materials": material})
        return self.made("struct pell_pass **", lambda out: lib.pell_pass_create(self.device, self.method, self.knobs, shape, out))

    def of(self, kind):
        name = kind.cname
        own = {"struct pell_context *": self.ctx, "struct pell_device *": self.device, "struct pell_scene *": self.scene,
               "struct pell_renderer *": self.renderer, "struct pell_method *": self.method, "struct pell_settings *": self.settings,
               "struct pell_medium *": self.medium, "struct pell_profile *": self.profile, "struct pell_gaussians *": self.gaussians,
               "struct pell_stack *": self.stack, "struct pell_knob *": lib.pell_settings_knobs(), "void *": self.knobs}
        if name in own:
            return own[name]
        if name == "struct pell_pass *":
            return self.pass_()
        if name == "struct pell_material_entry *":
            return self.new("struct pell_material_entry *", lib.pell_material_find(b"wholemilk")[0])
        if name == "char *":
            return self.new("char[]", b"width")
        if kind.kind == "pointer":
            if kind.item.kind == "struct" and kind.item.fields is not None or kind.item.kind in ("primitive", "pointer"):
                return self.new(f"{kind.item.cname.replace(' *', '*')}[64]")
            return ffi.cast(kind, self.new("char[65536]"))
        return 1


def outcome(name, null):
    """What the function returns in a process of its own, with NULL for one argument; a negative signal where it crashes there."""
    child = os.fork()
    if child == 0:
        try:
            faulthandler.disable()
            signal.alarm(20)
            values = Values()
            given = [ffi.NULL if i == null else values.of(kind) for i, kind in enumerate(kinds(name))]
            os._exit(-getattr(lib, name)(*given))
        finally:
            os._exit(99)
    status = os.waitpid(child, 0)[1]
    return -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)


@pytest.mark.parametrize("name", results())
def test_null(name):
    wrong = []
    for i, kind in enumerate(kinds(name)):
        if kind.kind == "pointer":
            ended = outcome(name, i)
            allowed = (name, i) in ALLOWED or kind.cname in OPTIONAL
            if ended < 0 or ended > 7 or not allowed and ended != -lib.PELL_ERR_INVALID:
                wrong.append(f"argument {i} ({kind.cname}) NULL: {signal.Signals(-ended).name if ended < 0 else ended}")
    assert not wrong
