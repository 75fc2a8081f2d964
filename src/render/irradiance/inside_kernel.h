/* SPDX-License-Identifier: MIT
 *
 * inside_kernel.h - private to src/render/irradiance: effects of a solid's shape, and of the light inside it, on the light of 16 points.
 * inside_kernel.c is compiled once per SIMD level.
 */
#ifndef PELL_IRRADIANCE_INSIDE_KERNEL_H
#define PELL_IRRADIANCE_INSIDE_KERNEL_H

#include "render/indirect/stage.h"
#include "render/irradiance/kernel.h"

/* Factors of all entering light, for the methods, and of single-scattered light. */
struct pell_gains {
    _Alignas(64) float all[3][16], single[3][16];
    float between[3][16]; /* `all` where transport between faces is added */
};

/* Light inside the solids; 0 where it is unknown. */
struct pell_inside {
    _Alignas(64) float sum_weight[3][16]; /* [0, 1]: weight of `transmitted`, as opposed to straight transmission by thickness */
    float transmitted[3][16], solved[3][16], light[3][16]; /* as in struct pell_indirect_inside, the light as it leaves toward the camera */
    float entered[3][16];                                  /* the same */
    float beam[3][16];                                     /* forward-scattered light toward the camera */
};

struct pell_inside_kernels {
    /* Sets the gains and the lanes' shift for curvature. */
    void (*apply_curvature)(const struct pell_irradiance_params *params, const struct pell_curvature_effects *effects,
                            struct pell_lanes *lanes, struct pell_gains *gains);
    /* Replaces the gains where light in the solid was solved, and marks the lanes whose transmitted light is found by straight rays.
     * `entering_only`: transmitted light is not needed. */
    void (*apply_solids)(const struct pell_irradiance_params *params, const struct pell_indirect_insides *found, bool entering_only,
                         const struct pell_lanes *lanes, struct pell_gains *gains, struct pell_inside *inside, int32_t *straight);
    void (*scale_sums)(const struct pell_gains *gains, struct pell_sums *sums);
    void (*add_transmitted)(const struct pell_inside *inside, struct pell_sums *sums);
};

PELL_SIMD_TABLES(struct pell_inside_kernels, pell_inside_kernels);

#endif
