/* SPDX-License-Identifier: MIT
 * bake_rays.c - rays from the texels of a surface through the solids inside. */
#include "cli/commands/bake.h"

#include <math.h>
#include <string.h>

#define NO_TRIANGLE UINT32_MAX
#define RAY_OFFSET 1e-5f /* fraction of the surface's size by which a ray's origin is moved past a hit */

/* The triangle that covers a texel. */
struct texel_cover {
    uint32_t mesh, triangle;
};

void bake_finish(struct bake *b)
{
    for (int k = -1; k < b->num_inner; k++) {
        struct bake_solid *s = k < 0 ? &b->outer : &b->inner[k];
        pell_rays_destroy(&s->rays);
        pell_scene_destroy(&s->scene);
    }
    pell_pool_destroy(&b->pool);
    pell_free(b->ctx, b->texels);
    pell_free(b->ctx, b->bottom);
    b->texels = NULL;
    b->bottom = NULL;
}

/* --- Texels --------------------------------------------------------------------------------------------------------------------- */

static void corners_of(const struct pell_mesh *m, uint32_t triangle, double uv[3][2])
{
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 2; d++)
            uv[k][d] = (double) m->uv[0][2 * (size_t) m->index[3 * (size_t) triangle + (size_t) k] + (size_t) d];
}

/* Barycentric coordinates of a point in the map; false: outside. */
static bool inside(const double uv[3][2], double x, double y, float *u, float *v)
{
    const double ax = uv[1][0] - uv[0][0], ay = uv[1][1] - uv[0][1], bx = uv[2][0] - uv[0][0], by = uv[2][1] - uv[0][1];
    const double px = x - uv[0][0], py = y - uv[0][1], area = ax * by - ay * bx;
    const double s = (px * by - py * bx) / area, t = (ax * py - ay * px) / area;

    *u = (float) s;
    *v = (float) t;
    return s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 2e-9; /* false for a degenerate triangle */
}

static enum pell_result cover_by_triangle(struct bake *b, uint32_t mesh, uint32_t triangle, struct texel_cover *cover)
{
    const struct pell_mesh *m = &b->outer.scene->meshes[mesh];
    double uv[3][2], low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    int first[2], last[2];

    corners_of(m, triangle, uv);
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 2; d++) {
            if (!(uv[k][d] >= -1e-3 && uv[k][d] <= 1.0 + 1e-3))
                return pell_error(b->ctx, PELL_ERR_INVALID, b->outer.path, "lay the surface out within one image",
                                  "has the texture coordinate %.4g, must be in [0, 1]", uv[k][d]);
            low[d] = fmin(low[d], uv[k][d]);
            high[d] = fmax(high[d], uv[k][d]);
        }
    for (int d = 0; d < 2; d++) {
        first[d] = (int) fmax(floor(low[d] * b->size - 0.5), 0.0);
        last[d] = (int) fmin(ceil(high[d] * b->size - 0.5), b->size - 1.0);
    }
    for (int y = first[1]; y <= last[1]; y++)
        for (int x = first[0]; x <= last[0]; x++) {
            struct texel_cover *s = &cover[(size_t) y * (size_t) b->size + (size_t) x];
            float u, v;
            if (!inside((const double(*)[2]) uv, (x + 0.5) / b->size, (y + 0.5) / b->size, &u, &v))
                continue;
            b->shared += s->triangle != NO_TRIANGLE && fminf(fminf(u, v), 1.0f - u - v) > 1e-3f;
            b->shown += s->triangle == NO_TRIANGLE;
            *s = (struct texel_cover) { mesh, triangle };
        }
    return PELL_OK;
}

static enum pell_result cover_texels(struct bake *b, struct texel_cover *cover)
{
    const struct pell_scene *scene = b->outer.scene;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < (size_t) b->size * (size_t) b->size; i++)
        cover[i].triangle = NO_TRIANGLE;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        if (!scene->meshes[i].uv[0])
            return pell_error(b->ctx, PELL_ERR_INVALID, b->outer.path, "lay it out in a modelling program", "has no texture coordinates");
        for (uint32_t t = 0; t < scene->meshes[i].num_triangles; t++) {
            PELL_TRY(cover_by_triangle(b, (uint32_t) i, t, cover));
            if (pell_cancelled_at(b->ctx, t))
                return PELL_ERR_CANCELLED;
        }
    }
    if (b->shown == 0)
        return pell_error(b->ctx, PELL_ERR_INVALID, b->outer.path, "give a larger --map-size", "shows no texel of a map of %d x %d",
                          b->size, b->size);

fail:
    return res;
}

/* --- A ray ---------------------------------------------------------------------------------------------------------------------- */

/* Where a ray enters and exits a solid. */
struct pairs {
    float in[BAKE_PAIRS], out[BAKE_PAIRS];
    int count;
    bool more;
};

/* The next surface of the solid at `from` or beyond, with the requested orientation; INFINITY: none. */
static float next_face(const struct bake_solid *s, struct pell_vec3 p, struct pell_vec3 direction, float from, float offset, bool leaving)
{
    struct pell_ray ray = { { p.x, p.y, p.z }, from, { direction.x, direction.y, direction.z }, INFINITY, PELL_RAY_ALL };
    struct pell_hit hit;

    for (int k = 0; k < 64 && pell_rays_closest(s->rays, &ray, &hit); k++) {
        const bool out = hit.ng[0] * direction.x + hit.ng[1] * direction.y + hit.ng[2] * direction.z > 0.0f;
        if (out == leaving)
            return hit.t;
        ray.tnear = hit.t + offset;
    }
    return INFINITY;
}

