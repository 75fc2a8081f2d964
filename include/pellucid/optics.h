/* SPDX-License-Identifier: MIT
 *
 * pellucid/optics.h - from optical coefficients to diffusion profiles, sums of Gaussians and materials. No scene, no files, no GPU,
 * no global state: numbers in, numbers out.
 *
 * Units      mm, 1/mm, profiles 1/mm^2; eta = n_inside / n_outside. Channel 0, 1, 2 = R, G, B.
 * Errors     functions that can fail return enum pell_result; nothing is logged here: the caller knows the names.
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_OPTICS_H
#define PELLUCID_OPTICS_H

#include <pellucid/common.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PELL_SIGMA_MAX 1e6   /* largest coefficient: a mean free path of a nanometre */
#define PELL_SIGMA_T_MIN 1e-6 /* smallest sigma_a + sigma_s_reduced: a mean free path of a kilometre */
#define PELL_G_MAX 0.9999    /* largest |g| */

/* A homogeneous medium behind a smooth boundary. */
struct pell_medium {
    double sigma_a[3];         /* absorption, [0, PELL_SIGMA_MAX] */
    double sigma_s_reduced[3]; /* sigma_s (1 - g), [0, PELL_SIGMA_MAX]; sigma_a + sigma_s_reduced >= PELL_SIGMA_T_MIN */
    double g[3];               /* mean cosine, |g| <= PELL_G_MAX; for methods that see single scattering; 0 where only reduced is known */
    double eta;                /* [1, 4] */
};

/* The first field out of range as "sigma_a[2]" with its value and range for a message, or NULL if the medium is valid. */
struct pell_medium_fault {
    const char *field;
    double value, min, max;
};
PELL_API bool pell_medium_valid(const struct pell_medium *medium, struct pell_medium_fault *fault);

/* --- Fresnel ----------------------------------------------------------------------------------------------------------------- */

/* Unpolarised reflectance of a smooth dielectric; cos_i in [0, 1] on the side of the incident ray, eta = n_transmitted/n_incident. */
PELL_API double pell_fresnel(double eta, double cos_i);

/* How the average diffuse reflectance is computed; exact is the default everywhere, the polynomials are the literature's. */
enum pell_fresnel_model { PELL_FRESNEL_EXACT, PELL_FRESNEL_POLY3, PELL_FRESNEL_POLY4 };

/* Fdr: reflectance averaged over a diffuse (cosine) hemisphere, with the literature's convention: eta = n_inside/n_outside > 1 is
 * light that meets the boundary from INSIDE, Fdr(n) = 2 Int_0^1 pell_fresnel(1/n, mu) mu dmu. Light from outside on the same
 * boundary: pell_fresnel_diffuse(1/n). */
PELL_API double pell_fresnel_diffuse(double eta, enum pell_fresnel_model model);

/* 2 Int_0^1 (1 - pell_fresnel(eta, mu)) mu dmu = 1 - Fdr(1/eta), the mean transmittance for diffuse light from outside. Dividing the
 * exit transmittance by it keeps the energy of light that has already left: L = (1 - F) M / (pi pell_fresnel_exit_norm(eta)). */
PELL_API double pell_fresnel_exit_norm(double eta);

/* --- Dipole (Jensen et al. 2001) ---------------------------------------------------------------------------------------------- */

struct pell_dipole {
    double sigma_t_reduced, albedo_reduced, sigma_tr;
    double A;      /* (1 + Fdr)/(1 - Fdr) */
    double zr, zv; /* depths of the real and the virtual source */
};

PELL_API struct pell_dipole pell_dipole_make(double sigma_a, double sigma_s_reduced, double eta, enum pell_fresnel_model model);
PELL_API double pell_dipole_rd(const struct pell_dipole *d, double r_mm);  /* R_d(r), 1/mm^2 */
PELL_API double pell_dipole_total(const struct pell_dipole *d);            /* 2 pi Int r R_d dr */
PELL_API double pell_dipole_cdf(const struct pell_dipole *d, double r_mm); /* share of the total inside r, [0, 1] */

