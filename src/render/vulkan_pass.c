/* SPDX-License-Identifier: MIT
 * vulkan_pass.c - a method on the Vulkan device of the calling program, recorded into its command buffers. */
#include "render/pass.h"

#include <pellucid/vulkan.h>

struct pell_vulkan_pass {
    struct pell_context *ctx; /* borrowed */
    struct pell_device *device;
    struct pell_gpu_buffer *planes[PELL_GPU_PLANES_GIVEN];
    struct pell_gpu_commands *commands;
    struct pell_pass *pass;
};

int pell_vulkan_pitch(int width)
{
    return pell_gpu_pitch(width);
}

void pell_vulkan_pass_destroy(struct pell_vulkan_pass **pass)
{
    struct pell_vulkan_pass *p = *pass;

    if (!p)
        return;
    *pass = NULL;
    pell_pass_destroy(&p->pass);
    pell_gpu_commands_destroy(&p->commands);
    for (int i = 0; i < PELL_GPU_PLANES_GIVEN; i++)
        pell_gpu_buffer_destroy(&p->planes[i]);
    pell_device_destroy(&p->device);
    pell_free(p->ctx, p);
}

static enum pell_result borrow(struct pell_vulkan_pass *p, const struct pell_vulkan_device_params *device,
                               const struct pell_frame_shape *shape, const struct pell_vulkan_buffers *buffers)
{
    static const char *const names[PELL_GPU_PLANES_GIVEN] = { "light", "surface", "result" };
    const uint64_t handles[PELL_GPU_PLANES_GIVEN] = { buffers->light, buffers->surface, buffers->result };
    const uint64_t pixels = (uint64_t) pell_vulkan_pitch(shape->width) * (uint64_t) shape->height;
    const struct pell_gpu_borrowed params = { device->instance, device->physical_device, device->device, device->get_instance_proc_addr };
    enum pell_result res;

    PELL_TRY(pell_device_create_borrowed(p->ctx, &params, &p->device));
    for (int i = 0; i < PELL_GPU_PLANES_GIVEN; i++)
        PELL_TRY(
            pell_gpu_buffer_borrow(p->device->gpu, handles[i], pixels * (i == PELL_GPU_PLANE_SURFACE ? 8 : 16), names[i], &p->planes[i]));
    p->device->planes = p->planes;
    return pell_gpu_commands_borrow(p->device->gpu, &p->commands);

fail:
    return res;
}

enum pell_result pell_vulkan_pass_create(struct pell_context *ctx, const struct pell_vulkan_device_params *device,
                                         const struct pell_method *method, const void *knobs, const struct pell_frame_shape *shape,
                                         const struct pell_vulkan_buffers *buffers, struct pell_vulkan_pass **out)
{
    if (out)
        *out = NULL;
    if (!ctx || !device || !method || !shape || !buffers || !out)
        return pell_null(ctx, "pell_vulkan_pass_create");

    struct pell_frame_shape on_device = *shape;
    struct pell_vulkan_pass *p;
    enum pell_result res;

    *out = NULL;
    if (!device->instance || !device->physical_device || !device->device || !device->get_instance_proc_addr || !buffers->light ||
        !buffers->surface || !buffers->result)
        return pell_error(ctx, PELL_ERR_INVALID, "vulkan pass", NULL, "a handle of the device or of a buffer is NULL");
    if (shape->width < 1 || shape->height < 1 || shape->width > 65536 || shape->height > 65536)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "size %d x %d, each must be in [1, 65536]", shape->width, shape->height);
    p = pell_zalloc(ctx, sizeof(*p));
    if (!p)
        return PELL_ERR_NOMEM;
    p->ctx = ctx;
    on_device.stride = pell_vulkan_pitch(shape->width);
    PELL_TRY(borrow(p, device, shape, buffers));
    PELL_TRY(pell_pass_create(p->device, method, knobs, &on_device, &p->pass));
    *out = p;
    return PELL_OK;

fail:
    pell_vulkan_pass_destroy(&p);
    return res;
}

enum pell_result pell_vulkan_pass_record(struct pell_vulkan_pass *pass, struct VkCommandBuffer_T *command_buffer, float nearest_mm)
{
    if (!pass)
        return PELL_ERR_INVALID;

    if (!command_buffer)
        return pell_error(pass->ctx, PELL_ERR_INVALID, "vulkan pass", NULL, "the command buffer is NULL");
    if (!(nearest_mm > 0.0f && nearest_mm < 1e12f))
        return pell_error(pass->ctx, PELL_ERR_INVALID, "vulkan pass", NULL, "nearest_mm = %g, must be in (0, 1e12)", (double) nearest_mm);
    pell_gpu_begin_in(pass->commands, command_buffer);
    pell_pass_record_in(pass->pass, pass->commands, nearest_mm, 1.0f);
    pell_gpu_end_in(pass->commands);
    return PELL_OK;
}
