/* SPDX-License-Identifier: MIT
 *
 * charts.c - charts: those of the mesh's texture coordinates, or planar ones grown over the surface while it faces an axis.
 */
#include "methods/texture_space/atlas/internal.h"

#include <string.h>

#define WELD_TEXELS 1e-2f    /* corners closer than this are one vertex of the layout */
#define CHART_COSINE 0.7     /* lower bound of the cosine between a planar chart's normals and its axis */
#define MIN_CHART_AREA 0.002 /* relative to the area: smaller charts are merged into adjacent ones */
#define JOIN_COSINE 0.3f     /* lower bound of the cosine for merging */
#define LAYER_DISTANCE 4.0   /* texels between overlapping layers of a projection */
#define MAX_COVER_SIZE 2048  /* maximum resolution of the overlap test, texels per side */
#define ROUNDS_MOST 64

bool ts_atlas_joined(const struct ts_atlas_build *b, uint32_t half)
{
    const struct ts_atlas *a = b->a;
    const uint32_t twin = a->twin[half];
    const float *p, *q;
    int i, j;

    if (twin == NONE)
        return false;
    p = a->corners[half / 3];
    q = a->corners[twin / 3];
    i = (int) (half % 3);
    j = (int) (twin % 3);
    for (int end = 0; end < 2; end++) {
        const int k = (i + end) % 3, l = (j + (opposed(b, half, twin) ? 1 - end : end)) % 3;
        if (!(fabsf(p[2 * k] - q[2 * l]) <= WELD_TEXELS && fabsf(p[2 * k + 1] - q[2 * l + 1]) <= WELD_TEXELS))
            return false;
    }
    return (flat_area(p) > 0.0) == (flat_area(q) > 0.0) || !opposed(b, half, twin);
}

void ts_atlas_number_charts(struct ts_atlas_build *b, uint32_t *todo)
{
    struct ts_atlas *a = b->a;
    uint32_t steps = 0;

    memset(a->chart, 0, a->num_triangles * sizeof(*a->chart));
    a->num_charts = 0;
    for (uint32_t seed = 0; seed < a->num_triangles && !pell_cancelled_at(b->ctx, seed); seed++) {
        uint32_t n = 0;
        if (a->chart[seed] || !(b->area[seed] > 0.0))
            continue;
        a->chart[seed] = ++a->num_charts;
        todo[n++] = seed;
        while (n > 0 && !pell_cancelled_at(b->ctx, steps++)) {
            const uint32_t t = todo[--n];
            for (uint32_t h = 3 * t; h < 3 * t + 3; h++)
                if (a->twin[h] != NONE && !a->chart[a->twin[h] / 3] && b->area[a->twin[h] / 3] > 0.0 && ts_atlas_joined(b, h)) {
                    a->chart[a->twin[h] / 3] = a->num_charts;
                    todo[n++] = a->twin[h] / 3;
                }
        }
    }
}

bool ts_atlas_has_set(const struct ts_atlas_build *b, int set)
{
    for (size_t i = 0; i < b->num_meshes; i++)
        if (!b->a->scene->meshes[b->meshes[i]].uv[set])
            return false;
    return true;
}

const char *ts_atlas_lay_out_file(struct ts_atlas_build *b, int set)
{
    struct ts_atlas *a = b->a;
    const int margin = 2 + (b->p->border < b->p->size / 8 ? b->p->border : b->p->size / 8);
    double low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY }, scale;

    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
        const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
        if (!m->uv[set])
            return "it has no texture coordinates";
        for (int k = 0; k < 3 && b->area[t] > 0.0; k++)
            for (int i = 0; i < 2; i++) {
                const double v = (double) m->uv[set][2 * (size_t) index[k] + (size_t) i];
                if (!(fabs(v) < 1e6))
                    return "its texture coordinates are too large";
                low[i] = fmin(low[i], v);
                high[i] = fmax(high[i], v);
            }
    }
    scale = fmax(high[0] - low[0], high[1] - low[1]);
    if (!(scale > 1e-6))
        return "its texture coordinates are all one";
    scale = (b->p->size - 2 * margin) / scale;
    a->width = (int) ceil((high[0] - low[0]) * scale) + 2 * margin;
    a->height = (int) ceil((high[1] - low[1]) * scale) + 2 * margin;
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
        const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
        for (int k = 0; k < 6 && b->area[t] > 0.0; k++)
            a->corners[t][k] = (float) (((double) m->uv[set][2 * (size_t) index[k / 2] + (size_t) (k % 2)] - low[k % 2]) * scale + margin);
    }
    return NULL;
}

