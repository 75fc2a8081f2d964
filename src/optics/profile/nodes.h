/* SPDX-License-Identifier: MIT
 *
 * nodes.h - tabulated profiles: monotone cubics between nodes. */
#ifndef PELL_PROFILE_NODES_H
#define PELL_PROFILE_NODES_H

#include <pellucid/profile.h>

/* How slopes at nodes are computed from their neighbours' values. */
enum pell_nodes_slopes {
    PELL_NODES_LINEAR, /* a parabola in (r, R): for arbitrary tables */
    PELL_NODES_LOG,    /* a quartic in (log r, log R), where all five values are positive: for smooth models over many decades */
    PELL_NODES_GIVEN,  /* out->slope holds them */
};

/* Completes a profile of which out->r[0..count) (rising, >= 0, mm) and out->value (finite, >= 0, 1/mm^2) are filled in: slopes (limited
 * so that the cubic is monotone between nodes), flux, total. 2 <= count <= PELL_PROFILE_NODES. R is value[0] inside r[0]; beyond the
 * last node it is 0 if tail_sigma_tr < 0, else it continues the last value by the far field of diffusion, C (1 + s r) exp(-s r)/r^3 with
 * s = tail_sigma_tr in 1/mm (0: no absorption). The caller judges out->total; it is finite if values and radii are within 1e24 and 1e12. */
void pell_profile_nodes_make(struct pell_profile *out, int count, enum pell_nodes_slopes slopes, double tail_sigma_tr);

/* Multiplies R (and all flux) by a factor >= 0. */
void pell_profile_nodes_scale(struct pell_profile *p, double factor);

/* Flux 2 pi Int r R dr between two radii r0 <= r1 of node interval i. */
double pell_profile_nodes_flux(const struct pell_profile *p, int i, double r0, double r1);

/* Limited slope at row i of a table of `count` >= 2 rows; PELL_NODES_LINEAR. */
double pell_nodes_slope(const double *r, const double *value, size_t count, size_t i);

/* 2 pi Int_0^x (r0 + y) R(r0 + y) dy of the cubic over [r0, r0 + h] with values v0, v1 and slopes m0/h, m1/h. */
double pell_nodes_cubic_flux(double r0, double h, double v0, double v1, double m0, double m1, double x);

#endif
