/* SPDX-License-Identifier: MIT
 *
 * pellucid/vulkan.h - records methods as compute passes into your own command buffers, on your own Vulkan device.
 *
 *     pell_vulkan_pass_create(ctx, &device, method, knobs, &shape, &buffers, &pass);   // once
 *     pell_vulkan_pass_record(pass, command_buffer, nearest_mm);                       // every frame
 *
 * Methods that need no scene are supported: screen-space, and image-space with the camera's view.
 *
 * No Vulkan headers are needed: handles are pointers to its structs, VkBuffer is passed as uint64_t. The device must support Vulkan 1.3
 * with the features synchronization2 and maintenance4. A pass allocates everything that it needs besides your buffers when it is created.
 *
 * The buffers (VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, `result` also VK_BUFFER_USAGE_TRANSFER_DST_BIT) hold a row of pell_vulkan_pitch(width)
 * pixels for each row of the image, top row first: pitch x height x bytes per pixel in all; pixels beyond the width are ignored. The
 * queue's family owns them, or they are shared (VK_SHARING_MODE_CONCURRENT). Each image size needs its own pass. vkCmdCopyImageToBuffer
 * fills them from images of the formats named here, with bufferRowLength = pell_vulkan_pitch(width).
 *
 *   light    16 bytes per pixel (R32G32B32A32_SFLOAT): R, G, B of the blurred quantity, as in struct pell_frame (irradiance, W/m^2, or,
 *            with knobs that blur the shaded image, radiance, W/(m^2 sr)); depth along the view axis, mm. Unused where the material is 0
 *   surface  8 bytes per pixel (R32G32_UINT): material, 0: not translucent, i + 1: shape.materials[i]; strength in [0, 1] as the bits of a
 *            float (1.0: 0x3f800000)
 *   result   16 bytes per pixel: radiant exitance, W/m^2, or radiance, R, G, B; 0. All 0 where the material is 0
 *
 * Units      mm, pixels, W/m^2, W/(m^2 sr); colour linear Rec.709.
 * Ownership  `create` transfers ownership to the caller, `destroy` releases it; device and buffers are borrowed as long as the pass lives.
 * Errors     enum pell_result, logged once; *out is NULL on failure. PELL_ERR_DEVICE: this build has no Vulkan support, the method has no
 *            Vulkan engine, or a Vulkan call failed.
 * Threads    a pass belongs to one thread at a time. It has internal buffers: each recorded execution must be complete, by a barrier or a
 *            fence, before the next one starts. Frames in flight need separate passes with separate buffers.
 */
#ifndef PELLUCID_VULKAN_H
#define PELLUCID_VULKAN_H

#include <pellucid/method.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Declared in vulkan.h; VkInstance, VkPhysicalDevice, VkDevice and VkCommandBuffer are pointers to these structs. */
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
    uint64_t light, surface, result; /* VkBuffer; data start at offset 0 */
};

struct pell_vulkan_pass;

/* The row pitch, in pixels, of the buffers for an image `width` pixels wide: the next multiple of 16. Thread-safe. */
PELL_API int pell_vulkan_pitch(int width);

/* Creates a pass. `knobs` may be NULL: defaults; shape.stride is not read. PELL_ERR_INVALID for a shape or knobs out of range,
 * PELL_ERR_UNSUPPORTED for an image too large for the device, or a method that needs a scene. */
PELL_API PELL_NODISCARD enum pell_result pell_vulkan_pass_create(struct pell_context *ctx, const struct pell_vulkan_device_params *device,
                                                                 const struct pell_method *method, const void *knobs,
                                                                 const struct pell_frame_shape *shape,
                                                                 const struct pell_vulkan_buffers *buffers, struct pell_vulkan_pass **out);
/* Records the pass into a command buffer in the recording state, outside a render pass, for a queue that supports compute. `nearest_mm` > 0
 * is a lower bound of the depth of translucent pixels (orthographic: ignored); for wide profiles it determines the number of preliminary
 * blurs of screen-space. The caller is responsible for the barriers: before the pass, `light` and `surface` must be visible to reads by
 * compute shaders, and no earlier command may still read `result`; the pass writes `result` by a copy (VK_PIPELINE_STAGE_2_COPY_BIT,
 * VK_ACCESS_2_TRANSFER_WRITE_BIT). The pass changes the bound compute pipeline, descriptor sets and push constants. Allocates nothing;
 * submits nothing. */
PELL_API PELL_NODISCARD enum pell_result pell_vulkan_pass_record(struct pell_vulkan_pass *pass, struct VkCommandBuffer_T *command_buffer,
                                                                 float nearest_mm);
/* Releases the pass, which no pending command buffer may use, and sets *pass to NULL; *pass may be NULL already. */
PELL_API void pell_vulkan_pass_destroy(struct pell_vulkan_pass **pass);

#ifdef __cplusplus
}
#endif
#endif
