/* SPDX-License-Identifier: MIT
 *
 * device.h - depth of field, and bloom with the tone curve, on a Vulkan device: the engine vulkan's.
 *
 * A sample's picture is sent, blurred and added to the sum there, which comes back once, after the last. What bloom spreads is shown where
 * it lies. Exposure, white and what is behind are the cpu's, and so is the tone curve where nothing comes before it on the device: planes
 * would be copied twice for a few operations a pixel (docs/adr/0049).
 *
 * Units      as in dof.h, bloom.h and kernel.h.
 * Errors     of the device or memory, logged.
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

/* `gpu` outlives it. */
PELL_NODISCARD enum pell_result pell_post_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_post_device **out);
void pell_post_device_destroy(struct pell_post_device **device);

/* Room for pictures of a size; nothing where it is there. What no buffer holds has none: see `refuses`. */
PELL_NODISCARD enum pell_result pell_post_device_reserve(struct pell_post_device *device, int width, int height, bool lens, bool bloom);
void pell_post_device_drop(struct pell_post_device *device);

/* The row of a frame's times that says why the cpu does it; NULL: the device does. */
const char *pell_post_device_refuses_lens(const struct pell_post_device *device);
const char *pell_post_device_refuses_bloom(const struct pell_post_device *device);

/* Depth of field of a sample, as pell_dof_render has it; the sum stays on the device. */
PELL_NODISCARD enum pell_result pell_post_device_lens(struct pell_post_device *device, struct pell_pool *pool,
                                                      const struct pell_dof_params *params, float *const in[4],
                                                      struct pell_post_device_times *times);
/* The same for a sample that is on the device: where its planes are written (R, G, B, alpha, and inverse depth, 1/mm, 0 for no hit; from
 * row y0 of the image on, only inside the rectangle), and the passes, which are recorded into a list after that. */
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
