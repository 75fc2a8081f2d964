/* SPDX-License-Identifier: MIT
 * shapes.h - hand-made scenes, meshes and lights for every test that needs a small scene. */
#ifndef PELL_TEST_SHAPES_H
#define PELL_TEST_SHAPES_H

#include "pell_test.h"

#include "math/vec.h"

#include <pellucid/scene.h>

/* A scene with one translucent material, index 0. */
static inline struct pell_scene *shapes_scene(struct pell_context *ctx)
{
    struct pell_scene *s = NULL;
    size_t index;

    if (pell_scene_create(ctx, &s) != PELL_OK)
        return NULL;
    for (int c = 0; c < 3; c++) {
        s->bounds_min[c] = INFINITY;
        s->bounds_max[c] = -INFINITY;
    }
    if (pell_scene_add_material(s, "translucent", &index) != PELL_OK) {
        pell_scene_destroy(&s);
        return NULL;
    }
    s->materials[0].opaque = false;
    s->materials[0].metallic = 0.0f;
    return s;
}

static inline size_t shapes_material(struct pell_scene *s, bool opaque)
{
    size_t index = 0;

    assert_int_equal(pell_scene_add_material(s, opaque ? "opaque" : "translucent", &index), PELL_OK);
    s->materials[index].opaque = opaque;
    s->materials[index].metallic = 0.0f;
    return index;
}

static inline struct pell_mesh *shapes_mesh(struct pell_scene *s, size_t material, uint32_t vertices, uint32_t triangles)
{
    size_t index = 0;

    assert_int_equal(pell_scene_add_mesh(s, "mesh", &index), PELL_OK);
    assert_int_equal(pell_mesh_allocate(s, index, vertices, triangles), PELL_OK);
    s->meshes[index].material = (int) material;
    return &s->meshes[index];
}

/* Widens the scene's bounds by a mesh. */
static inline void shapes_bound(struct pell_scene *s, const struct pell_mesh *m)
{
    for (uint32_t i = 0; i < m->num_vertices; i++)
        for (int c = 0; c < 3; c++) {
            s->bounds_min[c] = fminf(s->bounds_min[c], m->position[3 * i + (uint32_t) c]);
            s->bounds_max[c] = fmaxf(s->bounds_max[c], m->position[3 * i + (uint32_t) c]);
        }
}

/* A rectangle about `center` that spans +-a and +-b, counter-clockwise seen from a x b; uv (0, 0) at -a + b (upper left, if b is up),
 * tangent a, bitangent b. */
static inline struct pell_mesh *shapes_quad(struct pell_scene *s, size_t material, struct pell_vec3 center, struct pell_vec3 a,
                                            struct pell_vec3 b)
{
    struct pell_mesh *m = shapes_mesh(s, material, 4, 2);
    const struct pell_vec3 n = vec3_normalize(vec3_cross(a, b)), t = vec3_normalize(a);
    static const uint32_t index[6] = { 0, 1, 2, 0, 2, 3 };

    m->uv[0] = pell_calloc(s->ctx, 4, 2 * sizeof(float));
    m->tangent = pell_calloc(s->ctx, 4, 4 * sizeof(float));
    assert_non_null(m->uv[0]);
    assert_non_null(m->tangent);
    for (int i = 0; i < 4; i++) {
        const float sa = i == 1 || i == 2 ? 1.0f : -1.0f, sb = i >= 2 ? 1.0f : -1.0f;
        vec3_store(vec3_mad(vec3_mad(center, sa, a), sb, b), m->position + 3 * i);
        vec3_store(n, m->normal + 3 * i);
        vec3_store(t, m->tangent + 4 * i);
        m->tangent[4 * i + 3] = 1.0f;
        m->uv[0][2 * i] = 0.5f + 0.5f * sa;
        m->uv[0][2 * i + 1] = 0.5f - 0.5f * sb;
    }
    memcpy(m->index, index, sizeof(index));
    shapes_bound(s, m);
    return m;
}

