/* SPDX-License-Identifier: MIT
 * materials.c - the materials of a scene file, which override those of the mesh files. */
#include "scene/file/profile_table.h"
#include "scene/file/scene_file.h"
#include "scene/layers.h"
#include "scene/names.h"

#include <pellucid/inversion.h>

#include <string.h>

const char *const pell_material_keys[PELL_MATERIAL_KEYS] = {
    "preset",
    "skin",
    "sigma_a",
    "sigma_s_reduced",
    "sigma_s",
    "g",
    "eta",
    "color",
    "mean_free_path",
    "layers",
    "radius",
    "radius_kind",
    "profile",
    "color_from",
    "textures",
    "normal_scale",
    "alpha_cutoff",
    "mix",
    "strength",
    "roughness",
    "specular",
    "opaque",
    "depths",
    "depth_scale",
    "depth_encoding",
    "below",
    "diffuse_transmission",
    "diffuse_transmission_color",
};
const char *const pell_specular_keys[PELL_SPECULAR_KEYS] = { "model", "roughness", "rho_s" };

enum pell_result pell_scene_material_entry(struct pell_scene_reader *r, const struct pell_json *at, const char *name,
                                           struct pell_material_entry *entry)
{
    struct pell_text where;
    char *path = NULL;
    uint8_t *data = NULL;
    size_t size;
    enum pell_result res;

    memset(entry, 0, sizeof(*entry));
    pell_json_where(at, &where);
    if (pell_material_find(name) || !pell_material_is_path(name)) {
        res = pell_material_open(r->ctx, where.str, name, entry);
        return res == PELL_ERR_INVALID ? PELL_ERR_FORMAT : res;
    }
    PELL_TRY(pell_loader_read(r->loader, where.str, name, &path, &data, &size));
    PELL_TRY(pell_material_read(r->ctx, path, data, size, entry));

fail:
    pell_free(r->ctx, path);
    pell_free(r->ctx, data);
    return res == PELL_ERR_INVALID ? PELL_ERR_FORMAT : res;
}

/* --- Maps --------------------------------------------------------------------------------------------------------------------- */

/* "file.png" or "file.png#g". A broken image leaves the map unchanged. */
static enum pell_result read_map(struct pell_scene_reader *r, const struct pell_json *at, enum pell_image_role role,
                                 struct pell_texture_map *map)
{
    const char *text;
    struct pell_texture *texture;
    char *name = NULL;
    size_t length;
    int channel;
    enum pell_result res;

    PELL_TRY(pell_json_to_string(at, &text));
    PELL_TRY(pell_scene_channel_of(at, text, &length, &channel));
    name = pell_strndup(r->ctx, text, length);
    if (!name)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_scene_picture(r, at, name, role, &texture));
    if (texture) {
        *map = pell_texture_map_none();
        map->texture = texture;
        map->channel = channel;
    }

fail:
    pell_free(r->ctx, name);
    return res;
}

static enum pell_result read_textures(struct pell_scene_reader *r, const struct pell_json *parent, struct pell_material *m)
{
    struct pell_json textures;
    enum pell_result res;

    PELL_TRY(pell_json_object(parent, "textures", &textures));
    if (!textures.value)
        return PELL_OK;
    PELL_TRY(pell_json_only(&textures, pell_texture_keys, PELL_TEXTURE_KEYS));
    for (size_t i = 0; i < PELL_TEXTURE_KEYS; i++) {
        const char *key = pell_texture_keys[i];
        const struct pell_json at = pell_json_get(&textures, key);
        const bool color = strcmp(key, "baseColor") == 0 || strcmp(key, "emissive") == 0 || strcmp(key, "diffuseTransmissionColor") == 0;
        if (at.value)
            PELL_TRY(read_map(r, &at, color ? PELL_ROLE_COLOR : PELL_ROLE_DATA, pell_scene_map_called(m, key)));
    }
    return PELL_OK;

fail:
    return res;
}

