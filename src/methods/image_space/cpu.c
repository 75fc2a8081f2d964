/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the image-space method on the cpu engine: tables, irradiance images, passes. The inner loops are in kernels.c.
 */
#include "methods/image_space/image_space.h"

#include "base/simd.h"
#include "math/vec.h"
#include "methods/thickness.h"
#include "render/engine.h"
#include "render/material_id.h"

#include <string.h>

PELL_SIMD_TABLES(struct is_kernels, pell_is_kernels);

enum { BAND = 4, PLANES = 11 };
#define MOST_PIXELS ((size_t) 1 << 28) /* an index of a texel's float is an int */

struct is_state {
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct is_kernels *kernels;
    struct is_knobs knobs;
    struct is_set *sets;
    size_t num_sets;
    struct pell_solids *solids;             /* for views of lights, or NULL */
    struct pell_thickness_table *thickness; /* of each material, or NULL */
    struct is_light_view light_views[IS_VIEWS_MOST];
    struct is_view views[IS_VIEWS_MOST];
    float *memory, *texels;
    int32_t *solid;
    int64_t *counts; /* of bands */
    struct is_work work;
    void (*row)(const struct is_work *w, int y); /* what the running pass does; NULL: gather */
    struct pell_pass_time times[4];
    size_t num_times;
};

/* --- Life ---------------------------------------------------------------------------------------------------------------------- */

static void is_destroy(void *state)
{
    struct is_state *st = state;

    if (!st)
        return;
    for (size_t i = 0; st->sets && i < st->num_sets; i++)
        if (st->sets[i].owned) {
            pell_free(st->ctx, st->sets[i].offset);
            pell_free(st->ctx, st->sets[i].rows);
            pell_free(st->ctx, st->sets[i].level);
        }
    for (int i = 0; i < IS_VIEWS_MOST; i++)
        pell_free(st->ctx, st->light_views[i].texels);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st->thickness);
    pell_free(st->ctx, st->sets);
    pell_free(st->ctx, st->counts);
    pell_free(st->ctx, st->solid);
    pell_free(st->ctx, st->texels);
    pell_free(st->ctx, st->memory);
    pell_free(st->ctx, st);
}

/* The dipole of a material's coefficients, where the method is to use it and there are any. */
static enum pell_result published_profile(const struct is_state *st, const struct pell_frame_material *m, struct pell_profile *out,
                                          struct pell_frame_material *with)
{
    bool scatters = m->gaussians.count == 0 && pell_medium_valid(&m->medium, NULL);

    *with = *m;
    for (int c = 0; c < 3; c++)
        scatters = scatters && m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c] > 0.0;
    if (st->knobs.profile != IS_PROFILE_DIPOLE || !scatters)
        return PELL_OK;
    for (int c = 0; c < 3; c++) {
        const enum pell_result res = pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, c, NULL, &out[c]);
        if (res != PELL_OK)
            return pell_error(st->ctx, res, m->name, NULL, "has no dipole");
    }
    with->profile = out;
    return PELL_OK;
}

static bool same_set(const struct pell_frame_material *a, const struct pell_frame_material *b)
{
    return a->profile == b->profile && a->white == b->white && (a->gaussians.count == 0) == (b->gaussians.count == 0) &&
           memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0;
}

static enum pell_result make_set(struct is_state *st, const struct pell_frame_shape *shape, size_t i, struct pell_profile *dipole)
{
    const struct pell_frame_material *m = &shape->materials[i];
    const double most = 0.5 * (double) shape->object_height;
    struct pell_frame_material with;
    double reach;
    enum pell_result res;

    for (size_t k = 0; k < i; k++)
        if (same_set(&shape->materials[k], m)) {
            st->sets[i] = st->sets[k];
            st->sets[i].owned = false;
            return PELL_OK;
        }
    PELL_TRY(published_profile(st, m, dipole, &with));
    reach = is_reach(&with);
    if (most > 0.0 && reach > most && is_uniform_samples(&st->knobs) > 0)
        pell_warn(st->ctx, m->name, "few samples find light from farther away: use more samples, or hierarchical",
                  "its light spreads %.3g mm, further than half the object: uniform samples are limited to %.3g mm", reach, most);
    return is_set_make(st->ctx, &with, &st->knobs, most > 0.0 ? fmin(most, 1e15) : 1e15, &st->sets[i]);

fail:
    return res;
}

