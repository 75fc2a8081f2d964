# SPDX-License-Identifier: MIT
import copy
import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings

import numpy as np
import pytest

import pellucid

SIZE = (64, 48)
LOAD = {"size": "40mm", "material": "wholemilk"}


def ball_scene(ball, **more):
    vertices, triangles, _ = ball
    return pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], [{"preset": "wholemilk"}], **more)


@pytest.mark.parametrize("method", ["screen-space", "texture-space", "none"])
def test_a_picture_is_the_programs(program, ball_file, tmp_path, method):
    out = tmp_path / "out.pfm"
    program("render", ball_file, "--size", "40mm", "--material", "wholemilk", "-m", method, "--width", SIZE[0], "--height", SIZE[1],
            "--threads", 2, "-q", "-o", out)
    picture = pellucid.render(ball_file, method, size=SIZE, threads=2, load=LOAD)
    assert picture.rgb.shape == (SIZE[1], SIZE[0], 3) and picture.rgb.max() > 0
    assert (pellucid.read_image(out) == picture.rgb).all()
    assert picture.method == method and picture.invalid == 0


def alone(code, *words):
    """Runs code in an interpreter of its own, which may end by a signal or never."""
    done = subprocess.run([sys.executable, "-c", "import os, sys, threading, pellucid\n" + code, *map(str, words)], capture_output=True,
                          text=True, timeout=120, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    return done.stdout.split()


MADE = """
scene = pellucid.Scene.load(sys.argv[1], size="40mm", material="wholemilk")
renderer = pellucid.Renderer(scene, threads=int(sys.argv[2]))
def draw(**more):
    return float(renderer.render("none", size=(32, 24), **more).rgb.sum())
first = draw()
"""


def test_threads_take_turns(ball_file):
    said = alone(MADE + """
sums = []
threads = [threading.Thread(target=lambda: sums.extend(draw() for _ in range(4))) for _ in range(3)]
for t in threads: t.start()
for t in threads: t.join()
print(len(sums), set(sums) == {first})
last = threading.Thread(target=lambda: sums.append(draw()))
last.start()
renderer.close()
last.join()
try:
    renderer.threads
except pellucid.InvalidError as e:
    print("closed" in str(e))
""", ball_file, 2)
    assert said[:2] == ["12", "True"] and said[-1] == "True"


def test_an_object_is_of_no_use_to_the_functions_that_it_calls(ball_file):
    seen = []

    def progress(*_):
        try:
            renderer.render("none", size=(8, 6))
        except pellucid.InvalidError as e:
            seen.append(str(e))
    with pellucid.Scene.load(ball_file, progress=progress, **LOAD) as scene, pellucid.Renderer(scene) as renderer:
        renderer.render("path-trace", size=(32, 24), samples=8, msaa=1)
    assert seen and all("at work in this thread" in s for s in seen)


def test_what_owns_memory_is_not_copied(ball_file):
    with pellucid.Scene.load(ball_file, **LOAD) as scene, pellucid.Renderer(scene) as renderer:
        for thing in (scene, renderer, scene.context):
            for way in (copy.copy, copy.deepcopy, pickle.dumps):
                with pytest.raises(TypeError, match="can't be copied or pickled"):
                    way(thing)
        with pytest.raises(pellucid.InvalidError, match="still in use"):
            scene.context.close()
        assert renderer.render("none", size=SIZE).rgb.max() > 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.parametrize("threads", [1, 2])
def test_after_a_fork_threads_are_missed(ball_file, threads):
    said = alone(MADE + """
sys.stdout.flush()
child = os.fork()
if child == 0:
    try:
        print("same" if draw() == first else "other")
    except pellucid.InvalidError as e:
        print("refused" if "forked" in str(e) else e)
    own = pellucid.Renderer(scene, threads=2).render("none", size=(32, 24))
    print(float(own.rgb.sum()) == first)
    sys.stdout.flush()
    os._exit(0)
print(os.waitpid(child, 0)[1], draw() == first)
""", ball_file, threads)
    assert sorted(said) == sorted(["same" if threads == 1 else "refused", "True", "0", "True"])


def test_names_end_where_they_end(ball_file):
    for call in (lambda: pellucid.Medium.material("marble\0junk"), lambda: pellucid.render(ball_file, "none\0x", load=LOAD),
                 lambda: pellucid.Scene.load(f"{ball_file}\0x")):
        with pytest.raises(pellucid.InvalidError, match="NUL"):
            call()


def test_layers_and_display(ball_file):
    picture = pellucid.render(ball_file, size=SIZE, load=LOAD, msaa=1)
    assert "diffuse.multiple" in picture.layers
    assert picture["diffuse.multiple"].shape[:2] == (48, 64)
    assert 0 <= picture.display.min() and picture.display.max() <= 1
    with pytest.raises(pellucid.InvalidError, match="did you mean"):
        picture["difuse.multiple"]  # pylint: disable=pointless-statement


def test_intermediates_are_what_the_picture_is_made_of(ball_file):
    plain = pellucid.render(ball_file, size=SIZE, load=LOAD)
    assert not plain.intermediates
    with pellucid.Scene.load(ball_file, aspect=4 / 3, **LOAD) as scene, pellucid.Renderer(scene) as renderer:
        picture = renderer.render(size=SIZE, intermediates=True)
        again = renderer.render(size=SIZE)
        maps = renderer.render("texture-space", size=SIZE, intermediates=True).intermediates
    assert (picture.rgb == plain.rgb).all() and (again.rgb == plain.rgb).all() and not again.intermediates
    blur = picture.intermediates["screen-space.blur-4"]
    assert blur.data.shape == (48, 64, 3) and blur.unit == "W/m^2" and blur.data.max() > 0 and "Gaussian" in blur.what
    assert len(blur.gaussians) == 1 and blur.gaussians[0]["material"] == "wholemilk" and blur.gaussians[0]["variance"] > 0
    assert len(blur.gaussians[0]["weight"]) == 3 and 0 < max(blur.gaussians[0]["weight"]) <= 1
    assert picture.intermediates["frame.depth"].data.shape == (48, 64) and not picture.intermediates["frame.depth"].gaussians
    size = maps["texture-space.texel-size"].data
    assert size.shape[2] == 2 and 0 < size.max() < 40


def test_as_paper_has_the_papers_settings(program, ball_file, tmp_path):
    out = tmp_path / "out.pfm"
    for more, knobs in (((), {}), (("--exit", "balanced"), {"exit": "balanced"})):
        program("render", ball_file, "--size", "40mm", "--material", "wholemilk", "-m", "image-space", "--set", "as=paper", "--width",
                SIZE[0], "--height", SIZE[1], "-q", "-o", out, *more)
        picture = pellucid.render(ball_file, "image-space", size=SIZE, load=LOAD, as_="paper", **knobs)
        assert (pellucid.read_image(out) == picture.rgb).all()


def test_a_knob_that_has_the_name_of_an_argument_ends_with_an_underscore(ball_file):
    with pellucid.Renderer(pellucid.Scene.load(ball_file, **LOAD)) as renderer:
        maps = [renderer.render("texture-space", size=SIZE, size_=side, charts="planar", intermediates=True).intermediates
                for side in (64, 128)]
    width = [next(v for k, v in shown.items() if k.endswith("texel-size")).data.shape[1] for shown in maps]
    assert width[0] <= 64 < width[1] <= 128


def test_arrays_of_a_picture_are_the_renderers_and_outlive_it(ball_file):
    picture = pellucid.render(ball_file, size=SIZE, load=LOAD)
    plane = picture.channels["G"]
    assert not plane.flags.owndata and not plane.flags.writeable
    kept = plane.copy()
    del picture
    gc.collect()
    assert (plane == kept).all()


def test_scenes_from_arrays_and_files_give_the_same_picture(ball, ball_file):
    with pellucid.Scene.load(ball_file, size="40mm", material="wholemilk", aspect=4 / 3) as scene:
        bounds = scene.bounds
        assert scene.triangles == len(ball[1]) and scene.materials
    with ball_scene(ball, aspect=4 / 3) as scene:
        assert scene.bounds == pytest.approx(bounds, abs=1e-4)
        made = pellucid.render(scene, size=SIZE)
        assert not [p for p in scene.check() if p[0] == "error"]
        read = pellucid.render(ball_file, size=SIZE, load=LOAD)
        assert pellucid.compare(made, read)["rel_mse"] < 0.05


def test_lights_camera_textures_and_coefficients(ball):
    vertices, triangles, uv = ball
    checks = (np.indices((16, 16)).sum(axis=0) % 2 * 200 + 55).astype(np.uint8)
    scene = pellucid.Scene.from_arrays(
        [{"vertices": vertices, "triangles": triangles, "uv": uv, "material": 1}],
        [{"preset": "marble"}, {"sigma_a": 0.01, "sigma_s_reduced": (1, 2, 3), "eta": 1.4, "name": "made",
                                "color_from": pellucid.lib.PELL_COLOR_FROM_TEXTURE, "base_color_map": np.stack([checks] * 3, -1)}],
        [{"type": "directional", "direction": (0, 0, -1), "power": (3, 2, 1)}],
        {"position": (0, 0, 200), "to": (0, 0, 0), "fov_deg": 15}, background=(0, 0, 0))
    image = pellucid.render(scene, size=SIZE, layers=False).rgb
    lit = image[14:34, 22:42]
    assert image[0, 0].max() == 0 and lit.mean(axis=(0, 1))[0] > lit.mean(axis=(0, 1))[2] > 0
    assert scene.materials == ["material 0", "made"]
    plain = pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], [{"sigma_a": 0.01, "sigma_s_reduced": (1, 2, 3)}])
    assert plain.hash != scene.hash


