/* SPDX-License-Identifier: MIT
 *
 * pellucid/layers.h - computes reflectance and transmittance profiles of slabs and stacks of slabs.
 *
 * One layer is a multipole (Donner and Jensen 2005), layers are combined by the adding equations in the Hankel domain (d'Eon et al. 2007,
 * eqs. (3) to (5)). Light here is diffuse and excludes unscattered light; R + T = 1 only without absorption.
 *
 * Units      thickness and radii mm, coefficients 1/mm, profiles 1/mm^2, frequencies rad/mm; eta is a layer's own index of refraction.
 * Sides      + is light from above (onto layer 0), - from below.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged, because only the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_LAYERS_H
#define PELLUCID_LAYERS_H

#include <pellucid/gaussians.h>
#include <pellucid/medium.h>
#include <pellucid/profile.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PELL_LAYERS_MAX 32
#define PELL_THICKNESS_MIN 1e-6 /* mm */
#define PELL_THICKNESS_MAX 1e6

/* A homogeneous layer between two parallel planes. */
struct pell_medium_layer {
    double sigma_a[3];         /* absorption, [0, PELL_SIGMA_MAX] */
    double sigma_s_reduced[3]; /* sigma_s (1 - g), [0, PELL_SIGMA_MAX]; sigma_a + sigma_s_reduced >= PELL_SIGMA_T_MIN */
    double g[3];               /* mean cosine, |g| <= PELL_G_MAX; diffusion ignores it */
    double eta;                /* index of refraction; it and its ratios to both neighbours are in [PELL_ETA_MIN, PELL_ETA_MAX] */
    double thickness;          /* [PELL_THICKNESS_MIN, PELL_THICKNESS_MAX], or INFINITY in the last layer: a half-space */
};

/* Layers from top to bottom. All other fields may be 0. A value of fixed size, 4 KiB. */
struct pell_stack {
    int count; /* 1..PELL_LAYERS_MAX */
    struct pell_medium_layer layer[PELL_LAYERS_MAX];
    double eta_above, eta_below;           /* index of the media outside, [PELL_ETA_MIN, PELL_ETA_MAX]; 0 stands for 1 */
    enum pell_fresnel_model fresnel;       /* how a boundary's average reflectance is computed */
    double roughness[PELL_LAYERS_MAX + 1]; /* boundary i is above layer i; [0, 1]; 0: smooth; else GGX (pell_fresnel_diffuse_rough) */
    double A[PELL_LAYERS_MAX][2];          /* (1 + Fdr)/(1 - Fdr) at a layer's [0] top and [1] bottom, [1, 1e6], instead of the
                                              value from indices and roughness; 0: not given */
};

/* The value out of range: layer.field[channel]; layer and channel are -1 if the field has none. `field` is constant text. */
struct pell_stack_fault {
    int layer, channel;
    const char *field;
    double value, min, max;
};
PELL_API bool pell_stack_valid(const struct pell_stack *stack, struct pell_stack_fault *fault);

/* Layer i alone, with the boundaries that it has in the stack. PELL_ERR_INVALID if there is no layer i. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_layer(const struct pell_stack *stack, int i, struct pell_stack *out);

/* The four responses: reflectance and transmittance for light from above (plus) and from below (minus). A stack that ends in a half-space
 * has only the first; the others are 0. */
enum pell_stack_part { PELL_STACK_R_PLUS = 0, PELL_STACK_T_PLUS, PELL_STACK_R_MINUS, PELL_STACK_T_MINUS, PELL_STACK_PARTS };

/* Limitations that apply to a result. */
enum pell_stack_flags {
    /* A layer's mean free path exceeds its thickness, where the sum of poles is undefined: its closed form is used,
     * scaled to R + T = 1 where it would exceed that (by up to 5 %, at albedos around 0.75). */
    PELL_STACK_THIN = 1,
    /* A mean free path exceeds thickness + extrapolation distance: diffusion is not valid, so the layer reflects nothing; its transmittance
     * is that of the closed form at this bound, and rises linearly to 1 as the thickness goes to 0. */
    PELL_STACK_CLEAR = 2,
    /* The transform of such thin layers has no inverse, or one narrower than a sixteenth of the stack: light passes straight through these
     * layers instead, and the core of T(r) has that width. Totals do not change. */
    PELL_STACK_WIDENED = 4,
};

/* One layer of a medium in air: `thickness_mm` > 0; INFINITY: a half-space. */
PELL_API void pell_stack_of_medium(const struct pell_medium *medium, double thickness_mm, struct pell_stack *out);

/* Totals, Int 2 pi r f dr, of a channel in closed form; one of `out` per part. `flags` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_totals(const struct pell_stack *stack, int channel, double out[PELL_STACK_PARTS],
                                                           unsigned *flags);

/* The two-dimensional Fourier (Hankel) transforms 2 pi Int J0(s r) f(r) r dr at a radial frequency s >= 0, in closed form. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_transforms(const struct pell_stack *stack, int channel, double s,
                                                               double out[PELL_STACK_PARTS]);

/* R+, T+, R- or T- of a stack of one layer at a radius by the sum of 2n + 1 dipoles. n grows until the remainder is less than
 * `tolerance` ([1e-14, 1]) of the sum, or `dipoles_max` (1..100001) are in use; *dipoles (may be NULL) is their number. A half-space is
 * one dipole. PELL_ERR_UNSUPPORTED where the mean free path reaches or exceeds the thickness. */
