/* SPDX-License-Identifier: MIT
 *
 * chain.c - the chain of blurs: each level blurs what the one before left, adds its share to the sum, and transmits its share through thin
 * parts. The inner loops of the blurs are in kernels.c.
 */
#include "methods/texture_space/state.h"

#include <string.h>

#define FADE 6.0f             /* standard deviations at which transmitted light counts in full */
#define SOFT (1.0 / 3.0)      /* of the widest blur's width */
#define WEIGHTLESS_LEAST 0.05 /* texels^2: a blur without weight that reaches no further is left out */

enum { CHUNK = 4096 };

struct chain {
    struct ts_state *st;
    const struct ts_solid *solid;
    float *const *now; /* what is blurred next: st->light at first, st->now later */
    int planes;        /* of what the chain starts with */
    int level;         /* in the profile */
    bool down;
    bool scaled; /* by strength */
};

static void blur_rows(void *arg, int band, int worker)
{
    const struct chain *p = arg;
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
    const struct chain *p = arg;
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
                const float lx = st->work.length[0][i], ly = st->work.length[1][i], skew = st->knobs.stretch ? a->skew[i] * lx : 0.0f;
                st->now[4][i] = lx > 0.0f ? 1.0f / lx : 0.0f;
                st->now[5][i] = lx > 0.0f ? 1.0f / sqrtf(ly * ly + skew * skew) : 0.0f;
            }
        }
}

static void thin_out(void *arg, int chunk, int worker)
{
    const struct chain *p = arg;
    struct ts_state *st = p->st;
    const struct ts_profile *profile = p->solid->profile;
    const size_t end = (size_t) (chunk + 1) * CHUNK < st->tsm.count ? (size_t) (chunk + 1) * CHUNK : st->tsm.count;
    const bool linear = st->knobs.fade == TS_FADE_LINEAR;
    const float reach = FADE * (float) sqrt(profile->variance[p->level]), falloff = -0.5f / (float) profile->variance[p->level];

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        struct ts_transmitted_texel *t = &st->tsm.texels[i];
        const float alpha = p->now[3][t->at], strength = p->scaled ? st->strength[t->at] : 1.0f;
        /* Of A's light the blurs bring exp(-s^2/(2 v)) along the surface, where the straight way brings exp(-m^2/(2 v)). */
        float near = linear ? fminf(t->apart / reach, 1.0f) : -expm1f(fmaxf(t->apart * t->apart - t->m * t->m, 0.0f) * falloff);
        near += t->round || linear ? 0.0f : (1.0f - near) * t->opposed;
        t->share[0] = t->share[1] = t->share[2] = 0.0f;
        if (!(alpha > 0.0f) || !(strength > 0.0f))
            continue;
        ts_profile_transmission(profile, p->level, fmaxf(-logf(alpha), 0.0f) * (float) profile->widest / strength, t->opposed, t->share);
        for (int c = 0; c < 3; c++)
            t->share[c] *= near * t->left[c];
    }
}

static void add_transmission(void *arg, int chunk, int worker)
{
    const struct chain *p = arg;
    struct ts_state *st = p->st;
    const size_t end = (size_t) (chunk + 1) * CHUNK < st->tsm.count ? (size_t) (chunk + 1) * CHUNK : st->tsm.count;
    const float *const planes[3] = { p->now[0], p->now[1], p->now[2] };
    float *const *out = st->knobs.soften ? st->behind : st->sum;

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        const struct ts_transmitted_texel *t = &st->tsm.texels[i];
        float rgb[3];
        if (!(t->share[0] > 0.0f || t->share[1] > 0.0f || t->share[2] > 0.0f))
            continue;
        ts_read(p->solid->atlas, &t->from, planes, 3, rgb);
        if (t->part > 0.0f) {
            float also[3];
            ts_read(p->solid->atlas, &t->also, planes, 3, also);
            for (int c = 0; c < 3; c++)
                rgb[c] += t->part * (also[c] - rgb[c]);
        }
        for (int c = 0; c < 3; c++)
            out[c][t->at] += t->share[c] * rgb[c];
    }
}