/* Seen along its axis a chart may overlap itself, as the rim of an ear does. This structure records the covered texels and their depth, by
 * chart and texel. */
struct cover {
    uint64_t *texel; /* 0: not covered */
    float *depth;    /* texels */
    size_t mask, count;
    double scale; /* approximate texels per mm */
    double radius;
    struct pell_vec3 middle;
};

static enum pell_result make_cover(const struct ts_atlas_build *b, struct cover *g)
{
    struct pell_vec3 low = { INFINITY, INFINITY, INFINITY }, high = { -INFINITY, -INFINITY, -INFINITY };
    const double side = b->p->size < MAX_COVER_SIZE ? b->p->size : MAX_COVER_SIZE, most = 1.5 * COVERED_PLANAR * side * side;

    for (g->mask = 1024; (double) g->mask < most;)
        g->mask *= 2;
    g->texel = pell_calloc(b->ctx, g->mask, sizeof(*g->texel));
    g->depth = pell_alloc_array(b->ctx, g->mask, sizeof(*g->depth));
    g->mask--;
    for (uint32_t t = 0; t < b->a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        struct pell_vec3 p[3];
        corner_points(b->a, t, p);
        for (int k = 0; k < 3; k++) {
            low = vec3(fminf(low.x, p[k].x), fminf(low.y, p[k].y), fminf(low.z, p[k].z));
            high = vec3(fmaxf(high.x, p[k].x), fmaxf(high.y, p[k].y), fmaxf(high.z, p[k].z));
        }
    }
    g->middle = vec3_mul(vec3_add(low, high), 0.5f);
    g->scale = sqrt(COVERED_PLANAR / b->total_area) * side;
    g->radius = (double) vec3_length(vec3_sub(high, g->middle)) * g->scale + 2.0;
    return g->texel && g->depth ? PELL_OK : PELL_ERR_NOMEM;
}

/* `put`: records a texel at this depth. Else returns whether it is covered at a different depth. */
static bool cover_texel(struct cover *g, const struct ts_flat_chart *c, int x, int y, double depth, bool put)
{
    const uint64_t key = (uint64_t) c->number << 42 | (uint64_t) y << 21 | (uint64_t) x;
    size_t i = (size_t) (key * 0x9e3779b97f4a7c15u >> 20) & g->mask;

    while (g->texel[i] && g->texel[i] != key)
        i = (i + 1) & g->mask;
    if (!put)
        return g->texel[i] && fabs((double) g->depth[i] - depth) > LAYER_DISTANCE;
    if (!g->texel[i] && 4 * g->count < 3 * g->mask) {
        g->texel[i] = key;
        g->depth[i] = (float) depth;
        g->count++;
    }
    return false;
}

/* The same for the texels of a triangle, and the texel that contains its centroid. */
static bool cover_triangle(const struct ts_atlas_build *b, struct cover *g, uint32_t t, const struct ts_flat_chart *c, bool put)
{
    struct pell_vec3 p[3], u, v;
    double at[3][3];
    float corners[6];
    struct ts_flat f;
    int low[2], high[2];

    if (!(g->radius < 1e6))
        return false;
    vec3_basis(c->axis, &u, &v);
    corner_points(b->a, t, p);
    for (int k = 0; k < 3; k++) {
        const struct pell_vec3 q = vec3_sub(p[k], g->middle);
        at[k][0] = (double) vec3_dot(q, u) * g->scale + g->radius;
        at[k][1] = (double) vec3_dot(q, v) * g->scale + g->radius;
        at[k][2] = (double) vec3_dot(q, c->axis) * g->scale;
        corners[2 * k] = (float) at[k][0];
        corners[2 * k + 1] = (float) at[k][1];
    }
    if (!flatten(corners, &f))
        return false;
    if (cover_texel(g, c, (int) ((at[0][0] + at[1][0] + at[2][0]) / 3.0), (int) ((at[0][1] + at[1][1] + at[2][1]) / 3.0),
                    (at[0][2] + at[1][2] + at[2][2]) / 3.0, put))
        return true;
    for (int k = 0; k < 2; k++) {
        low[k] = (int) floor(fmin(at[0][k], fmin(at[1][k], at[2][k])) - 0.5);
        high[k] = (int) ceil(fmax(at[0][k], fmax(at[1][k], at[2][k])) - 0.5);
    }
    for (int y = low[1]; y <= high[1]; y++) {
        int x0 = low[0], x1 = high[0];
        row_of(&f, y + 0.5, &x0, &x1);
        for (int x = x0; x <= x1; x++) {
            const double fu = f.u[0] + f.u[1] * (x + 0.5) + f.u[2] * (y + 0.5), fv = f.v[0] + f.v[1] * (x + 0.5) + f.v[2] * (y + 0.5);
            if (fmin(1.0 - fu - fv, fmin(fu, fv)) >= 0.0 &&
                cover_texel(g, c, x, y, at[0][2] + fu * (at[1][2] - at[0][2]) + fv * (at[2][2] - at[0][2]), put))
                return true;
        }
    }
    return false;
}

