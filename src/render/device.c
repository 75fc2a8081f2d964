/* SPDX-License-Identifier: MIT
 * device.c - devices: a thread pool, an engine, and the Vulkan device of the engine vulkan. */
#include "render/engine.h"

#include "base/simd.h"

enum pell_engine pell_device_engine(const struct pell_device *device)
{
    return device->id;
}

int pell_device_threads(const struct pell_device *device)
{
    return pell_pool_threads(device->pool);
}

const char *pell_engine_name(enum pell_engine engine)
{
    static const char *const names[] = { "auto", "cpu", "vulkan" };
    return (unsigned) engine < PELL_COUNT(names) ? names[engine] : "unknown";
}

enum pell_result pell_device_create_with_engine(struct pell_context *ctx, int threads, enum pell_engine id,
                                                const struct pell_engine_interface *engine, struct pell_device **out)
{
    struct pell_device *d = pell_zalloc(ctx, sizeof(*d));
    enum pell_result res;

    *out = NULL;
    if (!d)
        return PELL_ERR_NOMEM;
    d->ctx = ctx;
    d->id = id;
    d->engine = engine;
    pell_simd_check(ctx);
    PELL_TRY(pell_pool_create(ctx, threads, &d->pool));
    *out = d;
    return PELL_OK;

fail:
    pell_device_destroy(&d);
    return res;
}

/* `gpu` is opened where `borrowed` is NULL. */
static enum pell_result create_on_gpu(struct pell_context *ctx, int threads, const struct pell_gpu_params *gpu,
                                      const struct pell_gpu_borrowed *borrowed, struct pell_device **out)
{
    struct pell_device *d;
    enum pell_result res = pell_device_create_with_engine(ctx, threads, PELL_ENGINE_VULKAN, NULL, &d);

    *out = NULL;
    if (res != PELL_OK)
        return res;
    pell_engine_vulkan_make(&d->own);
    d->engine = &d->own;
    res = borrowed ? pell_gpu_borrow(ctx, borrowed, &d->gpu) : pell_gpu_open(ctx, gpu, &d->gpu);
    if (res == PELL_OK)
        *out = d;
    else
        pell_device_destroy(&d);
    return res;
}

enum pell_result pell_device_create_vulkan(struct pell_context *ctx, int threads, const struct pell_gpu_params *gpu,
                                           struct pell_device **out)
{
    return create_on_gpu(ctx, threads, gpu, NULL, out);
}

enum pell_result pell_device_create_borrowed(struct pell_context *ctx, const struct pell_gpu_borrowed *gpu, struct pell_device **out)
{
    return create_on_gpu(ctx, 1, NULL, gpu, out);
}

enum pell_result pell_device_create(struct pell_context *ctx, const struct pell_device_params *params, struct pell_device **out)
{
    if (out)
        *out = NULL;
    if (!ctx || !out)
        return pell_null(ctx, "pell_device_create");

    static const struct pell_device_params none;

    *out = NULL;
    if (!params)
        params = &none;
    if (params->engine == PELL_ENGINE_VULKAN)
        return pell_device_create_vulkan(
            ctx, params->threads,
            &(struct pell_gpu_params) { .device = params->vulkan_device, .cache = params->vulkan_cache, .shaders = params->vulkan_shaders },
            out);
    if (params->engine != PELL_ENGINE_AUTO && params->engine != PELL_ENGINE_CPU)
        return pell_error(ctx, PELL_ERR_DEVICE, "engine", "PELL_ENGINE_CPU, PELL_ENGINE_VULKAN", "there is no engine %d",
                          (int) params->engine);
    return pell_device_create_with_engine(ctx, params->threads, PELL_ENGINE_CPU, &pell_engine_cpu, out);
}

void pell_device_destroy(struct pell_device **device)
{
    struct pell_device *d = *device;

    if (!d)
        return;
    *device = NULL;
    pell_gpu_close(&d->gpu);
    pell_pool_destroy(&d->pool);
    pell_free(d->ctx, d);
}
