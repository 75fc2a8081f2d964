/* SPDX-License-Identifier: MIT
 * polygon.c - triangulates polygons by ear clipping in the plane of the polygon's area vector (Newell's method). */
#include "scene/mesh/polygon.h"

#include "math/vec.h"

#include <math.h>

/* Limit on the point-in-ear tests for all polygons of a file, so that giant ones can't stall the reader. */
#define TESTS_MOST ((int64_t) 200000000)

enum pell_result pell_polygon_reserve(struct pell_polygon *p, size_t corners)
{
    size_t wanted = p->capacity ? p->capacity : 8;

    if (corners <= p->capacity)
        return PELL_OK;
    while (wanted < corners)
        wanted *= 2;
    {
        float *point = pell_realloc_array(p->ctx, p->point, wanted, 3 * sizeof(*point));
        uint32_t *triangle;
        if (!point)
            return PELL_ERR_NOMEM;
        p->point = point;
        triangle = pell_realloc_array(p->ctx, p->triangle, wanted, 3 * sizeof(*triangle));
        if (!triangle)
            return PELL_ERR_NOMEM;
        p->triangle = triangle;
    }
    pell_free(p->ctx, p->flat);
    pell_free(p->ctx, p->next);
    pell_free(p->ctx, p->previous);
    p->capacity = 0;
    p->flat = pell_alloc_array(p->ctx, wanted, 2 * sizeof(*p->flat));
    p->next = pell_alloc_array(p->ctx, wanted, sizeof(*p->next));
    p->previous = pell_alloc_array(p->ctx, wanted, sizeof(*p->previous));
    if (!p->flat || !p->next || !p->previous)
        return PELL_ERR_NOMEM;
    p->capacity = wanted;
    return PELL_OK;
}

void pell_polygon_finish(struct pell_polygon *p)
{
    if (!p->ctx)
        return;
    pell_free(p->ctx, p->point);
    pell_free(p->ctx, p->triangle);
    pell_free(p->ctx, p->flat);
    pell_free(p->ctx, p->next);
    pell_free(p->ctx, p->previous);
}

static void emit(struct pell_polygon *p, size_t *count, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t *t = p->triangle + 3 * (*count)++;

    t[0] = a;
    t[1] = b;
    t[2] = c;
}

/* Twice the signed area of a triangle of flat points. */
static double area(const double *flat, uint32_t a, uint32_t b, uint32_t c)
{
    const double *p = flat + 2 * (size_t) a, *q = flat + 2 * (size_t) b, *r = flat + 2 * (size_t) c;
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

/* Projects along the axis of the largest component of the area vector, so that the polygon runs counter-clockwise. False if it has no
 * area. */
static bool flatten(struct pell_polygon *p, size_t count)
{
    double n[3] = { 0 };
    int axis = 0, u, v;

    for (size_t i = 0; i < count; i++) {
        const float *a = p->point + 3 * i, *b = p->point + 3 * ((i + 1) % count);
        for (int c = 0; c < 3; c++) {
            const int d = (c + 1) % 3, e = (c + 2) % 3;
            n[c] += ((double) a[d] - b[d]) * ((double) a[e] + b[e]);
        }
    }
    for (int c = 1; c < 3; c++)
        if (fabs(n[c]) > fabs(n[axis]))
            axis = c;
    if (!(fabs(n[axis]) > 0.0))
        return false;
    u = (axis + 1) % 3;
    v = (axis + 2) % 3;
    for (size_t i = 0; i < count; i++) {
        p->flat[2 * i] = p->point[3 * i + (size_t) (n[axis] > 0.0 ? u : v)];
        p->flat[2 * i + 1] = p->point[3 * i + (size_t) (n[axis] > 0.0 ? v : u)];
    }
    return true;
}

static bool same_point(const double *flat, uint32_t a, uint32_t b)
{
    return flat[2 * (size_t) a] == flat[2 * (size_t) b] && flat[2 * (size_t) a + 1] == flat[2 * (size_t) b + 1];
}

/* Whether the corner is convex, and no other corner lies in its triangle. */
static bool is_ear(const struct pell_polygon *p, uint32_t b, int64_t *tests)
{
    const uint32_t a = p->previous[b], c = p->next[b];

    if (!(area(p->flat, a, b, c) > 0.0))
        return false;
    for (uint32_t i = p->next[c]; i != a && *tests > 0; i = p->next[i]) {
        --*tests;
        if (same_point(p->flat, i, a) || same_point(p->flat, i, b) || same_point(p->flat, i, c))
            continue;
        if (area(p->flat, a, b, i) >= 0.0 && area(p->flat, b, c, i) >= 0.0 && area(p->flat, c, a, i) >= 0.0)
            return false;
    }
    return *tests > 0;
}

static double distance2(const struct pell_polygon *p, size_t a, size_t b)
{
    double d2 = 0.0;

    for (int c = 0; c < 3; c++) {
        const double d = (double) p->point[3 * a + (size_t) c] - p->point[3 * b + (size_t) c];
        d2 += d * d;
    }
    return d2;
}

static bool is_convex(const struct pell_polygon *p, size_t count)
{
    double turn = 0.0;

    /* Convex if all corners turn left and the outline goes round once: then its exterior angles sum to one turn. */
    for (size_t i = 0; i < count; i++) {
        const double *a = p->flat + 2 * i, *b = p->flat + 2 * ((i + 1) % count), *c = p->flat + 2 * ((i + 2) % count);
        const double ux = b[0] - a[0], uy = b[1] - a[1], vx = c[0] - b[0], vy = c[1] - b[1], cross = ux * vy - uy * vx;
        if (!(cross > 0.0))
            return false;
        if (count > 4)
            turn += atan2(cross, ux * vx + uy * vy);
    }
    return turn < 3.0 * PELL_PI;
}

bool pell_polygon_triangulate(struct pell_polygon *p, size_t count)
{
    int64_t tests = TESTS_MOST - p->spent;
    uint32_t left = (uint32_t) count, corner = 0, stuck = 0;
    size_t done = 0;

    if (count == 3) {
        emit(p, &done, 0, 1, 2);
        return true;
    }
    if (!flatten(p, count) || is_convex(p, count)) {
        const bool other = count == 4 && distance2(p, 1, 3) < distance2(p, 0, 2);
        for (uint32_t i = 1; i + 1 < count; i++) {
            if (other)
                emit(p, &done, i == 1 ? 0 : 1, i == 1 ? 1 : 2, 3);
            else
                emit(p, &done, 0, i, i + 1);
        }
        return true;
    }
    for (uint32_t i = 0; i < count; i++) {
        p->next[i] = (uint32_t) ((i + 1) % count);
        p->previous[i] = (uint32_t) ((i + count - 1) % count);
    }
    while (left > 3 && stuck < left && tests > 0) {
        if (!is_ear(p, corner, &tests)) {
            corner = p->next[corner];
            stuck++;
            continue;
        }
        emit(p, &done, p->previous[corner], corner, p->next[corner]);
        p->next[p->previous[corner]] = p->next[corner];
        p->previous[p->next[corner]] = p->previous[corner];
        /* Continuing after the neighbour spreads the triangles instead of making a fan of slivers. */
        corner = p->next[p->next[corner]];
        left--;
        stuck = 0;
    }
    p->spent = TESTS_MOST - tests;
    const bool failed = left > 3;
    for (uint32_t i = p->next[corner]; left > 2; left--, i = p->next[i])
        emit(p, &done, corner, i, p->next[i]);
    return !failed;
}