def test_an_environment_of_an_array_shines_as_it_is(ball):
    vertices, triangles, _ = ball
    lights = [{"type": "environment", "image": np.full((8, 16, 3), 0.5, np.float32)}]
    scene = pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], [{"preset": "wholemilk"}], lights)
    assert tuple(scene.c.lights[0].power) == (1, 1, 1)
    twice = pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], [{"preset": "wholemilk"}],
                                       [{**lights[0], "power": 2.0}])
    assert tuple(twice.c.lights[0].power) == (2, 2, 2)


def test_a_dict_is_a_scene_file(ball_file):
    scene = {"pellucid": 1, "mesh": ball_file.name, "size": "40mm", "materials": {"*": {"preset": "wholemilk"}},
             "render": {"method": "texture-space", "width": 32, "height": 24}}
    picture = pellucid.render(scene, load={"folder": ball_file.parent}, msaa=1)
    assert picture.method == "texture-space" and (picture.width, picture.height) == (32, 24)
    scene["materials"]["*"]["presett"] = 1
    with pytest.raises(pellucid.Error, match="presett") as e:
        pellucid.Scene.from_dict(scene, folder=ball_file.parent)
    assert "/materials" in e.value.where


def test_scenes_load_with_a_side_lights_and_a_background(ball_file):
    with pellucid.Scene.load(ball_file, from_="34", studio="rim", background="#ff0000", **LOAD) as scene:
        assert scene.c.num_lights == 3 and tuple(scene.c.background_color) == (1, 0, 0)
        assert scene.c.cameras[0].forward[0] < -0.5
    with pytest.raises(pellucid.InvalidError, match="studio"):
        pellucid.Scene.load(ball_file, environment="none.hdr", studio="rim", **LOAD)
    with pytest.raises(pellucid.FileError):
        pellucid.Scene.load(ball_file, environment="none.hdr", **LOAD)