/* A number, a channel of one of the material's textures ("baseColor.a"), or of an image ("mask.png#r"). */
static enum pell_result read_strength(struct pell_scene_reader *r, const struct pell_json *parent, struct pell_material *m)
{
    const struct pell_json at = pell_json_get(parent, "strength");
    struct pell_texture_map own;
    const char *text;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    if (json_is_number(at.value))
        return pell_json_float(parent, "strength", 0.0, 1.0, &m->strength);
    PELL_TRY(pell_json_to_string(&at, &text));
    if (!pell_scene_own_map(m, text, &own))
        return read_map(r, &at, PELL_ROLE_DATA, &m->strength_map);
    if (own.texture)
        m->strength_map = own;
    else
        pell_json_warn(&at, NULL, "material \"%s\" has no texture %.*s: its strength stays %g", m->name, (int) (strrchr(text, '.') - text),
                       text, (double) m->strength);
    return PELL_OK;

fail:
    return res;
}

/* --- The medium --------------------------------------------------------------------------------------------------------------- */

static void forget_preset(struct pell_scene_reader *r, struct pell_material *m)
{
    pell_free(r->ctx, m->preset);
    m->preset = NULL;
    m->gaussians.count = 0;
    m->opaque = false;
    m->color_from = PELL_COLOR_FROM_PROFILE;
    m->metallic = 0.0f;
    m->metallic_map = pell_texture_map_none();
    pell_scene_layers_finish(r->ctx, m);
}

/* The key of the length that turns a colour into a medium; NULL: none. */
static const char *length_key(const struct pell_json *at)
{
    return pell_json_has(at, "mean_free_path") ? "mean_free_path" : pell_json_has(at, "radius") ? "radius" : NULL;
}

/* Whether the object defines diffuse scattering: only otherwise does the material use the profile of its own layers. */
static bool has_diffusion(const struct pell_json *at)
{
    return pell_json_has(at, "preset") || pell_json_has(at, "skin") || pell_json_has(at, "sigma_a") || pell_json_has(at, "sigma_s") ||
           pell_json_has(at, "sigma_s_reduced") || length_key(at);
}

/* A text for all channels, or three texts: lengths without a unit are the most common mistake. */
static enum pell_result read_lengths(const struct pell_json *parent, const char *key, double *mm)
{
    const struct pell_json at = pell_json_get(parent, key);
    enum pell_result res = PELL_OK;

    if (json_is_string(at.value)) {
        res = pell_scene_text_length(&at, false, &mm[0]);
        mm[1] = mm[2] = mm[0];
    } else if (json_is_array(at.value) && json_array_size(at.value) == 3) {
        for (size_t c = 0; c < 3 && res == PELL_OK; c++) {
            const struct pell_json element = pell_json_at(&at, c);
            if (!json_is_string(element.value))
                return pell_json_error(&element, PELL_ERR_FORMAT, "write it with its unit, as in \"1.2mm\"",
                                       "must be a text: a length without a unit could mean anything");
            res = pell_scene_text_length(&element, false, &mm[c]);
        }
    } else {
        return pell_json_error(&at, PELL_ERR_FORMAT, "write it with its unit, as in \"1.2mm\"",
                               "must be a text, or three: a length without a unit could mean anything");
    }
    for (size_t c = 0; c < 3 && res == PELL_OK; c++)
        if (!(mm[c] >= 1e-6 && mm[c] <= 1e6))
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %g mm, allowed: [1e-6, 1e6]", mm[c]);
    return res;
}

/* One number for all channels, or three. */
static enum pell_result read_reflectance(const struct pell_json *at, const char *key, double color[3])
{
    const struct pell_json value = pell_json_get(at, key);
    enum pell_result res;

    if (!json_is_number(value.value))
        return pell_json_numbers(at, key, 3, 0.0, 1.0, color);
    res = pell_json_to_number(&value, 0.0, 1.0, &color[0]);
    color[1] = color[2] = color[0];
    return res;
}

/* "color" with a length: the medium whose diffuse reflectance, by the material's profile model, is this colour. */
static enum pell_result read_color_and_radius(struct pell_scene_reader *r, const struct pell_json *at, struct pell_material *m)
{
    const char *key = length_key(at), *kinds[PELL_SCATTER_RADII];
    struct pell_color_and_radius params = { .eta = m->medium.eta };
    struct pell_medium_fault fault;
    int kind = PELL_SCATTER_RADIUS_MEAN_FREE_PATH;
    enum pell_result res;

