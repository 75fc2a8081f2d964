/* SPDX-License-Identifier: MIT
 * layers.c - see layers.h. */
#include "scene/layers.h"

#include "image/color.h"

#include <pellucid/inversion.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#define LOOK_UPS ((int64_t) 1 << 24) /* limit on look-ups to measure a material; of larger maps every second, third, ... texel is used */
#define SUBSTRATE_SIGMA_T 1e3        /* 1/mm: extinction of the medium that represents the substrate below the layers */

void pell_layer_texel(const struct pell_texture_map *map, float u, float v, float rgba[4])
{
    const struct pell_texture *t = map->texture;
    const float *m = map->matrix;

    pell_image_sample(&t->image, t->wrap_u, t->wrap_v, t->nearest, m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5], rgba);
}

bool pell_layer_maps_alike(const struct pell_texture_map *a, const struct pell_texture_map *b)
{
    return a->texture == b->texture && a->uv == b->uv && memcmp(a->matrix, b->matrix, sizeof(a->matrix)) == 0;
}

void pell_scene_layers_finish(struct pell_context *ctx, struct pell_material *m)
{
    for (int i = 0; m->layers && i < m->num_layers; i++)
        pell_free(ctx, m->layers[i].name);
    pell_free(ctx, m->layers);
    m->layers = NULL;
    m->num_layers = 0;
}

/* --- Validity ----------------------------------------------------------------------------------------------------------------- */

static PELL_PRINTF(5, 6) bool bad(struct pell_layer_fault *fault, double value, double min, double max, const char *fmt, ...)
{
    va_list args;

    va_start(args, fmt);
    vsnprintf(fault->field, sizeof(fault->field), fmt, args);
    va_end(args);
    fault->value = value;
    fault->min = min;
    fault->max = max;
    return false;
}

static bool in_range(double value, double min, double max)
{
    return value >= min && value <= max;
}

bool pell_layer_has_channel(const struct pell_image *image, int channel)
{
    return channel == 0 || (channel == 3 ? image->channels == 2 || image->channels == 4 : image->channels >= 3);
}

bool pell_layer_texels_valid(const struct pell_scene_layer *layer, struct pell_layer_fault *fault)
{
    const struct pell_image *image = &layer->depth_map.texture->image;
    const int channel = layer->depth_map.channel == 3 ? image->channels - 1 : layer->depth_map.channel;
    const double most = layer->depth_inverse ? 1.0 : fmin((double) PELL_LAYER_DEPTH_MAX / (double) layer->depth, 1e30);
    const float *at = image->pixels;

    if (image->type != PELL_PIXEL_F32)
        return true;
    at += channel;
    for (int y = 0; y < image->height; y++)
        for (int x = 0; x < image->width; x++, at += image->channels)
            if (!in_range((double) *at, 0.0, most))
                return bad(fault, (double) *at, 0.0, most, "texel (%d, %d), channel %c,", x, y, "rgba"[layer->depth_map.channel]);
    return true;
}

static bool numbers_valid(const struct pell_scene_layer *layer, int i, struct pell_layer_fault *fault)
{
    const struct pell_medium *m = &layer->medium;
    struct pell_medium_fault inner;

    for (int c = 0; c < 3; c++) {
        if (!pell_phase_valid(&layer->phase[c], &inner))
            return bad(fault, inner.value, inner.min, inner.max, "layer %d: phase[%d].%s", i, c, inner.field);
        if (!in_range(m->g[c], -PELL_G_MAX, PELL_G_MAX) || fabs(m->g[c] - pell_phase_mean_cosine(&layer->phase[c])) > 1e-6)
            return bad(fault, m->g[c], pell_phase_mean_cosine(&layer->phase[c]), pell_phase_mean_cosine(&layer->phase[c]),
                       "layer %d: g[%d], the phase function's mean cosine,", i, c);
        if (!in_range(m->sigma_a[c], 0.0, PELL_SIGMA_MAX))
            return bad(fault, m->sigma_a[c], 0.0, PELL_SIGMA_MAX, "layer %d: sigma_a[%d]", i, c);
        if (!in_range(m->sigma_s_reduced[c], 0.0, PELL_SIGMA_MAX * fmin(1.0, 1.0 - m->g[c])))
            return bad(fault, m->sigma_s_reduced[c], 0.0, PELL_SIGMA_MAX * fmin(1.0, 1.0 - m->g[c]), "layer %d: sigma_s_reduced[%d]", i, c);
    }
    return true;
}

