#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the head of the gallery: head.ply and head-eyes.ply in millimetres, closed and oriented outward, and the maps painted on its skin.

    make_head.py FOLDER [FINENESS]

FINENESS is the size of the mesh's cells in mm (1.4). The head is a solid of smooth unions (sdf.py), with the proportions of an adult: the
origin is between the eyes at the height of their centres, z is forward. head-color.png is white light after absorption by melanin and
blood (Beer's law from two painted maps), head-gloss.png the roughness, head-normal.png pores and lines. Deterministic.
"""
import sys
from pathlib import Path

import numpy as np

sys.dont_write_bytecode = True  # the folder of the sources stays as it is
import sdf
from sdf import FLOAT, at, chain, cone, curve, cut, ellipsoid, join, length, meet, noise, sphere, turn, where

EYE = (31.5, 0.0, 68.5)
EYE_RADIUS = 12.3
LOW, HIGH = (-150.0, -232.0, -140.0), (150.0, 125.0, 130.0)

# Knots (x, y, z, radius) of the right half; functions of |x|.
UPPER_LIP = curve([(0, -68.7, 92.6, 3.3), (6.0, -67.4, 92.0, 3.4), (13, -69.3, 88.9, 2.8), (19, -71.4, 85.0, 1.8),
                   (23.5, -72.9, 81.0, 0.9)])
LOWER_LIP = curve([(0, -77.4, 90.6, 4.6), (6.5, -77.3, 90.0, 4.4), (13, -76.0, 87.2, 3.5), (19, -74.5, 84.0, 2.1),
                   (23.5, -73.2, 81.0, 0.9)])
MOUTH = curve([(0, -72.7, 96.0, 0.7), (6.5, -72.1, 95.2, 0.7), (13, -72.9, 91.8, 0.7), (19, -73.1, 87.0, 0.7), (24, -73.3, 83.0, 0.6)])
# The ear in its own frame: u backward, v up, w outward.
HELIX = curve([(2, -3, 1.0, 1.6), (-5, 1, 2.4, 2.0), (-8.5, 11, 3.6, 2.2), (-5, 23, 4.0, 2.4), (3, 30.5, 4.4, 2.5), (12, 30, 5.2, 2.5),
               (18.5, 22, 6.0, 2.4), (20, 10, 6.4, 2.2), (17.5, -4, 6.0, 2.0), (11.5, -16, 4.8, 2.0), (7, -23, 3.2, 2.0)])
ANTIHELIX = curve([(3, 19, 2.6, 1.8), (8.5, 14, 4.2, 2.5), (11, 4, 5.6, 2.6), (9, -6, 5.6, 2.4),
                   (4.5, -13, 4.8, 2.5), (-0.5, -15.5, 4.2, 2.3)])


def lid_edges(x):
    """Heights of the lids' edges; x from the eye's centre, outward."""
    t = np.clip((x + 14.5) / 27.5, 0, 1)  # 0 at the inner corner, 1 at the outer
    bow = np.sqrt(np.clip(t * (1 - t) * 4, 0, 1))
    base = -2.6 + 3.6 * t
    return base + 4.5 * bow * (1.1 - 0.2 * t), base - 5.0 * bow * (0.8 + 0.3 * t)


def ear_frame(p):
    """p has |x|. u, v, w in mm."""
    q = at(p, (70.5, -13.0, -18.0))
    q = turn(q, 0, -8.0)  # leans back
    q = turn(q, 1, 20.0)  # protrudes behind
    return np.stack([-q[2], q[1], q[0]])


def ear(q):
    plate = ellipsoid(q, (6.5, 5.0, 2.6), (13.5, 26.0, 2.0))
    d = join(plate, chain(q, HELIX), 2.2)
    d = join(d, ellipsoid(q, (2.0, -24.5, 1.2), (7.6, 8.0, 2.5)), 4.0)
    d = join(d, ellipsoid(q, (1.0, -4.0, -4.0), (12.0, 14.0, 7.5)), 4.0)  # the back of the bowl
    d = join(d, ellipsoid(q, (-3.0, -14.0, -7.0), (8.0, 13.0, 8.0)), 5.0)
    d = cut(d, ellipsoid(q, (2.0, -4.5, 4.0), (8.6, 10.5, 7.0)), 2.0)
    d = join(d, chain(q, ANTIHELIX), 2.6)
    d = join(d, chain(q, curve([(3, 27, 2.6, 1.2), (8, 20, 4.2, 2.0), (10, 10, 5.0, 2.3)])), 2.6)
    d = join(d, chain(q, HELIX[:9]), 1.6)
    d = join(d, ellipsoid(q, (-7.6, -6.5, 3.2), (2.4, 5.0, 3.6)), 2.8)
    return cut(d, cone(q, (13.5, 22, 6.8), (15.5, 4, 8.2), 1.6), 1.6)


def skull(p):
    x, y, z = p
    d = join(ellipsoid(p, (0, 26, -10), (76, 86, 98)), ellipsoid(p, (0, 36, 24), (62, 60, 64)), 22)
    d = join(d, ellipsoid(p, (0, -46, 26), (54, 68, 58)), 26)
    jaw = chain(p, [(47, -48, -4, 12), (42, -84, 14, 11), (25, -104, 56, 11), (0, -108, 70, 12)])
    d = join(d, jaw, 26)
    d = join(d, cone(p, (0, -84, 34), (0, -60, 20), 34), 24)
    d = join(d, ellipsoid(p, (0, -105, 77), (17, 12.5, 13.5)), 16)
    d = join(d, ellipsoid(p, (0, -70, 62), (31, 25, 26.5)), 16)
    d = join(d, ellipsoid(p, (44, -26, 51), (17, 12, 18)), 22)
    d = join(d, cone(p, (50, -22, 44), (63, -17, 6), 6, 5), 20)
    d = join(d, ellipsoid(p, (35, -54, 55), (20, 24, 21)), 22)
    # Neck, its muscles, shoulders
    d = join(d, cone(p, (0, -70, -28), (0, -190, -40), 46, 53), 30)
    d = join(d, cone(p, (53, -52, -26), (12, -192, 16), 9, 9), 18)
    d = join(d, cone(p, (0, -112, 26), (0, -190, 10), 15, 12), 18)
    d = join(d, sphere(p, (0, -139, 30), 5.5), 12)
    d = join(d, cone(p, (34, -100, -66), (132, -196, -58), 24, 30), 44)
    d = join(d, cone(p, (60, -232, -34), (176, -232, -48), 38, 40), 40)
    d = join(d, cone(p, (10, -196, 22), (128, -184, -22), 5, 6), 16)
    return d


def face(p, d):
    x, y, z = p
    d = join(d, chain(p, curve([(7, 17, 84, 6), (22, 23, 80, 6.5), (40, 20, 66, 6), (48, 10, 56, 5)])), 12)
    d = cut(d, ellipsoid(p, (31, -1, 96), (17, 12, 20)), 16)
    d = cut(d, sphere(p, (0, 8, 106), 11), 16)  # between the brows, above the nose
    # The nose
    bridge = chain(p, curve([(0, 8, 80, 6.5), (0, -6, 85.5, 6.3), (0, -22, 93.5, 7.2), (0, -36, 101.5, 7.6)]))
    d = join(d, bridge, 11)
    d = join(d, cone(p, (7, -14, 80), (13, -40, 84), 6, 7), 12)
    nose = join(sphere(p, (0, -40.5, 104.3), 8.3), sphere(p, (3.6, -41.6, 105.6), 6.2), 4)
    nose = join(nose, ellipsoid(turn(at(p, (12.8, -44.5, 93.5)), 1, -22), (0, 0, 0), (5.4, 7.0, 9.0)), 5)
    nose = join(nose, cone(p, (0, -47.5, 103.5), (0, -52, 92), 3.6, 4.4), 3.5)
    d = join(d, nose, 6.5)
    d = cut(d, chain(p, curve([(13.5, -36.5, 95.5, 0.8), (17.8, -39, 90.2, 1.0), (19.6, -45, 86.8, 1.0), (18.2, -50, 86.4, 0.8)])), 4.5)
    nostril = ellipsoid(turn(turn(at(p, (7.4, -49.8, 96.8)), 1, -20), 0, 14), (0, 0, 0), (3.3, 6.6, 5.4))
    d = cut(d, nostril, 2.0)
    # Philtrum, folds next to the mouth, below the lip
    d = cut(d, cone(p, (0, -55, 94.6), (0, -63.5, 95.4), 1.9, 2.3), 4)
    d = cut(d, chain(p, curve([(20, -45, 91, 1), (26, -56, 90.5, 1), (32, -70, 83.0, 1)])), 9)
    d = cut(d, ellipsoid(p, (0, -88, 96.0), (16, 4.5, 8.0)), 8)
    # Lips
    d = join(d, chain(p, UPPER_LIP), 2.4)
    d = join(d, chain(p, LOWER_LIP), 3.2)
    d = cut(d, chain(p, MOUTH), 2.6)
    d = cut(d, sphere(p, (26.0, -73.6, 83.0), 1.8), 4)
    # Lids about the eyeball, which has its own mesh
    q = at(p, EYE)
    upper, lower = lid_edges(q[0])
    shell = sphere(q, (0, 0, 0), EYE_RADIUS + 2.3)
    crease = upper + 4.2 - 0.012 * (q[0] - 2) ** 2
    shell = meet(shell, meet(q[1] - crease, -11.5 - q[1], 1.0), 2.2)
    d = join(join(d, sphere(q, (0, 0, 0), EYE_RADIUS + 1.3), 3.0), shell, 2.0)
    d = join(d, ellipsoid(q, (-16.5, -2.8, 4.5), (5, 4, 4)), 4)
    opening = np.maximum(q[1] - upper, lower - q[1]) * FLOAT(0.85)
    opening = np.maximum(opening, np.maximum(5.0 - q[2], np.abs(q[0] + 0.75) - 14.2))
    d = cut(d, opening, 1.1)
    d = join(d, ellipsoid(q, (-12.4, -2.4, 6.6), (2.0, 1.6, 2.2)), 1.2)  # caruncle
    return cut(d, sphere(q, (0, 0, 0), EYE_RADIUS - 0.35), 0.3)


def bend(p):
    """No face is symmetric: a smooth displacement of everything below."""
    shift = (noise(p, 55.0, 3) - FLOAT(0.5)) * FLOAT(2.2)
    return p + np.stack([shift, (noise(p, 48.0, 4) - FLOAT(0.5)) * FLOAT(1.6), 0 * shift])


def head(p):
    p = bend(p)
    p[0] = np.abs(p[0])
    x, y, z = p
    d = skull(p)
    d = where(p, d, (z > 40) & (y < 45) & (y > -100) & (x < 62), face)
    d = where(p, d, (x > 48) & (np.abs(y + 12) < 52) & (np.abs(z + 20) < 48), lambda q, e: join(e, ear(ear_frame(q)), 5.0))
    d = meet(d, x - FLOAT(140.0), 8.0)
    return meet(d, -y - FLOAT(226.0), 6.0)


# --- Layout and maps ------------------------------------------------------------------------------------------------------------------

def layout(vertices, normals, faces):
    """The head unwrapped about its axis, bent so that the region below the chin and the shoulders have room, too; the ears' outer and
    inner sides and hollows in charts of their own above it."""
    x, y, z = vertices.T
    angle, radius = np.arctan2(x, z + 10), np.hypot(x, z + 10)
    lean = 0.4 * np.clip((y + 150) / 20, -1, 1)
    reach = np.minimum(radius, 110) - 90
    height = np.where(y < 20, y - 20 + lean * reach, np.arctan2(y - 20, radius) * 92 + 0.4 * reach)
    wrap = np.ptp(angle[faces], axis=1) > 3
    a = angle[faces]
    a = np.where(wrap[:, None] & (a < 0), a + 2 * np.pi, a)
    uv = np.stack([0.5 + a / (2 * np.pi), (height[faces] + 290) / (290 + 92 * np.pi / 2 + 10) * 0.79], -1)
    d1, d2 = uv[:, 2] - uv[:, 0], uv[:, 3] - uv[:, 1]
    area = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    p = np.ascontiguousarray(bend(vertices.T.astype(FLOAT)))
    p[0] = np.abs(p[0])
    middle = p[:, faces].mean(2)
    q = ear_frame(middle)
    on_ear = (np.abs(q[0]) < 26) & (np.abs(q[1]) < 40) & (np.abs(q[2]) < 14) & (middle[0] > 60) & (ear(q) < skull(middle) - 1)
    n = np.abs(normals[faces].mean(1))
    right = vertices[faces, 0].mean(1) > 0
    across = ear_frame(p + points_of(normals.T, vertices.T))[2] - ear_frame(p)[2]
    outer = across[faces].mean(1) > 0
    chart = np.where(on_ear, 1 + 2 * right + outer, np.where(area > 1e-9, 0, np.where(n[:, 0] < n[:, 2], 5, 6 + right)))
    for n in range(1, 5):
        here = chart == n
        e = ear_frame(p)[:, faces[here]]
        uv[here] = np.stack([0.005 + 0.13 * (n - 1) + (e[0] + 24) / 54 * 0.12, 0.80 + (e[1] + 40) / 80 * 0.19], -1)
    for n, along, left in ((5, x, 0.54), (6, z, 0.76), (7, z, 0.88)):
        here = chart == n
        wide = 0.2 if n == 5 else 0.1
        uv[here] = np.stack([left + (along[faces[here]] + 150) / 300 * wide, 0.80 + (y[faces[here]] + 232) / 360 * 0.19], -1)
    return chart, uv


def points_of(normals, vertices):
    n = normals.copy()
    n[0] *= np.sign(vertices[0])
    return (0.01 * n).astype(FLOAT)


def spot(p, x, y, z, radius):
    return np.exp(-((p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2) / FLOAT(radius * radius))


def paint(p):
    """At points (3, n): melanin, blood and hair, 0 none; roughness; height in mm."""
    q = bend(p)
    q[0] = np.abs(q[0])
    x, y, z = q
    lips = np.minimum(chain(q, UPPER_LIP), chain(q, LOWER_LIP))
    lip = np.clip((1.0 - lips) / 1.3, 0, 1)
    lip = lip * lip * (3 - 2 * lip) * (z > 70)
    e = at(q, EYE)
    upper, lower = lid_edges(e[0])
    near_eye = np.exp(-((e[0] / 17) ** 2 + ((e[1] + 1) / 12) ** 2) ** 2) * (z > 55)
    lash = np.exp(-((e[1] - upper - 0.4) / 0.75) ** 2) * (np.abs(e[0]) < 13.5) * (length(e) > 12.4) * (z > 60) * (e[1] < upper + 1.3)
    lash += 0.55 * np.exp(-((e[1] - lower + 0.4) / 0.6) ** 2) * (np.abs(e[0]) < 12.5) * (length(e) > 12.4) * (z > 60)
    arch = 21.0 + 4.5 * np.sin(np.clip((x - 10) / 42, 0, 1) * 2.4) - 5.5 * np.clip((x - 30) / 22, 0, 1) ** 2
    brow = np.exp(-((y - arch) / (4.2 - 0.045 * x)) ** 2) * np.clip((x - 8) / 6, 0, 1) * np.clip((55 - x) / 16, 0, 1) * (z > 40)
    hair = noise(np.stack([(x * 0.9 - y * 0.5) * 2.2, (y + 0.45 * x) * 0.5, z * 0.25]), 1.0, 21)
    m = 0.30 + 0.16 * (noise(p, 30, 5) - 0.5) + 0.10 * (noise(p, 9, 6) - 0.5) + 0.07 * (noise(p, 3, 7) - 0.5)
    freckle = np.clip(noise(p, 1.9, 8) - 0.71, 0, 1) * 6
    freckle = freckle * (spot(q, 28, -22, 70, 34) + spot(q, 0, -25, 95, 26) + 0.25 * spot(q, 30, 40, 75, 50))
    scalp = np.clip((y - 66 + 26 * np.clip((30 - z) / 50, 0, 2.8) - 8 * np.abs(np.clip((x - 38) / 30, 0, 1) - 0.5)) / 16, 0, 1)
    stubble = scalp * (0.10 + 0.8 * np.clip(noise(p, 0.7, 22) - 0.5, 0, 1))
    m = m + 0.45 * freckle + 0.10 * near_eye - 0.14 * lip
    dark = brow * (0.15 + 1.5 * hair * hair + 0.5 * hair) + 1.8 * lash + stubble
    b = 0.42 + 0.18 * (noise(p, 13, 10) - 0.5) + 0.22 * (noise(p, 4.5, 11) - 0.5) + 0.14 * (noise(p, 1.6, 12) - 0.5)
    b = b + 0.42 * spot(q, 40, -34, 66, 24) + 0.46 * spot(q, 0, -42, 108, 15) + 0.35 * spot(q, 15, -45, 93, 9)
    b = b + 0.2 * spot(q, 0, -104, 88, 16)
    b = b + 0.42 * spot(q, 84, -12, -24, 34) + 0.08 * near_eye + 1.05 * lip + 0.7 * spot(e, -12.5, -2.4, 7, 2.6)
    b = b - 0.12 * spot(q, 0, 60, 80, 60)
    rough = 0.50 - 0.10 * (spot(q, 0, 40, 88, 34) + spot(q, 0, -25, 100, 22) + 0.6 * spot(q, 0, -104, 90, 16))
    rough = rough - 0.16 * lip - 0.12 * near_eye + 0.10 * (noise(p, 1.1, 13) - 0.5) + 0.06 * (noise(p, 5, 14) - 0.5) + 0.1 * scalp
    oily = 0.35 + spot(q, 0, -30, 100, 30) + 0.7 * spot(q, 34, -30, 72, 28) + 0.5 * spot(q, 0, 45, 85, 45)
    pores = np.clip(noise(p, 0.85, 15) - 0.52, 0, 1) * oily
    h = -0.30 * pores + 0.045 * noise(p, 0.7, 16) + 0.06 * noise(p, 1.8, 17) + 0.05 * noise(p, 4.5, 18)
    furrow = sum(np.exp(-((y - c - 2.0 * noise(p, 18, 19)) / 0.7) ** 2) for c in (38, 47, 57)) * np.clip((40 - x) / 20, 0, 1) * (z > 60)
    crow = np.exp(-((np.abs(y - 1 + 0.10 * (x - 50)) % 4.5 - 2.2) / 0.5) ** 2) * spot(q, 52, 1, 56, 8)
    lines = np.exp(-((x + 0.9 * noise(p, 4, 20)) % 1.9 - 0.95) ** 2 / 0.12) * lip
    return m, b, dark, rough, h * (1 - 0.8 * lip) - 0.10 * furrow - 0.12 * crow - 0.07 * lines + 0.22 * brow * hair


def skin_maps(vertices, faces, uv, size):
    positions = sdf.enlarge(sdf.positions(vertices, faces, uv, size // 2), 2)
    p = np.ascontiguousarray(positions.reshape(-1, 3).T)
    m, b, dark, rough, height = (np.concatenate(k).reshape(size, size) for k in
                           zip(*(paint(np.ascontiguousarray(p[:, i:i + sdf.BATCH])) for i in range(0, p.shape[1], sdf.BATCH))))
    m, b, dark = (np.maximum(k, 0)[..., None] for k in (m, b, dark))
    absorbed = m * np.array([0.36, 0.58, 0.86]) + b * np.array([0.10, 0.56, 0.47]) + dark * np.array([0.95, 1.15, 1.35])
    color = np.array([0.70, 0.52, 0.42]) * np.exp(-absorbed)
    return {'color': sdf.srgb(color), 'gloss': rough, 'normal': sdf.normal_map(height.astype(FLOAT), positions)}


# --- Eyes -----------------------------------------------------------------------------------------------------------------------------

def eyes(rows=80, columns=96):
    """Both eyeballs, with the bulge of the cornea; u, v is the view along the gaze, the back half in the corner."""
    vertices, faces, uv = [], [], []
    for side in (-1, 1):
        a = np.pi * (np.arange(rows + 1) / rows) ** 1.2
        t = np.arange(columns) * 2 * np.pi / columns
        bulge = EYE_RADIUS + 1.3 * np.clip(1 - (a / 0.52) ** 2, 0, 1) ** 1.5
        s, c = np.sin(a) * bulge, np.cos(a) * bulge
        ring = np.stack([np.outer(s, np.cos(t)), np.outer(s, np.sin(t)), np.outer(c, np.ones(columns))])
        n = ring.reshape(3, -1)
        u = 0.5 + 0.48 * n[:2] / EYE_RADIUS
        u[:, n[2] < 0] = 0.02
        i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing='ij')
        at = lambda i, j: np.where((i == 0) | (i == rows), 0, j % columns) + i * columns
        quad = np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], -1).reshape(-1, 4) + len(vertices) * n.shape[1]
        corner = sdf.triangles(quad)
        corner = corner[(corner[:, 0] != corner[:, 1]) & (corner[:, 1] != corner[:, 2]) & (corner[:, 2] != corner[:, 0])]
        vertices.append((turn(n.astype(FLOAT), 1, side * 2.0) + np.array([[side * EYE[0]], [EYE[1]], [EYE[2]]])).T)
        faces.append(corner)
        uv.append(u.T)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(uv)


def eye_map(size):
    y, x = np.mgrid[0:size, 0:size]
    x, y = ((x + 0.5) / size - 0.5) / 0.48 * EYE_RADIUS, (0.5 - (y + 0.5) / size) / 0.48 * EYE_RADIUS
    r, t = np.hypot(x, y), np.arctan2(y, x)
    p = np.stack([np.cos(t) * 9, np.sin(t) * 9, r * 0.5]).reshape(3, -1).astype(FLOAT)
    fibre = (0.6 * noise(p, 0.55, 31) + 0.4 * noise(p, 0.2, 32)).reshape(size, size)
    flat = np.stack([x, y, 0 * x]).reshape(3, -1).astype(FLOAT)
    blood = (np.abs(noise(flat, 2.2, 33) - 0.5) < 0.02).reshape(size, size) * np.clip((r - 7) / 5, 0, 1)

    def rise(a, b):
        s = np.clip((r - a) / (b - a), 0, 1)[..., None]
        return s * s * (3 - 2 * s)

    iris = np.array([0.13, 0.19, 0.20]) * (0.45 + 1.1 * fibre[..., None])
    iris = iris + np.array([0.20, 0.11, 0.03]) * np.exp(-((r - 2.7) / 1.0) ** 2)[..., None]
    iris = iris * (1 - 0.75 * rise(4.8, 5.8))
    white = np.array([0.56, 0.52, 0.48]) * (1 - 0.10 * rise(6, 12)) - np.array([0.02, 0.22, 0.22]) * blood[..., None]
    color = iris * (1 - rise(5.6, 6.3)) + white * rise(5.6, 6.3)
    return sdf.srgb(0.004 + color * rise(1.9, 2.2))


def main():
    if len(sys.argv) not in (2, 3) or sys.argv[1].startswith('-'):
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    size = float(sys.argv[2]) if len(sys.argv) == 3 else 1.4
    vertices, normals, faces = sdf.mesh(head, LOW, HIGH, size)
    vertices, normals, faces, uv = sdf.unfold(vertices, normals, faces, layout)
    sdf.write_ply(folder / 'head.ply', vertices, normals, faces, uv)
    for name, picture in skin_maps(vertices, faces, uv, 1024 if size > 1.5 else 1536).items():
        sdf.write_png(folder / f'head-{name}.png', picture)
    vertices, faces, uv = eyes()
    centre = np.where(vertices[:, :1] > 0, 1, -1) * np.array([EYE[0], 0, 0]) + np.array([0, EYE[1], EYE[2]])
    normals = (vertices - centre) / np.sqrt(((vertices - centre) ** 2).sum(1, keepdims=True))
    sdf.write_ply(folder / 'head-eyes.ply', vertices, normals, faces, uv)
    sdf.write_png(folder / 'head-eyes.png', eye_map(512))


if __name__ == '__main__':
    main()