    for (int i = 0; i < PELL_SCATTER_RADII; i++)
        kinds[i] = pell_scatter_radius_at((size_t) i)->name;
    PELL_TRY(pell_json_choice(at, "radius_kind", kinds, PELL_COUNT(kinds), &kind));
    if (pell_json_has(at, "radius_kind"))
        PELL_TRY(pell_json_require(at, "radius"));
    if (!key)
        return PELL_OK;
    PELL_TRY(pell_json_require(at, "color"));
    PELL_TRY(read_reflectance(at, "color", params.color));
    PELL_TRY(read_lengths(at, key, params.radius));
    params.kind = (enum pell_scatter_radius) kind;
    forget_preset(r, m);
    if (pell_medium_from_color_and_radius(&params, m->model, NULL, &m->medium, &fault) != PELL_OK) {
        if (!isfinite(fault.min))
            return pell_json_error(at, PELL_ERR_FORMAT, "make the colour darker, or give the mean free path",
                                   "has no medium: where the colour is 1 nothing is absorbed, and light goes any distance, not %g mm",
                                   fault.value);
        return pell_json_error(at, PELL_ERR_FORMAT, "another colour, length or profile can do it",
                               "has no medium: %s is %g, allowed with the rest: [%g, %g]", fault.field ? fault.field : "color", fault.value,
                               fault.min, fault.max);
    }
    return PELL_OK;

fail:
    return res;
}

/* The colour of the surface. */
static enum pell_result read_color(const struct pell_json *at, struct pell_material *m)
{
    const struct pell_json value = pell_json_get(at, "color");
    const char *below = "";
    double color[3];
    enum pell_result res;

    if (!value.value)
        return PELL_OK;
    PELL_TRY(read_reflectance(at, "color", color));
    PELL_TRY(pell_json_string(at, "below", &below));
    if (!length_key(at) && !m->opaque && strcmp(below, "surface-color") != 0 && m->color_from == PELL_COLOR_FROM_PROFILE)
        return pell_json_error(&value, PELL_ERR_FORMAT, "add mean_free_path (\"1mm\"), or \"color_from\": \"texture\", or \"opaque\": true",
                               "says nothing about a material whose colour comes from its profile");
    for (int c = 0; c < 3; c++)
        m->base_color[c] = (float) color[c];
    return PELL_OK;

fail:
    return res;
}

/* A user's table, with r_mm, R, G, B per line. */
static enum pell_result read_table(struct pell_scene_reader *r, const struct pell_json *at, const char *name, struct pell_material *m)
{
    struct pell_text where;
    char *path = NULL;
    uint8_t *data = NULL;
    size_t size;
    enum pell_result res;

    pell_json_where(at, &where);
    PELL_TRY(pell_loader_read(r->loader, where.str, name, &path, &data, &size));
    if (!m->profile)
        m->profile = pell_calloc(r->ctx, 3, sizeof(*m->profile));
    res = PELL_ERR_NOMEM;
    if (!m->profile)
        goto fail;
    PELL_TRY(pell_profile_table_read(r->ctx, path, data, size, m->profile));

fail:
    pell_free(r->ctx, path);
    pell_free(r->ctx, data);
    return res == PELL_ERR_INVALID ? PELL_ERR_FORMAT : res;
}

/* "photon-beam", or { "table": "wax.csv" }. */
static enum pell_result read_profile(struct pell_scene_reader *r, const struct pell_json *at, struct pell_material *m)
{
    static const char *const keys[] = { "table" };
    const struct pell_json profile = pell_json_get(at, "profile");
    const char *names[PELL_PROFILE_MODELS], *name;
    struct pell_json table;
    int model = (int) m->model;
    enum pell_result res;

