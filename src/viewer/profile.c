/* SPDX-License-Identifier: MIT
 * profile.c - the profile bench: R(r) of coefficients edited in a page, by every model, with totals, mean free paths and a fit. */
#include "viewer/profile.h"

#include "cli/cli.h"
#include "cli/profile/profile.h"
#include "scene/scene.h"

#include <pellucid/gaussians.h>
#include <pellucid/profile.h>

#include <math.h>
#include <stdlib.h>

#define RADII 48
#define THICKNESSES 33
#define TAPS 25 /* size of the separable kernel in exported code: --taps of `pellucid profile` */

/* Radii spaced uniformly in log r that hold 99.9 % of the light of the widest channel. */
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
            json_array_append_new(values, cli_number(pell_profile_eval(&p[c], r[i])));
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
            json_array_append_new(variance, cli_number(g.variance[i]));
            json_array_append_new(weight, cli_number(g.weight[i][0]));
        }
        for (int i = 0; i < RADII; i++)
            json_array_append_new(values, cli_number(there ? pell_gaussians_eval(&g, 0, r[i]) : (double) NAN));
        json_array_append_new(errors, cli_number(there ? pell_gaussians_error(&g, 0, &p[c], 0.0) : (double) NAN));
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

/* Fraction of the light that a slab transmits over its thickness, from a tenth of the shortest mean free path to where 1e-4 is left. */
static json_t *slab_json(const struct pell_medium *medium)
{
    struct pell_slab slab[3];
    double thickness[THICKNESSES], least = INFINITY, most = 0.0;
    json_t *channels = json_array();

    for (int c = 0; c < 3; c++) {
        double d;
        if (!pell_slab_make(medium, c, &slab[c])) {
            json_decref(channels);
            return json_null();
        }
        d = 0.1 * pell_mean_free_path(medium, c);
        least = fmin(least, d);
        for (int i = 0; i < 60 && pell_slab_at(&slab[c], d).transmitted + pell_slab_at(&slab[c], d).straight > 1e-4; i++)
            d *= 1.3;
        most = fmax(most, d);
    }
    for (int i = 0; i < THICKNESSES; i++)
        thickness[i] = least * pow(most / least, (double) i / (THICKNESSES - 1));
    for (int c = 0; c < 3; c++) {
        json_t *values = json_array();
        for (int i = 0; i < THICKNESSES; i++) {
            const struct pell_slab_light light = pell_slab_at(&slab[c], thickness[i]);
            json_array_append_new(values, cli_number(light.transmitted + light.straight));
        }
        json_array_append_new(channels, values);
    }
    return json_pack("{s:o,s:o}", "thickness_mm", cli_numbers(thickness, THICKNESSES), "T", channels);
}

/* Reads a message's coefficients. */
static enum pell_result read_medium(struct pell_context *ctx, const struct viewer_message *m, struct pell_medium *medium)
{
    const struct pell_json_file file = { .ctx = ctx, .path = "coefficients", .root = m->medium };
    const struct pell_json at = pell_json_root(&file);

    *medium = (struct pell_medium) { .eta = 1.3 };
    return pell_read_medium(&at, medium);
}

static json_t *stack_json(const struct pell_material_layers *layers)
{
    json_t *list = json_array();

    for (int i = 0; i < layers->count; i++) {
        const struct pell_material_layer *l = &layers->item[i];
        json_array_append_new(list,
                              json_pack("{s:s,s:o,s:o,s:o}", "name", l->name, "thickness_mm", cli_number(l->thickness_mm), "sigma_a",
                                        cli_numbers(l->medium.sigma_a, 3), "sigma_s_reduced", cli_numbers(l->medium.sigma_s_reduced, 3)));
    }
    return list;
}

/* The composition of skin: its layers, and their combined profile. */
static json_t *skin_profile(struct pell_context *ctx, const struct viewer_message *m)
{
    const struct pell_json_file file = { .ctx = ctx, .path = "material", .root = m->material };
    const struct pell_json at = pell_json_root(&file);
    struct pell_material_entry *e = pell_calloc(ctx, 1, sizeof(*e));
    struct pell_profile *p = pell_calloc(ctx, 3, sizeof(*p));
    double r[RADII], totals[3];
    json_t *o = NULL;

    if (!e || !p || pell_material_read_skin(&at, e) != PELL_OK)
        goto fail;
    for (int c = 0; c < 3; c++) {
        if (pell_profile_from_gaussians(&e->gaussians, c, &p[c]) != PELL_OK)
            goto fail;
        totals[c] = pell_profile_total(&p[c]);
    }
    choose_radii(p, r);
    o = json_pack("{s:s,s:I,s:o,s:o,s:[{s:s,s:s,s:s,s:o,s:o}]}", "type", "profile", "id", (json_int_t) m->id, "layers",
                  stack_json(&e->layers), "r_mm", cli_numbers(r, RADII), "models", "name", "layers", "title", "Its layers", "limits",
                  "Two layers by multipole and dipole (Donner and Jensen 2005, 2006).", "total", cli_numbers(totals, 3), "R",
                  values_json(p, r));

fail:
    pell_free(ctx, e);
    pell_free(ctx, p);
    return o;
}

json_t *viewer_profile(struct pell_context *ctx, const struct viewer_message *m)
{
    struct pell_medium medium;
    struct pell_profile *p;
    double r[RADII], free_path[3], diffuse[3];
    json_t *o = NULL, *radii;

    if (!m->medium)
        return skin_profile(ctx, m);
    if (read_medium(ctx, m, &medium) != PELL_OK || !(p = pell_calloc(ctx, 3, sizeof(*p))))
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
        json_object_set_new(o, "slab", slab_json(&medium));
    if (o)
        json_object_set_new(o, "models", models_json(&medium, p, r));

fail:
    pell_free(ctx, p);
    return o;
}

enum pell_result viewer_profile_code(struct pell_context *ctx, const struct viewer_message *m, uint8_t **file, size_t *size)
{
    const struct pell_fit_params fit = { .count = m->gaussians };
    struct profile_job job = { .name = "material", .titles = { "red", "green", "blue" }, .has_medium = true };
    struct profile_text text = { .length = 0 };
    enum pell_result res;

    PELL_TRY(read_medium(ctx, m, &job.medium));
    job.model = pell_profile_model_at(PELL_PROFILE_DIPOLE)->name;
    res = PELL_ERR_NOMEM;
    if (!(job.profile = pell_calloc(ctx, 1, sizeof(*job.profile))))
        goto fail;
    res = make(PELL_PROFILE_DIPOLE, &job.medium, job.profile->R) ? profile_add_fit(&job, &fit, false) : PELL_ERR_INVALID;
    if (res == PELL_OK)
        res = profile_code(&job, m->export, TAPS, 1, &text, NULL);
    if (res != PELL_OK)
        res = pell_error(ctx, res, "export", "c, glsl, hlsl and json are languages", "\"%s\": the coefficients give no code (%s)",
                         m->export, pell_result_name(res));

fail:
    pell_free(ctx, job.profile);
    if (res != PELL_OK) {
        free(text.bytes);
        return res;
    }
    *file = (uint8_t *) text.bytes;
    *size = text.length;
    return PELL_OK;
}
