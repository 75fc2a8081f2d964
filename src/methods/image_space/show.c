/* SPDX-License-Identifier: MIT
 * show.c - intermediate images: the samples of each material, and the views of lights. */
#include "methods/image_space/image_space.h"

#include "render/intermediate.h"

#include <stdio.h>

enum pell_result is_show_samples(const struct pell_services *services, const struct is_knobs *knobs, const struct is_set *sets,
                                 size_t count)
{
    const int n = is_tile_side(knobs), samples = knobs->samples;
    int first = 0;
    const size_t size = (size_t) samples * (size_t) (n * n);
    float *copy = pell_alloc_array(services->ctx, size, 3 * sizeof(*copy));
    enum pell_result res = copy ? PELL_OK : PELL_ERR_NOMEM;

    for (int class = 0; class < IS_CLASS_OF_ALL; class ++)
        first += is_class_samples(knobs, class);
    for (size_t i = 0; i < count && res == PELL_OK; i++) {
        char name[64];
        const struct pell_intermediate image = {
            .name = name,
            .unit = "mm, mm, mm^2",
            .what = "x and y in the tangent plane and 1/density of the samples, a row for each pixel of the tile",
            .width = samples,
            .height = n * n,
            .stride = samples,
            .planes = { copy, copy + size, copy + 2 * size },
            .components = 3,
        };
        for (int c = 0; c < 3; c++)
            for (int p = 0; p < n * n; p++)
                for (int k = 0; k < samples; k++)
                    copy[(size_t) c * size + (size_t) (p * samples + k)] =
                        sets[i].offset[((n * first + p / n * samples + k) * 3 + c) * IS_BLOCK + p % n];
        snprintf(name, sizeof(name), "image-space.material-%d.samples", (int) i + 1);
        res = pell_show(services, &image);
    }
    pell_free(services->ctx, copy);
    return res;
}

enum pell_result is_show_view(const struct pell_services *services, const struct is_light_view *view, int index)
{
    const size_t size = (size_t) view->view.width * (size_t) view->view.height;
    float *copy = pell_alloc_array(services->ctx, size, 3 * sizeof(*copy));
    char name[64];
    const struct pell_intermediate image = {
        .name = name,
        .unit = "W/m^2",
        .what = "irradiance that entered where this light looks",
        .width = view->view.width,
        .height = view->view.height,
        .stride = view->view.width,
        .planes = { copy, copy + size, copy + 2 * size },
        .components = 3,
        .color = true,
    };
    enum pell_result res;

    if (!copy)
        return PELL_ERR_NOMEM;
    for (size_t c = 0; c < 3; c++)
        for (size_t i = 0; i < size; i++)
            copy[c * size + i] = view->texels[i * IS_TEXEL + IS_KEY] > 0.0f ? view->texels[i * IS_TEXEL + IS_RED + c] : 0.0f;
    snprintf(name, sizeof(name), "image-space.view-%d.irradiance", index);
    res = pell_show(services, &image);
    pell_free(services->ctx, copy);
    return res;
}