    if (!profile.value)
        return PELL_OK;
    if (!json_is_object(profile.value)) {
        for (int i = 0; i < PELL_PROFILE_MODELS; i++)
            names[i] = pell_profile_model_at((size_t) i)->name;
        PELL_TRY(pell_json_choice(at, "profile", names, PELL_COUNT(names), &model));
        if (pell_json_has(at, "layers") && !has_diffusion(at))
            return pell_json_error(&profile, PELL_ERR_FORMAT, "leave it out, or give coefficients or a preset for methods of diffusion",
                                   "says how coefficients of one medium become a profile; layers have one of their own");
        if (m->gaussians.count > 0 && !length_key(at))
            return pell_json_error(&profile, PELL_ERR_FORMAT, "leave it out, or give coefficients (sigma_a, sigma_s_reduced)",
                                   "says how coefficients become a profile; this material has none, its profile is given");
        m->model = (enum pell_profile_model) model;
        return PELL_OK;
    }
    PELL_TRY(pell_json_only(&profile, keys, PELL_COUNT(keys)));
    PELL_TRY(pell_json_require(&profile, "table"));
    table = pell_json_get(&profile, "table");
    PELL_TRY(pell_json_to_string(&table, &name));
    PELL_TRY(read_table(r, &table, name, m));
    return PELL_OK;

fail:
    return res;
}

/* The keys that define the medium: only one of them is allowed. */
static enum pell_result one_medium(const struct pell_json *at)
{
    const char *const given[] = {
        pell_json_has(at, "preset") ? "a preset" : NULL, pell_json_has(at, "skin") ? "skin" : NULL,
        pell_json_has(at, "sigma_a") || pell_json_has(at, "sigma_s") || pell_json_has(at, "sigma_s_reduced") ? "coefficients" : NULL,
        pell_json_has(at, "mean_free_path") ? "a mean_free_path" : NULL, pell_json_has(at, "radius") ? "a radius" : NULL
    };
    const char *first = NULL;

    for (size_t i = 0; i < PELL_COUNT(given); i++) {
        if (first && given[i])
            return pell_json_error(at, PELL_ERR_FORMAT, NULL, "gives %s and %s; one of them is allowed", first, given[i]);
        first = first ? first : given[i];
    }
    return PELL_OK;
}

static enum pell_result read_optics(struct pell_scene_reader *r, const struct pell_json *at, struct pell_material *m)
{
    const struct pell_json preset = pell_json_get(at, "preset");
    const bool medium = pell_json_has(at, "sigma_a") || pell_json_has(at, "sigma_s") || pell_json_has(at, "sigma_s_reduced");
    struct pell_material_entry entry = { 0 };
    char *owned = NULL; /* texts of the entry */
    const char *name;
    enum pell_result res;

    PELL_TRY(one_medium(at));
    if (preset.value) {
        PELL_TRY(pell_json_to_string(&preset, &name));
        res = pell_scene_material_entry(r, &preset, name, &entry);
        owned = (char *) entry.name;
        PELL_TRY(res);
    } else if (pell_json_has(at, "skin")) {
        PELL_TRY(pell_material_read_skin(at, &entry));
    }
    if (entry.name)
        PELL_TRY(pell_material_set(r->ctx, m, &entry));
    if (!preset.value && entry.name) { /* no built-in material has this composition */
        pell_free(r->ctx, m->preset);
        m->preset = NULL;
    }
    if (pell_json_has(at, "layers") && !has_diffusion(at))
        forget_preset(r, m);
    PELL_TRY(pell_json_number(at, "eta", 1.0, 4.0, &m->medium.eta));
    if (medium) {
        forget_preset(r, m);
        PELL_TRY(pell_read_medium(at, &m->medium));
    } else if (pell_json_has(at, "g")) {
        const struct pell_json g = pell_json_get(at, "g");
        return pell_json_error(&g, PELL_ERR_FORMAT, NULL, "stands without sigma_s or sigma_s_reduced");
    }
    res = PELL_OK;

fail:
    pell_free(r->ctx, owned);
    return res;
}

/* --- The surface -------------------------------------------------------------------------------------------------------------- */

static enum pell_result read_specular(const struct pell_json *at, struct pell_material *m)
{
    const char *models[PELL_SPECULAR_MODELS];
    int model = (int) m->specular;
    struct pell_json specular;
    enum pell_result res;

    for (int i = 0; i < PELL_SPECULAR_MODELS; i++)
        models[i] = pell_specular_name((enum pell_specular_model) i);
    PELL_TRY(pell_json_object(at, "specular", &specular));
    if (!specular.value)
        return PELL_OK;
    PELL_TRY(pell_json_only(&specular, pell_specular_keys, PELL_SPECULAR_KEYS));
    PELL_TRY(pell_json_choice(&specular, "model", models, PELL_COUNT(models), &model));
    m->specular = (enum pell_specular_model) model;
    PELL_TRY(pell_json_float(&specular, "roughness", 0.0, 1.0, &m->roughness));
    PELL_TRY(pell_json_float(&specular, "rho_s", 0.0, 1.0, &m->rho_s));
    return PELL_OK;

fail:
    return res;
}

