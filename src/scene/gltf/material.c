/* SPDX-License-Identifier: MIT
 * material.c - materials of glTF 2.0 (section 3.9 of the specification) and the extensions for translucency.
 *
 * Translucent materials have KHR_materials_diffuse_transmission with a factor above 0 and a KHR_materials_volume that
 * has a thickness, or a scattering volume (drafts KHR_materials_volume_scatter, KHR_materials_scatter). Diffuse transmission without a
 * volume is a thin sheet. All others are opaque; clear transmission is drawn as opaque with a warning.
 *
 * The medium, per unit of the file:
 *
 *     sigma_t = -ln(attenuationColor) / attenuationDistance                      KHR_materials_volume
 *     albedo  = van de Hulst's map (pellucid/inversion.h) of multiscatterColor and g = scatterAnisotropy
 *     sigma_s = albedo sigma_t,  sigma_s' = (1 - g) sigma_s
 *
 * If a file gives a translucent material no scattering, or no distance, it cannot be inferred: the medium takes the extinction of
 * marble (Jensen et al. 2001) for one unit = 1 m, and the albedo of the surface's own colour; a warning says so.
 *
 * A nonzero volume thickness distinguishes solids from sheets; its value is not used: it is for renderers that do not trace to the other
 * side.
 *
 * Colour: a base colour texture, else a diffuse transmission colour texture, gives the colour, with a mix of 0.5, and the medium only
 * spreads the light. Without one the colour is the medium's own. */
#include "scene/gltf/gltf.h"

#include <pellucid/inversion.h>

#include <inttypes.h>
#include <string.h>

#define MM_PER_METRE 1000.0

/* --- Numbers ---------------------------------------------------------------------------------------------------------------- */

enum pell_result gltf_factors(struct gltf *g, const struct pell_json *parent, const char *key, size_t count, double min, double max,
                              float *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    double x[4];
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    if ((res = pell_json_to_numbers(&at, count, -1e300, 1e300, x)) != PELL_OK)
        return res;
    for (size_t i = 0; i < count; i++) {
        if (!(x[i] >= min && x[i] <= max))
            gltf_warn(g, GLTF_WARN_VALUE, &at, NULL, "value %zu is %g, allowed: [%g, %g]; it is cut to that", i, x[i], min, max);
        out[i] = (float) fmin(fmax(x[i], min), max);
    }
    return PELL_OK;
}

enum pell_result gltf_factor(struct gltf *g, const struct pell_json *parent, const char *key, double min, double max, float *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    double x;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    if ((res = pell_json_to_number(&at, -1e300, 1e300, &x)) != PELL_OK)
        return res;
    if (!(x >= min && x <= max))
        gltf_warn(g, GLTF_WARN_VALUE, &at, NULL, "is %g, allowed: [%g, %g]; it is cut to that", x, min, max);
    *out = (float) fmin(fmax(x, min), max);
    return PELL_OK;
}

/* --- The medium ------------------------------------------------------------------------------------------------------------- */

/* The values of the translucency extensions. */
struct translucency {
    struct pell_json volume, diffuse, scatter, transmission; /* NULL values: absent */
    struct pell_json extensions[4];
    const char *scatter_name;
    float diffuse_factor, transmission_factor;
    float diffuse_color[3], multiscatter[3], attenuation_color[3];
    double attenuation_distance; /* infinite: not given */
    float thickness;
    double g;
};

static enum pell_result read_scatter(struct gltf *g, struct translucency *t)
{
    enum pell_result res;

