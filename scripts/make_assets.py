#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Generates the assets of the examples, the benches and the tests: closed solids and a simple bust, as OBJ files in
millimetres, images for light projectors, and maps of the scattering radius.

    make_assets.py FOLDER [NAME ...]

Deterministic, standard library only. Every mesh is closed and oriented outward.
"""
import math
import struct
import sys
import zlib
from pathlib import Path


def write_obj(path, comment, vertices, faces, uv=None, corners=None):
    """faces: tuples of three or more 0-based vertex indices; uv: of each vertex, or None; corners: the uv index of each corner of each
    face, where it differs from its vertex's."""
    lines = [f'# {comment}; made by scripts/make_assets.py; one unit is 1 mm']
    lines += [f'v {x:.5f} {y:.5f} {z:.5f}' for x, y, z in vertices]
    lines += [f'vt {u:.5f} {v:.5f}' for u, v in uv or []]
    lines += ['f ' + ' '.join(f'{i + 1}/{j + 1}' if uv else str(i + 1) for i, j in zip(face, pair))
              for face, pair in zip(faces, corners or faces)]
    path.write_text('\n'.join(lines) + '\n')


def revolve(rows, columns, point):
    """A closed surface from point(s, theta): s in (0, 1) from bottom to top on `rows` rings, and a pole at each end,
    point(0, 0) and point(1, 0).
    theta runs counter-clockwise seen from above, so faces look outward."""
    vertices = [point(0.0, 0.0)]
    for i in range(1, rows):
        vertices += [point(i / rows, 2 * math.pi * j / columns) for j in range(columns)]
    vertices.append(point(1.0, 0.0))
    top = len(vertices) - 1
    faces = []

    def at(i, j):
        return 1 + (i - 1) * columns + j % columns

    for j in range(columns):
        faces.append((0, at(1, j + 1), at(1, j)))
        faces.append((at(rows - 1, j), at(rows - 1, j + 1), top))
        for i in range(1, rows - 1):
            faces.append((at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)))
    return vertices, faces


def sphere(radius, rows=96, columns=192):
    def point(s, theta):
        a = math.pi * (s - 0.5)
        return (radius * math.cos(a) * math.sin(theta), radius * math.sin(a) + radius, radius * math.cos(a) * math.cos(theta))
    return revolve(rows, columns, point)


def signed_power(x, e):
    return math.copysign(abs(x) ** e, x)


def rounded_cube(size, exponent=0.35, rows=120, columns=240):
    """A superellipsoid (Barr 1981)."""
    def point(s, theta):
        a = math.pi * (s - 0.5)
        c, r = signed_power(math.cos(a), exponent), size / 2
        return (r * c * signed_power(math.sin(theta), exponent), r * signed_power(math.sin(a), exponent) + r,
                r * c * signed_power(math.cos(theta), exponent))
    return revolve(rows, columns, point)


def fluted(height, radius, flutes=7, turns=0.35, rows=200, columns=350):
    """A twisted, fluted vessel shape, solid: thin crests and a thick core, for marble and wax."""
    def point(s, theta):
        a = math.pi * (s - 0.5)
        body = math.cos(a) ** 0.6 * (0.72 + 0.28 * math.cos(2.6 * math.pi * (s - 0.42)))
        crest = 1.0 + 0.2 * math.cos(flutes * (theta + 2 * math.pi * turns * s)) * math.sin(math.pi * s) ** 0.5
        r = radius * body * crest
        return (r * math.sin(theta), height * 0.5 * (1.0 + math.sin(a)), r * math.cos(theta))
    return revolve(rows, columns, point)


def torus(major, minor, rows=96, columns=192):
    vertices, faces = [], []
    for i in range(columns):
        u = 2 * math.pi * i / columns
        for j in range(rows):
            v = 2 * math.pi * j / rows
            r = major + minor * math.cos(v)
            vertices.append((r * math.sin(u), minor * math.sin(v) + minor, r * math.cos(u)))
    for i in range(columns):
        for j in range(rows):
            a, b = i * rows + j, (i + 1) % columns * rows + j
            c, d = (i + 1) % columns * rows + (j + 1) % rows, i * rows + (j + 1) % rows
            faces.append((a, b, c, d))
    return vertices, faces


