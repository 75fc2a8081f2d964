/* SPDX-License-Identifier: MIT
 * connect_rig.h - a scene with one solid and its connector, for the tests and the benchmark of refractive connections. */
#ifndef PELL_CONNECT_RIG_H
#define PELL_CONNECT_RIG_H

#include "random.h"
#include "shapes.h"

#include "transport/refraction/connect.h"

#define OK(expr) assert_int_equal(expr, PELL_OK)

/* One solid, id 0, of material 0; everything else in the scene is opaque. */
struct rig {
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_solids *solids;
    struct pell_connector *connector;
};

static inline void rig_start(struct rig *r)
{
    memset(r, 0, sizeof(*r));
    r->ctx = test_context(NULL, NULL);
    r->scene = shapes_scene(r->ctx);
    assert_non_null(r->scene);
    OK(pell_pool_create(r->ctx, 1, &r->pool));
}

static inline void rig_build(struct rig *r, bool flat)
{
    static const uint16_t index[8] = { 0, 1 };
    const struct pell_frame_material material = { .medium = { .eta = 1.3 }, .name = "test" };

    if (!r->rays)
        OK(pell_rays_create(r->ctx, r->scene, r->pool, &r->rays));
    if (!r->solids)
        OK(pell_solids_create(r->ctx, r->scene, index, &material, &r->solids));
    pell_connector_destroy(&r->connector);
    OK(pell_connector_create(r->ctx, r->scene, r->rays, r->solids, flat, &r->connector));
}

static inline void rig_finish(struct rig *r)
{
    pell_connector_destroy(&r->connector);
    pell_solids_destroy(&r->solids);
    pell_rays_destroy(&r->rays);
    pell_pool_destroy(&r->pool);
    pell_scene_destroy(&r->scene);
    pell_context_destroy(&r->ctx);
}

/* A ball with waves on its surface, and vertex normals averaged over adjacent triangles: it has caustics inside. */
static inline void bumpy(struct rig *r, float radius, float height, int rings)
{
    struct pell_mesh *m = shapes_ball(r->scene, 0, vec3(0, 0, 0), radius, rings);

    for (uint32_t i = 0; i < m->num_vertices; i++) {
        const struct pell_vec3 n = vec3_load(m->normal + 3 * i);
        vec3_store(vec3_mul(n, radius + height * sinf(5.0f * n.x + 1.0f) * cosf(6.0f * n.y) * sinf(4.0f * n.z + 2.0f)),
                   m->position + 3 * i);
    }
    memset(m->normal, 0, 3 * sizeof(float) * m->num_vertices);
    for (uint32_t t = 0; t < m->num_triangles; t++) {
        const uint32_t *i = m->index + 3 * t;
        const struct pell_vec3 a = vec3_load(m->position + 3 * i[0]);
        const struct pell_vec3 n =
            vec3_cross(vec3_sub(vec3_load(m->position + 3 * i[1]), a), vec3_sub(vec3_load(m->position + 3 * i[2]), a));
        for (int k = 0; k < 3; k++)
            vec3_store(vec3_add(vec3_load(m->normal + 3 * i[k]), n), m->normal + 3 * i[k]);
    }
    for (uint32_t i = 0; i < m->num_vertices; i++)
        vec3_store(vec3_normalize(vec3_load(m->normal + 3 * i)), m->normal + 3 * i);
}

static inline double unit(uint64_t *state)
{
    return (double) (random_bits(state) >> 11) * 0x1p-53;
}

static inline struct pell_vec3 in_ball(uint64_t *state)
{
    for (;;) {
        const struct pell_vec3 p =
            vec3((float) (2.0 * unit(state) - 1.0), (float) (2.0 * unit(state) - 1.0), (float) (2.0 * unit(state) - 1.0));
        if (vec3_dot(p, p) <= 1.0f)
            return p;
    }
}

#endif
