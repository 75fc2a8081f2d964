/* SPDX-License-Identifier: MIT
 * internal.h - what the files of the stage share. Private to the folder. */
#ifndef RENDER_UNSCATTERED_INTERNAL_H
#define RENDER_UNSCATTERED_INTERNAL_H

#include "render/unscattered/facets.h"
#include "render/unscattered/lobe.h"
#include "render/unscattered/stage.h"

#include "lights/lights.h"

#define UNSCATTERED_THICKEST 8.0f /* optical thickness of the clearest channel, beyond which nothing is left */
#define UNSCATTERED_NEST 4        /* solids in solids */

struct unscattered_medium {
    bool is;          /* light is followed through it: it has coefficients, and */
    bool thin;        /* its parts are thin enough where they are seen */
    float eta;        /* over that of the open */
    float sigma_t[3]; /* 1/mm */
    float clearest;   /* least of them */
};

struct pell_unscattered {
    struct pell_context *ctx;
    struct unscattered_medium *media; /* per scene material */
    float bundles[UNSCATTERED_BUNDLES][4][UNSCATTERED_BUNDLE];
};

/* A solid that a way is in. */
struct unscattered_place {
    int object, material;
    int shells; /* of the same object, inside it, that it has entered */
};

struct unscattered_way {
    struct pell_vec3 at, along; /* where rays start, just beyond the last surface; unit */
    struct pell_vec3 side;      /* geometric normal of that, on this side */
    float weight[3];
    struct unscattered_lobe lobe;
    struct unscattered_place in[UNSCATTERED_NEST];
    int count;       /* of `in`; 0: in the open */
    int bounces;     /* left */
    float thickness; /* optical, of the clearest channels */
    uint32_t bundle;
    struct unscattered_draw draw;
};

/* lights.c. Adds to `rgb` what lights show along a way in the open up to `reach` mm, INFINITY where nothing is in the way. Returns the
 * number of rays. */
int64_t unscattered_see_lights(const struct pell_unscattered *u, const struct pell_unscattered_params *p, const struct unscattered_way *w,
                               float reach, float rgb[3]);

#define UNSCATTERED_STRAY 1e-30f /* in place of 0, which has no sign */
/* stray.c. Values of pixels whose ways are stray come below 0, and are given the mean of those around them. */
void unscattered_share_stray(struct pell_pool *pool, const struct pell_unscattered_params *p);

#endif