def slab(width, height, depth, cells=24):
    """A box, its faces cut into cells so that shading and normals behave like those of a real mesh."""
    vertices, faces, index = [], [], {}

    def vertex(x, y, z):
        key = (round(x, 6), round(y, 6), round(z, 6))
        if key not in index:
            index[key] = len(vertices)
            vertices.append(key)
        return index[key]

    half = (width / 2, height / 2, depth / 2)
    for axis in range(3):
        for side in (-1, 1):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for i in range(cells):
                for j in range(cells):
                    corners = []
                    for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        p = [0.0, 0.0, 0.0]
                        p[axis] = side * half[axis]
                        p[u] = (2 * (i + a) / cells - 1) * half[u]
                        p[v] = (2 * (j + b) / cells - 1) * half[v]
                        corners.append(vertex(*p))
                    faces.append(tuple(corners if side > 0 else reversed(corners)))
    return vertices, faces


def plate(width, height, depth):
    """A slab whose front has texture coordinates."""
    vertices, faces = slab(width, height, depth)
    return vertices, faces, [(x / width + 0.5, y / height + 0.5) for x, y, z in vertices]


# The bust: (height, half width, depth to the front, depth to the back), mm, bottom to top.
PROFILE = [
    (0, 0, 0, 0), (0, 60, 40, 48), (0.6, 88, 58, 70), (4, 94, 62, 75), (15, 91, 60, 73), (34, 76, 52, 62),
    (58, 60, 48, 57), (80, 55.5, 49, 57),
    (100, 55.5, 53, 61), (112, 57.5, 63, 65), (122, 61, 78, 69), (135, 65.5, 89, 76), (155, 70, 92.5, 85),
    (180, 73.5, 94, 94), (205, 75.5, 96, 100),
    (232, 75.5, 97, 102), (255, 71, 90.5, 97.5), (274, 60, 76, 83), (288, 43.5, 55, 60), (297, 23, 29.5, 32), (300, 0, 0, 0),
]
# Features that protrude from the face: (x, y, amplitude, width in x, width in y), mm; x is mirrored where it is not 0.
FACE = [
    (0, 206, 4.5, 7, 9), (0, 192, 8, 6.5, 9), (0, 178, 17, 8, 7.5), (0, 171, 6, 9, 4.5), (9.5, 171.5, 6.5, 5, 4.8), (9, 166.5, -2, 3, 2.5),
    (31, 204, -11, 14, 9), (31, 203.5, 6.5, 9.5, 6.2), (31, 203.2, 1.2, 9, 1.2), (24, 218, 5, 16, 5),
    (44, 214, 3.5, 11, 6), (0, 217, 3, 10, 7),
    (40, 180, 5, 15, 13), (46, 160, -3, 13, 14), (0, 152.6, 5.2, 14, 3.3), (5.5, 154.5, 1.4, 4, 2),
    (0, 143, 5.6, 12.5, 3.7), (0, 147.9, -3.4, 19, 1.5),
    (0, 159.5, -1.2, 3, 4.5), (0, 134, -2.5, 15, 3.5), (0, 123, 8, 15, 8), (24, 147, -1.8, 5, 5), (0, 240, 2.5, 34, 18),
]
# Ears: (z, y, amplitude, width in z, width in y) on either side.
EARS = [(-8, 192, 13, 9.5, 19), (-15, 194, 9, 4.5, 22), (-12, 176, 5, 6, 8), (-5, 193, -7, 5.5, 11), (-1, 187, 3, 2.5, 6)]


def catmull_rom(points, t):
    """Point at t in [0, 1] of the spline through `points`, centripetal by index."""
    n = len(points) - 1
    i = min(int(t * n), n - 1)
    f = t * n - i
    p = [points[max(0, min(n, i + k))] for k in (-1, 0, 1, 2)]
    return [0.5 * (2 * b + (c - a) * f + (2 * a - 5 * b + 4 * c - d) * f * f + (3 * b - a - 3 * c + d) * f ** 3)
            for a, b, c, d in zip(*p)]


def bump(x, y, width_x, width_y):
    return math.exp(-0.5 * ((x / width_x) ** 2 + (y / width_y) ** 2))