static enum pell_result make_sets(struct is_state *st, const struct pell_frame_shape *shape)
{
    struct pell_profile *dipole = pell_calloc(st->ctx, 3, sizeof(*dipole));
    enum pell_result res = PELL_ERR_NOMEM;

    st->sets = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->sets));
    if (!dipole || !st->sets)
        goto fail;
    st->num_sets = shape->num_materials;
    for (size_t i = 0; i < shape->num_materials; i++)
        PELL_TRY(make_set(st, shape, i, dipole));
    res = PELL_OK;

fail:
    pell_free(st->ctx, dipole);
    return res;
}

/* What the profile of a channel has beyond the radius d: Int R(sqrt(r^2 + d^2)) over the plane at the depth d. */
static double beyond(const void *material, int channel, double d)
{
    const struct pell_frame_material *m = material;
    const struct pell_profile *p = &m->profile[channel];

    return (m->white ? 1.0 : pell_profile_total(p)) * (1.0 - pell_profile_cdf(p, d));
}

static enum pell_result make_thickness(struct is_state *st, const struct pell_frame_shape *shape)
{
    const int through = is_through_of(&st->knobs);

    if (through == IS_THROUGH_OFF)
        return PELL_OK;
    st->thickness = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->thickness));
    if (!st->thickness)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < shape->num_materials; i++) {
        const struct pell_frame_material *m = &shape->materials[i];
        const size_t first = pell_first_alike(shape, i);
        if (first < i)
            st->thickness[i] = st->thickness[first];
        else
            pell_thickness_table_make(m, beyond, m, through == IS_THROUGH_SLAB, 1.0, &st->thickness[i]);
    }
    return PELL_OK;
}

static enum pell_result make_planes(struct is_state *st, const struct pell_frame_shape *shape)
{
    struct is_work *w = &st->work;
    const size_t stride = ((size_t) shape->width + IS_BLOCK - 1) / IS_BLOCK * IS_BLOCK + 2 * IS_MARGIN;
    const size_t size = stride * ((size_t) shape->height + 2 * IS_MARGIN) + 48;
    float **const planes[PLANES] = { &w->key,      &w->w,        &w->gu,       &w->gv,       &w->flat,    &w->alpha[0],
                                     &w->alpha[1], &w->alpha[2], &w->light[0], &w->light[1], &w->light[2] };

    w->stride = (ptrdiff_t) stride;
    w->texel_stride = shape->width;
    st->memory = pell_calloc(st->ctx, size, PLANES * sizeof(float));
    st->texels = pell_calloc(st->ctx, (size_t) shape->width * (size_t) shape->height, IS_TEXEL * sizeof(float));
    st->counts = pell_calloc(st->ctx, (size_t) shape->height / BAND + 2, sizeof(*st->counts));
    if (!st->memory || !st->texels || !st->counts)
        return PELL_ERR_NOMEM;
    if (st->solids) {
        st->solid = pell_calloc(st->ctx, (size_t) shape->width * (size_t) shape->height, sizeof(*st->solid));
        if (!st->solid)
            return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < PLANES; i++)
        *planes[i] = st->memory + i * size + IS_MARGIN * stride + IS_MARGIN;
    for (size_t i = 0; i < size; i++)
        st->memory[size + i] = 1.0f; /* w is divided by, where there is nothing, too */
    w->texels = st->texels;
    w->solid = st->solid;
    return PELL_OK;
}

