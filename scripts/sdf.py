#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Solids as signed distance functions over numpy arrays, and closed meshes of them.

A function takes points, float32 of shape (3, n), and gives n distances: negative inside. Distances are exact for spheres and capsules and
near the surface for the rest, which is all that blends (Quilez 2013) and meshes need. `mesh` finds the cells at the surface from coarse
to fine, puts a vertex into each (surface nets, Gibson 1998), and moves it onto the surface. Deterministic.
"""
import struct
import zlib

import numpy as np

FLOAT = np.float32


def points(*xyz):
    return np.array(xyz, FLOAT).reshape(3, -1)


def length(p):
    return np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])


def at(p, centre):
    return p - points(*centre)


def turn(p, axis, degrees):
    """Points in a frame that is rotated about axis 0, 1 or 2."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    q = p.copy()
    q[i], q[j] = c * p[i] + s * p[j], c * p[j] - s * p[i]
    return q


def sphere(p, centre, radius):
    return length(at(p, centre)) - FLOAT(radius)


def ellipsoid(p, centre, radii):
    q = at(p, centre) / points(*radii)
    k0, k1 = length(q), length(q / points(*radii))
    return k0 * (k0 - 1) / np.maximum(k1, FLOAT(1e-9))


def cone(p, a, b, ra, rb=None):
    """A capsule from a to b whose radius goes from ra to rb."""
    rb = ra if rb is None else rb
    pa, ba = at(p, a), points(*b) - points(*a)
    h = np.clip((pa * ba).sum(0) / (ba * ba).sum(), 0, 1)
    return length(pa - ba * h) - (FLOAT(ra) + FLOAT(rb - ra) * h)


def chain(p, knots):
    """Through knots (x, y, z, radius)."""
    d = None
    for a, b in zip(knots, knots[1:]):
        c = cone(p, a[:3], b[:3], a[3], b[3])
        d = c if d is None else np.minimum(d, c)
    return d


def curve(knots, steps=4):
    """Knots on the Catmull-Rom spline through knots, `steps` for each."""
    q = np.array(knots, float)
    q = np.vstack([2 * q[0] - q[1], q, 2 * q[-1] - q[-2]])
    out = []
    for i in range(1, len(q) - 2):
        a, b, c, d = q[i - 1:i + 3]
        for t in np.arange(steps) / steps:
            out.append(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t * t + (3 * b - a - 3 * c + d) * t ** 3))
    return [tuple(k) for k in out + [q[-2]]]


def join(a, b, k):
    """Union with a fillet of about k (polynomial smooth minimum)."""
    h = np.maximum(FLOAT(k) - np.abs(a - b), 0)
    return np.minimum(a, b) - h * h * FLOAT(0.25 / k)


def cut(a, b, k):
    """a without b."""
    return -join(-a, b, k)


def meet(a, b, k):
    """Intersection."""
    return -join(-a, -b, k)


def where(p, d, near, change):
    """change(points, distances) where `near`, d elsewhere: parts are evaluated only in their own neighbourhood."""
    index = np.flatnonzero(near)
    if index.size:
        d = d.copy()
        d[index] = change(p[:, index], d[index])
    return d


def hashed(i, j, k, seed):
    h = (i.astype(np.uint32) * np.uint32(374761393) + j.astype(np.uint32) * np.uint32(668265263) +
         k.astype(np.uint32) * np.uint32(2246822519) + np.uint32(seed * 3266489917 & 0xffffffff))
    h = (h ^ (h >> np.uint32(13))) * np.uint32(1274126177)
    return ((h ^ (h >> np.uint32(16))) & np.uint32(0xffffff)).astype(FLOAT) * FLOAT(1 / 16777216)


def noise(p, size, seed=0):
    """Smooth, in [0, 1], hills of about `size`."""
    q = p / FLOAT(size)
    cell = np.floor(q)
    f = q - cell
    f = f * f * (3 - 2 * f)
    i, j, k = cell.astype(np.int64)
    total = np.zeros(p.shape[1], FLOAT)
    for di in (0, 1):
        for dj in (0, 1):
            for dk in (0, 1):
                w = (f[0] if di else 1 - f[0]) * (f[1] if dj else 1 - f[1]) * (f[2] if dk else 1 - f[2])
                total += w * hashed(i + di, j + dj, k + dk, seed)
    return total


