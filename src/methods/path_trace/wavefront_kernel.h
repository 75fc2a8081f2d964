/* SPDX-License-Identifier: MIT
 *
 * wavefront_kernel.h - steps of sixteen SIMD paths, each lane with the same bits as the path alone (walk.c, distance_sampling.c, medium.c):
 * in homogeneous solids with a Henyey-Greenstein phase function common to all channels. Surfaces and next-event estimation are handled path
 * by path (wavefront.c).
 */
#ifndef PELL_PATH_TRACE_WAVEFRONT_KERNEL_H
#define PELL_PATH_TRACE_WAVEFRONT_KERNEL_H

#include "base/simd.h"
#include "methods/path_trace/path.h"

enum { PT_LANES = 16 };

/* Sets of lanes: bits of an uint32_t, lane 0 the lowest. */
struct pt_wavefront_lanes {
    _Alignas(64) float x[3][PT_LANES];
    float w[3][PT_LANES];
    float beta[3][PT_LANES];
    float incident[3][PT_LANES];       /* direction before the last scattering event */
    float collision_beta[3][PT_LANES]; /* beta before the last phase function, including the collision */
    float safe[PT_LANES], selection[PT_LANES], length[PT_LANES];
    float bound[PT_LANES];           /* of flights that need a ray: see struct pt_flight */
    float inverse_stay[3][PT_LANES]; /* see struct pt_flight */
    int32_t channel[PT_LANES];
    int32_t events[PT_LANES], scattered[PT_LANES];
    uint32_t at[PT_LANES]; /* state of the sampler */
    uint64_t state[PT_LANES];
    struct pt_sampler *sampler[PT_LANES]; /* of lanes that still use quasi-random numbers */
};

/* Data of the solid that all lanes of a call are in. */
struct pt_wavefront_solid {
    const struct pt_coefficients *m;
    const struct pell_distance_grid *grid; /* NULL: none */
    float lo[3], hi[3];                    /* bounds, with a margin */
    float roulette, fraction, connect_mm;  /* connect_mm: the maximum distance of connections is -connect_mm log u */
    int32_t events;                        /* maximum per path */
    bool connects;
};

struct pt_wavefront_kernels {
    /* Free flights: length, and safe. Returns the lanes that need a ray; *cut: lanes that exceeded the number of events, which stop. */
    uint32_t (*sample_distance)(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on, uint32_t *cut);
    /* Moves lanes without a hit to their collision. *lost: not moved, they left the solid; *gone: no throughput is left. Returns the other
     * lanes that are selected for next-event estimation. */
    uint32_t (*collide)(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on, uint32_t *lost, uint32_t *gone);
    /* Phase function and Russian roulette: returns the lanes that are complete. */
    uint32_t (*scatter)(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on);
};

PELL_SIMD_TABLES(struct pt_wavefront_kernels, pt_wavefront_kernels);

#endif
