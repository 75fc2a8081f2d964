/* SPDX-License-Identifier: MIT
 * device_absent.c - device.h where the build has no Vulkan: there is no device, and nothing but create and destroy is called. */
#include "render/picture/device.h"

enum pell_result pell_picture_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_picture_device **out)
{
    (void) ctx, (void) gpu;
    *out = NULL;
    return PELL_ERR_DEVICE;
}

void pell_picture_device_destroy(struct pell_picture_device **device)
{
    *device = NULL;
}

void pell_picture_device_drop(struct pell_picture_device *d)
{
    (void) d;
}

const char *pell_picture_device_refuses(const struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    (void) d, (void) s;
    return "no Vulkan";
}

enum pell_result pell_picture_device_sample(struct pell_picture_device *d, const struct pell_picture_sample *s,
                                            struct pell_engine_seen *seen)
{
    (void) d, (void) s, (void) seen;
    return PELL_ERR_DEVICE;
}

enum pell_result pell_picture_device_take(struct pell_picture_device *d, struct pell_pool *pool, struct pell_stage_notes *notes,
                                          const struct pell_accumulator *out, ptrdiff_t stride, const struct pell_rect *rect, bool lens)
{
    (void) d, (void) pool, (void) notes, (void) out, (void) stride, (void) rect, (void) lens;
    return PELL_ERR_DEVICE;
}