def bust(rows=230, columns=256):
    def point(s, theta):
        y, side, front, back = catmull_rom(PROFILE, s)
        side, front, back = max(side, 0.0), max(front, 0.0), max(back, 0.0)
        x, c = side * math.sin(theta), math.cos(theta)
        z = (front if c > 0 else back) * c
        if c > 0:
            weight = min(1.0, 2.5 * c) ** 2
            for fx, fy, amplitude, wx, wy in FACE:
                z += weight * amplitude * sum(bump(x - m * fx, y - fy, wx, wy) for m in ((1, -1) if fx else (1,)))
        out = math.copysign(1.0, x) * min(1.0, abs(math.sin(theta)) * 1.2) ** 4
        for ez, ey, amplitude, wz, wy in EARS:
            x += out * amplitude * bump(z - ez, y - ey, wz, wy)
        z += 10.0 * math.sin(math.pi * min(max((y - 20) / 200, 0.0), 1.0)) ** 2 * 0.4  # the head leans forward over the neck
        return (x, y, z)
    return revolve(rows, columns, point)


def wrapped_bust(rows=180, columns=200):
    """The bust with a texture wrapped around it: u around the axis, 0.5 in front, v up the profile's parameter. The texture repeats in
    u."""
    vertices, faces = bust(rows, columns)
    uv = [(0.5, 0.0)] + [(0.5 + j / columns, i / rows) for i in range(1, rows) for j in range(columns + 1)] + [(0.5, 1.0)]

    def position(vertex, wrap):
        if vertex in (0, len(vertices) - 1):
            return 0 if vertex == 0 else len(uv) - 1
        i, j = divmod(vertex - 1, columns)
        return 1 + i * (columns + 1) + (columns if wrap and j == 0 else j)

    corners = []
    for face in faces:
        wrap = any((v - 1) % columns == columns - 1 for v in face if 0 < v < len(vertices) - 1)
        corners.append(tuple(position(v, wrap) for v in face))
    return vertices, faces, uv, corners


ASSETS = {
    'sphere': ('a sphere of radius 20 mm', lambda: sphere(20.0)),
    'cube': ('a rounded cube of 40 mm', lambda: rounded_cube(40.0)),
    'fluted': ('a fluted solid, 120 mm tall', lambda: fluted(120.0, 42.0)),
    'torus': ('a torus of radii 30 and 12 mm', lambda: torus(30.0, 12.0)),
    'slab': ('a slab of 80 x 80 x 10 mm', lambda: slab(80.0, 80.0, 10.0)),
    'bust': ('a bust, 300 mm tall', lambda: bust()),
    'face': ('the bust with pictures wrapped around it', wrapped_bust),
    'plate': ('a slab of 100 x 100 x 20 mm with a picture on its front', lambda: plate(100.0, 100.0, 20.0)),
}


# Images: functions of x, y in [0, 1) that give red, green, blue in [0, 1].

def checker(x, y):
    return (1.0, 1.0, 1.0) if (int(8 * x) + int(8 * y)) % 2 == 0 else (0.0, 0.0, 0.0)


def fraction(i, j, k):
    """A pseudo-random number in [0, 1) for a cell; 32-bit integers, the same on all machines."""
    h = (i * 374761393 + j * 668265263 + k * 2246822519 + 12345) & 0xffffffff
    h = ((h ^ (h >> 13)) * 1274126177) & 0xffffffff
    return ((h ^ (h >> 16)) & 0xffffff) / 16777216.0


GLASS = [(0.85, 0.10, 0.07), (0.95, 0.62, 0.08), (0.10, 0.28, 0.85), (0.07, 0.60, 0.22), (0.55, 0.12, 0.65), (0.92, 0.90, 0.70)]


def glass(x, y, cells=7, lead=0.012):
    """Panes about the points of a jittered grid, the lead between them black."""
    best = second = (9.0, (0, 0))
    ci, cj = int(x * cells), int(y * cells)
    for i in range(ci - 2, ci + 3):
        for j in range(cj - 2, cj + 3):
            px, py = (i + 0.15 + 0.7 * fraction(i, j, 0)) / cells, (j + 0.15 + 0.7 * fraction(i, j, 1)) / cells
            d = (math.hypot(x - px, y - py), (i, j))
            if d < best:
                best, second = d, best
            elif d < second:
                second = d
    if second[0] - best[0] < lead:
        return (0.0, 0.0, 0.0)
    pane = best[1]
    dim = 0.75 + 0.25 * fraction(*pane, 3)
    return tuple(dim * v for v in GLASS[int(len(GLASS) * fraction(*pane, 2))])


