/* SPDX-License-Identifier: MIT
 * intermediate.c - see intermediate.h. */
#include "render/intermediate.h"

#include <math.h>

static float value_at(const void *plane, enum pell_plane_format format, ptrdiff_t at)
{
    switch (format) {
    case PELL_PLANE_U16: return (float) ((const uint16_t *) plane)[at];
    case PELL_PLANE_U32: return (float) ((const uint32_t *) plane)[at];
    case PELL_PLANE_F32: break;
    }
    return ((const float *) plane)[at];
}

enum pell_result pell_show_pixels(const struct pell_services *s, const struct pell_frame *in, const void *const planes[],
                                  enum pell_plane_format format, struct pell_intermediate *image)
{
    const size_t width = (size_t) in->shape.width, all = width * (size_t) in->shape.height;
    const ptrdiff_t stride = image->stride > 0 ? image->stride : in->shape.stride;
    float *copy = pell_calloc(s->ctx, all, (size_t) image->components * sizeof(*copy));
    enum pell_result res;

    if (!copy)
        return PELL_ERR_NOMEM;
    image->width = in->shape.width;
    image->height = in->shape.height;
    image->stride = in->shape.width;
    for (int c = 0; c < image->components; c++) {
        float *to = copy + (size_t) c * all;
        image->planes[c] = to;
        for (int y = in->rect.y0; y < in->rect.y1; y++)
            for (int x = in->rect.x0; x < in->rect.x1; x++) {
                const bool covered = in->material[y * in->shape.stride + x] > 0;
                const float value = covered ? value_at(planes[c], format, y * stride + x) : 0.0f;
                to[(size_t) y * width + (size_t) x] = isfinite(value) ? value : 0.0f;
            }
    }
    res = pell_show(s, image);
    pell_free(s->ctx, copy);
    return res;
}
