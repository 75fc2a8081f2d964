/* SPDX-License-Identifier: MIT
 * absent.c - devices.h and gpu.h where the build found no headers of Vulkan or no glslc: there is no device. */
#include "vulkan/devices.h"
#include "vulkan/gpu.h"

enum pell_result pell_vulkan_devices_find(struct pell_context *ctx, struct pell_vulkan_devices *out)
{
    (void) ctx;
    *out = (struct pell_vulkan_devices) { .taken = -1, .why = "this build has no Vulkan" };
    return PELL_OK;
}

enum pell_result pell_gpu_open(struct pell_context *ctx, const struct pell_gpu_params *params, struct pell_gpu **out)
{
    (void) params;
    *out = NULL;
    return pell_error(ctx, PELL_ERR_DEVICE, "engine vulkan", "use --engine cpu", "no Vulkan device: this build has the engine cpu only");
}

void pell_gpu_close(struct pell_gpu **gpu)
{
    *gpu = NULL;
}

const char *pell_gpu_name(const struct pell_gpu *gpu)
{
    (void) gpu;
    return "";
}
