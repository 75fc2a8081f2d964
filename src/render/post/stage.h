/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "post": background, bloom, exposure, tone mapping.
 *
 * Photographic tone reproduction (Reinhard, Stark, Shirley, Ferwerda 2002): L = exposure x luminance, L_d = L (1 + L / white^2) / (1 + L),
 * colour scaled by L_d / L.
 *
 * With several samples per pixel the displayed image has a Gaussian reconstruction filter, as in film renderers: a box filter leaves stairs
 * at edges between white and black for any number of samples. The pixel's mean, a box with a variance of 1/12 along each axis, is blended
 * with its neighbours: 1/12 + 2 x 0.06 is a standard deviation of 0.45 pixels.
 *
 * In a partially covered pixel foreground and background are tone mapped separately and then weighted by coverage: in linear light a rim
 * far brighter than white would make all of its pixels white, however little of them it covers.
 *
 * Exposure, unless the user sets it, is metered over the covered pixels, as a photographer would with two meters: by the incident light (a
 * white Lambertian surface in the mean irradiance becomes 1, so milk stays white and ketchup dark), but at most three times the exposure
 * that maps the log-average luminance to the key 0.18, so that backlit objects are not overexposed.
 */
#ifndef PELL_POST_H
#define PELL_POST_H

#include "render/contact/stage.h"
#include "render/irradiance/stage.h"
#include "render/post/device.h"

struct pell_post_params {
    const struct pell_scene *scene;
    const struct pell_view *view;       /* without a subpixel shift, through the centre of the lens */
    const struct pell_lens *lens;       /* lens of the rendered image */
    const struct pell_lights *lights;   /* for an environment as background */
    const struct pell_contact *contact; /* NULL: no contact shadow */
    const struct pell_settings *settings;
    int width, height;
    struct pell_rect rect; /* rectangle of the composite: outside it color and alpha are undefined and become the background */
    ptrdiff_t stride;
    const double *meter;             /* pell_accumulator.meter: 2 values per row */
    double *rows;                    /* scratch: 4 values per row */
    float *const *bloom_scratch;     /* scratch: PELL_BLOOM_PLANES planes; not read without bloom, or with a device */
    float *const *unfiltered;        /* scratch: 3 planes */
    struct pell_post_device *device; /* for bloom, with room for it; NULL: the CPU */
};

struct pell_post_result {
    float exposure, white;
    int64_t invalid;
    bool covered, any_light;                 /* something is visible; light arrives at it */
    bool negligible;                         /* but so little that no exposure shows it */
    double bloom;                            /* time of bloom, seconds */
    struct pell_post_device_times on_device; /* with a device */
};

/* `color` is premultiplied by `alpha` on input, and composited over the background (linear, without exposure), with bloom, on output;
 * `display` gets the displayed image. Exposure and white are those of the image without bloom. With a transparent background bloom also
 * spreads alpha, so that the image may be composited over any uniform background later. Allocates nothing. The result does not depend on
 * the number of threads, to the bit. Fails only with a device. */
PELL_NODISCARD enum pell_result pell_post_render(struct pell_pool *pool, const struct pell_post_params *params, float *const color[3],
                                                 float *alpha, float *const display[3], struct pell_post_result *result);

#endif
