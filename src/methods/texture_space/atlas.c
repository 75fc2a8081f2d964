/* SPDX-License-Identifier: MIT
 *
 * atlas.c - a body's surface laid out flat: charts, texels and the points of the surface that they stand for, and borders, whose texels
 * stand for points of the neighbouring charts, found by going straight on over the surface.
 */
#include "methods/texture_space/texture_space.h"

#include "base/pool.h"
#include "scene/mesh/topology.h"

#include <stdlib.h>
#include <string.h>

#define NONE UINT32_MAX
#define WELD_TEXELS 1e-2f    /* corners nearer than this are one point of the layout */
#define OVERLAP_MOST 0.01    /* share of the texels that two triangles may claim in a layout that is used */
#define DEGENERATE_MOST 0.02 /* share of the area whose triangles have none in the layout */
#define COVERED_MOST 4.0     /* times the map is covered in a layout that is looked at further */
#define OVERLAPS "its texture coordinates overlap"
#define COVERED_LEAST 0.02 /* share of the layout's rectangle that is covered */
#define CHART_COSINE 0.7   /* a planar chart's normals are this near to its axis */
#define CHART_LEAST 0.002  /* of the area: smaller charts are given to those beside them */
#define JOIN_COSINE 0.3f   /* where they face these at least so much */
#define COVERED_PLANAR 0.6 /* of the map by planar charts, at most */
#define APART 4.0          /* texels between what lies in front of each other */
#define COVER_MOST 2048    /* texels a side that this is looked for on */
#define ROUNDS_MOST 64
#define SIZE_MOST 16384    /* texels, a side */
#define BORDER_WORK 1024.0 /* texels looked at for borders, per texel of the map */
#define LEAN_MOST 8.0f
#define LENGTH_LEAST 1e-9f /* mm from texel to texel */
#define LENGTH_MOST 1e9f
#define STEPS_MOST 1024 /* triangles on one way over the surface */
#define NEARBY 2        /* texels */
#define TAPS_SIGMAS 3   /* standard deviations that a border is wide, about */
#define TILT_MOST 0.25f /* of a tap's weight, over a standard deviation */
#define BAND 16         /* rows that a thread looks at in one go */

struct build {
    struct pell_context *ctx;
    const struct ts_atlas_params *p;
    struct ts_atlas *a;
    struct pell_topology topology;
    uint32_t *meshes;
    size_t num_meshes;
    double *area; /* per triangle, mm^2 */
    double total_area;
    struct pell_vec3 *place;       /* of each texel, mm */
    struct ts_place *border_place; /* what each border stands for */
    int64_t claimed, twice;        /* texels that some, and that several triangles cover */
};

void ts_atlas_destroy(struct ts_atlas **atlas)
{
    struct ts_atlas *a = *atlas;

    if (!a)
        return;
    *atlas = NULL;
    pell_free(a->ctx, a->triangles);
    pell_free(a->ctx, a->first);
    pell_free(a->ctx, a->corners);
    pell_free(a->ctx, a->chart);
    pell_free(a->ctx, a->twin);
    if (a->key)
        pell_free(a->ctx, a->key - TS_MARGIN);
    pell_free(a->ctx, a->source);
    pell_free(a->ctx, a->borders);
    pell_free(a->ctx, a->fills);
    pell_free(a->ctx, a->first_mended);
    pell_free(a->ctx, a->first_border);
    pell_free(a->ctx, a->parts);
    pell_free(a->ctx, a->runs);
    pell_free(a->ctx, a->first_run);
    pell_free(a->ctx, a->cells);
    pell_free(a->ctx, a);
}

static void corner_points(const struct ts_atlas *a, uint32_t t, struct pell_vec3 p[3])
{
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
    const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;

    for (int k = 0; k < 3; k++)
        p[k] = vec3_load(m->position + 3 * (size_t) index[k]);
}

static double flat_area(const float c[6])
{
    return 0.5 * ((double) (c[2] - c[0]) * (double) (c[5] - c[1]) - (double) (c[4] - c[0]) * (double) (c[3] - c[1]));
}

/* --- Triangles and their neighbours ---------------------------------------------------------------------------------------------- */

static enum pell_result list_triangles(struct build *b)
{
    const struct pell_scene *scene = b->p->scene;
    struct ts_atlas *a = b->a;
    size_t count = 0;
    enum pell_result res;

