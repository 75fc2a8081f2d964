# SPDX-License-Identifier: MIT
"""Every script of python/examples draws its figure."""
import json
import os
import pathlib
import runpy
import subprocess
import sys

import pytest

SCRIPTS = sorted((pathlib.Path(__file__).resolve().parents[1] / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_an_example_draws_its_figure(script, ball_file, tmp_path):
    pytest.importorskip("matplotlib")
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"pellucid": 1, "mesh": ball_file.name, "size": "40mm", "materials": {"*": {"preset": "marble"}},
                                 "render": {"msaa": 1, "bounces": 0}}), "utf-8")
    out = tmp_path / "figure.png"
    arguments = [str(scene), str(out)] if "def main(scene" in script.read_text("utf-8") else [str(out)]
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, str(script), *arguments], env=environment, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
    assert out.read_bytes()[:4] == b"\x89PNG" and out.stat().st_size > 5000


@pytest.mark.parametrize("script", [s for s in SCRIPTS if "def main(scene" in s.read_text("utf-8")], ids=lambda path: path.name)
def test_an_example_without_its_scene_says_its_usage(script):
    pytest.importorskip("matplotlib")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stderr == f"usage: {script.name} SCENE [OUT.png]\n"


@pytest.mark.parametrize("name", ["colors", "gaussians", "skin_layers"])
def test_curves_of_an_example_differ_and_have_names(name, tmp_path, monkeypatch):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot  # pylint: disable=import-outside-toplevel # where it is installed
    script = runpy.run_path(str(SCRIPTS[0].parent / f"{name}.py"))
    script["main"](str(tmp_path / "out.png"))
    axis = pyplot.gcf().axes[0]
    lines = [line.get_xydata().tobytes() for line in axis.get_lines()]
    names = [t.get_text() for t in axis.get_legend().get_texts()]
    assert len(lines) > 2 and len(set(lines)) == len(lines) and len(set(names)) == len(names)
    assert not any(n.startswith("1 Gaussians") for n in names) and (name != "skin_layers" or names[0].startswith("red"))
    pyplot.close("all")