static struct pell_vec3 face_normal(const struct ts_atlas_build *b, uint32_t t)
{
    const float *f = b->topology.face + 3 * (size_t) t;
    return vec3_normalize(vec3(f[0], f[1], f[2]));
}

/* The triangle across an edge with the same orientation; NONE: no such triangle with an area. */
static uint32_t neighbour(const struct ts_atlas_build *b, uint32_t half)
{
    const uint32_t twin = b->a->twin[half];

    return twin != NONE && b->area[twin / 3] > 0.0 && opposed(b, half, twin) ? twin / 3 : NONE;
}

/* Grows a chart from the seed over unassigned triangles while they face the seed's axis (the mean normal of its neighbourhood) and do not
 * overlap the chart in projection. `order` has room for all triangles. */
static void grow_chart(struct ts_atlas_build *b, struct cover *g, uint32_t seed, struct ts_flat_chart *c, uint32_t *order)
{
    struct ts_atlas *a = b->a;

    c->axis = face_normal(b, seed);
    for (int round = 0; round < 2; round++) {
        struct pell_vec3 sum = { 0 };
        uint32_t n = 0;
        order[n++] = seed;
        a->chart[seed] = c->number;
        if (round == 1)
            cover_triangle(b, g, seed, c, true);
        for (uint32_t i = 0; i < n && !pell_cancelled(b->ctx); i++)
            for (uint32_t h = 3 * order[i]; h < 3 * order[i] + 3; h++) {
                const uint32_t t = neighbour(b, h);
                if (t == NONE || a->chart[t] || vec3_dot(face_normal(b, t), c->axis) < (float) CHART_COSINE ||
                    (round == 1 && cover_triangle(b, g, t, c, false)))
                    continue;
                if (round == 1)
                    cover_triangle(b, g, t, c, true);
                a->chart[t] = c->number;
                order[n++] = t;
            }
        c->count = n;
        c->area = 0.0;
        for (uint32_t i = 0; i < n && !pell_cancelled_at(b->ctx, i); i++) {
            sum = vec3_mad(sum, (float) b->area[order[i]], face_normal(b, order[i]));
            c->area += b->area[order[i]];
            if (round == 0)
                a->chart[order[i]] = 0;
        }
        if (round == 0 && vec3_dot(vec3_normalize(sum), face_normal(b, seed)) >= (float) CHART_COSINE)
            c->axis = vec3_normalize(sum);
    }
}

/* Small charts are too narrow to be blurred by themselves: their triangles join adjacent charts one by one, while they face
 * the axis and overlap nothing. */
static void connect_small(struct ts_atlas_build *b, struct cover *g, struct ts_flat_chart *charts)
{
    struct ts_atlas *a = b->a;
    bool any = true;

    for (int round = 0; any && round < ROUNDS_MOST; round++) {
        any = false;
        for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
            int32_t best = 0;
            float most = JOIN_COSINE;
            if (!a->chart[t] || charts[a->chart[t] - 1].area >= MIN_CHART_AREA * b->total_area)
                continue;
            for (uint32_t h = 3 * t; h < 3 * t + 3; h++) {
                const uint32_t other = neighbour(b, h);
                const int32_t number = other != NONE ? a->chart[other] : 0;
                float cosine;
                if (!number || charts[number - 1].area < MIN_CHART_AREA * b->total_area)
                    continue;
                cosine = vec3_dot(face_normal(b, t), charts[number - 1].axis);
                if (cosine > most && !cover_triangle(b, g, t, &charts[number - 1], false)) {
                    most = cosine;
                    best = number;
                }
            }
            if (!best)
                continue;
            charts[a->chart[t] - 1].count--;
            charts[best - 1].count++;
            cover_triangle(b, g, t, &charts[best - 1], true);
            a->chart[t] = best;
            any = true;
        }
    }
}

