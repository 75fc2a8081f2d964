/* SPDX-License-Identifier: MIT
 *
 * pellucid/inversion.h - converts a colour and a length, the parameters of artists, to coefficients.
 *
 * A colour here is the total diffuse reflectance of a half-space: the colour of a homogeneous, thick piece of the material under
 * white light, without its highlight. Albedo: alpha = sigma_s/sigma_t of one scattering event; reduced albedo: alpha' = sigma_s'/sigma_t'.
 * They are related by similarity, alpha = alpha'/(1 - g (1 - alpha')).
 *
 * A colour is converted to an albedo by the closed maps that other programs use (without a boundary, or the dipole's), or by the numeric
 * inversion of any profile model, whose total is then the colour to 1e-9.
 *
 * Units      mm, 1/mm; colours linear, [0, 1]. Channel 0, 1, 2 = R, G, B.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result with a fault that names field, value and range; nothing is logged, because only the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_INVERSION_H
#define PELLUCID_INVERSION_H

#include <pellucid/profile.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Convert alpha' to alpha and back; both in [0, 1], |g| <= PELL_G_MAX. */
PELL_API double pell_albedo_of_reduced(double albedo_reduced, double g);
PELL_API double pell_albedo_reduced_of(double albedo, double g);

/* --- Closed maps ---------------------------------------------------------------------------------------------------------------- */

/* Values are stable. The errors given are the largest absolute errors of the colour over all albedos; see src/optics/README.md. */
enum pell_albedo_map {
    /* (1 - s)(1 - 0.139 s)/(1 + 1.17 s), s = sqrt(1 - alpha'), no boundary, uniform light: van de Hulst 1980; its inverse is Kulla and
     * Conty 2017, d'Eon's "A Hitchhiker's Guide to Multiple Scattering", OpenPBR's, Cycles' and the multi-scatter colour of
     * KHR_materials_volume_scatter. Within 0.0025 (3.2 % of the colour) for g = 0, 0.007 for g in [-0.4, 0.8]; 0.022 too dark at g =
     * -0.8. */
    PELL_ALBEDO_VAN_DE_HULST = 0,
    /* alpha' = 1 - exp(-5.09406 A + 2.61188 A^2 - 4.31805 A^3), no boundary, isotropic: Chiang et al. 2016, Disney's and older Cycles'.
     * Within 0.006 up to a colour of 0.8; its inverse ends at alpha' = 0.9989, a colour of 1 (transport: 0.926). */
    PELL_ALBEDO_CHIANG,
    /* The total of the dipole, with a smooth boundary of index eta: Jensen et al. 2001. 13 to 17 % too bright at low albedos. */
    PELL_ALBEDO_DIPOLE,
    PELL_ALBEDO_MAPS,
};

struct pell_albedo_map_row {
    const char *name; /* "van-de-hulst" */
    const char *cite;
};
/* The row of enum pell_albedo_map `index`; NULL for an index of pell_albedo_map_count() or more. Constant data. */
PELL_API size_t pell_albedo_map_count(void);
PELL_API const struct pell_albedo_map_row *pell_albedo_map_at(size_t index);

/* The colour of a half-space of reduced albedo `albedo_reduced` in [0, 1]; only the dipole's map uses eta. */
PELL_API double pell_albedo_map_color(enum pell_albedo_map map, double albedo_reduced, double eta);
/* Its inverse, the reduced albedo with a colour in [0, 1]. Arguments out of range are clamped; NaN if one is NaN. */
PELL_API double pell_albedo_map_invert(enum pell_albedo_map map, double color, double eta);

/* The colour below a smooth boundary of a medium with this colour without one, for light that has entered: (1 - F) c/(1 - F c), F =
 * Fdr(eta) (Saunderson 1942), and the inverse. Light below is assumed to be uniform: with van de Hulst's map within 0.05 of transport for
 * normal incidence at eta 1.3. Both in [0, 1]; NaN if an argument is NaN. */
PELL_API double pell_color_under_boundary(double color, double eta);
PELL_API double pell_color_without_boundary(double color, double eta);

