/* SPDX-License-Identifier: MIT
 *
 * pellucid/profile.h - evaluates and samples radial diffusion profiles R(r) of all models through one interface.
 *
 * Units      radii mm, R(r) 1/mm^2.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged, because only the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_PROFILE_H
#define PELLUCID_PROFILE_H

#include <pellucid/medium.h>

#ifdef __cplusplus
extern "C" {
#endif

/* --- Dipole (Jensen et al. 2001) ---------------------------------------------------------------------------------------------- */

struct pell_dipole {
    double sigma_t_reduced, albedo_reduced, sigma_tr;
    double A;      /* (1 + Fdr)/(1 - Fdr) */
    double zr, zv; /* depths of the real and the virtual source */
};

/* sigma_a >= 0 and sigma_s_reduced > 0 in 1/mm, eta in [1, 3]. Arguments are not checked; outside these ranges the result is undefined. */
PELL_API struct pell_dipole pell_dipole_make(double sigma_a, double sigma_s_reduced, double eta, enum pell_fresnel_model model);
PELL_API double pell_dipole_rd(const struct pell_dipole *d, double r_mm);  /* R_d(r), 1/mm^2 */
PELL_API double pell_dipole_total(const struct pell_dipole *d);            /* 2 pi Int r R_d dr */
PELL_API double pell_dipole_cdf(const struct pell_dipole *d, double r_mm); /* fraction of the total inside r, [0, 1] */

/* --- Half-space ----------------------------------------------------------------------------------------------------------------- */

/* Reflectance of a half-space for light that has entered at normal incidence, with isotropic scattering below a smooth boundary: exact
 * transport (Chandrasekhar's H functions with internal reflection), not diffusion; error below 1e-6. Anisotropic media are covered by
 * similarity, with `albedo` = alpha' in [0, 1]. NAN out of range. Takes 0.1 ms. */
PELL_API double pell_half_space_albedo(double albedo, double eta);
/* The same for light incident from outside at the cosine mu, in (0, 1], as a fraction of the light that enters. */
PELL_API double pell_half_space_albedo_at(double albedo, double eta, double mu);

/* Dependence of reflectance on the angle: light whose refracted direction has the cosine m is reflected with R(1) (1 + slope (1 - m)). By
 * reciprocity, diffuse light leaves in proportion to the same factor. */
struct pell_half_space_angle {
    double slope; /* by least squares over all directions of entry */
    double mean;  /* mean of the factor for diffuse light that enters */
};

/* The angular dependence of the isotropically scattering medium whose half-space reflects `total`, in (0, 1), of the light at normal
 * incidence; for other totals slope 0, mean 1. Takes 3 ms. */
PELL_API struct pell_half_space_angle pell_half_space_angle_of(double total, double eta);

/* The same for multiply scattered light alone: `angle`, of that medium, minus isotropic single scattering
 * (pell_single_scattering_albedo_at). `albedo` is the medium's alpha', `total` the reflectance of its half-space. */
PELL_API struct pell_half_space_angle pell_half_space_angle_multiple(double total, double albedo, double eta,
                                                                     struct pell_half_space_angle angle);

/* Fraction of the light that entered at the refracted cosine `inside`, in (0, 1], that leaves a half-space after one scattering event, for
 * a single-scattering albedo of 1 and the Henyey-Greenstein phase function: a double integral, error below 1e-4 for abs(g) up to 0.9. NAN
 * out of range. */
PELL_API double pell_single_scattering_albedo_at(double g, double eta, double inside);

/* --- Slab ----------------------------------------------------------------------------------------------------------------------- */

enum { PELL_SLAB_STEPS = 45 }; /* two per octave of optical thickness, from 2^-9 to 2^13 */

/* One channel of a slab of a medium between two smooth boundaries, by transport. Plain data: pell_slab_make fills it, pell_slab_at reads
 * it. */
struct pell_slab {
    double sigma_t, sigma_t_reduced;                                 /* 1/mm */
    double boundary;                                                 /* reflectance at normal incidence */
    double reflected[PELL_SLAB_STEPS], transmitted[PELL_SLAB_STEPS]; /* logarithms, by optical thickness */
    /* `layered`: several media. Optical thickness is then that of the densest, and `transmitted` excludes unscattered light, which
     * follows from `optical`, the actual optical thickness. */
    bool layered;
    double optical[PELL_SLAB_STEPS];
};

/* Fractions of the light that has entered at normal incidence, [0, 1]. */
struct pell_slab_light {
    double reflected, transmitted; /* scattered light */
    double straight;               /* unscattered transmitted light: exp(-sigma_t d) and internal reflections at the boundaries */
};

