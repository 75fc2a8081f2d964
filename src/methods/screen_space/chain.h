/* SPDX-License-Identifier: MIT
 *
 * chain.h - what every engine's form of the screen-space method is made of: sums of Gaussians as a chain of blurs, and thickness tables.
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
    struct pell_gaussians *profiles;        /* of each material */
    struct pell_thickness_table *thickness; /* of each material, or NULL */
    int steps;                              /* of the longest chain, without those ahead */
    float *variance;                        /* see struct screen_work; SCREEN_PREBLUR rows come first */
    float (*blend)[3];
    float (*total)[3];
    double variance_max;                                             /* of a first step */
    float depth_mm, fixed_mm, ratio2, skip, correction, maxdd, unit; /* as in struct screen_work */
    int forms;
};

/* `chain` is zeroed. pell_ss_chain_finish when done, also where it failed. */
PELL_NODISCARD enum pell_result pell_ss_chain_make(struct pell_context *ctx, const struct pell_frame_shape *shape,
                                                   const struct screen_knobs *knobs, struct screen_chain *chain);
void pell_ss_chain_finish(struct screen_chain *chain);

/* How many steps to make ahead of the first, and the first that blurs any pixel, of a frame in which the largest pixel is `scale` px^2 per
 * mm^2. The tables of its steps begin (SCREEN_PREBLUR - preblur) rows behind the chain's; they are preblur + chain->steps. */
void pell_ss_chain_choose(const struct screen_chain *chain, float scale, int *preblur, int *first);

/* "blur ahead", "blur 1". */
const char *pell_ss_step_name(int step, int preblur);
/* "kernel 1": of a separable kernel's terms. */
const char *pell_ss_term_name(int term);

/* Shows what a step gave by itself, as an intermediate image: planes of a stride (0: the frame's). */
PELL_NODISCARD enum pell_result pell_ss_show(const struct screen_chain *chain, const struct pell_services *services,
                                             const struct pell_frame *in, const float *const light[3], ptrdiff_t stride, int step,
                                             int preblur);

#endif
