/* SPDX-License-Identifier: MIT
 * lights_rig.h - for tests of the irradiance stage: scenes built by hand, rendered through rays, surface and lights. */
#ifndef LIGHTS_RIG_H
#define LIGHTS_RIG_H

#include "shapes.h"
#include "slow.h"

#include "render/irradiance/stage.h"
#include "render/plane_buffers.h"

struct rig {
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct pell_settings settings;
    struct pell_thickness_table table;
    const struct pell_thickness_table *thickness[8]; /* per material, set by render */
    bool smooth;
    bool solid; /* no transmission through thin parts */
    bool ideal; /* after the surface stage: geometric normals are the shading normals, and nothing casts shadows */
    int threads;
    uint32_t seed, sample;
    uint64_t asked; /* bit mask of the active lights; 0: all */
    int width, height;
    /* after render */
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_surface surface;
    struct pell_specular_tables *tables;
    struct pell_lights *lights;
    struct pell_lighting light;
    struct pell_view view;
    const struct pell_unscattered *unscattered; /* of the test: media that pass light into their shadows */
};

#define OK(expr) assert_int_equal(expr, PELL_OK)

static inline void rig_start(struct rig *r, int width, int height)
{
    memset(r, 0, sizeof(*r));
    r->ctx = test_context(NULL, NULL);
    r->width = width;
    r->height = height;
    r->threads = 2;
    pell_knobs_default(pell_settings_knobs(), &r->settings);
    r->settings.msaa = 1;
    OK(pell_scene_create(r->ctx, &r->scene));
    /* a profile of one Gaussian per channel: T(d) = w exp(-d^2 / 2v) */
    r->table.max_mm = 20.0f;
    for (int i = 0; i < PELL_THICKNESS_STEPS; i++) {
        const double x = (double) i / (PELL_THICKNESS_STEPS - 1), d = 20.0 * x * x;
        const double w[3] = { 0.8, 0.6, 0.4 }, v[3] = { 9.0, 4.0, 1.0 };
        for (int c = 0; c < 3; c++)
            r->table.value[i][c] = r->table.slab[i][c] = i == PELL_THICKNESS_STEPS - 1 ? 0.0f : (float) (w[c] * exp(-d * d / (2.0 * v[c])));
    }
}

static inline double table_transmittance(double d, int c)
{
    static const double w[3] = { 0.8, 0.6, 0.4 }, v[3] = { 9.0, 4.0, 1.0 };
    return w[c] * exp(-d * d / (2.0 * v[c]));
}

/* rho_s = 0, white: all arriving light enters. */
static inline size_t rig_material(struct rig *r, bool opaque)
{
    size_t m;
    OK(pell_scene_add_material(r->scene, opaque ? "opaque" : "translucent", &m));
    r->scene->materials[m].opaque = opaque;
    r->scene->materials[m].rho_s = 0.0f;
    r->scene->materials[m].metallic = 0.0f;
    r->scene->materials[m].roughness = 0.5f;
    for (int c = 0; c < 3; c++)
        r->scene->materials[m].base_color[c] = 1.0f;
    return m;
}

static inline size_t rig_mesh(struct rig *r, size_t material, int object, uint32_t vertices, uint32_t triangles)
{
    shapes_mesh(r->scene, material, vertices, triangles)->object = object;
    return r->scene->num_meshes - 1;
}

static inline size_t rig_box(struct rig *r, size_t material, int object, struct pell_vec3 lo, struct pell_vec3 hi)
{
    shapes_box(r->scene, material, lo, hi)->object = object;
    return r->scene->num_meshes - 1;
}

/* One square in the plane z = `z`, facing +z. */
static inline size_t rig_plane(struct rig *r, size_t material, int object, float z, float half)
{
    const size_t m = rig_mesh(r, material, object, 4, 2);
    struct pell_mesh *mesh = &r->scene->meshes[m];
    static const float corner[4][2] = { { -1, -1 }, { 1, -1 }, { 1, 1 }, { -1, 1 } };
    for (int k = 0; k < 4; k++) {
        mesh->position[3 * k] = half * corner[k][0];
        mesh->position[3 * k + 1] = half * corner[k][1];
        mesh->position[3 * k + 2] = z;
        mesh->normal[3 * k + 2] = 1.0f;
    }
    memcpy(mesh->index, (const uint32_t[]) { 0, 1, 2, 0, 2, 3 }, 6 * sizeof(uint32_t));
    return m;
}

