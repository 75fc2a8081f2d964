#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the still lifes of the gallery, in millimetres: a hand, a vase with deep folds, a candle with its flame, fruit on a plate, cups, a
beech leaf, and a studio environment.

    make_models.py FOLDER [NAME ...]

Solids are closed and oriented outward; the leaf is a sheet. Colours are per vertex or in maps next to the mesh. Deterministic.
"""
import sys
from pathlib import Path

import numpy as np

sys.dont_write_bytecode = True  # the folder of the sources stays as it is
import sdf
from make_assets import write_obj
from sdf import FLOAT, chain, cone, curve, cut, ellipsoid, join, length, meet, noise, points, sphere


def save(folder, name, solid, uv=None, color=None):
    sdf.write_ply(folder / f'{name}.ply', *solid, uv, color)


def grid_normals(vertices, faces):
    """Means of the faces' normals, by area."""
    t = sdf.triangles(faces)
    n = np.cross(vertices[t[:, 1]] - vertices[t[:, 0]], vertices[t[:, 2]] - vertices[t[:, 0]])
    total = np.stack([sum(np.bincount(t[:, k], n[:, a], len(vertices)) for k in range(3)) for a in range(3)], 1)
    return total / np.maximum(np.sqrt((total ** 2).sum(1, keepdims=True)), 1e-12)


def revolved(rows, columns, position):
    """position(s, theta) -> (x, y, z) of arrays, s 0 at the lower pole and 1 at the upper; closed, with u, v = theta, s."""
    s, t = np.meshgrid(np.arange(rows + 1) / rows, np.arange(columns + 1) / columns * 2 * np.pi, indexing='ij')
    vertices = np.stack(position(s, t), -1)
    vertices[:, -1] = vertices[:, 0]
    vertices[0], vertices[-1] = vertices[0].mean(0), vertices[-1].mean(0)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing='ij')
    n = columns + 1
    quad = np.stack([i * n + j, i * n + j + 1, (i + 1) * n + j + 1, (i + 1) * n + j], -1)
    faces = np.concatenate([quad[0][:, [0, 2, 3]], sdf.triangles(quad[1:-1].reshape(-1, 4)), quad[-1][:, [0, 1, 2]]])
    uv = np.stack([t / (2 * np.pi), s], -1).reshape(-1, 2)
    vertices = vertices.reshape(-1, 3)
    # Normals of the welded surface: the seam and the poles share their normals.
    weld = (np.arange(rows + 1)[:, None] * n + np.arange(n) % columns).reshape(-1)
    weld[:n], weld[-n:] = 0, rows * n
    return (vertices, grid_normals(vertices, weld[faces])[weld], faces), uv


# --- A hand ---------------------------------------------------------------------------------------------------------------------------

# Knuckles and joints to the tip: (x, y, z, radius); the palm faces +z, the fingers point up.
FINGERS = [
    [(-27, 88, 0, 9.2), (-32, 131, 5, 8.1), (-33.5, 154, 10, 7.2), (-34, 171, 16, 6.0)],
    [(-8.5, 93, -1, 9.5), (-9.5, 139, 4, 8.3), (-9.5, 166, 9, 7.5), (-9.0, 185, 15, 6.2)],
    [(10, 90, -1, 9.2), (14, 132, 5, 8.0), (16, 157, 11, 7.1), (16.5, 174, 18, 5.9)],
    [(27, 82, 1, 8.4), (36, 114, 7, 7.0), (40, 132, 12, 6.3), (42, 147, 17, 5.3)],
]
THUMB = [(-27, 24, 8, 14.0), (-45, 52, 17, 11.0), (-59, 80, 20, 9.3), (-67, 101, 19, 7.4)]