/* Adding-doubling over 16 directions (van de Hulst 1980; Prahl et al. 1993). Scattering is isotropic with sigma_s_reduced, which represents
 * anisotropic media by similarity; light that such a medium scatters forward counts as transmitted. False, and an empty slab, for an
 * invalid medium. Takes 1 ms. */
PELL_API bool pell_slab_make(const struct pell_medium *medium, int channel, struct pell_slab *out);
/* The same for a slab with the stack's layers below both faces, down to the middle plane, such as an ear with skin on both sides. Light is
 * refracted only at the faces, by the index of the first layer; roughness is ignored. False, and an empty slab, for an invalid stack. Takes
 * 10 ms. */
struct pell_stack;
PELL_API bool pell_slab_make_layers(const struct pell_stack *stack, int channel, struct pell_slab *out);
/* A slab of `d` mm, d >= 0. The relative error of each fraction is below 1e-3 where the fraction is above 1e-6. */
PELL_API struct pell_slab_light pell_slab_at(const struct pell_slab *slab, double d);
/* Lateral spread of light transmitted through a slab of `d` mm, d >= 0: the variance of T(r) along one axis, mm^2, by diffusion from a
 * source one mean free path deep. The medium must be valid; roughness is ignored. Thread-safe. */
PELL_API double pell_slab_spread(const struct pell_medium *medium, int channel, double d);

/* --- Models ------------------------------------------------------------------------------------------------------------------- */

/* Models of R(r). Values are stable. */
enum pell_profile_model {
    PELL_PROFILE_DIPOLE = 0,           /* Jensen et al. 2001 */
    PELL_PROFILE_BETTER_DIPOLE,        /* d'Eon 2012 */
    PELL_PROFILE_NORMALIZED_DIFFUSION, /* Christensen and Burley 2015 */
    PELL_PROFILE_PHOTON_BEAM,          /* Habel et al. 2013 */
    PELL_PROFILE_MONTE_CARLO,          /* a table of simulated photons */
    PELL_PROFILE_MODELS,
};

struct pell_profile_model_row {
    const char *name;   /* "better-dipole": a value of --profile */
    const char *title;  /* display name */
    const char *cite;   /* authors, title, venue, year */
    const char *limits; /* limitations, a sentence */
};

/* The row of enum pell_profile_model `index`; NULL for an index of pell_profile_model_count() or more. Constant data. */
PELL_API size_t pell_profile_model_count(void);
PELL_API const struct pell_profile_model_row *pell_profile_model_at(size_t index);
/* False, and *out unchanged, for an unknown name. */
PELL_API bool pell_profile_model_find(const char *name, enum pell_profile_model *out);

/* --- A profile ---------------------------------------------------------------------------------------------------------------- */

#define PELL_PROFILE_NODES 512
#define PELL_PROFILE_PARAMETERS 40    /* of a closed form: a count and two for each of PELL_GAUSSIANS_MAX Gaussians take 21 */
#define PELL_PROFILE_TOTAL_SLACK 1e-6 /* by which a caller's total may exceed 1: rounded weights and tables */

/* Internal representation of a profile; callers use the functions below. */
enum pell_profile_kind {
    PELL_PROFILE_KIND_POLES = 0, /* closed form */
    PELL_PROFILE_KIND_BURLEY,    /* closed form */
    PELL_PROFILE_KIND_GAUSSIANS, /* closed form */
    PELL_PROFILE_KIND_NODES,     /* monotone cubic between nodes; beyond the last node 0 or the far field of diffusion */
    PELL_PROFILE_KINDS,
};

/* One channel's R(r): the flux that leaves at a distance r from where a unit of flux entered, 1/mm^2; R >= 0, Int 2 pi r R dr <= 1.
 * A value of fixed size (20 KiB) without pointers: it may be copied and need not be freed. The fields are private. */
struct pell_profile {
    int kind;                                  /* enum pell_profile_kind */
    double total;                              /* Int_0^inf 2 pi r R dr, [0, 1] */
    double parameter[PELL_PROFILE_PARAMETERS]; /* of a closed form */
    int count;                                 /* nodes in use */
    double r[PELL_PROFILE_NODES], value[PELL_PROFILE_NODES], slope[PELL_PROFILE_NODES];
    double inside[PELL_PROFILE_NODES]; /* flux inside r */
};

#define PELL_PROFILE_A_MAX 1e4