/* A closed sphere about a point; inward: with inverted normals. */
static inline size_t rig_sphere(struct rig *r, size_t material, int object, struct pell_vec3 centre, float radius, int rings)
{
    const int columns = 2 * rings;
    const size_t m = rig_mesh(r, material, object, (uint32_t) ((rings + 1) * (columns + 1)), (uint32_t) (2 * rings * columns));
    struct pell_mesh *mesh = &r->scene->meshes[m];
    uint32_t *index = mesh->index;
    for (int i = 0; i <= rings; i++)
        for (int j = 0; j <= columns; j++) {
            const double t = PELL_PI * i / rings, p = 2.0 * PELL_PI * (j % columns) / columns;
            const struct pell_vec3 n =
                vec3(i % rings ? (float) (sin(t) * sin(p)) : 0.0f, (float) cos(t), i % rings ? (float) (sin(t) * cos(p)) : 0.0f);
            const int v = i * (columns + 1) + j;
            vec3_store(vec3_mad(centre, radius, n), &mesh->position[3 * v]);
            vec3_store(n, &mesh->normal[3 * v]);
        }
    for (int i = 0; i < rings; i++)
        for (int j = 0; j < columns; j++) {
            const uint32_t a = (uint32_t) (i * (columns + 1) + j), b = a + (uint32_t) columns + 1;
            memcpy(index, (const uint32_t[]) { a, b, b + 1, a, b + 1, a + 1 }, 6 * sizeof(*index));
            index += 6;
        }
    return m;
}

static inline struct pell_light *rig_light(struct rig *r, enum pell_light_type type, struct pell_vec3 at, struct pell_vec3 to, float power)
{
    struct pell_light *l = shapes_light(r->scene, type, at, to);
    l->power[0] = power;
    l->power[1] = 0.5f * power;
    l->power[2] = 0.25f * power;
    return l;
}

/* Looks along -z, `height` mm tall, y up. */
static inline void rig_camera(struct rig *r, float height)
{
    size_t i;
    OK(pell_scene_add_camera(r->scene, "camera", &i));
    r->scene->cameras[i].position[2] = 500.0f;
    r->scene->cameras[i].forward[2] = -1.0f;
    r->scene->cameras[i].up[1] = 1.0f;
    r->scene->cameras[i].ortho_height = height;
}

static inline void rig_clear(struct rig *r)
{
    if (r->pool) {
        pell_free(r->ctx, r->light.irradiance[0]);
        pell_surface_finish(r->ctx, &r->surface);
        pell_lights_destroy(&r->lights);
        pell_specular_tables_destroy(&r->tables);
        pell_rays_destroy(&r->rays);
        pell_pool_destroy(&r->pool);
    }
}

static inline void rig_finish(struct rig *r)
{
    rig_clear(r);
    pell_scene_destroy(&r->scene);
    pell_context_destroy(&r->ctx);
}

/* Normals are made by hand here, so only bounds have to be completed. */
static inline void rig_bounds(struct pell_scene *scene)
{
    for (int c = 0; c < 3; c++) {
        scene->bounds_min[c] = INFINITY;
        scene->bounds_max[c] = -INFINITY;
    }
    scene->ground_mesh = -1;
    for (size_t i = 0; i < scene->num_meshes; i++)
        for (uint32_t v = 0; v < 3 * scene->meshes[i].num_vertices; v++) {
            scene->bounds_min[v % 3] = fminf(scene->bounds_min[v % 3], scene->meshes[i].position[v]);
            scene->bounds_max[v % 3] = fmaxf(scene->bounds_max[v % 3], scene->meshes[i].position[v]);
        }
}

static inline void rig_move(struct pell_scene *scene, float x)
{
    for (size_t i = 0; i < scene->num_meshes; i++)
        for (uint32_t v = 0; v < scene->meshes[i].num_vertices; v++)
            scene->meshes[i].position[3 * v] += x;
}