static const char *level_name(int i)
{
    static const char *const names[TS_LEVELS] = {
        "blur 1",  "blur 2",  "blur 3",  "blur 4",  "blur 5",  "blur 6",  "blur 7",  "blur 8",  "blur 9",  "blur 10", "blur 11",
        "blur 12", "blur 13", "blur 14", "blur 15", "blur 16", "blur 17", "blur 18", "blur 19", "blur 20", "blur 21", "blur 22",
        "blur 23", "blur 24", "blur 25", "blur 26", "blur 27", "blur 28", "blur 29", "blur 30", "blur 31", "blur 32",
    };

    return names[i];
}

/* A blur of the chain; `add`: what it gives is part of the answer. */
struct blur {
    double before, after; /* variance, mm^2 */
    const double *weight; /* NULL: don't add it to the sum */
};

/* How far from charts borders must be blurred along, for the blur down to find what it needs, and how far there must be light in them. */
static void reach_of(const struct chain *p, const struct blur *b, int *blurred, int *filled)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;
    float reach[2], aside;

    *blurred = *filled = TS_FAR - 1;
    w.before = (float) b->before;
    w.after = (float) b->after;
    for (int k = 0; k < 2; k++)
        reach[k] = floorf(st->kernels->reach(&w, st->least[k]));
    aside = ceilf(reach[1] * st->skew);
    if (w.planes > 4 || !(reach[0] + reach[1] + aside + 1.0f < (float) TS_FAR))
        return;
    *blurred = (int) fmaxf(reach[1], aside);
    *filled = (int) fmaxf(reach[1], aside + reach[0]);
}

/* Along and down, from p->now to st->now; adds the result to the sum, weighted. Borders must hold what the blur needs. */
static void blur_planes(struct chain *p, const struct blur *b, int64_t *texels)
{
    struct ts_state *st = p->st;
    struct ts_work *w = &st->work;
    const struct ts_atlas *a = p->solid->atlas;
    int blurred, filled;

    reach_of(p, b, &blurred, &filled);
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
        ts_rows(st, a->height, blur_rows, p);
    }
    p->now = st->now;
    *texels = 2 * a->inner + (int64_t) a->within[blurred] + (int64_t) a->within[filled];
}

/* Fills the borders of p->now so far as the next blur needs it, and so that it can be read anywhere in charts. */
static void fill_for(struct chain *p, const struct blur *next, int planes)
{
    int blurred, filled = 1;

    if (next)
        reach_of(p, next, &blurred, &filled);
    ts_fill(p->st, p->solid->atlas, p->now, planes, filled > 1 ? filled : 1);
}

/* Before the first blur: what is blurred is in `from`. */
static void start(struct chain *p, float *const *from, int planes)
{
    struct ts_state *st = p->st;

    st->work.planes = st->knobs.kernel == TS_KERNEL_SEVEN ? 6 : planes;
    p->now = from;
    if (st->work.planes == 6) {
        p->planes = planes;
        ts_rows(st, p->solid->atlas->height, start_rows, p);
        p->now = st->now;
    }
}

/* One level of the chain. */
struct level {
    int number; /* in the profile */
    bool blurs;
    struct blur blur; /* where it doesn't, its weight counts alone */
};

/* Texels may be longer than what a blur adds: reading the map alone blurs more. */
static bool reaches(const struct chain *p, const struct blur *b)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;

    w.before = (float) b->before;
    w.after = (float) b->after;
    return w.planes > 4 || st->kernels->reach(&w, st->least[0]) > 0.0f || st->kernels->reach(&w, st->least[1]) > 0.0f;
}