/* Parameters of a model besides the medium; zeroes are the defaults. A model refuses those it does not use: PELL_ERR_UNSUPPORTED. */
struct pell_profile_params {
    enum pell_fresnel_model fresnel; /* model of Fdr for a smooth boundary; dipole, better-dipole, photon-beam */
    double roughness;                /* of the boundary, [0, 1]; 0: smooth. Changes A by pell_fresnel_diffuse_rough, exact Fresnel only;
                                        dipole, better-dipole, photon-beam (their single scattering leaves through a smooth one) */
    double A;                        /* replaces the value from boundary and eta, (0, PELL_PROFILE_A_MAX]; 0: not set; dipole */
    bool without_single;             /* better-dipole, monte-carlo, photon-beam: exclude single scattering */
};

/* Computes the profile of one channel of a medium by a model. `params` may be NULL. PELL_ERR_INVALID: the medium is not valid, or the
 * channel, model or parameters are out of range; *out is then zero. A channel that does not scatter has total 0. */
PELL_API PELL_NODISCARD enum pell_result pell_profile_make(enum pell_profile_model model, const struct pell_medium *medium, int channel,
                                                           const struct pell_profile_params *params, struct pell_profile *out);

struct pell_profile_fault {
    size_t row;             /* the first faulty row; for "total" the row at which the light exceeds the limit */
    const char *field;      /* "rows", "r_mm", "R", "total": constant text */
    double value, min, max; /* the value (of "total": up to that row), and the allowed range */
};

#define PELL_PROFILE_RADIUS_MAX 1e12  /* mm */
#define PELL_PROFILE_STEP_MIN 1e-12   /* mm between two rows, whose distance must also be at least 1e-12 of the radius */
#define PELL_PROFILE_R_MAX 1e24       /* 1/mm^2 */
#define PELL_PROFILE_TOTAL_MIN 1e-290 /* a profile with less light than this counts as 0 */

/* A user's own table: `count` >= 2 rows of rising radius r_mm[0] >= 0 (mm) and R >= 0 (1/mm^2), interpolated by a cubic that is
 * monotone wherever the rows are; R is R(r_mm[0]) below the first row, and 0 beyond the last. More than PELL_PROFILE_NODES rows are merged:
 * nodes at rows, values such that the light between nodes and the total are unchanged. Refused (PELL_ERR_INVALID, with *fault if
 * not NULL, *out zero) unless Int 2 pi r R dr <= 1 (+ PELL_PROFILE_TOTAL_SLACK). */
PELL_API PELL_NODISCARD enum pell_result pell_profile_from_table(const double *r_mm, const double *R, size_t count,
                                                                 struct pell_profile *out, struct pell_profile_fault *fault);

PELL_API double pell_profile_eval(const struct pell_profile *p, double r_mm); /* R(r), 1/mm^2; r >= 0 */
/* The same for many radii, vectorised. */
PELL_API void pell_profile_eval_many(const struct pell_profile *p, const double *r_mm, double *R, size_t count);
PELL_API double pell_profile_total(const struct pell_profile *p);
PELL_API double pell_profile_cdf(const struct pell_profile *p, double r_mm); /* fraction of the total inside r, [0, 1] */

/* Samples a radius: the inverse of pell_profile_cdf at xi in [0, 1). Uniform xi give radii distributed as 2 pi r R(r)/total. 0 for a
 * profile without light. */
PELL_API double pell_profile_sample(const struct pell_profile *p, double xi);
/* Density per unit area of that sampling, R(r)/total, 1/mm^2. */
PELL_API double pell_profile_pdf(const struct pell_profile *p, double r_mm);

/* Mean distance between where light enters and where it leaves, mm: Int 2 pi r^2 R dr/total, by 256 radii of pell_profile_sample: within
 * 0.5 % of it for the models where sigma_a/sigma_s' is 1e-3 or more. In brighter media, whose last light leaves far away, it is smaller: by
 * 0.7 % at 1e-4, 4 % at 1e-6; without absorption the integral diverges, and this does not. 0 for a profile without light. */
PELL_API double pell_profile_mean_radius(const struct pell_profile *p);

/* Two-dimensional Fourier (Hankel) transform at a radial frequency s in rad/mm, 2 pi Int J0(s r) R(r) r dr; total at s = 0. */
PELL_API double pell_profile_transform(const struct pell_profile *p, double s);

/* Factor by which a curved surface reflects more light than its profile evaluated at straight distances predicts, for a mean curvature
 * `curvature` (1/mm, (k1 + k2)/2, positive where convex): exact diffusion in a ball, or around a spherical cavity, of that radius under
 * uniform light, divided by the part of the profile that the sphere's chords cover. 1 on a plane. Radii are clamped to at least about six
 * mean free paths. `medium` is that of `profile`. Takes 0.3 us. */
PELL_API double pell_curvature_gain(const struct pell_medium *medium, int channel, const struct pell_profile *profile, double curvature);

#ifdef __cplusplus
}
#endif
#endif
