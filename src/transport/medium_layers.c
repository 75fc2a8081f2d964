/* SPDX-License-Identifier: MIT
 * medium_layers.c - see medium_layers.h. */
#include "transport/medium_layers.h"

#include "base/base.h"
#include "image/color.h"
#include "scene/layers.h"

#include <math.h>
#include <string.h>

static void set_medium(const struct pell_medium *m, struct pell_layer_medium *out)
{
    for (int c = 0; c < 3; c++) {
        out->sigma_s[c] = m->sigma_s_reduced[c] / (1.0 - m->g[c]);
        out->sigma_t[c] = out->sigma_s[c] + m->sigma_a[c];
    }
}

/* Range of a depth map, relative to the layer's depth; if its values differ, `largest` is the maximum of its integer type. */
static void range_of(const struct pell_scene_layer *layer, float *least, float *largest)
{
    const struct pell_texture_map *map = &layer->depth_map;
    const struct pell_image *image = &map->texture->image;
    float rgba[4];

    *least = INFINITY;
    *largest = 0.0f;
    for (int y = 0; y < image->height; y++)
        for (int x = 0; x < image->width; x++) {
            pell_image_texel(image, x, y, rgba);
            *least = fminf(*least, pell_layer_depth_fraction(rgba[map->channel], layer->depth_inverse));
            *largest = fmaxf(*largest, pell_layer_depth_fraction(rgba[map->channel], layer->depth_inverse));
            if (*least < *largest && image->type != PELL_PIXEL_F32) {
                *largest = 1.0f;
                return;
            }
        }
}

static void take_layers(const struct pell_material *m, struct pell_medium_layers *out)
{
    float least = 0.0f, largest = 0.0f;
    double deepest;

    out->eta = m->medium.eta;
    out->count = m->num_layers < PELL_LAYERS_MOST ? m->num_layers : PELL_LAYERS_MOST;
    out->substrate = m->substrate;
    for (int i = 0; i < out->count; i++) {
        const struct pell_scene_layer *from = &m->layers[i];
        struct pell_layer_medium *to = &out->item[i];
        to->name = from->name ? from->name : "";
        set_medium(&from->medium, to);
        memcpy(to->phase, from->phase, sizeof(to->phase));
        to->depth = (double) from->depth;
        to->inverse = from->depth_inverse;
        if (from->depth_map.texture) {
            range_of(from, &least, &largest);
            if (least < largest) {
                to->map = &from->depth_map;
                out->has_maps = true;
            } else {
                to->depth = (double) (from->depth * least);
            }
        }
        /* Without texture coordinates the map's value is 1. */
        deepest = to->map ? (double) from->depth * fmax((double) largest, to->inverse ? 0.0 : 1.0) : to->depth;
        if (deepest < (double) INFINITY)
            out->deepest = fmax(out->deepest, deepest);
    }
    for (int i = 1; !out->has_maps && i < out->count; i++)
        out->item[i].depth = fmax(out->item[i].depth, out->item[i - 1].depth);
}

static void take_stack(struct pell_context *ctx, const char *method, const struct pell_material *m,
                       const struct pell_material_layers *layers, struct pell_medium_layers *out)
{
    double depth = 0.0;

    out->eta = layers->item[0].medium.eta;
    out->count = layers->count;
    out->substrate = PELL_SUBSTRATE_LAST;
    for (int i = 0; i < out->count; i++) {
        const struct pell_material_layer *from = &layers->item[i];
        struct pell_layer_medium *to = &out->item[i];
        to->name = from->name;
        set_medium(&from->medium, to);
        memcpy(to->phase, from->phase, sizeof(to->phase));
        out->deepest = depth;
        to->depth = i + 1 < out->count ? (depth += from->thickness_mm) : (double) INFINITY;
        if (i > 0 && fabs(from->medium.eta - out->eta) > 1e-3)
            pell_warn(ctx, m->name, NULL, "the index of layer %s, %g, is taken for %g, the first layer's: %s refracts at the surface alone",
                      from->name, from->medium.eta, out->eta, method);
    }
}

/* Strength scales all lengths of the medium, including the layers' depths, as diffusion methods scale the radii of their profiles. */
static void scale_lengths(struct pell_medium_layers *out, float strength)
{
    const double s = fmin(fmax((double) strength, 1.0 / 1024.0), 1.0);

    out->deepest *= s;
    for (int i = 0; i < out->count; i++) {
        out->item[i].depth *= s;
        for (int c = 0; c < 3; c++) {
            out->item[i].sigma_s[c] /= s;
            out->item[i].sigma_t[c] /= s;
        }
    }
}

bool pell_medium_layers_known(const struct pell_material *m)
{
    return m->num_layers > 0 || pell_scene_layers_preset(m) || !(m->profile || m->gaussians.count > 0);
}

enum pell_result pell_medium_layers_make(struct pell_context *ctx, const char *method, const struct pell_material *m,
                                         struct pell_medium_layers *out)
{
    const struct pell_material_entry *stack = pell_scene_layers_preset(m);

    memset(out, 0, sizeof(*out));
    if (m->num_layers > 0 || stack) {
        if (m->num_layers > 0)
            take_layers(m, out);
        else
            take_stack(ctx, method, m, &stack->layers, out);
        scale_lengths(out, m->strength);
        return PELL_OK;
    }
    if (!pell_medium_layers_known(m))
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, m->name,
                          "give it a medium: coefficients, layers, or a built-in material that has them (for skin: skin1, skin-2layer)",
                          "has a profile but no medium: %s needs scattering coefficients", method);
    out->eta = m->medium.eta;
    out->count = 1;
    out->substrate = PELL_SUBSTRATE_LAST;
    out->item[0].name = "";
    out->item[0].depth = (double) INFINITY;
    set_medium(&m->medium, &out->item[0]);
    for (int c = 0; c < 3; c++)
        out->item[0].phase[c] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { m->medium.g[c], 0.0 }, 0.0 };
    scale_lengths(out, m->strength);
    return PELL_OK;
}

/* --- At a point ------------------------------------------------------------------------------------------------------------------ */

void pell_medium_layers_depths(const struct pell_medium_layers *s, const struct pell_mesh *mesh, uint32_t triangle, float u, float v,
                               float *depth)
{
    const uint32_t *index = mesh->index + 3 * (size_t) triangle;
    const struct pell_texture_map *last = NULL;
    float rgba[4] = { 0 }, above = 0.0f;

    for (int i = 0; i < s->count; i++) {
        const struct pell_layer_medium *layer = &s->item[i];
        float d = (float) layer->depth;
        if (layer->map) {
            const float *uv = mesh->uv[layer->map->uv];
            if (!last /* several channels of one texture: one lookup */ || !pell_layer_maps_alike(last, layer->map)) {
                for (int c = 0; c < 4; c++)
                    rgba[c] = 1.0f;
                if (uv) {
                    const float *a = uv + 2 * (size_t) index[0], *b = uv + 2 * (size_t) index[1], *c = uv + 2 * (size_t) index[2];
                    const float w = 1.0f - u - v;
                    pell_layer_texel(layer->map, w * a[0] + u * b[0] + v * c[0], w * a[1] + u * b[1] + v * c[1], rgba);
                }
                last = layer->map;
            }
            d *= pell_layer_depth_fraction(rgba[layer->map->channel], layer->inverse);
        }
        depth[i] = above = d > above ? d : above;
    }
}
