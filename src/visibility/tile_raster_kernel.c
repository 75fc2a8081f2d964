/* SPDX-License-Identifier: MIT
 *
 * tile_raster_kernel.c - rasterises triangles into tiles: 16 are transformed to camera space together, then each is tested against blocks
 * of 4 x 4 pixels; compiled once per SIMD level. All levels give the same bits.
 *
 * With a pixel's ray d = (x, y, 1) and vertices a, b, c in camera space, the edge functions d . (a - b) x (a + b) etc. give the side of the
 * pixel's centre relative to the planes through the camera and the triangle's sides (Olano and Greer 1997, "Triangle Scan Conversion Using
 * 2D Homogeneous Coordinates": no vertex is divided by its depth, so vertices may be behind the camera; signs as in light_grid_kernel.c).
 * Orthographic vertices are (x, y, 1) there. The nearness of a triangle, 1 / depth or -depth, is linear over the image; it is evaluated
 * relative to a vertex, where it is known exactly, and clamped to the range of the vertices.
 */
#include "visibility/tile_raster.h"

#include "math/lanes.h"
#include "math/scalar.h"

#include <float.h>

#define LANES 16
#define NEAREST 1e-6f /* mm; nearer vertices are taken to be behind the camera */
#define LARGEST 1e12f /* mm; products of three are finite */
#define FEW 8         /* blocks that are tested one by one without a common test first */

/* Triangles in camera space: vertex k, axis c. */
struct corners16 {
    _Alignas(64) float at[3][3][LANES];
};

struct bounds16 {
    _Alignas(64) int32_t x0[LANES], x1[LANES], y0[LANES], y1[LANES]; /* bounds in pixels; x0 > x1: none */
    float near[LANES], far[LANES];
};

struct setup16 {
    _Alignas(64) float edge[3][3][LANES];
    float q[LANES], qx[LANES], qy[LANES], x[LANES], y[LANES]; /* nearness: q at slopes (x, y), and its derivatives by slope */
    float low[LANES], high[LANES];
};

/* Slopes of a tile's pixels. */
struct grid {
    _Alignas(64) float x[PELL_RASTER_BLOCKS][LANES], y[PELL_RASTER_BLOCKS][LANES];
};

static void vertices(const struct pell_raster_view *view, const float *restrict position, size_t count,
                     struct pell_raster_vertex *restrict out)
{
    const struct pell_raster_view v = *view;

    for (size_t i = 0; i < count; i++) {
        const float px = position[3 * i], py = position[3 * i + 1], pz = position[3 * i + 2];
        const float x = px - v.origin.x, y = py - v.origin.y, z = pz - v.origin.z;
        out[i].camera[0] = x * v.right.x + y * v.right.y + z * v.right.z;
        out[i].camera[1] = x * v.up.x + y * v.up.y + z * v.up.z;
        out[i].camera[2] = x * v.forward.x + y * v.forward.y + z * v.forward.z;
        out[i].scene[0] = px;
        out[i].scene[1] = py;
        out[i].scene[2] = pz;
    }
}

INLINE void fetch(const struct pell_raster *r, const uint32_t *restrict list, int count, struct corners16 *restrict c)
{
    for (int i = 0; i < LANES; i++) {
        const uint32_t *corners = r->triangles[list[i < count ? i : 0]].vertex;
        for (int k = 0; k < 3; k++) {
            const float *v = r->vertices[corners[k]].camera;
            c->at[k][0][i] = v[0];
            c->at[k][1][i] = v[1];
            c->at[k][2][i] = v[2];
        }
    }
}

/* Prefetches the data of a later `fetch`: triangles or, once those are loaded, their vertices. */
INLINE void prefetch_triangles(const struct pell_raster *r, const uint32_t *list, size_t from, size_t count, bool loaded)
{
    const size_t end = from + LANES < count ? from + LANES : count;

    for (size_t i = from; i < end; i++) {
        const struct pell_raster_triangle *t = &r->triangles[list[i]];
        if (!loaded)
            __builtin_prefetch(t);
        for (int k = 0; loaded && k < 3; k++)
            __builtin_prefetch(&r->vertices[t->vertex[k]]);
    }
}

