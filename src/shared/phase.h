/* SPDX-License-Identifier: MIT
 *
 * phase.h - phase functions of pellucid/phase.h from coefficients that are computed once per medium, in 1/sr. c is the cosine between both
 * directions as they point away from the scattering point: -1 is forward.
 *
 * Henyey and Greenstein 1941, "Diffuse radiation in the Galaxy"; Blasi, Le Saec and Schlick 1993, "A Rendering Algorithm for Discrete
 * Volume Density Objects"; Bohren and Huffman, "Absorption and Scattering of Light by Small Particles", 5 (Rayleigh).
 */
#ifndef PELL_SHARED_PHASE_H
#define PELL_SHARED_PHASE_H

#include "shared/language.h"

#define PELL_PHASE_TERMS_ISOTROPIC 0         /* n[0] */
#define PELL_PHASE_TERMS_HENYEY_GREENSTEIN 1 /* n[0] (a[0] + b[0] c)^(-3/2) */
#define PELL_PHASE_TERMS_SCHLICK 2           /* n[0] (1 + b[0] c)^-2 */
#define PELL_PHASE_TERMS_RAYLEIGH 3          /* n[0] (1 + c^2) */
#define PELL_PHASE_TERMS_TWO_LOBE 4          /* two of Henyey and Greenstein, weights in n */

struct pell_phase_terms {
    int shape; /* PELL_PHASE_TERMS_ISOTROPIC etc. */
    float n[2], a[2], b[2];
};

/* For any arithmetic type: x = a + b c > 0 and its root; x = 1 + b c; c. */
#define PELL_PHASE_HENYEY_GREENSTEIN(n, x, root_x) ((n) / ((x) * (root_x)))
#define PELL_PHASE_SCHLICK_OF(n, x) ((n) / ((x) * (x)))
#define PELL_PHASE_RAYLEIGH_OF(n, c) ((n) * (1.0f + (c) * (c)))

PELL_SHARED float pell_phase_lobe(float n, float a, float b, float c)
{
    const float x = a + b * c, above = x > 1e-12f ? x : 1e-12f;
    return PELL_PHASE_HENYEY_GREENSTEIN(n, above, sqrtf(above));
}

PELL_SHARED float pell_phase_evaluate(PELL_STRUCT(pell_phase_terms) f, float c)
{
    if (f.shape == PELL_PHASE_TERMS_HENYEY_GREENSTEIN)
        return pell_phase_lobe(f.n[0], f.a[0], f.b[0], c);
    if (f.shape == PELL_PHASE_TERMS_SCHLICK)
        return PELL_PHASE_SCHLICK_OF(f.n[0], 1.0f + f.b[0] * c);
    if (f.shape == PELL_PHASE_TERMS_RAYLEIGH)
        return PELL_PHASE_RAYLEIGH_OF(f.n[0], c);
    if (f.shape == PELL_PHASE_TERMS_TWO_LOBE)
        return pell_phase_lobe(f.n[0], f.a[0], f.b[0], c) + pell_phase_lobe(f.n[1], f.a[1], f.b[1], c);
    return f.n[0];
}

/* Henyey-Greenstein from g itself, without preparation: base = (1 - g)^2 + 2 g (1 - m), m = -c the forward cosine, accurate at g = 0 and
 * for nearly forward directions. */
#define PELL_PHASE_HG_BASE(g, m) ((1.0f - (g)) * (1.0f - (g)) + 2.0f * (g) * (1.0f - (m)))
#define PELL_PHASE_HG_VALUE(g, base, root_base) ((1.0f - (g) * (g)) / (4.0f * PELL_PI_F * (base) * (root_base)))

#endif
