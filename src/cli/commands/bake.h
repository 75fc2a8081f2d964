/* SPDX-License-Identifier: MIT
 *
 * bake.h - measurements of `bake-layers`: the media below each texel of a surface, along its inward normal.
 *
 * Ownership  bake_finish releases what a function filled, even partially.
 */
#ifndef PELL_CLI_BAKE_H
#define PELL_CLI_BAKE_H

#include "base/pool.h"
#include "cli/cli.h"
#include "visibility/rays.h"

enum {
    BAKE_PAIRS = 4, /* entries and exits, of each inner mesh */
    BAKE_INNER = 15,
    BAKE_STRETCHES = 1 + 2 * BAKE_PAIRS * 2, /* upper bound per texel */
};

/* The media below a texel from the surface down: which medium, and its lower end in mm. 0 is the outer object, k the inner mesh k - 1. */
struct bake_texel {
    uint8_t count; /* 0: no triangle covers this texel */
    uint8_t medium[BAKE_STRETCHES];
    float end[BAKE_STRETCHES];
};

struct bake_solid {
    const char *name, *path; /* borrowed */
    struct pell_scene *scene;
    struct pell_rays *rays;
};

struct bake {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct bake_solid outer, inner[BAKE_INNER];
    int num_inner;
    int size;          /* texels along a side */
    double down_to_mm; /* INFINITY: to the other side */
    struct bake_texel *texels;
    /* Counts of texels. */
    int64_t shown, shared; /* covered by the surface; covered by several triangles */
    int64_t cut;           /* with more pairs or stretches than fit: the deepest are left out */
    int64_t open;          /* whose ray does not leave the outer mesh */
    /* The layers common to all texels, in their order; the last is the outer object, without a bottom. */
    uint8_t layer[PELL_LAYERS_MOST];
    int num_layers;
    float *bottom; /* mm: [layer][texel], for all layers but the last */
};

/* Fills `texels` and the counts. */
PELL_NODISCARD enum pell_result bake_measure(struct bake *b);
/* Fills `layer` and `bottom`: every texel has every layer; a layer absent at a texel gets zero thickness there. */
PELL_NODISCARD enum pell_result bake_align(struct bake *b);
void bake_finish(struct bake *b);

#endif
