/* SPDX-License-Identifier: MIT
 *
 * multipole.h - one channel of a stack as slabs: sources, extrapolated boundaries, closed forms in the Hankel domain. Internal.
 *
 * Threads    safe; allocates nothing.
 */
#ifndef PELL_MULTIPOLE_H
#define PELL_MULTIPOLE_H

#include <pellucid/layers.h>

/* Sides are where light enters: 0 from above (+), 1 from below (-). */
struct pell_multipole_slab {
    double albedo;           /* alpha' */
    double sigma_tr;         /* 1/mm */
    double l;                /* reduced mean free path, mm */
    double d;                /* mm, INFINITY: half-space */
    double zb[2];            /* extrapolation distance at [0] top, [1] bottom */
    bool clear[2];           /* PELL_STACK_CLEAR for light entering on that side */
    double transmittance[2]; /* for a clear side: its transmittance at every frequency */
    double scale[2];         /* for all light entering on that side; below 1 if a thin slab's closed form exceeds 1 in total */
    double growth_max;       /* bound of (l - d) kappa, so that products over a stack stay finite where other factors are 0 */
    bool straight;           /* PELL_STACK_WIDENED: the growing factor of T^, exp((l - d) kappa), is clamped to its value at s = 0 */
};

struct pell_slabs {
    int count;
    struct pell_multipole_slab slab[PELL_LAYERS_MAX];
    unsigned flags;
    double reach_r;  /* R^ falls at least as exp(-reach_r s), mm */
    double reach_t;  /* T^ as exp(-reach_t s); if WIDENED, includes `widen` */
    double widen;    /* T^ is to be multiplied by exp(-widen (kappa_0 - sigma_tr_0)), mm */
    double scale;    /* the longest length of the profiles, mm */
    double shortest; /* the shortest of l, and d - l, over layers, mm: the narrow Gaussian resolves it */
};

struct pell_response {
    double r[2], t[2];
};

/* PELL_ERR_INVALID: the stack or the channel is not valid. */
enum pell_result pell_slabs_prepare(const struct pell_stack *stack, int channel, struct pell_slabs *out);
/* One slab's transforms at a frequency. */
struct pell_response pell_slab_response(const struct pell_multipole_slab *slab, double s);
/* The adding equations (4), (5) of d'Eon et al. 2007 and their mirror images; `a` lies on `b`. */
struct pell_response pell_response_add(const struct pell_response *a, const struct pell_response *b);
/* By enum pell_stack_part. */
void pell_response_store(const struct pell_response *response, double out[PELL_STACK_PARTS]);
/* The whole stack's. */
struct pell_response pell_slabs_response(const struct pell_slabs *slabs, double s);

#endif