/* A thin sheet. Its transmitted colour is that of the surface unless given separately. */
static enum pell_result read_sheet(const struct pell_json *at, struct pell_material *m)
{
    const struct pell_json transmission = pell_json_get(at, "diffuse_transmission");
    double color[3];
    enum pell_result res = PELL_OK;

    if (transmission.value && !m->opaque)
        return pell_json_error(&transmission, PELL_ERR_FORMAT,
                               "add \"opaque\": true, or leave it out: light passes a medium by its thickness",
                               "is of thin opaque sheets, and material \"%s\" is translucent", m->name);
    if (transmission.value && m->diffuse_transmission == 0.0f) {
        memcpy(m->diffuse_transmission_color, m->base_color, sizeof(m->diffuse_transmission_color));
        m->diffuse_transmission_color_map = m->base_color_map;
    }
    PELL_TRY(pell_json_float(at, "diffuse_transmission", 0.0, 1.0, &m->diffuse_transmission));
    if (!pell_json_has(at, "diffuse_transmission_color"))
        return PELL_OK;
    PELL_TRY(read_reflectance(at, "diffuse_transmission_color", color));
    for (int c = 0; c < 3; c++)
        m->diffuse_transmission_color[c] = (float) color[c];

fail:
    return res;
}

enum pell_result pell_scene_overlay(struct pell_scene_reader *r, const struct pell_json *at, size_t material)
{
    static const char *const sources[] = { "profile", "texture" };
    struct pell_material *m = &r->scene->materials[material];
    const struct pell_texture *before = m->base_color_map.texture;
    int color_from;
    enum pell_result res;

    PELL_TRY(pell_json_only(at, pell_material_keys, PELL_MATERIAL_KEYS));
    PELL_TRY(read_optics(r, at, m));
    PELL_TRY(read_profile(r, at, m));
    PELL_TRY(read_color_and_radius(r, at, m));
    PELL_TRY(pell_json_bool(at, "opaque", &m->opaque));
    color_from = m->color_from == PELL_COLOR_FROM_TEXTURE;
    PELL_TRY(pell_json_choice(at, "color_from", sources, PELL_COUNT(sources), &color_from));
    m->color_from = color_from ? PELL_COLOR_FROM_TEXTURE : PELL_COLOR_FROM_PROFILE;
    PELL_TRY(read_textures(r, at, m));
    if (m->base_color_map.texture && m->base_color_map.texture != before)
        m->base_color[0] = m->base_color[1] = m->base_color[2] = 1.0f; /* an image given here is the colour, not multiplied by one */
    PELL_TRY(read_color(at, m));
    PELL_TRY(pell_scene_read_layers(r, at, !has_diffusion(at) && !m->profile, material));
    m = &r->scene->materials[material];
    PELL_TRY(read_strength(r, at, m));
    PELL_TRY(pell_json_float(at, "mix", 0.0, 1.0, &m->mix));
    PELL_TRY(pell_json_float(at, "roughness", 0.0, 1.0, &m->roughness));
    PELL_TRY(pell_json_float(at, "normal_scale", -100.0, 100.0, &m->normal_scale));
    PELL_TRY(pell_json_float(at, "alpha_cutoff", 0.0, 1.0, &m->alpha_cutoff));
    m->alpha_mask = m->alpha_mask || pell_json_has(at, "alpha_cutoff");
    PELL_TRY(read_specular(at, m));
    PELL_TRY(read_sheet(at, m));
    return PELL_OK;

fail:
    return res;
}

/* --- By name ------------------------------------------------------------------------------------------------------------------ */

/* Searches for names only for as many warnings as are printed: a file may have a million of both. */
static enum pell_result warn_no_match(struct pell_scene_reader *r, const struct pell_json *at, const char *name, int unknown)
{
    enum { MOST = 4096 };
    const size_t count = r->scene->num_materials < MOST ? r->scene->num_materials : MOST;
    const char **names = pell_alloc_array(r->ctx, count, sizeof(*names));
    struct pell_text hint = { 0 };
    char shown[96];

