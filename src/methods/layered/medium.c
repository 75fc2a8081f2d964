/* SPDX-License-Identifier: MIT
 * medium.c - see layered.h: coefficients in single precision, phase functions in the form the kernels evaluate, depth maps as packs. */
#include "methods/layered/layered.h"

#include "base/base.h"
#include "math/vec.h"
#include "scene/layers.h"
#include "scene/material_maps.h"
#include "shared/color_share.h"

#include <math.h>
#include <string.h>

#define OPAQUE_DEPTH 14.0f /* optical depth where a march without a bottom ends: e^-14 */
#define BLACK 1e4f         /* 1/mm */
#define PATH_PER_DEPTH 2.2 /* mm of path, down and back up, per mm of depth */
#define EQUAL_FRACTION 0.1 /* fraction of the steps that have equal length */
#define NEAR_FRACTION 0.5  /* for a march that ends at another surface: fraction of the steps placed for light from the near surface, */
#define FAR_FRACTION 0.2   /* and for light from the far one */

enum { DENSITY_CELLS = 4096 }; /* resolution of the density of steps */

/* --- Phase functions ------------------------------------------------------------------------------------------------------------ */

static void set_lobe(double g, double weight, struct pell_phase_terms *out, int k)
{
    out->n[k] = (float) (weight * (1.0 - g * g) / (4.0 * PELL_PI));
    out->a[k] = (float) (1.0 + g * g);
    out->b[k] = (float) (2.0 * g);
}

static void set_phase(const struct pell_phase *from, struct pell_phase_terms *out)
{
    const double uniform = 1.0 / (4.0 * PELL_PI);

    memset(out, 0, sizeof(*out));
    switch (from->kind) {
    case PELL_PHASE_SCHLICK:
        out->shape = PELL_PHASE_TERMS_SCHLICK;
        out->n[0] = (float) ((1.0 - from->g[0] * from->g[0]) * uniform);
        out->b[0] = (float) from->g[0];
        break;
    case PELL_PHASE_RAYLEIGH:
        out->shape = PELL_PHASE_TERMS_RAYLEIGH;
        out->n[0] = (float) (0.75 * uniform);
        break;
    case PELL_PHASE_TWO_LOBE:
        out->shape = PELL_PHASE_TERMS_TWO_LOBE;
        set_lobe(from->g[0], from->weight, out, 0);
        set_lobe(from->g[1], 1.0 - from->weight, out, 1);
        break;
    default:
        out->shape = PELL_PHASE_TERMS_HENYEY_GREENSTEIN;
        set_lobe(from->g[0], 1.0, out, 0);
        break;
    }
    if (out->shape != PELL_PHASE_TERMS_RAYLEIGH && out->shape != PELL_PHASE_TERMS_TWO_LOBE && from->g[0] == 0.0) {
        out->shape = PELL_PHASE_TERMS_ISOTROPIC;
        out->n[0] = (float) uniform;
    }
}

/* --- Packs ---------------------------------------------------------------------------------------------------------------------- */

static bool same_look_up(const struct pell_texture_map *a, const struct pell_texture_map *b)
{
    const struct pell_texture *s = a->texture, *t = b->texture;

    return a->uv == b->uv && memcmp(a->matrix, b->matrix, sizeof(a->matrix)) == 0 && s->wrap_u == t->wrap_u && s->wrap_v == t->wrap_v &&
           s->nearest == t->nearest && s->image.width == t->image.width && s->image.height == t->image.height;
}

/* Finds or creates the pack for layer i. */
static void choose_pack(struct layered_medium *m, const struct pell_texture_map *map, int i)
{
    struct layered_pack *p = NULL;

    for (int k = 0; k < m->packs && !p; k++)
        if (m->pack[k].count < 4 && same_look_up(m->pack[k].map, map))
            p = &m->pack[k];
    if (!p) {
        p = &m->pack[m->packs++];
        p->map = map;
        for (int k = 0; k < 4; k++)
            p->layer[k] = -1;
    }
    m->layer[i].pack = (int) (p - m->pack);
    m->layer[i].channel = p->count;
    p->layer[p->count++] = i;
}

