/* SPDX-License-Identifier: MIT
 * material_file.c - material files, and coefficients from a target colour. */
#include "base/file.h"
#include "scene/file/json.h"
#include "scene/file/scene_file.h"
#include "scene/scene.h"

#include <pellucid/layers.h>
#include <pellucid/skin.h>

#include <math.h>
#include <string.h>

bool pell_material_is_path(const char *text)
{
    return strchr(text, '/') || pell_path_has_extension(text, "json");
}

static const char *const material_keys[] = { "$schema",
                                             "name",
                                             "title",
                                             "kind",
                                             "family",
                                             "sigma_a",
                                             "sigma_s_reduced",
                                             "sigma_s",
                                             "g",
                                             "eta",
                                             "concentration",
                                             "same_medium_as",
                                             "dilution",
                                             "variances",
                                             "weights",
                                             "same_profile_as",
                                             "layers",
                                             "skin",
                                             "color",
                                             "roughness",
                                             "mix",
                                             "color_from",
                                             "note",
                                             "source" };
static const char *const layer_keys[] = { "name", "thickness_mm", "sigma_a", "sigma_s_reduced", "sigma_s", "phase", "g", "eta" };
const char *const pell_skin_keys[PELL_SKIN_KEYS] = { "melanin", "melanin_blend", "haemoglobin", "oxygenation", "epidermis_mm", "eta" };

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

enum pell_result pell_read_medium(const struct pell_json *at, struct pell_medium *medium)
{
    const enum pell_result code = at->file->range_error ? at->file->range_error : PELL_ERR_INVALID;
    struct pell_medium_fault fault;
    double sigma_s[3];
    enum pell_result res;