/* Bounds of the pixel centres that a triangle may cover, with a margin for rounding errors; the edge functions decide which are inside. */
INLINE void bound(const struct pell_raster *r, const struct corners16 *restrict c, struct bounds16 *restrict b)
{
    const float focal = r->view.focal, left = r->view.left, top = r->view.top, w = (float) r->width, h = (float) r->height;
    const float margin = 0.02f + 1e-6f * (w + h), flat = r->view.orthographic ? 1.0f : 0.0f;

    for (int i = 0; i < LANES; i++) {
        const float z0 = c->at[0][2][i], z1 = c->at[1][2][i], z2 = c->at[2][2][i];
        const float near = smaller(smaller(z0, z1), z2), far = larger(larger(z0, z1), z2), safe = near > NEAREST ? 1.0f : 0.0f;
        const float ahead = far > NEAREST ? 1.0f : 0.0f, keep = flat + (1.0f - flat) * (1.0f - safe), by = 1.0f - keep;
        const float w0 = focal / (keep + by * z0), w1 = focal / (keep + by * z1), w2 = focal / (keep + by * z2);
        const float x0 = c->at[0][0][i] * w0 - left, x1 = c->at[1][0][i] * w1 - left, x2 = c->at[2][0][i] * w2 - left;
        const float y0 = top - c->at[0][1][i] * w0, y1 = top - c->at[1][1][i] * w1, y2 = top - c->at[2][1][i] * w2;
        const float low_x = safe > 0.0f ? smaller(smaller(x0, x1), x2) - margin : 0.0f;
        const float low_y = safe > 0.0f ? smaller(smaller(y0, y1), y2) - margin : 0.0f;
        const float high_x = safe > 0.0f ? larger(larger(x0, x1), x2) + margin : w;
        const float high_y = safe > 0.0f ? larger(larger(y0, y1), y2) + margin : h;
        const float a = smaller(larger(low_x, 0.0f), w), d = smaller(larger(low_y, 0.0f), h);
        const float e = ahead * (smaller(larger(high_x, -1.0f), w - 1.0f) + 1.0f), g = smaller(larger(high_y, -1.0f), h - 1.0f) + 1.0f;
        const int32_t ai = (int32_t) a, di = (int32_t) d;
        b->x0[i] = ai + ((float) ai < a);
        b->y0[i] = di + ((float) di < d);
        b->x1[i] = (int32_t) e - 1;
        b->y1[i] = (int32_t) g - 1;
        b->near[i] = near;
        b->far[i] = far;
    }
}

/* Normals, not unit, and six times the volume with the camera, > 0 for a front face. */
INLINE void measure(const struct corners16 *restrict c, float flat, float *restrict nx, float *restrict ny, float *restrict volume)
{
    for (int i = 0; i < LANES; i++) {
        const float ax = c->at[0][0][i], ay = c->at[0][1][i], az = c->at[0][2][i];
        const float ex = c->at[1][0][i] - ax, ey = c->at[1][1][i] - ay, ez = c->at[1][2][i] - az;
        const float fx = c->at[2][0][i] - ax, fy = c->at[2][1][i] - ay, fz = c->at[2][2][i] - az;
        const float x = ey * fz - ez * fy, y = ez * fx - ex * fz, z = ex * fy - ey * fx, solid = x * ax + y * ay + z * az;
        nx[i] = x;
        ny[i] = y;
        volume[i] = flat > 0.0f ? z : solid;
    }
}

static bool spans(const struct pell_raster *r, size_t first, size_t end, struct pell_raster_span *out)
{
    const float flat = r->view.orthographic ? 1.0f : 0.0f;

    for (size_t t = first; t < end; t += LANES) {
        const int count = end - t < LANES ? (int) (end - t) : LANES;
        _Alignas(64) float nx[LANES], ny[LANES], volume[LANES];
        uint32_t list[LANES];
        struct corners16 c;
        struct bounds16 b;
        int bad = 0;

        for (int i = 0; i < LANES; i++)
            list[i] = (uint32_t) (t + (size_t) i);
        fetch(r, list, count, &c);
        bound(r, &c, &b);
        measure(&c, flat, nx, ny, volume);
        for (int i = 0; i < LANES; i++) {
            float sum = 0.0f;
            for (int k = 0; k < 3; k++)
                sum += fabsf(c.at[k][0][i]) + fabsf(c.at[k][1][i]) + fabsf(c.at[k][2][i]);
            bad |= !(sum < LARGEST) | (flat > 0.0f && b.near[i] <= NEAREST && b.far[i] > NEAREST);
        }
        if (bad)
            return false;
        for (int i = 0; i < count; i++) {
            const struct pell_mesh *m = &r->scene->meshes[r->triangles[t + (size_t) i].mesh];
            const bool none =
                b.x0[i] > b.x1[i] || b.y0[i] > b.y1[i] || volume[i] == 0.0f || (volume[i] < 0.0f && pell_rays_single_sided(r->scene, m));
            const unsigned back = volume[i] < 0.0f ? PELL_RASTER_BACK : 0;
            out[t + (size_t) i] =
                none ? (struct pell_raster_span) { 1, 0, 1, 0 }
                     : (struct pell_raster_span) { (uint16_t) (b.x0[i] / PELL_RASTER_TILE), (uint16_t) (b.x1[i] / PELL_RASTER_TILE),
                                                   (uint16_t) ((unsigned) (b.y0[i] / PELL_RASTER_TILE) | back),
                                                   (uint16_t) (b.y1[i] / PELL_RASTER_TILE) };
        }
    }
    return true;
}

