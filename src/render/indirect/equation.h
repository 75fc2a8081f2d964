/* SPDX-License-Identifier: MIT
 *
 * equation.h - the boundary integral equation of diffusion.c for the fluence on a surface, solved by collocation. Far points are aggregated
 * into clusters.
 */
#ifndef INDIRECT_EQUATION_H
#define INDIRECT_EQUATION_H

#include "render/indirect/collocation.h"
#include "render/indirect/equation_kernel.h"

/* One colour channel. */
struct equation_channel {
    bool active; /* the equation is solved for this channel */
    float kappa, s, depth;
    float source_scale;     /* L of diffusion.c */
    float path[2];          /* depths in mean free paths at which light is first scattered, */
    float path_weight[2];   /* and the fraction of the light at each; */
    float min_distance2[2]; /* mm^2: least squared distance of points from there, */
    float blur2[2];         /* and the same without the term of the point's size */
    float total;            /* integral of the profile */
    double *light,
        *source,          /* of points and clusters, W/m^2: light that enters, scaled by surface curvature; light that goes into the depth,
                   * unscaled; */
        *single;          /* and the part that accounts for single scattering */
    double *point_source; /* of points: light that goes into the depth, scaled by curvature */
    double *rhs, *phi;    /* of points */
    float *matrix;        /* matrix entries: the factors of phi */
    float *curvature_factor, *source_depth[2]; /* of elements: see struct equation_kernel_params */
};

/* A range of consecutive elements. */
struct equation_run {
    uint32_t first, count;
};

struct equation {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct collocation_points *points;
    const struct equation_kernels *kernels;
    float near, window2, min_distance2;
    struct equation_patches patches;
    uint32_t *first_run, *first_entry; /* per point, plus one entry for the end */
    struct equation_run *run;
    struct equation_channel channel[3];
    double *basis, *extended;
    float *values;   /* storage behind the float arrays of elements and channels, */
    double *numbers; /* and behind the double arrays */
};

/* `points` is borrowed. Allocates the vectors of active channels; the caller then sets kappa, s and the light. */
PELL_NODISCARD enum pell_result equation_make(struct equation *e);
void equation_finish(struct equation *e);
/* Appends the area-weighted means of clusters to the values of points. */
void equation_extend(const struct equation *e, double *extended);
/* Computes matrix and rhs of every active channel. */
void equation_fill(struct equation *e);
/* Solves for phi. Returns false if the iteration does not converge. */
bool equation_solve(struct equation *e, struct equation_channel *channel);

#endif