def hand_solid(p):
    x, y, z = p
    d = join(ellipsoid(p, (0, 56, 0), (36, 50, 13)), ellipsoid(p, (1, 74, 0), (38, 22, 11.5)), 10)
    d = join(d, cone(p, (2, -56, -2), (1, 14, -1), 23, 25), 22)
    d = join(d, ellipsoid(p, (-24, 38, 9), (15, 27, 11)), 9)
    d = join(d, ellipsoid(p, (26, 38, 6), (10, 30, 9)), 9)
    for finger in FINGERS:
        f = chain(p, finger)
        for a, b, k in zip(finger, finger[1:], (1.0, 0.8, 0.6)):  # the pads between the joints
            m = [(u + v) / 2 for u, v in zip(a, b)]
            f = join(f, ellipsoid(p, (m[0], m[1], m[2] + 2.2 * k), (m[3] * 0.92, 0.4 * (b[1] - a[1]), m[3] * 0.86)), 3)
        for knuckle in finger[1:3]:
            kx, ky, kz, r = knuckle
            f = join(f, ellipsoid(p, (kx, ky, kz - r * 0.5), (r * 0.8, 6, r * 0.62)), 3)
            f = cut(f, cone(p, (kx - r, ky, kz + r + 0.9), (kx + r, ky, kz + r + 0.9), 1.0), 1.6)
        d = join(d, f, 5.0)
    t = chain(p, THUMB)
    t = join(t, ellipsoid(p, (-65, 96, 21.5), (7.6, 11, 6.6)), 4)
    d = join(d, t, 10.0)
    d = cut(d, chain(p, curve([(-33, 66, 16.5, 1.2), (-10, 60, 15.0, 1.4), (6, 38, 16.4, 1.4), (4, 16, 19, 1.0)])), 3.5)
    d = cut(d, chain(p, curve([(36, 64, 14.5, 1.0), (14, 68, 14.4, 1.3), (-14, 80, 14.2, 1.0)])), 3.0)
    for finger in FINGERS:  # tendons on the back
        d = join(d, cone(p, (0.3 * finger[0][0], 22, -13.5), (finger[0][0], 86, -7.5), 2.0, 3.0), 7)
    for tip in (finger[-1] for finger in FINGERS):  # nails
        d = join(d, ellipsoid(p, (tip[0], tip[1] - 1.0, tip[2] - tip[3] * 0.72), (tip[3] * 0.74, 6.2, 1.9)), 0.8)
    return meet(d, -FLOAT(46.0) - y, 4)


def hand(folder):
    solid = sdf.mesh(hand_solid, (-95, -70, -40), (75, 205, 50), 1.0)
    p = np.ascontiguousarray(solid[0].T.astype(FLOAT))
    b = 0.35 + 0.25 * (noise(p, 7, 1) - 0.5) + 0.2 * (noise(p, 2.5, 2) - 0.5)
    for finger in FINGERS + [THUMB]:
        b = b + 0.5 * np.exp(-((p - points(*finger[-1][:3])) ** 2).sum(0) / 170)
        for joint in finger[:3]:
            b = b + 0.16 * np.exp(-((p - points(*joint[:3])) ** 2).sum(0) / 110)
    color = np.array([0.70, 0.52, 0.42]) * np.exp(-0.25 * np.array([0.36, 0.58, 0.86]) - b[:, None] * np.array([0.10, 0.56, 0.47]))
    save(folder, 'hand', solid, color=color)


# --- A vase ---------------------------------------------------------------------------------------------------------------------------

def vase_radius(y, theta):
    """The outside: a body with folds that run around it as they rise, deep in the middle, none at the foot."""
    s = np.clip(y / 150, 0, 1)
    body = 27 + 24 * np.maximum(np.sin(np.pi * np.clip(s * 1.08, 0, 1) ** 0.9), 0) ** 1.2 + 13 * np.clip((s - 0.72) / 0.28, 0, 1) ** 2
    a = 9 * (theta + 1.15 * s + 0.10 * np.sin(5 * s + 2 * theta))
    fold = (np.sin(a / 2) ** 2 + 0.02) ** 0.4
    deep = 0.30 * np.clip(s / 0.25, 0, 1) ** 1.5
    return body * (1 - deep + deep * 1.15 * fold)


def vase_solid(p):
    x, y, z = p
    r, theta = np.hypot(x, z), np.arctan2(x, z)
    outside = (r - vase_radius(y, theta)) * FLOAT(0.55)
    inside = outside + FLOAT(2.6)
    d = meet(outside, np.maximum(y - 150, -y), 2.0)
    return cut(d, np.maximum(inside, 5 - y), 1.5).astype(FLOAT)


def vase(folder):
    save(folder, 'vase', sdf.mesh(vase_solid, (-72, -6, -72), (72, 158, 72), 1.2))


# --- A candle -------------------------------------------------------------------------------------------------------------------------

# Angle, length, radius.
DRIPS = [(0.9, 34, 3.6), (2.3, 40, 3.0), (3.3, 62, 3.6), (4.4, 26, 2.8), (5.6, 46, 3.4)]