static enum pell_result is_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                  void **state)
{
    struct pell_context *ctx = services->ctx;
    struct is_state *st = pell_zalloc(ctx, sizeof(*st));
    const struct is_knobs *k = knobs;
    enum pell_result res;
    struct is_work *w;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    st->pool = services->pool;
    st->kernels = pell_is_kernels_tables[pell_simd_best()];
    st->knobs = *k;
    if ((size_t) shape->width * (size_t) shape->height > MOST_PIXELS)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, "image-space", NULL, "%d x %d pixels, at most %zu in all", shape->width, shape->height,
                          MOST_PIXELS);
    w = &st->work;
    w->samples = k->samples;
    w->importance = is_importance_samples(k);
    w->first_kind = k->sampling == IS_SEPARATE && w->importance > 0 ? w->importance : k->samples;
    w->tile = is_tile_side(k);
    w->jacobian = k->jacobian || k->misprint == IS_MISPRINT_JACOBIAN;
    w->inverted = k->misprint == IS_MISPRINT_JACOBIAN;
    w->reconstruct = k->reconstruct && w->tile > 1;
    w->renormalise = k->renormalise;
    if (w->renormalise == IS_AS_VIEWS_ASK)
        w->renormalise = k->views == IS_VIEWS_LIGHTS ? IS_NEVER : IS_BY_WEIGHT;
    w->factor = k->misprint == IS_MISPRINT_TWO_PI ? (float) (0.5 / PELL_PI) : 1.0f;
    w->focal_px = shape->focal_px;
    PELL_TRY(make_sets(st, shape));
    w->sets = st->sets;
    PELL_TRY(make_thickness(st, shape));
    if (k->views == IS_VIEWS_LIGHTS) {
        PELL_TRY(pell_services_solids(services, &st->solids));
        PELL_TRY(is_light_views_make(services, st->solids, k->view_size, st->light_views, &w->num_views));
        w->views = st->views;
    }
    return make_planes(st, shape);

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

static void find_solids(const struct is_state *st, int y)
{
    const struct pell_frame *in = st->work.in;
    ptrdiff_t at[16];
    int32_t found[16];
    int count = 0;

    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        if (pell_material_id(in, y * in->shape.stride + x))
            at[count++] = y * in->shape.stride + x;
        if (count == 0 || (count < 16 && x + 1 < in->rect.x1))
            continue;
        pell_solids_find(st->solids, st->services->rays, in, at, count, found);
        for (int i = 0; i < count; i++)
            st->solid[y * st->work.texel_stride + at[i] - y * in->shape.stride] = found[i] + 1;
        count = 0;
    }
}

static void run_rows(void *arg, int index, int worker)
{
    struct is_state *st = arg;
    const struct is_work *w = &st->work;
    const struct pell_rect *rect = &w->in->rect;
    const int y0 = rect->y0 + index * BAND, y1 = y0 + BAND < rect->y1 ? y0 + BAND : rect->y1;

    (void) worker;
    for (int y = y0; y < y1; y++) {
        if (st->row == st->kernels->load) {
            memset(w->key + y * w->stride + rect->x0 - IS_MARGIN, 0, IS_MARGIN * sizeof(float));
            memset(w->key + y * w->stride + rect->x1, 0, IS_MARGIN * sizeof(float));
            if (st->solids)
                find_solids(st, y);
        }
        if (st->row)
            st->row(w, y);
        else if (!pell_cancelled(st->ctx))
            st->counts[index] += st->kernels->gather(w, y);
    }
}

static void pass(struct is_state *st, void (*row)(const struct is_work *w, int y))
{
    const struct pell_rect *rect = &st->work.in->rect;

    st->row = row;
    pell_pool_run(st->pool, (rect->y1 - rect->y0 + BAND - 1) / BAND, run_rows, st);
}

static void note_time(struct is_state *st, const char *name, double *from, int64_t pixels, int64_t bytes)
{
    const double now = pell_seconds();

    st->times[st->num_times++] = (struct pell_pass_time) { .name = name, .seconds = now - *from, .pixels = pixels, .bytes = bytes };
    *from = now;
}

/* Where in their pixels the rays of this frame go through: positions tell. */
static void find_shift(struct is_state *st, const struct pell_view *camera)
{
    const struct pell_frame *in = st->work.in;

    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t i = y * in->shape.stride + x;
            struct pell_vec3 p;
            float scale;
            if (!pell_material_id(in, i))
                continue;
            p = vec3_sub(vec3(in->position[0][i], in->position[1][i], in->position[2][i]), camera->origin);
            scale = in->shape.orthographic ? in->shape.focal_px : in->shape.focal_px / in->depth[i];
            st->work.mid_x = (float) x + 0.5f - vec3_dot(p, camera->right) * scale;
            st->work.mid_y = (float) y + 0.5f + vec3_dot(p, camera->up) * scale;
            return;
        }
}

