/* SPDX-License-Identifier: MIT
 * device_absent.c - device.h where the build has no Vulkan: there is no device, and nothing but create and destroy is called. */
#include "render/post/device.h"

enum pell_result pell_post_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_post_device **out)
{
    (void) ctx, (void) gpu;
    *out = NULL;
    return PELL_ERR_DEVICE;
}

void pell_post_device_destroy(struct pell_post_device **device)
{
    *device = NULL;
}

enum pell_result pell_post_device_reserve(struct pell_post_device *d, int width, int height, bool lens, bool bloom)
{
    (void) d, (void) width, (void) height, (void) lens, (void) bloom;
    return PELL_ERR_DEVICE;
}

void pell_post_device_drop(struct pell_post_device *d)
{
    (void) d;
}

const char *pell_post_device_refuses_lens(const struct pell_post_device *d)
{
    (void) d;
    return "no Vulkan";
}

const char *pell_post_device_refuses_bloom(const struct pell_post_device *d)
{
    (void) d;
    return "no Vulkan";
}

enum pell_result pell_post_device_lens(struct pell_post_device *d, struct pell_pool *pool, const struct pell_dof_params *params,
                                       float *const in[4], struct pell_post_device_times *times)
{
    (void) d, (void) pool, (void) params, (void) in, (void) times;
    return PELL_ERR_DEVICE;
}

enum pell_result pell_post_device_take_lens(struct pell_post_device *d, struct pell_pool *pool, float scale, float *const out[4],
                                            float *widest, struct pell_post_device_times *times)
{
    (void) d, (void) pool, (void) scale, (void) out, (void) widest, (void) times;
    return PELL_ERR_DEVICE;
}

enum pell_result pell_post_device_bloom(struct pell_post_device *d, struct pell_pool *pool, const struct pell_bloom_params *params,
                                        const struct pell_post_tone *tone, float *const *planes, size_t count, float *const display[3],
                                        struct pell_post_device_times *times)
{
    (void) d, (void) pool, (void) params, (void) tone, (void) planes, (void) count, (void) display, (void) times;
    return PELL_ERR_DEVICE;
}