/* Of the rendered pixels. */
static inline struct pell_irradiance_params rig_params(const struct rig *r)
{
    return (struct pell_irradiance_params) {
        .rays = r->rays,
        .scene = r->scene,
        .view = &r->view,
        .surface = &r->surface,
        .tables = r->tables,
        .thickness = r->thickness,
        .unscattered = r->unscattered,
        .mix = -1.0f,
        .smooth = r->smooth,
        .shared = true,
        .lights = r->asked,
        .sample = r->sample,
        .seed = r->seed,
    };
}

/* The same scene may be changed and rendered again. */
static inline void rig_render(struct rig *r)
{
    struct pell_lighting *l = &r->light;
    float **planes[] = { &l->irradiance[0],  &l->irradiance[1], &l->irradiance[2], &l->transmitted[0], &l->transmitted[1],
                         &l->transmitted[2], &l->specular[0],   &l->specular[1],   &l->specular[2],    &l->hidden[0],
                         &l->hidden[1],      &l->hidden[2],     &l->lost[0],       &l->lost[1],        &l->lost[2] };
    struct pell_irradiance_params p;

    rig_clear(r);
    rig_bounds(r->scene);
    OK(pell_pool_create(r->ctx, r->threads, &r->pool));
    OK(pell_rays_create(r->ctx, r->scene, r->pool, &r->rays));
    OK(pell_specular_tables_create(r->ctx, r->scene, 0, &r->tables));
    OK(pell_lights_create(r->ctx, r->scene, &r->settings, r->pool, &r->lights));
    OK(pell_surface_allocate(r->ctx, r->width, r->height, &r->surface));
    OK(pell_planes_allocate(r->ctx, r->width, r->height, planes, PELL_COUNT(planes)));
    r->view = pell_view_make(&r->scene->cameras[0], r->width, r->height, 0.0f, 0.0f);
    OK(pell_surface_render(r->pool, r->rays, r->scene, &r->view, &r->surface));
    if (r->ideal) {
        for (size_t i = 0; i < (size_t) r->surface.stride * (size_t) r->height; i++)
            for (int c = 0; c < 3; c++)
                r->surface.ng[c][i] = r->surface.ns[c][i];
        rig_move(r->scene, 1e6f);
        pell_rays_destroy(&r->rays);
        OK(pell_rays_create(r->ctx, r->scene, r->pool, &r->rays));
        rig_move(r->scene, -1e6f);
    }
    for (size_t i = 0; i < r->scene->num_materials && i < PELL_COUNT(r->thickness); i++)
        r->thickness[i] = r->solid || r->scene->materials[i].opaque ? NULL : &r->table;
    p = rig_params(r);
    OK(pell_irradiance_render(r->pool, r->lights, &p, &r->light));
}

static inline size_t rig_at(const struct rig *r, int x, int y)
{
    return (size_t) y * (size_t) r->surface.stride + (size_t) x;
}

static inline struct pell_vec3 rig_point(const struct rig *r, int x, int y)
{
    struct pell_vec3 start, direction;
    pell_view_ray(&r->view, (float) x, (float) y, &start, &direction);
    return vec3_mad(start, r->surface.depth[rig_at(r, x, y)], direction);
}

static inline struct pell_vec3 rig_normal(const struct rig *r, int x, int y)
{
    const size_t i = rig_at(r, x, y);
    return vec3(r->surface.ns[0][i], r->surface.ns[1][i], r->surface.ns[2][i]);
}

/* E of a polygon of radiance 1 at p with normal n (Lambert 1760): half the sum of edge angles times the cosine of each edge's plane. The
 * whole polygon must be above the horizon. */
static inline double polygon_irradiance(struct pell_vec3 p, struct pell_vec3 n, const struct pell_vec3 *corner, int count)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++) {
        const struct pell_vec3 a = vec3_sub(corner[i], p), b = vec3_sub(corner[(i + 1) % count], p);
        const struct pell_vec3 c = vec3_cross(a, b);
        const double length = sqrt((double) vec3_dot(c, c));
        sum += atan2(length, vec3_dot(a, b)) * vec3_dot(c, n) / length;
    }
    return fabs(0.5 * sum);
}

#endif
