/* SPDX-License-Identifier: MIT
 *
 * run_cpu.c - a solid's map on the cpu engine: tasks are bands of rows and chunks of texels. The inner loops of the blurs are in kernels.c.
 */
#include "methods/texture_space/state.h"

#include <string.h>

enum { CHUNK = 4096 };

static void blur_rows(void *arg, int band, int worker)
{
    const struct ts_blurring *p = arg;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++) {
            if (p->down)
                p->st->kernels->down(&p->st->work, y, a->runs[r].from, a->runs[r].to);
            else
                p->st->kernels->across(&p->st->work, y, a->runs[r].from, a->runs[r].to);
        }
}

/* The paper's taps blur the stretch as well: texels per mm, along x and y. */
static void start_rows(void *arg, int band, int worker)
{
    const struct ts_blurring *p = arg;
    struct ts_state *st = p->st;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++) {
            const ptrdiff_t at = y * a->stride + a->runs[r].from * TS_BLOCK;
            const size_t n = (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK;
            for (int c = 0; c < st->work.planes - 2; c++)
                if (c < p->planes)
                    memcpy(st->now[c] + at, p->now[c] + at, n * sizeof(float));
                else
                    memset(st->now[c] + at, 0, n * sizeof(float));
            for (ptrdiff_t i = at; i < at + (ptrdiff_t) n; i++) {
                float density[2];
                ts_stretch(st, a, i, density);
                st->now[4][i] = density[0];
                st->now[5][i] = density[1];
            }
        }
}

static void weigh_chunk(void *arg, int chunk, int worker)
{
    const struct ts_blurring *p = arg;
    struct ts_state *st = p->st;
    const struct ts_profile *profile = p->solid->profile;
    const size_t end = (size_t) (chunk + 1) * CHUNK < st->tsm.count ? (size_t) (chunk + 1) * CHUNK : st->tsm.count;
    const bool linear = st->knobs.fade == TS_FADE_LINEAR;
    const float reach = TS_FADE_REACH * (float) sqrt(profile->variance[p->level]), falloff = -0.5f / (float) profile->variance[p->level];

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        struct ts_transmitted_texel *t = &st->tsm.texels[i];
        const float alpha = p->now[3][t->at], strength = p->scaled ? st->strength[t->at] : 1.0f;
        /* The blurs weight A's light by exp(-s^2/(2 v)), s along the surface; a straight path has exp(-m^2/(2 v)). */
        float fade = linear ? fminf(t->surface_distance / reach, 1.0f)
                            : -expm1f(fmaxf(t->surface_distance * t->surface_distance - t->m * t->m, 0.0f) * falloff);
        fade += t->along_surface || linear ? 0.0f : (1.0f - fade) * t->opposed;
        t->fraction[0] = t->fraction[1] = t->fraction[2] = 0.0f;
        if (!(alpha > 0.0f) || !(strength > 0.0f) || (st->need.on && !st->need.transmitted[t->at]))
            continue;
        ts_profile_transmission(profile, p->level, fmaxf(-logf(alpha), 0.0f) * (float) profile->widest / strength, t->opposed, t->fraction);
        for (int c = 0; c < 3; c++)
            t->fraction[c] *= fade * t->remaining[c];
    }
}

static void add_transmission(void *arg, int chunk, int worker)
{
    const struct ts_blurring *p = arg;
    struct ts_state *st = p->st;
    const size_t end = (size_t) (chunk + 1) * CHUNK < st->tsm.count ? (size_t) (chunk + 1) * CHUNK : st->tsm.count;
    const float *const planes[3] = { p->now[0], p->now[1], p->now[2] };
    float *const *out = st->knobs.soften ? st->transmitted : st->sum;

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        const struct ts_transmitted_texel *t = &st->tsm.texels[i];
        float rgb[3];
        if (!(t->fraction[0] > 0.0f || t->fraction[1] > 0.0f || t->fraction[2] > 0.0f))
            continue;
        ts_read(p->solid->atlas, &t->from, planes, 3, rgb);
        if (t->second_weight > 0.0f) {
            float second[3];
            ts_read(p->solid->atlas, &t->second, planes, 3, second);
            for (int c = 0; c < 3; c++)
                rgb[c] += t->second_weight * (second[c] - rgb[c]);
        }
        for (int c = 0; c < 3; c++)
            out[c][t->at] += t->fraction[c] * rgb[c];
    }
}

/* A level without a blur. */
static void sum_rows(void *arg, int band, int worker)
{
    const struct ts_blurring *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int c = 0; c < 3; c++) {
                const ptrdiff_t at = y * a->stride + a->runs[r].from * TS_BLOCK;
                const float *from = p->now[c] + at, *local = p->planes == TS_PLANES ? p->now[TS_LOCAL + c] + at : NULL;
                const int count = (a->runs[r].to - a->runs[r].from) * TS_BLOCK;
                float *restrict sum = st->sum[c] + at;
                for (int i = 0; i < count; i++)
                    sum[i] += st->work.weight[c] * (local ? from[i] + local[i] : from[i]);
            }
}

