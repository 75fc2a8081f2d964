/* SPDX-License-Identifier: MIT
 *
 * thickness.h - light that is transmitted through a thin part: it enters at A, with the normal n_A, and is seen at C, with n_C
 * (render/irradiance/transmission.c). `same` is n_A.n_C.
 */
#ifndef PELL_SHARED_THICKNESS_H
#define PELL_SHARED_THICKNESS_H

#include "shared/language.h"
#include "shared/table.h"

/* Of the way through the part, from the cosines of shading and geometric normal with the direction to the light: a normal map can't make a
 * slab thin. */
PELL_SHARED float pell_thickness_cosine(float nl, float gl)
{
    const float a = -nl, b = -0.5f * gl, c = a > b ? a : b;
    return c > 1e-6f ? c : 1e-6f;
}

/* The thickness, mm, of a part that a ray crosses within m mm: across parallel faces their distance. */
PELL_SHARED float pell_thickness_of(float m, float cosine, float same)
{
    return m + (m * cosine - m) * (same < 0.0f ? -same : 0.0f);
}

/* How much faces oppose: by this the slab's table counts. */
PELL_SHARED float pell_thickness_opposed(float same)
{
    return same < 0.0f ? -same : 0.0f;
}

#define PELL_THICKNESS_TURNED 0.25f /* n_A.v from which on A counts as seen */

/* The part of what enters at A that is not yet part of the light near C: A is seen as far as it faces the viewer, `nv` is n_A.v. */
PELL_SHARED float pell_thickness_counted(float same, float nv)
{
    return 1.0f - pell_saturate(nv / PELL_THICKNESS_TURNED) * (same > 0.0f ? same : 0.0f);
}

/* How far the geometric normal holds back light that A's shading normal meets at the cosine mu; `ng` is their cosine. */
PELL_SHARED float pell_thickness_facing(float facing, float mu, float ng)
{
    const float g = facing / (mu * (ng > 1e-3f ? ng : 1e-3f));
    return g < 1.0f ? g : 1.0f;
}

/* Factor of light that has come d mm, by which it leaves as light from the depth: all of `pass` from 1/per on. See render/angle.h. */
PELL_SHARED float pell_thickness_leaves(float per, float d, float pass)
{
    const float thick = per * d, deep = thick < 1.0f ? thick : 1.0f;
    return 1.0f + deep * (pass - 1.0f);
}

#endif
