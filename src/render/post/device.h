/* SPDX-License-Identifier: MIT
 *
 * device.h - depth of field, and bloom with tone mapping, on the Vulkan device of the engine vulkan.
 *
 * A sample's image is uploaded, blurred and added to a sum on the device, which is read back once, after the last sample. After bloom the
 * image is tone mapped on the device. Exposure, white and background are computed on the CPU, and so is the tone curve without bloom:
 * copying planes back and forth for a few operations per pixel would cost more (docs/adr/0049).
 *
 * Units      as in dof.h, bloom.h and kernel.h.
 * Errors     errors of the device or memory, logged.
 * Threads    one at a time.
 */
#ifndef PELL_POST_DEVICE_H
#define PELL_POST_DEVICE_H

#include "render/post/bloom.h"
#include "render/post/dof.h"
#include "render/post/kernel.h"

struct pell_gpu;
struct pell_gpu_buffer;
struct pell_gpu_commands;
struct pell_post_device;

/* Timings of one call: seconds on the CPU, which copies planes, and by the device's clock; bytes transferred. */
struct pell_post_device_times {
    double pack, upload, run, download, unpack;
    int64_t bytes_up, bytes_run, bytes_down; /* up and down: over the bus */
};

/* `gpu` must outlive the device. */
PELL_NODISCARD enum pell_result pell_post_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_post_device **out);
void pell_post_device_destroy(struct pell_post_device **device);

/* Allocates buffers for images of this size, unless they exist. Images too large for a buffer are refused: see below. */
PELL_NODISCARD enum pell_result pell_post_device_reserve(struct pell_post_device *device, int width, int height, bool lens, bool bloom);
void pell_post_device_drop(struct pell_post_device *device);

/* Returns the row of a frame's timings that names why the CPU does this; NULL: the device does. */
const char *pell_post_device_refuses_lens(const struct pell_post_device *device);
const char *pell_post_device_refuses_bloom(const struct pell_post_device *device);

/* Depth of field of a sample, as pell_dof_render computes it; the sum stays on the device. */
PELL_NODISCARD enum pell_result pell_post_device_lens(struct pell_post_device *device, struct pell_pool *pool,
                                                      const struct pell_dof_params *params, float *const in[4],
                                                      struct pell_post_device_times *times);
/* The same for a sample that was rendered on the device: location of its planes (R, G, B, alpha, and inverse depth, 1/mm, 0 for no hit;
 * from row y0 of the image on, only inside the rectangle). The passes are recorded into a list after those that write the planes. */
struct pell_post_lens_planes {
    struct pell_gpu_buffer *buffer;
    uint32_t plane, stride; /* floats */
    int y0;
};
struct pell_post_lens_planes pell_post_device_lens_planes(const struct pell_post_device *device, const struct pell_rect *rect);
void pell_post_device_record_lens(struct pell_post_device *device, const struct pell_dof_params *params,
                                  struct pell_gpu_commands *commands);

/* Reads the sum, times `scale`, inside the rectangle of the last sample. *widest as from pell_dof_render, over all samples. */
PELL_NODISCARD enum pell_result pell_post_device_take_lens(struct pell_post_device *device, struct pell_pool *pool, float scale,
                                                           float *const out[4], float *widest, struct pell_post_device_times *times);

/* pell_bloom_render of `count` planes, then the displayed values of the first three: `tone` composites over nothing. With four, the last
 * is alpha. */
PELL_NODISCARD enum pell_result pell_post_device_bloom(struct pell_post_device *device, struct pell_pool *pool,
                                                       const struct pell_bloom_params *params, const struct pell_post_tone *tone,
                                                       float *const *planes, size_t count, float *const display[3],
                                                       struct pell_post_device_times *times);

#endif
