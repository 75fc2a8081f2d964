/* SPDX-License-Identifier: MIT
 *
 * medium_layers.h - what lies below each point of a translucent surface: the layers of its material, painted or even.
 *
 * The one home of "layers by distance below the surface" for methods that march or walk through a medium: `layered`, `single-scatter`,
 * `path-trace`. A material without layers has one, without a bottom.
 */
#ifndef PELL_STRATA_H
#define PELL_STRATA_H

#include <pellucid/scene.h>

struct pell_stratum {
    const char *name;                   /* "" : none */
    double sigma_s[3], sigma_t[3];      /* 1/mm; sigma_s is not reduced */
    struct pell_phase phase[3];
    double depth;                       /* mm from the surface to its bottom, which rises where none is painted; where a map is, its 1.
                                         * The last's may be INFINITY */
    const struct pell_texture_map *map; /* NULL: even, or of one value all over. Borrowed from the material */
    bool inverse;
};

struct pell_strata {
    double eta;
    int count; /* >= 1 */
    struct pell_stratum item[PELL_LAYERS_MOST];
    enum pell_below below;
    bool painted;   /* some layer has a map */
    double deepest; /* mm: no bottom lies deeper anywhere, but INFINITY */
};

/* Of the scene's own layers (struct pell_material.layers), else of the built-in stack or medium that the material is made of. Errors:
 * PELL_ERR_UNSUPPORTED, naming the material, where it has a profile but no medium. `method`: who asks, for messages. */
PELL_NODISCARD enum pell_result pell_strata_make(struct pell_context *ctx, const char *method, const struct pell_material *m,
                                                 struct pell_strata *out);

/* Depths of all layers' bottoms below a point of a triangle of `mesh`, mm, each at least the one before it (layers that cross are pushed
 * down: the upper one wins). u, v: barycentric as in struct pell_hit. A mesh without the map's texture coordinates is white all over.
 * Safe from many threads. */
void pell_strata_depths(const struct pell_strata *s, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float *depth);

/* The layer at a distance below the surface, by depths as above; -1: below the deepest. */
static inline int pell_strata_at(const struct pell_strata *s, const float *depth, float distance)
{
    for (int i = 0; i < s->count; i++)
        if (distance < depth[i])
            return i;
    return s->below == PELL_BELOW_LAST ? s->count - 1 : -1;
}

#endif
