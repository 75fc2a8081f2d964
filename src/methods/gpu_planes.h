/* SPDX-License-Identifier: MIT
 *
 * gpu_planes.h - a frame's planes on a Vulkan device, for methods that run there: packing, upload, and download of the result; or the
 * buffers of a program's own device, in the layout of pellucid/vulkan.h.
 *
 * The grid is the part of the image that contains the frame's rectangle, from a multiple of 16 pixels on; its width is one, too. Its
 * pixels outside of the rectangle have material 0.
 *
 * Ownership  pell_gpu_planes_finish releases what pell_gpu_planes_make created, even after a failure. Services are borrowed.
 * Threads    one at a time.
 */
#ifndef PELL_GPU_PLANES_H
#define PELL_GPU_PLANES_H

#include "render/services.h"
#include "vulkan/gpu.h"

struct pell_gpu_light { /* per pixel */
    float light[3], depth;
};

struct pell_gpu_surface {
    uint32_t material; /* 0: not translucent */
    float strength;
};

struct pell_gpu_planes {
    const struct pell_services *services;
    struct pell_gpu_buffer *light_up, *surface_up, *light, *surface, *result; /* NULL on a program's own device */
    int32_t *pixels;                                                          /* per row: number of translucent pixels */
    int width, height, x0, y0;                                                /* of the grid, px; its origin in the image */
    /* Of the frame. */
    const struct pell_frame *in;
    const float *const *from; /* planes of light */
    const float *strength;    /* NULL: 1 */
    float *const *to;         /* planes of the result */
    void (*row)(void *state, int row);
    void *state;
    double started, packed, finished; /* s: when packing began, when it ended, and when the device had finished */
    struct pell_pass_time times[PELL_GPU_MARKS];
    size_t num_times;
};

PELL_NODISCARD enum pell_result pell_gpu_planes_make(const struct pell_services *services, const struct pell_frame_shape *shape,
                                                     struct pell_gpu_planes *p);
void pell_gpu_planes_finish(struct pell_gpu_planes *p);

/* Buffers bound by passes. */
struct pell_gpu_buffer *pell_gpu_planes_buffer(const struct pell_gpu_planes *p, enum pell_gpu_plane plane);

/* Packs the frame's pixels into upload memory. `row` (may be NULL) is called for each row of the grid after it is packed, by any thread.
 * Returns the number of translucent pixels. */
int64_t pell_gpu_planes_pack(struct pell_gpu_planes *p, const struct pell_frame *in, const float *const light[3], const float *strength,
                             void (*row)(void *state, int row), void *state);
/* Packed row of the grid. */
struct pell_gpu_light *pell_gpu_planes_light_row(const struct pell_gpu_planes *p, int row);
struct pell_gpu_surface *pell_gpu_planes_surface_row(const struct pell_gpu_planes *p, int row);

/* The grid of a program's own device: the whole image. */
void pell_gpu_planes_whole(struct pell_gpu_planes *p, int width, int height);

/* Record: upload of the packed planes; download of the result, 16 bytes per pixel, or a copy to the program's buffer. */
void pell_gpu_planes_upload(const struct pell_gpu_planes *p, struct pell_gpu_commands *commands);
void pell_gpu_planes_download(const struct pell_gpu_planes *p, struct pell_gpu_commands *commands, struct pell_gpu_buffer *from);

/* Copies the result of the finished list to three planes of the frame, at translucent pixels. */
void pell_gpu_planes_unpack(struct pell_gpu_planes *p, float *const to[3]);

/* Times of the frame: "pack", the marks of the list, "unpack". `bytes`: memory traffic of a mark per pixel of the grid. */
void pell_gpu_planes_note(struct pell_gpu_planes *p, const struct pell_gpu_commands *commands, int64_t pixels,
                          int (*bytes)(const char *mark));
size_t pell_gpu_planes_times(const struct pell_gpu_planes *p, struct pell_pass_time *list, size_t size);

/* Number of workgroups with `of` invocations for `count` invocations. */
static inline uint32_t pell_gpu_groups(int64_t count, int of)
{
    return (uint32_t) ((count + of - 1) / of);
}

#endif