static int wrapped(enum pell_wrap wrap, int i, int size)
{
    if (wrap == PELL_WRAP_REPEAT)
        return i < 0 ? size - 1 : i >= size ? 0 : i;
    return i < 0 ? 0 : i >= size ? size - 1 : i;
}

static void make_border(const struct layered_level *l, const struct pell_texture *t, uint16_t *texels)
{
    for (int y = 0; y < l->height; y++)
        for (int side = 0; side < 2; side++) {
            const int x = side ? l->width : -1, from = wrapped(t->wrap_u, x, l->width);
            memcpy(texels + 4 * (l->offset + (y + 1) * l->stride + x + 1), texels + 4 * (l->offset + (y + 1) * l->stride + from + 1), 8);
        }
    for (int side = 0; side < 2; side++) {
        const int y = side ? l->height : -1, from = wrapped(t->wrap_v, y, l->height);
        memcpy(texels + 4 * (l->offset + (y + 1) * l->stride), texels + 4 * (l->offset + (from + 1) * l->stride), 8 * (size_t) l->stride);
    }
}

/* Builds mip levels: each halves the previous one, odd sizes rounded down; a texel is the mean of the texels that overlap it most. */
static void shrink(const struct layered_level *from, const struct layered_level *to, uint16_t *texels)
{
    for (int y = 0; y < to->height; y++)
        for (int x = 0; x < to->width; x++)
            for (int c = 0; c < 4; c++) {
                unsigned sum = 0;
                for (int k = 0; k < 4; k++) {
                    const int sx = 2 * x + (k & 1), sy = 2 * y + (k >> 1);
                    const int ax = sx < from->width ? sx : from->width - 1, ay = sy < from->height ? sy : from->height - 1;
                    sum += texels[4 * (from->offset + (ay + 1) * from->stride + ax + 1) + c];
                }
                texels[4 * (to->offset + (y + 1) * to->stride + x + 1) + c] = (uint16_t) ((sum + 2) / 4);
            }
}

/* Interleaves each texel with the one below it, signed: see kernels.h. The last row serves only as the lower neighbour. */
static void pair(const struct layered_level *l, const uint16_t *values, uint16_t *texels)
{
    const uint16_t *from = values + 4 * (ptrdiff_t) l->offset;
    uint16_t *to = texels + 8 * (ptrdiff_t) l->offset;

    for (ptrdiff_t i = 0; i < (ptrdiff_t) l->stride * (l->height + 1); i++)
        for (int k = 0; k < 4; k++) {
            to[8 * i + 2 * k] = from[4 * i + k] ^ 0x8000;
            to[8 * i + 2 * k + 1] = from[4 * (i + l->stride) + k] ^ 0x8000;
        }
}

static void read_layer(const struct pell_layer_medium *layer_medium, struct layered_layer *layer, const struct layered_level *l,
                       uint16_t *values)
{
    struct pell_texture_map map = *layer_medium->map;
    const double depth = fmin(layer_medium->depth, (double) PELL_LAYER_DEPTH_MAX);
    float largest = 0.0f;
    double sum = 0.0;

    memcpy(map.matrix, (const float[6]) { 1, 0, 0, 0, 1, 0 }, sizeof(map.matrix));
    for (int pass = 0; pass < 2; pass++)
        for (int y = 0; y < l->height; y++)
            for (int x = 0; x < l->width; x++) {
                float rgba[4] = { 0 }, fraction;
                pell_layer_texel(&map, ((float) x + 0.5f) / (float) l->width, ((float) y + 0.5f) / (float) l->height, rgba);
                fraction = pell_layer_depth_fraction(rgba[map.channel], layer_medium->inverse);
                fraction = fraction < 1e6f ? fraction : 0.0f; /* NaN becomes 0, too */
                if (pass == 0) {
                    largest = fraction > largest ? fraction : largest;
                    sum += (double) fraction;
                } else {
                    values[4 * (l->offset + (y + 1) * l->stride + x + 1) + layer->channel] =
                        (uint16_t) (largest > 0.0f ? fraction / largest * 65535.0f + 0.5f : 0.0f);
                }
            }
    layer->mean = (float) (depth * sum / ((double) l->width * (double) l->height));
    layer->depth = (float) (depth * (double) largest);
    layer->depth_scale = (float) (depth * (double) largest / 65535.0 / 32767.0);
    layer->middle = (float) (depth * (double) largest * 32768.0 / 65535.0);
}