/* --- A tile --------------------------------------------------------------------------------------------------------------------- */

INLINE void set_up(const struct corners16 *restrict c, const struct bounds16 *restrict b, float flat, struct setup16 *restrict s)
{
    _Alignas(64) float nx[LANES], ny[LANES], volume[LANES], side[LANES];

    measure(c, flat, nx, ny, volume);
    for (int i = 0; i < LANES; i++)
        side[i] = volume[i] < 0.0f ? -1.0f : 1.0f;
    for (int k = 0; k < 3; k++) {
        const int n = (k + 1) % 3;
        for (int i = 0; i < LANES; i++) {
            const float az = flat + (1.0f - flat) * c->at[k][2][i], bz = flat + (1.0f - flat) * c->at[n][2][i];
            const float dx = c->at[k][0][i] - c->at[n][0][i], dy = c->at[k][1][i] - c->at[n][1][i], dz = az - bz;
            const float sx = c->at[k][0][i] + c->at[n][0][i], sy = c->at[k][1][i] + c->at[n][1][i], sz = az + bz;
            s->edge[k][0][i] = side[i] * (dy * sz - dz * sy);
            s->edge[k][1][i] = side[i] * (dz * sx - dx * sz);
            s->edge[k][2][i] = side[i] * (dx * sy - dy * sx);
        }
    }
    for (int i = 0; i < LANES; i++) {
        /* relative to the farthest vertex, which is in front of the camera */
        const float z0 = c->at[0][2][i], z1 = c->at[1][2][i], far = b->far[i], near = b->near[i];
        const float x = z0 == far ? c->at[0][0][i] : z1 == far ? c->at[1][0][i] : c->at[2][0][i];
        const float y = z0 == far ? c->at[0][1][i] : z1 == far ? c->at[1][1][i] : c->at[2][1][i];
        const float by = flat > 0.0f ? 1.0f : 1.0f / far, per = 1.0f / volume[i];
        s->x[i] = x * by;
        s->y[i] = y * by;
        s->q[i] = flat > 0.0f ? -far : by;
        s->qx[i] = nx[i] * per;
        s->qy[i] = ny[i] * per;
        s->low[i] = s->q[i];
        s->high[i] = flat > 0.0f ? -near : near > NEAREST ? 1.0f / near : FLT_MAX;
    }
}

/* Whether no pixel of some blocks is inside. Edge functions are monotonic along rows and columns, also with rounding, so testing the
 * corners of the blocks is enough. */
INLINE bool is_outside(const struct setup16 *s, int i, float x0, float x1, float y0, float y1)
{
    for (int k = 0; k < 3; k++) {
        const float a = s->edge[k][0][i], b = s->edge[k][1][i];
        if (a * (a > 0.0f ? x1 : x0) + (b * (b > 0.0f ? y1 : y0) + s->edge[k][2][i]) < 0.0f)
            return true;
    }
    return false;
}

/* Draws triangle i of a set-up; `low`: for each block the farthest depth drawn so far, or NULL. */
INLINE void draw(const struct grid *g, const struct setup16 *s, int i, int32_t number, const int32_t blocks[4], const float *low,
                 struct pell_raster_tile *tile)
{
    const bool large = (blocks[1] - blocks[0] + 1) * (blocks[3] - blocks[2] + 1) > FEW;
    const vi name = (vi) { 0 } + number;

