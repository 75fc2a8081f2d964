/* SPDX-License-Identifier: MIT
 * curvature.h - effect of the shape of a translucent solid on light that enters it (render/curvature/stage.h, render/irradiance/inside.c):
 * lookup of the tables, and use of their entries. */
#ifndef PELL_SHARED_CURVATURE_H
#define PELL_SHARED_CURVATURE_H

#include "shared/hash.h"

#define PELL_CURVATURE_GAINS 257  /* entries of a material's tables: over curvatures from -limit to limit, and over thinness */
#define PELL_CURVATURE_SHIFT 0.3f /* upper limit, so that light from straight above does not become negative */
#define PELL_CURVATURE_SIDE 1024  /* nodes along an axis of a grid */

/* Clamps a coordinate of such a table. */
PELL_SHARED float pell_curvature_coord(float x)
{
    const float above = x > 0.0f ? x : 0.0f, last = PELL_TO_FLOAT(PELL_CURVATURE_GAINS) - 1.001f;
    return above < last ? above : last;
}

/* Table coordinates of a curvature, and of a thinness; `limit` and `step` are the material's. */
PELL_SHARED float pell_curvature_mean_coord(float mean, float limit)
{
    return pell_curvature_coord((mean / limit + 1.0f) * (0.5f * PELL_TO_FLOAT(PELL_CURVATURE_GAINS - 1)));
}

PELL_SHARED float pell_curvature_thinness_coord(float thinness, float step)
{
    return pell_curvature_coord(thinness * step / (1.0f + thinness * step) * PELL_TO_FLOAT(PELL_CURVATURE_GAINS - 1));
}

/* Thinness in excess of that of a ball with the same curvature. */
PELL_SHARED float pell_curvature_excess(float mean, float thinness)
{
    return thinness - (mean > 0.0f ? 0.5f * mean : 0.0f);
}

/* How flat a part is, from its excess (above) and its thinness: 0: balls and cylinders; 1: flat. */
PELL_SHARED float pell_curvature_sheet(float excess, float thinness)
{
    const float sheet = 2.0f * excess / thinness - 1.0f;
    return sheet > 0.0f ? sheet : 0.0f;
}

/* How close the exitance of a thin part is to a ball's, as opposed to a slab's: 0.7 for a cylinder. */
PELL_SHARED float pell_curvature_round(float mean, float thinness)
{
    const float x = mean > 0.0f ? 0.5f * mean / thinness : 0.0f, round = x < 1.0f ? x : 1.0f;
    return round * (1.8f - 0.8f * round);
}

/* Shift of the cosine mu of light incident on a curved surface, to mu + shift (1 - 3 mu^2) (render/curvature/stage.h): `mean` curvature
 * times `path`, the mean free path over the index of refraction; clamped. */
PELL_SHARED float pell_curvature_shift(float mean, float path)
{
    const float shift = mean * path, above = shift > -PELL_CURVATURE_SHIFT ? shift : -PELL_CURVATURE_SHIFT;
    return above < PELL_CURVATURE_SHIFT ? above : PELL_CURVATURE_SHIFT;
}

/* Single scattering that a ball returns of uniform light, over that of a half-space: 1/(1 - mean free path over radius), within 5 % for
 * radii of 5 and more mean free paths. `shift`: that of pell_curvature_shift, over the index of refraction. */
PELL_SHARED float pell_curvature_single(float shift, float inverse_eta2)
{
    const float inverse_eta = sqrtf(inverse_eta2), bend = inverse_eta > 0.0f ? shift / inverse_eta : 0.0f;
    return 1.0f / (1.0f - (bend < 0.25f ? bend : 0.25f));
}

/* First slot of the search for a node in a hash table of a grid's nodes. */
PELL_SHARED uint32_t pell_curvature_slot(uint32_t part, uint32_t node_index)
{
    return pell_hash(node_index ^ pell_hash(part));
}

#endif
