/* SPDX-License-Identifier: MIT
 * absent.c - stubs of devices.h and gpu.h if the build found no Vulkan headers or no glslc: there is no device. */
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

enum pell_result pell_gpu_borrow(struct pell_context *ctx, const struct pell_gpu_borrowed *params, struct pell_gpu **out)
{
    (void) params;
    *out = NULL;
    return pell_error(ctx, PELL_ERR_DEVICE, "vulkan pass", NULL, "no Vulkan device: this build has the engine cpu only");
}

/* Never called, as there is no device. */

enum pell_result pell_gpu_buffer_borrow(struct pell_gpu *gpu, uint64_t handle, uint64_t size, const char *name,
                                        struct pell_gpu_buffer **out)
{
    (void) gpu, (void) handle, (void) size, (void) name;
    *out = NULL;
    return PELL_ERR_DEVICE;
}

uint64_t pell_gpu_buffer_id(const struct pell_gpu_buffer *buffer)
{
    (void) buffer;
    return 0;
}

void pell_gpu_buffer_destroy(struct pell_gpu_buffer **buffer)
{
    *buffer = NULL;
}

enum pell_result pell_gpu_commands_borrow(struct pell_gpu *gpu, struct pell_gpu_commands **out)
{
    (void) gpu;
    *out = NULL;
    return PELL_ERR_DEVICE;
}

void pell_gpu_commands_destroy(struct pell_gpu_commands **commands)
{
    *commands = NULL;
}

void pell_gpu_begin_in(struct pell_gpu_commands *commands, struct VkCommandBuffer_T *command_buffer)
{
    (void) commands, (void) command_buffer;
}

void pell_gpu_end_in(struct pell_gpu_commands *commands)
{
    (void) commands;
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