    /* y decreases from row to row */
    if (large && is_outside(s, i, g->x[blocks[0]][0], g->x[blocks[1]][LANES - 1], g->y[blocks[3]][LANES - 1], g->y[blocks[2]][0]))
        return;
    for (int row = blocks[2]; row <= blocks[3]; row++)
        for (int at = 0; at < LANES; at += WIDTH) {
            const vf y = load(g->y[row] + at), q = s->q[i] + (y - s->y[i]) * s->qy[i];
            const vf a = y * s->edge[0][1][i] + s->edge[0][2][i], b = y * s->edge[1][1][i] + s->edge[1][2][i],
                     c = y * s->edge[2][1][i] + s->edge[2][2][i];
            for (int column = blocks[0]; column <= blocks[1]; column++) {
                const int block = row * PELL_RASTER_BLOCKS + column;
                float *near = tile->near + block * LANES + at;
                const vf x = load(g->x[column] + at), old = load(near);
                vf sides, depth;
                vi won, names;

                if (low && s->high[i] <= low[block])
                    continue;
                sides = vmin(vmin(x * s->edge[0][0][i] + a, x * s->edge[1][0][i] + b), x * s->edge[2][0][i] + c);
                depth = vmin(vmax(q + (x - s->x[i]) * s->qx[i], splat(s->low[i])), splat(s->high[i]));
                won = (sides >= 0.0f) & (depth > old);
                memcpy(&names, tile->triangle + block * LANES + at, sizeof(names));
                names = (name & won) | (names & ~won);
                store(near, select(won, depth, old));
                memcpy(tile->triangle + block * LANES + at, &names, sizeof(names));
            }
        }
}

/* The tile's pixels from `from` to `to`, in blocks. False: none. */
INLINE bool clip(int32_t from, int32_t to, int32_t begin, int32_t *first, int32_t *last)
{
    const int32_t a = from - begin, b = to - begin;

    *first = (a > 0 ? a : 0) / PELL_RASTER_BLOCK;
    *last = (b < PELL_RASTER_TILE ? b : PELL_RASTER_TILE - 1) / PELL_RASTER_BLOCK;
    return a < PELL_RASTER_TILE && b >= 0 && a <= b;
}

static void rasterize_list(const struct pell_raster *r, const uint32_t *list, size_t count, int32_t x0, int32_t y0, const struct grid *g,
                           const float *low, struct pell_raster_tile *tile)
{
    const float flat = r->view.orthographic ? 1.0f : 0.0f;

    for (size_t first = 0; first < count; first += LANES) {
        const int n = count - first < LANES ? (int) (count - first) : LANES;
        struct corners16 c;
        struct bounds16 b;
        struct setup16 s;

        prefetch_triangles(r, list, first + 2 * LANES, count, false);
        prefetch_triangles(r, list, first + LANES, count, true);
        fetch(r, list + first, n, &c);
        bound(r, &c, &b);
        set_up(&c, &b, flat, &s);
        for (int i = 0; i < n; i++) {
            int32_t blocks[4];
            if (clip(b.x0[i], b.x1[i], x0, &blocks[0], &blocks[1]) && clip(b.y0[i], b.y1[i], y0, &blocks[2], &blocks[3]))
                draw(g, &s, i, (int32_t) list[first + (size_t) i], blocks, low, tile);
        }
    }
}

static void tile(const struct pell_raster *r, int number, struct pell_raster_tile *out)
{
    const uint32_t *first = r->first + 2 * (size_t) number;
    const int x0 = number % r->columns * PELL_RASTER_TILE, y0 = number / r->columns * PELL_RASTER_TILE;
    const float none = r->view.orthographic ? -FLT_MAX : 0.0f;
    _Alignas(64) float low[PELL_RASTER_BLOCKS * PELL_RASTER_BLOCKS];
    struct grid g;

    for (int k = 0; k < PELL_RASTER_BLOCKS; k++)
        for (int i = 0; i < LANES; i++) {
            g.x[k][i] = r->slope_x[x0 + k * PELL_RASTER_BLOCK + i % PELL_RASTER_BLOCK];
            g.y[k][i] = r->slope_y[y0 + k * PELL_RASTER_BLOCK + i / PELL_RASTER_BLOCK];
        }
    for (int i = 0; i < PELL_RASTER_TILE * PELL_RASTER_TILE; i++) {
        out->near[i] = none;
        out->triangle[i] = -1;
    }
    rasterize_list(r, r->entries + first[0], first[1] - first[0], x0, y0, &g, NULL, out);
    if (first[1] == first[2])
        return;
    for (int k = 0; k < PELL_RASTER_BLOCKS * PELL_RASTER_BLOCKS; k++) {
        low[k] = out->near[k * LANES];
        for (int i = 1; i < LANES; i++)
            low[k] = smaller(low[k], out->near[k * LANES + i]);
    }
    rasterize_list(r, r->entries + first[1], first[2] - first[1], x0, y0, &g, low, out);
}

