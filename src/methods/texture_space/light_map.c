/* SPDX-License-Identifier: MIT
 *
 * light_map.c - the light that enters at each texel of a chart.
 */
#include "methods/texture_space/state.h"

#include <stdatomic.h>
#include <string.h>

struct lighting {
    struct ts_state *st;
    const struct ts_atlas *atlas;
    uint64_t lights;      /* whose light is computed */
    const uint8_t *faces; /* what triangles show them, where it is one of a known direction; NULL: unknown */
    const uint8_t *need;  /* per texel: 0: not asked for; NULL: all are */
    bool strength;        /* keep it, too */
    _Atomic int64_t rays;
};

struct texels {
    struct pell_points16 points;
    float ambient[16];
    ptrdiff_t at[16];
    uint32_t part; /* of the samples of lights with extent */
    int samples;
    int count;
};

static int64_t light_texels(const struct lighting *p, struct texels *k)
{
    const struct ts_state *st = p->st;
    const struct pell_points_params params = {
        .lights = p->lights,
        .mix = st->knobs.mix,
        .spacing = (float) p->atlas->mm_per_texel,
        .first = k->part * (uint32_t) k->samples,
        .samples = k->samples,
        .local = ts_is_local(st),
    };
    struct pell_points16_light light;
    int64_t rays;

    if (k->count == 0)
        return 0;
    rays = pell_services_light16(st->services, &params, &k->points, k->ambient, k->count, &light);
    for (int i = 0; i < k->count; i++) {
        for (int c = 0; c < 3; c++)
            st->light[c][k->at[i]] = light.irradiance[c][i];
        if (p->strength)
            st->strength[k->at[i]] = light.strength[i];
    }
    k->count = 0;
    return rays;
}

/* Light that enters at the texels of charts, 16 at a time. Lights with extent have a pattern of samples for each number of the multisample:
 * on fine maps texels of a square of 2 x 2 share them out. */
static void light_rows(void *arg, int band, int worker)
{
    struct lighting *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->atlas;
    const int side = ts_ambient_side(a) > 1 ? 2 : 1, samples = st->in->num_samples, parts = side == 1 ? 1 : samples < 4 ? samples : 4;
    struct texels list[4];
    uint8_t texels[TS_TILE * TS_BLOCK];
    int64_t rays = 0;

    (void) worker;
    for (int i = 0; i < parts; i++) {
        list[i].part = (uint32_t) i;
        list[i].samples = samples / parts;
        list[i].count = 0;
    }
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int c = 0; c < 3; c++)
                memset(st->light[c] + y * a->stride + a->runs[r].from * TS_BLOCK, 0,
                       (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK * sizeof(float));
    for (int y0 = band * TS_ROWS; y0 < (band + 1) * TS_ROWS && y0 < a->height; y0 += TS_TILE)
        for (int block = 0; block < a->blocks; block++) {
            const int count = ts_block_texels(a, y0, block, texels);
            for (int t = 0; t < count; t++) {
                const int x = block * TS_BLOCK + texels[t] % TS_BLOCK, y = y0 + texels[t] / TS_BLOCK;
                const ptrdiff_t i = y * a->stride + x;
                struct texels *k = &list[ts_ambient_part(side, x, y) % (uint32_t) parts];
                if ((p->need && !p->need[i]) || (p->faces && p->faces[a->source[i]] & TS_FACE_DARK))
                    continue;
                k->points.mesh[k->count] = a->triangles[a->source[i]].mesh;
                k->points.triangle[k->count] = a->triangles[a->source[i]].triangle;
                k->points.u[k->count] = a->bary[0][i];
                k->points.v[k->count] = a->bary[1][i];
                k->points.number[k->count] = (uint32_t) (y / side * a->width + x / side);
                k->ambient[k->count] = st->half[0][i];
                k->at[k->count++] = i;
                if (k->count == 16)
                    rays += light_texels(p, k);
            }
        }
    for (int i = 0; i < parts; i++)
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

static void light_charts(struct lighting *p)
{
    ts_rows(p->st, p->atlas->height, light_rows, p);
    ts_note_time(p->st, "map light", p->atlas->inner, p->atlas->inner * 24, atomic_load(&p->rays));
}

void ts_light_map(struct ts_state *st, const struct ts_atlas *a, uint64_t lights, const uint8_t *faces, bool all)
{
    const bool part = st->need.on && !all;
    struct lighting lighting = { .st = st, .atlas = a, .lights = lights, .faces = faces, .need = part ? st->need.stage : NULL };

    if (has_environment(st->services->scene, lights)) {
        const struct ts_ambient_params ambient = {
            .services = st->services,
            .atlas = a,
            .seed = st->in->seed,
            .need = part ? st->need.cell : NULL,
            .seen = st->half[0],
            .spare = st->half[1],
        };
        const int64_t rays = ts_ambient_look(&ambient);
        ts_note_time(st, "map sky", a->inner, a->inner * 24, rays);
    }
    light_charts(&lighting);
}

void ts_light_map_and_strength(struct ts_state *st, const struct ts_atlas *a)
{
    struct lighting lighting = { .st = st, .atlas = a, .strength = true };

    light_charts(&lighting);
}
