/* SPDX-License-Identifier: MIT
 *
 * wavefront_kernel.h - the steps of sixteen walks side by side, each lane the bits that the walk alone would have (walk.c,
 * distance_sampling.c, medium.c): in solids of one medium, Henyey and Greenstein's, that all channels see. What happens at surfaces, and
 * what is looked for at scatterers, is of one walk at a time (wavefront.c).
 */
#ifndef PELL_PATH_TRACE_STEPS_H
#define PELL_PATH_TRACE_STEPS_H

#include "base/simd.h"
#include "methods/path_trace/path.h"

enum { PT_LANES = 16 };

/* Lanes in sets: bits of an uint32_t, lane 0 the lowest. */
struct pt_wavefront_lanes {
    _Alignas(64) float x[3][PT_LANES];
    float w[3][PT_LANES];
    float beta[3][PT_LANES];
    float came[3][PT_LANES];     /* the way before it last scattered */
    float collided[3][PT_LANES]; /* beta before it scattered, with the collision */
    float safe[PT_LANES], turn[PT_LANES], length[PT_LANES];
    float bound[PT_LANES];   /* of flights that need a ray: see struct pt_flight */
    float over[3][PT_LANES]; /* the same */
    int32_t channel[PT_LANES];
    int32_t events[PT_LANES], scattered[PT_LANES];
    uint32_t at[PT_LANES]; /* of the sampler, as state */
    uint64_t state[PT_LANES];
    struct pt_sampler *sampler[PT_LANES]; /* of lanes whose numbers are still the even ones */
};

/* What all lanes of a call have in common. */
struct pt_wavefront_place {
    const struct pt_coefficients *m;
    const struct pell_distance_grid *grid; /* NULL: none */
    float lo[3], hi[3];                    /* bounds, with a margin */
    float roulette, share, ask;            /* ask: mm; how far connections look is -ask log u */
    int32_t events;                        /* of a path at most */
    bool connects;
};

struct pt_wavefront_kernels {
    /* Free flights: length, and safe. Lanes that need a ray; *cut: that had too many steps, which do nothing else. */
    uint32_t (*sample_distance)(struct pt_wavefront_lanes *w, const struct pt_wavefront_place *p, uint32_t on, uint32_t *cut);
    /* Moves lanes that met nothing to where they scatter. *lost: not moved, they left the solid; *gone: nothing is left. Of the others:
     * lanes whose turn it is to look for lights. */
    uint32_t (*collide)(struct pt_wavefront_lanes *w, const struct pt_wavefront_place *p, uint32_t on, uint32_t *lost, uint32_t *gone);
    /* Phase function and roulette: lanes that are over. */
    uint32_t (*scatter)(struct pt_wavefront_lanes *w, const struct pt_wavefront_place *p, uint32_t on);
};

PELL_SIMD_TABLES(struct pt_wavefront_kernels, pt_wavefront_kernels);

#endif
