/* SPDX-License-Identifier: MIT
 *
 * chain.h - common to all engines of the screen-space method: sums of Gaussians as a chain of blurs, and thickness tables.
 */
#ifndef PELL_SCREEN_SPACE_CHAIN_H
#define PELL_SCREEN_SPACE_CHAIN_H

#include "methods/screen_space/kernels.h"
#include "methods/screen_space/screen_space.h"

#include "render/engine.h"

struct screen_chain {
    struct pell_context *ctx; /* borrowed */
    struct screen_knobs knobs;
    size_t num_materials;
    struct pell_gaussians *profiles;        /* by material */
    struct pell_thickness_table *thickness; /* by material, or NULL */
    int steps;                              /* of the longest chain, without preblur steps */
    float *variance;                        /* see struct screen_work; SCREEN_PREBLUR rows come first */
    float (*blend)[3];
    float (*total)[3];
    double variance_max;                                             /* of a first step */
    float depth_mm, fixed_mm, ratio2, skip, correction, maxdd, unit; /* as in struct screen_work */
    int forms;
};

/* `chain` is zeroed. Call pell_ss_chain_finish even after a failure. */
PELL_NODISCARD enum pell_result pell_ss_chain_make(struct pell_context *ctx, const struct pell_frame_shape *shape,
                                                   const struct screen_knobs *knobs, struct screen_chain *chain);
void pell_ss_chain_finish(struct screen_chain *chain);

/* The number of steps to run before the first Gaussian, and the first step that blurs any pixel, for a frame whose largest pixel scale is
 * `scale` px^2 per mm^2. The tables of its steps begin (SCREEN_PREBLUR - preblur) rows after the chain's; they have preblur + chain->steps
 * rows. */
void pell_ss_chain_choose(const struct screen_chain *chain, float scale, int *preblur, int *first);

/* Names of stages: "blur ahead", "blur 1". */
const char *pell_ss_step_name(int step, int preblur);
/* "kernel 1": terms of a separable kernel. */
const char *pell_ss_term_name(int term);

/* Shows the result of a single step as an intermediate image: planes with this stride (0: the frame's). */
PELL_NODISCARD enum pell_result pell_ss_show(const struct screen_chain *chain, const struct pell_services *services,
                                             const struct pell_frame *in, const float *const light[3], ptrdiff_t stride, int step,
                                             int preblur);

#endif
