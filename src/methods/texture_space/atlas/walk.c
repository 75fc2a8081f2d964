/* SPDX-License-Identifier: MIT
 *
 * walk.c - straight walks over the surface from triangle to triangle, and the position of a surface point in the layout.
 */
#include "methods/texture_space/atlas/internal.h"

#include "base/pool.h"

#define MAX_STEPS 256 /* triangles per walk: without a limit a walk can circle a spike finer than a texel */

enum { TRIANGLES = 1024 }; /* triangles per task */

static void unfold_triangles(void *arg, int chunk, int worker)
{
    struct ts_atlas_build *b = arg;
    const uint32_t first = (uint32_t) chunk * TRIANGLES, most = b->a->num_triangles;

    (void) worker;
    for (uint32_t t = first; t < first + TRIANGLES && t < most; t++) {
        struct pell_vec3 corner[3];
        double p[3][3];
        corner_points(b->a, t, corner);
        for (int k = 0; k < 3; k++) {
            p[k][0] = (double) corner[k].x;
            p[k][1] = (double) corner[k].y;
            p[k][2] = (double) corner[k].z;
        }
        for (int k = 0; k < 3; k++) {
            struct ts_hinge *h = &b->hinge[3 * t + (uint32_t) k];
            double e[3], w[3], square = 0.0, along = 0.0, high = 0.0, length;
            for (int i = 0; i < 3; i++) {
                e[i] = p[(k + 1) % 3][i] - p[k][i];
                w[i] = p[(k + 2) % 3][i] - p[k][i];
                square += e[i] * e[i];
                along += e[i] * w[i];
            }
            for (int i = 0; i < 3; i++) {
                const double rest = square > 0.0 ? w[i] - along / square * e[i] : 0.0;
                high += rest * rest;
            }
            length = sqrt(square);
            *h = (struct ts_hinge) { (float) length, square > 0.0 ? (float) (along / length) : 0.0f, (float) sqrt(high) };
        }
    }
}

enum pell_result ts_atlas_unfold(struct ts_atlas_build *b)
{
    b->hinge = pell_alloc_array(b->ctx, 3 * (size_t) b->a->num_triangles + 1, sizeof(*b->hinge));
    if (!b->hinge)
        return PELL_ERR_NOMEM;
    pell_pool_run(b->p->pool, (int) ((b->a->num_triangles + TRIANGLES - 1) / TRIANGLES), unfold_triangles, b);
    return PELL_OK;
}

/* Unit vectors along a half-edge, and perpendicular to it toward the third corner; false: no area. */
static bool axes_of(const struct ts_atlas *a, uint32_t half, struct pell_vec3 axis[2])
{
    const uint32_t k = half % 3;
    struct pell_vec3 p[3], to;

    corner_points(a, half / 3, p);
    axis[0] = vec3_normalize(vec3_sub(p[(k + 1) % 3], p[k]));
    to = vec3_sub(p[(k + 2) % 3], p[k]);
    axis[1] = vec3_normalize(vec3_mad(to, -vec3_dot(to, axis[0]), axis[0]));
    return vec3_dot(axis[0], axis[0]) > 0.5f && vec3_dot(axis[1], axis[1]) > 0.5f;
}

/* Unfolds each triangle into the plane of the one before, in the frame of the shared edge: x along the edge, y into the triangle. */
bool ts_atlas_walk(const struct ts_atlas_build *b, uint32_t *triangle, double bary[2], struct pell_vec3 *dir)
{
    const struct ts_atlas *a = b->a;
    const struct ts_hinge *hinge = &b->hinge[3 * (size_t) *triangle];
    uint32_t half = 3 * *triangle; /* the shared edge */
    struct pell_vec3 axis[2];
    double x = bary[0] * (double) hinge->length + bary[1] * (double) hinge->x, y = bary[1] * (double) hinge->y, dx, dy;

    if (!axes_of(a, half, axis))
        return false;
    dx = (double) vec3_dot(*dir, axis[0]);
    dy = (double) vec3_dot(*dir, axis[1]);
    for (int step = 0; step < MAX_STEPS; step++) {
        const double length = (double) hinge->length, cx = (double) hinge->x, cy = (double) hinge->y;
        const uint32_t base = half - half % 3;
        double s = 1.0, f = 0.0, out_length = 1.0, out_x = 0.0, out_y = 0.0;
        uint32_t out = NONE, twin;

        if (!(length > 0.0 && cy > 0.0))
            return false;
        /* Across the edges from either end to the third corner; in the first triangle also across the edge itself. */
        for (uint32_t k = step == 0 ? 0 : 1; k < 3; k++) {
            const double px = k == 1 ? length : k == 2 ? cx : 0.0, py = k == 2 ? cy : 0.0;
            const double ex = (k == 0 ? length : k == 1 ? cx : 0.0) - px, ey = (k == 1 ? cy : 0.0) - py;
            const double leaves = dx * ey - dy * ex, inside = ex * (y - py) - ey * (x - px); /* on its left */
            if (!(leaves > 0.0 && inside < s * leaves))
                continue;
            s = inside > 0.0 ? inside / leaves : 0.0;
            out = base + (half + k) % 3;
            out_length = ex * ex + ey * ey;
            out_x = ex;
            out_y = ey;
            f = ((x + s * dx - px) * ex + (y + s * dy - py) * ey) / out_length;
        }
        if (out == NONE) {
            const double v = fmin(fmax((y + dy) / cy, 0.0), 1.0), u = fmin(fmax((x + dx - v * cx) / length, 0.0), 1.0 - v);
            const double w[3] = { 1.0 - u - v, u, v };
            *triangle = half / 3;
            for (uint32_t k = 0; k < 3; k++) /* the edge's two corners and the third one */
                if ((half + k) % 3 > 0)
                    bary[(half + k) % 3 - 1] = w[k];
            if (!axes_of(a, half, axis))
                return false;
            *dir = vec3_mad(vec3_mul(axis[0], (float) dx), (float) dy, axis[1]);
            return true;
        }
        twin = a->twin[out];
        if (twin == NONE || !a->chart[twin / 3])
            return false;
        /* The component along the edge is unchanged; the rest rotates about the edge. */
        out_length = sqrt(out_length);
        f = fmin(fmax(f, 0.0), 1.0);
        {
            const bool same = !opposed(b, out, twin);
            const double along = (dx * out_x + dy * out_y) / out_length, across = (dx * out_y - dy * out_x) / out_length;
            hinge = &b->hinge[twin];
            half = twin;
            x = (same ? f : 1.0 - f) * (double) hinge->length;
            y = 0.0;
            dx = (1.0 - s) * (same ? along : -along);
            dy = (1.0 - s) * (across > 0.0 ? across : 0.0);
        }
    }
    return false;
}

struct ts_bilinear ts_atlas_locate(const struct ts_atlas *a, uint32_t t, float u, float v)
{
    const float *c = a->corners[t], w = 1.0f - u - v;
    const float x = w * c[0] + u * c[2] + v * c[4] - 0.5f, y = w * c[1] + u * c[3] + v * c[5] - 0.5f;
    const float fx = floorf(x), fy = floorf(y);

    if (!a->chart[t] || !(fx >= 0.0f && fy >= 0.0f && fx < (float) a->width && fy < (float) (a->height - 1)))
        return (struct ts_bilinear) { .at = -1 };
    return (struct ts_bilinear) {
        .at = (int32_t) ((ptrdiff_t) fy * a->stride + (ptrdiff_t) fx),
        .key = (float) a->chart[t],
        .fx = x - fx,
        .fy = y - fy,
    };
}
