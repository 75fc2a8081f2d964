/* SPDX-License-Identifier: MIT
 *
 * light_map.c - irradiance that enters at each chart texel. If the engine computes direct light on a device, texels are sent in batches of
 * rows, and the same texels then receive the results.
 */
#include "methods/texture_space/state.h"

#include <stdatomic.h>
#include <string.h>

enum step { AT_ONCE, SEND, RECEIVE };

struct lighting {
    struct ts_state *st;
    enum step step;
    int rows, first; /* of a band, a multiple of TS_TILE; the first band */
    uint32_t *slots; /* of the texels sent */
    ptrdiff_t slots_per_band;
    const struct ts_atlas *atlas;
    uint64_t lights;      /* bit mask of the lights to compute */
    float *const *light;  /* output: three planes */
    float *const *single; /* output: three planes, as in ts_light_map; NULL: not requested */
    const uint8_t *faces; /* for a light of a known direction, the orientation of each triangle to it; NULL: unknown */
    const uint8_t *need;  /* per texel: 0: not needed; NULL: all are needed */
    bool strength;        /* also store the strength map */
    _Atomic int64_t rays;
};

struct texels {
    struct pell_points16 points;
    float ambient[16];
    ptrdiff_t at[16];
    uint32_t subset; /* which subset of the samples of area lights */
    int samples;
    uint32_t **slot; /* next index of the band */
    int count;
};

static struct pell_points_params params_of(const struct lighting *p, uint32_t first, int samples)
{
    return (struct pell_points_params) {
        .lights = p->lights,
        .mix = p->st->knobs.mix,
        .spacing = (float) p->atlas->mm_per_texel,
        .first = first,
        .samples = samples,
        .local = ts_is_local(p->st),
    };
}

/* Evaluates and empties the packet. Returns the number of rays. */
static int64_t light_texels(const struct lighting *p, struct texels *k)
{
    const struct ts_state *st = p->st;
    const struct pell_services *services = st->services;
    const struct pell_points_params params = params_of(p, k->subset * (uint32_t) k->samples, k->samples);
    const struct pell_surface_points in = pell_points16_in(&k->points, k->ambient);
    struct pell_points16_light light;
    struct pell_surface_light out = pell_points16_out(&light);
    float single[3][16];
    const size_t count = (size_t) k->count;
    int64_t rays;

    if (count == 0)
        return 0;
    for (int c = 0; c < 3 && p->single; c++)
        out.single_surplus[c] = single[c];
    if (p->step == SEND) {
        *(*k->slot)++ = services->batches->send(services->engine, &params, &in, count);
        k->count = 0;
        return 0;
    }
    rays = p->step == RECEIVE ? services->batches->take(services->engine, &params, &in, count, *(*k->slot)++, &out)
                              : pell_services_light_points(services, &params, &in, count, &out);
    for (int i = 0; i < k->count; i++) {
        for (int c = 0; c < 3; c++)
            p->light[c][k->at[i]] = light.irradiance[c][i];
        for (int c = 0; c < 3 && p->single; c++)
            p->single[c][k->at[i]] = single[c][i];
        if (p->strength)
            st->strength[k->at[i]] = light.strength[i];
    }
    k->count = 0;
    return rays;
}

static int map_side(const struct ts_atlas *a)
{
    return ts_ambient_side(a) > 1 ? 2 : 1;
}

static int map_subsets(const struct ts_atlas *a, int samples)
{
    return map_side(a) == 1 ? 1 : samples < 4 ? samples : 4;
}

/* Irradiance at chart texels, 16 at a time. Area lights have a pattern of samples per index of the multisample; on fine maps the texels of
 * a square of 2 x 2 share it. */
static void light_rows(void *arg, int index, int worker)
{
    struct lighting *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->atlas;
    const int side = map_side(a), samples = st->in->num_samples, subsets = map_subsets(a, samples);
    const int first = (p->first + index) * p->rows, last = first + p->rows < a->height ? first + p->rows : a->height;
    uint32_t *slot = p->slots ? p->slots + index * p->slots_per_band : NULL; /* NULL: evaluated at once */
    struct texels list[4];
    uint8_t texels[TS_TILE * TS_BLOCK];
    int64_t rays = 0;

    (void) worker;
    for (int i = 0; i < subsets; i++) {
        list[i].subset = (uint32_t) i;
        list[i].samples = samples / subsets;
        list[i].count = 0;
        list[i].slot = &slot;
    }
    for (int y = first; y < last && p->step != SEND; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int c = 0; c < 3; c++) {
                const ptrdiff_t from = y * a->stride + a->runs[r].from * TS_BLOCK;
                const size_t bytes = (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK * sizeof(float);
                memset(p->light[c] + from, 0, bytes);
                if (p->single)
                    memset(p->single[c] + from, 0, bytes);
            }
    for (int y0 = first; y0 < last; y0 += TS_TILE)
        for (int block = 0; block < a->blocks; block++) {
            const int count = ts_block_texels(a, y0, block, texels);
            for (int t = 0; t < count; t++) {
                const int x = block * TS_BLOCK + texels[t] % TS_BLOCK, y = y0 + texels[t] / TS_BLOCK;
                const ptrdiff_t i = y * a->stride + x;
                struct texels *k = &list[ts_ambient_part(side, x, y) % (uint32_t) subsets];
                if ((p->need && !p->need[i]) || (p->faces && p->faces[a->source[i]] & TS_FACE_DARK))
                    continue;
                k->points.mesh[k->count] = a->triangles[a->source[i]].mesh;
                k->points.triangle[k->count] = a->triangles[a->source[i]].triangle;
                k->points.u[k->count] = a->bary[0][i];
                k->points.v[k->count] = a->bary[1][i];
                k->points.seed[k->count] = (uint32_t) (y / side * a->width + x / side);
                k->ambient[k->count] = st->half[0][i];
                k->at[k->count++] = i;
                if (k->count == 16)
                    rays += light_texels(p, k);
            }
        }
    for (int i = 0; i < subsets; i++)
        rays += light_texels(p, &list[i]);
    atomic_fetch_add_explicit(&p->rays, rays, memory_order_relaxed);
}

static bool has_environment(const struct pell_scene *scene, uint64_t lights)
{
    for (size_t i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].type == PELL_LIGHT_ENVIRONMENT && (lights == 0 || (lights & pell_light_bit(i))))
            return true;
    return false;
}

