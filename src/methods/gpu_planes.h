/* SPDX-License-Identifier: MIT
 *
 * gpu_planes.h - a frame's planes on a Vulkan device, for methods there: packed, sent, and their result brought back; or the buffers of a
 * program's own device, in the layout of pellucid/vulkan.h.
 *
 * The grid is the part of the picture that holds the frame's rectangle, from a multiple of 16 pixels on; its width is one, too. Its pixels
 * outside the rectangle have material 0.
 *
 * Ownership  pell_gpu_planes_finish takes what pell_gpu_planes_make gave, also where it failed. Services are borrowed.
 * Threads    one at a time.
 */
#ifndef PELL_GPU_PLANES_H
#define PELL_GPU_PLANES_H

#include "render/services.h"
#include "vulkan/gpu.h"

struct pell_gpu_light { /* of a pixel */
    float light[3], depth;
};

struct pell_gpu_surface {
    uint32_t material; /* 0: not translucent */
    float strength;
};

struct pell_gpu_planes {
    const struct pell_services *services;
    struct pell_gpu_buffer *light_up, *surface_up, *light, *surface, *result; /* NULL on a program's own device */
    int32_t *pixels;                                                          /* of each row: that are translucent */
    int width, height, x0, y0;                                                /* of the grid, px; its first pixel in the picture */
    /* Of the frame. */
    const struct pell_frame *in;
    const float *const *from; /* planes of light */
    const float *strength;    /* NULL: 1 */
    float *const *to;         /* planes that the result goes to */
    void (*row)(void *state, int row);
    void *state;
    double started, packed, finished; /* s: when packing began, when it ended, and when the device was ready */
    struct pell_pass_time times[PELL_GPU_MARKS];
    size_t num_times;
};

PELL_NODISCARD enum pell_result pell_gpu_planes_make(const struct pell_services *services, const struct pell_frame_shape *shape,
                                                     struct pell_gpu_planes *p);
void pell_gpu_planes_finish(struct pell_gpu_planes *p);

/* What passes bind. */
struct pell_gpu_buffer *pell_gpu_planes_buffer(const struct pell_gpu_planes *p, enum pell_gpu_plane plane);

/* The frame's pixels, into memory that goes to the device. `row` (may be NULL) is called for each row of the grid once it is packed, by any
 * thread. Returns how many pixels are translucent. */
int64_t pell_gpu_planes_pack(struct pell_gpu_planes *p, const struct pell_frame *in, const float *const light[3], const float *strength,
                             void (*row)(void *state, int row), void *state);
/* Row of the grid, packed. */
struct pell_gpu_light *pell_gpu_planes_light_row(const struct pell_gpu_planes *p, int row);
struct pell_gpu_surface *pell_gpu_planes_surface_row(const struct pell_gpu_planes *p, int row);

/* The grid of a program's own device: the whole picture. */
void pell_gpu_planes_whole(struct pell_gpu_planes *p, int width, int height);

/* Record: the packed planes to the device; what came of them, 16 bytes a pixel, back or to the program's buffer. */
void pell_gpu_planes_upload(const struct pell_gpu_planes *p, struct pell_gpu_commands *commands);
void pell_gpu_planes_download(const struct pell_gpu_planes *p, struct pell_gpu_commands *commands, struct pell_gpu_buffer *from);

/* The result of the finished list, where pixels are translucent, to three planes of the frame. */
void pell_gpu_planes_unpack(struct pell_gpu_planes *p, float *const to[3]);

/* Times of the frame: "pack", the marks of the list, "unpack". `bytes`: that what a mark times must move for a pixel of the grid. */
void pell_gpu_planes_note(struct pell_gpu_planes *p, const struct pell_gpu_commands *commands, int64_t pixels,
                          int (*bytes)(const char *mark));
size_t pell_gpu_planes_times(const struct pell_gpu_planes *p, struct pell_pass_time *list, size_t size);

/* Workgroups of `of` invocations that hold `count`. */
static inline uint32_t pell_gpu_groups(int64_t count, int of)
{
    return (uint32_t) ((count + of - 1) / of);
}

#endif
