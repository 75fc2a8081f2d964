/* SPDX-License-Identifier: MIT
 *
 * multiple.h - light that is scattered more than once in layers: which of it leaves how far from where it entered, for the depths of the
 * layers below each point.
 *
 * The profile of the layers (diffusion; of one medium the profile that its material has) less that of light scattered once, which the march
 * finds, at a few sets of depths; between them weights are interpolated. All sets share variances, so that one chain of blurs serves all.
 */
#ifndef PELL_LAYERED_MULTIPLE_H
#define PELL_LAYERED_MULTIPLE_H

#include "transport/medium_layers.h"

#include <pellucid/frame.h>

enum {
    LAYERED_GAUSSIANS = 6,
    LAYERED_SETS = 12, /* of depths, at most */
};

struct layered_multiple {
    int layers, sets; /* sets 0: no light is scattered more than once */
    double variance[LAYERED_GAUSSIANS];
    float bend[PELL_LAYERS_MOST];                   /* 1/mm: depth d counts as x = bend d/(1 + bend d) */
    float at[LAYERED_SETS][PELL_LAYERS_MOST];       /* x of each set's layers */
    float cardinal[LAYERED_SETS + 1][LAYERED_SETS]; /* weight of set s = Sum_t |x - at[t]| cardinal[t][s] + cardinal[sets][s] */
    float weight[LAYERED_SETS][LAYERED_GAUSSIANS][3];
};

/* R(r), 1/mm^2, of light at right angles that is scattered once in a channel of layers with these bottoms (mm, rising), and its total. `r`
 * > 0, mm; a smooth boundary. */
double layered_single_rd(const struct pell_medium_layers *layers, const float *bottoms, int channel, double r);
double layered_single_total(const struct pell_medium_layers *layers, const float *bottoms, int channel);

/* Of a material as its meshes show it. `frame`: what the frame says of it. */
PELL_NODISCARD enum pell_result layered_multiple_make(struct pell_context *ctx, const struct pell_scene *scene, int material,
                                                      const struct pell_medium_layers *layers, const struct pell_frame_material *frame,
                                                      struct layered_multiple *out);

/* Weights of the sets below a point whose layers have these bottoms; their sum is 1. */
void layered_multiple_blend(const struct layered_multiple *m, const float *bottoms, float *share);

#endif
