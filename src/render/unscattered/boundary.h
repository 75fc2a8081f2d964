/* SPDX-License-Identifier: MIT
 * boundary.h - what a boundary does to a way. Private to the folder. */
#ifndef RENDER_UNSCATTERED_BOUNDARY_H
#define RENDER_UNSCATTERED_BOUNDARY_H

#include "render/unscattered/internal.h"

/* A place of a boundary. */
struct unscattered_face {
    struct pell_vec3 at, n, ng; /* n: that light refracts by; both unit, toward where the way comes from */
    float unit;                 /* mm: how far from it rays start */
    int material;               /* scene's */
    float roughness, rho_s;
    float n1, n2; /* indices before and behind it */
};

/* The way goes on behind it, weaker; false: it is reflected, with all that it has. */
bool unscattered_pass(const struct pell_unscattered_params *p, const struct unscattered_face *f, struct unscattered_way *w);

#endif
