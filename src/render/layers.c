/* SPDX-License-Identifier: MIT
 * layers.c - the rows. Their order is that of an image's channels. */
#include "render/layers.h"

#define AT(member) offsetof(struct pell_accumulator, member)

const struct pell_output_layer pell_output_layers[PELL_OUTPUT_LAYERS] = {
    { { "R", "G", "B" }, 3, AT(color), PELL_LAYER_ALWAYS, 1, false },
    { { "A" }, 1, AT(alpha), PELL_LAYER_ALWAYS, 1, false },
    { { "diffuse.multiple.R", "diffuse.multiple.G", "diffuse.multiple.B" }, 3, AT(multiple), PELL_LAYER_ASKED, 1, false },
    { { "transmission.R", "transmission.G", "transmission.B" }, 3, AT(transmission), PELL_LAYER_ASKED, 1, false },
    { { "specular.R", "specular.G", "specular.B" }, 3, AT(specular), PELL_LAYER_ASKED, 1, false },
    { { "irradiance.R", "irradiance.G", "irradiance.B" }, 3, AT(irradiance), PELL_LAYER_ASKED, 1, false },
    { { "normal.X", "normal.Y", "normal.Z" }, 3, AT(normal), PELL_LAYER_ASKED, 1, false },
    { { "albedo.R", "albedo.G", "albedo.B" }, 3, AT(albedo), PELL_LAYER_ASKED, 1, false },
    { { "depth.Z" }, 1, AT(depth), PELL_LAYER_ASKED, 0, true },
    { { "translucent.Y" }, 1, AT(translucent), PELL_LAYER_ASKED, 1, false },
    { { "diffuse.single.R", "diffuse.single.G", "diffuse.single.B" }, 3, AT(single), PELL_LAYER_SINGLE, 1, false },
    { { "variance.R", "variance.G", "variance.B" }, 3, AT(variance), PELL_LAYER_NOISE, 2, true }, /* squares of small numbers */
};

void pell_output_layers_scale(const struct pell_accumulator *sum, size_t size, float up)
{
    for (size_t k = 0; k < PELL_OUTPUT_LAYERS; k++) {
        const struct pell_output_layer *l = &pell_output_layers[k];
        float *const *planes = pell_output_layer_planes(sum, l);
        const float scale = l->power == 2 ? up * up : up;
        for (int c = 0; c < l->components && l->power > 0; c++)
            for (size_t i = 0; planes[c] && i < size; i++)
                planes[c][i] *= scale;
    }
}
