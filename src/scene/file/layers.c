/* SPDX-License-Identifier: MIT
 * layers.c - "layers" of a scene file's material: coefficients, phase functions, depth maps. */
#include "scene/layers.h"
#include "scene/file/scene_file.h"

#include <float.h>
#include <math.h>
#include <string.h>

const char *const pell_layer_keys[PELL_LAYER_KEYS] = { "name", "sigma_a", "sigma_s", "sigma_t",     "phase",
                                                       "g",    "weight",  "depth",   "depth_scale", "depth_encoding" };

#define DEPTH_IMAGES_MOST ((PELL_LAYERS_MOST + 3) / 4)

/* The keys next to "layers" that apply to all of them. */
struct depth_defaults {
    struct pell_json depths; /* images, one layer per channel */
    size_t count;            /* number of images */
    double scale;            /* mm; 0: not given */
    int inverse;
};

/* --- Media -------------------------------------------------------------------------------------------------------------------- */

/* "g" is one number or three; for two lobes, two. */
static enum pell_result read_phase(const struct pell_json *at, struct pell_scene_layer *layer)
{
    static const char *const phases[] = { "hg", "schlick", "rayleigh", "two-lobe" }; /* in the order of enum pell_phase_kind */
    const struct pell_json g_at = pell_json_get(at, "g"), weight = pell_json_get(at, "weight");
    int phase = PELL_PHASE_HENYEY_GREENSTEIN;
    double g[3] = { 0 }, w = 0.5;
    enum pell_result res;

    PELL_TRY(pell_json_choice(at, "phase", phases, PELL_COUNT(phases), &phase));
    if (phase == PELL_PHASE_RAYLEIGH && g_at.value)
        return pell_json_error(&g_at, PELL_ERR_FORMAT, NULL, "does not belong to the phase function \"rayleigh\"");
    if (phase != PELL_PHASE_TWO_LOBE && weight.value)
        return pell_json_error(&weight, PELL_ERR_FORMAT, NULL, "belongs to the phase function \"two-lobe\"");
    if (phase == PELL_PHASE_TWO_LOBE) {
        PELL_TRY(pell_json_require(at, "g"));
        PELL_TRY(pell_json_numbers(at, "g", 2, -PELL_G_MAX, PELL_G_MAX, g));
        PELL_TRY(pell_json_number(at, "weight", 0.0, 1.0, &w));
    } else if (json_is_number(g_at.value)) {
        PELL_TRY(pell_json_to_number(&g_at, -PELL_G_MAX, PELL_G_MAX, &g[0]));
        g[1] = g[2] = g[0];
    } else {
        PELL_TRY(pell_json_numbers(at, "g", 3, -PELL_G_MAX, PELL_G_MAX, g));
    }
    for (int c = 0; c < 3; c++) {
        layer->phase[c] = (struct pell_phase) { .kind = (enum pell_phase_kind) phase, .g = { g[c] } };
        if (phase == PELL_PHASE_TWO_LOBE)
            layer->phase[c] = (struct pell_phase) { PELL_PHASE_TWO_LOBE, { g[0], g[1] }, w };
        layer->medium.g[c] = pell_phase_mean_cosine(&layer->phase[c]);
    }
    return PELL_OK;

fail:
    return res;
}

/* Reads two of sigma_a, sigma_s and sigma_t. */
static enum pell_result read_sigmas(const struct pell_json *at, struct pell_medium *m)
{
    const struct pell_json t = pell_json_get(at, "sigma_t");
    const char *part = pell_json_has(at, "sigma_s") ? "sigma_s" : "sigma_a";
    double a[3], s[3], sum[3];
    enum pell_result res;

