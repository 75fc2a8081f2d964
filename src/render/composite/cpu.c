/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. */
#include "render/composite/kernel.h"

#include "render/layers.h"
#include "scene/material_maps.h"

#include <string.h>

#define ROWS 4 /* rows of one task */

struct pell_compositor {
    struct pell_context *ctx;
    const struct pell_composite_kernels *kernels;
    struct pell_composite_material *materials;
    size_t num_materials;
};

struct task {
    const struct pell_compositor *c;
    const struct pell_composite_params *p;
    const struct pell_accumulator *out;
    float *const *shaded;
    struct pell_composite_row row; /* y is not set */
};

enum pell_result pell_compositor_create(struct pell_context *ctx, size_t num_materials, struct pell_compositor **out)
{
    struct pell_compositor *c = *out = pell_zalloc(ctx, sizeof(*c));

    if (!c)
        return PELL_ERR_NOMEM;
    c->ctx = ctx;
    c->kernels = pell_composite_kernels_tables[pell_simd_best()];
    c->num_materials = num_materials;
    c->materials = pell_calloc(ctx, num_materials, sizeof(*c->materials));
    if (c->materials)
        return PELL_OK;
    pell_compositor_destroy(out);
    return PELL_ERR_NOMEM;
}

void pell_compositor_destroy(struct pell_compositor **compositor)
{
    struct pell_compositor *c = *compositor;
    if (!c)
        return;
    *compositor = NULL;
    pell_free(c->ctx, c->materials);
    pell_free(c->ctx, c);
}

static void fill_materials(struct pell_compositor *c, const struct pell_composite_params *p, struct pell_composite_row *row)
{
    const struct pell_specular_tables *t = p->tables;

    for (size_t i = 0; i < c->num_materials; i++) {
        const struct pell_material *m = &p->scene->materials[i];
        const struct pell_boundary_table *boundary = &t->boundaries[t->boundary[i]];
        const bool texture = m->color_from == PELL_COLOR_FROM_TEXTURE;
        const float mix = p->mix >= 0.0f ? p->mix : m->mix;
        struct pell_composite_material *out = &c->materials[i];

        *out = (struct pell_composite_material) {
            .f0 = boundary->f0,
            .boundary_mean = boundary->mean,
            .boundary = boundary->transmittance,
            .model = t->model[i],
            .smooth = p->smooth && !m->opaque,
            .out_exponent = !m->opaque && texture ? 1.0f - mix : 0.0f,
            .in_exponent = m->opaque ? 1.0f
                           : texture ? mix
                                     : 0.0f,
            .in_metal = m->opaque ? 1.0f : 0.0f,
            .scatters = p->exitance && !m->opaque ? 1.0f : 0.0f,
            .thin = pell_material_is_thin(m) ? 1.0f : 0.0f,
        };
        out->inverse_eta2 = p->angle && !m->opaque ? p->angle[i].inverse_eta2 : 1.0f;
        for (int k = 0; k < 3; k++) {
            out->total[k] = m->opaque ? 1.0f : p->total[i][k];
            out->exit_base[k] = p->angle && !m->opaque ? p->angle[i].exit_base[k] : 1.0f;
            out->exit_slope[k] = p->angle && !m->opaque ? p->angle[i].exit_slope[k] : 0.0f;
            out->metered[k] = p->angle && !m->opaque ? pell_meter_fraction(p->angle[i].enter_mean[k], p->diffuse) : 1.0f;
        }
        out->uniform = pell_surface_is_uniform(m);
        if (out->uniform) {
            const struct pell_surface_uniform uniform = pell_surface_uniform(m);
            out->roughness = uniform.roughness;
            out->rho_s = (uniform.specular[0] + uniform.specular[1] + uniform.specular[2]) * (1.0f / 3.0f);
        }
        row->any_smooth = row->any_smooth || out->smooth;
        row->any_texture = row->any_texture || out->out_exponent > 0.0f || out->in_exponent > 0.0f;
        row->any_power = row->any_power || (mix > 0.0f && mix < 1.0f && mix != 0.5f);
    }
}

/* Adds values to a plane, or writes them, if the plane was requested. */
static void put(float *plane, size_t at, int count, const float *values, float weight, bool first)
{
    if (plane)
        pell_composite_put(values, weight, first, count, plane + at);
}

static void clear(const struct pell_accumulator *out, size_t at, int count)
{
    for (size_t k = 0; k < PELL_OUTPUT_LAYERS; k++) {
        float *const *planes = pell_output_layer_planes(out, &pell_output_layers[k]);
        for (int c = 0; c < pell_output_layers[k].components; c++)
            if (planes[c])
                memset(planes[c] + at, 0, (size_t) count * sizeof(float));
    }
}

