/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "post": background, bloom, exposure, tone mapping.
 *
 * Photographic tone reproduction (Reinhard, Stark, Shirley, Ferwerda 2002): L = exposure x luminance, L_d = L (1 + L / white^2) / (1 + L),
 * colour scaled by L_d / L.
 *
 * What is shown of several samples a pixel is weighted by a Gaussian about the pixel's centre, as renderers of films do: a box leaves
 * stairs at edges between white and black, however many samples it has. The pixel's mean, which has a variance of 1/12 along each axis,
 * is blended with its neighbours' for that: 1/12 + 2 x 0.06 is a standard deviation of 0.45 pixels.
 *
 * A pixel that is covered in part is shown as the shares of what covers it and of what is behind it, each by the curve: the linear light of
 * a rim far brighter than white would make all of its pixels white, however little of them it covers.
 *
 * Exposure, where the user gives none, is metered over the pixels that something covers, as a photographer would with two meters: by the
 * light that arrives (a white Lambertian surface in the mean irradiance becomes 1, so milk stays white and ketchup dark), but never
 * more than three times what the key 0.18 of the log-average luminance asks for, so that what is lit from behind does not burn out.
 */
#ifndef PELL_POST_H
#define PELL_POST_H

#include "render/contact/stage.h"
#include "render/irradiance/stage.h"
#include "render/post/device.h"

struct pell_post_params {
    const struct pell_scene *scene;
    const struct pell_view *view;       /* unshifted, through the centre of the lens */
    const struct pell_lens *lens;       /* with which the image was rendered */
    const struct pell_lights *lights;   /* for an environment as background */
    const struct pell_contact *contact; /* NULL: no contact shadow */
    const struct pell_settings *settings;
    int width, height;
    struct pell_rect rect; /* of the composite: outside it color and alpha are undefined and become the background */
    ptrdiff_t stride;
    const double *meter;             /* of the composite: 2 values per row */
    double *rows;                    /* scratch: 4 numbers a row */
    float *const *glow;              /* scratch: PELL_BLOOM_PLANES planes; not read without bloom, or with a device */
    float *const *unfiltered;        /* scratch: 3 planes */
    struct pell_post_device *device; /* for bloom, with room for it; NULL: the CPU */
};

struct pell_post_result {
    float exposure, white;
    int64_t invalid;
    bool covered, any_light;                 /* something is visible; light arrives at it */
    double bloom;                            /* seconds of it */
    struct pell_post_device_times on_device; /* where there is one */
};

/* `color` is premultiplied by `alpha` on input, and composited over the background (linear, without exposure), with bloom, on output;
 * `display` gets the displayed image. Exposure and white are those of the image without bloom. With a transparent background bloom also
 * spreads alpha, so that the image may be composited over any uniform background later. Allocates nothing. The result does not depend on
 * the number of threads, to the bit. Fails only with a device. */
PELL_NODISCARD enum pell_result pell_post_render(struct pell_pool *pool, const struct pell_post_params *params, float *const color[3],
                                                 float *alpha, float *const display[3], struct pell_post_result *result);

#endif
