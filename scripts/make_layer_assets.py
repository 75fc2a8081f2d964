#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the solids whose layers the `layered` examples paint, as OBJ files in millimetres, and the maps painted on them.

    make_layer_assets.py FOLDER [NAME ...]

NAME* selects all models whose names begin with NAME. fish-1400, fish-5000 and fish-20000 are the fish with about that many vertices, made
only when named. A NAME-layers.png holds the depth of the bottom of each layer as red, green, blue, alpha, 16 bit; 1 is the depth_scale
that the scene file says. Deterministic, standard library only. Every object is one closed manifold surface, oriented outward, without
self-intersections.
"""
import math
import struct
import sys
import zlib
from array import array
from bisect import bisect_right
from functools import lru_cache
from pathlib import Path

sys.dont_write_bytecode = True  # the folder of the sources stays as it is
from make_assets import bust, fraction


# --- Curves, meshes, textures -------------------------------------------------------------------------------------------------------


class Curve:
    """Through points (x, y), monotone between them, constant beyond (Fritsch and Carlson 1980)."""

    def __init__(self, *points):
        self.x, self.y = [p[0] for p in points], [p[1] for p in points]
        h = [b - a for a, b in zip(self.x, self.x[1:])]
        d = [(b - a) / w for a, b, w in zip(self.y, self.y[1:], h)]
        self.m = [d[0]] + [2 * p * q / (p + q) if p * q > 0 else 0.0 for p, q in zip(d, d[1:])] + [d[-1]]

    def __call__(self, x):
        if x <= self.x[0]:
            return self.y[0]
        if x >= self.x[-1]:
            return self.y[-1]
        i = bisect_right(self.x, x) - 1
        h = self.x[i + 1] - self.x[i]
        t = (x - self.x[i]) / h
        return (self.y[i] * (1 + 2 * t) * (1 - t) ** 2 + self.m[i] * h * t * (1 - t) ** 2 + self.y[i + 1] * t * t * (3 - 2 * t) +
                self.m[i + 1] * h * t * t * (t - 1))


def step(a, b, x):
    """0 up to a, 1 from b on, smooth between; a may be above b."""
    t = min(1.0, max(0.0, (x - a) / (b - a)))
    return t * t * (3 - 2 * t)


def mix(a, b, t):
    return a + (b - a) * t


fraction = lru_cache(maxsize=None)(fraction)


def noise(x, y, k):
    """Smooth noise in [0, 1], about one hill per unit; another pattern for each k."""
    i, j = math.floor(x), math.floor(y)
    f, g = x - i, y - j
    f, g = f * f * (3 - 2 * f), g * g * (3 - 2 * g)
    low = fraction(i, j, k) * (1 - f) + fraction(i + 1, j, k) * f
    return low * (1 - g) + (fraction(i, j + 1, k) * (1 - f) + fraction(i + 1, j + 1, k) * f) * g


@lru_cache(maxsize=None)
def cell_seed(i, j):
    return i + 0.1 + 0.8 * fraction(i, j, 4), j + 0.1 + 0.8 * fraction(i, j, 5)


def areole(x, y, size):
    """0 on the lines between the cells of an irregular net, 1 in the cells."""
    x, y = x / size, y / size
    ci, cj = math.floor(x), math.floor(y)
    best = second = 9.0
    for i in (ci - 1, ci, ci + 1):
        for j in (cj - 1, cj, cj + 1):
            px, py = cell_seed(i, j)
            d = (x - px) * (x - px) + (y - py) * (y - py)
            if d < best:
                best, second = d, best
            elif d < second:
                second = d
    return min(1.0, (math.sqrt(second) - math.sqrt(best)) * 2.2)


def spread(weight, a, b, count, fine=600):
    """count + 1 numbers from a to b, the denser the greater the weight."""
    total, sums = 0.0, [0.0]
    for i in range(fine):
        total += weight(a + (b - a) * (i + 0.5) / fine)
        sums.append(total)
    out, j = [a], 0
    for k in range(1, count):
        want = total * k / count
        while sums[j + 1] < want:
            j += 1
        out.append(a + (b - a) * (j + (want - sums[j]) / (sums[j + 1] - sums[j])) / fine)
    return out + [b]


class Solid:
    """One object: vertices, texture coordinates of corners (mm in the texture's own plane), faces by material."""

    def __init__(self, name):
        self.name, self.vertices, self.uv, self.faces, self.known = name, [], [], [], {}
        self.normals = {}  # normals of vertices, where the analytic surface is more accurate than the faces; written if there are any

    def vertex(self, x, y, z):
        self.vertices.append((x, y, z))
        return len(self.vertices) - 1

    def face(self, material, corners, uv=None):
        """corners: vertex indices, counter-clockwise from outside; uv: (u, v) of each, (0, 0) is the lower left of the texture."""
        numbers = []
        for c, t in zip(corners, uv or []):
            key = (round(t[0], 6), round(t[1], 6))
            if key not in self.known:
                self.known[key] = len(self.uv)
                self.uv.append(key)
            numbers.append(self.known[key])
        self.faces.append((material, tuple(corners), tuple(numbers)))


def mean_normals(solid):
    """Normals of all vertices: the analytic ones, or area-weighted means of adjacent faces."""
    sums = [[0.0, 0.0, 0.0] for v in solid.vertices]
    for _, corners, _ in solid.faces:
        a, b, c = (solid.vertices[k] for k in corners[:3])
        n = cross(tuple(q - p for p, q in zip(a, b)), tuple(q - p for p, q in zip(a, c)))
        for k in corners:
            sums[k] = [p + q for p, q in zip(sums[k], n)]
    return [unit(solid.normals.get(i, s)) for i, s in enumerate(sums)]


def write_obj(path, comment, solids):
    """With a material library that only names the materials: the scene file defines them."""
    lines = [f'# {comment}; made by scripts/make_layer_assets.py; one unit is 1 mm', f'mtllib {path.stem}.mtl']
    v, vt, vn = 1, 1, 1
    for solid in solids:
        normals = mean_normals(solid) if solid.normals else []
        lines.append(f'o {solid.name}')
        lines += [f'v {x:.4f} {y:.4f} {z:.4f}' for x, y, z in solid.vertices]
        lines += [f'vt {a:.5f} {b:.5f}' for a, b in solid.uv]
        lines += [f'vn {x:.4f} {y:.4f} {z:.4f}' for x, y, z in normals]
        material = None
        for name, corners, uv in solid.faces:
            if name != material:
                lines.append(f'usemtl {name}')
                material = name
            texts = [f'{c + v}/{uv[k] + vt if uv else ""}' for k, c in enumerate(corners)]
            lines.append('f ' + ' '.join(f'{text}/{c + vn}' if normals else text.rstrip('/') for text, c in zip(texts, corners)))
        v, vt, vn = v + len(solid.vertices), vt + len(solid.uv), vn + len(normals)
    path.write_text('\n'.join(lines) + '\n')
    path.with_suffix('.mtl').write_text(''.join(f'newmtl {name}\nKd 0.5 0.5 0.5\n' for name in
                                                dict.fromkeys(face[0] for solid in solids for face in solid.faces)))


def pillow(solid, material, columns, rows, point, height, uv, skip=lambda i, j, side: False):
    """Two sheets over one flat grid, joined along its rim: point(i, j) in the plane, height(i, j) of each sheet over and under the middle
    surface, (over, under) in z. Returns the vertex numbers [side][i][j]."""
    index = [[[0] * (rows + 1) for i in range(columns + 1)] for side in (0, 1)]
    flat = [[point(i, j) for j in range(rows + 1)] for i in range(columns + 1)]
    for i in range(columns + 1):
        for j in range(rows + 1):
            over, under = height(i, j)
            rim = i in (0, columns) or j in (0, rows)
            index[0][i][j] = solid.vertex(*flat[i][j], 0.5 * (over + under) if rim else over)
            index[1][i][j] = index[0][i][j] if rim else solid.vertex(*flat[i][j], under)
    for i in range(columns):
        for j in range(rows):
            quad = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            # The diagonal must end in the rim's corner there, else three corners of a triangle would be on the rim of both sheets.
            corner = (i in (0, columns - 1)) and (j in (0, rows - 1))
            if corner:
                first = (i == 0) == (j == 0)
            else:
                a, b, c, d = (flat[p][q] for p, q in quad)
                first = math.dist(a, c) <= math.dist(b, d)
            cut = [(0, 1, 2), (0, 2, 3)] if first else [(0, 1, 3), (1, 2, 3)]
            for side in (0, 1):
                if skip(i, j, side):
                    continue
                for t in cut:
                    order = t if side == 0 else t[::-1]
                    solid.face(material, [index[side][quad[k][0]][quad[k][1]] for k in order],
                               [uv(*flat[quad[k][0]][quad[k][1]]) for k in order])
    return index


def ball(name, centre, radii, bands, axis, rows, columns):
    """An ellipsoid about an axis along z (axis 1 or -1); bands: (material, to this angle from the axis in degrees)."""
    solid = Solid(name)

    def at(a, b):
        return solid.vertex(centre[0] + radii[0] * math.sin(a) * math.cos(b), centre[1] + radii[1] * math.sin(a) * math.sin(b),
                            centre[2] + axis * radii[2] * math.cos(a))

    top, rings = at(0, 0), []
    for i in range(1, rows):
        rings.append([at(math.pi * i / rows, 2 * math.pi * j / columns * axis) for j in range(columns)])
    bottom = at(math.pi, 0)

    def material(i):
        angle = 180 * (i + 0.5) / rows
        return next(m for m, to in bands if angle <= to)

    for i in range(rows):
        for j in range(columns):
            k = (j + 1) % columns
            if i == 0:
                solid.face(material(i), (top, rings[0][j], rings[0][k]))
            elif i == rows - 1:
                solid.face(material(i), (rings[-1][j], bottom, rings[-1][k]))
            else:
                solid.face(material(i), (rings[i - 1][j], rings[i][j], rings[i][k], rings[i - 1][k]))
    return solid


class Blend:
    """A smooth union of round cones on a grid, and its surface: one vertex in each cell that the surface crosses, at the mean of the
    crossings of the cell's edges (surface nets, Gibson 1998)."""

    def __init__(self, low, high, step_mm, flat):
        """flat: the solids are this much thinner in z than they are wide."""
        self.low, self.step, self.flat = low, step_mm, flat
        self.size = [int(math.ceil((b - a) / step_mm)) + 1 for a, b in zip(low, high)]
        self.f = array('f', [8.0]) * (self.size[0] * self.size[1] * self.size[2])

    def add(self, a, ra, b, rb, soft):
        """A cone from the ball (a, ra) to the ball (b, rb); soft: the radius that rounds the corner where it joins, mm."""
        reach, nx, ny, nz = 3.0 * self.step + soft, *self.size
        span = []
        for k in range(3):
            r = reach if k < 2 else reach / self.flat
            low = min(a[k] - ra * (1 if k < 2 else 1 / self.flat), b[k] - rb * (1 if k < 2 else 1 / self.flat)) - r
            high = max(a[k] + ra * (1 if k < 2 else 1 / self.flat), b[k] + rb * (1 if k < 2 else 1 / self.flat)) + r
            span.append(range(max(0, int((low - self.low[k]) / self.step)), min(self.size[k], int((high - self.low[k]) / self.step) + 2)))
        d = [b[0] - a[0], b[1] - a[1], (b[2] - a[2]) * self.flat]
        length = sum(v * v for v in d) or 1e-9
        for i in span[0]:
            x = self.low[0] + i * self.step - a[0]
            for j in span[1]:
                y = self.low[1] + j * self.step - a[1]
                base, part = (i * ny + j) * nz, x * d[0] + y * d[1]
                for k in span[2]:
                    z = (self.low[2] + k * self.step - a[2]) * self.flat
                    t = (part + z * d[2]) / length
                    t = 0.0 if t < 0.0 else 1.0 if t > 1.0 else t
                    u, v, w = x - t * d[0], y - t * d[1], z - t * d[2]
                    e = math.sqrt(u * u + v * v + w * w) - ra - t * (rb - ra)
                    old = self.f[base + k]
                    h = soft - abs(old - e)
                    self.f[base + k] = (old if old < e else e) - (h * h / (4 * soft) if h > 0 else 0.0)

    def surface(self, solid, material, uv):
        nx, ny, nz = self.size
        f, cells = self.f, {}
        strides = ((ny * nz, nz, 1))
        corners = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if sum(p != q for p, q in zip(corners[a], corners[b])) == 1]
        offsets = [c[0] * strides[0] + c[1] * strides[1] + c[2] for c in corners]
        for i in range(nx - 1):
            for j in range(ny - 1):
                for k in range(nz - 1):
                    at = (i * ny + j) * nz + k
                    values = [f[at + o] for o in offsets]
                    if min(values) >= 0.0 or max(values) < 0.0:
                        continue
                    s, n = [0.0, 0.0, 0.0], 0
                    for a, b in edges:
                        if (values[a] < 0) != (values[b] < 0):
                            t = values[a] / (values[a] - values[b])
                            for c in range(3):
                                s[c] += mix(corners[a][c], corners[b][c], t)
                            n += 1
                    cells[i, j, k] = solid.vertex(*(self.low[c] + self.step * ((i, j, k)[c] + s[c] / n) for c in range(3)))
        for (i, j, k) in list(cells):
            at = (i * ny + j) * nz + k
            for axis in range(3):
                inside = f[at] < 0
                if inside == (f[at + strides[axis]] < 0):
                    continue
                p, q = [0, 0, 0], [0, 0, 0]
                p[(axis + 1) % 3], q[(axis + 2) % 3] = -1, -1
                quad = [cells[i, j, k], cells[i + p[0], j + p[1], k + p[2]],
                        cells[i + p[0] + q[0], j + p[1] + q[1], k + p[2] + q[2]], cells[i + q[0], j + q[1], k + q[2]]]
                if not inside:
                    quad.reverse()
                v = [solid.vertices[c] for c in quad]
                first = math.dist(v[0], v[2]) <= math.dist(v[1], v[3])
                for tri in ((0, 1, 2), (0, 2, 3)) if first else ((0, 1, 3), (1, 2, 3)):
                    solid.face(material, [quad[c] for c in tri], [uv(*v[c]) for c in tri])