/* Renumbers the remaining charts and projects them along their axes. Returns their number. */
static size_t flatten_charts(struct ts_atlas_build *b, struct ts_flat_chart *charts, size_t count)
{
    struct ts_atlas *a = b->a;
    size_t left = 0;

    for (size_t i = 0; i < count; i++)
        charts[i].number = charts[i].count > 0 ? (int32_t) ++left : 0;
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        struct ts_flat_chart *c = a->chart[t] ? &charts[a->chart[t] - 1] : NULL;
        struct pell_vec3 p[3], u, v;
        if (!c)
            continue;
        a->chart[t] = c->number;
        vec3_basis(c->axis, &u, &v);
        corner_points(a, t, p);
        for (int k = 0; k < 3; k++) {
            const double at[2] = { (double) vec3_dot(p[k], u), (double) vec3_dot(p[k], v) };
            for (int j = 0; j < 2; j++) {
                a->corners[t][2 * k + j] = (float) at[j];
                c->low[j] = fmin(c->low[j], at[j]);
                c->high[j] = fmax(c->high[j], at[j]);
            }
        }
    }
    for (size_t i = 0; i < count; i++)
        if (charts[i].number > 0)
            charts[charts[i].number - 1] = charts[i];
    return left;
}

/* Maps corners, in mm in their charts, to their position in the map. */
static enum pell_result put_side_by_side(struct ts_atlas_build *b, struct ts_flat_chart *charts, size_t count)
{
    struct ts_atlas *a = b->a;
    double scale;
    enum pell_result res;

    PELL_TRY(ts_atlas_pack(b, charts, count, &scale));
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        const struct ts_flat_chart *c = a->chart[t] ? &charts[a->chart[t] - 1] : NULL;
        for (int k = 0; c && k < 6; k++)
            a->corners[t][k] = (float) (((double) a->corners[t][k] - c->low[k % 2]) * scale + (k % 2 ? c->y : c->x));
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result ts_atlas_separate(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;
    const size_t count = (size_t) a->num_charts;
    struct ts_flat_chart *charts = pell_calloc(b->ctx, count + 1, sizeof(*charts));
    double *flat = pell_calloc(b->ctx, count + 1, sizeof(*flat));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!charts || !flat)
        goto fail;
    for (size_t i = 0; i < count; i++)
        charts[i] = (struct ts_flat_chart) { .number = (int32_t) i + 1, .low = { INFINITY, INFINITY }, .high = { -INFINITY, -INFINITY } };
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++)
        if (a->chart[t]) {
            charts[a->chart[t] - 1].area += b->area[t];
            flat[a->chart[t] - 1] += fabs(flat_area(a->corners[t]));
        }
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        struct ts_flat_chart *c = a->chart[t] ? &charts[a->chart[t] - 1] : NULL;
        const double mm_per_texel = c && flat[c->number - 1] > 1e-9 ? sqrt(c->area / flat[c->number - 1]) : 0.0; /* in the layout so far */
        for (int k = 0; c && k < 6; k++) {
            a->corners[t][k] *= (float) mm_per_texel;
            c->low[k % 2] = fmin(c->low[k % 2], (double) a->corners[t][k]);
            c->high[k % 2] = fmax(c->high[k % 2], (double) a->corners[t][k]);
        }
    }
    PELL_TRY(put_side_by_side(b, charts, count));
    res = PELL_OK;

fail:
    pell_free(b->ctx, flat);
    pell_free(b->ctx, charts);
    return res;
}

enum pell_result ts_atlas_lay_out_planar(struct ts_atlas_build *b, uint32_t *order)
{
    struct ts_atlas *a = b->a;
    struct ts_flat_chart *charts = NULL;
    struct cover cover = { 0 };
    size_t count = 0, capacity = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    memset(a->chart, 0, a->num_triangles * sizeof(*a->chart));
    PELL_TRY(make_cover(b, &cover));
    for (uint32_t seed = 0; seed < a->num_triangles; seed++) {
        void *array = charts;
        if (pell_cancelled_at(b->ctx, seed)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        if (a->chart[seed] || !(b->area[seed] > 0.0))
            continue;
        PELL_TRY(pell_grow(b->ctx, &array, count, &capacity, sizeof(*charts)));
        charts = array;
        charts[count] =
            (struct ts_flat_chart) { .number = (int32_t) count + 1, .low = { INFINITY, INFINITY }, .high = { -INFINITY, -INFINITY } };
        grow_chart(b, &cover, seed, &charts[count++], order);
    }
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(b->ctx))
        goto fail;
    connect_small(b, &cover, charts);
    count = flatten_charts(b, charts, count);
    if (pell_cancelled(b->ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    a->num_charts = (int) count;
    PELL_TRY(put_side_by_side(b, charts, count));
    res = PELL_OK;

fail:
    pell_free(b->ctx, cover.texel);
    pell_free(b->ctx, cover.depth);
    pell_free(b->ctx, charts);
    return res;
}