static bool map_valid(const struct pell_scene_layer *layer, int i, struct pell_layer_fault *fault)
{
    const struct pell_texture_map *map = &layer->depth_map;
    struct pell_layer_fault texel;

    if (map->uv < 0 || map->uv >= PELL_UV_SETS)
        return bad(fault, map->uv, 0, PELL_UV_SETS - 1, "layer %d: the UV set of the depth map", i);
    if (!map->texture->image.pixels || map->texture->image.width < 1 || map->texture->image.height < 1)
        return bad(fault, 0.0, 1.0, (double) INT32_MAX, "layer %d: the size of the depth map", i);
    if (map->channel < 0 || map->channel > 3 || !pell_layer_has_channel(&map->texture->image, map->channel))
        return bad(fault, map->channel, 0, map->texture->image.channels - 1, "layer %d: the channel of the depth map", i);
    for (int k = 0; k < 6; k++)
        if (!in_range((double) map->matrix[k], -1e9, 1e9))
            return bad(fault, (double) map->matrix[k], -1e9, 1e9, "layer %d: the transform of the depth map", i);
    if (!pell_layer_texels_valid(layer, &texel))
        return bad(fault, texel.value, texel.min, texel.max, "layer %d: %.120s of the depth map", i, texel.field);
    return true;
}

bool pell_scene_layers_valid(const struct pell_material *m, struct pell_layer_fault *fault)
{
    float above = 0.0f;

    if (m->num_layers < 0 || m->num_layers > PELL_LAYERS_MOST)
        return bad(fault, m->num_layers, 0, PELL_LAYERS_MOST, "the number of layers");
    if (m->num_layers > 0 && !m->layers)
        return bad(fault, m->num_layers, 0, 0, "the number of layers, without any");
    if (m->num_layers > 0 && ((int) m->substrate < 0 || m->substrate > PELL_SUBSTRATE_SURFACE_COLOR))
        return bad(fault, (int) m->substrate, 0, PELL_SUBSTRATE_SURFACE_COLOR, "what is below the layers");
    for (int i = 0; i < m->num_layers; i++) {
        const struct pell_scene_layer *layer = &m->layers[i];
        const bool endless = i + 1 == m->num_layers && !layer->depth_map.texture;
        if (!numbers_valid(layer, i, fault))
            return false;
        if (!in_range((double) layer->depth, 0.0, (double) PELL_LAYER_DEPTH_MAX) && !(endless && layer->depth == INFINITY))
            return bad(fault, (double) layer->depth, 0.0, (double) PELL_LAYER_DEPTH_MAX, "layer %d: depth (mm)", i);
        if (layer->depth_map.texture) {
            if (!map_valid(layer, i, fault))
                return false;
            continue;
        }
        if (layer->depth < above)
            return bad(fault, (double) layer->depth, (double) above, (double) PELL_LAYER_DEPTH_MAX,
                       "layer %d, which lies below another: depth (mm)", i);
        above = layer->depth;
    }
    return true;
}

/* --- Measures ----------------------------------------------------------------------------------------------------------------- */

static int64_t texels_of(const struct pell_texture_map *map)
{
    return (int64_t) map->texture->image.width * map->texture->image.height;
}

/* Whether two maps have texels at the same points of the mesh. */
static bool same_grid(const struct pell_texture_map *a, const struct pell_texture_map *b)
{
    return a->texture->image.width == b->texture->image.width && a->texture->image.height == b->texture->image.height &&
           memcmp(a->matrix, b->matrix, sizeof(a->matrix)) == 0;
}