class Picture:
    """Channels of numbers over a rectangle in mm, row 0 at the top."""

    def __init__(self, width, height, left, bottom, mm_wide, values):
        """values: the channels where nothing is painted."""
        self.width, self.height, self.left, self.px = width, height, left, width / mm_wide
        self.top = bottom + height / self.px
        self.data = [array('f', [v]) * (width * height) for v in values]
        self.mask = b'\1' * (width * height)

    def uv(self, x, y, z=0.0):
        return ((x - self.left) * self.px / self.width, 1.0 - (self.top - y) * self.px / self.height)

    def cover(self, boxes, margin):
        """fill() evaluates only these boxes (x0, y0, x1, y1): most of the texture is not used by any surface."""
        self.mask = bytearray(self.width * self.height)
        for x0, y0, x1, y1 in boxes:
            c0, c1 = max(0, int((x0 - margin - self.left) * self.px)), min(self.width, int((x1 + margin - self.left) * self.px) + 1)
            r0, r1 = max(0, int((self.top - y1 - margin) * self.px)), min(self.height, int((self.top - y0 + margin) * self.px) + 1)
            for row in range(r0, r1):
                self.mask[row * self.width + c0:row * self.width + c1] = b'\1' * max(0, c1 - c0)
        return self

    def fill(self, function):
        """function(x, y) -> the channels."""
        for row in range(self.height):
            y = self.top - (row + 0.5) / self.px
            for column in range(self.width):
                if self.mask[row * self.width + column]:
                    for c, value in enumerate(function(self.left + (column + 0.5) / self.px, y)):
                        self.data[c][row * self.width + column] = value

    def stroke(self, points, paint):
        """Along a line of points (x, y, radius): paint(channels there, distance / radius, t along it) for distances up to the radius."""
        n = len(points) - 1
        seen = {}
        for k in range(n):
            (ax, ay, ar), (bx, by, br) = points[k], points[k + 1]
            r = max(ar, br)
            dx, dy = bx - ax, by - ay
            length = dx * dx + dy * dy or 1e-12
            c0, c1 = int((min(ax, bx) - r - self.left) * self.px) - 1, int((max(ax, bx) + r - self.left) * self.px) + 1
            r0, r1 = int((self.top - max(ay, by) - r) * self.px) - 1, int((self.top - min(ay, by) + r) * self.px) + 1
            for row in range(max(r0, 0), min(r1, self.height - 1) + 1):
                y = self.top - (row + 0.5) / self.px
                for column in range(max(c0, 0), min(c1, self.width - 1) + 1):
                    x = self.left + (column + 0.5) / self.px
                    t = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length))
                    d = math.hypot(x - ax - t * dx, y - ay - t * dy) / mix(ar, br, t)
                    at = row * self.width + column
                    if d < 1.0 and d < seen.get(at, (1.0,))[0]:
                        seen[at] = (d, (k + t) / n)
        for at, (d, t) in seen.items():
            for c, value in enumerate(paint([channel[at] for channel in self.data], d, t)):
                self.data[c][at] = value

    def shape(self, x, y, rx, ry, tilt_deg, paint):
        """An ellipse: paint(channels, distance from its middle, 1 at its rim)."""
        c, s = math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))
        r = max(rx, ry)
        for row in range(max(int((self.top - y - r) * self.px), 0), min(int((self.top - y + r) * self.px) + 1, self.height)):
            dy = self.top - (row + 0.5) / self.px - y
            for column in range(max(int((x - r - self.left) * self.px), 0), min(int((x + r - self.left) * self.px) + 1, self.width)):
                dx = self.left + (column + 0.5) / self.px - x
                d = math.hypot((c * dx + s * dy) / rx, (c * dy - s * dx) / ry)
                if d < 1.0:
                    at = row * self.width + column
                    for k, value in enumerate(paint([channel[at] for channel in self.data], d)):
                        self.data[k][at] = value

    def normals(self):
        """The first channel as a height in mm over the surface, to a normal map: tangent space, +Y up."""
        out = [array('f', bytes(4 * self.width * self.height)) for c in range(3)]
        h, w = self.data[0], self.width
        for row in range(self.height):
            up, down = max(row - 1, 0) * w, min(row + 1, self.height - 1) * w
            for column in range(w):
                dx = (h[row * w + min(column + 1, w - 1)] - h[row * w + max(column - 1, 0)]) * 0.5 * self.px
                dy = (h[up + column] - h[down + column]) * 0.5 * self.px
                s = 0.5 / math.sqrt(1 + dx * dx + dy * dy)
                at = row * w + column
                out[0][at], out[1][at], out[2][at] = 0.5 - dx * s, 0.5 - dy * s, 0.5 + s
        self.data = out
        return self

    def write(self, path, bits, scale=1.0):
        """Values over `scale`, in [0, 1]."""
        most, n = (1 << bits) - 1, len(self.data)
        values = array('H' if bits == 16 else 'B', bytes(bits // 8 * n * self.width * self.height))
        for c, channel in enumerate(self.data):
            values[c::n] = array(values.typecode, [int(min(1.0, max(0.0, v / scale)) * most + 0.5) for v in channel])
        if bits == 16 and sys.byteorder == 'little':
            values.byteswap()
        raw, stride = values.tobytes(), bits // 8 * n * self.width
        # Each row as its difference to the one above it: smooth images compress well.
        rows, above = [], bytes(stride)
        for row in range(self.height):
            line = raw[row * stride:(row + 1) * stride]
            rows.append(b'\2' + bytes((a - b) & 255 for a, b in zip(line, above)))
            above = line

        def chunk(name, data):
            return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))

        kind = {3: 2, 4: 6}[n]
        path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', self.width, self.height, bits, kind, 0, 0, 0)) +
                         chunk(b'IDAT', zlib.compress(b''.join(rows), 6)) + chunk(b'IEND', b''))


