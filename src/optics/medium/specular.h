/* SPDX-License-Identifier: MIT
 *
 * specular.h - look-ups in the tables of pellucid/specular.h; the lobes themselves are in shared/lobe.h.
 */
#ifndef PELL_SPECULAR_H
#define PELL_SPECULAR_H

#include "shared/boundary.h"
#include "shared/lobe.h"
#include "shared/table.h"

#include <pellucid/medium.h>
#include <pellucid/specular.h>

#include <stdint.h>

#define PELL_BOUNDARY_MU 256 /* entries over mu of a smooth boundary: (i / 255)^2 */

/* A smooth boundary seen from outside: F0, Fresnel's transmittance F_t(mu), and its cosine-weighted mean 1 - Fdr(1/eta). */
struct pell_boundary_table {
    double eta;
    float f0, mean;
    float transmittance[PELL_BOUNDARY_MU];
};
void pell_boundary_table_make(double eta, struct pell_boundary_table *out);

/* Position of a roughness between two entries. */
static inline void pell_roughness_position(float roughness, int *index, float *fraction)
{
    const float x = pell_roughness_coord(roughness, PELL_ROUGHNESS_MIN, PELL_ALBEDO_ROUGHNESS);
    *index = pell_table_cell(x, PELL_ALBEDO_ROUGHNESS);
    *fraction = x - (float) *index;
}

/* Scale and bias at mu, bilinear; `first` points at albedo[model][0][index] and counts from there. */
static inline void pell_albedo_pair(const float *first, float fraction, float mu, float *scale, float *bias)
{
    const float x = pell_cosine_coord(pell_saturate(mu), PELL_ALBEDO_MU);
    const int i = pell_table_cell(x, PELL_ALBEDO_MU);
    const float f = x - (float) i, *p = first + 2 * PELL_ALBEDO_ROUGHNESS * i, *q = p + 2 * PELL_ALBEDO_ROUGHNESS;
    *scale = pell_bilinear(p[0], p[2], q[0], q[2], fraction, f);
    *bias = pell_bilinear(p[1], p[3], q[1], q[3], fraction, f);
}

static inline float pell_boundary_lookup(const float *transmittance, float mu)
{
    const float x = pell_cosine_coord(pell_saturate(mu), PELL_BOUNDARY_MU);
    const int i = pell_table_cell(x, PELL_BOUNDARY_MU);
    return pell_lerp(transmittance[i], transmittance[i + 1], x - (float) i);
}

_Static_assert((int) PELL_SPECULAR_GGX == PELL_LOBE_GGX && (int) PELL_SPECULAR_KELEMEN == PELL_LOBE_KELEMEN &&
                   (int) PELL_SPECULAR_PHONG == PELL_LOBE_PHONG && (int) PELL_SPECULAR_BLINN_PHONG == PELL_LOBE_BLINN_PHONG,
               "shared/lobe.h numbers the models alike");

/* Replaces unknown models by a default. */
static inline enum pell_specular_model pell_specular_known(enum pell_specular_model model)
{
    return (unsigned) model < PELL_SPECULAR_MODELS ? model : PELL_SPECULAR_GGX;
}

#endif
