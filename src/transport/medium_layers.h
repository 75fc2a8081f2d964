/* SPDX-License-Identifier: MIT
 *
 * medium_layers.h - what lies below each point of a translucent surface: the layers of its material, painted or even.
 *
 * The one home of "layers by distance below the surface" for methods that march or walk through a medium: `layered`, `single-scatter`,
 * `path-trace`. A material without layers has one, without a bottom.
 */
#ifndef PELL_MEDIUM_LAYERS_H
#define PELL_MEDIUM_LAYERS_H

#include <pellucid/scene.h>

struct pell_layer_medium {
    const char *name;              /* "" : none */
    double sigma_s[3], sigma_t[3]; /* 1/mm; sigma_s is not reduced */
    struct pell_phase phase[3];
    double depth;                       /* mm from the surface to its bottom, which rises where none is painted; where a map is, its 1.
                                         * The last's may be INFINITY */
    const struct pell_texture_map *map; /* NULL: even, or of one value all over. Borrowed from the material */
    bool inverse;
};

struct pell_medium_layers {
    double eta;
    int count; /* >= 1 */
    struct pell_layer_medium item[PELL_LAYERS_MOST];
    enum pell_substrate substrate;
    bool painted;   /* some layer has a map */
    double deepest; /* mm: no bottom lies deeper anywhere, but INFINITY */
};

/* Whether the material has layers or coefficients that pell_medium_layers_make takes. */
bool pell_medium_layers_known(const struct pell_material *m);

/* Of the scene's own layers (struct pell_material.layers), else of the built-in stack or medium that the material is made of. Errors:
 * PELL_ERR_UNSUPPORTED, naming the material, where it has a profile but no medium. `method`: who asks, for messages. */
PELL_NODISCARD enum pell_result pell_medium_layers_make(struct pell_context *ctx, const char *method, const struct pell_material *m,
                                                        struct pell_medium_layers *out);

/* Depths of all layers' bottoms below a point of a triangle of `mesh`, mm, each at least the one before it (layers that cross are pushed
 * down: the upper one wins). u, v: barycentric as in struct pell_hit. A mesh without the map's texture coordinates is white all over.
 * Safe from many threads. */
void pell_medium_layers_depths(const struct pell_medium_layers *s, const struct pell_mesh *mesh, uint32_t triangle, float u, float v,
                               float *depth);

/* The layer at a distance below the surface, by depths as above; -1: below the deepest. */
static inline int pell_medium_layers_at(const struct pell_medium_layers *s, const float *depth, float distance)
{
    for (int i = 0; i < s->count; i++)
        if (distance < depth[i])
            return i;
    return s->substrate == PELL_SUBSTRATE_LAST ? s->count - 1 : -1;
}

#endif