PELL_API PELL_NODISCARD enum pell_result pell_slab_poles(const struct pell_stack *stack, int channel, enum pell_stack_part part,
                                                         double r_mm, double tolerance, int dipoles_max, double *out, int *dipoles);

/* --- Solvers ------------------------------------------------------------------------------------------------------------------ */

/* Profiles of a channel at `count` radii >= 0 by the Hankel solver: one of `out` per part, NULL if not needed. Absolute error 1e-9 of
 * f(0), or less; 0 beyond 1e8 times the shortest length. Needs 170 KiB of stack. `flags` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_hankel(const struct pell_stack *stack, int channel, const double *r_mm, size_t count,
                                                           double *const out[PELL_STACK_PARTS], unsigned *flags);

/* A part of a channel as a profile, by the Hankel solver. R(r) < 0, which occurs at large radii in thin absorbing slabs under a strongly
 * reflecting boundary, becomes 0, and the rest is scaled to the total. `flags` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_profile(const struct pell_stack *stack, int channel, enum pell_stack_part part,
                                                            struct pell_profile *out, unsigned *flags);

/* Parameters of the algebra of Gaussians; zeroes are the defaults. */
struct pell_stack_gaussians_params {
    bool analytic;         /* slabs by the closed-form pole fits of appendix A (energy kept): signed poles, so signed weights, too */
    double variance;       /* of the narrow Gaussian, mm^2; 0: the smallest min(l, d - l)^2/64 over layers (d'Eon's bound, sharpened) */
    int block;             /* powers 0..block are kept singly, higher ones in octaves of block/2: even, 8..PELL_STACK_BLOCK_MAX; 0: 32 */
    double energy_loss;    /* threshold at which the series over bounces between layers ends, [1e-15, 0.1]; 0: 1e-6 */
    bool reflectance_only; /* R+ alone, at less than half the cost; the other parts are empty */
};

#define PELL_STACK_BLOCK_MAX 128
#define PELL_STACK_OCTAVES 48
#define PELL_STACK_SET_MAX (PELL_STACK_BLOCK_MAX + 1 + PELL_STACK_OCTAVES * PELL_STACK_BLOCK_MAX / 2)

/* One channel's responses as sets of Gaussians with common variances, all multiples of the narrow one, and weights >= 0 (but for
 * `analytic`). 130 KiB. */
struct pell_stack_sets {
    double narrow;  /* the variance of the narrow Gaussian, mm^2 */
    int count;      /* number of Gaussians in each set */
    int terms;      /* number of terms of the longest series over bounces */
    unsigned flags; /* enum pell_stack_flags */
    double clipped; /* largest share of a part in negative weights that became 0 (the rest is scaled to the total): the remaining
                        error for a thin slab under a strongly reflecting boundary, whose R(r) is negative at large radii */
    double variance[PELL_STACK_SET_MAX]; /* mm^2, rising, > 0 */
    double weight[PELL_STACK_PARTS][PELL_STACK_SET_MAX];
};

/* Size of the workspace of pell_stack_gaussians in bytes, for any stack. The caller allocates it, aligned as by malloc. */
PELL_API size_t pell_stack_workspace_size(const struct pell_stack_gaussians_params *params);

/* Combines the layers of a channel by the algebra of Gaussians. `params` may be NULL. *out is only valid on success. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_gaussians(const struct pell_stack *stack, int channel,
                                                              const struct pell_stack_gaussians_params *params, void *workspace,
                                                              size_t workspace_size, struct pell_stack_sets *out);

/* A part's set as a profile, interpolated between nodes. R(r) < 0, which weights of both signs (`analytic`) may cause at large radii,
 * becomes 0, and the rest is scaled to the total. PELL_ERR_INVALID (and *out zero) for an empty set or an invalid part. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_sets_profile(const struct pell_stack_sets *sets, enum pell_stack_part part,
                                                                 struct pell_profile *out);

/* Three channels' sets of a part reduced to `count` (2..PELL_GAUSSIANS_MAX) Gaussians with shared variances, geometric, the best of several
 * ranges: weights >= 0 by least squares of error (10), each channel's total and second moment kept (the moment only where it is above 0, as
 * it always is but for weights of both signs). Half a millisecond; pell_fit_profiles finds better variances in several, and keeps the total
 * alone; pell_gaussian_set_reduce is for variances of the caller's choice. *out has count 0 if no channel has light, and on
 * PELL_ERR_INVALID: a count, part or set out of range. */
PELL_API PELL_NODISCARD enum pell_result pell_stack_reduce(const struct pell_stack_sets *const channel[3], enum pell_stack_part part,
                                                           int count, struct pell_gaussians *out);

#ifdef __cplusplus
}
#endif
#endif