/* Texture coordinates of the mesh for a map's own coordinates; unchanged if the map's matrix is singular. */
static void invert(const struct pell_texture_map *map, double s, double t, float *u, float *v)
{
    const float *m = map->matrix;
    const double a = (double) m[0], b = (double) m[1], c = (double) m[3], d = (double) m[4], det = a * d - b * c;

    s -= (double) m[2];
    t -= (double) m[5];
    *u = (float) (det != 0.0 ? (d * s - b * t) / det : s);
    *v = (float) (det != 0.0 ? (a * t - c * s) / det : t);
}

static void measure(const struct pell_material *m, const bool *included, const struct pell_texture_map *grid,
                    struct pell_layer_measure *out)
{
    const struct pell_image *image = &grid->texture->image;
    int step = 1;
    double points = 0.0;

    while ((int64_t) (image->width / step) * (image->height / step) > LOOK_UPS / m->num_layers)
        step++;
    for (int i = 0; i < m->num_layers; i++)
        if (included[i])
            out[i] = (struct pell_layer_measure) { (double) INFINITY, 0.0, 0.0, 0 };
    for (int y = step / 2 < image->height ? step / 2 : 0; y < image->height; y += step)
        for (int x = step / 2 < image->width ? step / 2 : 0; x < image->width; x += step) {
            const struct pell_texture_map *last = NULL;
            float u, v, rgba[4] = { 0 }, above = 0.0f;
            invert(grid, (x + 0.5) / image->width, (y + 0.5) / image->height, &u, &v);
            points += 1.0;
            for (int i = 0; i < m->num_layers; i++) {
                const struct pell_scene_layer *layer = &m->layers[i];
                const struct pell_texture_map *map = &layer->depth_map;
                float d = layer->depth;
                if (!included[i])
                    continue;
                if (map->texture) {
                    if (!last || !pell_layer_maps_alike(last, map)) {
                        if (same_grid(map, grid))
                            pell_image_texel(&map->texture->image, x, y, rgba);
                        else
                            pell_layer_texel(map, u, v, rgba);
                        last = map;
                    }
                    d *= pell_layer_depth_fraction(rgba[map->channel], layer->depth_inverse);
                }
                out[i].crossings += d < above - 1e-5f * above - 1e-6f; /* more than rounding */
                above = d > above ? d : above;
                out[i].min = fmin(out[i].min, (double) above);
                out[i].max = fmax(out[i].max, (double) above);
                out[i].mean += (double) above;
            }
        }
    for (int i = 0; i < m->num_layers; i++)
        if (included[i]) {
            out[i].mean /= points;
            out[i].crossings = (int64_t) ((double) out[i].crossings * ((double) image->width * image->height / points));
        }
}

int64_t pell_scene_layers_measure(const struct pell_material *m, struct pell_layer_measure *out)
{
    const struct pell_texture_map *grid = NULL;
    bool included[PELL_LAYERS_MOST];
    float above = 0.0f;

    for (int i = 0; i < m->num_layers; i++) {
        const struct pell_texture_map *map = &m->layers[i].depth_map;
        if (map->texture && (!grid || texels_of(map) > texels_of(grid)))
            grid = map;
    }
    for (int i = 0; !grid && i < m->num_layers; i++) {
        above = fmaxf(above, m->layers[i].depth);
        out[i] = (struct pell_layer_measure) { (double) above, (double) above, (double) above, 0 };
    }
    if (!grid)
        return 0;
    for (int i = 0; i < m->num_layers; i++)
        included[i] = !m->layers[i].depth_map.texture || m->layers[i].depth_map.uv == grid->uv;
    measure(m, included, grid, out);
    for (int i = 0; i < m->num_layers; i++)
        if (m->layers[i].depth_map.texture && m->layers[i].depth_map.uv != grid->uv) {
            memset(included, 0, sizeof(included));
            included[i] = true;
            measure(m, included, &m->layers[i].depth_map, out);
        }
    return texels_of(grid);
}

/* --- What they reflect -------------------------------------------------------------------------------------------------------- */

