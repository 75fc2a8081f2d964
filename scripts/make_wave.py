#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_wave.py FOLDER: writes wave.glb, a strip of 120 x 60 x 8 mm with a travelling wave: the deforming mesh of the examples, after
figure 10 of d'Eon, Luebke and Enderton (2007).

A travelling wave is cos(kx) cos(wt) + sin(kx) sin(wt): two morph targets and their weights. It stretches the surface up to 1.9 times.
The targets have no normals, which could not be summed: the reader computes them for the deformed shape."""
import json
import math
import pathlib
import struct
import sys

LENGTH, WIDTH, THICKNESS = 0.120, 0.060, 0.008  # m
AMPLITUDE, WAVES, PERIOD = 0.008, 4, 2.0        # m, wavelengths in the strip, s
COLUMNS, ROWS = 112, 28
KEYS = 16


class Strip:
    """Charts without common vertices; each is a grid of u x v in its own rectangle of the texture."""

    def __init__(self):
        self.points, self.uvs, self.indices = [], [], []

    def chart(self, columns, rows, rectangle, point):
        first = len(self.points)
        u0, v0, u1, v1 = rectangle
        for j in range(rows + 1):
            for i in range(columns + 1):
                u, v = i / columns, j / rows
                self.points.append(point(u, v))
                self.uvs.append((u0 + u * (u1 - u0), v0 + v * (v1 - v0)))
        for j in range(rows):
            for i in range(columns):
                a = first + j * (columns + 1) + i
                b = a + columns + 1
                self.indices += [a, b, a + 1, a + 1, b, b + 1]


def strip():
    x, y, z = LENGTH / 2, THICKNESS / 2, WIDTH / 2

    def line(a, b, t):
        return a + (b - a) * t

    s = Strip()
    s.chart(COLUMNS, ROWS, (0.02, 0.02, 0.98, 0.44), lambda u, v: (line(-x, x, u), y, line(-z, z, v)))      # top
    s.chart(COLUMNS, ROWS, (0.02, 0.46, 0.98, 0.88), lambda u, v: (line(-x, x, u), -y, line(z, -z, v)))     # bottom
    s.chart(COLUMNS, 4, (0.02, 0.90, 0.98, 0.93), lambda u, v: (line(-x, x, u), line(y, -y, v), z))         # front
    s.chart(COLUMNS, 4, (0.02, 0.94, 0.98, 0.97), lambda u, v: (line(x, -x, u), line(y, -y, v), -z))        # back
    s.chart(ROWS, 4, (0.02, 0.975, 0.48, 0.99), lambda u, v: (x, line(y, -y, v), line(z, -z, u)))           # right
    s.chart(ROWS, 4, (0.52, 0.975, 0.98, 0.99), lambda u, v: (-x, line(y, -y, v), line(-z, z, u)))          # left
    return s


def wave(s):
    """The targets, and the weights at the keys with their tangents: a cubic through both."""
    k, w = 2 * math.pi * WAVES / LENGTH, 2 * math.pi / PERIOD
    targets = [[(0.0, AMPLITUDE * f(k * p[0]), 0.0) for p in s.points] for f in (math.cos, math.sin)]
    times = [PERIOD * i / KEYS for i in range(KEYS + 1)]
    weights = []
    for i in range(KEYS + 1):
        angle = 2 * math.pi * (i % KEYS) / KEYS  # the last key is the first, bit by bit
        value, slope = (math.cos(angle), math.sin(angle)), (-w * math.sin(angle), w * math.cos(angle))
        weights += [*slope, *value, *slope]
    return targets, times, weights


def glb(s):
    targets, times, weights = wave(s)
    data, views, accessors = b"", [], []

    def add(form, component, kind, values, **more):
        nonlocal data
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[kind]
        packed = struct.pack(f"<{len(values)}{form}", *values)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values) // width, "type": kind, **more})
        data += packed + bytes(-len(packed) % 4)
        return len(accessors) - 1

    def points(list_of):
        return add("f", 5126, "VEC3", [c for p in list_of for c in p], min=[min(p[c] for p in list_of) for c in range(3)],
                   max=[max(p[c] for p in list_of) for c in range(3)])

    primitive = {
        "attributes": {"POSITION": points(s.points), "TEXCOORD_0": add("f", 5126, "VEC2", [c for uv in s.uvs for c in uv])},
        "indices": add("I", 5125, "SCALAR", s.indices),
        "targets": [{"POSITION": points(t)} for t in targets],
        "material": 0,
    }
    sampler = {"input": add("f", 5126, "SCALAR", times, min=[times[0]], max=[times[-1]]),
               "output": add("f", 5126, "SCALAR", weights), "interpolation": "CUBICSPLINE"}
    text = json.dumps({
        "asset": {"version": "2.0"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "strip"}],
        "meshes": [{"name": "strip", "primitives": [primitive], "weights": [0, 0]}],
        "materials": [{"name": "Strip", "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.4}}],
        "animations": [{"name": "wave", "samplers": [sampler],
                        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}],
        "buffers": [{"byteLength": len(data)}], "bufferViews": views, "accessors": accessors,
    }, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


if __name__ == "__main__":
    pathlib.Path(sys.argv[1], "wave.glb").write_bytes(glb(strip()))
