/* SPDX-License-Identifier: MIT
 *
 * photon.h - photon random walks through plane-parallel layers: the reference for profiles, and the source of their table.
 *
 * A stack of homogeneous layers lies between two half-spaces of air or glass. A photon enters at the origin of the upper face, travels
 * -log(u)/sigma_t, collides, scatters by the Henyey-Greenstein phase function (1941), and is reflected or transmitted at smooth boundaries
 * with the probability of Fresnel's equations (unpolarised), until it exits. Collisions do not end a walk: they multiply its weight by
 * sigma_s/sigma_t of the layer. In a medium that does not absorb a photon that exits after n collisions has the weight alpha^n in an
 * absorbing one, in units of its mean free path: one run covers every albedo.
 *
 * Units      lengths and coefficients in any one unit and its inverse; radii are measured along the faces.
 * Random     photon i of seed s has its own generator (xoshiro256+, Blackman and Vigna 2021, filled by splitmix64 from s
 *            and i): its path depends on neither threads nor batches.
 * Threads    pure and safe; nothing is allocated.
 */
#ifndef PELL_PHOTON_H
#define PELL_PHOTON_H

#include <pellucid/common.h>

#define PELL_PHOTON_LAYERS 8
#define PELL_PHOTON_COLLISIONS_MAX (1 << 20)

struct pell_photon_layer {
    double sigma_a, sigma_s;
    double g;         /* mean cosine, (-1, 1) */
    double n;         /* refractive index */
    double thickness; /* > 0; INFINITY for the last layer only */
};

struct pell_photon_stack {
    int count;
    struct pell_photon_layer layer[PELL_PHOTON_LAYERS]; /* from the upper face down */
    double n_above, n_below;                            /* refractive indices outside; below a half-space nothing exits */

    /* Range of the cosines outside of the light incident on the upper face, 0 <= mu_min <= mu_max <= 1: equal radiance between them (1, 1:
     * a beam at normal incidence; 0, 1: a uniform hemisphere). */
    double mu_min, mu_max;
    bool inside; /* a photon starts just below the upper face, and is not reflected by it from outside */

    /* Beyond this many collisions, and again each time their number has grown fourfold, one of two photons survives with twice the weight:
     * unbiased Russian roulette; long walks cost a constant for each octave. 0: never. */
    int roulette;
    int collisions_max; /* longer walks are terminated, and counted as lost; [1, PELL_PHOTON_COLLISIONS_MAX] */
};

/* A photon that exits. */
struct pell_photon_exit {
    uint64_t index; /* index of the photon */
    int face;       /* 0 the upper one, 1 the lower one */
    int collisions; /* 0: never scattered (reflected where it entered, or transmitted unscattered) */
    double radius;  /* distance from where it entered */
    double mu;      /* cosine to the normal outside */
    double weight;  /* product of the albedos of its collisions, times roulette compensation; > 0 */
};
/* Called for photons that exit, or (`touch`) each time one hits an outer face from inside, before reflection or transmission is decided:
 * `mu` is then the cosine inside. If every touch is weighted by its transmittance, one run also covers many indices. */
typedef void (*pell_photon_callback)(void *user, const struct pell_photon_exit *e);

struct pell_photon_sums {
    double absorbed[PELL_PHOTON_LAYERS]; /* weight absorbed in each layer; all photons sum to 1 */
    double lost;                         /* weight of terminated walks */
    uint64_t collisions;                 /* work done */
};

/* The first field that is out of range ("layer[1].g", "mu_min"), or NULL if the stack is valid. */
const char *pell_photon_fault(const struct pell_photon_stack *stack);

/* Traces photons first, first + 1, ... (count of them) of this seed, in that order, and calls `leave` and `touch` (either may be NULL).
 * Adds to *sums. The stack must be valid. */
void pell_photon_walk(const struct pell_photon_stack *stack, uint64_t seed, uint64_t first, uint64_t count, pell_photon_callback leave,
                      pell_photon_callback touch, void *user, struct pell_photon_sums *sums);

#endif
