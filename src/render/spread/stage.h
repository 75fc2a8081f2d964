/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "spread": straight transmission through thin parts is blurred sideways, as by a slab.
 *
 * The stage "irradiance" finds what a slab transmits along one path through it. Light that enters at a point leaves around the opposite
 * point, with a variance that is tabulated by thickness (struct pell_thickness_table). Each pixel's light is split between two Gaussians,
 * with variances a factor of four apart, whose mixture has its variance; the light of all Gaussians is blurred together from the widest to
 * the narrowest, so that artefacts of the few taps of one are smoothed by the next. Taps are weighted by their distance in space, and must
 * be on the same object.
 *
 * Threads    one call at a time per set of planes.
 */
#ifndef PELL_RENDER_SPREAD_STAGE_H
#define PELL_RENDER_SPREAD_STAGE_H

#include "base/pool.h"
#include "render/spread/kernel.h"

#include <pellucid/frame.h>

struct pell_spread_params {
    struct pell_rect rect;                               /* bounds of the translucent pixels */
    ptrdiff_t stride;                                    /* for all planes */
    const uint16_t *key;                                 /* only pixels with equal keys exchange light; 0: none */
    const uint16_t *material;                            /* scene material + 1 */
    const struct pell_thickness_table *const *thickness; /* per scene material; entries may be NULL */
    const float *depth;                                  /* mm */
    const float *path;                                   /* as in struct pell_lighting */
    float depth_mm, fixed_mm;                            /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float *transmitted[3];                               /* modified in place */
    float *sum[3], *half[3]; /* scratch: the blurred light, and that of the first axis; initial content is ignored */
    uint8_t *lit[2];         /* scratch: pell_spread_blocks(stride) entries per row of the image each */
};

/* Number of blocks per row for which it is recorded whether they contain light. */
static inline size_t pell_spread_blocks(ptrdiff_t stride)
{
    return (size_t) stride / PELL_SPREAD_BLOCK + 1;
}

/* Bounds of pixels with straight transmission, the least width of a pixel there, mm, and the largest variance, mm^2. */
struct pell_spread_found {
    struct pell_rect straight;
    float finest, widest;
};

enum { PELL_SPREAD_LEVELS = 8 }; /* the widest has a standard deviation of 2^7 times the narrowest's */

/* The Gaussians between which light is split, from the widest, level `levels`, to level 1. */
struct pell_spread_plan {
    int levels;
    float variance[PELL_SPREAD_LEVELS + 1]; /* mm^2: 0, then of each Gaussian */
    struct {
        float inverse;              /* 1/reach^2, 1/mm^2 */
        int taps, spacing;          /* taps to each side, and their spacing, px */
    } blur[PELL_SPREAD_LEVELS + 1]; /* blurs by the excess of variance over the next narrower Gaussian */
    struct pell_rect around;        /* pixels that receive light, and those adjacent */
};

/* `within`: bounds of the translucent pixels. Returns false if no light is spread. */
bool pell_spread_make_plan(const struct pell_spread_found *found, const struct pell_rect *within, struct pell_spread_plan *plan);

/* Returns the number of pixels that light was spread over. */
int64_t pell_spread_render(struct pell_pool *pool, const struct pell_spread_params *params);

#endif
