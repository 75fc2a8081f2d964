/* SPDX-License-Identifier: MIT
 *
 * multiple.h - multiple scattering in layers: diffusion profiles by the depths of the layers below each point.
 *
 * The profile of the layers (diffusion; for a single medium the profile of its material) minus single scattering, which the march computes,
 * at a few sets of depths, with weights that interpolate between them. All sets share variances, so that one blur chain serves all.
 */
#ifndef PELL_LAYERED_MULTIPLE_H
#define PELL_LAYERED_MULTIPLE_H

#include "transport/medium_layers.h"

#include <pellucid/frame.h>

enum {
    LAYERED_GAUSSIANS = 6,
    LAYERED_SETS = 12, /* maximum number of depth sets */
};

struct layered_multiple {
    int layers, sets; /* sets 0: no multiple scattering */
    double variance[LAYERED_GAUSSIANS];
    float bend[PELL_LAYERS_MOST];                   /* 1/mm: depth d maps to x = bend d/(1 + bend d) */
    float at[LAYERED_SETS][PELL_LAYERS_MOST];       /* x of the layers of each set */
    float cardinal[LAYERED_SETS + 1][LAYERED_SETS]; /* weight of set s = Sum_t |x - at[t]| cardinal[t][s] + cardinal[sets][s] */
    float weight[LAYERED_SETS][LAYERED_GAUSSIANS][3];
};

/* R(r), 1/mm^2, of single scattering in one channel at normal incidence, for layers with these bottoms (mm, increasing), and its total. `r`
 * > 0, mm; a smooth boundary. */
double layered_single_rd(const struct pell_medium_layers *layers, const float *bottoms, int channel, double r);
double layered_single_total(const struct pell_medium_layers *layers, const float *bottoms, int channel);

/* Makes the profiles of a material as its meshes use it. `frame`: the frame's version of the material. */
PELL_NODISCARD enum pell_result layered_multiple_make(struct pell_context *ctx, const struct pell_scene *scene, int material,
                                                      const struct pell_medium_layers *layers, const struct pell_frame_material *frame,
                                                      struct layered_multiple *out);

/* Weights of the sets at a point whose layers have these bottoms; they sum to 1. */
void layered_multiple_blend(const struct layered_multiple *m, const float *bottoms, float *fraction);

#endif