/* The translucent fraction, and the noise. Noise is known for the exitance; its visible part is scaled like the light itself. Samples
 * are independent, so the variance of their mean is the sum of theirs, each times its squared weight. */
static void put_noise(const struct task *t, size_t at, int count, const struct pell_composite_lanes *l)
{
    const struct pell_composite_params *p = t->p;
    const uint16_t *material = p->surface->material + at;
    float translucent[LANES] = { 0 }, values[LANES] = { 0 };

    for (int i = 0; i < count; i++)
        translucent[i] = l->on[i] > 0.0f && !p->scene->materials[material[i] - 1].opaque ? 1.0f : 0.0f;
    put(t->out->translucent, at, count, translucent, p->weight, p->first);
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < count; i++) {
            const float light = p->exitance ? p->exitance[c][at + (size_t) i] : 0.0f;
            const float scale = p->radiance ? 1.0f : light > 0.0f ? l->multiple[c][i] / light : 0.0f;
            const float error = p->standard_error && translucent[i] > 0.0f ? scale * p->standard_error[c][at + (size_t) i] : 0.0f;
            values[i] = error * error;
        }
        put(t->out->variance[c], at, count, values, p->weight * p->weight, p->first);
    }
}

/* Albedo of a surface: the colour of a medium's profile, and of textures where they apply. */
static float albedo_of(const struct task *t, int c, size_t at)
{
    const struct pell_composite_material *m = &t->c->materials[t->p->surface->material[at] - 1];
    const bool plain = m->in_metal == 0.0f && m->out_exponent + m->in_exponent == 0.0f; /* `base` may be unwritten */

    return m->total[c] * (plain ? 1.0f : t->p->surface->base[c][at]);
}

/* All light that enters. */
static float irradiance_at(const struct pell_lighting *l, int c, size_t at)
{
    return l->irradiance[c][at] + (l->entered[c] ? l->entered[c][at] : 0.0f);
}

/* Copies planes of the frame to layers, masked by coverage. */
static void put_layers(const struct task *t, size_t at, int count, const struct pell_composite_lanes *l)
{
    const struct pell_composite_params *p = t->p;
    float masked[LANES];

    for (int c = 0; c < 3; c++) {
        put(t->out->multiple[c], at, count, l->multiple[c], p->weight, p->first);
        put(t->out->transmission[c], at, count, l->transmission[c], p->weight, p->first);
        put(t->out->specular[c], at, count, l->specular[c], p->weight, p->first);
        for (int i = 0; i < count; i++)
            masked[i] = l->on[i] > 0.0f ? irradiance_at(p->lighting, c, at + (size_t) i) : 0.0f;
        put(t->out->irradiance[c], at, count, masked, p->weight, p->first);
        for (int i = 0; i < count; i++)
            masked[i] = l->on[i] > 0.0f ? p->surface->ns[c][at + (size_t) i] : 0.0f;
        put(t->out->normal[c], at, count, masked, p->weight, p->first);
        for (int i = 0; i < count; i++)
            masked[i] = l->on[i] > 0.0f ? albedo_of(t, c, at + (size_t) i) : 0.0f;
        put(t->out->albedo[c], at, count, masked, p->weight, p->first);
    }
    for (int i = 0; t->out->depth && i < count; i++) {
        float *depth = &t->out->depth[at + (size_t) i];
        if (p->first || *depth == 0.0f)
            *depth = l->on[i] > 0.0f ? p->surface->depth[at + (size_t) i] : 0.0f;
    }
}

/* Adds separately computed light: reflection to the specular part, single scattering to `single`, unscattered light to the transmitted
 * part. */
static void take_parts(const struct task *t, size_t at, int count, struct pell_composite_lanes *l, float single[3][LANES])
{
    const struct pell_composite_params *p = t->p;
    const uint16_t *material = p->surface->material + at;

    for (int i = 0; i < count; i++) {
        if (!(l->on[i] > 0.0f) || !(t->c->materials[material[i] - 1].scatters > 0.0f))
            continue;
        for (int c = 0; c < 3; c++) {
            if (p->reflected)
                l->specular[c][i] += p->reflected[c][at + (size_t) i];
            if (p->single)
                single[c][i] = p->single[c][at + (size_t) i];
            if (p->unscattered)
                l->transmission[c][i] += p->unscattered[c][at + (size_t) i];
        }
    }
}

/* Prefetches the data that a block of pixels at `at` reads and writes. Rows are too short for hardware prefetching of their next lines. */
PELL_FETCHING_INLINE void fetch(const struct task *t, size_t at)
{
    const struct pell_composite_params *p = t->p;

    __builtin_prefetch(p->surface->material + at);
    for (int c = 0; c < 3; c++) {
        __builtin_prefetch(p->surface->ns[c] + at);
        __builtin_prefetch(p->lighting->irradiance[c] + at);
        __builtin_prefetch(p->lighting->transmitted[c] + at);
        __builtin_prefetch(p->lighting->specular[c] + at);
        if (p->exitance)
            __builtin_prefetch(p->exitance[c] + at);
        pell_fetch_to_write(t->out->color[c] + at);
    }
    pell_fetch_to_write(t->out->alpha + at);
}