    if (!names)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count; i++)
        names[i] = r->scene->materials[i].name;
    if (unknown <= pell_context_limits(r->ctx)->warnings)
        pell_text_suggest_or_list(&hint, "the files have ", name, names, count);
    pell_free(r->ctx, names);
    pell_json_warn(at, hint.str, "no material is called \"%s\": nothing is changed by it", pell_printable(name, shown, sizeof(shown)));
    return PELL_OK;
}

/* The scene's materials by name: materials of one name form a list. */
struct by_name {
    struct pell_names names;
    uint32_t *first, *next; /* material + 1 */
    int unknown;            /* number of names without a material, so far */
};

static enum pell_result index_names(struct pell_scene_reader *r, struct by_name *b)
{
    const size_t count = r->scene->num_materials;
    uint32_t number;
    bool fresh;
    enum pell_result res;

    b->names.ctx = r->ctx;
    b->names.where = r->file.path;
    b->first = pell_calloc(r->ctx, count, sizeof(*b->first));
    b->next = pell_calloc(r->ctx, count, sizeof(*b->next));
    if (!b->first || !b->next)
        return PELL_ERR_NOMEM;
    for (size_t i = count; i-- > 0;) {
        const char *name = r->scene->materials[i].name;
        PELL_TRY(pell_names_enter(&b->names, name, strlen(name), &number, &fresh));
        b->next[i] = b->first[number];
        b->first[number] = (uint32_t) i + 1;
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result overlay_named(struct pell_scene_reader *r, const struct pell_json *materials, const char *name, struct by_name *b)
{
    const struct pell_json at = pell_json_get(materials, name);
    const size_t known = b->names.count;
    uint32_t number;
    bool fresh;
    enum pell_result res;

    PELL_TRY(pell_names_enter(&b->names, name, strlen(name), &number, &fresh));
    if (fresh || number >= known) {
        PELL_TRY(pell_json_only(&at, pell_material_keys, PELL_MATERIAL_KEYS)); /* unused ones must be valid, too */
        return warn_no_match(r, &at, name, ++b->unknown);
    }
    for (uint32_t i = b->first[number]; i; i = b->next[i - 1])
        PELL_TRY(pell_scene_overlay(r, &at, i - 1));
    return PELL_OK;

fail:
    return res;
}

/* A text in place of a material gets the form of one; the overlay reports other types. */
static enum pell_result check_materials(const struct pell_json *materials)
{
    const char *name;
    json_t *value;

    json_object_foreach((json_t *) materials->value, name, value)
    {
        const struct pell_json at = pell_json_get(materials, name);
        char shown[96];
        if (json_is_string(value))
            return pell_json_error(&at, PELL_ERR_FORMAT, "a built-in material: {\"preset\": \"marble\"}", "is %s, allowed: an object",
                                   pell_json_value(&at, shown, sizeof(shown)));
    }
    return PELL_OK;
}

enum pell_result pell_scene_overlay_all(struct pell_scene_reader *r, const struct pell_json *root)
{
    struct by_name b = { .first = NULL };
    struct pell_json materials, all;
    const char *name;
    json_t *value;
    enum pell_result res;

    PELL_TRY(pell_json_object(root, "materials", &materials));
    PELL_TRY(check_materials(&materials));
    all = pell_json_get(&materials, "*");
    PELL_TRY(pell_scene_default_material(r->scene, all.value || pell_json_has(&materials, PELL_DEFAULT_MATERIAL)));
    if (!materials.value)
        return PELL_OK;
    for (size_t i = 0; all.value && i < r->scene->num_materials; i++)
        PELL_TRY(pell_scene_overlay(r, &all, i));
    PELL_TRY(index_names(r, &b));
    json_object_foreach((json_t *) materials.value, name, value) if (strcmp(name, "*") != 0)
        PELL_TRY(overlay_named(r, &materials, name, &b));

fail:
    pell_names_finish(&b.names);
    pell_free(r->ctx, b.first);
    pell_free(r->ctx, b.next);
    return res;
}