# --- Fish: a small glassy one, 100 mm, nose at -x -----------------------------------------------------------------------------------

FISH_END = 90.0  # where the tail ends in its middle
BACK = Curve((0, 0.5), (1.2, 1.9), (3, 3.4), (7, 6.2), (14, 9.8), (23, 12.9), (33, 14.2), (44, 12.9), (56, 9.6), (66, 6.2), (72, 4.6),
             (76, 4.2), (79, 5.3), (83, 9.2), (86, 11.9), (88, 13.1), (90, 13.6))
BELLY = Curve((0, -1.0), (1.2, -2.2), (3, -3.6), (7, -6.0), (14, -9.2), (23, -12.2), (33, -13.4), (44, -12.3), (56, -9.2), (66, -6.0),
              (72, -4.6), (76, -4.2), (79, -5.2), (83, -8.9), (86, -11.5), (88, -12.6), (90, -13.1))
FLANK = Curve((0, 0.5), (1.2, 1.5), (3, 2.5), (7, 3.9), (14, 5.3), (23, 6.3), (33, 6.6), (44, 5.8), (56, 4.3), (66, 2.9), (73, 1.9),
              (77, 1.4), (82, 0.7), (86, 0.1), (88, 0.0))
DORSAL = Curve((32.5, 0), (34, 2.0), (37, 6.8), (40, 9.2), (43, 9.6), (48, 7.6), (54, 5.3), (58, 4.0), (60, 2.3), (61, 0))
ANAL = Curve((52.5, 0), (54, 2.6), (56.5, 6.4), (58.5, 7.4), (63, 5.2), (68, 3.3), (70.5, 2.0), (72, 0))
PELVIC = Curve((33, 0), (34.5, 2.4), (37, 6.0), (38.6, 6.6), (40, 4.4), (41.5, 0))
FISH_EYE = (8.6, 2.0)
RIM = ((0.25, 0.045), (1.05, 0.12))  # rows next to a rim: mm from it, at most this fraction of the section
ROOT, ROOT_LOW, ROOT_HIGH = (21.95, 23.2), -6.4, -2.6  # of a pectoral fin: x, y
SWEEP = 0.75  # how far fins lean back


def fish_outline(x):
    return BELLY(x) - ANAL(x) - PELVIC(x), BACK(x) + DORSAL(x)


def fish_position(x, t):
    """The station x and the height t over the axis, in the plane: fins lean back, the tail forks."""
    low, high = BELLY(x), BACK(x)
    if x >= 74:
        side = t / (high if t > 0 else -low)
        return x + 9.5 * step(74, 91, x) * abs(side) ** 2, t
    return x + SWEEP * (max(0.0, t - high) + max(0.0, low - t)), t


def fish_half(x, t):
    """Half of the thickness, mm."""
    low, high, (bottom, top) = BELLY(x), BACK(x), fish_outline(x)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    eta = abs(t - middle) / half
    body = FLANK(x) * max(0.0, 1.0 - eta ** 2.1) ** 0.56
    # The gill cover protrudes a little, the eye is in a shallow ring.
    gill = math.hypot((x - 14.5) / 1.0, (t + 0.6) / 1.15)
    body *= 1.0 + 0.055 * step(6.5, 4.6, gill) * step(2, 6, x)
    inside = min(t - bottom, top - t, FISH_END - x)
    ray = step(0.0, 12.0, max(t - high, low - t, x - 76.0))
    blade = mix(0.85, 0.5, ray)
    d = min(1.0, max(0.0, inside / 1.1))
    blade *= math.sqrt(d * (2.0 - d))
    return (body ** 4 + blade ** 4) ** 0.25


def fish_normal(x, t):
    """Normal of the side toward +z, by differences; at a rim that of a point just inside."""
    x = min(max(x, 0.02), FISH_END - 0.05)
    bottom, top = fish_outline(x)
    d = min(0.02, 0.01 * (top - bottom))
    t = min(max(t, bottom + 2 * d), top - 2 * d)

    def at(x, t):
        low, high = fish_outline(x)
        return *fish_position(x, t), fish_half(x, min(max(t, low), high))

    along, up = ([p - q for p, q in zip(at(x + a, t + b), at(x - a, t - b))] for a, b in ((0.01, 0.0), (0.0, d)))
    return unit(cross(along, up))


def fish_bends(x):
    """Curvature of the outline and the flank: stations are denser there."""
    d, bends = 0.3, 0.0
    for f in (lambda x: fish_outline(x)[0], lambda x: fish_outline(x)[1], FLANK):
        low, here, high = f(max(0.0, x - d)), f(x), f(min(FISH_END, x + d))
        bends += min(abs(low + high - 2 * here) / (d * d), 3.0) / (1 + ((high - low) / (2 * d)) ** 2)
    return math.sqrt(bends) + 0.25 + 2 * math.exp(-x / 2.2)


