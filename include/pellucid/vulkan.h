/* SPDX-License-Identifier: MIT
 *
 * pellucid/vulkan.h - a method as compute passes on your own Vulkan device, recorded into your own command buffers.
 *
 *     pell_vulkan_pass_create(ctx, &device, method, knobs, &shape, &buffers, &pass);   // once
 *     pell_vulkan_pass_record(pass, command_buffer, nearest_mm);                       // every frame
 *
 * Methods that need no scene run here: screen-space, and image-space with its camera's view.
 *
 * Needs no headers of Vulkan: handles are pointers to its structs, VkBuffer is passed as uint64_t. The device is of Vulkan 1.3, with the
 * features synchronization2 and maintenance4. Everything that a pass needs besides your buffers is made with it.
 *
 * The buffers (VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, `result` also VK_BUFFER_USAGE_TRANSFER_DST_BIT) hold a row of pell_vulkan_pitch(width)
 * pixels for each row of the picture, the first at the top, so pitch x height x bytes of a pixel; pixels beyond the width are ignored. The
 * queue's family owns them, or they are shared (VK_SHARING_MODE_CONCURRENT). A picture of another size needs a pass of its own.
 * vkCmdCopyImageToBuffer fills them from images of the formats named here, with bufferRowLength = pell_vulkan_pitch(width).
 *
 *   light    16 bytes a pixel (R32G32B32A32_SFLOAT): what is blurred, R, G, B, as in struct pell_frame (irradiance, W/m^2, or with knobs
 *            that blur the shaded image radiance, W/(m^2 sr)); depth along the view axis, mm. Not used where the material is 0
 *   surface  8 bytes (R32G32_UINT): material, 0 where nothing is translucent, i + 1: shape.materials[i]; strength in [0, 1] as the bits
 *            of a float (1.0: 0x3f800000)
 *   result   16 bytes: exitance, W/m^2, or radiance, R, G, B; 0. All 0 where the material is 0
 *
 * Units      mm, pixels, W/m^2, W/(m^2 sr); colour linear Rec.709.
 * Ownership  `create` transfers ownership to the caller, `destroy` releases it; device and buffers are borrowed as long as the pass lives.
 * Errors     enum pell_result, logged once; *out is NULL on failure. PELL_ERR_DEVICE: this build has no Vulkan, the method no such engine,
 *            or a call of Vulkan failed.
 * Threads    a pass belongs to one thread at a time. It has memory of its own: what was recorded of it must have run, by a barrier or a
 *            fence, before it runs again. Frames in flight need a pass each, with buffers of their own.
 */
#ifndef PELLUCID_VULKAN_H
#define PELLUCID_VULKAN_H

#include <pellucid/method.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Of vulkan.h: VkInstance, VkPhysicalDevice, VkDevice and VkCommandBuffer are pointers to them. */
struct VkInstance_T;
struct VkPhysicalDevice_T;
struct VkDevice_T;
struct VkCommandBuffer_T;

struct pell_vulkan_device_params {
    struct VkInstance_T *instance;
    struct VkPhysicalDevice_T *physical_device;
    struct VkDevice_T *device;
    void (*(*get_instance_proc_addr)(struct VkInstance_T *instance, const char *name))(void); /* vkGetInstanceProcAddr */
};

struct pell_vulkan_buffers {
    uint64_t light, surface, result; /* VkBuffer, each from its first byte on */
};

struct pell_vulkan_pass;

/* Pixels from row to row of the buffers of a picture `width` pixels wide: the next multiple of 16. Thread-safe. */
PELL_API int pell_vulkan_pitch(int width);

/* `knobs` may be NULL: defaults; shape.stride is not read. PELL_ERR_INVALID for a shape or knobs out of range, PELL_ERR_UNSUPPORTED for a
 * picture that is too large for the device, or a method that needs a scene. */
PELL_API PELL_NODISCARD enum pell_result pell_vulkan_pass_create(struct pell_context *ctx, const struct pell_vulkan_device_params *device,
                                                                 const struct pell_method *method, const void *knobs,
                                                                 const struct pell_frame_shape *shape,
                                                                 const struct pell_vulkan_buffers *buffers, struct pell_vulkan_pass **out);
/* Records the pass into a command buffer that is begun, outside a render pass, for a queue that computes. `nearest_mm` > 0: no depth of a
 * translucent pixel is below it (orthographic: ignored); of wide profiles it chooses how many blurs of screen-space go ahead. Before,
 * `light` and `surface` must be visible to reads by compute shaders, and nothing may read `result` any more; after, `result` is written by
 * a copy (VK_PIPELINE_STAGE_2_COPY_BIT, VK_ACCESS_2_TRANSFER_WRITE_BIT): the barriers are yours. The compute pipeline, descriptor sets and
 * push constants that were bound are not any more. Allocates nothing; submits nothing. */
PELL_API PELL_NODISCARD enum pell_result pell_vulkan_pass_record(struct pell_vulkan_pass *pass, struct VkCommandBuffer_T *command_buffer,
                                                                 float nearest_mm);
/* Releases the pass, which no command buffer that runs may hold, and sets *pass to NULL; *pass may be NULL already. */
PELL_API void pell_vulkan_pass_destroy(struct pell_vulkan_pass **pass);

#ifdef __cplusplus
}
#endif
#endif
