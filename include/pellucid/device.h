/* SPDX-License-Identifier: MIT
 *
 * pellucid/device.h - an engine and its threads, on which renderers and passes are created.
 *
 *     pell_device_create(ctx, &(struct pell_device_params) { .threads = 4 }, &device);
 *     pell_renderer_create(device, &renderer);                          // render.h: whole scenes
 *     pell_pass_create(device, method, knobs, &shape, &pass);           // method.h: a method on the caller's planes
 *
 * Units      none; a number of threads.
 * Ownership  the device borrows the context; everything created on a device must be destroyed before it.
 * Errors     logged once by the function that detects them; PELL_ERR_DEVICE for an engine that this build or machine does not have.
 * Threads    renderers and passes of one device may be used from different threads at once, one thread at a time each. They share the
 *            device's threads, which serve one call at a time: to keep calls from waiting for each other, give each its own device.
 */
#ifndef PELLUCID_DEVICE_H
#define PELLUCID_DEVICE_H

#include <pellucid/context.h>

#ifdef __cplusplus
extern "C" {
#endif

enum pell_engine { PELL_ENGINE_AUTO, PELL_ENGINE_CPU, PELL_ENGINE_VULKAN };

struct pell_device_params {
    int threads; /* [1, 256]; 0: one per core that the process may use */
    enum pell_engine
        engine; /* AUTO: cpu. VULKAN: methods and stages that have a Vulkan implementation run on a Vulkan device, all others on the cpu */
    const char *vulkan_device;  /* for VULKAN: index in the driver's order, or a part of its name; NULL: hardware before software */
    const char *vulkan_cache;   /* for VULKAN: a folder that caches compiled shaders between runs; NULL: none */
    const char *vulkan_shaders; /* for VULKAN: a folder whose files NAME.spv replace built-in shaders and are reloaded when they
                                 * change; NULL: none. They must be trusted like code: the driver compiles and runs them */
};

struct pell_device;

/* `params` may be NULL: AUTO, one thread per core. On failure *out is NULL. PELL_ERR_DEVICE; PELL_ERR_INVALID: threads out of range. */
PELL_API PELL_NODISCARD enum pell_result pell_device_create(struct pell_context *ctx, const struct pell_device_params *params,
                                                            struct pell_device **out);
/* Sets *device to NULL; destroying &(NULL) does nothing. */
PELL_API void pell_device_destroy(struct pell_device **device);

/* The engine that was chosen; never AUTO. */
PELL_API enum pell_engine pell_device_engine(const struct pell_device *device);
PELL_API int pell_device_threads(const struct pell_device *device);

/* "auto", "cpu", "vulkan"; "unknown" for any other number. Thread-safe. */
PELL_API const char *pell_engine_name(enum pell_engine engine);

#ifdef __cplusplus
}
#endif
#endif
