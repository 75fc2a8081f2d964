/* SPDX-License-Identifier: MIT
 *
 * solids.h - closed solids for tests of transport, beyond the box and the ball of stage.h, and the check that a solid is one.
 *
 *     solid_slab       a box so wide that its middle is a slab
 *     solid_stack      stacked slabs, each a separate solid
 *     solid_ball       a ball from an icosahedron: another tessellation than stage_ball's rings
 *     solid_shell      a ball with another one, or an opaque object, inside
 *     solid_volume     checks that a mesh is closed and oriented outward; its volume
 */
#ifndef RENDER_SOLIDS_H
#define RENDER_SOLIDS_H

#include "stage.h"

/* From z = -thickness to 0, `half` mm to each side. */
static inline void solid_slab(struct stage *s, size_t material, int object, float half, float thickness)
{
    stage_box(s, material, object, vec3(-half, -half, -thickness), vec3(half, half, 0.0f));
}

/* `count` slabs downward from z = 0, objects 0, 1, ...; separated by `gap` mm, 0: faces coincide. */
static inline void solid_stack(struct stage *s, const size_t *material, const float *thickness, int count, float half, float gap)
{
    float top = 0.0f;

    for (int i = 0; i < count; i++) {
        stage_box(s, material[i], i, vec3(-half, -half, top - thickness[i]), vec3(half, half, top));
        top -= thickness[i] + gap;
    }
}

/* An icosahedron each of whose faces is cut into 4^`cuts`, on the ball, with smooth normals: 20 x 4^cuts triangles. */
static inline void solid_ball(struct stage *s, size_t material, int object, struct pell_vec3 centre, float radius, int cuts)
{
    static const uint32_t faces[20][3] = { { 0, 11, 5 }, { 0, 5, 1 },  { 0, 1, 7 },   { 0, 7, 10 }, { 0, 10, 11 },
                                           { 1, 5, 9 },  { 5, 11, 4 }, { 11, 10, 2 }, { 10, 7, 6 }, { 7, 1, 8 },
                                           { 3, 9, 4 },  { 3, 4, 2 },  { 3, 2, 6 },   { 3, 6, 8 },  { 3, 8, 9 },
                                           { 4, 9, 5 },  { 2, 4, 11 }, { 6, 2, 10 },  { 8, 6, 7 },  { 9, 8, 1 } };
    const double g = 0.5 * (1.0 + sqrt(5.0)),
                 corner[12][3] = { { -1, g, 0 },  { 1, g, 0 },  { -1, -g, 0 }, { 1, -g, 0 }, { 0, -1, g },  { 0, 1, g },
                                   { 0, -1, -g }, { 0, 1, -g }, { g, 0, -1 },  { g, 0, 1 },  { -g, 0, -1 }, { -g, 0, 1 } };
    const int side = 1 << cuts;
    const uint32_t triangles = 20u * (uint32_t) side * (uint32_t) side;
    struct pell_mesh *m = shapes_mesh(s->scene, material, 3 * triangles, triangles);
    uint32_t v = 0;

    m->object = object;
    for (int f = 0; f < 20; f++)
        for (int j = 0; j < side; j++)
            for (int i = 0; i + j < side; i++)
                for (int half = 0; half < (i + j + 1 < side ? 2 : 1); half++)
                    for (int k = 0; k < 3; k++) {
                        /* Weights are integers, summed in the order of the corners: the same bits from both sides of an edge. */
                        const int a = i + (half ? k != 2 : k == 1), b = j + (half ? k != 0 : k == 2);
                        const int weight[3] = { side - a - b, a, b };
                        double p[3] = { 0 }, length;
                        for (uint32_t n = 0; n < 12; n++)
                            for (int q = 0; q < 3; q++)
                                for (int x = 0; faces[f][q] == n && x < 3; x++)
                                    p[x] += weight[q] * corner[n][x];
                        length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
                        m->normal[3 * v] = (float) (p[0] / length);
                        m->normal[3 * v + 1] = (float) (p[1] / length);
                        m->normal[3 * v + 2] = (float) (p[2] / length);
                        vec3_store(vec3_mad(centre, radius, vec3_load(m->normal + 3 * v)), m->position + 3 * v);
                        m->index[v] = v;
                        v++;
                    }
}

/* Two concentric balls; the inner one is `inside`, an opaque material or a medium, and another object. */
static inline void solid_shell(struct stage *s, size_t material, size_t inside, float radius, float inner, int cuts)
{
    solid_ball(s, material, 0, vec3(0, 0, 0), radius, cuts);
    solid_ball(s, inside, 1, vec3(0, 0, 0), inner, cuts);
}

static inline int solid_compare_edges(const void *a, const void *b)
{
    return memcmp(a, b, 6 * sizeof(float));
}

/* Volume in mm^3 by the divergence theorem; fails where an edge, by the bits of its ends, is not traversed once in each direction. */
static inline double solid_volume(const struct pell_mesh *m)
{
    const size_t n = 3 * (size_t) m->num_triangles;
    float(*there)[6] = malloc(n * sizeof(*there)), (*back)[6] = malloc(n * sizeof(*back));
    double six = 0.0;

    for (size_t i = 0; i < n; i++) {
        const float *a = m->position + 3 * (size_t) m->index[i], *b = m->position + 3 * (size_t) m->index[i % 3 == 2 ? i - 2 : i + 1];
        for (int k = 0; k < 3; k++) { /* + 0: a negative zero has other bits */
            there[i][k] = back[i][3 + k] = a[k] + 0.0f;
            there[i][3 + k] = back[i][k] = b[k] + 0.0f;
        }
    }
    for (size_t i = 0; i < n; i += 3) {
        const float *a = there[i], *b = there[i + 1], *c = there[i + 2];
        for (int k = 0; k < 3; k++)
            six += (double) a[k] * ((double) b[(k + 1) % 3] * (double) c[(k + 2) % 3] - (double) b[(k + 2) % 3] * (double) c[(k + 1) % 3]);
    }
    qsort(there, n, sizeof(*there), solid_compare_edges);
    qsort(back, n, sizeof(*back), solid_compare_edges);
    REQUIRE(memcmp(there, back, n * sizeof(*there)) == 0);
    for (size_t i = 1; i < n; i++)
        REQUIRE(memcmp(there[i - 1], there[i], sizeof(*there)) != 0);
    free(there);
    free(back);
    return six / 6.0;
}

#endif
