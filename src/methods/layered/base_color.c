/* SPDX-License-Identifier: MIT
 * base_color.c - the colour of what lies below the layers, or on top of them. */
#include "methods/layered/state.h"

#include "image/color.h"

void layered_base_color(const struct pell_material *m, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float color[3])
{
    const struct pell_texture *t = m->base_color_map.texture;
    float rgba[4] = { 1.0f, 1.0f, 1.0f, 1.0f };

    if (t && t->image.pixels) {
        const uint32_t *index = mesh->index + 3 * (size_t) triangle;
        float uv[3][2];
        for (int c = 0; c < 3; c++)
            layered_map_uv(&m->base_color_map, mesh, index[c], uv[c]);
        pell_image_sample(&t->image, t->wrap_u, t->wrap_v, t->nearest, uv[0][0] + u * (uv[1][0] - uv[0][0]) + v * (uv[2][0] - uv[0][0]),
                          uv[0][1] + u * (uv[1][1] - uv[0][1]) + v * (uv[2][1] - uv[0][1]), rgba);
    }
    for (int c = 0; c < 3; c++) {
        const float value = m->base_color[c] * rgba[c];
        color[c] = value > 0.0f ? fminf(value, 1.0f) : 0.0f;
    }
}