    if (pell_json_has(at, "sigma_a") + pell_json_has(at, "sigma_s") + pell_json_has(at, "sigma_t") != 2)
        return pell_json_error(at, PELL_ERR_FORMAT, "sigma_t = sigma_a + sigma_s", "must have two of sigma_a, sigma_s and sigma_t");
    PELL_TRY(pell_json_numbers(at, "sigma_a", 3, 0.0, PELL_SIGMA_MAX, a));
    PELL_TRY(pell_json_numbers(at, "sigma_s", 3, 0.0, PELL_SIGMA_MAX, s));
    PELL_TRY(pell_json_numbers(at, "sigma_t", 3, 0.0, PELL_SIGMA_MAX, sum));
    if (t.value) {
        const struct pell_json list = pell_json_get(at, part);
        for (size_t c = 0; c < 3; c++) {
            const double known = part[6] == 's' ? s[c] : a[c];
            const struct pell_json number = pell_json_at(&list, c);
            if (known > sum[c])
                return pell_json_error(&number, PELL_ERR_FORMAT, NULL, "is %g, allowed: [0, %g], for %s is a part of sigma_t", known,
                                       sum[c], part);
            (part[6] == 's' ? a : s)[c] = sum[c] - known;
        }
    }
    for (int c = 0; c < 3; c++) {
        m->sigma_a[c] = a[c];
        m->sigma_s_reduced[c] = s[c] * (1.0 - m->g[c]);
    }
    return PELL_OK;

fail:
    return res;
}

/* --- Depths ------------------------------------------------------------------------------------------------------------------- */

/* A number followed directly by letters is a length; with a '#' or '/', or a dot before the letters ("01.png"), it is an image's name. */
static bool is_length(const char *text)
{
    size_t end = strlen(text);

    while (end > 0 && ((text[end - 1] | 32) >= 'a' && (text[end - 1] | 32) <= 'z'))
        end--;
    return strspn(text, "+-.0123456789") > 0 && !strpbrk(text, "#/\\") && (end == 0 || text[end - 1] != '.');
}

/* "file.png#r": an image's channel without colour conversion, floats too. "baseColor.a": a channel of one of the material's textures. */
static enum pell_result read_map(struct pell_scene_reader *r, const struct pell_json *at, const char *text, const struct pell_material *m,
                                 int channel, struct pell_texture_map *map)
{
    char *name = NULL;
    struct pell_texture *texture;
    size_t length = strlen(text);
    enum pell_result res;

    if (pell_scene_own_map(m, text, map)) {
        r->layers = NULL; /* another material has another texture */
        return map->texture ? PELL_OK : pell_json_error(at, PELL_ERR_FORMAT, NULL, "the material has no such texture");
    }
    if (channel < 0)
        PELL_TRY(pell_scene_channel_of(at, text, &length, &channel));
    name = pell_strndup(r->ctx, text, length);
    if (!name)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_scene_need_picture(r, at, name, PELL_ROLE_RAW, &texture));
    texture->image.srgb = false; /* depths are numbers, not colours */
    *map = pell_texture_map_none();
    map->texture = texture;
    map->channel = channel;

fail:
    pell_free(r->ctx, name);
    return res;
}

static enum pell_result read_depth_map(struct pell_scene_reader *r, const struct pell_json *place, const struct pell_json *at,
                                       const char *text, int channel, const struct depth_defaults *defaults, const struct pell_material *m,
                                       struct pell_scene_layer *layer)
{
    static const char *const encodings[] = { "linear", "inverse" };
    const struct pell_json scale = pell_json_get(at, "depth_scale");
    struct pell_layer_fault fault;
    double mm = defaults->scale;
    int inverse = defaults->inverse;
    enum pell_result res;

    PELL_TRY(pell_json_choice(at, "depth_encoding", encodings, PELL_COUNT(encodings), &inverse));
    if (scale.value)
        PELL_TRY(pell_scene_text_length(&scale, false, &mm));
    if (!(mm > 0.0))
        return pell_json_error(at, PELL_ERR_FORMAT, "as in \"depth_scale\": \"4mm\"",
                               "must have depth_scale: the depth where the map \"%.60s\" is 1", text);
    if (!(mm <= (double) PELL_LAYER_DEPTH_MAX))
        return pell_json_error(scale.value ? &scale : at, PELL_ERR_FORMAT, NULL, "depth_scale is %g mm, allowed: above 0, at most %g", mm,
                               (double) PELL_LAYER_DEPTH_MAX);
    PELL_TRY(read_map(r, place, text, m, channel, &layer->depth_map));
    layer->depth = fmaxf((float) mm, FLT_MIN);
    layer->depth_inverse = inverse == 1;
    if (!pell_layer_has_channel(&layer->depth_map.texture->image, layer->depth_map.channel))
        return pell_json_error(place, PELL_ERR_FORMAT, NULL, "has no channel %c: the image has %d", "rgba"[layer->depth_map.channel],
                               layer -> depth_map.texture->image.channels);
    if (!pell_layer_texels_valid(layer, &fault))
        return pell_json_error(place, PELL_ERR_FORMAT, "NaN and infinity are refused, too", "%s is %g, allowed: [%g, %g]", fault.field,
                               fault.value, fault.min, fault.max);

fail:
    return res;
}

