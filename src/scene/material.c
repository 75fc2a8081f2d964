/* SPDX-License-Identifier: MIT
 * material.c - material files, and coefficients from the colour that a thing shall have. */
#include "base/file.h"
#include "scene/json.h"
#include "scene/scene.h"

#include <string.h>

enum { BISECTIONS = 60 };

double pell_albedo_of_total(double total, double eta)
{
    /* The total reflectance of the dipole depends on the reduced albedo and eta alone, and rises with the albedo (Jensen et al. 2001,
     * eq. 15): the extinction can be 1. */
    double low = 0.0, high = 1.0;

    if (total <= 0.0)
        return 0.0;
    if (total >= 1.0)
        return 1.0;
    for (int i = 0; i < BISECTIONS; i++) {
        const double middle = 0.5 * (low + high);
        const struct pell_dipole d = pell_dipole_make(1.0 - middle, middle, eta, PELL_FRESNEL_EXACT);
        *(pell_dipole_total(&d) < total ? &low : &high) = middle;
    }
    return 0.5 * (low + high);
}

bool pell_material_is_path(const char *text)
{
    return strchr(text, '/') || pell_path_has_extension(text, "json");
}

static const char *const material_keys[] = { "$schema", "name", "title", "kind", "sigma_a", "sigma_s_reduced", "sigma_s", "g", "eta",
                                             "variances", "weights", "same_profile_as", "color", "roughness", "mix", "color_from", "note",
                                             "source" };

/* "g" is one number or three. */
static enum pell_result read_g(const struct pell_json *root, double *g)
{
    const struct pell_json at = pell_json_get(root, "g");
    enum pell_result res;

    if (!json_is_number(at.value))
        return pell_json_numbers(root, "g", 3, -0.9999, 0.9999, g);
    res = pell_json_to_number(&at, -0.9999, 0.9999, &g[0]);
    g[1] = g[2] = g[0];
    return res;
}

static bool has(const struct pell_json *root, const char *key)
{
    return pell_json_get(root, key).value != NULL;
}

enum pell_result pell_read_medium(const struct pell_json *at, struct pell_medium *medium)
{
    const enum pell_result code = at->file->range ? at->file->range : PELL_ERR_INVALID;
    struct pell_medium_fault fault;
    double sigma_s[3];
    enum pell_result res;