/* --- Sums of Gaussians -------------------------------------------------------------------------------------------------------- */

#define PELL_GAUSSIANS_MAX 10

/* R_c(r) = Sum_i weight[i][c] exp(-r^2/(2 variance[i])) / (2 pi variance[i]); variances shared by the channels and rising. */
struct pell_gaussians {
    int count; /* 1..PELL_GAUSSIANS_MAX; 0: none */
    double variance[PELL_GAUSSIANS_MAX];  /* mm^2 */
    double weight[PELL_GAUSSIANS_MAX][3]; /* Sum over i = the channel's total reflectance */
};

PELL_API double pell_gaussians_eval(const struct pell_gaussians *g, int channel, double r_mm); /* 1/mm^2 */
PELL_API double pell_gaussians_total(const struct pell_gaussians *g, int channel);

/* What a fit reports: error (10) of d'Eon et al. 2007, sqrt(Int r (R - G)^2 dr) / sqrt(Int r R^2 dr), as a fraction. */
struct pell_fit_report {
    double error[3];
    int evaluations;
};

struct pell_fit_params {
    int count;        /* 1..PELL_GAUSSIANS_MAX */
    bool free_energy; /* false: weights of a channel sum to the profile's total exactly */
};

/* One channel's best sum of Gaussians for a dipole; writes weight[i][0], all of them >= 0. Nothing is allocated; a fit needs about
 * 150 KiB of stack and milliseconds. An albedo of 0 gives count 0. `report` may be NULL. PELL_ERR_INVALID for a count or dipole out
 * of range. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_dipole(const struct pell_dipole *dipole, const struct pell_fit_params *params,
                                                         struct pell_gaussians *out, struct pell_fit_report *report);

/* The three channels of a medium with shared variances, each channel's total kept (unless free_energy), so that one blur serves all:
 * minimises the sum over channels of the squared error (10). Weights are >= 0; a channel that scatters nothing has weights 0 (count 0
 * if all three do). `report` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_medium(const struct pell_medium *medium, const struct pell_fit_params *params,
                                                         struct pell_gaussians *out, struct pell_fit_report *report);

/* --- Materials ---------------------------------------------------------------------------------------------------------------- */

enum pell_material_kind {
    PELL_MATERIAL_MEDIUM,    /* coefficients: `medium` holds */
    PELL_MATERIAL_GAUSSIANS, /* a published sum of Gaussians: `gaussians` holds, normalised to white; colour comes from textures */
};

/* One entry of data/materials, built in. Constant data. */
struct pell_material_entry {
    const char *name;  /* "wholemilk" */
    const char *title; /* "Whole milk" */
    enum pell_material_kind kind;
    struct pell_medium medium;       /* GAUSSIANS: eta only, coefficients 0 */
    struct pell_gaussians gaussians;
    double color[3];                 /* what it looks like where nothing else says: diffuse reflectance or base colour, [0, 1] */
    double roughness;                /* of its specular lobe, (0, 1] */
    double mix;                      /* mix exponent of a colour texture, [0, 1] */
    bool color_from_texture;         /* base colour textures apply (skin presets), else the profile's own colour */
    const char *note;                /* "artistic", or what a user should know; may be "" */
    const char *source;              /* where every number comes from */
};

PELL_API size_t pell_material_count(void);
PELL_API const struct pell_material_entry *pell_material_at(size_t index); /* sorted by name; NULL past the end */
PELL_API const struct pell_material_entry *pell_material_find(const char *name); /* NULL if there is none of that name */

/* Mean free path 1/(sigma_a + sigma_s_reduced) and diffuse mean free path 1/sigma_tr of a channel, mm; infinite where the divisor is 0. */
PELL_API double pell_mean_free_path(const struct pell_medium *medium, int channel);
PELL_API double pell_diffuse_mean_free_path(const struct pell_medium *medium, int channel);

#ifdef __cplusplus
}
#endif
#endif
