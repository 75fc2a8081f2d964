/* SPDX-License-Identifier: MIT
 *
 * medium_layers.h - the medium below each point of a translucent surface: the layers of its material, with uniform or texture-mapped
 * depths.
 *
 * Shared by the methods that march or trace paths through a medium: `layered`, `single-scatter`, `path-trace`. A material without layers
 * has a single layer without a bottom.
 */
#ifndef PELL_MEDIUM_LAYERS_H
#define PELL_MEDIUM_LAYERS_H

#include <pellucid/scene.h>

struct pell_layer_medium {
    const char *name;              /* "" : none */
    double sigma_s[3], sigma_t[3]; /* 1/mm; sigma_s is not reduced */
    struct pell_phase phase[3];
    double depth;                       /* mm from the surface to its bottom, increasing with the index for uniform depths; with a map the
                                         * depth at its value 1. The last one may be INFINITY */
    const struct pell_texture_map *map; /* NULL: uniform depth. Borrowed from the material */
    bool inverse;
};

struct pell_medium_layers {
    double eta;
    int count; /* >= 1 */
    struct pell_layer_medium item[PELL_LAYERS_MOST];
    enum pell_substrate substrate;
    bool has_maps;  /* some layer has a map */
    double deepest; /* mm: largest depth of any finite bottom */
};

/* Whether the material has layers or coefficients that pell_medium_layers_make supports. */
bool pell_medium_layers_known(const struct pell_material *m);

/* From the scene's own layers (struct pell_material.layers), else from the built-in stack or medium of the material. Errors:
 * PELL_ERR_UNSUPPORTED, naming the material, if it has only a profile. `method`: the caller's name, for messages. */
PELL_NODISCARD enum pell_result pell_medium_layers_make(struct pell_context *ctx, const char *method, const struct pell_material *m,
                                                        struct pell_medium_layers *out);

/* Depths of all layers' bottoms below a point of a triangle of `mesh`, mm, in ascending order (where layers cross, the upper one has
 * precedence). u, v: barycentric as in struct pell_hit. Without texture coordinates the map's value is 1. Thread-safe. */
void pell_medium_layers_depths(const struct pell_medium_layers *s, const struct pell_mesh *mesh, uint32_t triangle, float u, float v,
                               float *depth);

/* Index of the layer at a distance below the surface, given the depths; -1: below the deepest. */
static inline int pell_medium_layers_at(const struct pell_medium_layers *s, const float *depth, float distance)
{
    for (int i = 0; i < s->count; i++)
        if (distance < depth[i])
            return i;
    return s->substrate == PELL_SUBSTRATE_LAST ? s->count - 1 : -1;
}

#endif