    PELL_TRY(pell_json_require(at, "sigma_a"));
    PELL_TRY(pell_json_numbers(at, "sigma_a", 3, 0.0, 1e6, medium->sigma_a));
    medium->g[0] = medium->g[1] = medium->g[2] = 0.0;
    PELL_TRY(read_g(at, medium->g));
    if (has(at, "sigma_s") && has(at, "sigma_s_reduced"))
        return pell_json_error(at, code, "sigma_s_reduced = sigma_s (1 - g)", "has both sigma_s and sigma_s_reduced; one is allowed");
    if (has(at, "sigma_s")) {
        if (!has(at, "g"))
            return pell_json_error(at, code, "write sigma_s_reduced if the coefficients are reduced", "has sigma_s without g");
        PELL_TRY(pell_json_numbers(at, "sigma_s", 3, 0.0, 1e6, sigma_s));
        for (int c = 0; c < 3; c++)
            medium->sigma_s_reduced[c] = sigma_s[c] * (1.0 - medium->g[c]);
    } else {
        PELL_TRY(pell_json_require(at, "sigma_s_reduced"));
        PELL_TRY(pell_json_numbers(at, "sigma_s_reduced", 3, 0.0, 1e6, medium->sigma_s_reduced));
    }
    PELL_TRY(pell_json_number(at, "eta", 1.0, 4.0, &medium->eta));
    if (!pell_medium_valid(medium, &fault))
        return pell_json_error(at, code, NULL, "%s is %g, allowed: [%g, %g]; sigma_a + sigma_s_reduced must not be 0", fault.field,
                               fault.value, fault.min, fault.max);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_gaussians(const struct pell_json *root, struct pell_gaussians *g)
{
    struct pell_json variances, weights;
    double sum[3] = { 0 };
    const char *same = NULL;
    enum pell_result res;

    PELL_TRY(pell_json_string(root, "same_profile_as", &same));
    if (same) {
        const struct pell_material_entry *other = pell_material_find(same);
        const struct pell_json at = pell_json_get(root, "same_profile_as");
        struct pell_text where;
        if (!other)
            return pell_material_unknown(root->file->ctx, pell_json_where(&at, &where), same);
        if (other->gaussians.count == 0)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "\"%s\" has no Gaussians", other->name);
        *g = other->gaussians;
        return PELL_OK;
    }
    PELL_TRY(pell_json_require(root, "variances"));
    PELL_TRY(pell_json_require(root, "weights"));
    PELL_TRY(pell_json_array(root, "variances", 1, PELL_GAUSSIANS_MAX, &variances));
    g->count = (int) pell_json_count(&variances);
    PELL_TRY(pell_json_array(root, "weights", (size_t) g->count, (size_t) g->count, &weights));
    for (int i = 0; i < g->count; i++) {
        const struct pell_json v = pell_json_at(&variances, (size_t) i), w = pell_json_at(&weights, (size_t) i);
        PELL_TRY(pell_json_to_number(&v, i ? g->variance[i - 1] : 1e-12, 1e12, &g->variance[i]));
        PELL_TRY(pell_json_to_numbers(&w, 3, 0.0, 1.0, g->weight[i]));
        for (int c = 0; c < 3; c++)
            sum[c] += g->weight[i][c];
    }
    for (int c = 0; c < 3; c++) {
        if (!(sum[c] > 1e-6))
            return pell_json_error(&weights, PELL_ERR_FORMAT, NULL, "the weights of channel %d sum to %g, which must be above 0", c,
                                   sum[c]);
        for (int i = 0; i < g->count; i++)
            g->weight[i][c] /= sum[c];
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_entry(const struct pell_json *root, struct pell_material_entry *e)
{
    static const char *const kinds[] = { "medium", "gaussians" }, *const sources[] = { "profile", "texture" };
    int kind = has(root, "variances") || has(root, "same_profile_as"), color_from;
    enum pell_result res;

    PELL_TRY(pell_json_only(root, material_keys, PELL_COUNT(material_keys)));
    PELL_TRY(pell_json_choice(root, "kind", kinds, PELL_COUNT(kinds), &kind));
    e->kind = kind ? PELL_MATERIAL_GAUSSIANS : PELL_MATERIAL_MEDIUM;
    color_from = kind;
    e->medium.eta = 1.3;
    if (kind) {
        for (const char *const *k = (const char *const[]) { "sigma_a", "sigma_s", "sigma_s_reduced", "g", NULL }; *k; k++) {
            const struct pell_json at = pell_json_get(root, *k);
            if (at.value)
                return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "a sum of Gaussians has no coefficients");
        }
        PELL_TRY(pell_json_number(root, "eta", 1.0, 4.0, &e->medium.eta));
        PELL_TRY(read_gaussians(root, &e->gaussians));
    } else {
        for (const char *const *k = (const char *const[]) { "variances", "weights", "same_profile_as", NULL }; *k; k++) {
            const struct pell_json at = pell_json_get(root, *k);
            if (at.value)
                return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "a medium has no Gaussians");
        }
        PELL_TRY(pell_read_medium(root, &e->medium));
    }
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d =
            pell_dipole_make(e->medium.sigma_a[c], e->medium.sigma_s_reduced[c], e->medium.eta, PELL_FRESNEL_EXACT);
        e->color[c] = kind ? 0.8 : fmin(1.0, fmax(0.0, pell_dipole_total(&d)));
    }
    e->roughness = 0.3;
    e->mix = 0.5;
    PELL_TRY(pell_json_numbers(root, "color", 3, 0.0, 1.0, e->color));
    PELL_TRY(pell_json_number(root, "roughness", 1e-3, 1.0, &e->roughness));
    PELL_TRY(pell_json_number(root, "mix", 0.0, 1.0, &e->mix));
    PELL_TRY(pell_json_choice(root, "color_from", sources, PELL_COUNT(sources), &color_from));
    e->color_from_texture = color_from == 1;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_material_read(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                    struct pell_material_entry *entry)
{
    struct pell_json_file file = { .ctx = ctx, .path = path, .range = PELL_ERR_FORMAT };
    const char *name = pell_path_name(path), *text = NULL;
    struct pell_json root;
    enum pell_result res;

    memset(entry, 0, sizeof(*entry));
    PELL_TRY(pell_json_parse(&file, data, size));
    root = pell_json_root(&file);
    PELL_TRY(pell_json_is_object(&root));
    PELL_TRY(read_entry(&root, entry));
    PELL_TRY(pell_json_string(&root, "name", &name));
    for (const char *const *k = (const char *const[]) { "title", "note", "source", "$schema", NULL }; *k; k++)
        PELL_TRY(pell_json_string(&root, *k, &text)); /* types only: they are for people */
    entry->title = entry->note = entry->source = "";
    entry->name = pell_strdup(ctx, name);
    res = entry->name ? PELL_OK : PELL_ERR_NOMEM;

fail:
    pell_json_finish(&file);
    return res;
}

enum pell_result pell_material_open(struct pell_context *ctx, const char *where, const char *text, struct pell_material_entry *entry)
{
    const struct pell_material_entry *found = pell_material_find(text);
    uint8_t *data = NULL;
    size_t size;
    enum pell_result res;

    memset(entry, 0, sizeof(*entry));
    if (found) {
        *entry = *found;
        entry->name = pell_strdup(ctx, found->name);
        return entry->name ? PELL_OK : PELL_ERR_NOMEM;
    }
    if (!pell_material_is_path(text))
        return pell_material_unknown(ctx, where, text);
    PELL_TRY(pell_file_read(ctx, text, &data, &size));
    PELL_TRY(pell_material_read(ctx, text, data, size, entry));

fail:
    pell_free(ctx, data);
    return res;
}
