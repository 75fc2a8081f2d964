/* SPDX-License-Identifier: MIT
 * hash.c - a 64-bit hash of a scene's content, for metadata: names and paths of files don't count. */
#include "base/hash.h"
#include "scene/import.h"

static void add_bytes(uint64_t *hash, const void *data, size_t size)
{
    *hash = pell_hash_bytes(*hash, data, size);
}

/* By value, so that the padding of structs never counts. */
static void add_int(uint64_t *hash, int64_t value)
{
    *hash = pell_hash_word(*hash, (uint64_t) value);
}

static void add_float(uint64_t *hash, double value)
{
    *hash = pell_hash_number(*hash, value);
}

static void add_floats(uint64_t *hash, const float *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        add_float(hash, (double) values[i]);
}

static void add_texture(uint64_t *hash, const struct pell_texture *t)
{
    static const size_t sizes[] = { 1, 2, 4 };

    add_int(hash, t != NULL);
    if (!t)
        return;
    add_int(hash, t->image.width);
    add_int(hash, t->image.height);
    add_int(hash, t->image.channels);
    add_int(hash, t->image.type);
    add_int(hash, t->image.srgb);
    add_int(hash, t->wrap_u);
    add_int(hash, t->wrap_v);
    add_int(hash, t->nearest);
    add_bytes(hash, t->image.pixels,
              (size_t) t->image.width * (size_t) t->image.height * (size_t) t->image.channels * sizes[t->image.type]);
}

static void add_map(uint64_t *hash, const struct pell_texture_map *m)
{
    add_texture(hash, m->texture);
    if (!m->texture)
        return;
    add_int(hash, m->uv);
    add_int(hash, m->channel);
    add_floats(hash, m->matrix, 6);
}

static void add_layer(uint64_t *hash, const struct pell_scene_layer *l)
{
    add_bytes(hash, l->medium.sigma_a, sizeof(l->medium.sigma_a));
    add_bytes(hash, l->medium.sigma_s_reduced, sizeof(l->medium.sigma_s_reduced));
    add_bytes(hash, l->medium.g, sizeof(l->medium.g));
    for (int c = 0; c < 3; c++) {
        add_int(hash, l->phase[c].kind);
        add_float(hash, l->phase[c].g[0]);
        add_float(hash, l->phase[c].g[1]);
        add_float(hash, l->phase[c].weight);
    }
    add_float(hash, (double) l->depth);
    add_int(hash, l->depth_inverse);
    add_map(hash, &l->depth_map);
}

static void add_material(uint64_t *hash, const struct pell_material *m)
{
    const float numbers[] = { m->mix,   m->strength,     m->metallic,     m->roughness,
                              m->rho_s, m->normal_scale, m->alpha_cutoff, m->diffuse_transmission };
    const int flags[] = { m->opaque,       (int) m->color_from, (int) m->specular, m->alpha_mask,
                          m->double_sided, m->gaussians.count,  (int) m->model };

    add_bytes(hash, m->medium.sigma_a, sizeof(m->medium.sigma_a));
    add_bytes(hash, m->medium.sigma_s_reduced, sizeof(m->medium.sigma_s_reduced));
    add_bytes(hash, m->medium.g, sizeof(m->medium.g));
    add_float(hash, m->medium.eta);
    for (int i = 0; i < m->gaussians.count; i++) {
        add_float(hash, m->gaussians.variance[i]);
        add_bytes(hash, m->gaussians.weight[i], sizeof(m->gaussians.weight[i]));
    }
    for (int c = 0; m->profile && c < 3; c++) {
        const size_t size = (size_t) m->profile[c].count * sizeof(double);
        add_bytes(hash, m->profile[c].r, size);
        add_bytes(hash, m->profile[c].value, size);
    }
    for (size_t i = 0; i < PELL_COUNT(flags); i++)
        add_int(hash, flags[i]);
    add_floats(hash, numbers, PELL_COUNT(numbers));
    add_floats(hash, m->base_color, 4);
    add_floats(hash, m->specular_color, 3);
    add_floats(hash, m->emissive, 3);
    add_floats(hash, m->diffuse_transmission_color, 3);
    for (enum pell_map i = 0; i < PELL_MAPS; i++)
        add_map(hash, pell_material_map(m, i));
    for (int i = 0; i < m->num_layers; i++)
        add_layer(hash, &m->layers[i]);
    if (m->num_layers > 0)
        add_int(hash, m->substrate);
}

static void add_mesh(uint64_t *hash, const struct pell_mesh *m)
{
    const size_t vertices = m->num_vertices;

    add_int(hash, m->object);
    add_int(hash, m->material);
    add_bytes(hash, m->position, 3 * vertices * sizeof(*m->position));
    add_bytes(hash, m->normal, 3 * vertices * sizeof(*m->normal));
    add_bytes(hash, m->index, 3 * (size_t) m->num_triangles * sizeof(*m->index));
    add_bytes(hash, m->tangent, m->tangent ? 4 * vertices * sizeof(*m->tangent) : 0);
    add_bytes(hash, m->color, m->color ? 4 * vertices * sizeof(*m->color) : 0);
    for (int i = 0; i < PELL_UV_SETS; i++)
        add_bytes(hash, m->uv[i], m->uv[i] ? 2 * vertices * sizeof(*m->uv[i]) : 0);
}

static void add_light(uint64_t *hash, const struct pell_light *l)
{
    const float numbers[] = { l->cos_inner, l->cos_outer, l->width, l->height, l->radius, l->range, l->image_fov, l->rotate };

    add_int(hash, l->type);
    add_floats(hash, l->position, 3);
    add_floats(hash, l->direction, 3);
    add_floats(hash, l->up, 3);
    add_floats(hash, l->power, 3);
    add_floats(hash, numbers, PELL_COUNT(numbers));
    add_texture(hash, l->image);
}

uint64_t pell_scene_hash_materials(const struct pell_scene *scene)
{
    uint64_t hash = 1;
    for (size_t i = 0; i < scene->num_materials; i++)
        add_material(&hash, &scene->materials[i]);
    return hash;
}

uint64_t pell_scene_hash(const struct pell_scene *scene)
{
    const struct pell_camera *c = scene->cameras;
    uint64_t hash = pell_scene_hash_materials(scene);

    for (size_t i = 0; i < scene->num_meshes; i++)
        add_mesh(&hash, &scene->meshes[i]);
    for (size_t i = 0; i < scene->num_lights; i++)
        add_light(&hash, &scene->lights[i]);
    add_int(&hash, scene->background);
    add_floats(&hash, scene->background_color, 3);
    if (scene->contact_shadow)
        add_int(&hash, 1);
    add_texture(&hash, scene->background_image);
    if (scene->num_cameras > 0) {
        add_floats(&hash, c->position, 3);
        add_floats(&hash, c->forward, 3);
        add_floats(&hash, c->up, 3);
        add_float(&hash, (double) c->fov);
        add_float(&hash, (double) c->ortho_height);
        add_float(&hash, (double) c->focus);
        add_float(&hash, (double) c->f_number);
    }
    return hash;
}
