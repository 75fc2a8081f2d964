/* SPDX-License-Identifier: MIT
 *
 * kernel.h - private to the folder: what follows from the shape at 16 points, built once per SIMD level (kernel.c).
 */
#ifndef RENDER_CURVATURE_KERNEL_H
#define RENDER_CURVATURE_KERNEL_H

#include "base/simd.h"
#include "render/curvature/stage.h"
#include "shared/curvature.h"

/* Of R, G and B. */
struct curvature_bent {
    float gain[3];
    float opposed[3]; /* the same for profiles that are turned between faces at an angle */
    float across[3];  /* what of it goes through a ball, over the profile's total */
    float all[3];     /* all that a solid of this curvature returns, over the profile's total */
};

/* What a material makes of shapes. */
struct curvature_law {
    struct curvature_bent bent[PELL_CURVATURE_GAINS];
    /* Of a slab, over the half-space's R, at the thinness x/(step (1 - x)), x = i/(GAINS - 1): R + T, T, and what goes forward beside it
     * (optics/medium/forward.h), which no half-space returns; and T over what goes through by optics/medium/opposed.h; of R, G and B, and
     * 0. */
    float slab[PELL_CURVATURE_GAINS][4], through[PELL_CURVATURE_GAINS][4], forward[PELL_CURVATURE_GAINS][4],
        crossed[PELL_CURVATURE_GAINS][4];
    /* Of a ball as thick, all that it returns by optics/medium/small.h, with what T has less of even light than the rest; and how far that
     * holds. */
    float ball[PELL_CURVATURE_GAINS][4], small[PELL_CURVATURE_GAINS][4];
    bool there;
    float step;     /* mm: the distance of averaging */
    float limit;    /* 1/mm */
    float path[3];  /* mean free path over index, mm */
    float farthest; /* mm: nothing gets through thicker parts */
};

/* The shape at 16 points; 0: nothing happens there. */
struct curvature_shapes {
    _Alignas(64) float mean[16], thinness[16];
    const struct curvature_law *law[16];
};

struct curvature_kernels {
    void (*effects)(const struct curvature_shapes *shapes, struct pell_curvature_effects *out);
};

PELL_SIMD_TABLES(struct curvature_kernels, curvature_kernels);

#endif
