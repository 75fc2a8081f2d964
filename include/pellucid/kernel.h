/* SPDX-License-Identifier: MIT
 *
 * pellucid/kernel.h - converts profiles to convolution kernels for a renderer: taps of a Gaussian blur, separable kernels, lookup tables.
 *
 * Units      offsets and radii mm, variances mm^2, profiles 1/mm^2; weights include the profile's total, so that convolving with a kernel
 *            multiplies light by the diffuse reflectance: divide by the total if a texture holds the albedo.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged, because only the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated, arrays are the caller's.
 */
#ifndef PELLUCID_KERNEL_H
#define PELLUCID_KERNEL_H

#include <pellucid/gaussians.h>

#ifdef __cplusplus
extern "C" {
#endif

/* --- One blur for each Gaussian ------------------------------------------------------------------------------------------------ */

#define PELL_KERNEL_TAPS_MAX 65

/* `taps` (odd, 3..PELL_KERNEL_TAPS_MAX) equally spaced samples of a one-dimensional Gaussian of that variance (> 0): offsets rise and
 * are symmetric, weights sum to 1 and have exactly this variance, Sum weight offset^2 = variance_mm2. Two passes, along x and y, blur by
 * the Gaussian G(v, r). 7 taps reach 2.7 standard deviations. */
PELL_API PELL_NODISCARD enum pell_result pell_kernel_gaussian_taps(double variance_mm2, int taps, double *offset_mm, double *weight);

/* A chain of blurs, each applied to the preceding result (d'Eon et al. 2007, section 5.4): blur i widens by step[i] = variance[i] -
 * variance[i - 1], and adding into one target, target = lerp(target, blurred, blend[i]) per channel, gives Sum weight[i][c] blurred_i /
 * total after the last: blend[i][c] = weight[i][c] / Sum_{j <= i} weight[j][c] (0 while that sum is 0). */
struct pell_kernel_chain {
    int count;
    double step_mm2[PELL_GAUSSIANS_MAX]; /* >= 0 */
    double blend[PELL_GAUSSIANS_MAX][3]; /* [0, 1] */
    double total[3];                     /* factor for the result of the chain */
};

/* PELL_ERR_INVALID unless variances rise, all values are finite and weights are >= 0. */
PELL_API PELL_NODISCARD enum pell_result pell_kernel_chain_make(const struct pell_gaussians *g, struct pell_kernel_chain *out);

/* --- Separable kernels --------------------------------------------------------------------------------------------------------- */

#define PELL_KERNEL_RANK_MAX 3

struct pell_separable_params {
    int taps;         /* odd, 3..PELL_KERNEL_TAPS_MAX; 0: 25 */
    int rank;         /* 1..PELL_KERNEL_RANK_MAX pairs of passes; 0: 1 */
    double extent_mm; /* half the width; 0: the largest of the channels' radii that contain 98 % of the light */
    double spread;    /* [1, 4]: offsets grow as |i|^spread, so that taps are dense near the centre; 0: 2 */
};

/* R(sqrt(x^2 + y^2)) ~ Sum_k sign[k][c] a_kc(x) a_kc(y), the least-squares approximation of its rank (an eigenvalue problem, as R is
 * symmetric): Jimenez, Zsolnai, Jarabo et al. 2015, "Separable Subsurface Scattering", section 4, for any profile. One rank is two passes
 * with the same weights; ranks add. Channel c of a blurred image is
 *     Sum_k sign[k][c] Sum_j weight[k][j][c] ( Sum_i weight[k][i][c] image(x + offset[i], y + offset[j]) ). */
struct pell_separable {
    int taps, rank;
    double extent_mm;
    double offset_mm[PELL_KERNEL_TAPS_MAX];                       /* rising, symmetric, the middle one 0 */
    double weight[PELL_KERNEL_RANK_MAX][PELL_KERNEL_TAPS_MAX][3]; /* weights of one pass, spacing included */
    double sign[PELL_KERNEL_RANK_MAX][3];                         /* 1 or -1; 0 for a channel without light */
    double total[3];   /* Sum_k sign (Sum_i weight)^2: the profile's total exactly, the light outside the extent included */
    double outside[3]; /* fraction of the light outside the square of the extent */
    double error[3];   /* sqrt(Int (R - separable)^2 / Int R^2) over the square, before discretisation into taps: the error of the rank */
};

/* `params` may be NULL. PELL_ERR_INVALID for parameters out of range, or three profiles without light. A profile that is unbounded at r = 0
 * is averaged over the finest cells. Needs about 100 KiB of stack and milliseconds. */
PELL_API PELL_NODISCARD enum pell_result pell_separable_make(const struct pell_profile profiles[3],
                                                             const struct pell_separable_params *params, struct pell_separable *out);

/* --- Lookup tables ------------------------------------------------------------------------------------------------------------- */

/* `count` >= 1 texels over [0, r_max_mm]; texel i is the mean of R over the ring i dr <= r < (i + 1) dr, dr = r_max/count, from the
 * profile's flux: the table's rings hold exactly the light that the profile has inside r_max. 1/mm^2. */
PELL_API PELL_NODISCARD enum pell_result pell_kernel_table_value(const struct pell_profile *profile, double r_max_mm, float *texel,
                                                                 size_t count);

/* The light in each of these rings (the sum is the total times the cdf at r_max): weights for samples on rings. */
PELL_API PELL_NODISCARD enum pell_result pell_kernel_table_ring(const struct pell_profile *profile, double r_max_mm, float *texel,
                                                                size_t count);

/* Radii with equal light between them: texel i holds pell_profile_sample at (i + 1/2)/count, mm; for importance sampling. */
PELL_API PELL_NODISCARD enum pell_result pell_kernel_table_radius(const struct pell_profile *profile, float *texel, size_t count);

/* Scattering pre-integrated around a ring (Penner 2011, "Pre-Integrated Skin Shading", SIGGRAPH course): the radiant exitance of a sphere
 * of radius rho under a directional light of irradiance 1, at an angle theta from the light, along a great circle,
 *     D(theta, rho) = total Int_-pi^pi max(cos(theta + x), 0) R(2 rho |sin(x/2)|) dx / Int_-pi^pi R(2 rho |sin(x/2)|) dx.
 * texel[j * width + i]: cos theta = -1 + 2 (i + 1/2)/width, 1/rho = curvature_max (j + 1/2)/height, 1/mm. */
PELL_API PELL_NODISCARD enum pell_result pell_kernel_table_sphere(const struct pell_profile *profile, double curvature_max, float *texel,
                                                                  size_t width, size_t height);

#ifdef __cplusplus
}
#endif
#endif
