/* SPDX-License-Identifier: MIT
 *
 * lanes.h - shared by the kernel files of this folder, which are compiled once per level of base/simd.h. Only for kernel files.
 */
#ifndef PELL_IRRADIANCE_LANES_H
#define PELL_IRRADIANCE_LANES_H

#include "render/irradiance/kernel.h"

#include "shared/light.h"

#ifndef PELL_SIMD_NAME
#define PELL_SIMD_NAME base
#endif

#define N PELL_LANES
#define BIG 1e25f   /* upper limit of an irradiance, so that sums over many lights stay finite */
#define TINY 1e-12f /* mm^2; lower limit of squared distances: a light in the surface */

/* Whether light at this cosine to the triangle's normal may reach a lane. A lane with a terminator offset is on the smooth surface, so
 * its triangle does not decide. */
static inline bool pell_lane_fronts(const struct pell_lanes *p, int i, float gl)
{
    return gl > 0.0f || p->terminator_offset[i] > TERMINATOR_LIFTED * p->epsilon[i];
}

/* Cosine n.l = nl with a soft terminator. */
static inline float pell_lane_facing(const struct pell_lanes *p, int i, float nl, float gl)
{
    const float ratio = gl / (nl * p->gn[i]);

    return pell_soft_terminator(nl, ratio < 1.0f && p->terminator_offset[i] <= TERMINATOR_LIFTED * p->epsilon[i] ? ratio : 1.0f);
}

/* gloss.c */
void PELL_SIMD(pell_add_highlight)(const struct pell_light_data *light, const struct pell_lanes *p, const struct pell_aim *a,
                                   const float *facing, const float *clipped, const int32_t *visible, struct pell_gloss *gloss);
void PELL_SIMD(pell_begin_highlights)(const struct pell_light_data *light, const struct pell_lanes *p, struct pell_gloss *gloss);
bool PELL_SIMD(pell_reflect)(const struct pell_light_data *light, const struct pell_lanes *p, uint32_t n, struct pell_gloss *gloss,
                             int32_t *mask, struct pell_ray16 *rays);
void PELL_SIMD(pell_reflected)(const int32_t *visible, struct pell_gloss *gloss);
void PELL_SIMD(pell_end_highlights)(const struct pell_light_data *light, const struct pell_lanes *p, const struct pell_gloss *gloss,
                                    struct pell_sums *sums);

#endif
