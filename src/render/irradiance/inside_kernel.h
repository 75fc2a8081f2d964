/* SPDX-License-Identifier: MIT
 *
 * inside_kernel.h - private to src/render/irradiance: what the shape of a solid and the light inside of it do to the light of 16 points,
 * built once per SIMD level (inside_kernel.c).
 */
#ifndef PELL_IRRADIANCE_INSIDE_KERNEL_H
#define PELL_IRRADIANCE_INSIDE_KERNEL_H

#include "render/indirect/stage.h"
#include "render/irradiance/kernel.h"

/* Factors of all light that enters, for the methods, and of what is scattered once below the surface. */
struct pell_gains {
    _Alignas(64) float all[3][16], once[3][16];
    float between[3][16]; /* `all` where what goes between faces is added */
};

/* What is known of light inside of the solids; 0 where nothing is. */
struct pell_inside {
    _Alignas(64) float thick[3][16]; /* share of transmitted light that is `through`, and not sought straight */
    float through[3][16], solved[3][16], light[3][16], beam[3][16];
};

struct pell_inside_kernels {
    /* Fills in the gains and the lanes' shift. */
    void (*bend)(const struct pell_irradiance_params *params, const struct pell_curvature_effects *effects, struct pell_lanes *lanes,
                 struct pell_gains *gains);
    /* Takes the gains over where light in the solid was solved, and says for which lanes transmitted light is sought straight through.
     * `entering`: nothing of what is transmitted is asked for. */
    void (*look)(const struct pell_irradiance_params *params, const struct pell_indirect_insides *found, bool entering,
                 const struct pell_lanes *lanes, struct pell_gains *gains, struct pell_inside *inside, int32_t *straight);
    void (*scale)(const struct pell_gains *gains, struct pell_sums *sums);
    void (*add)(const struct pell_inside *inside, struct pell_sums *sums);
};

PELL_SIMD_TABLES(struct pell_inside_kernels, pell_inside_kernels);

#endif
