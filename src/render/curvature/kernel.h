/* SPDX-License-Identifier: MIT
 *
 * kernel.h - private to the folder: effects of the shape at 16 points; kernel.c is compiled once per SIMD level.
 */
#ifndef RENDER_CURVATURE_KERNEL_H
#define RENDER_CURVATURE_KERNEL_H

#include "base/simd.h"
#include "render/curvature/stage.h"
#include "shared/curvature.h"

/* Entry of a table over curvature, for R, G and B. */
struct curvature_bent {
    float gain[3];
    float opposed[3]; /* the same for profiles that are corrected between faces at an angle */
    float across[3];  /* transmission through a ball, over the profile's total */
    float all[3];     /* total return of a solid with this curvature, over the profile's total */
};

/* Response of a material to shapes. */
struct curvature_response {
    struct curvature_bent bent[PELL_CURVATURE_GAINS];
    /* For a slab, over the half-space's R, at the thinness x/(step (1 - x)), x = i/(GAINS - 1): R + T; T; forward-scattered light in
     * addition (optics/medium/forward.h), which no half-space returns; and T over the transmission of optics/medium/opposed.h; for R, G
     * and B, and 0. */
    float slab[PELL_CURVATURE_GAINS][4], through[PELL_CURVATURE_GAINS][4], forward[PELL_CURVATURE_GAINS][4],
        crossed[PELL_CURVATURE_GAINS][4];
    /* For a ball as thick: total return by optics/medium/small.h, corrected for T of uniform light; and the confidence of that. */
    float ball[PELL_CURVATURE_GAINS][4], small[PELL_CURVATURE_GAINS][4];
    bool scatters;
    float step;          /* mm: the distance of averaging */
    float limit;         /* 1/mm */
    float path[3];       /* mean free path over index, mm */
    float max_thickness; /* mm: thicker parts transmit nothing */
};

/* Shape at 16 points; 0: no effect. */
struct curvature_shapes {
    _Alignas(64) float mean[16], thinness[16];
    const struct curvature_response *response[16];
};

struct curvature_kernels {
    void (*effects)(const struct curvature_shapes *shapes, struct pell_curvature_effects *out);
};

PELL_SIMD_TABLES(struct curvature_kernels, curvature_kernels);

#endif