    PELL_TRY(pell_json_require(at, "sigma_a"));
    PELL_TRY(pell_json_numbers(at, "sigma_a", 3, 0.0, 1e6, medium->sigma_a));
    medium->g[0] = medium->g[1] = medium->g[2] = 0.0;
    PELL_TRY(read_g(at, medium->g));
    if (pell_json_has(at, "sigma_s") && pell_json_has(at, "sigma_s_reduced"))
        return pell_json_error(at, code, "sigma_s_reduced = sigma_s (1 - g)", "has both sigma_s and sigma_s_reduced; one is allowed");
    if (pell_json_has(at, "sigma_s")) {
        if (!pell_json_has(at, "g"))
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

/* --- Solutions ---------------------------------------------------------------------------------------------------------------- */

/* Reads its own or another material's coefficients, at the requested concentration. */
static enum pell_result read_solution(const struct pell_json *root, struct pell_material_entry *e)
{
    const struct pell_json at = pell_json_get(root, "concentration");
    double concentration = 1.0;
    const char *same = NULL;
    enum pell_result res;

    PELL_TRY(pell_json_string(root, "same_medium_as", &same));
    if (same) {
        const struct pell_material_entry *other = pell_material_find(same);
        const struct pell_json name = pell_json_get(root, "same_medium_as");
        struct pell_text where;
        for (const char *const *k = (const char *const[]) { "sigma_a", "sigma_s", "sigma_s_reduced", "g", "dilution", NULL }; *k; k++) {
            const struct pell_json own = pell_json_get(root, *k);
            if (own.value)
                return pell_json_error(&own, PELL_ERR_FORMAT, NULL, "stands beside same_medium_as; one of them is allowed");
        }
        if (!other)
            return pell_material_unknown(root->file->ctx, pell_json_where(&name, &where), same);
        if (other->kind != PELL_MATERIAL_MEDIUM)
            return pell_json_error(&name, PELL_ERR_FORMAT, NULL, "\"%s\" has no coefficients of one medium", other->name);
        e->medium = other->medium;
        e->dilution = other->dilution;
        PELL_TRY(pell_json_number(root, "eta", 1.0, 4.0, &e->medium.eta));
    } else {
        PELL_TRY(pell_read_medium(root, &e->medium));
        PELL_TRY(pell_json_number(root, "dilution", 1.0, 1e6, &e->dilution));
    }
    e->concentration = 1.0;
    if (!at.value)
        return PELL_OK;
    PELL_TRY(pell_json_to_number(&at, -INFINITY, INFINITY, &concentration));
    if (!(concentration > 0.0 && concentration <= PELL_CONCENTRATION_MAX))
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %g, allowed: above 0, at most %g", concentration, PELL_CONCENTRATION_MAX);
    if (pell_material_dilute(e, concentration, e) != PELL_OK)
        return pell_json_error(&at, PELL_ERR_FORMAT, "pure water is no medium here: what neither scatters nor absorbs has no profile",
                               "is %g, which takes sigma_a + sigma_s_reduced out of [%g, %g] 1/mm", concentration, PELL_SIGMA_T_MIN,
                               PELL_SIGMA_MAX);
    return PELL_OK;

fail:
    return res;
}

/* --- Sums of Gaussians -------------------------------------------------------------------------------------------------------- */

/* `scale`: weights are scaled to a sum of 1 per channel; else the sum is the total reflectance, at most 1. */
static enum pell_result read_sum(const struct pell_json *root, bool scale, struct pell_gaussians *g)
{
    struct pell_json variances, weights;
    double sum[3] = { 0 };
    enum pell_result res;

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
        if (!scale && sum[c] > 1.0)
            return pell_json_error(&weights, PELL_ERR_FORMAT, NULL, "the weights of channel %d sum to %g; a stack reflects at most 1", c,
                                   sum[c]);
        for (int i = 0; scale && i < g->count; i++)
            g->weight[i][c] /= sum[c];
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_gaussians(const struct pell_json *root, struct pell_gaussians *g)
{
    const char *same = NULL;
    enum pell_result res;

    PELL_TRY(pell_json_string(root, "same_profile_as", &same));
    if (same) {
        const struct pell_material_entry *other = pell_material_find(same);
        const struct pell_json at = pell_json_get(root, "same_profile_as");
        struct pell_text where;
        if (!other)
            return pell_material_unknown(root->file->ctx, pell_json_where(&at, &where), same);
        if (other->kind != PELL_MATERIAL_GAUSSIANS)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "\"%s\" has no Gaussians", other->name);
        *g = other->gaussians;
        return PELL_OK;
    }
    return read_sum(root, true, g);

fail:
    return res;
}

/* --- Layers ------------------------------------------------------------------------------------------------------------------- */

static enum pell_result read_thickness(const struct pell_json *at, bool last, double *thickness)
{
    const struct pell_json value = pell_json_get(at, "thickness_mm");
    const char *text;
    enum pell_result res;

    PELL_TRY(pell_json_require(at, "thickness_mm"));
    if (!json_is_string(value.value))
        return pell_json_to_number(&value, 1e-6, 1e6, thickness);
    PELL_TRY(pell_json_to_string(&value, &text));
    if (strcmp(text, "infinite") != 0 || !last)
        return pell_json_error(&value, PELL_ERR_FORMAT, "thickness_mm is a number, in mm",
                               "must be a number; only the last layer may be \"infinite\"");
    *thickness = INFINITY;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_layer(const struct pell_json *at, bool last, double eta, struct pell_material_layer *item)
{
    static const char *const phases[] = { "hg", "schlick", "rayleigh" }; /* in the order of enum pell_phase_kind */
    struct pell_medium *m = &item->medium;
    struct pell_medium_fault fault;
    const char *name = "";
    double sigma_s[3], g[3] = { 0 };
    int phase = PELL_PHASE_HENYEY_GREENSTEIN;
    enum pell_result res;

    m->eta = eta;
    PELL_TRY(pell_json_is_object(at));
    PELL_TRY(pell_json_only(at, layer_keys, PELL_COUNT(layer_keys)));
    PELL_TRY(pell_json_string(at, "name", &name));
    if (strlen(name) >= sizeof(item->name)) {
        const struct pell_json at_name = pell_json_get(at, "name");
        return pell_json_error(&at_name, PELL_ERR_FORMAT, NULL, "has %zu bytes; %zu are allowed", strlen(name), sizeof(item->name) - 1);
    }
    memcpy(item->name, name, strlen(name) + 1);
    PELL_TRY(read_thickness(at, last, &item->thickness_mm));
    PELL_TRY(pell_json_require(at, "sigma_a"));
    PELL_TRY(pell_json_numbers(at, "sigma_a", 3, 0.0, PELL_SIGMA_MAX, m->sigma_a));
    PELL_TRY(pell_json_choice(at, "phase", phases, PELL_COUNT(phases), &phase));
    if (phase == PELL_PHASE_RAYLEIGH && pell_json_has(at, "g")) {
        const struct pell_json where = pell_json_get(at, "g");
        return pell_json_error(&where, PELL_ERR_FORMAT, NULL, "does not belong to the phase function \"rayleigh\"");
    }
    PELL_TRY(read_g(at, g));
    for (int c = 0; c < 3; c++) {
        item->phase[c] = (struct pell_phase) { .kind = (enum pell_phase_kind) phase, .g = { g[c] } };
        m->g[c] = pell_phase_mean_cosine(&item->phase[c]);
    }
    if (pell_json_has(at, "sigma_s") && pell_json_has(at, "sigma_s_reduced"))
        return pell_json_error(at, PELL_ERR_FORMAT, "sigma_s_reduced = sigma_s (1 - mean cosine)",
                               "has both sigma_s and sigma_s_reduced; one is allowed");
    if (pell_json_has(at, "sigma_s")) {
        if (!pell_json_has(at, "g") && phase != PELL_PHASE_RAYLEIGH)
            return pell_json_error(at, PELL_ERR_FORMAT, "write sigma_s_reduced if the coefficients are reduced", "has sigma_s without g");
        PELL_TRY(pell_json_numbers(at, "sigma_s", 3, 0.0, PELL_SIGMA_MAX, sigma_s));
        for (int c = 0; c < 3; c++)
            m->sigma_s_reduced[c] = sigma_s[c] * (1.0 - m->g[c]);
    } else {
        PELL_TRY(pell_json_require(at, "sigma_s_reduced"));
        PELL_TRY(pell_json_numbers(at, "sigma_s_reduced", 3, 0.0, PELL_SIGMA_MAX, m->sigma_s_reduced));
    }
    PELL_TRY(pell_json_number(at, "eta", 1.0, 4.0, &m->eta));
    if (!pell_medium_valid(m, &fault))
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "%s is %g, allowed: [%g, %g]; sigma_a + sigma_s_reduced must not be 0",
                               fault.field, fault.value, fault.min, fault.max);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_skin(const struct pell_json *root, struct pell_material_entry *e)
{
    struct pell_skin skin = pell_skin_default();
    struct pell_json at;
    enum pell_result res;

    PELL_TRY(pell_json_object(root, "skin", &at));
    PELL_TRY(pell_json_only(&at, pell_skin_keys, PELL_SKIN_KEYS));
    PELL_TRY(pell_json_number(&at, "melanin", 0.0, 1.0, &skin.melanin));
    PELL_TRY(pell_json_number(&at, "melanin_blend", 0.0, 1.0, &skin.melanin_blend));
    PELL_TRY(pell_json_number(&at, "haemoglobin", 0.0, 1.0, &skin.haemoglobin));
    PELL_TRY(pell_json_number(&at, "oxygenation", 0.0, 1.0, &skin.oxygenation));
    PELL_TRY(pell_json_number(&at, "epidermis_mm", 0.01, 1.0, &skin.epidermis_mm));
    PELL_TRY(pell_json_number(&at, "eta", 1.0, 2.0, &skin.eta));
    PELL_TRY(pell_skin_layers(&skin, &e->layers));
    e->medium.eta = skin.eta;
    return PELL_OK;

fail:
    return res;
}

static struct pell_json layer_at(const struct pell_json *where, int i)
{
    return i >= 0 && json_is_array(where->value) ? pell_json_at(where, (size_t) i) : *where;
}

/* Reports why a stack can't be solved. */
static enum pell_result refuse_stack(const struct pell_json *where, const struct pell_material_layers *layers)
{
    static const char *const or_give = "or give variances and weights";
    struct pell_stack_fault fault;
    struct pell_stack stack;

    pell_material_stack(layers, &stack);
    if (!pell_stack_valid(&stack, &fault)) {
        const struct pell_json at = layer_at(where, fault.layer);
        return pell_json_error(&at, PELL_ERR_FORMAT, or_give, "%s is %g, allowed: [%g, %g]", fault.field, fault.value, fault.min,
                               fault.max);
    }
    for (int i = 0; i < layers->count; i++) {
        const double *s = layers->item[i].medium.sigma_s_reduced;
        const struct pell_json at = layer_at(where, i);
        if (!(s[0] > 0.0 || s[1] > 0.0 || s[2] > 0.0))
            return pell_json_error(&at, PELL_ERR_FORMAT, or_give,
                                   "does not scatter (sigma_s_reduced is 0), and the stack sends no light back");
    }
    return pell_json_error(where, PELL_ERR_FORMAT, or_give, "sends no light back that a sum of Gaussians could stand for");
}

/* Reads a stack and its reflectance: from the file, else solved here. */
static enum pell_result read_layers(const struct pell_json *root, struct pell_material_entry *e)
{
    const struct pell_json where = pell_json_get(root, pell_json_has(root, "skin") ? "skin" : "layers");
    enum pell_result res;

    if (pell_json_has(root, "skin")) {
        const struct pell_json layers = pell_json_get(root, "layers"), eta = pell_json_get(root, "eta");
        if (layers.value)
            return pell_json_error(&layers, PELL_ERR_FORMAT, NULL, "stands beside skin; one of them is allowed");
        if (eta.value)
            return pell_json_error(&eta, PELL_ERR_FORMAT, NULL, "belongs inside skin");
        PELL_TRY(read_skin(root, e));
    } else {
        struct pell_json list;
        PELL_TRY(pell_json_require(root, "layers"));
        PELL_TRY(pell_json_number(root, "eta", 1.0, 4.0, &e->medium.eta));
        PELL_TRY(pell_json_array(root, "layers", 1, PELL_MATERIAL_LAYERS_MAX, &list));
        e->layers.count = (int) pell_json_count(&list);
        for (int i = 0; i < e->layers.count; i++) {
            const struct pell_json at = pell_json_at(&list, (size_t) i);
            PELL_TRY(read_layer(&at, i + 1 == e->layers.count, e->medium.eta, &e->layers.item[i]));
        }
    }
    if (pell_json_has(root, "variances") || pell_json_has(root, "weights"))
        return read_sum(root, false, &e->gaussians);
    res = pell_material_solve(&e->layers, &e->gaussians, NULL);
    if (res == PELL_ERR_INVALID)
        res = refuse_stack(&where, &e->layers);

fail:
    return res;
}

/* --- A file ------------------------------------------------------------------------------------------------------------------- */

/* Refuses keys that a kind must not have. */
static enum pell_result refuse(const struct pell_json *root, const char *const *keys, const char *why)
{
    for (; *keys; keys++) {
        const struct pell_json at = pell_json_get(root, *keys);
        if (at.value)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "%s", why);
    }
    return PELL_OK;
}

static enum pell_result read_entry(const struct pell_json *root, struct pell_material_entry *e)
{
    static const char *const kinds[] = { "medium", "gaussians", "layers" }, *const sources[] = { "profile", "texture" };
    static const char *const coefficients[] = { "sigma_a",       "sigma_s",        "sigma_s_reduced", "g",
                                                "concentration", "same_medium_as", "dilution",        NULL };
    static const char *const sums[] = { "variances", "weights", "same_profile_as", NULL }, *const same[] = { "same_profile_as", NULL };
    static const char *const stacks[] = { "layers", "skin", NULL };
    int kind = pell_json_has(root, "layers") || pell_json_has(root, "skin")                 ? PELL_MATERIAL_LAYERS
               : pell_json_has(root, "variances") || pell_json_has(root, "same_profile_as") ? PELL_MATERIAL_GAUSSIANS
                                                                                            : PELL_MATERIAL_MEDIUM;
    int color_from;
    enum pell_result res;

    PELL_TRY(pell_json_only(root, material_keys, PELL_COUNT(material_keys)));
    PELL_TRY(pell_json_choice(root, "kind", kinds, PELL_COUNT(kinds), &kind));
    e->kind = (enum pell_material_kind) kind;
    color_from = kind == PELL_MATERIAL_GAUSSIANS;
    e->medium.eta = 1.3;
    switch (e->kind) {
    case PELL_MATERIAL_MEDIUM:
        PELL_TRY(refuse(root, sums, "a medium has no Gaussians"));
        PELL_TRY(refuse(root, stacks, "a medium has no layers"));
        PELL_TRY(read_solution(root, e));
        break;
    case PELL_MATERIAL_GAUSSIANS:
        PELL_TRY(refuse(root, coefficients, "a sum of Gaussians has no coefficients"));
        PELL_TRY(refuse(root, stacks, "a sum of Gaussians has no layers"));
        PELL_TRY(pell_json_number(root, "eta", 1.0, 4.0, &e->medium.eta));
        PELL_TRY(read_gaussians(root, &e->gaussians));
        break;
    case PELL_MATERIAL_LAYERS:
        PELL_TRY(refuse(root, coefficients, "a stack has its coefficients in its layers"));
        PELL_TRY(refuse(root, same, "a stack has a profile of its own"));
        PELL_TRY(read_layers(root, e));
        break;
    }
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d =
            pell_dipole_make(e->medium.sigma_a[c], e->medium.sigma_s_reduced[c], e->medium.eta, PELL_FRESNEL_EXACT);
        e->color[c] = e->kind == PELL_MATERIAL_GAUSSIANS ? 0.8
                      : e->kind == PELL_MATERIAL_LAYERS  ? fmin(1.0, pell_gaussians_total(&e->gaussians, c))
                                                         : fmin(1.0, fmax(0.0, pell_dipole_total(&d)));
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

enum pell_result pell_material_read_skin(const struct pell_json *at, struct pell_material_entry *entry)
{
    *entry = (struct pell_material_entry) {
        .name = "skin", .title = "", .family = "", .note = "", .source = "", .kind = PELL_MATERIAL_LAYERS, .roughness = 0.35, .mix = 0.5
    };
    const enum pell_result res = read_layers(at, entry);

    for (int c = 0; c < 3; c++)
        entry->color[c] = fmin(1.0, pell_gaussians_total(&entry->gaussians, c));
    return res;
}

enum { TEXTS = 5 };

/* Copies name, title, family, note and source into one block, which begins with the name. */
static enum pell_result keep_texts(struct pell_context *ctx, const char *const texts[TEXTS], struct pell_material_entry *entry)
{
    const char **const fields[TEXTS] = { &entry->name, &entry->title, &entry->family, &entry->note, &entry->source };
    size_t size = 0;
    char *block;

    for (int i = 0; i < TEXTS; i++)
        size += strlen(texts[i]) + 1;
    block = pell_alloc(ctx, size);
    if (!block)
        return PELL_ERR_NOMEM;
    for (int i = 0; i < TEXTS; i++) {
        const size_t length = strlen(texts[i]) + 1;
        memcpy(block, texts[i], length);
        *fields[i] = block;
        block += length;
    }
    return PELL_OK;
}

enum pell_result pell_material_read(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                    struct pell_material_entry *entry)
{
    struct pell_json_file file = { .ctx = ctx, .path = path, .range_error = PELL_ERR_FORMAT };
    const char *texts[TEXTS] = { pell_path_name(path), "", "", "", "" }, *schema;
    struct pell_json root;
    enum pell_result res;

    memset(entry, 0, sizeof(*entry));
    PELL_TRY(pell_json_parse(&file, data, size));
    root = pell_json_root(&file);
    PELL_TRY(pell_json_is_object(&root));
    PELL_TRY(read_entry(&root, entry));
    PELL_TRY(pell_json_string(&root, "name", &texts[0]));
    PELL_TRY(pell_json_string(&root, "$schema", &schema)); /* used by editors only */
    PELL_TRY(pell_json_string(&root, "title", &texts[1]));
    PELL_TRY(pell_json_string(&root, "family", &texts[2]));
    PELL_TRY(pell_json_string(&root, "note", &texts[3]));
    PELL_TRY(pell_json_string(&root, "source", &texts[4]));
    res = keep_texts(ctx, texts, entry);

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