def candle_solid(p):
    x, y, z = p
    theta = np.arctan2(x, z)
    r = np.hypot(x, z) + FLOAT(0.5) * np.sin(3 * theta + 0.03 * y) + FLOAT(0.9) * (noise(p, 26, 1) - FLOAT(0.5))
    top = 104 + FLOAT(2.2) * np.sin(theta + 0.6) + FLOAT(1.3) * np.sin(3 * theta)
    d = meet(r - FLOAT(24), np.maximum(y - top, -y), 3.0)
    for angle, run, radius in DRIPS:
        s, c = np.sin(angle), np.cos(angle)
        low = 102 - run
        drip = chain(p, curve([(22 * s, 103, 22 * c, radius), (24.6 * s, 90 - 0.2 * run, 24.6 * c, 0.85 * radius),
                               (24.0 * s + 0.8, low + 10, 24.0 * c, 0.8 * radius),
                               (22.6 * s + 0.8, low, 22.6 * c, 0.7 * radius)], 3))
        d = join(d, drip, 7.0)
    pool = ellipsoid(p, (0, 106, 0), (19.5, 9.5, 19.5))
    return cut(d, pool, 2.0)


def flame_shape(rows=60, columns=48):
    t = (np.arange(rows + 1) / rows)
    radius = 5.2 * np.sin(np.pi * t ** 0.62) ** 1.15 * (1 - 0.25 * t) + 0.02
    return t * 36, radius


def candle(folder):
    save(folder, 'candle', sdf.mesh(candle_solid, (-36, -5, -36), (36, 115, 36), 0.8))
    save(folder, 'wick',
         sdf.mesh(lambda p: chain(p, curve([(0, 94, 0, 0.95), (0.3, 101, 0, 0.9), (1.2, 107, 0.2, 0.75)])), (-4, 90, -4), (5, 112, 4),
                  0.35))
    heights, radius = flame_shape()
    (vertices, _, faces), uv = revolved(60, 48, lambda s, t: (
        np.interp(s * 36, heights, radius) * np.sin(t) + 1.0 + 1.6 * s ** 2, 104 + 36 * s, np.interp(s * 36, heights, radius) * np.cos(t)))
    keep, index = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    first = np.zeros(len(keep), int)
    first[index.reshape(-1)] = np.arange(len(vertices))
    faces = index.reshape(-1)[faces]
    write_obj(folder / 'flame.obj', 'the flame of a candle', [tuple(v) for v in keep], [tuple(f) for f in faces],
              [tuple(w) for w in uv[first]])
    text = (folder / 'flame.obj').read_text('utf-8').split('\n')
    text[1:1] = ['mtllib flame.mtl', 'usemtl Flame']
    (folder / 'flame.obj').write_text('\n'.join(text), 'utf-8')
    (folder / 'flame.mtl').write_text('# made by scripts/make_models.py\nnewmtl Flame\nKd 0 0 0\nKs 0 0 0\nKe 60 60 60\nmap_Ke flame.png\n',
                                      'utf-8')
    s = (1 - (np.arange(128) + 0.5) / 128)[:, None, None]  # rows from the top
    hot, blue = np.clip((s - 0.12) / 0.25, 0, 1), np.exp(-(s / 0.10) ** 2)
    color = hot * np.array([1.0, 0.72, 0.30]) * (1 - 0.35 * np.clip((s - 0.6) / 0.4, 0, 1)) + blue * np.array([0.05, 0.12, 0.45])
    sdf.write_png(folder / 'flame.png', sdf.srgb(np.repeat(color, 8, 1)))


# --- Fruit ----------------------------------------------------------------------------------------------------------------------------

def bunch(count, radius, seed):
    """Centres of grapes in a heap on the plate: points of a spiral, pushed away from each other and down until none touches another."""
    rng = np.random.RandomState(seed)
    c = rng.uniform(-1, 1, (count, 3)) * np.array([30, 12, 20]) + np.array([0, 22, 0])
    for step in range(400):
        d = c[:, None] - c[None]
        r = np.sqrt((d ** 2).sum(-1)) + np.eye(count) * 1e3
        push = np.maximum(2.02 * radius - r, 0)[..., None] * d / r[..., None] * 0.45
        c += push.sum(1)
        c += (np.array([0, 0, 0]) - c) * np.array([0.012, 0, 0.012]) * (step < 300)
        c[:, 1] -= 0.25 * (step < 300)
        c[:, 1] = np.maximum(c[:, 1], radius)
    return c