/* --- Hits ----------------------------------------------------------------------------------------------------------------------- */

INLINE void side_of(const float a[3][LANES], const float b[3][LANES], const struct pell_ray16 *ray, float *restrict out)
{
    for (int i = 0; i < LANES; i++) {
        const float dx = a[0][i] - b[0][i], dy = a[1][i] - b[1][i], dz = a[2][i] - b[2][i];
        const float sx = a[0][i] + b[0][i], sy = a[1][i] + b[1][i], sz = a[2][i] + b[2][i];
        out[i] = (dy * sz - dz * sy) * ray->dx[i] + (dz * sx - dx * sz) * ray->dy[i] + (dx * sy - dy * sx) * ray->dz[i];
    }
}

static void intersect(const struct pell_raster *r, const int32_t *triangle, struct pell_ray_hit16 *packet, struct pell_corners *corners)
{
    const struct pell_vec3 forward = r->view.forward;
    struct pell_ray16 *restrict ray = &packet->ray;
    struct pell_hit16 *restrict hit = &packet->hit;
    _Alignas(64) float dir[3][3][LANES], side[3][LANES];
    int first = 0;

    while (triangle[first] < 0)
        first++;
    for (int i = 0; i < LANES; i++) {
        const uint32_t number = (uint32_t) triangle[triangle[i] >= 0 ? i : first];
        const struct pell_raster_triangle *t = &r->triangles[number];

        hit->mesh[i] = triangle[i] >= 0 ? t->mesh : PELL_NO_HIT;
        hit->triangle[i] = number - r->first_triangle[t->mesh];
        for (int k = 0; k < 3; k++) {
            const float *p = r->vertices[t->vertex[k]].scene;
            corners->vertex[k][i] = t->vertex[k] - r->first_vertex[t->mesh];
            for (int c = 0; c < 3; c++)
                corners->position[k][c][i] = p[c];
        }
    }
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++) {
            dir[k][0][i] = corners->position[k][0][i] - ray->ox[i];
            dir[k][1][i] = corners->position[k][1][i] - ray->oy[i];
            dir[k][2][i] = corners->position[k][2][i] - ray->oz[i];
        }
    side_of((const float(*)[LANES]) dir[0], (const float(*)[LANES]) dir[1], ray, side[2]);
    side_of((const float(*)[LANES]) dir[1], (const float(*)[LANES]) dir[2], ray, side[0]);
    side_of((const float(*)[LANES]) dir[2], (const float(*)[LANES]) dir[0], ray, side[1]);
    for (int i = 0; i < LANES; i++) {
        const float turn = side[0][i] + side[1][i] + side[2][i] < 0.0f ? -1.0f : 1.0f;
        const float a = larger(turn * side[0][i], 0.0f), b = larger(turn * side[1][i], 0.0f), c = larger(turn * side[2][i], 0.0f);
        const float sum = a + b + c, per = sum > 0.0f ? 1.0f / sum : 0.0f, u = b * per, v = c * per, w = sum > 0.0f ? a * per : 1.0f;
        float z[3];
        for (int k = 0; k < 3; k++)
            z[k] = dir[k][0][i] * forward.x + dir[k][1][i] * forward.y + dir[k][2][i] * forward.z;
        hit->u[i] = u;
        hit->v[i] = v;
        ray->tfar[i] = larger(w * z[0] + u * z[1] + v * z[2], NEAREST);
    }
    for (int i = 0; i < LANES; i++) {
        const float ex = dir[1][0][i] - dir[0][0][i], ey = dir[1][1][i] - dir[0][1][i], ez = dir[1][2][i] - dir[0][2][i];
        const float fx = dir[2][0][i] - dir[0][0][i], fy = dir[2][1][i] - dir[0][1][i], fz = dir[2][2][i] - dir[0][2][i];
        hit->ngx[i] = ey * fz - ez * fy;
        hit->ngy[i] = ez * fx - ex * fz;
        hit->ngz[i] = ex * fy - ey * fx;
    }
}

extern const struct pell_raster_kernels PELL_SIMD(pell_raster_kernels);
const struct pell_raster_kernels PELL_SIMD(pell_raster_kernels) = { vertices, spans, tile, intersect };