    b->meshes = pell_calloc(b->ctx, scene->num_meshes + 1, sizeof(*b->meshes));
    a->first = pell_alloc_array(b->ctx, scene->num_meshes + 1, sizeof(*a->first));
    if (!b->meshes || !a->first)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        a->first[i] = NONE;
        if (b->p->bodies->of_mesh[i] != (int32_t) b->p->body)
            continue;
        b->meshes[b->num_meshes++] = (uint32_t) i;
        a->first[i] = (uint32_t) count;
        count += scene->meshes[i].num_triangles;
    }
    if (count > UINT32_MAX / 8)
        return pell_error(b->ctx, PELL_ERR_UNSUPPORTED, b->p->name, NULL, "%zu triangles, at most %u in a thing", count, UINT32_MAX / 8);
    a->num_triangles = (uint32_t) count;
    a->triangles = pell_alloc_array(b->ctx, count + 1, sizeof(*a->triangles));
    a->corners = pell_calloc(b->ctx, count + 1, sizeof(*a->corners));
    a->chart = pell_calloc(b->ctx, count + 1, sizeof(*a->chart));
    a->twin = pell_alloc_array(b->ctx, 3 * count + 1, sizeof(*a->twin));
    b->area = pell_calloc(b->ctx, count + 1, sizeof(*b->area));
    if (!a->triangles || !a->corners || !a->chart || !a->twin || !b->area)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < b->num_meshes; i++)
        for (uint32_t t = 0; t < scene->meshes[b->meshes[i]].num_triangles; t++)
            a->triangles[a->first[b->meshes[i]] + t] = (struct ts_triangle){ b->meshes[i], t };
    for (uint32_t t = 0; t < a->num_triangles; t++) {
        struct pell_vec3 p[3];
        double e[2][3], n[3];
        corner_points(a, t, p);
        for (int k = 0; k < 2; k++) {
            e[k][0] = (double) p[k + 1].x - (double) p[0].x;
            e[k][1] = (double) p[k + 1].y - (double) p[0].y;
            e[k][2] = (double) p[k + 1].z - (double) p[0].z;
        }
        for (int k = 0; k < 3; k++)
            n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
        b->area[t] = 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        if (!(b->area[t] > 0.0 && b->area[t] < INFINITY))
            b->area[t] = 0.0;
        b->total_area += b->area[t];
    }
    PELL_TRY(pell_topology_make(&b->topology, scene, b->meshes, b->num_meshes));
    for (size_t h = 0; h < 3 * count; h++)
        a->twin[h] = NONE;
    for (uint32_t e = 0, end; e < b->topology.num_halves; e = end) {
        end = pell_topology_edge(&b->topology, e);
        if (end - e == 2 && b->topology.half[e] / 3 != b->topology.half[e + 1] / 3) {
            a->twin[b->topology.half[e]] = b->topology.half[e + 1];
            a->twin[b->topology.half[e + 1]] = b->topology.half[e];
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* Whether the twin runs the other way, as it does where both triangles face the same side. */
static bool opposed(const struct build *b, uint32_t half, uint32_t twin)
{
    return pell_half_start(&b->topology, half) == pell_half_end(&b->topology, twin);
}

/* Whether two triangles that share an edge do so in the layout. */
static bool joined(const struct build *b, uint32_t half)
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

/* Numbers charts by what hangs together in the layout. `todo` has room for all triangles. */
static void number_charts(struct build *b, uint32_t *todo)
{
    struct ts_atlas *a = b->a;

    memset(a->chart, 0, a->num_triangles * sizeof(*a->chart));
    a->num_charts = 0;
    for (uint32_t seed = 0; seed < a->num_triangles; seed++) {
        uint32_t n = 0;
        if (a->chart[seed] || !(b->area[seed] > 0.0))
            continue;
        a->chart[seed] = ++a->num_charts;
        todo[n++] = seed;
        while (n > 0) {
            const uint32_t t = todo[--n];
            for (uint32_t h = 3 * t; h < 3 * t + 3; h++)
                if (a->twin[h] != NONE && !a->chart[a->twin[h] / 3] && b->area[a->twin[h] / 3] > 0.0 && joined(b, h)) {
                    a->chart[a->twin[h] / 3] = a->num_charts;
                    todo[n++] = a->twin[h] / 3;
                }
        }
    }
}

/* --- Layouts --------------------------------------------------------------------------------------------------------------------- */

/* The layout of the file, scaled to fit. Returns NULL, or what is wrong with it. */
static const char *lay_out_file(struct build *b)
{
    struct ts_atlas *a = b->a;
    const int margin = 2 + (b->p->border < b->p->size / 8 ? b->p->border : b->p->size / 8);
    double low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY }, scale;

    for (uint32_t t = 0; t < a->num_triangles; t++) {
        const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
        const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
        if (!m->uv[0])
            return "it has no texture coordinates";
        for (int k = 0; k < 3 && b->area[t] > 0.0; k++)
            for (int i = 0; i < 2; i++) {
                const double v = (double) m->uv[0][2 * (size_t) index[k] + (size_t) i];
                if (!(fabs(v) < 1e6))
                    return "its texture coordinates are no numbers of use";
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
    for (uint32_t t = 0; t < a->num_triangles; t++) {
        const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
        const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
        for (int k = 0; k < 6 && b->area[t] > 0.0; k++)
            a->corners[t][k] = (float) (((double) m->uv[0][2 * (size_t) index[k / 2] + (size_t) (k % 2)] - low[k % 2]) * scale + margin);
    }
    return NULL;
}

struct flat_chart {
    struct pell_vec3 axis;
    double area;            /* mm^2, when it was grown */
    uint32_t count;         /* triangles */
    double low[2], high[2]; /* mm */
    double x, y;            /* texels */
    int32_t number;
};

static int by_height(const void *p, const void *q)
{
    const struct flat_chart *a = p, *b = q;
    const double ha = a->high[1] - a->low[1], hb = b->high[1] - b->low[1];

    return ha > hb ? -1 : ha < hb ? 1 : a->number < b->number ? -1 : 1;
}

static int by_number(const void *p, const void *q)
{
    const struct flat_chart *a = p, *b = q;

    return (a->number > b->number) - (a->number < b->number);
}

/* Puts charts on shelves, `scale` texels a mm. False where they are too many. */
static bool pack(struct flat_chart *charts, size_t count, double scale, int gutter, int size)
{
    double x = 2.0, y = 2.0, tall = 0.0;

    for (size_t i = 0; i < count; i++) {
        struct flat_chart *c = &charts[i];
        const double w = (c->high[0] - c->low[0]) * scale + gutter, h = (c->high[1] - c->low[1]) * scale + gutter;
        if (x + w > size - 2.0) {
            x = 2.0;
            y += tall;
            tall = 0.0;
        }
        if (x + w > size - 2.0 || y + h > size - 2.0)
            return false;
        c->x = x + 0.5 * gutter;
        c->y = y + 0.5 * gutter;
        x += w;
        tall = fmax(tall, h);
    }
    return true;
}

/* Barycentrics of a point in a triangle's layout: 1 and x, y times these. */
struct flat {
    double u[3], v[3];
};

static bool flatten(const float c[6], struct flat *f)
{
    const double ux = (double) c[2] - (double) c[0], uy = (double) c[3] - (double) c[1];
    const double vx = (double) c[4] - (double) c[0], vy = (double) c[5] - (double) c[1], det = ux * vy - uy * vx;

    if (!(fabs(det) > 1e-12))
        return false;
    f->u[1] = vy / det;
    f->u[2] = -vx / det;
    f->v[1] = -uy / det;
    f->v[2] = ux / det;
    f->u[0] = -(f->u[1] * (double) c[0] + f->u[2] * (double) c[1]);
    f->v[0] = -(f->v[1] * (double) c[0] + f->v[2] * (double) c[1]);
    return true;
}

/* Narrows [x0, x1] to the texels of a row that a triangle may cover, one more on either side: slivers cost what they cover, not their
 * boxes. */
static void row_of(const struct flat *f, double y, int *x0, int *x1)
{
    const double at[3][2] = { { f->u[0] + f->u[2] * y, f->u[1] },
                              { f->v[0] + f->v[2] * y, f->v[1] },
                              { 1.0 - f->u[0] - f->v[0] - (f->u[2] + f->v[2]) * y, -f->u[1] - f->v[1] } };
    double low = *x0, high = *x1;

    for (int k = 0; k < 3; k++) {
        if (fabs(at[k][1]) < 1e-12)
            continue;
        if (at[k][1] > 0.0)
            low = fmax(low, floor(-at[k][0] / at[k][1] - 1.5));
        else
            high = fmin(high, ceil(-at[k][0] / at[k][1] + 0.5));
    }
    *x0 = low < *x1 + 1.0 ? (int) low : *x1 + 1;
    *x1 = high > -1.0 ? (int) high : -1;
}

/* Seen from its axis a chart may lie in front of itself, as the rim of an ear does before the rest: what of it is covered already, and how
 * deep, by chart and texel. */
struct cover {
    uint64_t *texel; /* 0: none */
    float *depth;    /* texels */
    size_t mask, count;
    double scale; /* texels a mm, about */
    double radius;
    struct pell_vec3 middle;
};

static enum pell_result make_cover(const struct build *b, struct cover *g)
{
    struct pell_vec3 low = { INFINITY, INFINITY, INFINITY }, high = { -INFINITY, -INFINITY, -INFINITY };
    const double side = b->p->size < COVER_MOST ? b->p->size : COVER_MOST, most = 1.5 * COVERED_PLANAR * side * side;

    for (g->mask = 1024; (double) g->mask < most;)
        g->mask *= 2;
    g->texel = pell_calloc(b->ctx, g->mask, sizeof(*g->texel));
    g->depth = pell_alloc_array(b->ctx, g->mask, sizeof(*g->depth));
    g->mask--;
    for (uint32_t t = 0; t < b->a->num_triangles; t++) {
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

/* `put`: covers a texel at this depth. Else whether it is covered at another. */
static bool cover_texel(struct cover *g, const struct flat_chart *c, int x, int y, double depth, bool put)
{
    const uint64_t key = (uint64_t) c->number << 42 | (uint64_t) y << 21 | (uint64_t) x;
    size_t i = (size_t) (key * 0x9e3779b97f4a7c15u >> 20) & g->mask;

    while (g->texel[i] && g->texel[i] != key)
        i = (i + 1) & g->mask;
    if (!put)
        return g->texel[i] && fabs((double) g->depth[i] - depth) > APART;
    if (!g->texel[i] && 4 * g->count < 3 * g->mask) {
        g->texel[i] = key;
        g->depth[i] = (float) depth;
        g->count++;
    }
    return false;
}

/* The same for the texels of a triangle, and the one that its middle is in. */
static bool cover_triangle(const struct build *b, struct cover *g, uint32_t t, const struct flat_chart *c, bool put)
{
    struct pell_vec3 p[3], u, v;
    double at[3][3];
    float corners[6];
    struct flat f;
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

static struct pell_vec3 face_normal(const struct build *b, uint32_t t)
{
    const float *f = b->topology.face + 3 * (size_t) t;
    return vec3_normalize(vec3(f[0], f[1], f[2]));
}

/* The triangle across an edge that faces the same side; NONE: there is none with an area. */
static uint32_t neighbour(const struct build *b, uint32_t half)
{
    const uint32_t twin = b->a->twin[half];

    return twin != NONE && b->area[twin / 3] > 0.0 && opposed(b, half, twin) ? twin / 3 : NONE;
}

/* A chart that grows from the seed over what has none, as far as that faces the seed's axis, the mean normal of what lies around it, and
 * does not hide another part of it. `order` has room for all triangles. */
static void grow_chart(struct build *b, struct cover *g, uint32_t seed, struct flat_chart *c, uint32_t *order)
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
        for (uint32_t i = 0; i < n; i++) {
            sum = vec3_mad(sum, (float) b->area[order[i]], face_normal(b, order[i]));
            c->area += b->area[order[i]];
            if (round == 0)
                a->chart[order[i]] = 0;
        }
        if (round == 0 && vec3_dot(vec3_normalize(sum), face_normal(b, seed)) >= (float) CHART_COSINE)
            c->axis = vec3_normalize(sum);
    }
}

/* What is left over between charts is too narrow to be blurred in charts of its own: its triangles join those beside them, one by one,
 * while they face the axis at all and hide nothing. */
static void join_small(struct build *b, struct cover *g, struct flat_chart *charts)
{
    struct ts_atlas *a = b->a;
    bool any = true;

    for (int round = 0; any && round < ROUNDS_MOST; round++) {
        any = false;
        for (uint32_t t = 0; t < a->num_triangles; t++) {
            int32_t best = 0;
            float most = JOIN_COSINE;
            if (!a->chart[t] || charts[a->chart[t] - 1].area >= CHART_LEAST * b->total_area)
                continue;
            for (uint32_t h = 3 * t; h < 3 * t + 3; h++) {
                const uint32_t other = neighbour(b, h);
                const int32_t number = other != NONE ? a->chart[other] : 0;
                float cosine;
                if (!number || charts[number - 1].area < CHART_LEAST * b->total_area)
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

/* Charts that are left are numbered anew and seen from their axes. Returns how many there are. */
static size_t flatten_charts(struct build *b, struct flat_chart *charts, size_t count)
{
    struct ts_atlas *a = b->a;
    size_t left = 0;

    for (size_t i = 0; i < count; i++)
        charts[i].number = charts[i].count > 0 ? (int32_t) ++left : 0;
    for (uint32_t t = 0; t < a->num_triangles; t++) {
        struct flat_chart *c = a->chart[t] ? &charts[a->chart[t] - 1] : NULL;
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

/* Charts that grow over the surface as far as it faces their axis, each seen from there. `order` has room for all triangles. */
static enum pell_result lay_out_planar(struct build *b, uint32_t *order)
{
    struct ts_atlas *a = b->a;
    struct flat_chart *charts = NULL;
    struct cover cover = { 0 };
    size_t count = 0, capacity = 0;
    int gutter = 0, size = b->p->size;
    double low = 0.0;
    enum pell_result res = PELL_ERR_NOMEM;

    memset(a->chart, 0, a->num_triangles * sizeof(*a->chart));
    PELL_TRY(make_cover(b, &cover));
    for (uint32_t seed = 0; seed < a->num_triangles; seed++) {
        void *array = charts;
        if (a->chart[seed] || !(b->area[seed] > 0.0))
            continue;
        PELL_TRY(pell_grow(b->ctx, &array, count, &capacity, sizeof(*charts)));
        charts = array;
        charts[count] =
            (struct flat_chart){ .number = (int32_t) count + 1, .low = { INFINITY, INFINITY }, .high = { -INFINITY, -INFINITY } };
        grow_chart(b, &cover, seed, &charts[count++], order);
    }
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(b->ctx))
        goto fail;
    join_small(b, &cover, charts);
    count = flatten_charts(b, charts, count);
    a->num_charts = (int) count;
    qsort(charts, count, sizeof(*charts), by_height);
    /* Where they do not fit in the size that was asked for they get twice as much. */
    for (; low == 0.0 && size <= SIZE_MOST; size *= 2) {
        double top = 2.0 * size / sqrt(b->total_area);
        gutter = 2 * b->p->border;
        if (gutter * gutter * (double) count > 0.25 * (double) size * size)
            gutter = (int) sqrt(0.25 * (double) size * size / (double) (count ? count : 1));
        gutter = gutter > 2 ? gutter : 2;
        for (int i = 0; i < 40; i++) {
            const double scale = 0.5 * (low + top);
            if (pack(charts, count, scale, gutter, size))
                low = scale;
            else
                top = scale;
        }
        a->width = a->height = size;
    }
    if (!(low > 0.0) || !pack(charts, count, low, gutter, a->width)) {
        res = pell_error(b->ctx, PELL_ERR_UNSUPPORTED, b->p->name, "give it texture coordinates", "%zu charts do not fit in %d x %d texels",
                         count, SIZE_MOST, SIZE_MOST);
        goto fail;
    }
    qsort(charts, count, sizeof(*charts), by_number);
    for (uint32_t t = 0; t < a->num_triangles; t++) {
        const struct flat_chart *c = a->chart[t] ? &charts[a->chart[t] - 1] : NULL;
        for (int k = 0; c && k < 6; k++)
            a->corners[t][k] = (float) (((double) a->corners[t][k] - c->low[k % 2]) * low + (k % 2 ? c->y : c->x));
    }
    a->planar = true;
    res = PELL_OK;

fail:
    pell_free(b->ctx, cover.texel);
    pell_free(b->ctx, cover.depth);
    pell_free(b->ctx, charts);
    return res;
}

/* --- Texels ---------------------------------------------------------------------------------------------------------------------- */

static enum pell_result make_planes(struct build *b)
{
    struct ts_atlas *a = b->a;
    float **const planes[] = { &a->key, &a->bary[0], &a->bary[1], &a->length[0], &a->length[1], &a->lean, &a->tilt[0], &a->tilt[1] };
    float *block;

    if (a->key)
        pell_free(b->ctx, a->key - TS_MARGIN);
    a->key = NULL;
    pell_free(b->ctx, a->source);
    a->blocks = (a->width + TS_BLOCK - 1) / TS_BLOCK;
    a->width = a->blocks * TS_BLOCK;
    a->stride = a->width + 2 * TS_MARGIN + 16;
    a->size = (size_t) a->stride * (size_t) a->height + 2 * TS_MARGIN;
    block = pell_calloc(b->ctx, a->size * PELL_COUNT(planes), sizeof(float));
    a->source = pell_alloc_array(b->ctx, a->size, sizeof(*a->source));
    for (size_t i = 0; block && i < PELL_COUNT(planes); i++)
        *planes[i] = block + i * a->size + TS_MARGIN;
    if (!block || !a->source)
        return PELL_ERR_NOMEM;
    memset(a->source, 0xff, a->size * sizeof(*a->source));
    return PELL_OK;
}

/* How a triangle lies in the layout: mm from texel to texel along x, and at right angles to that, where a step along y goes `lean` texels
 * along x, too. */
struct metric {
    float length[2], lean;
};

static struct metric metric_of(const struct ts_atlas *a, uint32_t t, const struct flat *f)
{
    struct pell_vec3 p[3], e[2], way[2];
    struct metric m;
    float square;

    corner_points(a, t, p);
    e[0] = vec3_sub(p[1], p[0]);
    e[1] = vec3_sub(p[2], p[0]);
    for (int i = 0; i < 2; i++)
        way[i] = vec3_mad(vec3_mul(e[0], (float) f->u[1 + i]), (float) f->v[1 + i], e[1]);
    square = vec3_dot(way[0], way[0]);
    m.lean = square > 0.0f ? vec3_dot(way[0], way[1]) / square : 0.0f;
    if (!(fabsf(m.lean) < LEAN_MOST))
        m.lean = 0.0f;
    m.length[0] = fminf(fmaxf(vec3_length(way[0]), LENGTH_LEAST), LENGTH_MOST);
    m.length[1] = fminf(fmaxf(vec3_length(vec3_mad(way[1], -m.lean, way[0])), LENGTH_LEAST), LENGTH_MOST);
    return m;
}

static void set_metric(struct ts_atlas *a, ptrdiff_t at, const struct metric *m)
{
    a->length[0][at] = m->length[0];
    a->length[1][at] = m->length[1];
    a->lean[at] = m->lean;
}

static void set_texel(struct ts_atlas *a, ptrdiff_t at, uint32_t t, double u, double v, const struct metric *m)
{
    a->key[at] = (float) a->chart[t];
    a->source[at] = t;
    a->bary[0][at] = (float) u;
    a->bary[1][at] = (float) v;
    set_metric(a, at, m);
}

/* Texels whose middles lie in a triangle; of several triangles the first's. */
static void rasterize(struct build *b)
{
    struct ts_atlas *a = b->a;

    b->claimed = b->twice = 0;
    for (uint32_t t = 0; t < a->num_triangles; t++) {
        const float *c = a->corners[t];
        struct flat f;
        struct metric m;
        int y0, y1;
        if (!a->chart[t] || !flatten(c, &f))
            continue;
        m = metric_of(a, t, &f);
        y0 = (int) floorf(fminf(c[1], fminf(c[3], c[5])) - 0.5f);
        y1 = (int) ceilf(fmaxf(c[1], fmaxf(c[3], c[5])) - 0.5f);
        for (int y = y0 > 0 ? y0 : 0; y <= y1 && y < a->height; y++) {
            int x0 = 0, x1 = a->width - 1;
            row_of(&f, y + 0.5, &x0, &x1);
            for (int x = x0; x <= x1; x++) {
                const double px = x + 0.5, py = y + 0.5;
                const double u = f.u[0] + f.u[1] * px + f.u[2] * py, v = f.v[0] + f.v[1] * px + f.v[2] * py, w = 1.0 - u - v;
                const ptrdiff_t at = y * a->stride + x;
                const double least = fmin(w, fmin(u, v));
                if (least < -1e-9)
                    continue;
                if (a->source[at] != NONE) {
                    /* Well inside of both: they overlap. The first has left how far inside the texel is. */
                    const double other = fmin(1.0 - (double) a->bary[0][at] - (double) a->bary[1][at],
                                              fmin((double) a->bary[0][at], (double) a->bary[1][at]));
                    b->twice += least > 1e-3 && other > 1e-3;
                    continue;
                }
                b->claimed++;
                set_texel(a, at, t, fmin(fmax(u, 0.0), 1.0), fmin(fmax(v, 0.0), 1.0), &m);
            }
        }
    }
}

/* A triangle that no texel would tell anything about takes the one that it is in. */
static void rescue(struct build *b)
{
    struct ts_atlas *a = b->a;

    for (uint32_t t = 0; t < a->num_triangles; t++) {
        const float *c = a->corners[t];
        const float x = (c[0] + c[2] + c[4]) / 3.0f, y = (c[1] + c[3] + c[5]) / 3.0f;
        struct ts_place place;
        ptrdiff_t at;
        struct flat f;
        struct metric m = { .length = { (float) a->mm_per_texel, (float) a->mm_per_texel } };
        if (!a->chart[t] || !(x > 0.0f && y > 0.0f && x < (float) a->width && y < (float) a->height))
            continue;
        place = ts_atlas_place(a, t, 1.0f / 3.0f, 1.0f / 3.0f);
        if (ts_read(a, &place, NULL, 0, NULL))
            continue;
        at = (ptrdiff_t) y * a->stride + (ptrdiff_t) x;
        if (a->source[at] != NONE)
            continue;
        if (flatten(c, &f))
            m = metric_of(a, t, &f);
        set_texel(a, at, t, 1.0 / 3.0, 1.0 / 3.0, &m);
        b->claimed++;
    }
}

/* --- Over the edge --------------------------------------------------------------------------------------------------------------- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

bool ts_atlas_walk(const struct ts_atlas *a, uint32_t *triangle, double bary[2], struct pell_vec3 way)
{
    double d[3] = { (double) way.x, (double) way.y, (double) way.z };
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
                s = fmax(b[k], 0.0) / -rate[k];
                out = half;
            }
        }
        for (int k = 0; k < 3; k++)
            b[k] = fmax(b[k] + s * rate[k], 0.0);
        length = b[0] + b[1] + b[2];
        if (out == NONE) {
            *triangle = t;
            bary[0] = b[1] / length;
            bary[1] = b[2] / length;
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
        return (struct ts_place){ .at = -1 };
    return (struct ts_place){
        .at = (int32_t) ((ptrdiff_t) fy * a->stride + (ptrdiff_t) fx),
        .key = (float) a->chart[t],
        .fx = x - fx,
        .fy = y - fy,
    };
}

/* Lets the texel of the chart itself that is nearest to a place where it has none stand for it; false: there is none near. */
static bool take_nearest(const struct ts_atlas *a, const struct ts_place *p, struct ts_border *border)
{
    const int px = (int) (p->at % a->stride), py = (int) (p->at / a->stride);
    float least = INFINITY;

    for (int y = py - NEARBY; y <= py + 1 + NEARBY; y++)
        for (int x = px - NEARBY; x <= px + 1 + NEARBY; x++) {
            const ptrdiff_t at = y * a->stride + x;
            const float dx = (float) (x - px) - p->fx, dy = (float) (y - py) - p->fy, d2 = dx * dx + dy * dy;
            if (x < 0 || y < 0 || x >= a->width || y >= a->height || a->source[at] == NONE || a->key[at] != p->key || !(d2 < least))
                continue;
            least = d2;
            border->from = (int32_t) at;
        }
    border->weight[0] = 1.0f;
    return least < INFINITY;
}

/* The border texel `at`, where texels of the chart itself say what is at the place. One that is left out is a hole that a row of taps
 * falls into: triangles narrower than texels, which have none, take the nearest. */
static bool take_border(const struct ts_atlas *a, ptrdiff_t at, const struct ts_place *p, struct ts_border *border)
{
    float sum = 0.0f;

    if (p->at < 0)
        return false;
    *border = (struct ts_border){ .at = (int32_t) at, .from = p->at };
    for (int k = 0; k < 4; k++) {
        const ptrdiff_t from = p->at + k % 2 + k / 2 * a->stride;
        if (a->source[from] != NONE && a->key[from] == p->key)
            sum += border->weight[k] = (k % 2 ? p->fx : 1.0f - p->fx) * (k / 2 ? p->fy : 1.0f - p->fy);
    }
    for (int k = 0; k < 4; k++)
        border->weight[k] = sum > 1e-3f ? border->weight[k] / sum : 0.0f;
    return sum > 1e-3f || take_nearest(a, p, border);
}

/* Texels and the nearest edge at which a chart ends but the surface goes on. */
struct nearest {
    const struct build *b;
    const uint32_t *edges; /* halves */
    size_t num_edges;
    float *distance2;
    uint32_t *edge; /* NONE: all are too far */
};

static void near_edge(const struct nearest *n, uint32_t h, int y0, int y1)
{
    const struct ts_atlas *a = n->b->a;
    const float reach = (float) n->b->p->border, *c = a->corners[h / 3], *p = c + 2 * (h % 3), *q = c + 2 * ((h + 1) % 3);
    const float ex = q[0] - p[0], ey = q[1] - p[1], l2 = ex * ex + ey * ey, inverse = l2 > 0.0f ? 1.0f / l2 : 0.0f;
    const float left = fmaxf(floorf(fminf(p[0], q[0]) - reach), 0.0f), right = fmaxf(p[0], q[0]) + reach;
    const float top = fmaxf(floorf(fminf(p[1], q[1]) - reach), (float) y0), bottom = fmaxf(p[1], q[1]) + reach;

    for (int y = (int) top; y < y1 && (float) y < bottom; y++)
        for (int x = (int) left; x < a->width && (float) x < right; x++) {
            const ptrdiff_t at = y * a->stride + x;
            float dx, dy, s, d2;

            if (a->source[at] != NONE)
                continue;
            dx = (float) x + 0.5f - p[0];
            dy = (float) y + 0.5f - p[1];
            s = (dx * ex + dy * ey) * inverse;
            s = s > 0.0f ? s < 1.0f ? s : 1.0f : 0.0f;
            d2 = (dx - s * ex) * (dx - s * ex) + (dy - s * ey) * (dy - s * ey);
            if (d2 >= reach * reach)
                continue;
            /* Of the two edges of a corner the one that the texel lies more in front of. */
            d2 -= 1e-3f * (dx * ey - dy * ex) * (dx * ey - dy * ex) * inverse;
            if (d2 < n->distance2[at]) {
                n->distance2[at] = d2;
                n->edge[at] = h;
            }
        }
}

static void near_rows(void *arg, int index, int worker)
{
    const struct nearest *n = arg;
    const struct ts_atlas *a = n->b->a;
    const int y0 = index * BAND, y1 = y0 + BAND < a->height ? y0 + BAND : a->height;
    const float reach = (float) n->b->p->border;

    (void) worker;
    for (ptrdiff_t at = y0 * a->stride; at < y1 * a->stride; at++) {
        n->distance2[at] = reach * reach;
        n->edge[at] = NONE;
    }
    for (size_t i = 0; i < n->num_edges && !pell_cancelled(n->b->ctx); i++)
        near_edge(n, n->edges[i], y0, y1);
}

/* How far each texel is from the inside of a chart, along the longer axis, under TS_FAR: once from each end of the map. */
static void measure_far(const struct ts_atlas *a, uint8_t *far)
{
    const ptrdiff_t step[2][4] = { { -1, -a->stride - 1, -a->stride, -a->stride + 1 }, { 1, a->stride + 1, a->stride, a->stride - 1 } };

    for (size_t i = 0; i < a->size; i++)
        far[i] = TS_FAR - 1;
    far += TS_MARGIN;
    for (int back = 0; back < 2; back++)
        for (int j = 0; j < a->height; j++) {
            const int y = back ? a->height - 1 - j : j, around = back ? y < a->height - 1 ? 4 : 1 : y > 0 ? 4 : 1;
            for (int i = 0; i < a->width; i++) {
                const ptrdiff_t at = y * a->stride + (back ? a->width - 1 - i : i);
                int least = far[at];
                for (int k = 0; k < around; k++)
                    least = far[at + step[back][k]] + 1 < least ? far[at + step[back][k]] + 1 : least;
                far[at] = a->source[at] != NONE ? 0 : (uint8_t) least;
            }
        }
}

static void put_part(struct ts_part *list, int32_t *count, ptrdiff_t at, float weight)
{
    for (int32_t i = 0; i < *count; i++)
        if (list[i].at == at) {
            list[i].weight += weight;
            return;
        }
    list[(*count)++] = (struct ts_part){ (int32_t) at, weight };
}

/* Beside a seam some of the four texels around a place are borders themselves. What these stand for lies across the seam again: without it
 * the place is moved inward by up to half a texel. */
static enum pell_result mend_seams(struct build *b)
{
    struct ts_atlas *a = b->a;
    int32_t *border_at = pell_alloc_array(b->ctx, a->size, sizeof(*border_at));
    size_t count = 0, room = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!border_at)
        return PELL_ERR_NOMEM;
    memset(border_at, 0xff, a->size * sizeof(*border_at));
    for (size_t i = 0; i < a->num_borders; i++)
        border_at[a->borders[i].at] = (int32_t) i;
    for (size_t i = 0; i < a->num_borders; i++) {
        struct ts_border *border = &a->borders[i];
        const struct ts_place *p = &b->border_place[i];
        struct ts_part list[4 + 3 * 4];
        int32_t parts = 0;
        bool mixed = false;
        float sum = 0.0f;
        void *array = a->parts;
        for (int k = 0; k < 4; k++) {
            const ptrdiff_t from = p->at + k % 2 + k / 2 * a->stride;
            const float w = (k % 2 ? p->fx : 1.0f - p->fx) * (k / 2 ? p->fy : 1.0f - p->fy);
            if (!(w > 0.0f) || a->key[from] != p->key)
                continue;
            if (a->source[from] != NONE) {
                put_part(list, &parts, from, w);
                sum += w;
                continue;
            }
            if (parts > 12 || border_at[from] < 0)
                continue;
            for (int l = 0; l < 4; l++)
                if (a->borders[border_at[from]].weight[l] > 0.0f)
                    put_part(list, &parts, a->borders[border_at[from]].from + l % 2 + l / 2 * a->stride,
                             w * a->borders[border_at[from]].weight[l]);
            sum += w;
            mixed = true;
        }
        if (!mixed && border->weight[0] > 0.0f && border->weight[1] > 0.0f && border->weight[2] > 0.0f && border->weight[3] > 0.0f)
            continue;
        if (!(sum > 1e-3f)) {
            parts = 0;
            sum = 1.0f;
            for (int l = 0; l < 4; l++)
                if (border->weight[l] > 0.0f)
                    put_part(list, &parts, border->from + l % 2 + l / 2 * a->stride, border->weight[l]);
        }
        while (room < count + (size_t) parts) {
            PELL_TRY(pell_grow(b->ctx, &array, room, &room, sizeof(*a->parts)));
            a->parts = array;
        }
        border->first = (int32_t) count;
        border->parts = parts;
        for (int32_t k = 0; k < parts; k++)
            a->parts[count++] = (struct ts_part){ list[k].at, list[k].weight / sum };
    }
    res = PELL_OK;

fail:
    pell_free(b->ctx, border_at);
    return res;
}

static size_t square_of(const struct ts_atlas *a, const struct ts_border *b)
{
    return (size_t) (b->at / a->stride / TS_BLOCK) * (size_t) a->blocks + (size_t) (b->at % a->stride / TS_BLOCK);
}

static struct ts_fill fill_of(const struct ts_border *b)
{
    const float *w = b->weight;

    return (struct ts_fill){
        .at = b->at,
        .from = b->parts > 0 ? b->first : b->from,
        .x = (uint16_t) ((w[1] + w[3]) * TS_WHOLE + 0.5f),
        .y = (uint16_t) ((w[2] + w[3]) * TS_WHOLE + 0.5f),
        .far = (uint8_t) b->far,
        .parts = (uint8_t) b->parts,
    };
}

/* By squares, so that what lies beside each other is read together, and in a square by distance. */
static enum pell_result sort_borders(struct build *b, const uint8_t *far)
{
    struct ts_atlas *a = b->a;
    const size_t squares = (size_t) a->blocks * (size_t) ((a->height + TS_BLOCK - 1) / TS_BLOCK);
    struct ts_border *sorted = pell_alloc_array(b->ctx, a->num_borders + 1, sizeof(*sorted)), *other = a->borders;
    size_t next[TS_FAR] = { 0 };

    a->first_border = pell_calloc(b->ctx, squares + 2, sizeof(*a->first_border));
    a->first_mended = pell_alloc_array(b->ctx, squares + 1, sizeof(*a->first_mended));
    a->fills = pell_calloc(b->ctx, a->num_borders + TS_AHEAD, sizeof(*a->fills));
    if (!sorted || !a->first_border || !a->first_mended || !a->fills) {
        pell_free(b->ctx, sorted);
        return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < a->num_borders; i++) {
        other[i].far = far[other[i].at];
        a->within[other[i].far]++;
        a->first_border[square_of(a, &other[i]) + 2]++;
    }
    for (int k = 1; k < TS_FAR; k++) {
        next[k] = a->within[k - 1];
        a->within[k] += a->within[k - 1];
    }
    for (size_t i = 0; i < a->num_borders; i++)
        sorted[next[other[i].far]++] = other[i];
    a->num_squares = squares;
    for (size_t i = 2; i < squares + 2; i++)
        a->first_border[i] += a->first_border[i - 1];
    for (int mended = 0; mended < 2; mended++) {
        for (size_t i = 0; i < a->num_borders; i++)
            if ((sorted[i].parts > 0) == mended)
                a->fills[a->first_border[square_of(a, &sorted[i]) + 1]++] = fill_of(&sorted[i]);
        for (size_t i = 0; i < squares && !mended; i++)
            a->first_mended[i] = a->first_border[i + 1];
    }
    pell_free(b->ctx, sorted);
    pell_free(b->ctx, a->borders);
    a->borders = NULL;
    return PELL_OK;
}

static struct pell_vec3 spot_of(const struct ts_atlas *a, uint32_t triangle, float u, float v)
{
    struct pell_vec3 at, normal;
    float largest;

    ts_point_of(a, triangle, u, v, &at, &normal, &largest);
    return at;
}

/* Texels beside the charts, each with its nearest edge. */
struct beside {
    struct build *b;
    const uint32_t *edge;
    size_t *first; /* per row: where its borders begin */
    int *count;    /* and how many there are: only texels of charts are read, so that rows go by themselves */
};

/* What lies beyond its edge becomes of a texel. */
static bool cross_edge(struct build *b, uint32_t h, int x, int y, struct ts_border *border, struct ts_place *place)
{
    struct ts_atlas *a = b->a;
    const ptrdiff_t at = y * a->stride + x;
    const uint32_t t = h / 3;
    const float *c = a->corners[t], *e0 = c + 2 * (h % 3), *e1 = c + 2 * ((h + 1) % 3);
    const float ex = e1[0] - e0[0], ey = e1[1] - e0[1], l2 = ex * ex + ey * ey;
    float s = l2 > 0.0f ? (((float) x + 0.5f - e0[0]) * ex + ((float) y + 0.5f - e0[1]) * ey) / l2 : 0.5f;
    double inner[3] = { 1e-3 / 3.0, 1e-3 / 3.0, 1e-3 / 3.0 }, from[2], way[2]; /* just inside */
    struct pell_vec3 p[3];
    struct metric m;
    struct flat f;
    uint32_t to = t;

    if (!flatten(c, &f))
        return false;
    s = fminf(fmaxf(s, 0.0f), 1.0f);
    inner[h % 3] += (1.0 - 1e-3) * (1.0 - (double) s);
    inner[(h + 1) % 3] += (1.0 - 1e-3) * (double) s;
    from[0] = inner[1];
    from[1] = inner[2];
    way[0] = f.u[0] + f.u[1] * (x + 0.5) + f.u[2] * (y + 0.5) - from[0];
    way[1] = f.v[0] + f.v[1] * (x + 0.5) + f.v[2] * (y + 0.5) - from[1];
    corner_points(a, t, p);
    m = metric_of(a, t, &f);
    if (!ts_atlas_walk(a, &to, from,
                       vec3_add(vec3_mul(vec3_sub(p[1], p[0]), (float) way[0]), vec3_mul(vec3_sub(p[2], p[0]), (float) way[1]))))
        return false;
    *place = ts_atlas_place(a, to, (float) from[0], (float) from[1]);
    if (!take_border(a, at, place, border))
        return false;
    b->place[at] = spot_of(a, to, (float) from[0], (float) from[1]);
    a->key[at] = (float) a->chart[t];
    set_metric(a, at, &m);
    return true;
}

static void cross_row(void *arg, int y, int worker)
{
    const struct beside *beside = arg;
    struct build *b = beside->b;
    size_t next = beside->first[y];
    (void) worker;

    for (int x = 0; x < b->a->width; x++) {
        const uint32_t h = beside->edge[y * b->a->stride + x];
        if (h != NONE && cross_edge(b, h, x, y, &b->a->borders[next], &b->border_place[next]))
            next++;
    }
    beside->count[y] = (int) (next - beside->first[y]);
}

/* For each texel beside the charts the nearest edge at which a chart ends but the surface goes on, and what lies there. */
static enum pell_result find_borders(struct build *b)
{
    struct ts_atlas *a = b->a;
    const float reach = (float) b->p->border;
    double budget = BORDER_WORK * (double) a->size;
    float *near = pell_alloc_array(b->ctx, a->size, sizeof(*near));
    uint32_t *edge = pell_alloc_array(b->ctx, a->size, sizeof(*edge)), *edges = NULL;
    size_t count = 0, room = 0;
    struct nearest nearest = { .b = b, .distance2 = near, .edge = edge };
    struct beside beside = { .b = b, .edge = edge };
    enum pell_result res = PELL_ERR_NOMEM;

    if (!near || !edge)
        goto fail;
    for (uint32_t h = 0; h < 3 * a->num_triangles; h++) {
        const float *c = a->corners[h / 3];
        const float *p = c + 2 * (h % 3), *q = c + 2 * ((h + 1) % 3);
        if (!a->chart[h / 3] || a->twin[h] == NONE || !a->chart[a->twin[h] / 3] || joined(b, h))
            continue;
        /* Edges that are long and many, as only layouts made to harm have them, go without. */
        budget -= (double) (fabsf(q[0] - p[0]) + 2.0f * reach) * (double) (fabsf(q[1] - p[1]) + 2.0f * reach);
        if (budget < 0.0)
            break;
        PELL_TRY(pell_grow(b->ctx, (void **) &edges, nearest.num_edges, &room, sizeof(*edges)));
        edges[nearest.num_edges++] = h;
    }
    nearest.edges = edges;
    pell_pool_run(b->p->pool, (a->height + BAND - 1) / BAND, near_rows, &nearest);
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(b->ctx))
        goto fail;
    res = PELL_ERR_NOMEM;
    beside.first = pell_alloc_array(b->ctx, (size_t) a->height, sizeof(*beside.first));
    beside.count = pell_calloc(b->ctx, (size_t) a->height, sizeof(*beside.count));
    if (!beside.first || !beside.count)
        goto fail;
    for (int y = 0; y < a->height; y++) {
        beside.first[y] = count;
        for (int x = 0; x < a->width; x++)
            count += edge[y * a->stride + x] != NONE;
    }
    a->borders = pell_alloc_array(b->ctx, count + 1, sizeof(*a->borders));
    b->border_place = pell_alloc_array(b->ctx, count + 1, sizeof(*b->border_place));
    if (!a->borders || !b->border_place)
        goto fail;
    pell_pool_run(b->p->pool, a->height, cross_row, &beside);
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(b->ctx))
        goto fail;
    for (int y = 0; y < a->height; y++) {
        const size_t n = (size_t) beside.count[y];
        memmove(a->borders + a->num_borders, a->borders + beside.first[y], n * sizeof(*a->borders));
        memmove(b->border_place + a->num_borders, b->border_place + beside.first[y], n * sizeof(*b->border_place));
        a->num_borders += n;
    }
    res = PELL_OK;

fail:
    pell_free(b->ctx, beside.first);
    pell_free(b->ctx, beside.count);
    pell_free(b->ctx, near);
    pell_free(b->ctx, edge);
    pell_free(b->ctx, edges);
    return res;
}

static enum pell_result find_runs(struct build *b, const uint8_t *far)
{
    struct ts_atlas *a = b->a;
    int count = 0;

    a->cells = pell_calloc(b->ctx, (size_t) a->blocks * (size_t) a->height + 1, sizeof(*a->cells));
    a->first_run = pell_calloc(b->ctx, (size_t) a->height + 1, sizeof(*a->first_run));
    a->runs = pell_alloc_array(b->ctx, ((size_t) a->blocks / 2 + 1) * (size_t) a->height + 1, sizeof(*a->runs));
    if (!a->cells || !a->first_run || !a->runs)
        return PELL_ERR_NOMEM;
    for (int y = 0; y < a->height; y++) {
        bool open = false;
        a->first_run[y] = count;
        for (int block = 0; block < a->blocks; block++) {
            struct ts_cell *c = &a->cells[(ptrdiff_t) y * a->blocks + block];
            float lean = 0.0f, count_of = 0.0f;
            c->near = TS_FAR;
            for (int l = 0; l < TS_BLOCK; l++) {
                const ptrdiff_t at = y * a->stride + block * TS_BLOCK + l;
                for (int i = 0; i < 2 && a->key[at] > 0.0f; i++) {
                    c->least[i] = c->most[i] > 0.0f ? fminf(c->least[i], a->length[i][at]) : a->length[i][at];
                    c->most[i] = fmaxf(c->most[i], a->length[i][at]);
                }
                lean += a->source[at] != NONE ? a->lean[at] : 0.0f;
                count_of += a->source[at] != NONE ? 1.0f : 0.0f;
                c->near = a->key[at] > 0.0f && far[at] < c->near ? far[at] : c->near;
            }
            c->lean = count_of > 0.0f ? lean / count_of : 0.0f;
            if (c->most[0] > 0.0f && !open)
                a->runs[count++].from = (int16_t) block;
            open = c->most[0] > 0.0f;
            if (open)
                a->runs[count - 1].to = (int16_t) (block + 1);
        }
    }
    a->first_run[a->height] = count;
    return PELL_OK;
}

/* --- How lines of texels bend ---------------------------------------------------------------------------------------------------- */

/* A way along x, or along the line at right angles to it. */
struct way {
    struct pell_vec3 end;
    float length; /* mm */
};

/* `steps` texels from a texel, or as far as its chart goes; false: nowhere. */
static bool go(const struct build *b, int x, int y, int axis, int sign, int steps, struct way *out)
{
    const struct ts_atlas *a = b->a;
    const ptrdiff_t from = y * a->stride + x;
    const float lean = axis == 0 ? 0.0f : a->cells[(ptrdiff_t) y * a->blocks + x / TS_BLOCK].lean;
    float last = a->length[axis][from];
    int done = 0;

    out->length = 0.0f;
    out->end = b->place[from];
    for (int j = 1; j <= steps; j++) {
        const int px = axis == 0 ? x + sign * j : x + (int) floorf(0.5f - lean * (float) (sign * j)), py = axis == 0 ? y : y + sign * j;
        const ptrdiff_t at = py * a->stride + px;
        if (px < 0 || py < 0 || px >= a->width || py >= a->height || a->key[at] != a->key[from])
            break;
        if (vec3_length(vec3_sub(b->place[at], out->end)) > a->length[0][at] + a->length[1][at])
            break; /* two edges' borders meet */
        out->length += 0.5f * (last + a->length[axis][at]);
        last = a->length[axis][at];
        out->end = b->place[at];
        done = j;
    }
    return 2 * done > steps;
}

/* Second derivative of the place along a line of texels. */
static struct pell_vec3 bend_of(const struct build *b, int x, int y, int axis, int steps)
{
    const struct pell_vec3 at = b->place[y * b->a->stride + x];
    struct way way[2];

    if (!go(b, x, y, axis, 1, steps, &way[0]) || !go(b, x, y, axis, -1, steps, &way[1]))
        return vec3(0.0f, 0.0f, 0.0f);
    return vec3_mul(
        vec3_add(vec3_mul(vec3_sub(way[0].end, at), 1.0f / way[0].length), vec3_mul(vec3_sub(way[1].end, at), 1.0f / way[1].length)),
        2.0f / (way[0].length + way[1].length));
}

/* In texels. */
static float tilt_of(struct pell_vec3 bend, struct pell_vec3 way, float length, float most)
{
    const float tilt = -0.5f * vec3_dot(bend, vec3_normalize(way)) * length;

    return tilt > -most ? tilt < most ? tilt : most : tilt < 0.0f ? -most : 0.0f; /* no number: none */
}

/* Blurs go along straight lines of the layout, which on the surface are not the straightest ones: their taps lie aside, by s^2/2 times how
 * they bend. Light that spreads along the surface has no such drift (the Laplacian of the place is normal to the surface): taps weigh more
 * on the other side, by as much as brings their mean back. */
static void tilt_rows(void *arg, int band, int worker)
{
    const struct build *b = arg;
    const struct ts_atlas *a = b->a;
    const int steps = b->p->border > 2 * TAPS_SIGMAS ? b->p->border / TAPS_SIGMAS : 2;

    (void) worker;
    for (int y = band * BAND; y < (band + 1) * BAND && y < a->height && !pell_cancelled(b->ctx); y++)
        for (int x = 0; x < a->width; x++) {
            const ptrdiff_t at = y * a->stride + x;
            struct pell_vec3 along, down, p[3], e[2];
            struct flat f;
            if (a->source[at] == NONE || !flatten(a->corners[a->source[at]], &f))
                continue;
            corner_points(a, a->source[at], p);
            e[0] = vec3_sub(p[1], p[0]);
            e[1] = vec3_sub(p[2], p[0]);
            along = vec3_mad(vec3_mul(e[0], (float) f.u[1]), (float) f.v[1], e[1]);
            down = vec3_mad(vec3_mul(e[0], (float) f.u[2]), (float) f.v[2], e[1]);
            down = vec3_mad(down, -a->lean[at], along);
            a->tilt[0][at] = tilt_of(bend_of(b, x, y, 1, steps), along, a->length[0][at], TILT_MOST / (float) steps);
            a->tilt[1][at] = tilt_of(bend_of(b, x, y, 0, steps), down, a->length[1][at], TILT_MOST / (float) steps);
        }
}

/* --- All together ---------------------------------------------------------------------------------------------------------------- */

static enum pell_result lay_out(struct build *b, uint32_t *order)
{
    struct ts_atlas *a = b->a;
    const char *wrong = b->p->charts == TS_CHARTS_PLANAR ? "" : lay_out_file(b);
    double flat = 0.0, covered = 0.0;
    enum pell_result res;

    for (uint32_t t = 0; t < a->num_triangles && !wrong; t++)
        covered += fabs(flat_area(a->corners[t]));
    if (!wrong && covered > COVERED_MOST * a->width * a->height)
        wrong = OVERLAPS;
    if (!wrong) {
        number_charts(b, order);
        PELL_TRY(make_planes(b));
        rasterize(b);
        for (uint32_t t = 0; t < a->num_triangles; t++)
            if (b->area[t] > 0.0 && !(fabs(flat_area(a->corners[t])) > 1e-9))
                flat += b->area[t];
        a->degenerate = flat / b->total_area;
        a->overlap = b->claimed > 0 ? (double) b->twice / (double) b->claimed : 0.0;
        if (a->degenerate > DEGENERATE_MOST)
            wrong = "part of it has no area in its texture coordinates";
        else if (a->overlap > OVERLAP_MOST)
            wrong = OVERLAPS;
        else if ((double) b->claimed < COVERED_LEAST * a->width * a->height)
            wrong = "its texture coordinates leave most of the map empty";
        if (!wrong || b->p->charts == TS_CHARTS_UV)
            return PELL_OK;
    } else if (b->p->charts == TS_CHARTS_UV) {
        return pell_error(b->ctx, PELL_ERR_INVALID, b->p->name, "let the method choose: charts=auto", "%s", wrong);
    }
    PELL_TRY(lay_out_planar(b, order));
    if (wrong[0] && !a->scene->meshes[b->meshes[0]].uv[0])
        pell_info(b->ctx, b->p->name, "%s: laid out in %d planar charts", wrong, a->num_charts);
    else if (wrong[0])
        pell_warn(b->ctx, b->p->name, "charts=planar says that this is as meant", "%s: laid out in %d planar charts", wrong, a->num_charts);
    PELL_TRY(make_planes(b));
    rasterize(b);
    return PELL_OK;

fail:
    return res;
}

enum pell_result ts_atlas_make(struct pell_context *ctx, const struct ts_atlas_params *params, struct ts_atlas **out)
{
    struct ts_atlas *a = pell_zalloc(ctx, sizeof(*a));
    struct build b = { .ctx = ctx, .p = params, .a = a };
    uint32_t *order = NULL;
    uint8_t *far = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!a)
        return PELL_ERR_NOMEM;
    a->ctx = ctx;
    a->scene = params->scene;
    PELL_TRY(list_triangles(&b));
    order = pell_alloc_array(ctx, 2 * (size_t) a->num_triangles + 1, sizeof(*order));
    if (!order) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(lay_out(&b, order));
    a->mm_per_texel = b.claimed > 0 ? sqrt(b.total_area / (double) b.claimed) : 1.0;
    rescue(&b);
    a->inner = b.claimed;
    far = pell_alloc_array(ctx, a->size, sizeof(*far));
    if (!far) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    b.place = pell_alloc_array(ctx, a->size, sizeof(*b.place));
    if (!b.place) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(find_borders(&b));
    PELL_TRY(mend_seams(&b));
    measure_far(a, far);
    PELL_TRY(sort_borders(&b, far + TS_MARGIN));
    PELL_TRY(find_runs(&b, far + TS_MARGIN));
    for (int y = 0; y < a->height; y++)
        for (ptrdiff_t at = y * a->stride; at < y * a->stride + a->width; at++)
            if (a->source[at] != NONE)
                b.place[at] = spot_of(a, a->source[at], a->bary[0][at], a->bary[1][at]);
    pell_pool_run(params->pool, (a->height + BAND - 1) / BAND, tilt_rows, &b);
    *out = a;
    a = NULL;

fail:
    pell_topology_finish(&b.topology);
    pell_free(ctx, b.meshes);
    pell_free(ctx, b.area);
    pell_free(ctx, order);
    pell_free(ctx, far);
    pell_free(ctx, b.place);
    pell_free(ctx, b.border_place);
    ts_atlas_destroy(&a);
    return res;
}