def test_errors_carry_place_and_hint(ball_file, tmp_path):
    with pytest.raises(pellucid.InvalidError, match="^read_image: path .* has a NUL byte"):
        pellucid.read_image(f"{ball_file}\0b")
    with pytest.raises(pellucid.FileError):
        pellucid.Scene.load(tmp_path / "missing.obj")
    with pytest.raises(pellucid.InvalidError) as e:
        pellucid.Scene.load(ball_file)
    assert "ball.obj" in e.value.where and e.value.hint
    with pellucid.Scene.load(ball_file, **LOAD) as scene:
        for bad in ({"method": "screenspace"}, {"msaa": 0}, {"gausians": 3}, {"size": (0, 4)}, {"engine": "gpu"}):
            with pytest.raises(pellucid.InvalidError):
                pellucid.render(scene, **bad)
    with pytest.raises(pellucid.InvalidError):
        pellucid.render(scene)
    with pytest.raises(pellucid.InvalidError, match="length"):
        pellucid.Scene.load(ball_file, size="70")
    with pytest.raises(pellucid.InvalidError, match="triangles"):
        pellucid.Scene.from_arrays([{"vertices": np.zeros((3, 3)), "triangles": [[0, 1, 3]]}])


@pytest.mark.parametrize("size", ["16x16", (16, 16, 3), 16, (4, 0), (4, -1), (1.5, 2), ("a", "b"), np.nan])
def test_a_size_is_width_and_height(ball_file, size):
    with pellucid.Scene.load(ball_file, **LOAD) as scene:
        for what, more in ((scene, {}), (ball_file, {"load": LOAD})):
            with pytest.raises(pellucid.InvalidError, match=r"must be \(width, height\)") as e:
                pellucid.render(what, size=size, **more)
            assert e.value.where == "size"


