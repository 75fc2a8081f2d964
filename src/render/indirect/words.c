/* SPDX-License-Identifier: MIT
 * words.c - packs indirect light, or the light inside solids, for a device. */
#include "render/indirect/internal.h"

#include <string.h>

size_t pell_indirect_words(const struct pell_indirect *in, uint32_t *out)
{
    const size_t meshes = in->p.scene->num_meshes, words_per_value = in->inside ? sizeof(*in->inside) / sizeof(*out) : 6,
                 roots = PELL_INDIRECT_HEAD + 3 * meshes;
    const size_t cells = roots + in->num_roots, values = cells + 4 * in->num_cells;

    if (!out)
        return values + words_per_value * in->num_values;
    out[0] = (uint32_t) roots;
    out[1] = (uint32_t) cells;
    out[2] = (uint32_t) values;
    out[3] = (uint32_t) in->num_mesh_knots;
    out[4] = (uint32_t) in->num_knots;
    for (size_t i = 0; i < meshes; i++)
        memcpy(out + PELL_INDIRECT_HEAD + 3 * i, &in->meshes[i], 3 * sizeof(*out));
    memcpy(out + roots, in->roots, in->num_roots * sizeof(*out));
    memcpy(out + cells, in->cells, 4 * in->num_cells * sizeof(*out));
    if (in->inside) {
        memcpy(out + values, in->inside, words_per_value * in->num_values * sizeof(*out));
        return values + words_per_value * in->num_values;
    }
    for (size_t i = 0; i < in->num_values; i++) {
        memcpy(out + values + 6 * i, in->value[i], 3 * sizeof(*out));
        if (in->behind)
            memcpy(out + values + 6 * i + 3, in->behind[i], 3 * sizeof(*out));
        else
            memset(out + values + 6 * i + 3, 0, 3 * sizeof(*out));
    }
    return values + words_per_value * in->num_values;
}
