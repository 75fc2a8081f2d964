/* SPDX-License-Identifier: MIT
 *
 * thickness.h - transmission through a thin part: light enters at A, with the normal n_A, and is seen at C, with n_C
 * (render/irradiance/transmission.c). `same` is n_A.n_C.
 */
#ifndef PELL_SHARED_THICKNESS_H
#define PELL_SHARED_THICKNESS_H

#include "shared/language.h"
#include "shared/table.h"

/* Cosine of the ray through the part, from the cosines of shading and geometric normal with the direction to the light: a normal map
 * can't make a slab thin. */
PELL_SHARED float pell_thickness_cosine(float nl, float gl)
{
    const float a = -nl, b = -0.5f * gl, c = a > b ? a : b;
    return c > 1e-6f ? c : 1e-6f;
}

/* Thickness, mm, of a part that a ray crosses after `path` mm at this cosine: the distance between the faces if they are parallel. */
PELL_SHARED float pell_thickness_of(float path, float cosine, float same)
{
    return path + (path * cosine - path) * (same < 0.0f ? -same : 0.0f);
}

/* Degree to which the faces oppose: weight of the slab's table. */
PELL_SHARED float pell_thickness_opposed(float same)
{
    return same < 0.0f ? -same : 0.0f;
}

#define PELL_THICKNESS_TURNED 0.25f /* n_A.v from which A counts as visible */

/* Fraction of the light entering at A that is not already part of the light near C: A is visible to the degree that it faces the viewer,
 * `nv` is n_A.v. */
PELL_SHARED float pell_thickness_counted(float same, float nv)
{
    return 1.0f - pell_saturate(nv / PELL_THICKNESS_TURNED) * (same > 0.0f ? same : 0.0f);
}

/* Factor by which the geometric normal reduces light that arrives at A's shading normal with the cosine mu; `ng` is the cosine of both
 * normals. */
PELL_SHARED float pell_thickness_facing(float facing, float mu, float ng)
{
    const float g = facing / (mu * (ng > 1e-3f ? ng : 1e-3f));
    return g < 1.0f ? g : 1.0f;
}

/* Factor of exiting light that travelled `path` mm: from 1 at 0 to `pass`, that of light from the depth, at 1/per mm (render/angle.h). */
PELL_SHARED float pell_thickness_exit(float per, float path, float pass)
{
    const float thick = per * path, deep = thick < 1.0f ? thick : 1.0f;
    return 1.0f + deep * (pass - 1.0f);
}

#endif