/* The views of lights in this frame's camera coordinates. */
static void turn_views(struct is_state *st, const struct pell_frame *in)
{
    const struct pell_view camera = *in->view;
    const struct pell_vec3 from[3] = { camera.right, vec3_mul(camera.up, -1.0f), camera.forward };

    find_shift(st, &camera);
    for (int i = 0; i < st->work.num_views; i++) {
        const struct pell_view *v = &st->light_views[i].view;
        const struct pell_vec3 to[3] = { v->right, vec3_mul(v->up, -1.0f), v->forward };
        struct is_view *out = &st->views[i];
        *out = (struct is_view) {
            .texels = st->light_views[i].texels,
            .size = v->width,
            .orthographic = v->orthographic,
            .focal_px = v->focal_px,
            .centre_px = 0.5f * (float) v->width - 0.5f,
        };
        for (int k = 0; k < 3; k++) {
            for (int j = 0; j < 3; j++)
                out->rotate[k][j] = vec3_dot(to[k], from[j]);
            out->shift[k] = vec3_dot(to[k], vec3_sub(camera.origin, v->origin));
        }
    }
}

static enum pell_result is_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct is_state *st = state;
    struct is_work *w = &st->work;
    struct pell_frame frame = *in;
    const size_t width = ((size_t) (in->rect.x1 - in->rect.x0) + 2 * IS_MARGIN) * sizeof(float);
    const int bands = (in->rect.y1 - in->rect.y0 + BAND - 1) / BAND;
    double clock = pell_seconds();
    int64_t pixels = 0;
    enum pell_result res = PELL_OK;

    st->num_times = 0;
    if (!st->knobs.strength)
        frame.strength = NULL;
    if (!frame.base[1] || !frame.base[2])
        frame.base[0] = NULL;
    w->in = &frame;
    w->out = out;
    w->mid_x = 0.5f * (float) in->shape.width;
    w->mid_y = 0.5f * (float) in->shape.height;
    if (st->solids)
        turn_views(st, in);
    if (pell_services_observed(st->services, in))
        res = is_show_samples(st->services, &st->knobs, st->sets, st->num_sets);
    for (int i = 0; i < w->num_views && res == PELL_OK && pell_services_observed(st->services, in); i++)
        res = is_show_view(st->services, &st->light_views[i], i + 1);
    if (res != PELL_OK)
        return res;
    memset(st->counts, 0, (size_t) bands * sizeof(*st->counts));
    for (int i = 1; i <= IS_MARGIN; i++) {
        memset(w->key + (in->rect.y0 - i) * w->stride + in->rect.x0 - IS_MARGIN, 0, width);
        memset(w->key + (in->rect.y1 - 1 + i) * w->stride + in->rect.x0 - IS_MARGIN, 0, width);
    }
    pass(st, st->kernels->load);
    pass(st, st->kernels->measure);
    note_time(st, "load", &clock, 0, 0);
    pass(st, NULL);
    for (int i = 0; i < bands; i++)
        pixels += st->counts[i];
    st->times[0].pixels = pixels;
    st->times[0].bytes = pixels * (18 + 16 + IS_TEXEL * 4);
    note_time(st, "sample", &clock, pixels, pixels * (IS_TEXEL * 4 + 12));
    if (w->reconstruct) {
        pass(st, st->kernels->rebuild);
        note_time(st, "reconstruct", &clock, pixels, pixels * 52);
    }
    w->in = NULL;
    w->out = NULL;
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static size_t is_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct is_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        list[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

static const struct pell_thickness_table *is_thickness(const void *state, size_t material)
{
    const struct is_state *st = state;

    return st->thickness && material < st->num_sets ? &st->thickness[material] : NULL;
}

const struct pell_method_engine pell_is_cpu = {
    .create = is_create,
    .record = is_render,
    .destroy = is_destroy,
    .thickness = is_thickness,
    .times = is_times,
};