/* A box between two corners, faces outward. */
static inline struct pell_mesh *shapes_box(struct pell_scene *s, size_t material, struct pell_vec3 lo, struct pell_vec3 hi)
{
    static const int axes[6][3] = { { 0, 1, 2 }, { 0, 2, 1 }, { 1, 2, 0 }, { 1, 0, 2 }, { 2, 0, 1 }, { 2, 1, 0 } };
    struct pell_mesh *mesh = shapes_mesh(s, material, 24, 12);
    const float c[2][3] = { { lo.x, lo.y, lo.z }, { hi.x, hi.y, hi.z } };

    for (int f = 0; f < 6; f++) {
        const int n = axes[f][0], u = axes[f][1], v = axes[f][2], side = f % 2 == 0; /* u x v = +n on even faces */
        for (int k = 0; k < 4; k++) {
            float *p = &mesh->position[3 * (4 * f + k)], *q = &mesh->normal[3 * (4 * f + k)];
            p[n] = c[side][n];
            p[u] = c[k == 1 || k == 2][u];
            p[v] = c[k >= 2][v];
            q[n] = side ? 1.0f : -1.0f;
        }
        for (int k = 0; k < 6; k++)
            mesh->index[6 * f + k] = (uint32_t) (4 * f + ((const int[]) { 0, 1, 2, 0, 2, 3 })[k]);
    }
    shapes_bound(s, mesh);
    return mesh;
}

/* A closed ball of 2 `rings` x `rings` cells with smooth normals. The seam and the poles share their vertices: it is watertight. */
static inline struct pell_mesh *shapes_ball(struct pell_scene *s, size_t material, struct pell_vec3 center, float radius, int rings)
{
    const int sectors = 2 * rings;
    struct pell_mesh *m = shapes_mesh(s, material, (uint32_t) ((rings - 1) * sectors + 2), (uint32_t) (2 * (rings - 1) * sectors));
    const uint32_t bottom = (uint32_t) ((rings - 1) * sectors + 1);
    uint32_t *out = m->index;

    for (uint32_t k = 0; k <= bottom; k++) {
        const int j = k == 0 ? 0 : k == bottom ? rings : 1 + (int) (k - 1) / sectors, i = (int) (k - 1) % sectors;
        const double theta = PELL_PI * j / rings, phi = 2.0 * PELL_PI * i / sectors;
        const struct pell_vec3 n = vec3((float) (sin(theta) * cos(phi)), (float) cos(theta), (float) (-sin(theta) * sin(phi)));
        vec3_store(n, m->normal + 3 * k);
        vec3_store(vec3_mad(center, radius, n), m->position + 3 * k);
    }
    for (int j = 0; j < rings; j++)
        for (int i = 0; i < sectors; i++) {
            const int next = (i + 1) % sectors;
            const uint32_t a = j == 0 ? 0 : (uint32_t) (1 + (j - 1) * sectors + i);
            const uint32_t b = j == 0 ? 0 : (uint32_t) (1 + (j - 1) * sectors + next);
            const uint32_t c = j == rings - 1 ? bottom : (uint32_t) (1 + j * sectors + i);
            const uint32_t d = j == rings - 1 ? bottom : (uint32_t) (1 + j * sectors + next);
            if (j < rings - 1) {
                *out++ = a;
                *out++ = c;
                *out++ = d;
            }
            if (j > 0) {
                *out++ = a;
                *out++ = d;
                *out++ = b;
            }
        }
    shapes_bound(s, m);
    return m;
}

/* A light at one point that faces another; the caller sets power and the members specific to its type. */
static inline struct pell_light *shapes_light(struct pell_scene *s, enum pell_light_type type, struct pell_vec3 at, struct pell_vec3 to)
{
    const struct pell_vec3 d = vec3_normalize(vec3_sub(to, at));
    struct pell_vec3 t, b;
    struct pell_light *l;
    size_t i;

    assert_int_equal(pell_scene_add_light(s, "light", &i), PELL_OK);
    l = &s->lights[i];
    l->type = type;
    vec3_basis(d, &t, &b);
    vec3_store(at, l->position);
    vec3_store(d, l->direction);
    vec3_store(b, l->up);
    l->cos_inner = 0.95f;
    l->cos_outer = 0.8f;
    return l;
}

/* An 8 bit texture; `pixels` are copied. */
static inline struct pell_texture *shapes_texture(struct pell_scene *s, int width, int height, int channels, bool srgb,
                                                  const uint8_t *pixels)
{
    struct pell_texture *t = NULL;
    const size_t size = (size_t) width * (size_t) height * (size_t) channels;

    assert_int_equal(pell_scene_add_texture(s, "texture", &t), PELL_OK);
    t->image = (struct pell_image) { width, height, channels, PELL_PIXEL_U8, srgb, pell_alloc(s->ctx, size) };
    assert_non_null(t->image.pixels);
    memcpy(t->image.pixels, pixels, size);
    return t;
}

/* Pseudo-random numbers in [0, 1). */
static inline float shapes_random(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float) (*state >> 8) * (1.0f / 16777216.0f);
}

#endif