/* The colour of the entering light in place of depths. */
static void read_color(const struct pell_texture_map *from, float mix, const struct layered_level *l, uint16_t *values)
{
    struct pell_texture_map map = *from;

    memcpy(map.matrix, (const float[6]) { 1, 0, 0, 0, 1, 0 }, sizeof(map.matrix));
    for (int y = 0; y < l->height; y++)
        for (int x = 0; x < l->width; x++) {
            float rgba[4] = { 0 };
            pell_layer_texel(&map, ((float) x + 0.5f) / (float) l->width, ((float) y + 0.5f) / (float) l->height, rgba);
            for (int c = 0; c < 3; c++) {
                const float fraction = pell_color_share(rgba[c], mix);
                values[4 * (l->offset + (y + 1) * l->stride + x + 1) + c] =
                    (uint16_t) (fraction > 0.0f ? fminf(fraction, 1.0f) * 65535.0f + 0.5f : 0.0f);
            }
        }
}

/* Fills a pack with depths or, if `medium_layers` is NULL, with the colour of the entering light. */
static enum pell_result make_pack(struct pell_context *ctx, const char *name, const struct pell_medium_layers *medium_layers,
                                  struct layered_medium *m, struct layered_pack *p)
{
    const struct pell_image *image = &p->map->texture->image;
    uint16_t *values;
    int64_t texels = 0;

    if (image->width < 1 || image->height < 1 || (int64_t) image->width * image->height > (int64_t) 1 << 28)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, name, NULL, "layered: the map %s has %d x %d texels, at least one and at most 2^28",
                          p->map->texture->name ? p->map->texture->name : "", image->width, image->height);
    for (int w = image->width, h = image->height;; w = w > 1 ? w / 2 : 1, h = h > 1 ? h / 2 : 1) {
        p->level[p->levels++] = (struct layered_level) { (int32_t) texels, w + 2, w, h };
        texels += (int64_t) (w + 2) * (h + 2);
        if ((w == 1 && h == 1) || p->levels == LAYERED_LEVELS || p->map->texture->nearest)
            break;
    }
    values = pell_calloc(ctx, (size_t) texels, 4 * sizeof(*values));
    p->texels = pell_calloc(ctx, (size_t) texels, 8 * sizeof(*p->texels));
    if (values && p->texels) {
        if (!medium_layers)
            read_color(p->map, m->tint.mix, &p->level[0], values);
        for (int k = 0; medium_layers && k < p->count; k++)
            read_layer(&medium_layers->item[p->layer[k]], &m->layer[p->layer[k]], &p->level[0], values);
        for (int i = 0; i < p->levels; i++) {
            if (i > 0)
                shrink(&p->level[i - 1], &p->level[i], values);
            make_border(&p->level[i], p->map->texture, values);
            pair(&p->level[i], values, p->texels);
        }
    }
    pell_free(ctx, values);
    return values && p->texels ? PELL_OK : PELL_ERR_NOMEM;
}

/* --- Construction --------------------------------------------------------------------------------------------------------------- */

