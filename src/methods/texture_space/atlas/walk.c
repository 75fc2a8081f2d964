/* SPDX-License-Identifier: MIT
 *
 * walk.c - straight ways over the surface from triangle to triangle, and where a point of the surface lies in the layout.
 */
#include "methods/texture_space/atlas/internal.h"

#define STEPS_MOST 256 /* triangles on one way over the surface: a spike finer than a texel is passed around again and again */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

bool ts_atlas_walk(const struct ts_atlas *a, uint32_t *triangle, double bary[2], struct pell_vec3 *way)
{
    double d[3] = { (double) way->x, (double) way->y, (double) way->z };
    uint32_t t = *triangle, entered = NONE;

    for (int step = 0; step < STEPS_MOST; step++) {
        struct pell_vec3 corner[3];
        double p[3][3], e[2][3], gram[3], det, rhs[2], rate[3], b[3], s = 1.0, along[3], length, f, part, rest[3], high, inward[3];
        uint32_t out = NONE, twin;
        bool same;

        corner_points(a, t, corner);
        for (int k = 0; k < 3; k++) {
            p[k][0] = (double) corner[k].x;
            p[k][1] = (double) corner[k].y;
            p[k][2] = (double) corner[k].z;
        }
        for (int k = 0; k < 2; k++)
            for (int i = 0; i < 3; i++)
                e[k][i] = p[k + 1][i] - p[0][i];
        gram[0] = dot(e[0], e[0]);
        gram[1] = dot(e[0], e[1]);
        gram[2] = dot(e[1], e[1]);
        det = gram[0] * gram[2] - gram[1] * gram[1];
        if (!(det > 0.0))
            return false;
        rhs[0] = dot(d, e[0]);
        rhs[1] = dot(d, e[1]);
        rate[1] = (rhs[0] * gram[2] - rhs[1] * gram[1]) / det;
        rate[2] = (rhs[1] * gram[0] - rhs[0] * gram[1]) / det;
        rate[0] = -rate[1] - rate[2];
        b[1] = bary[0];
        b[2] = bary[1];
        b[0] = 1.0 - b[1] - b[2];
        for (uint32_t k = 0; k < 3; k++) {
            const uint32_t half = 3 * t + (k + 1) % 3; /* the edge across from corner k */
            if (half != entered && rate[k] < 0.0 && b[k] + s * rate[k] < 0.0) {
                s = (b[k] > 0.0 ? b[k] : 0.0) / -rate[k];
                out = half;
            }
        }
        for (int k = 0; k < 3; k++)
            b[k] = b[k] + s * rate[k] > 0.0 ? b[k] + s * rate[k] : 0.0;
        length = b[0] + b[1] + b[2];
        if (out == NONE) {
            *triangle = t;
            bary[0] = b[1] / length;
            bary[1] = b[2] / length;
            *way = vec3((float) d[0], (float) d[1], (float) d[2]);
            return true;
        }
        twin = a->twin[out];
        if (twin == NONE || !a->chart[twin / 3])
            return false;
        {
            const uint32_t i = out % 3, j = (i + 1) % 3;
            f = b[i] + b[j] > 0.0 ? b[j] / (b[i] + b[j]) : 0.5;
            for (int k = 0; k < 3; k++)
                along[k] = p[j][k] - p[i][k];
        }
        length = sqrt(dot(along, along));
        if (!(length > 0.0))
            return false;
        for (int k = 0; k < 3; k++)
            along[k] /= length;
        part = (1.0 - s) * dot(d, along);
        for (int k = 0; k < 3; k++)
            rest[k] = (1.0 - s) * d[k] - part * along[k];
        high = sqrt(dot(rest, rest));
        /* Into the other triangle: what goes along the edge stays, the rest turns about it. */
        t = twin / 3;
        corner_points(a, t, corner);
        {
            const uint32_t i = twin % 3, j = (i + 1) % 3, k = (i + 2) % 3;
            const struct pell_vec3 edge = vec3_sub(corner[j], corner[i]), to = vec3_sub(corner[k], corner[i]);
            const double w[3] = { (double) to.x, (double) to.y, (double) to.z }, across = dot(w, along);
            double c[3] = { 0.0, 0.0, 0.0 };
            same = (double) edge.x * along[0] + (double) edge.y * along[1] + (double) edge.z * along[2] > 0.0;
            for (int n = 0; n < 3; n++)
                inward[n] = w[n] - across * along[n];
            length = sqrt(dot(inward, inward));
            if (!(length > 0.0))
                return false;
            for (int n = 0; n < 3; n++)
                d[n] = part * along[n] + high * inward[n] / length;
            c[i] = same ? 1.0 - f : f;
            c[j] = same ? f : 1.0 - f;
            bary[0] = c[1];
            bary[1] = c[2];
        }
        entered = twin;
    }
    return false;
}

struct ts_place ts_atlas_place(const struct ts_atlas *a, uint32_t t, float u, float v)
{
    const float *c = a->corners[t], w = 1.0f - u - v;
    const float x = w * c[0] + u * c[2] + v * c[4] - 0.5f, y = w * c[1] + u * c[3] + v * c[5] - 0.5f;
    const float fx = floorf(x), fy = floorf(y);

    if (!a->chart[t] || !(fx >= 0.0f && fy >= 0.0f && fx < (float) a->width && fy < (float) (a->height - 1)))
        return (struct ts_place) { .at = -1 };
    return (struct ts_place) {
        .at = (int32_t) ((ptrdiff_t) fy * a->stride + (ptrdiff_t) fx),
        .key = (float) a->chart[t],
        .fx = x - fx,
        .fy = y - fy,
    };
}