def fish(vertices):
    """About `vertices` vertices in total."""
    picture = fish_picture(2, ())
    rows = max(12, round(2 + math.sqrt(0.93 * vertices * 0.132)))
    columns = round((0.93 * vertices + 2 * rows) / (2 * rows + 0.01))
    # The strip of quads that the pectoral fins grow out of is the same for any number of vertices.
    root = round(columns * 0.33)
    stations = spread(fish_bends, 0.0, ROOT[0], root) + spread(fish_bends, ROOT[1], FISH_END - 0.4, columns - 2 - root) + [FISH_END]
    heights = []
    for x in stations:
        bottom, top = fish_outline(x)
        size = top - bottom
        at = min(x, FISH_END - 1.0)

        def weight(t):
            """Rows are denser where the section bends more: chords have the same accuracy everywhere."""
            d = max(0.004 * size, 0.03)
            low, here, high = (fish_half(at, min(max(t + k * d, bottom), top)) for k in (-1, 0, 1))
            slope, bend = (high - low) / (2 * d), abs(high + low - 2 * here) / (d * d)
            long = 1 + min(slope * slope, 16.0)
            return math.sqrt(long) * math.sqrt(min(bend / long ** 1.5, 2.0) + 0.02)

        # For a mesh of any resolution a rim has the same radius: fins stay as thick.
        rim = [min(far, fraction * size) for far, fraction in RIM]
        heights.append([bottom] + [bottom + e for e in rim[:-1]] +
                       spread(weight, bottom + rim[-1], top - rim[-1], rows - 2 * len(rim), 400) +
                       [top - e for e in rim[-2::-1]] + [top])
    first, last = (min(range(2, rows - 1), key=lambda j: abs(heights[root][j] - y)) for y in (ROOT_LOW, ROOT_HIGH))
    while last - first < 4:
        first, last = (first, last + 1) if (last - first) % 2 else (first - 1, last)
    for i in (root, root + 1):  # their rows meet the fin's edges
        pins = {0: heights[i][0], first: ROOT_LOW, last: ROOT_HIGH, rows: heights[i][-1]}
        moved = Curve(*((heights[i][j], y) for j, y in sorted(pins.items())))
        heights[i] = [moved(y) for y in heights[i]]
    solid = Solid('fish')

    def height(i, j):
        h = fish_half(stations[i], heights[i][j])
        return h, -h

    # A pectoral fin grows out of a strip of quads behind the gill, on either side.
    index = pillow(solid, 'Fish', columns, rows, lambda i, j: fish_position(stations[i], heights[i][j]), height, picture.uv,
                   lambda i, j, side: i == root and first <= j < last)
    for i in range(columns + 1):
        for j in range(rows + 1):
            n = fish_normal(stations[i], heights[i][j])
            if index[0][i][j] == index[1][i][j]:
                solid.normals[index[0][i][j]] = (n[0], n[1], 0.0)
            else:
                solid.normals[index[0][i][j]], solid.normals[index[1][i][j]] = n, (n[0], n[1], -n[2])
    for side in (0, 1):
        fish_pectoral(solid, picture, index[side], root, first, last, 1 if side == 0 else -1, max(6, round(9 * math.sqrt(vertices / 5000))))
    eyes = []
    for side, name in ((1, 'eye-left'), (-1, 'eye-right')):
        z = fish_half(*FISH_EYE)
        rings = (('Pupil', 33), ('Iris', 66), ('Rim', 180))
        eyes.append(ball(name, (FISH_EYE[0], FISH_EYE[1], side * (z - 0.75)), (2.5, 2.5, 1.7), rings, side, 16, 24))
    return [solid] + eyes


PECTORAL_WIDTH = Curve((0, 1.9), (3, 2.3), (8, 3.6), (12, 3.4), (14.2, 2.4), (15.2, 1.2))