def test_messages_of_scenes_from_arrays_begin_with_what_they_are_of(ball, caplog):
    vertices, triangles, _ = ball
    with caplog.at_level("INFO", logger="pellucid"), warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = {"vertices": vertices, "triangles": triangles[:, ::-1], "normals": np.full_like(vertices, np.nan)}
        pellucid.Scene.from_arrays([mesh]).close()
        for wrong in ({"lights": [{"power": -1}]}, {"camera": {"fov_deg": 900}}):
            with pytest.raises(pellucid.InvalidError) as e:
                pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], **wrong)
            assert str(e.value).startswith(('light "point": ', 'camera "camera": '))
    said = [str(w.message) for w in told] + caplog.messages
    assert len(told) >= 2 and caplog.messages and all(m[0].isalpha() or m[0] == '"' for m in said), said


def test_lengths_have_the_units_of_scene_files(ball_file):
    for length in ("4e7nm", "40000um", "40mm", "4cm", "0.04m", "4e-5km", f"{40 / 25.4!r}in", 40):
        with pellucid.Scene.load(ball_file, size=length) as scene:
            assert np.ptp(scene.bounds, axis=0).max() == pytest.approx(40, rel=1e-5)


def test_wrong_names_and_types_are_told_as_the_caller_gave_them(ball, ball_file):
    vertices, triangles, _ = ball
    mesh, make, load = {"vertices": vertices, "triangles": triangles}, pellucid.Scene.from_arrays, pellucid.Scene.load
    for call, words in ((lambda: pellucid.render(ball_file, load={**LOAD, "materal": "skin"}), 'did you mean "material"'),
                        (lambda: pellucid.render(ball_file, load={**LOAD, "progress": print}), '"progress"'),
                        (lambda: pellucid.render(ball_file, load="70mm"), "must be a dict"),
                        (lambda: pellucid.Scene.load(ball_file, sise="70mm"), 'did you mean "size"'),
                        (lambda: pellucid.Scene.load(ball_file, size=[1, 2]), r"^Scene.load: size is \[1, 2\], must be a number"),
                        (lambda: make([{**mesh, "normal": vertices}]), 'did you mean "normals"'),
                        (lambda: make([{"vertices": vertices}]), r"^Scene.from_arrays: meshes\[0\].triangles is missing"),
                        (lambda: make([{**mesh, "vertices": [[1, 2], [3]]}]), "^Scene.from_arrays: mesh.vertices must be numbers"),
                        (lambda: make([{**mesh, "triangles": "all"}]), "^Scene.from_arrays: mesh.triangles is 'all', must be numbers"),
                        (lambda: make([{**mesh, "material": "skin"}]), "^Scene.from_arrays: mesh.material is 'skin', must be a number"),
                        (lambda: make(mesh), "^Scene.from_arrays: meshes is .*must be a list of dicts"),
                        (lambda: make([mesh], ["marble"]), r"^Scene.from_arrays: materials\[0\] is 'marble', must be a dict"),
                        (lambda: make([mesh], {"preset": "marble"}), "^Scene.from_arrays: materials is"),
                        (lambda: make([mesh], 5), "^Scene.from_arrays: materials is 5, must be a list of dicts"),
                        (lambda: make([mesh], [{"eta": "high"}]), "^Scene.from_arrays: material 0.eta is 'high', must be a number"),
                        (lambda: make([mesh], lights=[3]), r"^Scene.from_arrays: lights\[0\] is 3, must be a dict"),
                        (lambda: make([mesh], camera="front"), "^Scene.from_arrays: camera is 'front', must be a dict"),
                        (lambda: make([mesh], camera={"to": (0, 1)}),
                         "^Scene.from_arrays: camera.to has the shape .2,., must be three numbers"),
                        (lambda: load(ball_file, from_="nowhere", **LOAD), '^Scene.load: from_: there is no "nowhere" .allowed: front'),
                        (lambda: load(ball_file, environment_rotate=90, **LOAD), "^Scene.load: environment_rotate goes with environment"),
                        (lambda: load(ball_file, up="w", **LOAD), '^Scene.load: up: there is no "w" .allowed: y, z'),
                        (lambda: pellucid.render(ball_file, "screen-spaec", load=LOAD),
                         '^render: there is no method "screen-spaec" .did you mean'),
                        (lambda: pellucid.render(ball_file, load=LOAD, engine="gpu"),
                         '^render: engine is "gpu", must be one of auto, cpu, vulkan'),
                        (lambda: pellucid.Scene.from_dict({"pellucid": object()}),
                         "^Scene.from_dict: scene is no content of a scene file: it holds"),
                        (lambda: make([mesh], [{"etaa": 2}]), '^Scene.from_arrays: material 0 has no member "etaa"'),
                        (lambda: make([mesh], lights=[{"type": "pint"}]), 'there is no type of light "pint" .did you mean "point"'),
                        (lambda: pellucid.render(ball_file, load=LOAD, light_sample=2),
                         '^render: method screen-space has no knob "light_sample" .did you mean "light_samples"'),
                        (lambda: pellucid.render(ball_file, load=LOAD, width=20), r"^render: width .*must be given as size="),
                        (lambda: pellucid.render(ball_file, load=LOAD, size_=64),
                         '^render: method screen-space has no knob "size_" .it is a knob of texture-space'),
                        (lambda: pellucid.render(ball_file, "texture-space", load=LOAD, size_=None), "^render: size is None, must be"),
                        (lambda: pellucid.render(ball_file, "texture-space", load=LOAD, lights=["sum"]), r"^render: lights is \['sum'\]"),
                        (lambda: pellucid.render(ball_file, load=LOAD, msaa=0), r"^render: msaa = 0, must be in \[1, 64\]"),
                        (lambda: pellucid.render(ball_file, load=LOAD, threads=-1),
                         r"^render: threads is -1, must be in \[0, 256\]"),
                        (lambda: pellucid.render(ball_file, load={"sise": "70mm"}),
                         '^render: load has no option "sise" .did you mean "size"')):
        with pytest.raises(pellucid.InvalidError, match=words):
            call()
    with pytest.raises(pellucid.FormatError, match="^Scene.from_arrays: holds no triangles"):
        make([])


