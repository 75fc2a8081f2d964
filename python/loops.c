/* SPDX-License-Identifier: MIT
 * loops.c - loops over arrays that Python calls once. Part of the source of the extension module: make_binding.py binds what is marked LOOP.
 * A function of one number is called through `fn`, so that the numbers are the library's own to the last bit. */
#include <stdlib.h>

#define LOOP static

/* out[i] = R_channel(r[i]) and so on; `what`: 0 value, 1 cdf, 2 pdf, 3 radius of a share, 4 transform. */
LOOP void pellpy_profile_map(const struct pell_profile *p, int what, const double *x, double *out, size_t count)
{
    static double (*const functions[])(const struct pell_profile *, double) = { pell_profile_eval, pell_profile_cdf, pell_profile_pdf,
                                                                                pell_profile_sample, pell_profile_transform };

    if (what == 0)
        pell_profile_eval_many(p, x, out, count);
    else
        for (size_t i = 0; i < count; i++)
            out[i] = functions[what](p, x[i]);
}

/* Dipoles of many media: out[i][j] at radius r[j]; `what`: 0 R(r), 1 share inside r, 2 density of sampling, 3 radius at the share r[j]. */
LOOP void pellpy_dipoles(const double *sigma_a, const double *sigma_s_reduced, const double *eta, size_t media, int what, const double *r,
                         size_t radii, double *out, double *total)
{
    static double (*const functions[])(const struct pell_dipole *, double) = { pell_dipole_rd, pell_dipole_cdf, pell_dipole_pdf,
                                                                               pell_dipole_sample_one };

    for (size_t i = 0; i < media; i++) {
        const struct pell_dipole d = pell_dipole_make(sigma_a[i], sigma_s_reduced[i], eta[i], PELL_FRESNEL_EXACT);

        if (total)
            total[i] = pell_dipole_total(&d);
        for (size_t j = 0; j < radii; j++)
            out[i * radii + j] = functions[what](&d, r[j]);
    }
}

/* Profiles of many media under a model; the index of the first that fails, or `media`. */
LOOP size_t pellpy_profiles(int model, const double *sigma_a, const double *sigma_s_reduced, const double *g, const double *eta,
                            size_t media, const struct pell_profile_params *params, const double *r, size_t radii, double *out,
                            double *total, int *result)
{
    struct pell_profile *p = malloc(sizeof(*p));
    size_t i = 0;

    *result = p ? PELL_OK : PELL_ERR_NOMEM;
    for (; *result == PELL_OK && i < media; i++) {
        struct pell_medium m = { .eta = eta[i] };

        for (int c = 0; c < 3; c++) {
            m.sigma_a[c] = sigma_a[i];
            m.sigma_s_reduced[c] = sigma_s_reduced[i];
            m.g[c] = g[i];
        }
        *result = pell_profile_make((enum pell_profile_model) model, &m, 0, params, p);
        if (*result != PELL_OK)
            break;
        if (total)
            total[i] = pell_profile_total(p);
        if (radii)
            pell_profile_eval_many(p, r, out + i * radii, radii);
    }
    free(p);
    return i;
}

/* Reduced albedos of colours by a profile model; the index of the first that fails, or `count`. */
LOOP size_t pellpy_albedos(int model, const struct pell_profile_params *params, const double *color, const double *g, const double *eta,
                           size_t count, double *out, struct pell_medium_fault *fault, int *result)
{
    size_t i = 0;

    *result = PELL_OK;
    for (; i < count; i++) {
        *result = pell_albedo_of_color((enum pell_profile_model) model, params, color[i], g[i], eta[i], &out[i], fault);
        if (*result != PELL_OK)
            break;
    }
    return i;
}

/* The same by a closed map, both ways. */
LOOP void pellpy_albedo_map(int map, bool invert, const double *x, const double *eta, size_t count, double *out)
{
    for (size_t i = 0; i < count; i++)
        out[i] = invert ? pell_albedo_map_invert((enum pell_albedo_map) map, x[i], eta[i])
                        : pell_albedo_map_color((enum pell_albedo_map) map, x[i], eta[i]);
}

LOOP void pellpy_gaussians(const struct pell_gaussians *g, int channel, const double *r, double *out, size_t count)
{
    for (size_t i = 0; i < count; i++)
        out[i] = pell_gaussians_eval(g, channel, r[i]);
}

/* `what`: 0 pell_fresnel(a, b), 1 pell_fresnel_diffuse(a), 2 pell_fresnel_diffuse_rough(a, b), 3 pell_fresnel_exit_norm(a),
 * 4 pell_half_space_albedo(a, b), 5 pell_albedo_of_reduced(a, b), 6 pell_albedo_reduced_of(a, b). */
LOOP void pellpy_pairs(int what, const double *a, const double *b, double *out, size_t count)
{
    for (size_t i = 0; i < count; i++)
        switch (what) {
        case 0: out[i] = pell_fresnel(a[i], b[i]); break;
        case 1: out[i] = pell_fresnel_diffuse(a[i], PELL_FRESNEL_EXACT); break;
        case 2: out[i] = pell_fresnel_diffuse_rough(a[i], b[i]); break;
        case 3: out[i] = pell_fresnel_exit_norm(a[i]); break;
        case 4: out[i] = pell_half_space_albedo(a[i], b[i]); break;
        case 5: out[i] = pell_albedo_of_reduced(a[i], b[i]); break;
        default: out[i] = pell_albedo_reduced_of(a[i], b[i]); break;
        }
}

/* `what`: 0 value, 1 share scattered by more, 2 cosine of a share. */
LOOP void pellpy_phase(const struct pell_phase *p, int what, const double *x, double *out, size_t count)
{
    static double (*const functions[])(const struct pell_phase *, double) = { pell_phase_value, pell_phase_cdf,
                                                                              pell_phase_sample_cosine };

    for (size_t i = 0; i < count; i++)
        out[i] = functions[what](p, x[i]);
}

/* Creates a context as programs in C do, with the version of the headers that this module was compiled with. */
LOOP enum pell_result pellpy_context(void *user, int level, bool progress, void (*log)(void *, const struct pell_message *),
                                     void (*report)(void *, const char *, double), struct pell_context **out)
{
    const struct pell_context_params params = { .log = log, .log_user = user, .log_level = (enum pell_log_level) level,
                                                .progress = progress ? report : NULL, .progress_user = user };

    return pell_context_create(&params, out);
}