def gradient(distance, p, step):
    e = FLOAT(step)
    return np.stack([distance(p + points(*(e if a == b else 0 for b in range(3)))) -
                     distance(p - points(*(e if a == b else 0 for b in range(3)))) for a in range(3)]) / (2 * e)


CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], np.int64)
BATCH = 1 << 20


def in_batches(distance, p):
    return np.concatenate([distance(np.ascontiguousarray(p[:, i:i + BATCH])) for i in range(0, p.shape[1], BATCH)] or [np.zeros(0, FLOAT)])


def cells_at_surface(distance, low, high, size):
    """Cells (n, 3) of a grid of `size` from `low` near the surface, their corners (n, 8), the distance at each corner, and the grid's
    shape."""
    levels = 5
    step = 2 ** (levels - 1)
    count = np.ceil((np.array(high) - low) / (size * step)).astype(np.int64)
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing='ij'), -1).reshape(-1, 3) * step
    while step > 1:
        centre = (np.array(low)[:, None] + (cells.T + 0.5 * step) * size).astype(FLOAT)
        # Blends underestimate distances by half at most, and ellipsoids overestimate them: twice the half diagonal is a sufficient margin.
        cells = cells[np.abs(in_batches(distance, centre)) < 1.8 * step * size]
        step //= 2
        cells = (cells[:, None, :] + CORNERS[None] * step).reshape(-1, 3)
    shape = (np.ceil((np.array(high) - low) / size).astype(np.int64) // 16 + 2) * 16 + 1
    corner = cells[:, None, :] + CORNERS[None]
    key = (corner[..., 0] * shape[1] + corner[..., 1]) * shape[2] + corner[..., 2]
    unique, inverse = np.unique(key, return_inverse=True)
    p = np.stack([unique // (shape[1] * shape[2]), unique // shape[2] % shape[1], unique % shape[2]])
    return cells, inverse.reshape(key.shape), in_batches(distance, (np.array(low)[:, None] + p * size).astype(FLOAT)), shape


EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count('1') == 1]


def patches():
    """For each of the 256 patterns of inside corners: the patch of surface that each edge of the cell belongs to, -1 where the surface
    does not cross it. Where a face of the cell is ambiguous, its inside corners are separated: both cells at the face do the same,
    and each patch gets a vertex of its own, so that the mesh is a manifold (Nielson 2004)."""
    table = np.full((256, len(EDGES)), -1, np.int64)
    number = {edge: n for n, edge in enumerate(EDGES)}
    sides = [[c for c in range(8) if c >> axis & 1 == side] for axis in range(3) for side in (0, 1)]
    for pattern in range(256):
        inside = [pattern >> c & 1 for c in range(8)]
        group = {n: n for n, (a, b) in enumerate(EDGES) if inside[a] != inside[b]}

        def root(n):
            while group[n] != n:
                n = group[n]
            return n

        for side in sides:
            crossed = [number[e] for e in EDGES if e[0] in side and e[1] in side and number[e] in group]
            pairs = [crossed] if len(crossed) == 2 else [[n for n in crossed if c in EDGES[n]] for c in side if inside[c] and crossed]
            for a, b in pairs:
                group[root(a)] = root(b)
        names = sorted({root(n) for n in group})
        for n in group:
            table[pattern, n] = names.index(root(n))
    return table


def mesh(distance, low, high, size):
    """Vertices (n, 3), their normals, and quadrilaterals (m, 4), turned outward; closed, the solid has to be inside the box. Where two
    patches of neighbours touch along an edge, the corner between them that is least deep is taken out of the solid."""
    cells, corner, value, shape = cells_at_surface(distance, low, high, size)
    for _ in range(20):
        inside = value[corner] < 0
        keep = np.flatnonzero(inside.any(1) & ~inside.all(1))
        vertices, normals, faces, owner = mesh_of_cells(distance, low, size, cells[keep], value[corner[keep]], shape)
        edges = crowded_edges(faces)
        if not len(edges):
            return vertices, normals, faces
        for a, b in keep[owner[edges]]:
            shared = np.intersect1d(corner[a], corner[b])
            shared = shared[value[shared] < 0]
            value[shared[np.argmax(value[shared])]] = FLOAT(0.02 * size)
    raise ValueError('parts of the solid are too thin for the grid')


def mesh_of_cells(distance, low, size, cells, value, shape):
    patch = patches()[((value < 0) * (1 << np.arange(8))).sum(1)]
    first = np.concatenate([[0], np.cumsum(patch.max(1) + 1)])
    total, weight = np.zeros((first[-1], 3)), np.zeros(first[-1])
    for n, (a, b) in enumerate(EDGES):
        crosses = np.flatnonzero(patch[:, n] >= 0)
        va, vb = value[crosses, a], value[crosses, b]
        t = (va / (va - vb))[:, None]
        vertex = first[crosses] + patch[crosses, n]
        np.add.at(total, vertex, cells[crosses] + CORNERS[a] + t * (CORNERS[b] - CORNERS[a]))
        weight += np.bincount(vertex, minlength=first[-1])
    p = np.ascontiguousarray((np.array(low) + total / weight[:, None] * size).T.astype(FLOAT))
    for step in range(3):  # onto the surface, by no more than a fraction of a cell: cells stay in order
        g = gradient(lambda q: in_batches(distance, q), p, 0.1 * size)
        if step < 2:
            move = in_batches(distance, p) / np.maximum((g * g).sum(0), FLOAT(0.25))
            p = p - g * np.clip(move, -0.3 * size, 0.3 * size)
    key = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    order = np.argsort(key)
    ordered, stride, number = key[order], np.array([shape[1] * shape[2], shape[2], 1]), {edge: n for n, edge in enumerate(EDGES)}
    faces = []
    for axis in range(3):
        # The edge from corner 0 along the axis: four cells share it, with a different corner index in each.
        along, u, v = (4 >> (axis + k) % 3 for k in range(3))
        crossed = np.flatnonzero(patch[:, number[0, along]] >= 0)
        quad = []
        for corner in (0, u, u | v, v):
            back = sum(stride[k] for k in range(3) if corner & 4 >> k)
            position = np.searchsorted(ordered, key[crossed] - back)
            if (ordered[np.minimum(position, len(ordered) - 1)] != key[crossed] - back).any():
                raise ValueError('the solid reaches the border of its box')
            cell = order[position]
            quad.append(first[cell] + patch[cell, number[corner, corner | along]])
        quad = np.stack(quad, 1)
        outside = value[crossed, 0] >= 0
        quad[outside] = quad[outside][:, ::-1]
        faces.append(quad)
    owner = np.repeat(np.arange(len(cells)), np.diff(first))
    return p.T.astype(float), (g / np.maximum(length(g), FLOAT(1e-9))).T.astype(float), np.concatenate(faces), owner


def crowded_edges(faces):
    """Edges (n, 2) that more than one face traverses in the same direction."""
    a, b = faces.reshape(-1).astype(np.int64), np.roll(faces, -1, 1).reshape(-1).astype(np.int64)
    n = int(faces.max()) + 1
    edge, count = np.unique(a * n + b, return_counts=True)
    edge = edge[count > 1]
    return np.stack([edge // n, edge % n], 1)


# --- Layouts, maps, files -------------------------------------------------------------------------------------------------------------

def triangles(faces):
    return faces if faces.shape[1] == 3 else np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def unfold(vertices, normals, faces, charts):
    """charts(vertices, normals, faces) gives each face its chart and each of its corners (u, v): vertices are doubled where they differ."""
    chart, uv = charts(vertices, normals, faces)
    key = np.round(np.column_stack([faces.reshape(-1), uv.reshape(-1, 2) * 65536])).astype(np.int64)
    key = (key[:, 0] << 36) + (key[:, 1] << 18) + key[:, 2]
    unique, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    old = faces.reshape(-1)[first]
    return vertices[old], normals[old], inverse.reshape(faces.shape), uv.reshape(-1, 2)[first]


def positions(vertices, faces, uv, size, values=None):
    """For each texel of a map of size x size, rows from the top: the point of the surface there, extended beyond the charts."""
    corner = triangles(faces)
    what = vertices if values is None else values
    grid = np.full((size, size, what.shape[1]), np.nan, FLOAT)
    texel = uv * size
    a, b, c = (texel[corner[:, k]] for k in range(3))
    side = np.maximum(np.abs(b - a).max(1), np.maximum(np.abs(c - a).max(1), np.abs(c - b).max(1)))
    for steps, low, high in ((3, 0, 2), (8, 2, 6), (24, 6, 20)):
        some = corner[(side >= low) & (side < high)]
        for i in range(steps + 1):
            for j in range(steps + 1 - i):
                w = np.array([i, j, steps - i - j]) / steps
                at_uv = sum(w[k] * texel[some[:, k]] for k in range(3))
                x, y = np.clip(at_uv[:, 0].astype(int), 0, size - 1), np.clip(size - 1 - at_uv[:, 1].astype(int), 0, size - 1)
                grid[y, x] = sum(w[k] * what[some[:, k]] for k in range(3))
    for _ in range(12):
        hole = np.isnan(grid[..., 0])
        for axis, move in ((0, 1), (0, -1), (1, 1), (1, -1)):
            other = np.roll(grid, move, axis)
            take = hole & ~np.isnan(other[..., 0])
            grid[take] = other[take]
            hole &= ~take
    return np.nan_to_num(grid)


def enlarge(grid, times):
    """Bilinear, texel centres on texel centres."""
    n = grid.shape[0]
    where_ = (np.arange(n * times) + 0.5) / times - 0.5
    low = np.clip(np.floor(where_).astype(int), 0, n - 2)
    f = np.clip(where_ - low, 0, 1).astype(FLOAT)
    rows = grid[low] * (1 - f)[:, None, None] + grid[low + 1] * f[:, None, None]
    return rows[:, low] * (1 - f)[None, :, None] + rows[:, low + 1] * f[None, :, None]


def normal_map(height, position):
    """Tangent space, +Y up, from heights in mm and the surface positions of the texels."""
    def slope(axis):
        span = np.sqrt(((np.roll(position, -1, axis) - np.roll(position, 1, axis)) ** 2).sum(2))
        rise = np.roll(height, -1, axis) - np.roll(height, 1, axis)
        return np.where(span < 4, rise / np.maximum(span, 0.1), 0)
    n = np.stack([-slope(1), slope(0), np.ones_like(height)], -1)
    return 0.5 + 0.5 * n / np.sqrt((n * n).sum(2, keepdims=True))


def srgb(linear):
    v = np.clip(linear, 0, 1)
    return np.where(v < 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def write_png(path, picture):
    """Values in [0, 1], (h, w, 3) or (h, w), as 8 bits."""
    rows = (np.clip(picture, 0, 1) * 255 + 0.5).astype(np.uint8)
    height, width = rows.shape[:2]
    rows = rows.reshape(height, -1)
    # Each byte minus the one above it (filter 2) compresses well.
    packed = np.hstack([np.full((height, 1), 2, np.uint8), rows - np.vstack([np.zeros_like(rows[:1]), rows[:-1]])])

    def part(name, data):
        return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))

    path.write_bytes(b'\x89PNG\r\n\x1a\n' +
                     part(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 0 if picture.ndim == 2 else 2, 0, 0, 0)) +
                     part(b'IDAT', zlib.compress(packed.tobytes(), 3)) + part(b'IEND', b''))


def write_ply(path, vertices, normals, faces, uv=None, color=None):
    """color: linear, of each vertex; written in sRGB, 8 bits, as PLY files have it."""
    fields = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('nx', '<f4'), ('ny', '<f4'), ('nz', '<f4')]
    columns = [vertices, normals]
    if uv is not None:
        fields += [('s', '<f4'), ('t', '<f4')]
        columns.append(uv)
    if color is not None:
        fields += [('red', 'u1'), ('green', 'u1'), ('blue', 'u1')]
        columns.append(255 * srgb(color) + 0.5)
    rows = np.empty(len(vertices), fields)
    for (name, _), values in zip(fields, np.hstack(columns).T):
        rows[name] = values
    kinds = {'<f4': 'float', 'u1': 'uchar'}
    header = ['ply', 'format binary_little_endian 1.0', f'element vertex {len(vertices)}', *(f'property {kinds[k]} {n}' for n, k in fields),
              f'element face {len(faces)}', 'property list uchar int vertex_indices', 'end_header']
    corners = np.empty(len(faces), [('n', 'u1'), ('v', '<i4', faces.shape[1])])
    corners['n'], corners['v'] = faces.shape[1], faces
    path.write_bytes('\n'.join(header).encode() + b'\n' + rows.tobytes() + corners.tobytes())