def test_a_camera_may_look_along_its_default_up(ball):
    vertices, triangles, _ = ball
    for side in (1, -1):
        camera = {"position": (0, 200 * side, 0), "to": (0, 0, 0), "fov_deg": 15}
        with pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], camera=camera) as scene:
            assert tuple(scene.c.cameras[0].up) == (0, 0, -1)
    with pytest.raises(pellucid.InvalidError, match="camera.up"):
        pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], camera={**camera, "up": (0, 1, 0)})


def test_a_renderer_renders_again(ball):
    with ball_scene(ball) as scene, pellucid.Renderer(scene, threads=1) as renderer:
        assert renderer.threads == 1
        first = renderer.render(size=SIZE, gaussians=3)
        second = renderer.render(size=(32, 24), gaussians=3)
        again = renderer.render(size=SIZE, gaussians=3)
        assert second.rgb.shape == (24, 32, 3) and (first.rgb == again.rgb).all()


def test_progress_is_reported_and_its_exception_cancels(ball_file):
    seen = []
    pellucid.render(ball_file, "path-trace", size=(32, 24), samples=8, msaa=1, load=LOAD, progress=lambda *a: seen.append(a))
    assert seen and all(0 <= f <= 1 for _, f in seen)

    def stop(_task, _fraction):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        pellucid.render(ball_file, "path-trace", size=(64, 48), samples=4096, load=LOAD, progress=stop)


    with pellucid.Scene.load(ball_file, progress=stop_once([]), **LOAD) as scene, pellucid.Renderer(scene) as renderer:
        with pytest.raises(RuntimeError, match="enough"):
            renderer.render(size=SIZE)
        assert renderer.render(size=SIZE).rgb.max() > 0


def stop_once(seen):
    """A progress that fails in the first render."""
    def stop(task, _fraction):
        if "load" not in task and "read" not in task and not seen:
            seen.append(task)
            raise RuntimeError("enough")
    return stop