static void set_depths(struct layered_medium *m, bool bottomless)
{
    const struct layered_layer *last = &m->layer[m->count - 1];
    float max_mapped = 0.0f, min_sigma_t = INFINITY, reach;

    for (int i = 0; i < m->count - (bottomless ? 1 : 0); i++)
        max_mapped = fmaxf(max_mapped, m->layer[i].depth);
    m->bottomless = bottomless;
    m->deepest = max_mapped;
    for (int c = 0; c < 3; c++) {
        if (last->sigma_s[c] > 0.0f)
            min_sigma_t = fminf(min_sigma_t, last->sigma_t[c]);
        m->rest[c] = bottomless ? last->sigma_t2[c] : BLACK;
    }
    if (!bottomless)
        return;
    reach = min_sigma_t > 0.0f && min_sigma_t < INFINITY ? OPAQUE_DEPTH / min_sigma_t : min_sigma_t > 0.0f ? 0.0f : LAYERED_FAR;
    m->deepest = fminf(max_mapped + reach, LAYERED_FAR);
}

enum pell_result layered_medium_make(struct pell_context *ctx, const struct pell_medium_layers *medium_layers, const char *name, int under,
                                     struct layered_medium *out)
{
    const int substrate = under == LAYERED_STOP    ? PELL_SUBSTRATE_STOP
                          : under == LAYERED_LAST  ? PELL_SUBSTRATE_LAST
                          : under == LAYERED_COLOR ? PELL_SUBSTRATE_SURFACE_COLOR
                                                   : (int) medium_layers->substrate;
    enum pell_result res = PELL_ERR_NOMEM;

    memset(out, 0, sizeof(*out));
    out->count = medium_layers->count;
    out->eta = (float) medium_layers->eta;
    out->substrate = substrate;
    out->layer = pell_calloc(ctx, (size_t) medium_layers->count, sizeof(*out->layer));
    out->pack = pell_calloc(ctx, (size_t) medium_layers->count + 1, sizeof(*out->pack));
    if (!out->layer || !out->pack)
        goto fail;
    for (int i = 0; i < medium_layers->count; i++) {
        const struct pell_layer_medium *from = &medium_layers->item[i];
        struct layered_layer *to = &out->layer[i];
        to->pack = -1;
        to->depth = to->mean = (float) fmin(from->depth, (double) LAYERED_FAR);
        to->one_phase = true;
        for (int c = 0; c < 3; c++) {
            to->sigma_s[c] = (float) from->sigma_s[c];
            to->sigma_t[c] = (float) from->sigma_t[c];
            to->sigma_t2[c] = (float) (from->sigma_t[c] * 1.4426950408889634);
            to->max_tau2 = fmaxf(to->max_tau2, to->sigma_t2[c]);
            set_phase(&from->phase[c], &to->phase[c]);
            to->one_phase = to->one_phase && memcmp(&to->phase[c], &to->phase[0], sizeof(to->phase[0])) == 0;
        }
        if (from->map && !(i + 1 == medium_layers->count && substrate == PELL_SUBSTRATE_LAST))
            choose_pack(out, from->map, i);
    }
    for (int k = 0; k < out->packs; k++)
        PELL_TRY(make_pack(ctx, name, medium_layers, out, &out->pack[k]));
    if (substrate == PELL_SUBSTRATE_LAST)
        out->layer[out->count - 1].depth = LAYERED_FAR;
    set_depths(out, out->layer[out->count - 1].depth >= LAYERED_FAR);
    out->first = fminf(out->layer[0].sigma_t[0], fminf(out->layer[0].sigma_t[1], out->layer[0].sigma_t[2]));
    return PELL_OK;

fail:
    layered_medium_finish(ctx, out);
    return res;
}

enum pell_result layered_medium_color(struct pell_context *ctx, const struct pell_material *material, struct layered_medium *m)
{
    struct layered_pack *p = &m->pack[m->packs];

    pell_tint_make(material, &m->tint);
    if (!m->tint.enabled || !(m->tint.mix > 0.0f) || !material->base_color_map.texture)
        return PELL_OK;
    m->colors = 1;
    *p = (struct layered_pack) { .map = &material->base_color_map, .layer = { -1, -1, -1, -1 }, .count = 3 };
    return make_pack(ctx, material->name, NULL, m, p);
}