    /* the drafts differ in this name */
    PELL_TRY(gltf_factors(g, &t->scatter, "multiscatterColor", 3, 0.0, 1.0, t->multiscatter));
    PELL_TRY(gltf_factors(g, &t->scatter, "multiscatterColorFactor", 3, 0.0, 1.0, t->multiscatter));
    PELL_TRY(pell_json_number(&t->scatter, "scatterAnisotropy", -0.999, 0.999, &t->g));
    if (pell_json_get(&t->scatter, "multiscatterColorTexture").value) {
        const struct pell_json at = pell_json_get(&t->scatter, "multiscatterColorTexture");
        gltf_warn(g, GLTF_WARN_INTERIOR, &at, NULL, "a texture of the multi-scatter colour is not read: the factor is used");
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_translucency(struct gltf *g, const struct pell_json *at, struct translucency *t)
{
    static const char *const scatters[] = { "KHR_materials_volume_scatter", "KHR_materials_scatter" };
    enum pell_result res;

    t->attenuation_distance = INFINITY;
    t->diffuse_factor = t->transmission_factor = t->thickness = 0.0f;
    for (int c = 0; c < 3; c++) {
        t->diffuse_color[c] = t->attenuation_color[c] = 1.0f;
        t->multiscatter[c] = 0.0f;
    }
    PELL_TRY(gltf_extension(at, "KHR_materials_volume", &t->extensions[0], &t->volume));
    PELL_TRY(gltf_extension(at, "KHR_materials_diffuse_transmission", &t->extensions[1], &t->diffuse));
    PELL_TRY(gltf_extension(at, "KHR_materials_transmission", &t->extensions[2], &t->transmission));
    for (int i = 0; i < 2 && !t->scatter.value; i++) {
        t->scatter_name = scatters[i];
        PELL_TRY(gltf_extension(at, scatters[i], &t->extensions[3], &t->scatter));
    }
    if (t->volume.value) {
        PELL_TRY(gltf_factor(g, &t->volume, "thicknessFactor", 0.0, 1e12, &t->thickness));
        PELL_TRY(gltf_factors(g, &t->volume, "attenuationColor", 3, 0.0, 1.0, t->attenuation_color));
        PELL_TRY(pell_json_number(&t->volume, "attenuationDistance", 1e-12, 1e300, &t->attenuation_distance));
        if (t->attenuation_distance > 1e12)
            t->attenuation_distance = INFINITY;
    }
    if (t->diffuse.value) {
        PELL_TRY(gltf_factor(g, &t->diffuse, "diffuseTransmissionFactor", 0.0, 1.0, &t->diffuse_factor));
        PELL_TRY(gltf_factors(g, &t->diffuse, "diffuseTransmissionColorFactor", 3, 0.0, 1.0, t->diffuse_color));
    }
    if (t->transmission.value)
        PELL_TRY(gltf_factor(g, &t->transmission, "transmissionFactor", 0.0, 1.0, &t->transmission_factor));
    if (t->scatter.value)
        PELL_TRY(read_scatter(g, t));
    return PELL_OK;

fail:
    return res;
}

/* Single-scattering albedo that gives a multi-scatter colour m. m = 1 would never be absorbed: it is limited to 0.999. */
static double albedo_of_color(double m, double g)
{
    return pell_albedo_of_reduced(pell_albedo_map_invert(PELL_ALBEDO_VAN_DE_HULST, fmin(fmax(m, 0.0), 0.999), 1.0), g);
}

/* Extinction per unit of the file; by default that of `marble`, the medium of every new material, in 1/mm. An attenuation colour of 1 would
 * be empty space, of 0 opaque: both are moved close to the values of the other channels. */
static void extinction(const struct translucency *t, bool given, const struct pell_medium *marble, double sigma_t[3])
{
    double least = 1e-2; /* a mean free path of 100 m */

    for (int c = 0; c < 3; c++) {
        sigma_t[c] = given ? -log(fmax((double) t->attenuation_color[c], 1e-6)) / t->attenuation_distance
                           : (marble->sigma_a[c] + marble->sigma_s_reduced[c]) * MM_PER_METRE;
        least = fmax(least, 1e-3 * sigma_t[c]);
    }
    for (int c = 0; c < 3; c++)
        sigma_t[c] = fmax(sigma_t[c], least);
}

static void set_medium(struct gltf *g, const struct pell_json *at, const struct translucency *t, struct pell_material *m)
{
    const bool given = t->scatter.value && isfinite(t->attenuation_distance);
    double sigma_t[3];

    extinction(t, given, &m->medium, sigma_t);
    for (int c = 0; c < 3; c++) {
        const double f = t->diffuse_factor, surface = (1.0 - f) * m->base_color[c] + f * t->diffuse_color[c];
        const double color = t->scatter.value ? t->multiscatter[c] : fmin(surface, 0.95), gc = given ? t->g : 0.0;
        const double sigma_s = albedo_of_color(color, gc) * sigma_t[c];
        m->medium.sigma_s_reduced[c] = (1.0 - gc) * sigma_s;
        m->medium.sigma_a[c] = sigma_t[c] - sigma_s;
        m->medium.g[c] = gc;
    }
    if (given)
        return;
    if (t->scatter.value)
        gltf_warn(g, GLTF_WARN_INTERIOR, at, "give KHR_materials_volume an attenuationDistance, or a preset in a scene file",
                  "material \"%s\" scatters but has no attenuationDistance: the extinction of marble is used", m->name);
    else
        gltf_warn(g, GLTF_WARN_INTERIOR, at, "add KHR_materials_volume_scatter, or a preset in a scene file",
                  "material \"%s\" transmits diffusely but does not say how it scatters: marble's extinction with its own colour is used "
                  "(experimental)",
                  m->name);
}

static enum pell_result read_ior(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    struct pell_json extensions, ior;
    double eta = 1.5;
    enum pell_result res;

    PELL_TRY(gltf_extension(at, "KHR_materials_ior", &extensions, &ior));
    if (ior.value)
        PELL_TRY(pell_json_number(&ior, "ior", -1e300, 1e300, &eta));
    if (!(eta >= 1.0 && eta <= 4.0)) {
        const struct pell_json value = pell_json_get(&ior, "ior");
        /* 0 is the extension's name for "reflects like a metal" */
        gltf_warn(g, GLTF_WARN_VALUE, &value, NULL, "is %g, allowed: [1, 4]; %g is used", eta, eta > 4.0 ? 4.0 : eta == 0.0 ? 1.5 : 1.0);
        eta = eta > 4.0 ? 4.0 : eta == 0.0 ? 1.5 : 1.0;
    }
    m->medium.eta = eta;
    return PELL_OK;

fail:
    return res;
}

/* Diffuse transmission without a volume: the base colour is reflected, transmitted light has the extension's colour. */
static enum pell_result read_sheet(struct gltf *g, const struct translucency *t, struct pell_material *m)
{
    enum pell_result res;

    if (t->transmission_factor > 0.0f)
        gltf_warn(g, GLTF_WARN_INTERIOR, &t->transmission, NULL, "material \"%s\": its clear transmission is not drawn", m->name);
    m->diffuse_transmission = t->diffuse_factor;
    for (int c = 0; c < 3; c++)
        m->diffuse_transmission_color[c] = t->diffuse_color[c];
    PELL_TRY(gltf_texture_map(g, &t->diffuse, "diffuseTransmissionTexture", PELL_ROLE_DATA, 3, &m->diffuse_transmission_map));
    PELL_TRY(gltf_texture_map(g, &t->diffuse, "diffuseTransmissionColorTexture", PELL_ROLE_COLOR, 0, &m->diffuse_transmission_color_map));

fail:
    return res;
}

static enum pell_result read_interior(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    struct translucency t = { 0 };
    enum pell_result res;
    bool lets_in;

    PELL_TRY(read_ior(g, at, m));
    PELL_TRY(read_translucency(g, at, &t));
    /* A scattering volume alone is visible; behind a diffuse transmission of 0 it is not. */
    lets_in = t.diffuse_factor > 0.0f || (t.scatter.value && (!t.diffuse.value || t.transmission_factor > 0.0f));
    if (!lets_in) {
        if (t.transmission_factor > 0.0f)
            gltf_warn(g, GLTF_WARN_INTERIOR, &t.transmission, NULL,
                      "material \"%s\" is clear (KHR_materials_transmission): it is drawn as opaque", m->name);
        return PELL_OK;
    }
    if (!t.scatter.value && !(t.thickness > 0.0f))
        return read_sheet(g, &t, m);
    if (pell_json_get(&t.diffuse, "diffuseTransmissionTexture").value) {
        const struct pell_json texture = pell_json_get(&t.diffuse, "diffuseTransmissionTexture");
        gltf_warn(g, GLTF_WARN_INTERIOR, &texture, NULL, "a texture of the diffuse transmission is not read: the factor is used");
    }
    if (t.transmission_factor > 0.0f)
        gltf_warn(g, GLTF_WARN_INTERIOR, &t.transmission, NULL, "material \"%s\": its clear transmission is not drawn, its scattering is",
                  m->name);
    if (t.diffuse.value && t.diffuse_factor < 1.0f && t.scatter.value)
        gltf_warn(g, GLTF_WARN_INTERIOR, &t.diffuse, NULL,
                  "material \"%s\" lets in %g of the diffuse light: it is drawn as if it let in all of it", m->name,
                  (double) t.diffuse_factor);
    if (t.scatter.value)
        gltf_mention(g, &t.scatter, t.scatter_name);
    m->opaque = false;
    set_medium(g, at, &t, m);
    m->color_from = PELL_COLOR_FROM_PROFILE;
    if (!m->base_color_map.texture && t.diffuse.value) {
        PELL_TRY(gltf_texture_map(g, &t.diffuse, "diffuseTransmissionColorTexture", PELL_ROLE_COLOR, 0, &m->base_color_map));
        for (int c = 0; c < 3 && m->base_color_map.texture; c++)
            m->base_color[c] = t.diffuse_color[c];
    }
    if (m->base_color_map.texture) {
        m->color_from = PELL_COLOR_FROM_TEXTURE;
        m->mix = 0.5f;
    }
    return PELL_OK;

fail:
    return res;
}

/* --- The surface ------------------------------------------------------------------------------------------------------------ */

static enum pell_result read_metallic_roughness(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    struct pell_json pbr;
    enum pell_result res;

    PELL_TRY(pell_json_object(at, "pbrMetallicRoughness", &pbr));
    if (!pbr.value)
        return PELL_OK;
    PELL_TRY(gltf_factors(g, &pbr, "baseColorFactor", 4, 0.0, 1.0, m->base_color));
    PELL_TRY(gltf_factor(g, &pbr, "metallicFactor", 0.0, 1.0, &m->metallic));
    PELL_TRY(gltf_factor(g, &pbr, "roughnessFactor", 0.0, 1.0, &m->roughness));
    PELL_TRY(gltf_texture_map(g, &pbr, "baseColorTexture", PELL_ROLE_COLOR, 0, &m->base_color_map));
    PELL_TRY(gltf_texture_map(g, &pbr, "metallicRoughnessTexture", PELL_ROLE_DATA, 1, &m->roughness_map));
    m->metallic_map = m->roughness_map;
    m->metallic_map.channel = m->metallic_map.texture ? 2 : 0;
    return PELL_OK;

fail:
    return res;
}

/* One value per pixel: 1 - factor x alpha, rounded to the nearest of 255 steps. */
static void glossiness_to_roughness(const struct pell_image *from, float factor, uint8_t *to)
{
    const size_t pixels = (size_t) from->width * (size_t) from->height, channels = (size_t) from->channels;

    for (size_t i = 0; i < pixels; i++) {
        const size_t at = (i + 1) * channels - 1;
        const float alpha = from->type == PELL_PIXEL_U8    ? (float) ((const uint8_t *) from->pixels)[at] / 255.0f
                            : from->type == PELL_PIXEL_U16 ? (float) ((const uint16_t *) from->pixels)[at] / 65535.0f
                                                           : ((const float *) from->pixels)[at];
        const float roughness = 1.0f - factor * (alpha > 0.0f ? alpha < 1.0f ? alpha : 1.0f : 0.0f);
        to[i] = (uint8_t) (255.0f * roughness + 0.5f);
    }
}

/* The alpha of `map` is glossiness: makes a texture of roughness, with the same sampler. */
static enum pell_result invert_glossiness(struct gltf *g, const struct pell_texture_map *map, float factor, struct pell_material *m)
{
    const struct pell_image *image = &map->texture->image;
    struct pell_texture *texture;
    enum pell_result res;

    if (image->channels % 2 != 0) { /* without an alpha channel, alpha is 1 */
        m->roughness = 1.0f - factor;
        return PELL_OK;
    }
    PELL_TRY(pell_scene_add_texture(g->scene, map->texture->name, &texture));
    PELL_TRY(pell_texture_allocate(g->scene, texture, image->width, image->height, 1, PELL_PIXEL_U8));
    glossiness_to_roughness(image, factor, texture->image.pixels);
    texture->wrap_u = map->texture->wrap_u;
    texture->wrap_v = map->texture->wrap_v;
    texture->nearest = map->texture->nearest;
    m->roughness_map = *map;
    m->roughness_map.texture = texture;
    m->roughness_map.channel = 0;
    m->roughness = 1.0f;
    return PELL_OK;

fail:
    return res;
}

/* KHR_materials_pbrSpecularGlossiness, in place of metallic-roughness. It becomes a dielectric of index 1.5, whose reflectance at normal
 * incidence is tinted to the specular colour: diffuse is the base colour, which Fresnel's reflectance darkens as the extension's 1 -
 * max(specular) does; roughness is 1 - glossiness. *given: the material has it. */
static enum pell_result read_specular_glossiness(struct gltf *g, const struct pell_json *at, struct pell_material *m, bool *given)
{
    const float f0 = 0.04f; /* ((1.5 - 1)/(1.5 + 1))^2 */
    struct pell_json extensions, spec_gloss;
    float glossiness = 1.0f;
    enum pell_result res;

    PELL_TRY(gltf_extension(at, "KHR_materials_pbrSpecularGlossiness", &extensions, &spec_gloss));
    *given = spec_gloss.value != NULL;
    if (!*given)
        return PELL_OK;
    m->metallic = 0.0f;
    for (int c = 0; c < 3; c++)
        m->specular_color[c] = 1.0f;
    PELL_TRY(gltf_factors(g, &spec_gloss, "diffuseFactor", 4, 0.0, 1.0, m->base_color));
    PELL_TRY(gltf_factors(g, &spec_gloss, "specularFactor", 3, 0.0, 1.0, m->specular_color));
    PELL_TRY(gltf_factor(g, &spec_gloss, "glossinessFactor", 0.0, 1.0, &glossiness));
    for (int c = 0; c < 3; c++)
        m->specular_color[c] /= f0;
    m->roughness = 1.0f - glossiness;
    PELL_TRY(gltf_texture_map(g, &spec_gloss, "diffuseTexture", PELL_ROLE_COLOR, 0, &m->base_color_map));
    PELL_TRY(gltf_texture_map(g, &spec_gloss, "specularGlossinessTexture", PELL_ROLE_COLOR, 0, &m->specular_color_map));
    return m->specular_color_map.texture ? invert_glossiness(g, &m->specular_color_map, glossiness, m) : PELL_OK;

fail:
    return res;
}

static enum pell_result read_specular(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    struct pell_json extensions, specular;
    enum pell_result res;

    PELL_TRY(gltf_extension(at, "KHR_materials_specular", &extensions, &specular));
    if (!specular.value)
        return PELL_OK;
    PELL_TRY(gltf_factor(g, &specular, "specularFactor", 0.0, 1.0, &m->rho_s));
    PELL_TRY(gltf_factors(g, &specular, "specularColorFactor", 3, 0.0, 1e3, m->specular_color));
    PELL_TRY(gltf_texture_map(g, &specular, "specularTexture", PELL_ROLE_DATA, 3, &m->rho_s_map));
    PELL_TRY(gltf_texture_map(g, &specular, "specularColorTexture", PELL_ROLE_COLOR, 0, &m->specular_color_map));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_emission(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    struct pell_json extensions, strength;
    float factor = 1.0f;
    enum pell_result res;

    /* above 1 is against the rules without the extension, but the meaning is plain */
    PELL_TRY(gltf_factors(g, at, "emissiveFactor", 3, 0.0, 1e6, m->emissive));
    PELL_TRY(gltf_extension(at, "KHR_materials_emissive_strength", &extensions, &strength));
    if (strength.value)
        PELL_TRY(gltf_factor(g, &strength, "emissiveStrength", 0.0, 1e12, &factor));
    for (int c = 0; c < 3; c++)
        m->emissive[c] *= factor;
    if (m->emissive[0] > 0.0f || m->emissive[1] > 0.0f || m->emissive[2] > 0.0f)
        PELL_TRY(gltf_texture_map(g, at, "emissiveTexture", PELL_ROLE_COLOR, 0, &m->emissive_map));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_alpha(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    static const char *const modes[] = { "OPAQUE", "MASK", "BLEND" };
    int mode = 0;
    enum pell_result res;

    PELL_TRY(pell_json_choice(at, "alphaMode", modes, PELL_COUNT(modes), &mode));
    m->alpha_mask = mode != 0;
    m->alpha_cutoff = 0.5f;
    if (mode == 1)
        PELL_TRY(gltf_factor(g, at, "alphaCutoff", 0.0, 1e6, &m->alpha_cutoff));
    if (mode == 2)
        gltf_warn(g, GLTF_WARN_MATERIAL, at, NULL, "material \"%s\" has alphaMode BLEND: it is drawn as a mask at 0.5", m->name);
    m->double_sided = false;
    return pell_json_bool(at, "doubleSided", &m->double_sided);

fail:
    return res;
}

static enum pell_result read_surface(struct gltf *g, const struct pell_json *at, struct pell_material *m)
{
    struct pell_json normal;
    bool spec_gloss; /* specular-glossiness */
    enum pell_result res;

    PELL_TRY(read_specular_glossiness(g, at, m, &spec_gloss));
    if (!spec_gloss) {
        PELL_TRY(read_metallic_roughness(g, at, m));
        PELL_TRY(read_specular(g, at, m));
    }
    PELL_TRY(pell_json_object(at, "normalTexture", &normal));
    PELL_TRY(gltf_texture_map(g, at, "normalTexture", PELL_ROLE_DATA, 0, &m->normal_map));
    if (normal.value)
        PELL_TRY(gltf_factor(g, &normal, "scale", -1e3, 1e3, &m->normal_scale));
    PELL_TRY(read_emission(g, at, m));
    return read_alpha(g, at, m);

fail:
    return res;
}

/* Reports unsupported extensions of a material, also if the file does not list them as used. */
static enum pell_result mention_extensions(struct gltf *g, const struct pell_json *at)
{
    /* clang-format off */
    static const char *const ignored[] = {
        "KHR_materials_unlit",       "KHR_materials_clearcoat",  "KHR_materials_sheen",
        "KHR_materials_iridescence", "KHR_materials_anisotropy", "KHR_materials_dispersion",
    };
    /* clang-format on */
    for (size_t i = 0; i < PELL_COUNT(ignored); i++) {
        struct pell_json extensions, extension;
        const enum pell_result res = gltf_extension(at, ignored[i], &extensions, &extension);
        if (res != PELL_OK)
            return res;
        if (extension.value)
            gltf_mention(g, &extension, ignored[i]);
    }
    return PELL_OK;
}

enum pell_result gltf_material(struct gltf *g, int64_t index, int *out)
{
    const struct pell_json at = pell_json_at(&g->materials, (size_t) index);
    struct pell_medium_fault fault;
    struct pell_material *m;
    struct pell_medium scaled;
    char name[128];
    size_t added;
    enum pell_result res;

    if (g->material[index] >= 0) {
        *out = (int) g->material[index];
        return PELL_OK;
    }
    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_scene_add_material(g->scene, gltf_name(&at, "material", name, sizeof(name)), &added));
    m = &g->scene->materials[added];
    PELL_TRY(mention_extensions(g, &at));
    PELL_TRY(read_surface(g, &at, m));
    PELL_TRY(read_interior(g, &at, m));
    scaled = m->medium;
    for (int c = 0; c < 3 && !m->opaque; c++) {
        scaled.sigma_a[c] /= MM_PER_METRE;
        scaled.sigma_s_reduced[c] /= MM_PER_METRE;
    }
    if (!pell_medium_valid(&scaled, &fault))
        return pell_json_error(&at, PELL_ERR_INVALID, "look at attenuationDistance and attenuationColor",
                               "the medium has %s = %g, allowed: [%g, %g] (1/mm, one unit taken as 1 m)", fault.field, fault.value,
                               fault.min, fault.max);
    g->material[index] = (int64_t) added;
    *out = (int) added;
    return PELL_OK;

fail:
    return res;
}