def fish_pectoral(solid, picture, grid, column, first, last, side, rings):
    length = 15.2
    along = unit((0.86, -0.22, 0.46 * side))
    up = unit(cross(cross(along, (0.3, 0.95, 0.0)), along))
    out = tuple(side * v for v in cross(along, up))
    # The outer face begins at the strip's edge towards the nose, the inner one at the other.
    outer, inner = grid[column][first:last + 1], grid[column + 1][first:last + 1]
    count = last - first
    centre = [sum(solid.vertices[v][k] for v in outer + inner) / (2 * count + 2) for k in range(3)]
    width = math.dist(*(solid.vertices[v[count // 2]] for v in (outer, inner)))
    loops = [(outer, inner)]
    for r in range(1, rings + 1):
        a = 0.3 + (length - 0.3) * (r / rings) ** 0.9
        loop = ([], [])
        for j in range(count + 1):
            s = math.sin(math.pi * (j / count - 0.5))
            w = PECTORAL_WIDTH(a) * s
            reach = a - 1.6 * s * s * step(0, length, a) + 1.2 * s * step(2, length, a)
            # From a thin root it becomes thicker with the distance from the body.
            h = min(mix(0.62, 0.45, a / length), 0.35 * width + 0.2 * a) * math.sqrt(max(0.04, 1 - s * s)) * (0.55 if r == rings else 1)
            p = [centre[k] + reach * along[k] + w * up[k] for k in range(3)]
            p[2] += 0.7 * side * step(0.0, 2.5, a)
            loop[0].append(solid.vertex(*(p[k] + h * out[k] for k in range(3))))
            loop[1].append(solid.vertex(*(p[k] - h * out[k] for k in range(3))))
        loops.append(loop)

    def uv(r, j, extra=0.0, beyond=0.0):
        s = math.sin(math.pi * (j / count - 0.5))
        a = length * r / rings
        return picture.uv(1.0 + a + beyond, -21.0 + s * (PECTORAL_WIDTH(a) + extra))

    def quad(corners, at):
        if side < 0:
            corners, at = corners[::-1], at[::-1]
        solid.face('Fish', corners, at)

    for r in range(rings):
        (a0, b0), (a1, b1) = loops[r], loops[r + 1]
        for j in range(count):
            quad([a0[j], a1[j], a1[j + 1], a0[j + 1]], [uv(r, j), uv(r + 1, j), uv(r + 1, j + 1), uv(r, j + 1)])
            quad([b0[j + 1], b1[j + 1], b1[j], b0[j]], [uv(r, j + 1), uv(r + 1, j + 1), uv(r + 1, j), uv(r, j)])
        quad([b0[0], b1[0], a1[0], a0[0]], [uv(r, 0, 0.6), uv(r + 1, 0, 0.6), uv(r + 1, 0), uv(r, 0)])
        quad([a0[count], a1[count], b1[count], b0[count]],
             [uv(r, count), uv(r + 1, count), uv(r + 1, count, 0.6), uv(r, count, 0.6)])
    a, b = loops[-1]
    for j in range(count):
        quad([a[j], b[j], b[j + 1], a[j + 1]],
             [uv(rings, j), uv(rings, j, 0, 0.6), uv(rings, j + 1, 0, 0.6), uv(rings, j + 1)])


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    n = math.sqrt(sum(v * v for v in a))
    return tuple(v / n for v in a)


def fish_picture(width, values):
    picture, boxes = Picture(width, width // 2, -3.0, -27.0, 108.0, values), [(1.0, -25.0, 17.0, -17.0)]
    n, m = 60, 16
    for i in range(n):
        edge = [(x, fish_outline(x)) for x in (FISH_END * (i + k) / n for k in (0, 1))]
        for j in range(m):
            corners = [fish_position(x, mix(low, high, (j + k) / m)) for x, (low, high) in edge for k in (0, 1)]
            boxes.append((min(c[0] for c in corners), min(c[1] for c in corners), max(c[0] for c in corners), max(c[1] for c in corners)))
    return picture.cover(boxes, 0.8)


def fish_fin(x, y):
    """(distance out of the body in mm; index and phase of the ray) of a point of a fin, or None in the body."""
    if x >= 74.5:
        out = math.hypot(x - 74.5, 0.6 * y)
        return out, 3.6 * math.atan2(y, x - 66.0) * 8
    for edge, sign in ((BACK, 1), (BELLY, -1)):
        x0 = x
        for k in range(4):
            x0 = x - SWEEP * max(0.0, sign * (y - edge(x0)))
        out = sign * (y - edge(x0))
        if out > 0:
            return out, 0.85 * (x0 + 0.22 * out)
    return None


def scale_height(x, y, size=2.3):
    """Overlapping scales, in [0, 1]: rounded, their free edges towards the tail."""
    best = 0.0
    for row in (math.floor(y / (0.5 * size)) - 1, math.floor(y / (0.5 * size)), math.floor(y / (0.5 * size)) + 1):
        shift = 0.5 * size * (row % 2)
        column = math.floor((x - shift) / size)
        for k in (column - 1, column):
            dx, dy = x - shift - (k + 0.5) * size, y - (row + 0.5) * 0.5 * size
            d = math.hypot(dx * 0.95, dy * 1.1) / (0.62 * size)
            if d < 1.0:
                best = max(best, (0.35 + 0.65 * (dx / size + 0.5)) * step(1.0, 0.86, d))
    return best


def fish_skin(x, y):
    """Height over the smooth surface, mm."""
    if x < 17.5 and y < -14.0:
        return pectoral_ray(x, y) * 0.06
    fin = fish_fin(x, y)
    if fin:
        out, ray = fin
        return 0.08 * step(0, 2.5, out) * (0.5 + 0.5 * math.cos(2 * math.pi * ray)) ** 2
    fade = step(15.5, 20.0, x + 0.12 * y * y * 0.3) * step(75, 68, x)
    gill = math.hypot((x - 14.5) / 1.0, (y + 0.6) / 1.15)
    return 0.055 * fade * scale_height(x, y) - 0.09 * math.exp(-((gill - 5.6) / 0.22) ** 2) * step(12.0, 15.0, x)


def pectoral_ray(x, y):
    t = (y + 21.0) / PECTORAL_WIDTH(x - 1.0)
    return (0.5 + 0.5 * math.cos(2 * math.pi * 4.5 * t)) ** 2


def fish_tissue(x, y):
    """Bottoms of dermis, blood and muscle, organs, bone, mm below the surface, before bones and organs are drawn."""
    grain = noise(1.3 * x, 1.3 * y, 3) - 0.5
    island = x < 17.5 and y < -14.0
    fin = None if island else fish_fin(x, y)
    if fin or island:
        if fin:
            out, ray = fin
            rays = (0.5 + 0.5 * math.cos(2 * math.pi * ray)) ** 3
        else:
            out, rays = x - 1.0, pectoral_ray(x, y) ** 1.5
        root = math.exp(-out / 3.5)
        dermis = 0.045 + 0.02 * grain + 0.03 * root
        return dermis, dermis + 0.005 + 0.2 * rays * (0.3 + 0.7 * math.exp(-out / 9.0)) + 0.16 * root, 4.0, 4.0
    low, high = BELLY(x), BACK(x)
    eta = (y - 0.5 * (low + high)) / (0.5 * (high - low))
    dermis = 0.035 + 0.075 * step(0.2, 0.95, eta) + 0.03 * step(-0.5, -1.0, eta) + 0.02 * grain
    dermis += 0.03 * scale_height(x, y) * step(17, 22, x)
    # Muscle in segments, each a W on its side; thin at the lateral line and over the belly.
    w = 0.7 * abs(y + 0.3) - 0.55 * max(0.0, abs(y) - 6.0) * 2.0
    phase = (x - w) / 2.7
    seam = math.exp(-((phase - round(phase)) / 0.1) ** 2)
    muscle = 0.04 + 0.24 * step(-0.05, 0.8, eta) + 0.16 * step(36, 58, x) * step(0.4, -0.5, eta) + 0.04 * grain
    muscle *= 1.0 - 0.9 * seam * step(19, 24, x)
    muscle *= 1.0 - 0.35 * math.exp(-(y - 0.4) ** 2 / 0.3) * step(19, 24, x)
    muscle *= 1.0 - 0.6 * step(20, 14, x) * step(0.75, 0.3, eta)
    return dermis, dermis + max(0.01, muscle), 4.0, 4.0


def deep(top, rise):
    """Paints bone that bulges to `top` mm below the blood, `rise` mm deeper at its edges."""
    def paint(ch, d, t=0.0):
        return ch[0], ch[1], min(ch[2], ch[1] + top + rise * (1 - math.sqrt(1 - d * d))), 4.0
    return paint


def flesh(depth):
    """Paints an organ full of blood, `depth` mm thick in its middle."""
    def paint(ch, d, t=0.0):
        return ch[0], max(ch[1], ch[0] + depth * math.sqrt(1 - d * d)), ch[2], ch[3]
    return paint


def bow(ax, ay, bx, by, sag, r0, r1, n=14):
    """A line from a to b that sags to its left, radius r0 to r1."""
    dx, dy = bx - ax, by - ay
    return [(ax + dx * t - dy * sag * 4 * t * (1 - t), ay + dy * t + dx * sag * 4 * t * (1 - t), mix(r0, r1, t))
            for t in (k / n for k in range(n + 1))]


def fish_layers(picture):
    picture.fill(fish_tissue)
    # Belly: a silvery bag of gut, liver, heart; the swim bladder above it.
    picture.shape(34.0, 2.6, 11.0, 2.5, -2, deep(0.12, 0.9))
    picture.shape(30.5, -5.2, 9.6, 4.5, -9, lambda ch, d: (ch[0], mix(ch[1], ch[0] + 0.02, step(1.0, 0.85, d)), ch[2], ch[3]))
    for y, n in ((-3.6, 0), (-5.6, 1), (-7.3, 2)):
        line = [(24.0 + k * 0.5 + 0.6 * n, y - 0.08 * k + 0.55 * math.sin(0.9 * k + n), 0.85) for k in range(26 - 5 * n)]
        picture.stroke(line, flesh(0.35))
    picture.shape(23.0, -6.3, 3.8, 2.6, -35, flesh(0.5))
    picture.shape(19.8, -8.0, 1.7, 1.3, -20, flesh(0.9))
    # Gills: red combs under the cover.
    for k in range(5):
        picture.stroke(bow(14.4 + 0.9 * k, 3.0 - 0.35 * k, 13.8 + 0.9 * k, -6.4 + 0.35 * k, -0.24, 0.36, 0.3), flesh(0.55))
    # Skull, jaws, gill cover.
    for line in (bow(1.0, 0.4, 15.5, 6.6, 0.10, 0.35, 0.7), bow(0.9, -1.3, 8.2, -4.4, -0.05, 0.3, 0.5),
                 bow(8.2, -4.4, 13.5, -8.2, -0.06, 0.45, 0.35), bow(15.5, 6.6, 20.0, -6.8, 0.26, 0.42, 0.3),
                 bow(11.5, 4.8, 19.0, 1.0, 0.06, 0.45, 0.55), bow(1.2, -0.2, 6.6, -2.6, 0.1, 0.25, 0.3)):
        picture.stroke(line, deep(0.05, 0.5))
    for k in range(5):  # rays of the gill cover
        picture.stroke(bow(12.0 + k, -6.6 - 0.35 * k, 15.6 + 1.1 * k, -9.0 - 0.1 * k, -0.16, 0.2, 0.14), deep(0.06, 0.4))
    # Spine in beads, ribs under it as far as the belly, a spine of bone over and under each bead.
    spine = [(18.5 + 0.4 * k, 3.9 - 3.7 * step(0, 115, k) - 0.1 * math.sin(0.05 * k), mix(0.85, 0.4, k / 145)) for k in range(146)]
    beads = 34

    def bead(ch, d, t):
        waist = 1.0 - 0.3 * (0.5 + 0.5 * math.cos(2 * math.pi * beads * t)) ** 2
        return deep(0.03, 0.45)(ch, d / waist, t) if d < waist else ch
    for k in range(1, beads):
        x = 18.5 + 58.0 * k / beads
        j = min(145, int((x - 18.5) / 0.4))
        y, low, high = spine[j][1], BELLY(x), BACK(x)
        reach = 0.62 if x < 60 else 0.8
        picture.stroke(bow(x, y, x + 3.4 * (high - y) / 12, mix(y, high, reach), 0.05, 0.24, 0.1), deep(0.05, 0.4))
        if x < 44:
            if k > 2:
                picture.stroke(bow(x, y, x + 4.5, mix(y, low, 0.86 - 0.004 * (x - 22)), 0.14, 0.27, 0.13), deep(0.04, 0.4))
        else:
            picture.stroke(bow(x, y, x + 3.4 * (y - low) / 12, mix(y, low, reach), -0.05, 0.24, 0.1), deep(0.05, 0.4))
    picture.stroke(spine, bead)
    for k in range(7):  # the plate that holds the tail's rays
        a = math.radians(-42 + 14 * k)
        picture.stroke(bow(75.5, 0.25, 75.5 + 5.0 * math.cos(a), 5.4 * math.sin(a), 0.0, 0.5, 0.3), deep(0.04, 0.4))
    for k in range(9):  # what holds the rays of the dorsal fin
        x = 36.0 + 2.4 * k
        picture.stroke(bow(x - 1.0, BACK(x) - 4.2, x, BACK(x) - 0.3, 0.0, 0.14, 0.26), deep(0.05, 0.4))
    return picture


# --- Leaf: of a broad-leaved tree, 85 mm and its stalk, the tip at +x ---------------------------------------------------------------

LEAF_FROM, LEAF_TO = -20.0, 86.0
LEAF_WIDTH = Curve((-20, 0.95), (-3, 0.85), (-0.5, 1.1), (3, 7.0), (8, 13.2), (16, 18.6), (26, 21.6), (36, 21.6), (48, 18.4), (60, 13.2),
                   (70, 8.2), (78, 4.1), (83, 1.6), (86, 0.2))


def leaf_edge(x, side):
    teeth = x / 5.2 + 0.3 * side
    tooth = teeth - math.floor(teeth)
    return LEAF_WIDTH(x) * (1.0 + 0.06 * step(2, 10, x) * step(86, 74, x) * (tooth * step(1.0, 0.75, tooth) - 0.4))


def leaf_veins():
    """(points (x, y, radius), rank): the midrib, its side veins, the ladder between these."""
    out = [([(LEAF_FROM + 1.06 * k, 0.0, mix(1.25, 0.22, (k / 98) ** 0.8)) for k in range(99)], 0)]
    sides = []
    for side in (1, -1):
        lines = []
        for k in range(10):
            x0 = 1.0 + 7.4 * k + (1.9 if side < 0 else 0.0) + 0.9 * (noise(k + 0.5, side + 5.5, 7) - 0.5)
            line = []
            for n in range(41):
                s = n / 40
                x = x0 + (0.52 + 0.05 * k / 10) * 21 * s * step(110, -30, x0) * (0.75 + 0.55 * s)
                y = side * 0.965 * s * leaf_edge(x, side) * (1.0 - 0.05 * (1 - s) * s)
                line.append((x, y, mix(0.62, 0.2, s) * step(110, 10, x0)))
            lines.append(line)
            out.append((line, 1))
        sides.append(lines)
    for lines in sides:
        for a, b in zip(lines, lines[1:]):
            for n in range(2, 15):
                s = n / 15.5
                p, q = a[round(40 * min(1, s + 0.06))], b[round(40 * max(0, s - 0.10))]
                wave = 0.16 * (noise(3.1 * n, p[0], 9) - 0.5)
                out.append((bow(p[0], p[1], q[0], q[1], wave, 0.24, 0.2, 8), 2))
    return out


def leaf_picture(values):
    boxes = []
    for i in range(80):
        x = [mix(LEAF_FROM, LEAF_TO, (i + k) / 80) for k in (0, 1)]
        w = max(LEAF_WIDTH(x[0]), LEAF_WIDTH(x[1])) * 1.03
        boxes.append((x[0], -w, x[1], w))
    return Picture(768, 384, -21.0, -27.0, 108.0, values).cover(boxes, 0.6)


@lru_cache(maxsize=None)
def leaf_field():
    """Weight of a vein at a point: 1 in its middle; a channel for each rank."""
    picture = leaf_picture((0.0, 0.0, 0.0))
    for line, rank in leaf_veins():
        def paint(ch, d, t, rank=rank):
            ch[rank] = max(ch[rank], 1 - d * d)
            return ch
        picture.stroke(line, paint)
    return picture


def leaf(columns=150, rows=64):
    field = leaf_field()
    stations = spread(lambda x: 1 + 2 * step(4, 0, abs(x)) + 2 * math.exp((x - LEAF_TO) / 2.0) + 2 * math.exp((LEAF_FROM - x) / 0.8),
                      LEAF_FROM, LEAF_TO, columns)
    positions = [spread(lambda s: 1 + 1.1 * math.exp(-abs(s) / 0.07) + 2 * math.exp((abs(s) - 1) / 0.02), -1.0, 1.0, rows)] * (columns + 1)

    def point(i, j):
        x, s = stations[i], positions[i][j]
        return x, s * leaf_edge(x, 1 if s > 0 else -1)

    def height(i, j):
        x, y = point(i, j)
        w = LEAF_WIDTH(x)
        column = min(field.width - 1, max(0, int((x - field.left) * field.px)))
        row = min(field.height - 1, max(0, int((field.top - y) * field.px)))
        midrib, side = (field.data[k][row * field.width + column] for k in (0, 1))
        blade = step(-2.0, 3.0, x)
        # A stalk is round; the blade folds a little at the midrib, arches between side veins and bends down to the tip.
        stalk = LEAF_WIDTH(LEAF_FROM) * math.sqrt(max(0.0, 1 - (y / w) ** 2))
        edge = min(1.0, max(0.0, (w - abs(y)) / 0.5))
        half = mix(stalk, 0.26 * math.sqrt(edge * (2 - edge)) + 0.01, blade)
        middle = blade * (0.17 * (math.sqrt(y * y + 4.0) - 2.0) + 0.55 * math.sin(0.16 * x + 0.7) * (y / 20) ** 2)
        middle -= 0.0021 * max(0.0, x - 18) ** 2
        middle += blade * 0.35 * math.sin(0.55 * x - 0.35 * abs(y)) * step(2.0, 9.0, abs(y)) * step(86, 60, x)
        middle += 0.004 * min(0.0, x) ** 2
        rib = blade * (mix(0.75, 0.25, step(0, 80, x)) * math.sqrt(midrib) + 0.18 * math.sqrt(side)) * edge
        return middle + half + 0.2 * rib, middle - half - rib

    solid = Solid('leaf')
    pillow(solid, 'Leaf', columns, rows, point, height, field.uv)
    return [solid]


def leaf_layers():
    """Bottoms of epidermis, palisade, spongy tissue and veins, mm."""
    field = leaf_field()
    picture = leaf_picture((0.03, 0.16, 1.0, 2.0))
    at = [0]

    def tissue(x, y):
        row, column = int((picture.top - y) * picture.px), int((x - picture.left) * picture.px)
        at[0] = row * picture.width + column
        rib, side, ladder = (channel[at[0]] for channel in field.data)
        net = 1.0 - areole(x, y, 1.25)
        grain = noise(0.9 * x, 0.9 * y, 3) - 0.5
        vein = max(min(1.0, 2.5 * rib), min(1.0, 1.8 * side), 0.62 * min(1.0, 1.6 * ladder), 0.5 * net ** 2)
        vein = max(vein, step(1.0, -2.0, x))
        epidermis = 0.028
        palisade = epidermis + mix(0.13 + 0.04 * grain, 0.012, vein)
        return epidermis, palisade, palisade + mix(0.85, 0.012, vein ** 0.6), 2.0

    picture.fill(tissue)
    return picture


def leaf_relief():
    """Veins sink into the surface, the areas between them bulge, mm."""
    field = leaf_field()

    def height(x, y):
        at = int((field.top - y) * field.px) * field.width + int((x - field.left) * field.px)
        rib, side, ladder = (channel[at] for channel in field.data)
        return (0.05 * areole(x, y, 1.25) - 0.14 * math.sqrt(side) - 0.09 * math.sqrt(ladder) - 0.1 * math.sqrt(rib),)

    picture = leaf_picture((0.0,))
    picture.fill(height)
    return picture.normals()


# --- Gecko: seen from above, nose at -x, 105 mm with its tail ------------------------------------------------------------------------


def bend(points, n):
    """Points between points, smooth (Catmull and Rom 1974): all numbers of them."""
    out = []
    for i in range(len(points) - 1):
        p = [points[max(0, min(len(points) - 1, i + k))] for k in (-1, 0, 1, 2)]
        for s in range(n):
            f = s / n
            out.append(tuple(0.5 * (2 * b + (c - a) * f + (2 * a - 5 * b + 4 * c - d) * f * f + (3 * b - a - 3 * c + d) * f ** 3)
                             for a, b, c, d in zip(*p)))
    return out + [tuple(float(v) for v in points[-1])]


# (x, y, radius) along the back.
GECKO_BACK = bend([(1.4, 0.5, 1.5), (5.0, 0.6, 3.2), (9.5, 0.6, 4.7), (14.0, 0.4, 4.4), (18.0, 0.2, 3.1), (24.0, -0.3, 4.4),
                   (32.0, -1.2, 5.5), (41.0, -1.3, 5.6), (49.0, 0.0, 4.4), (54.0, 1.2, 3.3), (60.0, 2.2, 2.6), (66.0, 2.3, 3.0),
                   (72.0, 0.6, 3.1), (79.0, -3.0, 2.5), (86.0, -6.6, 1.9), (93.0, -7.4, 1.35), (99.0, -5.0, 0.95), (104.0, -1.5, 0.6)], 6)
# Of each leg: hip, knee, ankle (x, y), the direction the foot points in degrees, side.
GECKO_LEGS = [((22.5, 2.6), (26.5, 10.6), (18.5, 14.4), 118, 1), ((22.0, -2.8), (17.5, -10.6), (11.0, -15.4), -150, -1),
              ((51.5, 2.4), (46.0, 11.0), (55.0, 15.6), 60, 1), ((51.0, -1.4), (57.5, -9.4), (64.5, -14.6), -32, -1)]
GECKO_EYES = ((8.4, 4.15), (8.2, -2.9))


def gecko_toes(leg):
    """From the middle of the foot to the tip of each toe."""
    (ax, ay), direction, side = leg[2], leg[3], leg[4]
    for k in range(5):
        a = math.radians(direction + side * (k - 2) * 38)
        reach = (4.6, 5.6, 6.1, 5.8, 4.9)[k]
        yield (ax + 0.9 * math.cos(a), ay + 0.9 * math.sin(a)), (ax + reach * math.cos(a), ay + reach * math.sin(a))


def gecko_picture(width, values):
    boxes = [(x - r, y - r, x + r, y + r) for x, y, r in GECKO_BACK]
    for leg in GECKO_LEGS:
        for a, b in zip(leg, leg[1:3]):
            boxes.append((min(a[0], b[0]) - 2, min(a[1], b[1]) - 2, max(a[0], b[0]) + 2, max(a[1], b[1]) + 2))
        boxes.append((leg[2][0] - 7.6, leg[2][1] - 7.6, leg[2][0] + 7.6, leg[2][1] + 7.6))
    return Picture(width, width // 2, -2.0, -26.5, 108.0, values).cover(boxes, 0.8)


def gecko():
    solid, picture = Solid('gecko'), gecko_picture(2, ())
    blend = Blend((-2.5, -25.0, -5.2), (107.0, 25.0, 6.2), 0.6, 1.28)
    for (ax, ay, ar), (bx, by, br) in zip(GECKO_BACK, GECKO_BACK[1:]):
        blend.add((ax, ay, 0.0), ar, (bx, by, 0.0), br, 0.6)
    for leg in GECKO_LEGS:
        hip, knee, ankle, _, side = leg
        thick = 1.0 if hip[0] < 40 else 1.2
        blend.add((*hip, -0.6), 2.3 * thick, (*knee, -0.2), 1.75 * thick, 1.6)
        blend.add((*knee, -0.2), 1.75 * thick, (*ankle, -1.6), 1.2, 0.8)
        blend.add((*ankle, -1.7), 1.5, (*ankle, -1.7), 1.5, 0.8)
        for a, b in gecko_toes(leg):
            blend.add((*a, -1.8), 0.95, (*b, -2.0), 0.8, 0.5)
            blend.add((*b, -2.0), 1.2, (*b, -2.0), 1.2, 0.4)
    for x, y in GECKO_EYES:  # the lids protrude
        blend.add((x, y, 1.7), 1.9, (x, y, 1.7), 1.9, 1.2)
    blend.surface(solid, 'Gecko', picture.uv)
    eyes = []
    for (x, y), name in zip(GECKO_EYES, ('eye-left', 'eye-right')):
        out = 1 if name == 'eye-left' else -1
        axis = unit((-0.25, 0.72 * out, 0.62))
        ball_at = (x + 0.7 * axis[0], y + 0.7 * axis[1], 1.7 + 0.8 * axis[2])
        eyes.append(turned(ball(name, (0, 0, 0), (1.5, 1.5, 1.5), (('Pupil', 30), ('Iris', 66), ('Rim', 180)), 1, 16, 24), axis, ball_at))
    return [solid] + eyes


def turned(solid, axis, centre):
    """Its z axis turned to `axis`, moved to `centre`."""
    side = unit(cross((0.0, 0.0, 1.0), axis))
    up = cross(axis, side)
    solid.vertices = [tuple(centre[c] + x * side[c] + y * up[c] + z * axis[c] for c in range(3)) for x, y, z in solid.vertices]
    return solid


def gecko_spine(x, y):
    """(position along the back, 0 to 1; distance from its middle as a fraction of its width there)"""
    k = min(len(GECKO_BACK) - 2, max(0, bisect_right(GECKO_BACK, (x,)) - 1))
    (ax, ay, ar), (bx, by, br) = GECKO_BACK[k], GECKO_BACK[k + 1]
    t = min(1.0, max(0.0, (x - ax) / (bx - ax)))
    return (k + t) / (len(GECKO_BACK) - 1), abs(y - mix(ay, by, t)) / mix(ar, br, t)


@lru_cache(maxsize=None)
def scale_seed(i, j, jitter):
    """A net of triangles, one unit wide, each corner moved by up to `jitter`."""
    turn, out = 2 * math.pi * fraction(i, j, 11), jitter * fraction(i, j, 12)
    return i + 0.5 * (j & 1) + out * math.cos(turn), 0.8660254 * j + out * math.sin(turn), fraction(i, j, 13)


def scale(x, y, size, jitter):
    """(distance from the middle of the scale at this point, as a fraction of `size`; a random number of that scale, [0, 1))"""
    x, y = x / size, y / size
    row = math.floor(y / 0.8660254 + 0.5)
    best, number = 9.0, 0.0
    for j in (row - 1, row, row + 1):
        column = math.floor(x - 0.5 * (j & 1) + 0.5)
        for i in (column - 1, column, column + 1):
            px, py, k = scale_seed(i, j, jitter)
            d = (x - px) * (x - px) + (y - py) * (y - py)
            if d < best:
                best, number = d, k
    return math.sqrt(best), number


def tubercle(x, y):
    """The warts of the back, 0 between them, 1 on their tops: in crooked rows, not on the snout, the feet and under the flanks."""
    along, aside = gecko_spine(x, y)
    d, number = scale(x + 0.8 * noise(0.3 * x, 0.3 * y, 21), y, 2.5, 0.22)
    radius = (0.2 + 0.1 * number) * step(0.06, 0.16, along) * step(1.0, 0.75, aside) * step(1.0, 0.8, along)
    return (1 - (d / radius) ** 2) ** 2 if number > 0.25 and d < radius else 0.0


def gecko_skin(x, y):
    """Granular scales, round and close together, and warts among them, mm over the smooth surface."""
    d, number = scale(x, y, 0.62, 0.14)
    grain = max(0.0, 1 - (d / 0.56) ** 2) * (0.7 + 0.3 * number)
    return 0.036 * grain + 0.2 * tubercle(x, y)


def gecko_tissue(x, y):
    """Bottoms of the horny skin, of pigment, of flesh, of bone, mm."""
    along, aside = gecko_spine(x, y)
    d, number = scale(x, y, 0.62, 0.14)
    wart = tubercle(x, y)
    horn = 0.03 + 0.03 * max(0.0, 1 - (d / 0.56) ** 2) + 0.05 * wart
    ragged = 0.02 * (noise(0.22 * x, 0.22 * y, 5) - 0.5) + 0.008 * (noise(0.9 * x, 0.9 * y, 6) - 0.5)
    band = 0.5 + 0.5 * math.cos(2 * math.pi * 11.0 * (along + ragged))
    back, fleck = step(1.25, 0.7, aside), noise(1.1 * x, 1.1 * y, 8)
    dark = step(0.42, 0.72, band + 0.3 * (fleck - 0.5)) * back
    pigment = 0.004 + 0.02 * back * (0.4 + 1.2 * fleck) + 0.26 * dark + 0.12 * wart + 0.1 * step(0.7, 0.85, fleck) * back
    pigment *= 0.8 + 0.4 * number  # each scale has its own
    return horn, horn + pigment, 3.5, 3.5


def gecko_layers():
    picture = gecko_picture(1024, (0.06, 0.12, 3.5, 3.5))
    picture.fill(gecko_tissue)
    tail = [(x, y, mix(0.75, 0.28, k / len(GECKO_BACK))) for k, (x, y, r) in enumerate(GECKO_BACK) if k > 16]

    def beaded(beads):
        def bead(ch, d, t):
            waist = 1.0 - 0.35 * (0.5 + 0.5 * math.cos(2 * math.pi * beads * t)) ** 2
            return deep(0.5, 1.2)(ch, d / waist, t) if d < waist else ch
        return bead
    for k in range(30, 51, 2):  # ribs
        x, y, r = GECKO_BACK[k]
        for side in (1, -1):
            picture.stroke(bow(x, y, x + 2.6, y + side * 0.86 * r, -0.16 * side, 0.34, 0.2), deep(0.7, 1.2))
    for leg in GECKO_LEGS:
        hip, knee, ankle = leg[:3]
        for a, b, r in ((hip, knee, 0.6), (knee, ankle, 0.5)):
            near, far = (tuple(mix(p, q, f) for p, q in zip(a, b)) for f in (0.2, 0.8))
            picture.stroke([(*a, 1.3 * r), (*near, r), (*far, r), (*b, 1.3 * r)], deep(0.55, 1.2))
        for a, b in gecko_toes(leg):
            for f in (0.1, 0.45, 0.72):
                near, far = (tuple(mix(p, q, g) for p, q in zip(a, b)) for g in (f, f + 0.22))
                picture.stroke([(*near, 0.24), (*far, 0.2)], deep(0.2, 0.8))
    for side in (1, -1):  # jaws
        picture.stroke(bow(1.6, 0.5 + 0.7 * side, 13.0, 0.5 + 3.6 * side, 0.16 * side, 0.34, 0.5), deep(0.6, 1.2))
    picture.stroke(tail, beaded(44))
    return picture


# --- Veins: the bust of make_assets.py, painted from in front ------------------------------------------------------------------------

# (x, y, radius) of the large veins of the right half, mm: brow, temple, cheek, jaw and neck, shoulder.
HEAD_VEINS = [
    [(3, 206, 1.0), (5, 222, 1.5), (9, 240, 1.7), (7, 258, 1.5), (13, 276, 1.1), (18, 290, 0.7)],
    [(67, 176, 1.3), (66, 195, 1.7), (61, 212, 1.8), (63, 230, 1.6), (53, 248, 1.4), (46, 268, 1.0), (36, 284, 0.6)],
    [(11, 200, 0.8), (14, 188, 1.1), (20, 174, 1.2), (31, 162, 1.4), (42, 145, 1.5), (50, 130, 1.6), (53, 119, 1.7)],
    [(53, 122, 1.7), (46, 104, 2.0), (42, 86, 2.1), (41, 68, 2.1), (52, 50, 1.9), (70, 33, 1.6)],
    [(12, 92, 1.2), (10, 74, 1.5), (14, 56, 1.6), (20, 40, 1.5), (16, 20, 1.2)],
    [(26, 24, 1.1), (46, 22, 1.3), (64, 14, 1.3), (78, 20, 1.0)],
]


def head_veins():
    """Lines of points (x, y, radius): the large ones of either side, not quite alike, and their branches."""
    out, sprouts = [], []

    def wander(points, seed):
        line = []
        for k, (x, y, r) in enumerate(bend(points, 7)):
            aside, up = noise(0.16 * y, 0.05 * x, seed) - 0.5, noise(0.16 * x, 0.05 * y, seed + 1) - 0.5
            line.append((x + 3.2 * aside, y + 3.2 * up, 1.35 * r))
        out.append(line)
        for k in range(4, len(line) - 3, 6):
            (ax, ay, r), (bx, by, _) = line[k], line[k + 1]
            turn = (1 if fraction(k, seed, 1) < 0.5 else -1) * (0.5 + 0.6 * fraction(k, seed, 2))
            sprouts.append((ax, ay, 0.72 * r, math.atan2(by - ay, bx - ax) + turn, 24 + 26 * fraction(k, seed, 3), seed * 31 + k, 0))

    for i, points in enumerate(HEAD_VEINS):
        for side in (1, -1):
            wander([(side * x * (1.0 if side > 0 else 0.96), y + (0 if side > 0 else 2.5), r) for x, y, r in points], 10 * i + 3 * side + 4)
    while sprouts:
        x, y, r, angle, length, seed, rank = sprouts.pop()
        line, n = [], max(4, int(length / 2.4))
        for k in range(n):
            line.append((x, y, r * (1.0 - 0.62 * k / n)))
            angle += 0.55 * (noise(0.5 * k, 0.37 * seed, 6) - 0.5) + 0.12 * (fraction(k, seed, 7) - 0.5)
            x, y = x + 2.4 * math.cos(angle), y + 2.4 * math.sin(angle)
            if rank < 2 and k in (n // 3, 2 * n // 3):
                turn = (1 if fraction(k, seed, 8) < 0.5 else -1) * (0.55 + 0.4 * fraction(k, seed, 9))
                sprouts.append((x, y, 0.72 * line[-1][2], angle + turn, 0.62 * length, seed * 7 + k, rank + 1))
        out.append(line)
    return sorted(out, key=lambda line: line[0][2])


def head_picture(values):
    return Picture(440, 682, -100.0, -5.0, 200.0, values)


def head_layers():
    """Bottoms of epidermis, dermis, blood, fat, mm."""
    picture = head_picture((0.1, 1.7, 1.7, 12.0))

    def skin(x, y):
        grain, blush = noise(0.9 * x, 0.9 * y, 3) - 0.5, noise(0.06 * x, 0.06 * y, 4) - 0.5
        lips = step(1.0, 0.55, math.hypot(x / 19.0, (y - 148.5) / 8.5))
        dermis = mix(1.7 + 0.3 * blush, 0.7, lips)
        return 0.075 + 0.02 * grain - 0.035 * lips, dermis, dermis + 0.16 + 0.12 * blush + 0.8 * lips, 12.0

    picture.fill(skin)

    def vein(ch, d, t=0.0):
        h = math.sqrt(1 - d * d)
        return ch[0], min(ch[1], 1.5 - 1.35 * h), max(ch[2], 1.5 + 1.6 * h), ch[3]

    for line in head_veins():
        picture.stroke(line, vein)
    return picture


def head():
    vertices, faces = bust(150, 176)
    solid, picture = Solid('head'), head_picture(())
    solid.vertices = vertices
    for face in faces:
        solid.face('Skin', face, [picture.uv(*vertices[c]) for c in face])
    return [solid]


# --- The list of models -------------------------------------------------------------------------------------------------------------

MESHES = {
    'fish': ('a small fish, 100 mm long', lambda: fish(4800)),
    'leaf': ('a leaf, 85 mm and its stalk', leaf),
    'gecko': ('a gecko, 105 mm with its tail', gecko),
    'veined-head': ('the bust, with coordinates of a picture painted from in front', head),
    'leaf-1000': ('a leaf, coarse', lambda: leaf(32, 14)),
    'fish-1400': ('a small fish, coarse', lambda: fish(1400)),
    'fish-5000': ('a small fish', lambda: fish(5000)),
    'fish-20000': ('a small fish, fine', lambda: fish(20000)),
}


def skin_of(picture, height):
    picture.fill(lambda x, y: (height(x, y),))
    return picture.normals()


PICTURES = {
    'fish-layers': (lambda: fish_layers(fish_picture(768, (0.15, 0.3, 4.0, 4.0))), 16, 4.0),
    'fish-normal': (lambda: skin_of(fish_picture(768, (0.0,)), fish_skin), 8, 1.0),
    'leaf-layers': (leaf_layers, 16, 2.0),
    'leaf-normal': (leaf_relief, 8, 1.0),
    'veined-head-layers': (head_layers, 16, 12.0),
    'gecko-layers': (gecko_layers, 16, 3.5),
    'gecko-normal': (lambda: skin_of(gecko_picture(1536, (0.0,)), gecko_skin), 8, 1.0),
}
ON_REQUEST = ('leaf-1000', 'fish-1400', 'fish-5000', 'fish-20000')


def main():
    known = list(MESHES) + list(PICTURES)
    names = []
    for word in sys.argv[2:] or ['*']:
        all_of = [name for name in known if name not in ON_REQUEST and name.startswith(word[:-1])] if word.endswith('*') else []
        names += all_of or [word]
    if len(sys.argv) < 2 or sys.argv[1].startswith('-') or any(name not in known for name in names):
        sys.exit(f'{__doc__}\nNAMEs: {" ".join(known)}')
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        if name in MESHES:
            comment, make = MESHES[name]
            write_obj(folder / f'{name}.obj', comment, make())
        else:
            make, bits, scale = PICTURES[name]
            make().write(folder / f'{name}.png', bits, scale)


if __name__ == '__main__':
    main()
