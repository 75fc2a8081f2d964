/* SPDX-License-Identifier: MIT
 *
 * encode.h - encodes images for the page.
 *
 * Ownership  the caller frees *bytes by free().
 * Errors     logged; *bytes is NULL on failure.
 */
#ifndef PELL_VIEWER_ENCODE_H
#define PELL_VIEWER_ENCODE_H

#include "base/base.h"

#include <pellucid/render.h>

/* Three planes in [0, 1], linear display light as in pell_render_result.display. */
struct viewer_image {
    int width, height;
    ptrdiff_t stride;
    const float *planes[3];
    bool encoded; /* the planes are sRGB-encoded already */
};

PELL_NODISCARD enum pell_result viewer_encode_jpeg(struct pell_context *ctx, const struct viewer_image *p, int quality, uint8_t **bytes,
                                                   size_t *size);
/* Encodes the same pixels as `pellucid render -o x.png`. */
PELL_NODISCARD enum pell_result viewer_encode_png(struct pell_context *ctx, const struct viewer_image *p, uint8_t **bytes, size_t *size);
/* Encodes all channels of a result, linear. */
PELL_NODISCARD enum pell_result viewer_encode_exr(struct pell_context *ctx, const struct pell_render_result *image, uint8_t **bytes,
                                                  size_t *size);
/* Applies the renderer's display transform to linear radiance: exposure, white and curve from `settings`. Planes without padding; `out` may
 * be `in`. */
void viewer_tone(const struct pell_settings *settings, const float *const in[3], float *const out[3], size_t count);

#endif
