/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "spread": light that went straight through thin parts is spread sideways, as a slab does.
 *
 * The stage "irradiance" finds what a slab transmits along one way through it. Light that enters at a point leaves around the point across:
 * the variance of that is known by thickness (struct pell_thickness_table). Each pixel's light is shared out between two Gaussians, with
 * variances a factor of four apart, whose mixture has its variance; light of all Gaussians is blurred together from the widest to the
 * narrowest, so that the edges of few taps of one are smoothed by the next. Taps are weighed by their distance in space, and lie on the
 * same object.
 *
 * Threads    one call at a time per set of planes.
 */
#ifndef PELL_RENDER_SPREAD_STAGE_H
#define PELL_RENDER_SPREAD_STAGE_H

#include "base/pool.h"
#include "render/spread/kernel.h"

#include <pellucid/frame.h>

struct pell_spread_params {
    struct pell_rect rect;                               /* of the translucent pixels */
    ptrdiff_t stride;                                    /* of all planes */
    const uint16_t *key;                                 /* pixels with equal numbers exchange light; 0: none */
    const uint16_t *material;                            /* scene material + 1 */
    const struct pell_thickness_table *const *thickness; /* per scene material; entries may be NULL */
    const float *depth;                                  /* mm */
    const float *way;                                    /* of struct pell_lighting */
    float depth_mm, fixed_mm;                            /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float *transmitted[3];                               /* is changed */
    float *sum[3], *half[3];                             /* room; may hold anything */
    uint8_t *lit[2];                                     /* room: pell_spread_blocks(stride) a row of the picture each */
};

/* Blocks of a row of which is known whether they hold light. */
static inline size_t pell_spread_blocks(ptrdiff_t stride)
{
    return (size_t) stride / PELL_SPREAD_BLOCK + 1;
}

/* Where light went straight, the least mm of a pixel there, and the largest variance, mm^2. */
struct pell_spread_found {
    struct pell_rect straight;
    float finest, widest;
};

enum { PELL_SPREAD_LEVELS = 8 }; /* the widest has a standard deviation of 2^7 times the narrowest's */

/* The Gaussians that light is shared out between, from the widest, number `levels`, to number 1. */
struct pell_spread_plan {
    int levels;
    float variance[PELL_SPREAD_LEVELS + 1]; /* mm^2: none, then of each */
    struct {
        float inverse;              /* 1/reach^2, 1/mm^2, */
        int taps, spacing;          /* and those to each side, px apart: */
    } blur[PELL_SPREAD_LEVELS + 1]; /* of each with what the next is narrower by */
    struct pell_rect around;        /* where light comes to, and what is beside */
};

/* `within`: the translucent pixels. False: nothing is spread. */
bool pell_spread_make_plan(const struct pell_spread_found *found, const struct pell_rect *within, struct pell_spread_plan *plan);

/* How many pixels it spread light over. */
int64_t pell_spread_render(struct pell_pool *pool, const struct pell_spread_params *params);

#endif
