/* SPDX-License-Identifier: MIT
 * kernel.h - shared by cpu.c and kernel.c. */
#ifndef PELL_SURFACE_KERNEL_H
#define PELL_SURFACE_KERNEL_H

#include "base/simd.h"
#include "render/surface/mipmaps.h"

/* Packets of 4 x 4 pixels: the rays of a head take a quarter less time than in packets of 16 x 1; 8 x 2 is in between. */
#define SURFACE_PACKET_SIDE 4
#define SURFACE_BAND_ROWS 8

/* Statistics of a band of rows, or of a tile of the raster. Sums and extremes of integers, which do not depend on the order. */
struct surface_band {
    _Alignas(64) struct pell_rect covered, translucent; /* empty: x0 > x1 */
    int64_t covered_pixels, translucent_pixels, rays;
};

struct surface_job {
    const struct pell_rays *rays;
    const struct pell_scene *scene;
    const struct pell_view *view;
    struct pell_surface *out;
    struct pell_rect rect; /* pixels to trace */
    struct surface_band *bands;
    const struct surface_decode *decode;
    bool bare; /* trace the rays only */
};

struct pell_surface_kernels {
    void (*band)(const struct surface_job *job, int band);
    void (*tile)(const struct surface_job *job, int tile); /* of job->out->raster */
    /* Computes the surface at 16 hits (bits of `hits`: valid ones) into the pixels of job->out, which is 4 x 4 with a stride of 4. The
     * viewer is at the origin of packet->ray. */
    void (*look)(const struct surface_job *job, const struct pell_ray_hit16 *packet, uint32_t hits);
};

#endif
