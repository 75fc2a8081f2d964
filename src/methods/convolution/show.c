/* SPDX-License-Identifier: MIT
 * show.c - intermediate images: the light of each plane before and after the convolutions. */
#include "methods/convolution/state.h"

#include "render/intermediate.h"

#include <stdio.h>
#include <string.h>

/* One of the job's planes, before or after the convolution. */
static float *image_of(const struct convolution_state *st, int after, int plane, int channel)
{
    const size_t size = (size_t) st->job.layout.width * (size_t) st->job.layout.height;

    return st->shown + ((size_t) (after * st->job.layout.planes + plane) * 3 + (size_t) channel) * size;
}

enum pell_result convolution_show_begin(struct convolution_state *st)
{
    const struct conv_layout *lay = &st->job.layout;

    if (!pell_services_observed(st->services, st->job.in))
        return PELL_OK;
    st->shown = pell_calloc(st->ctx, (size_t) lay->width * (size_t) lay->height, (size_t) (2 * lay->planes * 3) * sizeof(float));
    return st->shown ? PELL_OK : PELL_ERR_NOMEM;
}

void convolution_show_band(const struct convolution_state *st, int band, bool after, const bool *which, const float *images, size_t size)
{
    const struct conv_job *j = &st->job;
    const struct conv_layout *lay = &j->layout;

    if (!st->shown || j->uniform)
        return;
    for (int i = 0; i < lay->planes; i++)
        for (int y = band * CONV_BAND; which[i] && y < (band + 1) * CONV_BAND && y < lay->height; y++)
            memcpy(image_of(st, after, i, j->channel) + (size_t) y * (size_t) lay->width,
                   images + (size_t) i * size + (y - band * CONV_BAND) * j->stride, (size_t) lay->width * sizeof(float));
}

enum pell_result convolution_show_end(struct convolution_state *st)
{
    static const char *const names[2] = { "irradiance", "exitance" };
    static const char *const what[2] = { "light that is given to this plane, per area of a pixel on the middle plane",
                                         "light that reaches this plane from all planes, where the image needs it" };
    const struct conv_layout *lay = &st->job.layout;
    enum pell_result res = PELL_OK;

    for (int k = 0; k < 2 * lay->planes && st->shown && res == PELL_OK; k++) {
        const int plane = k / 2, after = k % 2;
        char name[96], of_group[24] = "", of_level[24] = "";
        struct pell_intermediate image = { .name = name,
                                           .unit = "W/m^2",
                                           .what = what[after],
                                           .width = lay->width,
                                           .height = lay->height,
                                           .stride = lay->width,
                                           .components = 3,
                                           .color = true };
        for (int c = 0; c < 3; c++)
            image.planes[c] = image_of(st, after, plane, c);
        if (st->num_groups > 1)
            snprintf(of_group, sizeof(of_group), "group-%d.", (int) st->job.group + 1);
        if (st->job.level >= 0)
            snprintf(of_level, sizeof(of_level), "level-%d.", st->job.level + 1);
        snprintf(name, sizeof(name), "convolution.%s%splane-%d.%s", of_group, of_level, plane + 1, names[after]);
        res = pell_show(st->services, &image);
    }
    convolution_show_drop(st);
    return res;
}

void convolution_show_drop(struct convolution_state *st)
{
    pell_free(st->ctx, st->shown);
    st->shown = NULL;
}
