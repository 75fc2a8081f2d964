/* SPDX-License-Identifier: MIT
 *
 * equation.h - the integral equation of solid.c for the fluence on a surface, by collocation at places. Far places are seen as clusters.
 */
#ifndef INDIRECT_EQUATION_H
#define INDIRECT_EQUATION_H

#include "render/indirect/equation_kernel.h"
#include "render/indirect/places.h"
#include "render/indirect/radial.h"

/* Of red, green or blue. */
struct equation_channel {
    bool is; /* it is solved */
    float kappa, s, depth;
    float enters;        /* L */
    float path[2];       /* mean free paths at which light that goes into the medium is taken to be scattered first, */
    float share[2];      /* and how much of it; */
    float least2[2];     /* mm^2: that places count as away from there at least, */
    float blur2[2];      /* and what is not of a place */
    float total, window; /* of the profile, and of what is inside the window */
    struct radial radial;
    double *light,
        *source,  /* of places and clusters, W/m^2: what enters, as a curved surface moves it; what goes into the depth, as it falls; */
        *once;    /* and what of the light stands for single scattering */
    double *here; /* of places: what goes into the depth, moved */
    double *right, *phi, *sum; /* of places; sum: what a method finds */
    float *left;               /* phi's factors, of entries */
    float *bend, *deep[2];     /* of patches: see struct equation_law */
};

/* Patches that follow each other. */
struct equation_run {
    uint32_t first, count;
};

struct equation {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct places *places;
    const struct equation_kernels *kernels;
    float near, window2, least2;
    bool around; /* a method sees all faces, along the surface */
    struct equation_patches patches;
    uint32_t *first_run, *first_entry; /* of places, and one more */
    struct equation_run *run;
    struct equation_channel channel[3];
    double *basis, *all;
    float *values;   /* holds what patches and channels have of them, */
    double *numbers; /* and of these */
};

/* `places` are borrowed; channels whose `is` is set get their vectors. The caller sets the law, the light and phi. */
PELL_NODISCARD enum pell_result equation_make(struct equation *e);
void equation_finish(struct equation *e);
/* Puts the means of clusters behind the places. */
void equation_extend(const struct equation *e, double *all);
/* left, right and sum of every channel. */
void equation_fill(struct equation *e);
/* phi, from what it is set to. False where it does not converge. */
bool equation_solve(struct equation *e, struct equation_channel *channel);

#endif