def balls(centres, radii, tall, seed, rows=40, columns=56):
    rng, parts, base = np.random.RandomState(seed), [], 0
    for c, r in zip(centres, radii):
        (v, n, f), _ = revolved(rows, columns, lambda s, t: (
            r * np.sin(np.pi * s) * np.sin(t), -tall * r * np.cos(np.pi * s), r * np.sin(np.pi * s) * np.cos(t)))
        a, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        a *= np.sign(np.linalg.det(a))
        parts.append((v @ a.T + c, n @ a.T, f + base))
        base += len(v)
    return tuple(np.concatenate(k) for k in zip(*parts))


def apple_position(s, t):
    a = np.pi * (s - 0.5)
    r = 37 * np.cos(a) ** 0.82 * (1 + 0.07 * np.sin(a)) * (1 + 0.018 * np.cos(5 * t + 0.4) * (1 - s) + 0.014 * np.sin(2 * t + 1))
    y = 34 * np.sin(a) - 13 * np.exp(-(r / 10) ** 2) * (np.sin(a) > 0) * 1.15 + 9 * np.exp(-(r / 9) ** 2) * (np.sin(a) < 0)
    return r * np.sin(t), y + 33.5, r * np.cos(t)


def orange_position(s, t):
    a = np.pi * (s - 0.5)
    r = 36 * np.cos(a) * (1 + 0.012 * np.sin(3 * t) + 0.01 * np.cos(2 * t + 1))
    return r * np.sin(t), 34.5 * np.sin(a) + 34.5 - 2.2 * np.exp(-(r / 5.0) ** 2) * np.sign(np.sin(a)), r * np.cos(t)


def ball_map(size):
    """Points on the unit sphere of the texels of a map of u, v = theta, s."""
    v, u = np.mgrid[0:size, 0:size]
    s, t = 1 - (v + 0.5) / size, (u + 0.5) / size * 2 * np.pi
    a = np.pi * (s - 0.5)
    return np.stack([np.cos(a) * np.sin(t), np.sin(a), np.cos(a) * np.cos(t)]).reshape(3, -1).astype(FLOAT), s, t


def fruit(folder):
    centres = bunch(44, 10.0, 5)
    save(folder, 'grapes', balls(centres + np.array([36, 5, 32]), np.linspace(9.2, 10.0, 44), 1.12, 6))
    for name, position in (('apple', apple_position), ('orange', orange_position)):
        solid, uv = revolved(160, 256, position)
        save(folder, name, solid, uv)
    size = 768
    p, s, t = ball_map(size)
    streak = noise(np.stack([np.sin(t) * 16, np.cos(t) * 16, s * 3.0]).reshape(3, -1).astype(FLOAT), 1.0, 41)
    blush = np.clip(0.62 + 0.55 * p[2] + 0.75 * (streak - 0.5) + 0.5 * (noise(p, 0.5, 42) - 0.5), 0, 1)[:, None]
    dots = np.clip(noise(p, 0.045, 43) - 0.80, 0, 1)[:, None] * 2.2
    pit = np.exp(-((1 - s) / 0.075) ** 2).reshape(-1, 1)
    color = np.array([0.62, 0.50, 0.10]) * (1 - blush) + np.array([0.44, 0.030, 0.028]) * blush
    color = color * (1 - 0.7 * pit) + np.array([0.40, 0.38, 0.10]) * 0.7 * pit + dots * np.array([0.5, 0.4, 0.2])
    sdf.write_png(folder / 'apple-color.png', sdf.srgb(color.reshape(size, size, 3)))
    height = 0.55 * np.clip(noise(p, 0.055, 44) - 0.45, 0, 1) + 0.25 * noise(p, 0.11, 45)
    sdf.write_png(folder / 'orange-normal.png', sdf.normal_map(-height.reshape(size, size) * FLOAT(1.6), (36 * p.T).reshape(size, size, 3)))
    save(folder, 'stem',
         sdf.mesh(lambda q: chain(q, curve([(0, 50, 0, 1.5), (0.6, 62, 0.3, 1.2), (3.2, 72, 1.0, 1.7)])), (-5, 46, -5), (8, 77, 6), 0.5))
    save(folder, 'plate', revolved(320, 256, lambda s, t: lathe(PLATE, s, t))[0])


