/* SPDX-License-Identifier: MIT
 *
 * hierarchical.h - declarations shared by the files of this method. Its only external symbol is pell_method_hierarchical.
 */
#ifndef PELL_HIERARCHICAL_H
#define PELL_HIERARCHICAL_H

#include "transport/light_tree.h"
#include "transport/solids.h"

#include <pellucid/method.h>

enum hierarchical_as { HI_BEST, HI_PAPER };
enum hierarchical_near { HI_NEAR_CORRECTED, HI_NEAR_PLAIN };

struct hierarchical_knobs {
    int as; /* enum hierarchical_as */
    float error;
    float density;
    int points;
    int near; /* enum hierarchical_near */
    int gaussians;
    bool strength;
};

/* --- radial.c: a profile as a table over the squared radius ---------------------------------------------------------------------- */

#define HI_STRENGTHS 65 /* strengths, uniform over [0, 1] */

/* R(r) of three channels, normalised if white. Nodes are uniform within each octave of r^2, so that the node index consists of bits of the
 * float; linear interpolation. R is constant below the first node and 0 beyond the last. */
struct hierarchical_radial {
    struct pell_context *ctx;
    float (*node)[4];
    int first, count; /* of node 0: float bits >> HI_SHIFT; number of nodes less one */
    double total[3];
    /* For a strength of i / (HI_STRENGTHS - 1): light returned inside the near window, and the mean of R over one sample's disc. */
    float window[HI_STRENGTHS][3], core[HI_STRENGTHS][3];
};

#define HI_SHIFT 17 /* 64 nodes per octave of r^2 */

/* Smallest of the channels' radii that contain a quarter of the light, the unit of the sample density. mm, > 0. */
double hierarchical_radial_length(const struct pell_frame_material *m);
/* The profiles of `m`, or the sum of `gaussians` (> 0) Gaussians fitted to them. */
PELL_NODISCARD enum pell_result hierarchical_radial_fit(struct pell_context *ctx, const struct pell_frame_material *m, int gaussians,
                                                        struct pell_profile out[3]);
/* R from `profile`, R, G and B, for radii of `low` to `high` mm; a window of `reach` mm, discs of `disc` mm. `r` is zeroed; call the finish
 * function even after a failure. */
PELL_NODISCARD enum pell_result hierarchical_radial_make(struct pell_context *ctx, const struct pell_profile profile[3], bool white,
                                                         double low, double high, double reach, double disc, struct hierarchical_radial *r);
void hierarchical_radial_finish(struct hierarchical_radial *r);

/* --- samples.c: surface sample points --------------------------------------------------------------------------------------------- */

struct hierarchical_sample {
    uint32_t mesh, triangle;
    float u, v; /* barycentric */
    float area; /* mm^2 that it represents */
};

/* `count` sample points with a minimum distance from one another, in the order of the solid's curve; the caller owns *out. Temporarily
 * needs about 120 bytes for each of two candidates per sample. The same bits for any number of threads. */
PELL_NODISCARD enum pell_result hierarchical_samples_make(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                          const struct pell_solid *solid, size_t count, struct hierarchical_sample **out);

extern const struct pell_method_engine pell_hierarchical_cpu;

#endif