/* Coefficients that diffusion solvers accept: a clear layer gets a little absorption. */
static void set_stack_layer(const struct pell_medium *from, double eta, double thickness, struct pell_medium_layer *to)
{
    for (int c = 0; c < 3; c++) {
        to->sigma_a[c] = from->sigma_a[c];
        to->sigma_s_reduced[c] = from->sigma_s_reduced[c];
        to->g[c] = from->g[c];
        if (to->sigma_a[c] + to->sigma_s_reduced[c] < PELL_SIGMA_T_MIN)
            to->sigma_a[c] = PELL_SIGMA_T_MIN;
    }
    to->eta = eta;
    to->thickness = thickness;
}

static bool same_medium(const struct pell_medium_layer *a, const struct pell_medium_layer *b)
{
    return memcmp(a->sigma_a, b->sigma_a, sizeof(a->sigma_a)) == 0 &&
           memcmp(a->sigma_s_reduced, b->sigma_s_reduced, sizeof(a->sigma_s_reduced)) == 0;
}

/* Merges the two neighbours that are thinnest for their depth, as the deeper ones matter less; both have bottoms. */
static void merge_least(struct pell_medium_layer *layer, int count)
{
    struct pell_medium_layer *a = layer, *b;
    double least = INFINITY, above = 0.0, sum;

    for (int i = 0; i + 1 < count; i++) {
        const double both = layer[i].thickness + layer[i + 1].thickness, fraction = both / (above + both);
        if (fraction <= least) {
            least = fraction;
            a = &layer[i];
        }
        above += layer[i].thickness;
    }
    b = a + 1;
    sum = a->thickness + b->thickness;
    for (int c = 0; c < 3; c++) {
        a->sigma_a[c] = (a->sigma_a[c] * a->thickness + b->sigma_a[c] * b->thickness) / sum;
        a->sigma_s_reduced[c] = (a->sigma_s_reduced[c] * a->thickness + b->sigma_s_reduced[c] * b->thickness) / sum;
        a->g[c] = (a->g[c] * a->thickness + b->g[c] * b->thickness) / sum;
    }
    a->thickness = sum;
    memmove(b, b + 1, (size_t) (layer + count - (b + 1)) * sizeof(*b));
}

/* The substrate below layers that end, as a half-space of the same index. */
static void set_substrate(const struct pell_material *m, struct pell_medium_layer *out)
{
    struct pell_medium medium = { 0 };

    for (int c = 0; c < 3; c++) {
        const double color = fmin(fmax((double) m->base_color[c], 0.0), 1.0);
        const double albedo = m->substrate == PELL_SUBSTRATE_STOP ? 0.0 : pell_albedo_map_invert(PELL_ALBEDO_VAN_DE_HULST, color, 1.0);
        medium.sigma_s_reduced[c] = SUBSTRATE_SIGMA_T * albedo;
        medium.sigma_a[c] = SUBSTRATE_SIGMA_T * (1.0 - albedo);
    }
    set_stack_layer(&medium, m->medium.eta, (double) INFINITY, out);
}

/* Mean weighted by thickness; for infinite layers the last alone. */
static void mean_medium(const struct pell_medium_layer *layer, int count, struct pell_medium *out)
{
    double sum = 0.0;

    for (int i = 0; i < count; i++)
        sum += layer[i].thickness;
    for (int c = 0; c < 3; c++) {
        out->sigma_a[c] = out->sigma_s_reduced[c] = out->g[c] = 0.0;
        for (int i = sum == (double) INFINITY ? count - 1 : 0; i < count; i++) {
            const double w = sum == (double) INFINITY ? 1.0 : layer[i].thickness / sum;
            out->sigma_a[c] += w * layer[i].sigma_a[c];
            out->sigma_s_reduced[c] += w * layer[i].sigma_s_reduced[c];
            out->g[c] += w * layer[i].g[c];
        }
        out->sigma_a[c] = fmin(fmax(out->sigma_a[c], PELL_SIGMA_T_MIN), PELL_SIGMA_MAX);
        out->sigma_s_reduced[c] = fmin(out->sigma_s_reduced[c], PELL_SIGMA_MAX);
    }
}

