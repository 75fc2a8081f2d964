/* SPDX-License-Identifier: MIT
 * layers_rig.h - for tests of layered media: the three layers of Francois et al. 2006, table 1, uniform or painted. */
#ifndef RENDER_LAYERS_RIG_H
#define RENDER_LAYERS_RIG_H

#include "pell_test.h"

#include "base/base.h"

#include <pellucid/scene.h>

#define LAYERS_WIDE 800.0f /* mm that texture coordinates from 0 to 1 cover */

/* sigma_s, sigma_t (the same in all channels) and Schlick's k; depths in mm. */
static inline void layers_set(struct pell_scene *scene, size_t material, int count, const double (*optics)[3], const float *depth,
                              enum pell_substrate substrate)
{
    struct pell_material *m = &scene->materials[material];

    assert_int_equal(pell_material_allocate_layers(scene, material, count), PELL_OK);
    m->opaque = false;
    m->substrate = substrate;
    for (int i = 0; i < count; i++) {
        struct pell_scene_layer *l = &m->layers[i];
        l->depth = depth[i];
        for (int c = 0; c < 3; c++) {
            l->phase[c] = (struct pell_phase) { PELL_PHASE_SCHLICK, { optics[i][2], 0.0 }, 0.0 };
            l->medium.g[c] = pell_phase_mean_cosine(&l->phase[c]);
            l->medium.sigma_s_reduced[c] = optics[i][0] * (1.0 - l->medium.g[c]);
            l->medium.sigma_a[c] = optics[i][1] - optics[i][0];
        }
    }
}

/* Paints a layer's depth by the first of `channels` floats per texel: fractions of its `depth`. */
static inline struct pell_texture *layers_paint(struct pell_scene *scene, size_t material, int layer, int width, int height, int channels,
                                                const float *fraction)
{
    const size_t size = (size_t) width * (size_t) height * (size_t) channels * sizeof(float);
    struct pell_texture *t;

    assert_int_equal(pell_scene_add_texture(scene, "map", &t), PELL_OK);
    t->image = (struct pell_image) { .width = width, .height = height, .channels = channels, .type = PELL_PIXEL_F32 };
    t->image.pixels = pell_alloc(scene->ctx, size);
    assert_non_null(t->image.pixels);
    memcpy(t->image.pixels, fraction, size);
    scene->materials[material].layers[layer].depth_map.texture = t;
    return t;
}

/* Texture coordinates of every mesh by x and y: (0.5, 0.5) at the origin. */
static inline void layers_unwrap(struct pell_scene *scene)
{
    for (size_t k = 0; k < scene->num_meshes; k++) {
        struct pell_mesh *m = &scene->meshes[k];
        m->uv[0] = pell_alloc_array(scene->ctx, m->num_vertices, 2 * sizeof(float));
        assert_non_null(m->uv[0]);
        for (size_t i = 0; i < m->num_vertices; i++)
            for (size_t c = 0; c < 2; c++)
                m->uv[0][2 * i + c] = 0.5f + m->position[3 * i + c] / LAYERS_WIDE;
    }
}

#endif
