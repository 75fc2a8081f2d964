/* SPDX-License-Identifier: MIT
 *
 * photon.h - photons that walk through plane layers: the reference that profiles are judged by, and the source of their table.
 *
 * A stack of homogeneous layers lies between two half-spaces of air or glass. A photon enters at the origin of the upper face, flies
 * -log(u)/sigma_t, collides, turns by Henyey and Greenstein's phase function (1941), and is reflected or let through at smooth
 * boundaries with the probability of Fresnel's equations (unpolarised), until it leaves. Collisions do not end a walk: they multiply
 * its weight by sigma_s/sigma_t of the layer. In a medium that does not absorb a photon that leaves after n collisions counts
 * alpha^n for one that does, in units of its mean free path: one run serves every albedo.
 *
 * Units      lengths and coefficients in any one unit and its inverse; radii are measured along the faces.
 * Random     photon i of seed s draws from a generator of its own (xoshiro256+, Blackman and Vigna 2021, filled by splitmix64 from s
 *            and i): what it does depends on neither threads nor batches.
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
    double n_above, n_below;                            /* refractive indices outside; below a half-space nothing leaves */

    /* Cosines outside of the light that falls on the upper face, 0 <= mu_min <= mu_max <= 1: equal radiance between them (1, 1 a
     * beam at right angles; 0, 1 a diffuse sky). */
    double mu_min, mu_max;
    bool inside; /* a photon starts behind the upper face, and is not reflected by it from outside */

    /* Beyond this many collisions, and again each time their number has grown fourfold, one of two photons goes on and counts twice:
     * nothing is biased, and long walks cost a constant for each octave. 0: never. */
    int roulette;
    int collisions_max; /* a walk longer than this is lost; [1, PELL_PHOTON_COLLISIONS_MAX] */
};

/* A photon that leaves. */
struct pell_photon_exit {
    uint64_t index; /* of the photon */
    int face;       /* 0 the upper one, 1 the lower one */
    int collisions; /* 0: never scattered (reflected where it came in, or gone straight through) */
    double radius;  /* from where it entered */
    double mu;      /* cosine to the normal outside */
    double weight;  /* albedos of its collisions, times what roulette made of it; > 0 */
};
/* Called for photons that leave, or (`touch`) each time one meets an outer face from inside, before it is known whether it passes: `mu`
 * is then the cosine inside. With every touch counted by what would pass, one run serves many indices, too. */
typedef void (*pell_photon_leave)(void *user, const struct pell_photon_exit *e);

struct pell_photon_sums {
    double absorbed[PELL_PHOTON_LAYERS]; /* weight left in each layer; all photons are 1 */
    double lost;                         /* weight of walks that were cut */
    uint64_t collisions;                 /* work done */
};

/* The first field that is out of range ("layer[1].g", "mu_min"), or NULL if photons may walk. */
const char *pell_photon_fault(const struct pell_photon_stack *stack);

/* Lets photons first, first + 1, ... (count of them) of this seed walk, in that order, and calls `leave` and `touch` (either may
 * be NULL). Adds to *sums. The stack must be without fault. */
void pell_photon_walk(const struct pell_photon_stack *stack, uint64_t seed, uint64_t first, uint64_t count, pell_photon_leave leave,
                      pell_photon_leave touch, void *user, struct pell_photon_sums *sums);

#endif