def smooth_noise(x, y, k):
    i, j = math.floor(x), math.floor(y)
    f, g = (t * t * (3 - 2 * t) for t in (x - i, y - j))
    low = fraction(i, j, k) * (1 - f) + fraction(i + 1, j, k) * f
    return low * (1 - g) + (fraction(i, j + 1, k) * (1 - f) + fraction(i + 1, j + 1, k) * f) * g


def veins(x, y):
    """Scattering radius of a veined stone: reduced in the veins."""
    turbulence = sum(smooth_noise(2 ** k * 4 * x, 2 ** k * 4 * y, k) / 2 ** k for k in range(4))
    v = 0.25 + 0.75 * abs(math.sin(9.0 * (x + 0.4 * y) + 4.5 * turbulence)) ** 0.6
    return (v, v, v)


PICTURES = {'checker': (checker, 256), 'glass': (glass, 320), 'veins': (veins, 320)}


# Maps of the face, in the texture coordinates of wrapped_bust: rows of pixels from the top.

def noise_rows(size, cells_x, cells_y, k):
    """Smooth noise in [0, 1) that repeats in x; evaluated per row, as this is much faster."""
    lattice = [[fraction(i, j, k) for i in range(cells_x)] for j in range(cells_y + 1)]
    columns = []
    for x in range(size):
        at = (x + 0.5) / size * cells_x
        i, f = int(at), at - int(at)
        columns.append((i % cells_x, (i + 1) % cells_x, f * f * (3 - 2 * f)))
    for y in range(size):
        at = (y + 0.5) / size * cells_y
        j, g = int(at), at - int(at)
        g = g * g * (3 - 2 * g)
        row = [a + g * (b - a) for a, b in zip(lattice[j], lattice[j + 1])]
        yield [row[i] + f * (row[n] - row[i]) for i, n, f in columns]


def face_rows(size):
    """For each row the positions of its pixels on the bust: (x, y, whether in front), mm."""
    for row in range(size):
        y, side, _, _ = catmull_rom(PROFILE, 1.0 - (row + 0.5) / size)
        angles = [2 * math.pi * ((x + 0.5) / size - 0.5) for x in range(size)]
        yield [(side * math.sin(a), y, max(0.0, math.cos(a)) ** 0.3) for a in angles]


def sums_of(spots, positions):
    """Sum of soft spots (x, y, weight, width in x, width in y), mirrored, on the front, for a row of positions."""
    y = positions[0][1]
    near = [(px, w * math.exp(-0.5 * ((y - py) / wy) ** 2), -0.5 / (wx * wx), 9 * wx * wx) for px, py, w, wx, wy in spots
            if abs(y - py) < 3 * wy]
    row = [0.0] * len(positions)
    for px, w, k, most in near:
        for i, (x, _, front) in enumerate(positions):
            d = (abs(x) - px) ** 2
            if d < most and front:
                row[i] += w * front * math.exp(k * d)
    return row


LIPS = [(0, 152.6, 0.95, 13, 2.6), (6, 153.6, 0.3, 5, 2.0), (0, 143.5, 0.95, 11.5, 3.0), (0, 148.0, 0.7, 15, 2.5)]
FLUSH = [(38, 178, 0.5, 14, 12), (0, 178, 0.55, 9, 8), (75, 190, 0.6, 14, 20), (0, 124, 0.3, 14, 8), (31, 196, 0.3, 12, 6)]
BROWS = [(20, 217.5, 0.8, 9, 2.2), (32, 219, 0.7, 7, 1.8)]
OILY = [(0, 180, 0.8, 8, 20), (0, 238, 0.6, 30, 16), (0, 124, 0.4, 10, 7), (36, 184, 0.3, 12, 9)]
LINES = [(0, 228, 0.3, 26, 1.2), (0, 236.5, 0.4, 30, 1.2), (0, 245, 0.3, 26, 1.2), (27, 163, 0.4, 3.0, 9.0), (52, 204, 0.3, 4, 1.0)]


