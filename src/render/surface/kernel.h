/* SPDX-License-Identifier: MIT
 * kernel.h - what surface.c and the kernels of packet.c share. */
#ifndef PELL_SURFACE_PACKET_H
#define PELL_SURFACE_PACKET_H

#include "base/simd.h"
#include "render/surface/mipmaps.h"

/* Packets of 4 x 4 pixels: against 16 x 1 they take a quarter less time for the rays of a head, and 8 x 2 is between. */
#define SURFACE_PACKET_SIDE 4
#define SURFACE_BAND_ROWS 8

/* What a band of rows saw, or a tile of the raster. Summed in order, but sums and extremes of integers don't depend on it. */
struct surface_band {
    _Alignas(64) struct pell_rect covered, translucent; /* empty: x0 > x1 */
    int64_t covered_pixels, translucent_pixels, rays;
};

struct surface_job {
    const struct pell_rays *rays;
    const struct pell_scene *scene;
    const struct pell_view *view;
    struct pell_surface *out;
    struct pell_rect rect; /* to trace */
    struct surface_band *bands;
    const struct surface_decode *decode;
    bool bare; /* trace the rays only */
};

struct pell_surface_kernels {
    void (*band)(const struct surface_job *job, int band);
    void (*tile)(const struct surface_job *job, int tile); /* of job->out->raster */
    /* What 16 hits look like (bits of `hits`: which), into the pixels of job->out, which is 4 x 4 with a stride of 4. The viewer is where
     * packet->ray comes from. */
    void (*look)(const struct surface_job *job, const struct pell_ray_hit16 *packet, uint32_t hits);
};

#endif