# Radius, height; from below to above.
PLATE = [(0, 0.6), (30, 0.6), (57, 0.4), (60, -0.8), (63, -0.8), (66, 0.6), (80, 2.0), (104, 9.5), (120, 17.5), (122.2, 19.4),
         (122.4, 20.6), (121.4, 21.4), (119, 20.6), (103, 12.6), (80, 5.2), (66, 3.9), (30, 3.8), (0, 3.8)]


# The same, and facets on the outside.
CUP = [(0, 1.4), (12, 1.4), (16.5, 0), (19.5, 0), (21.5, 2), (29, 13), (35, 32), (38.6, 58), (39.6, 61.4), (39.2, 63.2), (37.8, 63),
       (36.4, 59), (33.2, 40), (28.4, 24), (20, 12), (10, 8.2), (0, 7.4)]
FACETS = 10


def lathe(profile, s, t, facets=0):
    points = np.array([k[:2] for k in curve([(r, y, 0, 0) for r, y in profile], 12)])
    at = np.concatenate([[0], np.cumsum(np.sqrt((np.diff(points, axis=0) ** 2).sum(1)))])
    r, y = (np.interp(s * at[-1], at, points[:, k]) for k in range(2))
    if facets:
        cut = np.clip((y - 6) / 6, 0, 1) * np.clip((50 - y) / 10, 0, 1) * (s < 0.5)
        around = (t * facets / (2 * np.pi) + 0.5) % 1 - 0.5
        r = r * (1 + cut * (np.cos(np.pi / facets) / np.cos(2 * np.pi / facets * around) - 1))
    r = np.where((s == 0) | (s == 1), 0, np.maximum(r, 0.01))
    return r * np.sin(t), y, r * np.cos(t)


def cups(folder):
    save(folder, 'cup', revolved(200, 240, lambda s, t: lathe(CUP, s, t, FACETS))[0])


# --- A leaf ---------------------------------------------------------------------------------------------------------------------------

LEAF_LENGTH = 90.0


def leaf_half_width(s):
    return 27 * np.sin(np.pi * np.clip(s, 0, 1) ** 0.85) ** 0.75 * (1 - 0.22 * s) + 0.5


def leaf_veins(s, w):
    """Distance in mm to the nearest vein, and its thickness; w from -1 to 1 across."""
    across = np.abs(w) * leaf_half_width(s)
    along = s * LEAF_LENGTH
    origin = along - 0.72 * across - 0.006 * across ** 2
    gap = 9.2
    side = np.abs((origin - 6 + np.where(w < 0, 0.5 * gap, 0)) % gap - gap / 2) * 0.8
    fine = np.abs((along + 0.55 * across) % 2.1 - 1.05)
    return np.minimum(across / (1.25 - 0.9 * s), side / (0.45 * (1 - 0.75 * np.abs(w)))), fine


