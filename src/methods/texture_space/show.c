/* SPDX-License-Identifier: MIT
 * show.c - intermediate images of a solid's map. */
#include "methods/texture_space/state.h"

#include "render/intermediate.h"

#include <math.h>
#include <stdio.h>

/* Thickness encoded in alpha; 0 without transmission. */
static float thickness_of(float alpha, double falloff)
{
    return alpha > 0.0f ? fmaxf(-logf(alpha), 0.0f) * (float) falloff : 0.0f;
}

static enum pell_result show(struct ts_state *st, const struct ts_image *image, float *copy)
{
    const struct ts_solid *solid = &st->solid[st->shown.solid];
    const struct ts_atlas *a = solid->atlas;
    char name[64], of_solid[24] = "", of_light[24] = "";
    struct pell_intermediate out = {
        .name = name,
        .unit = image->unit,
        .what = image->what,
        .width = a->width,
        .height = a->height,
        .stride = a->width,
        .components = image->components,
        .color = image->color,
        .gaussians = image->gaussian,
        .num_gaussians = image->gaussian ? 1 : 0,
    };

    for (int c = 0; c < image->components; c++) {
        float *to = copy + (size_t) c * (size_t) a->width * (size_t) a->height;
        out.planes[c] = to;
        for (int y = 0; y < a->height; y++)
            for (int x = 0; x < a->width; x++) {
                const ptrdiff_t at = y * a->stride + x;
                const float value = a->source[at] != UINT32_MAX ? image->planes[c][at] : 0.0f;
                *to++ = image->falloff > 0.0 ? thickness_of(value, image->falloff) : isfinite(value) ? value : 0.0f;
            }
    }
    if (st->solids->count > 1)
        snprintf(of_solid, sizeof(of_solid), "object-%d.", (int) st->shown.solid + 1);
    if (st->shown.light >= 0 && image->of_light)
        snprintf(of_light, sizeof(of_light), "light-%d.", st->shown.light + 1);
    snprintf(name, sizeof(name), "texture-space.%s%s%s", of_solid, of_light, image->name);
    return pell_show(st->services, &out);
}

void ts_show(struct ts_state *st, const struct ts_image *image)
{
    const struct ts_atlas *a = st->solid[st->shown.solid].atlas;
    float *copy;

    if (!pell_services_observed(st->services, st->in) || st->shown.result != PELL_OK)
        return;
    copy = pell_alloc_array(st->ctx, (size_t) a->width * (size_t) a->height, (size_t) image->components * sizeof(*copy));
    st->shown.result = copy ? show(st, image, copy) : PELL_ERR_NOMEM;
    pell_free(st->ctx, copy);
}