static enum pell_result read_depth(struct pell_scene_reader *r, const struct pell_json *at, int i, bool last,
                                   const struct depth_defaults *defaults, const struct pell_material *m, float *above,
                                   struct pell_scene_layer *layer)
{
    const struct pell_json depth = pell_json_get(at, "depth");
    const char *text;
    double mm;
    enum pell_result res;

    if (depth.value) {
        if (!json_is_string(depth.value))
            return pell_json_error(&depth, PELL_ERR_FORMAT, "write it with its unit, as in \"1.2mm\", or \"image.png#r\"",
                                   "must be a text: a length without a unit could mean anything");
        PELL_TRY(pell_json_to_string(&depth, &text));
        if (!is_length(text))
            return read_depth_map(r, &depth, at, text, -1, defaults, m, layer);
    } else if ((size_t) i < 4 * defaults->count) {
        const struct pell_json picture = pell_json_at(&defaults->depths, (size_t) i / 4);
        PELL_TRY(pell_json_to_string(&picture, &text));
        return read_depth_map(r, &picture, at, text, i % 4, defaults, m, layer);
    }
    for (const char *const *k = (const char *const[]) { "depth_scale", "depth_encoding", NULL }; *k; k++) {
        const struct pell_json of_map = pell_json_get(at, *k);
        if (of_map.value)
            return pell_json_error(&of_map, PELL_ERR_FORMAT, NULL, "belongs to a painted depth: \"depth\" is no image here");
    }
    layer->depth = INFINITY;
    if (!depth.value && !last)
        return pell_json_require(at, "depth");
    if (!depth.value)
        return PELL_OK;
    PELL_TRY(pell_scene_text_length(&depth, true, &mm));
    if (!((float) mm >= *above && mm <= (double) PELL_LAYER_DEPTH_MAX))
        return pell_json_error(&depth, PELL_ERR_FORMAT, "depths are from the surface to the layer's bottom; layers go from top to bottom",
                               "is %g mm, allowed: [%g, %g]", mm, (double) *above, (double) PELL_LAYER_DEPTH_MAX);
    *above = layer->depth = (float) mm;
    return PELL_OK;

fail:
    return res;
}

/* --- All ---------------------------------------------------------------------------------------------------------------------- */

static enum pell_result read_depth_defaults(const struct pell_json *at, struct depth_defaults *out)
{
    static const char *const encodings[] = { "linear", "inverse" };
    const struct pell_json scale = pell_json_get(at, "depth_scale");
    enum pell_result res;

    memset(out, 0, sizeof(*out));
    for (const char *const *k = (const char *const[]) { "depths", "depth_scale", "depth_encoding", "below", NULL }; *k; k++) {
        const struct pell_json value = pell_json_get(at, *k);
        if (value.value && !pell_json_has(at, "layers"))
            return pell_json_error(&value, PELL_ERR_FORMAT, NULL, "stands without layers");
    }
    PELL_TRY(pell_json_array(at, "depths", 1, DEPTH_IMAGES_MOST, &out->depths));
    out->count = pell_json_count(&out->depths);
    if (scale.value)
        PELL_TRY(pell_scene_text_length(&scale, false, &out->scale));
    PELL_TRY(pell_json_choice(at, "depth_encoding", encodings, PELL_COUNT(encodings), &out->inverse));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_layer(struct pell_scene_reader *r, const struct pell_json *at, int i, bool last,
                                   const struct depth_defaults *defaults, const struct pell_material *m, float *above,
                                   struct pell_scene_layer *layer)
{
    const char *name = "";
    enum pell_result res;