static void find_pairs(const struct bake_solid *s, struct pell_vec3 p, struct pell_vec3 direction, float offset, float end,
                       struct pairs *out)
{
    float in = next_face(s, p, direction, 0.0f, offset, false);
    const float first_out = next_face(s, p, direction, 0.0f, offset, true);
    float at;

    out->count = 0;
    out->more = false;
    if (first_out < in) /* the ray begins inside */
        in = 0.0f;
    while (in < end) {
        at = next_face(s, p, direction, in + (in > 0.0f ? offset : 0.0f), offset, true);
        if (out->count == BAKE_PAIRS) {
            out->more = true;
            return;
        }
        out->in[out->count] = in;
        out->out[out->count++] = fminf(at, end);
        in = at < end ? next_face(s, p, direction, at + offset, offset, false) : INFINITY;
    }
}

/* Splits a ray into stretches; where inner meshes overlap, the last one counts. */
static void cut_ray(const struct bake *b, const struct pairs *pairs, float end, struct bake_texel *t, bool *more)
{
    float at = 0.0f;

    t->count = 0;
    while (at < end) {
        float next = end;
        int medium = 0;
        for (int k = 0; k < b->num_inner; k++)
            for (int i = 0; i < pairs[k].count; i++) {
                if (pairs[k].in[i] <= at && at < pairs[k].out[i])
                    medium = k + 1;
                next = pairs[k].in[i] > at ? fminf(next, pairs[k].in[i]) : next;
                next = pairs[k].out[i] > at ? fminf(next, pairs[k].out[i]) : next;
            }
        if (t->count > 0 && t->medium[t->count - 1] == medium) {
            t->end[t->count - 1] = next;
        } else if (t->count == BAKE_STRETCHES) {
            *more = true;
            return;
        } else {
            t->medium[t->count] = (uint8_t) medium;
            t->end[t->count++] = next;
        }
        at = next;
    }
}

struct rows {
    struct bake *b;
    const struct texel_cover *cover;
    float offset;
    int64_t (*counts)[2]; /* per worker: cut, open */
};

static void measure_row(void *arg, int row, int worker)
{
    const struct rows *r = arg;
    struct bake *b = r->b;

    for (int x = 0; x < b->size && !pell_cancelled(b->ctx); x++) {
        const size_t at = (size_t) row * (size_t) b->size + (size_t) x;
        const struct texel_cover *s = &r->cover[at];
        struct pairs pairs[BAKE_INNER];
        struct pell_vec3 c[3], n[3], p, direction;
        const struct pell_mesh *m;
        double uv[3][2];
        float u, v, w, end;
        bool more = false;
        if (s->triangle == NO_TRIANGLE)
            continue;
        m = &b->outer.scene->meshes[s->mesh];
        corners_of(m, s->triangle, uv);
        inside((const double(*)[2]) uv, (x + 0.5) / b->size, (row + 0.5) / b->size, &u, &v);
        for (int k = 0; k < 3; k++) {
            const size_t i = 3 * (size_t) m->index[3 * (size_t) s->triangle + (size_t) k];
            c[k] = vec3_load(m->position + i);
            n[k] = vec3_load(m->normal + i);
        }
        w = 1.0f - u - v;
        p = vec3_mad(vec3_mad(vec3_mul(c[0], w), u, c[1]), v, c[2]);
        direction = vec3_mul(vec3_normalize(vec3_mad(vec3_mad(vec3_mul(n[0], w), u, n[1]), v, n[2])), -1.0f);
        end = next_face(&b->outer, p, direction, r->offset, r->offset, true);
        if (!(end < INFINITY))
            r->counts[worker][1]++;
        end = fminf(fminf(end, (float) fmin(b->down_to_mm, 1e30)), r->offset / RAY_OFFSET);
        for (int k = 0; k < b->num_inner; k++) {
            find_pairs(&b->inner[k], p, direction, r->offset, end, &pairs[k]);
            more = more || pairs[k].more;
        }
        cut_ray(b, pairs, end, &b->texels[at], &more);
        r->counts[worker][0] += more;
    }
}

enum pell_result bake_measure(struct bake *b)
{
    const size_t n = (size_t) b->size * (size_t) b->size;
    const struct pell_scene *scene = b->outer.scene;
    struct texel_cover *cover = pell_alloc_array(b->ctx, n, sizeof(*cover));
    struct rows rows = { .b = b, .cover = cover };
    enum pell_result res = PELL_ERR_NOMEM;

    b->texels = pell_calloc(b->ctx, n, sizeof(*b->texels));
    rows.counts = pell_calloc(b->ctx, (size_t) pell_pool_threads(b->pool), sizeof(*rows.counts));
    if (!cover || !b->texels || !rows.counts)
        goto fail;
    PELL_TRY(cover_texels(b, cover));
    rows.offset = RAY_OFFSET * vec3_length(vec3_sub(vec3_load(scene->bounds_max), vec3_load(scene->bounds_min)));
    pell_pool_run(b->pool, b->size, measure_row, &rows);
    for (int i = 0; i < pell_pool_threads(b->pool); i++) {
        b->cut += rows.counts[i][0];
        b->open += rows.counts[i][1];
    }
    res = pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(b->ctx, rows.counts);
    pell_free(b->ctx, cover);
    return res;
}