FRECKLES = [(30, 186, 1.0, 18, 10), (0, 186, 1.0, 8, 10)]
TONES = [(0.79, 0.47, 0.42), (0.69, 0.34, 0.33), (0.34, 0.24, 0.19)]


def face_color(size):
    """sRGB. A skin tone with flushed cheeks, nose, ears and chin, lips, brows, freckles."""
    for positions, soft, fine in zip(face_rows(size), noise_rows(size, 60, 48, 11), noise_rows(size, 170, 130, 12)):
        row = []
        for flush, lips, brows, spot, m, s in zip(*(sums_of(k, positions) for k in (FLUSH, LIPS, BROWS, FRECKLES)), soft, fine):
            parts = (flush + 0.35 * (m - 0.5), min(0.9, lips), brows * (0.6 + 0.8 * s) + 1.25 * spot * max(0.0, s - 0.72))
            light = 1.0 + 0.06 * (m - 0.5)
            r, g, b = 0.85 * light, 0.66 * light, 0.565 * light
            for part, (tr, tg, tb) in zip(parts, TONES):
                if part > 0.0:
                    part = min(part, 1.0)
                    r, g, b = r + part * (tr - r), g + part * (tg - g), b + part * (tb - b)
            row.append((r, g, b))
        yield row


def face_gloss(size):
    """Roughness: oily brow, nose and chin, moist lips, pores."""
    for positions, fine in zip(face_rows(size), noise_rows(size, 190, 150, 13)):
        row = []
        for oily, lips, n in zip(sums_of(OILY, positions), sums_of(LIPS, positions), fine):
            r = 0.52 - 0.16 * oily - 0.2 * min(1.0, lips) + 0.16 * (n - 0.5)
            row.append((r, r, r))
        yield row


def face_normal(size):
    """Tangent space, +Y up: pores and lines."""
    heights, ys = [], []
    for positions, coarse, fine in zip(face_rows(size), noise_rows(size, 130, 110, 14), noise_rows(size, 260, 220, 15)):
        heights.append([0.22 * a + 0.2 * b * b - line for line, a, b in zip(sums_of(LINES, positions), coarse, fine)])
        ys.append(positions[0][1])
    mm_x = 2 * math.pi * 72.0 / size
    for y in range(size):
        above, below = max(y - 1, 0), min(y + 1, size - 1)
        mm_y, here, row = max(ys[above] - ys[below], 0.5), heights[y], []
        for x, (up, down) in enumerate(zip(heights[above], heights[below])):
            nx, ny = (here[x - 1] - here[(x + 1) % size]) / (2 * mm_x), (down - up) / mm_y
            k = 0.5 / math.sqrt(nx * nx + ny * ny + 1.0)
            row.append((0.5 + k * nx, 0.5 + k * ny, 0.5 + k))
        yield row


MAPS = {'face-color': (face_color, 384), 'face-gloss': (face_gloss, 384), 'face-normal': (face_normal, 512)}


def rows_of(picture, size):
    for y in range(size):
        yield [picture((x + 0.5) / size, (y + 0.5) / size) for x in range(size)]


def write_png(path, pixels, size):
    rows = b''.join(b'\0' + bytes(int(255.0 * min(max(v, 0.0), 1.0) + 0.5) for pixel in row for v in pixel) for row in pixels)

    def chunk(name, data):
        return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))

    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', size, size, 8, 2, 0, 0, 0)) +
                     chunk(b'IDAT', zlib.compress(rows, 6)) + chunk(b'IEND', b''))


def main():
    known = list(ASSETS) + list(PICTURES) + list(MAPS)
    names = sys.argv[2:] or known
    if len(sys.argv) < 2 or sys.argv[1].startswith('-') or any(name not in known for name in names):
        sys.exit(f'{__doc__}\nNAMEs: {" ".join(known)}')
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        if name in PICTURES:
            picture, size = PICTURES[name]
            write_png(folder / f'{name}.png', rows_of(picture, size), size)
            continue
        if name in MAPS:
            rows, size = MAPS[name]
            write_png(folder / f'{name}.png', rows(size), size)
            continue
        comment, make = ASSETS[name]
        write_obj(folder / f'{name}.obj', comment, *make())


if __name__ == '__main__':
    main()