static void light_at_once(struct lighting *p)
{
    p->rows = TS_ROWS;
    ts_rows(p->st, p->atlas->height, light_rows, p);
    ts_note_time(p->st, "map light", p->atlas->inner, p->atlas->inner * 24, atomic_load(&p->rays));
}

/* Batches of as many bands as fit if all their texels are needed. */
static enum pell_result light_in_batches(struct lighting *p, int bands)
{
    const struct pell_services *services = p->st->services;
    const struct pell_points_params params = params_of(p, 0, 1);
    const int all = (p->atlas->height + TS_TILE - 1) / TS_TILE;
    struct pell_pass_time on_device = { .name = "map direct light" };
    enum pell_result res;

    p->rows = TS_TILE;
    for (p->first = 0; p->first < all; p->first += bands) {
        const int count = all - p->first < bands ? all - p->first : bands;
        double seconds = 0.0;
        int64_t bytes = 0;
        p->slots = services->batches->begin(services->engine);
        p->step = SEND;
        pell_pool_run(p->st->pool, count, light_rows, p);
        if (pell_cancelled(p->st->ctx))
            return PELL_ERR_CANCELLED;
        res = services->batches->run(services->engine, &params, &seconds, &bytes);
        if (res != PELL_OK)
            return res;
        p->step = RECEIVE;
        pell_pool_run(p->st->pool, count, light_rows, p);
        on_device.seconds += seconds;
        on_device.bytes += bytes;
    }
    on_device.pixels = p->atlas->inner;
    on_device.rays = atomic_load(&p->rays);
    ts_add_time(p->st, &on_device);
    p->st->clock += on_device.seconds;
    atomic_store(&p->rays, 0);
    return PELL_OK;
}

static enum pell_result light_charts(struct lighting *p)
{
    const struct pell_services *s = p->st->services;
    const struct ts_atlas *a = p->atlas;
    const int samples = p->st->in->num_samples, subsets = map_subsets(a, samples);
    const size_t room = s->batches ? s->batches->room(s->engine) : 0;
    /* Packets of a band; the last one of each subset may be partly filled. */
    const size_t most = (size_t) TS_TILE * TS_BLOCK * (size_t) a->blocks / 16 + (size_t) subsets;
    const size_t bands = room / (most * pell_services_batch_points(s) * (size_t) (samples / subsets));
    enum pell_result res;

    p->slots_per_band = (ptrdiff_t) most;
    if (bands == 0) {
        light_at_once(p);
        return PELL_OK;
    }
    res = light_in_batches(p, bands < (size_t) a->height ? (int) bands : a->height);
    ts_note_time(p->st, "map light", a->inner, a->inner * 24, atomic_load(&p->rays));
    return res;
}

enum pell_result ts_light_map(struct ts_state *st, const struct ts_atlas *a, uint64_t lights, const uint8_t *faces, bool all,
                              float *const light[3], float *const *single)
{
    const bool partial = st->need.on && !all;
    struct lighting lighting = {
        .st = st,
        .atlas = a,
        .lights = lights,
        .light = light,
        .single = single,
        .faces = faces,
        .need = partial ? st->need.stage : NULL,
    };

    if (has_environment(st->services->scene, lights)) {
        const struct ts_ambient_params ambient = {
            .services = st->services,
            .atlas = a,
            .seed = st->in->seed,
            .need = partial ? st->need.cell : NULL,
            .seen = st->half[0],
            .spare = st->half[1],
        };
        const int64_t rays = ts_ambient_trace(&ambient);
        ts_note_time(st, "map sky", a->inner, a->inner * 24, rays);
    }
    return light_charts(&lighting);
}

void ts_light_map_and_strength(struct ts_state *st, const struct ts_atlas *a)
{
    struct lighting lighting = { .st = st, .atlas = a, .light = st->light, .strength = true };

    light_at_once(&lighting);
}
