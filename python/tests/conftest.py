# SPDX-License-Identifier: MIT
import json
import os
import subprocess

import numpy as np
import pytest

PROGRAM = os.environ.get("PELLUCID_PROGRAM", "pellucid")


def sphere(radius, rings=16, slices=32):
    """A closed ball: vertices (n, 3), triangles (m, 3), uv (n, 2)."""
    t, f = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, slices + 1), indexing="ij")
    vertices = radius * np.stack([np.sin(t) * np.cos(f), np.cos(t), -np.sin(t) * np.sin(f)], axis=-1).reshape(-1, 3)
    vertices[np.arange(rings + 1) * (slices + 1) + slices] = vertices[np.arange(rings + 1) * (slices + 1)]
    a = (np.arange(rings)[:, None] * (slices + 1) + np.arange(slices)).ravel()
    b = a + slices + 1
    triangles = np.concatenate([np.stack([a, b, a + 1], -1), np.stack([a + 1, b, b + 1], -1)])
    uv = np.stack([f / (2 * np.pi), t / np.pi], axis=-1).reshape(-1, 2)
    return vertices, triangles, uv


@pytest.fixture
def ball():
    return sphere(20.0)


@pytest.fixture
def ball_file(tmp_path, ball):
    path = tmp_path / "ball.obj"
    vertices, triangles, _ = ball
    path.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()) +
                    "".join(f"f {a} {b} {c}\n" for a, b, c in (triangles + 1).tolist()))
    return path


@pytest.fixture
def program():
    def run(*words):
        return subprocess.run([PROGRAM, *map(str, words)], check=True, capture_output=True, text=True).stdout

    run.json = lambda *words: json.loads(run(*words, "--json"))
    return run
