/* SPDX-License-Identifier: MIT
 *
 * device.h - renders all samples of an image on a Vulkan device: camera rays, light (by irradiance/device.h), the method, and the
 * composite. Only statistics per row are read back for each sample, and the image once. pell_picture_device_refuses returns before the
 * first sample why the device cannot render a frame.
 *
 * Ownership  pell_picture_device_destroy sets the pointer to NULL and accepts NULL in it.
 * Errors     as in gpu.h.
 * Threads    one at a time.
 */
#ifndef PELL_PICTURE_DEVICE_H
#define PELL_PICTURE_DEVICE_H

#include "render/composite/stage.h"
#include "render/engine.h"
#include "render/irradiance/device.h"
#include "render/post/device.h"

struct pell_picture_device;

PELL_NODISCARD enum pell_result pell_picture_device_create(struct pell_context *ctx, struct pell_gpu *gpu,
                                                           struct pell_picture_device **out);
void pell_picture_device_destroy(struct pell_picture_device **device);
/* Frees data that depends on a size and a scene. */
void pell_picture_device_drop(struct pell_picture_device *d);

struct pell_picture_sample {
    const struct pell_engine_sample *sample;
    struct pell_light_device *light;                 /* holds the scene and its lights */
    const struct pell_irradiance_params *irradiance; /* parameters of the sample's light, */
    const struct pell_composite_params *composite;   /* and of its composite, without the method's result */
    struct pell_pass *pass;                          /* NULL: nothing scatters */
    bool spreads;                                    /* straight transmission is spread */
    bool unscattered;                                /* light passes thin parts without being scattered */
    struct pell_post_device *lens;                   /* applies depth of field; NULL: none */
    int rays;                                        /* shadow rays per pixel and light */
    uint32_t version;                                /* counts changes of the solids' data in `irradiance` */
};

/* Returns why the CPU renders these samples, as named in a row of the timings; NULL: the device does. A constant. */
const char *pell_picture_device_refuses(const struct pell_picture_device *d, const struct pell_picture_sample *s);

/* Adds a sample to the image; the first one overwrites it. Notes the times of its passes. */
PELL_NODISCARD enum pell_result pell_picture_device_sample(struct pell_picture_device *d, const struct pell_picture_sample *s,
                                                           struct pell_engine_seen *seen);

/* Reads the sum of the samples into the planes of `out` inside the rectangle: color, alpha and meter; with depth of field only the
 * meter, since the lens has the sum. */
PELL_NODISCARD enum pell_result pell_picture_device_take(struct pell_picture_device *d, struct pell_pool *pool,
                                                         struct pell_stage_notes *notes, const struct pell_accumulator *out,
                                                         ptrdiff_t stride, const struct pell_rect *rect, bool lens);

#endif
