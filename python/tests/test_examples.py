# SPDX-License-Identifier: MIT
"""Every script of python/examples draws its figure."""
import json
import os
import pathlib
import subprocess
import sys

import pytest

SCRIPTS = sorted((pathlib.Path(__file__).resolve().parents[1] / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_an_example_draws_its_figure(script, ball_file, tmp_path):
    pytest.importorskip("matplotlib")
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"pellucid": 1, "mesh": ball_file.name, "size": "40mm", "materials": {"*": {"preset": "marble"}},
                                 "render": {"msaa": 1}}), "utf-8")
    out = tmp_path / "figure.png"
    arguments = [str(scene), str(out)] if "def main(scene" in script.read_text("utf-8") else [str(out)]
    done = subprocess.run([sys.executable, str(script), *arguments], env={**os.environ, "MPLBACKEND": "Agg"}, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
    assert out.read_bytes()[:4] == b"\x89PNG" and out.stat().st_size > 5000