@pytest.fixture
def ctrl_c():
    """Python's own handler of SIGINT: a shell's background jobs start without it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_leaves_scene_and_renderer_usable(ball_file, ctrl_c):
    with pellucid.Scene.load(ball_file, **LOAD) as scene, pellucid.Renderer(scene) as renderer:
        timer = threading.Timer(0.7, lambda: signal.raise_signal(signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            renderer.render("path-trace", size=(640, 480), samples=100000)
        timer.cancel()
        assert renderer.render(size=SIZE).rgb.max() > 0
        assert isinstance(scene.check(), list)


def test_ctrl_c_cancels(ball_file, ctrl_c):
    timer = threading.Timer(0.7, lambda: signal.raise_signal(signal.SIGINT))
    start = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        pellucid.render(ball_file, "path-trace", size=(640, 480), samples=100000, load=LOAD)
    timer.cancel()
    assert time.monotonic() - start < 10


def test_other_threads_run_while_one_renders(ball_file):
    rendering = threading.Thread(target=pellucid.render, args=(ball_file, "path-trace"),
                                 kwargs={"size": (80, 60), "samples": 32, "threads": 1, "load": LOAD})
    turns = 0
    rendering.start()
    while rendering.is_alive():
        turns += 1
        time.sleep(0.001)
    # a progress that waits for the interpreter's lock runs when the image is complete
    assert turns > 20


def test_images_survive_files(tmp_path):
    image = np.random.default_rng(1).random((5, 7, 3), dtype=np.float32)
    for name in ("a.exr", "a.pfm"):
        pellucid.write_image(tmp_path / name, image)
        assert (pellucid.read_image(tmp_path / name) == image).all()
    assert set(pellucid.read_exr(tmp_path / "a.exr")) == {"R", "G", "B"}
    with pytest.raises(pellucid.InvalidError):
        pellucid.write_image(tmp_path / "a.exr", np.zeros((2, 2, 5)))


def test_comparing(program, tmp_path):
    rng = np.random.default_rng(2)
    a, b = rng.random((2, 32, 40, 3), dtype=np.float32)
    assert pellucid.compare(a, a)["mse"] == 0 and pellucid.compare(a, a)["ssim"] == pytest.approx(1)
    found = pellucid.compare(a, b, mask=np.ones((32, 40)))
    assert found["mse"] == pytest.approx(((a - b).astype(float) ** 2).mean()) and found.whole["mse"] == found["mse"]
    assert found.maps["flip"].shape == (32, 40)
    pellucid.write_image(tmp_path / "a.pfm", a)
    pellucid.write_image(tmp_path / "b.pfm", b)
    result = program.json("compare", tmp_path / "a.pfm", tmp_path / "b.pfm")
    whole = result["methods"][0]
    for name in ("mse", "rel_mse", "mae", "ssim", "flip"):
        assert whole[name] == pytest.approx(found[name], rel=1e-8)
    with pytest.raises(pellucid.InvalidError, match="^compare: the images have different shapes.*: test .32, 40., reference .31, 40."):
        pellucid.compare(a, b[:-1])


def test_comparing_says_what_does_not_count():
    ones, hole = np.ones((16, 20, 3)), np.ones((16, 20, 3))
    hole[2:4, 5] = np.nan
    with pytest.warns(pellucid.PellucidWarning, match="test: 2 of 320 pixels"):
        found = pellucid.compare(hole, 2 * ones)
    assert (found["bad_test"], found["bad_reference"], found["bad_variance"], found["pixels"]) == (2, 0, 0, 318)
    variance = np.zeros((16, 20, 3))
    variance[0, 0] = -1
    with pytest.warns(pellucid.PellucidWarning, match="reference: 1 of 320"):
        found = pellucid.compare(ones, 2 * ones, variance=variance)
    assert found["bad_reference"] == found["bad_variance"] == 1
    for test, reference in ((np.nan * ones, ones), (ones, np.inf * ones)):
        with pytest.raises(pellucid.InvalidError, match="no pixel is finite"):
            pellucid.compare(test, reference)
    mask = np.zeros((16, 20))
    for rows in ((0, 0), (2, 4)):
        mask[rows[0]:rows[1], 5] = 1
        with pytest.raises(pellucid.InvalidError, match="^compare: mask has no pixel"):
            pellucid.compare(hole, ones, mask=mask)
    with pytest.raises(pellucid.InvalidError, match="test"):
        pellucid.compare([["x", "y"]], ones)


def test_a_pass_writes_into_the_callers_planes():
    shape = (16, 256)
    light = np.zeros((3, *shape), np.float32)
    irradiance = np.zeros((3, *shape), np.float32)
    irradiance[:, :, 128:] = 100
    planes = {"material": np.ones(shape, np.uint16), "depth": np.full(shape, 500, np.float32), "irradiance": irradiance}
    marble = pellucid.Medium.material("marble")
    with pellucid.Pass("screen-space", shape, [marble], 10.0, gaussians=6, lod=2) as scatter:
        scatter.render({"light": light}, **planes)
        total = pellucid.fit(marble, 6).total
        assert light[:, 8, 250] == pytest.approx(100 * total, rel=0.03) and light[:, 8, 128] == pytest.approx(50 * total, rel=0.12)
        wrong = {"light of another type": light.astype(float), "light of another shape": light[:, :-1], "light with gaps": light[:, :, ::-1]}
        for value in wrong.values():
            with pytest.raises(pellucid.InvalidError, match="light"):
                scatter.render({"light": value}, **planes)
        with pytest.raises(pellucid.InvalidError, match='^Pass.render: there is no plane "irradiances" .did you mean "irradiance"'):
            scatter.render({"light": light}, irradiances=irradiance)
    with pytest.raises(pellucid.Error):
        pellucid.Pass("path-trace", shape, [marble], 10.0)


def test_a_pass_refuses_wrong_numbers_masks_and_missing_media():
    shape, marble = (8, 8), pellucid.Medium.material("marble")
    planes = {"material": np.ones(shape, np.uint16), "depth": np.full(shape, 500, np.float32), "irradiance": np.ones((3, *shape), np.float32)}
    out = {"light": np.zeros((3, *shape), np.float32)}
    with pellucid.Pass("screen-space", shape, [marble], 10.0) as scatter:
        for name, value in (("material", np.full(shape, 2, np.uint16)), ("depth", np.ma.masked_less(planes["depth"], 0)), ("irradiance", None)):
            with pytest.raises(pellucid.InvalidError, match=name):
                scatter.render(out, **{**planes, name: value})
        scatter.render(out, **planes)
    with pytest.raises(pellucid.InvalidError, match="media"):
        pellucid.Pass("screen-space", shape, [], 10.0)


def test_arrays_with_masked_values_are_refused_and_bad_normals_are_reported(ball):
    vertices, triangles, _ = ball
    with pytest.raises(pellucid.InvalidError, match="masked"):
        pellucid.Scene.from_arrays([{"vertices": np.ma.masked_greater(vertices, 0), "triangles": triangles}])
    with pytest.warns(pellucid.PellucidWarning, match="normals are not finite"):
        pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles, "normals": np.full_like(vertices, np.nan)}]).close()


@pytest.mark.parametrize("method, knobs", [("screen-space", {}), ("image-space", {"views": "eye"}), ("convolution", {"surfaces": 1})])
def test_a_pass_over_the_planes_of_a_render_is_that_render(ball, method, knobs):
    material, fov, distance = "skin-6gaussian", 20.0, 200.0
    vertices, triangles, _ = ball
    view = {"camera": {"position": [0, 0, distance], "to": [0, 0, 0], "fov_deg": fov},
            "lights": [{"type": "point", "position": [-60, 70, 90], "power": [5, 5, 5]}]}
    with pellucid.Scene.from_arrays([{"vertices": vertices, "triangles": triangles}], [{"preset": material}], **view) as scene, \
            pellucid.Renderer(scene) as renderer:
        images = renderer.render(method, size=SIZE, msaa=1, intermediates=True, **knobs).intermediates
    planes = {}
    for name in ("material", "depth", "strength", "irradiance", "normal"):
        plane = images[f"frame.{name}"].data
        plane = plane if plane.ndim == 2 else np.moveaxis(plane, 2, 0)
        planes[name] = np.ascontiguousarray(plane, np.uint16 if name == "material" else np.float32)
    light = np.zeros((3, SIZE[1], SIZE[0]), np.float32)
    focal = SIZE[1] / 2 / np.tan(np.radians(fov / 2))
    with pellucid.Pass(method, light.shape[1:], [pellucid.material(material)["gaussians"]], focal, perspective=True, **knobs) as scatter:
        scatter.render({"light": light}, **planes)
    covered = planes["material"] > 0
    assert covered.sum() > 100 and light[:, covered].mean() > 1
    assert (light[:, covered] == np.moveaxis(images["frame.light"].data, 2, 0)[:, covered]).all()


def test_methods_tell_their_knobs():
    found = pellucid.methods()
    assert found["screen-space"]["knobs"]["gaussians"]["default"] > 0 and found["path-trace"]["reference"]