static enum pell_result begin(struct ts_state *st, const struct ts_solid *solid)
{
    (void) st;
    (void) solid;
    return PELL_OK;
}

static enum pell_result start(struct ts_blurring *p, bool transmitted, int planes)
{
    struct ts_state *st = p->st;

    (void) planes;
    p->now = transmitted ? st->transmitted : st->light;
    if (st->work.seven) {
        ts_rows(st, p->solid->atlas->height, start_rows, p);
        p->now = st->now;
    }
    return PELL_OK;
}

static void fill(struct ts_blurring *p, int planes, int far)
{
    ts_fill(p->st, p->solid->atlas, p->now, planes, far, TS_NEED_BEFORE(p->blurs));
}

static int chunks_of(const struct ts_state *st)
{
    return (int) ((st->tsm.count + CHUNK - 1) / CHUNK);
}

static void transmission_weights(struct ts_blurring *p)
{
    pell_pool_run(p->st->pool, chunks_of(p->st), weigh_chunk, p);
}

static void transmit(struct ts_blurring *p)
{
    pell_pool_run(p->st->pool, chunks_of(p->st), add_transmission, p);
}

static void blur(struct ts_blurring *p, const struct ts_blur *b, int blurred)
{
    struct ts_state *st = p->st;
    struct ts_work *w = &st->work;

    w->before = (float) b->before;
    w->after = (float) b->after;
    for (int c = 0; c < 3; c++) {
        w->sum[c] = b->weight ? st->sum[c] : NULL;
        w->weight[c] = b->weight ? (float) b->weight[c] : 0.0f;
    }
    for (int down = 0; down < 2; down++) {
        for (int c = 0; c < w->planes; c++) {
            w->from[c] = down ? st->half[c] : p->now[c];
            w->to[c] = down ? st->now[c] : st->half[c];
        }
        p->down = down;
        w->near = down ? 0 : blurred;
        w->need = st->need.on ? st->need.cell : NULL;
        w->stage = (uint8_t) (down ? TS_NEED_DOWN(p->blurs) : TS_NEED_ALONG(p->blurs));
        ts_rows(st, p->solid->atlas->height, blur_rows, p);
    }
    p->now = st->now;
}

static void scatter_rows(void *arg, int band, int worker)
{
    const struct ts_blurring *p = arg;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            p->st->kernels->scatter(&p->st->work, a->skew, p->solid->profile->taps, TS_TAPS, y, a->runs[r].from, a->runs[r].to);
}

static void scatter(struct ts_blurring *p)
{
    for (int c = 0; c < 3; c++) {
        p->st->work.from[c] = p->now[c];
        p->st->work.sum[c] = p->st->sum[c];
    }
    ts_rows(p->st, p->solid->atlas->height, scatter_rows, p);
}

static void add(struct ts_blurring *p, const double weight[3])
{
    for (int c = 0; c < 3; c++)
        p->st->work.weight[c] = (float) weight[c];
    ts_rows(p->st, p->solid->atlas->height, sum_rows, p);
}

static void note(struct ts_state *st, const char *name, int64_t texels, int planes)
{
    ts_note_time(st, name, texels, 4 * planes * texels, 0);
}

static enum pell_result inspect(struct ts_blurring *p, bool sum)
{
    (void) p;
    (void) sum;
    return PELL_OK;
}

static enum pell_result finish(struct ts_blurring *p)
{
    (void) p;
    return PELL_OK;
}

struct storing {
    const struct ts_state *st;
    const struct ts_solid *solid;
};

static void store_rows(void *arg, int band, int worker)
{
    const struct storing *p = arg;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int b = a->runs[r].from; b < a->runs[r].to; b++) {
                const ptrdiff_t first = y * a->stride + b * TS_BLOCK;
                if (a->cells[(ptrdiff_t) y * a->blocks + b].near > TS_READ_FAR)
                    continue;
                for (ptrdiff_t at = first; at < first + TS_BLOCK; at++) {
                    float *out = p->solid->map + 4 * at;
                    for (int c = 0; c < 3; c++)
                        out[c] = p->st->sum[c][at];
                    out[3] = a->key[at];
                }
            }
}

static enum pell_result store(struct ts_state *st, const struct ts_solid *solid)
{
    struct storing task = { st, solid };

    ts_fill(st, solid->atlas, st->sum, 3, TS_READ_FAR, 1);
    ts_rows(st, solid->atlas->height, store_rows, &task);
    return PELL_OK;
}

static void forget(struct ts_state *st)
{
    (void) st;
}

const struct ts_runner ts_cpu_runner = {
    .begin = begin,
    .start = start,
    .fill = fill,
    .transmission_weights = transmission_weights,
    .blur = blur,
    .scatter = scatter,
    .add = add,
    .transmit = transmit,
    .note = note,
    .inspect = inspect,
    .finish = finish,
    .store = store,
    .forget = forget,
    .culls = true,
    .joins = true,
};