/* --- Numeric inversion ------------------------------------------------------------------------------------------------------------ */

/* The reduced albedo with which one channel of a profile model has the total `color`, to 1e-9. `params` may be NULL. Colour 0 gives 0; the
 * largest colour the model reaches gives 1. PELL_ERR_INVALID with *fault (may be NULL) if the colour is not in [0, largest] or g or eta is
 * out of range; the result of pell_profile_make, if that fails. Computes about ten profiles. */
PELL_API PELL_NODISCARD enum pell_result pell_albedo_of_color(enum pell_profile_model model, const struct pell_profile_params *params,
                                                              double color, double g, double eta, double *albedo_reduced,
                                                              struct pell_medium_fault *fault);

/* --- Colour and radius ------------------------------------------------------------------------------------------------------------ */

/* Definitions of a length. s(A) = 1.9 - A + 3.5 (A - 0.8)^2, Christensen and Burley 2015. Values are stable. */
enum pell_scatter_radius {
    PELL_SCATTER_RADIUS_MEAN_FREE_PATH = 0, /* 1/sigma_t', as pell_mean_free_path */
    PELL_SCATTER_RADIUS_DIFFUSE,            /* diffuse mean free path 1/sigma_tr, as pell_diffuse_mean_free_path */
    PELL_SCATTER_RADIUS_EXTINCTION,         /* 1/sigma_t: OpenPBR's and Arnold's subsurface radius x scale */
    PELL_SCATTER_RADIUS_BURLEY,             /* d in exp(-r/d) + exp(-r/(3 d)): 1/(s(A) sigma_t); Disney's scatter distance, Chiang et al.
                                             * 2016 */
    PELL_SCATTER_RADIUS_CYCLES,             /* 4 pi/(sigma_t (1 - g)): Cycles' radius of Christensen-Burley and of the random walk */
    PELL_SCATTER_RADIUS_CYCLES_SKIN, /* 1/(sigma_t (1 - g) sqrt(3 (1 - a))), a the dipole's inverse (Fdr of 3 digits): Cycles' random walk
                                      * (skin) */
    PELL_SCATTER_RADIUS_MEAN,        /* pell_profile_mean_radius of the model's profile; in pell_medium_from_map of monte-carlo's */
    PELL_SCATTER_RADII,
};

struct pell_scatter_radius_row {
    const char *name; /* "diffuse" */
    const char *help; /* a sentence */
};
/* The row of enum pell_scatter_radius `index`; NULL for an index of pell_radius_count() or more. Constant data. */
PELL_API size_t pell_radius_count(void);
PELL_API const struct pell_scatter_radius_row *pell_scatter_radius_at(size_t index);
/* False, and *out unchanged, for an unknown name. */
PELL_API bool pell_scatter_radius_find(const char *name, enum pell_scatter_radius *out);

struct pell_color_and_radius {
    double color[3];  /* [0, 1] */
    double radius[3]; /* mm, > 0, as `kind` defines it */
    double g[3];      /* |g| <= PELL_G_MAX */
    double eta;       /* [PELL_ETA_MIN, PELL_ETA_MAX] */
    enum pell_scatter_radius kind;
};

/* The medium whose profile of this model has these colours. *out is zero on failure, *fault (may be NULL) names "color[1]", "radius[0]",
 * "g[2]", "eta" or "kind" with its value and the allowed range. At the largest colour the diffuse mean free path is
 * infinite: a radius of that kind is refused. `params` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_medium_from_color_and_radius(const struct pell_color_and_radius *look,
                                                                           enum pell_profile_model model,
                                                                           const struct pell_profile_params *params,
                                                                           struct pell_medium *out, struct pell_medium_fault *fault);
/* The same by a closed map: the coefficients that another program uses for this colour and radius. */
PELL_API PELL_NODISCARD enum pell_result pell_medium_from_map(const struct pell_color_and_radius *look, enum pell_albedo_map map,
                                                              struct pell_medium *out, struct pell_medium_fault *fault);

#ifdef __cplusplus
}
#endif
#endif
