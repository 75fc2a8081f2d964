# SPDX-License-Identifier: MIT
"""The code of docs/guide/python.md runs as it stands there."""
import pathlib
import re
import shutil

import numpy as np

GUIDE = pathlib.Path(__file__).resolve().parents[2] / "docs/guide/python.md"


def test_the_guides_code_runs(ball_file, tmp_path, monkeypatch):
    blocks = re.findall(r"^```python\n(.*?)^```", GUIDE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    shutil.copy(ball_file, tmp_path / "bunny.obj")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(compile(block, str(GUIDE), "exec"), names)  # pylint: disable=exec-used # the point of the test
    assert isinstance(names["values"], np.ndarray) and names["picture"].rgb.shape == (360, 640, 3)