def beech(folder, rows=220, columns=120):
    s, w = np.meshgrid(np.arange(rows + 1) / rows, np.linspace(-1, 1, columns + 1), indexing='ij')
    half = leaf_half_width(s) * (1 + 0.035 * np.abs(np.sin(s * 31)) * np.abs(w) ** 3)
    vein, _ = leaf_veins(s, w)
    x, y = half * w, s * LEAF_LENGTH
    z = 7 * np.sin(2.2 * s) - 0.009 * half * half * w * w + 2.2 * np.sin(5 * s + 2 * w) * w * w
    z = z + 0.9 * np.minimum(vein, 4) / 4 * np.sin(np.pi * s)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing='ij')
    n = columns + 1
    faces = np.stack([i * n + j, i * n + j + 1, (i + 1) * n + j + 1, (i + 1) * n + j], -1).reshape(-1, 4)
    uv = np.stack([0.5 + 0.49 * w, 0.01 + 0.98 * s], -1).reshape(-1, 2)
    save(folder, 'beech', (vertices, grid_normals(vertices, faces), faces), uv)
    save(folder, 'stalk', sdf.mesh(lambda q: chain(q, curve([(0, 8, 0.9, 0.6), (0, 0, 0.2, 0.8), (-1, -14, -1, 0.8), (-5, -30, -4, 1.1)])),
                                   (-9, -34, -8), (4, 12, 5), 0.4))
    size = 1024
    v, u = np.mgrid[0:size, 0:size]
    s, w = (1 - (v + 0.5) / size - 0.01) / 0.98, ((u + 0.5) / size - 0.5) / 0.49
    s = np.clip(s, 0, 1)
    vein, fine = leaf_veins(s, w)
    line, thread = np.exp(-vein ** 2)[..., None], np.exp(-(fine / 0.22) ** 2)[..., None]
    p = np.stack([w * 27, s * LEAF_LENGTH, 0 * s]).reshape(3, -1).astype(FLOAT)
    spread = (0.6 * noise(p, 9, 51) + 0.4 * noise(p, 2.2, 52)).reshape(size, size, 1)
    autumn = np.clip((np.abs(w) - 0.55) * 1.6 + 1.4 * (spread[..., 0] - 0.45) + 0.5 * (s - 0.6), 0, 1)[..., None]
    lit = np.array([0.28, 0.44, 0.035]) * (0.7 + 0.6 * spread) * (1 - autumn) + np.array([0.80, 0.36, 0.03]) * autumn
    lit = lit * (1 - 0.16 * thread) * (1 - 0.45 * line)  # veins are thick: they transmit less light
    seen = np.array([0.075, 0.15, 0.022]) * (0.8 + 0.4 * spread) * (1 - autumn) + np.array([0.38, 0.15, 0.02]) * autumn
    seen = seen * (1 - 0.5 * line) + np.array([0.26, 0.30, 0.10]) * 0.5 * line
    sdf.write_png(folder / 'beech-color.png', sdf.srgb(seen))
    sdf.write_png(folder / 'beech-through.png', sdf.srgb(lit))
    height = 0.20 * np.minimum(vein, 3) / 3 + 0.05 * np.minimum(fine, 0.5) + 0.04 * noise(p, 0.8, 53).reshape(size, size)
    position = np.stack([w * leaf_half_width(s), s * LEAF_LENGTH, 0 * s], -1)
    sdf.write_png(folder / 'beech-normal.png', sdf.normal_map(height.astype(FLOAT), position))


# --- Light from all sides --------------------------------------------------------------------------------------------------------------

def studio(folder, width=512, height=256):
    """An environment, equirectangular, as PFM: a dim room, two soft boxes, a strip behind, a warm floor."""
    v, u = np.mgrid[0:height, 0:width]
    up, around = np.pi * (0.5 - (v + 0.5) / height), 2 * np.pi * ((u + 0.5) / width - 0.5)  # 0: -z
    x, y, z = np.cos(up) * np.sin(around), np.sin(up), -np.cos(up) * np.cos(around)
    light = np.array([0.16, 0.18, 0.22]) * (0.55 + 0.45 * y[..., None]) + np.array([0.05, 0.035, 0.02]) * np.clip(-y, 0, 1)[..., None]

    def box(to, wide, high, color):
        nonlocal light
        to = np.array(to) / np.linalg.norm(to)
        right = np.cross(to, [0, 1, 0])
        right /= np.linalg.norm(right)
        over = np.cross(right, to)
        d = x * to[0] + y * to[1] + z * to[2]
        a = (x * right[0] + z * right[2]) / np.maximum(d, 1e-6)
        b = (x * over[0] + y * over[1] + z * over[2]) / np.maximum(d, 1e-6)
        edge = lambda t, r: np.clip((r - np.abs(t)) / 0.05 + 0.5, 0, 1)
        light = light + ((d > 0) * edge(a, wide) * edge(b, high))[..., None] * np.array(color)

    box((-0.8, 0.7, 0.7), 0.42, 0.42, [9.0, 8.6, 8.0])
    box((1.0, 0.25, 0.35), 0.30, 0.60, [2.2, 2.5, 3.0])
    box((0.45, 0.5, -1.0), 0.22, 0.55, [16.0, 14.6, 12.6])
    box((0, 1, 0.05), 0.35, 0.35, [3.0, 3.1, 3.3])
    data = light[::-1].astype('<f4').tobytes()  # rows from the bottom
    (folder / 'studio.pfm').write_bytes(f'PF\n{width} {height}\n-1.0\n'.encode() + data)


MODELS = {'hand': hand, 'vase': vase, 'candle': candle, 'fruit': fruit, 'cups': cups, 'beech': beech, 'studio': studio}


def main():
    names = sys.argv[2:] or list(MODELS)
    if len(sys.argv) < 2 or sys.argv[1].startswith('-') or any(name not in MODELS for name in names):
        sys.exit(f'{__doc__}\nNAMEs: {" ".join(MODELS)}')
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        MODELS[name](folder)


if __name__ == '__main__':
    main()