static PELL_FETCHING void composite_rows(void *arg, int band, int worker)
{
    const struct task *t = arg;
    const struct pell_composite_params *p = t->p;
    const struct pell_surface *s = p->surface;
    const struct pell_accumulator *out = t->out;
    const struct pell_rect r = p->rect;
    struct pell_composite_row row = t->row;
    struct pell_composite_cut cut = { 0 };
    (void) worker;

    for (int y = r.y0 + band * ROWS; y < r.y1 && y < r.y0 + (band + 1) * ROWS; y++) {
        struct pell_composite_meter meter = { { 0 }, { 0 } };
        double arriving = 0.0, covered = 0.0;
        row.y = y;
        for (int x = r.x0 / LANES * LANES; x < r.x1; x += LANES) {
            const size_t at = (size_t) ((ptrdiff_t) y * s->stride + x);
            const int count = s->width - x < LANES ? s->width - x : LANES;
            float *const color[] = { out->color[0] + at, out->color[1] + at, out->color[2] + at };
            struct pell_composite_lanes l;
            float single[3][LANES] = { { 0 } };

            if (!t->c->kernels->shade(&row, x, &cut, &l)) {
                if (p->first)
                    clear(out, at, count);
                continue;
            }
            if (y + 1 < r.y1)
                fetch(t, at + (size_t) s->stride);
            if (p->single || p->reflected || p->unscattered)
                take_parts(t, at, count, &l, single);
            for (int c = 0; c < 3; c++)
                put(out->single[c], at, count, single[c], p->weight, p->first);
            t->c->kernels->add(&l, (const float(*)[LANES]) single, p->weight, p->first, count, color, out->alpha + at, &meter);
            if (out->multiple[0])
                put_layers(t, at, count, &l);
            if (out->variance[0])
                put_noise(t, at, count, &l);
        }
        for (int i = 0; i < LANES; i++) {
            arriving += meter.arriving[i];
            covered += meter.covered[i];
        }
        out->meter[2 * y] = arriving + (p->first ? 0.0 : out->meter[2 * y]);
        out->meter[2 * y + 1] = covered + (p->first ? 0.0 : out->meter[2 * y + 1]);
    }
}

static void shade_rows(void *arg, int band, int worker)
{
    const struct task *t = arg;
    const struct pell_surface *s = t->p->surface;
    const struct pell_rect r = s->translucent;
    struct pell_composite_row row = t->row;
    struct pell_composite_cut cut = { 0 };
    (void) worker;

    for (int y = r.y0 + band * ROWS; y < r.y1 && y < r.y0 + (band + 1) * ROWS; y++) {
        row.y = y;
        for (int x = r.x0 / LANES * LANES; x < r.x1; x += LANES) {
            const size_t at = (size_t) ((ptrdiff_t) y * s->stride + x);
            const int count = s->width - x < LANES ? s->width - x : LANES;
            struct pell_composite_lanes l;

            if (!t->c->kernels->shade(&row, x, &cut, &l))
                continue;
            for (int c = 0; c < 3; c++)
                for (int i = 0; i < count; i++)
                    t->shaded[c][at + (size_t) i] = l.multiple[c][i] + l.specular[c][i];
        }
    }
}

static struct task make_task(struct pell_compositor *c, const struct pell_composite_params *params)
{
    struct task t = { .c = c, .p = params };

    t.row = (struct pell_composite_row) {
        .p = params,
        .materials = c->materials,
        .albedo = &params->tables->albedo[0][0][0][0],
        .mean = &params->tables->mean[0][0][0],
    };
    fill_materials(c, params, &t.row);
    return t;
}

void pell_composite_render(struct pell_pool *pool, struct pell_compositor *c, const struct pell_composite_params *params,
                           const struct pell_accumulator *out)
{
    struct task t = make_task(c, params);
    t.out = out;
    if (params->rect.y1 > params->rect.y0)
        pell_pool_run(pool, (params->rect.y1 - params->rect.y0 + ROWS - 1) / ROWS, composite_rows, &t);
}

void pell_composite_shaded(struct pell_pool *pool, struct pell_compositor *c, const struct pell_composite_params *params,
                           float *const shaded[3])
{
    struct task t = make_task(c, params);
    const struct pell_rect r = params->surface->translucent;
    t.shaded = shaded;
    if (r.y1 > r.y0)
        pell_pool_run(pool, (r.y1 - r.y0 + ROWS - 1) / ROWS, shade_rows, &t);
}
