/* SPDX-License-Identifier: MIT
 * profile.c - the profile bench: R(r) of coefficients that a page tries out, by every model, with totals, free paths and a fit. */
#include "viewer/profile.h"

#include "cli/cli.h"
#include "scene/scene.h"

#include <pellucid/gaussians.h>
#include <pellucid/profile.h>

#include <math.h>

#define RADII 48

static json_t *finite(double x)
{
    return isfinite(x) ? json_real(x) : json_null();
}

/* Radii that are evenly spaced in log r and hold 99.9 % of the light of the widest channel. */
static void choose_radii(const struct pell_profile *p, double r[RADII])
{
    double far = 1e-6;

    for (int c = 0; c < 3; c++)
        if (pell_profile_total(&p[c]) > 0.0)
            far = fmax(far, pell_profile_sample(&p[c], 0.999));
    for (int i = 0; i < RADII; i++)
        r[i] = far * pow(1e-3, 1.0 - (double) i / (RADII - 1));
}

static json_t *values_json(const struct pell_profile *p, const double r[RADII])
{
    json_t *channels = json_array();

    for (int c = 0; c < 3; c++) {
        json_t *values = json_array();
        for (int i = 0; i < RADII; i++)
            json_array_append_new(values, finite(pell_profile_eval(&p[c], r[i])));
        json_array_append_new(channels, values);
    }
    return channels;
}

static bool make(enum pell_profile_model model, const struct pell_medium *medium, struct pell_profile *p)
{
    for (int c = 0; c < 3; c++)
        if (pell_profile_make(model, medium, c, NULL, &p[c]) != PELL_OK)
            return false;
    return true;
}

/* The best sum of Gaussians of each channel, with its values over r. */
static json_t *fit_json(const struct pell_profile *p, int count, const double r[RADII])
{
    const struct pell_fit_params params = { .count = count };
    json_t *errors = json_array(), *variances = json_array(), *weights = json_array(), *channels = json_array();

    for (int c = 0; c < 3; c++) {
        struct pell_gaussians g = { .count = 0 };
        json_t *variance = json_array(), *weight = json_array(), *values = json_array();
        const bool there = pell_fit_profile(&p[c], &params, &g, NULL) == PELL_OK;
        for (int i = 0; i < g.count; i++) {
            json_array_append_new(variance, finite(g.variance[i]));
            json_array_append_new(weight, finite(g.weight[i][0]));
        }
        for (int i = 0; i < RADII; i++)
            json_array_append_new(values, finite(there ? pell_gaussians_eval(&g, 0, r[i]) : (double) NAN));
        json_array_append_new(errors, finite(there ? pell_gaussians_error(&g, 0, &p[c], 0.0) : (double) NAN));
        json_array_append_new(variances, variance);
        json_array_append_new(weights, weight);
        json_array_append_new(channels, values);
    }
    return json_pack("{s:i,s:o,s:o,s:o,s:o}", "k", count, "error", errors, "variance_mm2", variances, "weight", weights, "R", channels);
}

static json_t *models_json(const struct pell_medium *medium, struct pell_profile *p, const double r[RADII])
{
    json_t *models = json_array();

    for (size_t i = 0; i < pell_profile_model_count(); i++) {
        const struct pell_profile_model_row *row = pell_profile_model_at(i);
        double totals[3];
        if (!make((enum pell_profile_model) i, medium, p))
            continue;
        for (int c = 0; c < 3; c++)
            totals[c] = pell_profile_total(&p[c]);
        json_array_append_new(models, json_pack("{s:s,s:s,s:s,s:o,s:o}", "name", row->name, "title", row->title, "limits", row->limits,
                                                "total", cli_numbers(totals, 3), "R", values_json(p, r)));
    }
    return models;
}

json_t *viewer_profile(struct pell_context *ctx, const struct viewer_message *m)
{
    const struct pell_json_file file = { .ctx = ctx, .path = "coefficients", .root = m->medium };
    const struct pell_json at = pell_json_root(&file);
    struct pell_medium medium = { .eta = 1.3 };
    struct pell_profile *p;
    double r[RADII], free_path[3], diffuse[3];
    json_t *o = NULL, *radii;

    if (pell_read_medium(&at, &medium) != PELL_OK || !(p = pell_calloc(ctx, 3, sizeof(*p))))
        return NULL;
    if (!make(PELL_PROFILE_DIPOLE, &medium, p)) {
        pell_error(ctx, PELL_ERR_INVALID, "coefficients", NULL, "are out of the range of a medium");
        goto fail;
    }
    choose_radii(p, r);
    for (int c = 0; c < 3; c++) {
        free_path[c] = pell_mean_free_path(&medium, c);
        diffuse[c] = pell_diffuse_mean_free_path(&medium, c);
    }
    radii = cli_numbers(r, RADII);
    o = json_pack("{s:s,s:I,s:o,s:o,s:o,s:o}", "type", "profile", "id", (json_int_t) m->id, "r_mm", radii, "mean_free_path",
                  cli_numbers(free_path, 3), "diffuse_mean_free_path", cli_numbers(diffuse, 3), "fit", fit_json(p, m->gaussians, r));
    if (o)
        json_object_set_new(o, "models", models_json(&medium, p, r));

fail:
    pell_free(ctx, p);
    return o;
}