/* Density of steps at the fraction x of the depth. The error of a step grows with the cube of its length and with the light from there,
 * attenuated on the way down and back up; the optimal density is the cube root of that light. */
static double step_density(const struct layered_medium *m, double x)
{
    double above = 0.0, sum = 0.0, tau[3] = { 0.0, 0.0, 0.0 };
    const double z = x * (double) m->deepest;
    int i = 0;

    for (; i + 1 < m->count && z >= fmax((double) m->layer[i].mean, above); i++) {
        const double bottom = fmax((double) m->layer[i].mean, above);
        for (int c = 0; c < 3; c++)
            tau[c] += (double) m->layer[i].sigma_t[c] * (bottom - above);
        above = bottom;
    }
    for (int c = 0; c < 3; c++) {
        const double t = (double) m->layer[i].sigma_t[c];
        sum += exp(-PATH_PER_DEPTH * (tau[c] + t * (z - above)));
    }
    return cbrt(sum / 3.0);
}

/* Divides [0, 1] into `count` intervals of equal integral of a density tabulated over DENSITY_CELLS cells. */
static void set_edges(const double *density, int count, float *edges)
{
    double sum = 0.0, position = 0.0, all = 0.0;
    int cell = 0;

    for (int i = 0; i < DENSITY_CELLS; i++)
        all += density[i];
    for (int i = 0; i <= count; i++) {
        const double target = all * i / count;
        while (cell < DENSITY_CELLS && sum + density[cell] < target)
            sum += density[cell++];
        position = cell < DENSITY_CELLS ? cell + (target - sum) / density[cell] : DENSITY_CELLS;
        edges[i] = (float) fmin(position / DENSITY_CELLS, 1.0);
    }
    edges[count] = 1.0f;
}

enum pell_result layered_medium_steps(struct pell_context *ctx, int count, bool equal, struct layered_medium *m)
{
    double *light_density = pell_alloc_array(ctx, DENSITY_CELLS, sizeof(*light_density)),
           *density = pell_alloc_array(ctx, DENSITY_CELLS, sizeof(*density));
    float *edges = pell_alloc_array(ctx, (size_t) count + 1, (1 + LAYERED_THICKNESSES) * sizeof(*edges));
    enum pell_result res = PELL_ERR_NOMEM;

    m->edges[0] = edges;
    if (!light_density || !density || !edges)
        goto fail;
    for (int k = 0; k <= LAYERED_THICKNESSES; k++) {
        const double thick = k > 0 ? ldexp(1.0, 1 - k) : 1.0, near = k > 0 ? NEAR_FRACTION : 1.0 - EQUAL_FRACTION,
                     far = k > 0 ? FAR_FRACTION : 0.0;
        double mean = 0.0;
        for (int i = 0; i < DENSITY_CELLS; i++)
            mean += (light_density[i] = step_density(m, thick * (i + 0.5) / DENSITY_CELLS)) / DENSITY_CELLS;
        for (int i = 0; i < DENSITY_CELLS; i++)
            density[i] = mean > 0.0 && !equal
                             ? (near * light_density[i] + far * light_density[DENSITY_CELLS - 1 - i]) / mean + (1.0 - near - far)
                             : 1.0;
        m->edges[k] = edges + (size_t) k * ((size_t) count + 1);
        set_edges(density, count, m->edges[k]);
    }
    res = PELL_OK;

fail:
    pell_free(ctx, density);
    pell_free(ctx, light_density);
    return res;
}

void layered_medium_finish(struct pell_context *ctx, struct layered_medium *m)
{
    pell_free(ctx, m->edges[0]);
    for (int k = 0; m->pack && k < m->packs + m->colors; k++)
        pell_free(ctx, m->pack[k].texels);
    pell_free(ctx, m->pack);
    pell_free(ctx, m->layer);
    memset(m, 0, sizeof(*m));
}