/* `endless`: the last layer has no bottom; else a substrate lies below. */
static void make_stack(const struct pell_material *m, const double *bottoms, struct pell_stack *out, bool *endless)
{
    struct pell_medium_layer layer[PELL_LAYERS_MOST + 1];
    double above = 0.0;
    int count = 0;

    *endless = false;
    for (int i = 0; i < m->num_layers && !*endless; i++) {
        const double thickness = bottoms[i] - above;
        *endless = bottoms[i] == (double) INFINITY || (i + 1 == m->num_layers && m->substrate == PELL_SUBSTRATE_LAST);
        if (!*endless && !(thickness >= PELL_THICKNESS_MIN))
            continue;
        set_stack_layer(&m->layers[i].medium, m->medium.eta, *endless ? (double) INFINITY : fmin(thickness, PELL_THICKNESS_MAX),
                        &layer[count++]);
        /* merge layers of one medium: thin layers can't be solved on their own */
        if (count > 1 && same_medium(&layer[count - 2], &layer[count - 1])) {
            layer[count - 2].thickness += layer[count - 1].thickness;
            if (!*endless)
                layer[count - 2].thickness = fmin(layer[count - 2].thickness, PELL_THICKNESS_MAX);
            count--;
        }
        above = bottoms[i];
    }
    while (count > PELL_LAYERS_MAX - 1) {
        merge_least(layer, count - *endless);
        if (*endless)
            layer[count - 2] = layer[count - 1];
        count--;
    }
    if (!*endless)
        set_substrate(m, &layer[count++]);
    memset(out, 0, sizeof(*out));
    out->count = count;
    memcpy(out->layer, layer, (size_t) count * sizeof(*layer));
}

void pell_scene_layers_stack(const struct pell_material *m, const double *bottoms, struct pell_stack *out)
{
    bool endless;

    make_stack(m, bottoms, out, &endless);
}

const struct pell_material_entry *pell_scene_layers_preset(const struct pell_material *m)
{
    const struct pell_material_entry *e = m->preset && !m->profile ? pell_material_find(m->preset) : NULL;

    return e && e->kind == PELL_MATERIAL_LAYERS && memcmp(&e->gaussians, &m->gaussians, sizeof(e->gaussians)) == 0 ? e : NULL;
}

bool pell_scene_profile_stack(const struct pell_material *m, struct pell_stack *out)
{
    const struct pell_material_entry *preset = pell_scene_layers_preset(m);
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    double bottoms[PELL_LAYERS_MOST];

    if (m->num_layers == 0 && preset)
        pell_material_stack(&preset->layers, out);
    if (m->num_layers == 0 || m->profile || m->gaussians.count == 0)
        return m->num_layers == 0 && preset;
    pell_scene_layers_measure(m, measure);
    for (int i = 0; i < m->num_layers; i++)
        bottoms[i] = measure[i].mean;
    pell_scene_layers_stack(m, bottoms, out);
    return true;
}

bool pell_scene_layers_solve(struct pell_material *m, const struct pell_layer_measure *measure)
{
    static const struct pell_fit_params params = { .count = PELL_MATERIAL_LAYERS_GAUSSIANS };
    struct pell_stack stack;
    struct pell_profile profiles[3];
    struct pell_gaussians found = { 0 };
    double bottoms[PELL_LAYERS_MOST];
    bool endless, solved = true;

    for (int i = 0; i < m->num_layers; i++)
        bottoms[i] = measure[i].mean;
    make_stack(m, bottoms, &stack, &endless);
    mean_medium(stack.layer, stack.count > 1 && !endless ? stack.count - 1 : stack.count, &m->medium);
    for (int c = 0; c < 3 && solved; c++)
        solved = pell_stack_profile(&stack, c, PELL_STACK_R_PLUS, &profiles[c], NULL) == PELL_OK;
    solved = solved && pell_fit_profiles(profiles, &params, &found, NULL) == PELL_OK && found.count > 0;
    m->gaussians.count = 0;
    if (solved)
        m->gaussians = found;
    return solved;
}
