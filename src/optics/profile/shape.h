/* SPDX-License-Identifier: MIT
 *
 * shape.h - operations of a kind of profile besides R(r), and the models that make profiles. */
#ifndef PELL_PROFILE_SHAPE_H
#define PELL_PROFILE_SHAPE_H

#include <pellucid/profile.h>

#include <string.h>

/* One of these for each enum pell_profile_kind. Radii are finite and >= 0. */
struct pell_profile_shape {
    double (*inside)(const struct pell_profile *p, double r);  /* flux inside r; exact in relative terms for small r */
    double (*outside)(const struct pell_profile *p, double r); /* flux outside r; exact in relative terms for large r */
    double (*transform)(const struct pell_profile *p, double s);
    double (*scale)(const struct pell_profile *p); /* a radius, > 0, where an inversion starts */
};

extern const struct pell_profile_shape pell_profile_pair, pell_profile_burley, pell_profile_gaussians, pell_profile_nodes;

/* Called at the end by everything that makes a profile: below PELL_PROFILE_TOTAL_MIN, parts of the light would have too few digits to be
 * compared with it, so the profile becomes 0. */
static inline void pell_profile_drop_traces(struct pell_profile *p)
{
    const int kind = p->kind;

    if (p->total >= PELL_PROFILE_TOTAL_MIN)
        return;
    memset(p, 0, sizeof(*p));
    p->kind = kind;
}

/* R = a (pole of zr + pole of zv) + b (fluence of zr - fluence of zv), including `total`: see pair.c. */
void pell_profile_pair_make(struct pell_profile *out, double sigma_tr, double zr, double zv, double a, double b);
/* Total > 0 and distance d of R = total (exp(-r/d) + exp(-r/(3 d)))/(8 pi d r). */
void pell_profile_burley_make(struct pell_profile *out, double total, double d);

/* A model that computes a profile from coefficients. `medium`, `channel` and `params` are valid when make() is called, and *out is zero; it
 * refuses members of `params` that it does not support with PELL_ERR_UNSUPPORTED. */
struct pell_profile_source {
    struct pell_profile_model_row row;
    enum pell_result (*make)(const struct pell_medium *medium, int channel, const struct pell_profile_params *params,
                             struct pell_profile *out);
};

extern const struct pell_profile_source pell_profile_source_dipole, pell_profile_source_better_dipole,
    pell_profile_source_normalized_diffusion, pell_profile_source_photon_beam, pell_profile_source_monte_carlo;

/* Moments of the internal reflectance: c1 = 2 Int F mu dmu = Fdr by `params`, c2 = 3 Int F mu^2 dmu. */
struct pell_profile_boundary {
    double c1, c2;
};
enum pell_result pell_profile_boundary_make(double eta, const struct pell_profile_params *params, struct pell_profile_boundary *out);

/* pell_half_space_albedo for valid arguments, with 1 - alpha' = sigma_a/sigma_t' as exact as the caller has it. */
double pell_half_space_total(double albedo, double absorbed, double eta);

/* (1 - exp(-s x))/s for s, x >= 0; x where s is 0. */
double pell_profile_absorbed(double s, double x);

#endif
