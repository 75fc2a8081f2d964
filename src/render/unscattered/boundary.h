/* SPDX-License-Identifier: MIT
 * boundary.h - refraction and reflection of a path at a boundary. Private to the folder. */
#ifndef RENDER_UNSCATTERED_BOUNDARY_H
#define RENDER_UNSCATTERED_BOUNDARY_H

#include "render/unscattered/internal.h"

/* A hit of a boundary. */
struct unscattered_hit {
    struct pell_vec3 position, n, ng; /* n: shading normal, for refraction; ng: geometric. Both unit, on the side from which the path
                                       * arrives */
    float offset;                     /* mm: offset of ray origins */
    struct unscattered_boundary boundary;
    float n1, n2; /* indices of refraction before and behind it */
};

/* Continues the path behind the boundary with a smaller weight, or returns false if it is reflected, with its full weight. */
bool unscattered_cross(const struct pell_unscattered_params *p, const struct unscattered_hit *f, struct unscattered_path *w);

#endif