    PELL_TRY(pell_json_is_object(at));
    PELL_TRY(pell_json_only(at, pell_layer_keys, PELL_LAYER_KEYS));
    PELL_TRY(pell_json_string(at, "name", &name));
    layer->name = pell_strdup(r->ctx, name);
    if (!layer->name)
        return PELL_ERR_NOMEM;
    layer->depth_map = pell_texture_map_none();
    layer->medium.eta = m->medium.eta;
    PELL_TRY(read_phase(at, layer));
    PELL_TRY(read_sigmas(at, &layer->medium));
    PELL_TRY(read_depth(r, at, i, last, defaults, m, above, layer));
    return PELL_OK;

fail:
    return res;
}

/* Copies layers that the same text gave another material: "*" applies to all materials. */
static enum pell_result copy_layers(struct pell_scene_reader *r, const struct pell_material *from, struct pell_material *to)
{
    for (int i = 0; i < to->num_layers; i++) {
        struct pell_scene_layer *layer = &to->layers[i];
        *layer = from->layers[i];
        layer->name = pell_strdup(r->ctx, from->layers[i].name);
        if (!layer->name)
            return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

static bool same_below(const struct pell_material *a, const struct pell_material *b)
{
    return a->substrate == b->substrate && a->medium.eta == b->medium.eta &&
           memcmp(a->base_color, b->base_color, sizeof(a->base_color)) == 0;
}

static void warn_of_crossings(const struct pell_json *list, const struct pell_material *m, const struct pell_layer_measure *measure,
                              int64_t texels)
{
    struct pell_text text = { 0 };
    char shown[64];
    int reported = 0;

    for (int i = 0; i < m->num_layers; i++)
        if (measure[i].crossings > 0 && reported++ < 4)
            pell_text_add(&text, "%s layer %d (\"%s\") at %.3g %% of the texels", reported > 1 ? "," : "", i,
                          pell_printable(m->layers[i].name, shown, sizeof(shown)), 100.0 * (double) measure[i].crossings / (double) texels);
    if (reported > 0)
        pell_json_warn(list, "where layers cross, the upper one takes precedence: paint depths that grow from layer to layer",
                       "the bottom lies above that of a layer above:%s%s", text.str, reported > 4 ? ", and more" : "");
}

enum pell_result pell_scene_read_layers(struct pell_scene_reader *r, const struct pell_json *at, bool own, size_t material)
{
    static const char *const substrate_names[] = { "stop", "last", "surface-color" }; /* in the order of enum pell_substrate */
    struct pell_material *m = &r->scene->materials[material];
    const struct pell_material *other;
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    struct depth_defaults defaults;
    struct pell_json list;
    float above = 0.0f;
    int below = PELL_SUBSTRATE_LAST, count;
    int64_t texels;
    enum pell_result res;

    PELL_TRY(read_depth_defaults(at, &defaults));
    PELL_TRY(pell_json_array(at, "layers", 1, PELL_LAYERS_MOST, &list));
    if (!list.value)
        return PELL_OK;
    PELL_TRY(pell_json_choice(at, "below", substrate_names, PELL_COUNT(substrate_names), &below));
    count = (int) pell_json_count(&list);
    if (defaults.count > ((size_t) count + 3) / 4)
        return pell_json_error(&defaults.depths, PELL_ERR_FORMAT, "an image paints four layers, one in each channel", "has %s for %s",
                               pell_counted((long long) defaults.count, "image", "images").str, pell_counted(count, "layer", "layers").str);
    PELL_TRY(pell_material_allocate_layers(r->scene, material, count));
    m->substrate = (enum pell_substrate) below;
    other = r->layers == list.value ? &r->scene->materials[r->layers_of] : NULL;
    if (other && other->num_layers == count && same_below(other, m)) {
        if (own) {
            m->gaussians = other->gaussians;
            m->medium = other->medium;
        }
        return copy_layers(r, other, m);
    }
    r->layers = list.value;
    r->layers_of = material;
    for (int i = 0; i < count; i++) {
        const struct pell_json layer = pell_json_at(&list, (size_t) i);
        PELL_TRY(read_layer(r, &layer, i, i + 1 == count, &defaults, m, &above, &m->layers[i]));
    }
    texels = pell_scene_layers_measure(m, measure);
    warn_of_crossings(&list, m, measure, texels);
    if (own && !pell_scene_layers_solve(m, measure))
        pell_json_warn(&list, "methods of diffusion show the mean of their coefficients",
                       "the layers reflect no light, so there is no sum of Gaussians for them");
    return PELL_OK;

fail:
    return res;
}