static int list_levels(const struct chain *p, bool local, struct level *out)
{
    const struct ts_profile *profile = p->solid->profile;
    const double finest = 1.0 / (p->solid->atlas->mm_per_texel * p->solid->atlas->mm_per_texel);
    double before = 0.0;
    int count = 0, unblurred = -1;

    for (int i = 0; i < profile->count && unblurred < 0; i++)
        if (profile->weight[i][0] + profile->weight[i][1] + profile->weight[i][2] > 0.0)
            unblurred = i;
    for (int i = 0; i < profile->count; i++) {
        const double *weight = profile->weight[i];
        const bool none = !(weight[0] > 0.0 || weight[1] > 0.0 || weight[2] > 0.0);
        const bool still = p->st->knobs.first == TS_FIRST_UNBLURRED && i <= unblurred;
        if (none && (still || (profile->variance[i] - before) * finest < WEIGHTLESS_LEAST))
            continue;
        out[count] = (struct level) { i, false, { before, profile->variance[i], local && !none && !still ? weight : NULL } };
        out[count].blurs = !still && reaches(p, &out[count].blur);
        before = still ? before : profile->variance[i];
        count++;
    }
    return count;
}

static const struct blur *next_blur(const struct level *levels, int from, int count)
{
    for (int i = from; i < count; i++)
        if (levels[i].blurs)
            return &levels[i].blur;
    return NULL;
}

/* A level that blurs nothing. */
static void sum_rows(void *arg, int band, int worker)
{
    const struct chain *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int c = 0; c < 3; c++) {
                const ptrdiff_t at = y * a->stride + a->runs[r].from * TS_BLOCK;
                const float *from = p->now[c] + at;
                float *restrict sum = st->sum[c] + at;
                for (int i = 0; i < (a->runs[r].to - a->runs[r].from) * TS_BLOCK; i++)
                    sum[i] += st->work.weight[c] * from[i];
            }
}

void ts_chain(struct ts_state *st, const struct ts_solid *solid, const struct ts_chain_params *params)
{
    struct chain chain = { .st = st, .solid = solid, .scaled = params->scaled }, *p = &chain;
    const bool transmission = params->transmission;
    const int planes = transmission ? 4 : 3, chunks = (int) ((st->tsm.count + CHUNK - 1) / CHUNK);
    struct level levels[TS_LEVELS];
    int number = 0, count;

    start(p, st->light, planes);
    count = list_levels(p, params->local, levels);
    fill_for(p, next_blur(levels, 0, count), planes);
    for (int i = 0; i < count; i++) {
        const struct blur *b = &levels[i].blur;
        int64_t texels = 0;
        p->level = levels[i].number;
        if (transmission)
            pell_pool_run(st->pool, chunks, thin_out, p);
        if (levels[i].blurs) {
            blur_planes(p, b, &texels);
            ts_show(st, &(struct ts_image) { "blur",
                                             "W/m^2",
                                             "the irradiance map after the Gaussians up to this one",
                                             { p->now[0], p->now[1], p->now[2] },
                                             3,
                                             i + 1,
                                             true,
                                             true });
            if (transmission || i + 1 < count)
                fill_for(p, next_blur(levels, i + 1, count), planes);
            ts_note_time(st, level_name(number++), texels, 8 * texels * st->work.planes, 0);
        } else if (b->weight) {
            for (int c = 0; c < 3; c++)
                st->work.weight[c] = (float) b->weight[c];
            ts_rows(st, p->solid->atlas->height, sum_rows, p);
            ts_note_time(st, "unblurred", p->solid->atlas->inner, 36 * p->solid->atlas->inner, 0);
        }
        if (transmission) {
            pell_pool_run(st->pool, chunks, add_transmission, p);
            ts_note_time(st, "through", (int64_t) st->tsm.count, (int64_t) st->tsm.count * 80, 0);
        }
    }
}

void ts_soften(struct ts_state *st, const struct ts_solid *solid)
{
    static const double whole[3] = { 1.0, 1.0, 1.0 };
    struct chain chain = { .st = st, .solid = solid }, *p = &chain;
    const struct blur blur = { 0.0, SOFT * SOFT * solid->profile->widest * solid->profile->widest, whole };
    int64_t texels;

    start(p, st->behind, 3);
    fill_for(p, &blur, 3);
    blur_planes(p, &blur, &texels);
    ts_note_time(st, "soften", texels, 8 * texels * st->work.planes, 0);
}
