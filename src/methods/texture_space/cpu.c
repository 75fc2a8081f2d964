/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the texture-space method on the cpu engine: light on the map, the chain of blurs, what comes through, and the last look at each
 * pixel. The inner loops of the blurs are in kernels.c.
 *
 * A frame makes the map when it is the first one that sees the scene and its lights like this; later ones only look at it.
 */
#include "methods/texture_space/texture_space.h"

#include "base/simd.h"

#include <stdatomic.h>
#include <string.h>

PELL_SIMD_TABLES(struct ts_kernels, pell_ts_kernels);

enum { ROWS = 16, CHUNK = 4096, SQUARES = 64, LIGHTS_MOST = 16, TIMES = TS_LEVELS + 8, LIT = 4 };
#define GRID_VARIANCE (1.0f / 6.0f) /* texels^2 that bilinear reading adds on the average */
#define SIZE_LEAST 32.0             /* texels, of small things beside large ones */
#define TAPS_REACH 3.46             /* standard deviations */
#define COVERED 0.6
#define STRENGTH_LEAST 1e-3f
#define FADE 6.0f             /* standard deviations at which light from behind counts in full */
#define SOFT (1.0 / 3.0)      /* of the widest blur's width */
#define WEIGHTLESS_LEAST 0.05 /* texels^2: a blur without weight that reaches no further is left out */
#define READ_FAR 6            /* texels from the inside of charts that pixels read at most: look_around's, and the four about a place */

struct ts_body {
    struct ts_atlas *atlas;
    const struct ts_profile *profile; /* of its material */
    float *map;                       /* R, G, B of M and the chart, per texel; begins at texel (0, 0) */
};

struct ts_state {
    struct pell_renderer *r; /* borrowed */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct ts_kernels *kernels;
    struct ts_knobs knobs;
    struct pell_bodies *bodies;
    struct ts_body *body;
    struct ts_profile *profiles; /* of materials; a body's alone are made */
    size_t num_profiles;
    struct ts_tsm tsm;
    float *memory;     /* of the planes below, at texel (0, 0) of any atlas */
    float *light[LIT]; /* that entered, and alpha */
    float *now[TS_PLANES], *half[TS_PLANES], *sum[3];
    float *behind[3]; /* what comes through, before it is softened */
    float *strength;
    float *scaled[2]; /* lengths over strength */
    struct ts_cell *cells;
    uint64_t lit; /* the lights' number; 0: not yet */
    size_t warned; /* how many lights there were when they were counted */
    struct ts_work work;
    float least[2], lean; /* lengths of the body's shortest texels; and the most that a block leans */
    struct pell_pass_time times[TIMES];
    size_t num_times;
    double clock;
};

/* --- Life ------------------------------------------------------------------------------------------------------------------------ */

static void ts_destroy(void *state)
{
    struct ts_state *st = state;

    if (!st)
        return;
    for (size_t i = 0; st->body && i < st->bodies->count; i++) {
        ts_atlas_destroy(&st->body[i].atlas);
        if (st->body[i].map)
            pell_free(st->ctx, st->body[i].map - 4 * TS_MARGIN);
    }
    for (size_t i = 0; st->profiles && i < st->num_profiles; i++)
        ts_profile_finish(st->ctx, &st->profiles[i]);
    ts_tsm_finish(st->ctx, &st->tsm);
    pell_free(st->ctx, st->cells);
    pell_free(st->ctx, st->memory);
    pell_free(st->ctx, st->profiles);
    pell_free(st->ctx, st->body);
    pell_bodies_destroy(&st->bodies);
    pell_free(st->ctx, st);
}

static bool scaled_strength(const struct ts_state *st, int32_t body)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);

    for (size_t i = 0; st->knobs.strength && i < scene->num_meshes; i++)
        if (st->bodies->of_mesh[i] == body) {
            const struct pell_material *m = &scene->materials[scene->meshes[i].material];
            if (m->strength != 1.0f || m->strength_map.texture)
                return true;
        }
    return false;
}

/* As far as the taps of the widest blur reach, where texels are as long as they would be if charts covered 0.6 of the map. */
static int border_of(const struct ts_state *st, const struct ts_profile *p, double area, int size)
{
    double widest = 0.0, reach;

    if (st->knobs.border >= 0)
        return st->knobs.border;
    for (int i = 0; i < p->count; i++)
        widest = fmax(widest, p->variance[i] - (i > 0 ? p->variance[i - 1] : 0.0));
    reach = TAPS_REACH * sqrt(widest * COVERED * size * size / area);
    return (int) fmin(fmax(ceil(reach), 4.0), ceil(0.1 * size));
}

static enum pell_result make_atlases(struct ts_state *st, const struct pell_frame *shape)
{
    const struct pell_bodies *b = st->bodies;
    double largest = 0.0;
    enum pell_result res;

    for (size_t i = 0; i < b->count; i++)
        largest = fmax(largest, b->bodies[i].area);
    for (size_t i = 0; i < b->count; i++) {
        const struct pell_body *body = &b->bodies[i];
        const struct pell_frame_material *m = &shape->materials[body->material];
        const double share = largest > 0.0 ? sqrt(body->area / largest) : 0.0;
        struct ts_profile *profile = &st->profiles[body->material];
        struct ts_atlas_params p = {
            .pool = st->pool,
            .scene = pell_renderer_scene(st->r),
            .bodies = b,
            .body = i,
            .name = m->name,
            .charts = st->knobs.charts,
            .size = (int) fmin(fmax(ceil(st->knobs.size * share), SIZE_LEAST), st->knobs.size),
        };
        if (body->num_triangles == 0)
            continue;
        if (profile->count == 0)
            PELL_TRY(ts_profile_make(st->ctx, m, &st->knobs, profile));
        st->body[i].profile = profile;
        p.border = border_of(st, profile, body->area, p.size);
        PELL_TRY(ts_atlas_make(st->ctx, &p, &st->body[i].atlas));
        st->body[i].map = pell_calloc(st->ctx, 4 * st->body[i].atlas->size, sizeof(float));
        if (!st->body[i].map)
            return PELL_ERR_NOMEM;
        st->body[i].map += 4 * TS_MARGIN;
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
    }
    return PELL_OK;

fail:
    return res;
}

/* Planes of the largest atlas serve all. */
static enum pell_result make_planes(struct ts_state *st)
{
    const bool seven = st->knobs.kernel == TS_KERNEL_SEVEN, through = st->knobs.tsm != TS_TSM_OFF;
    const struct ts_atlas **atlases = pell_calloc(st->ctx, st->bodies->count + 1, sizeof(*atlases));
    size_t size = 0, cells = 0, count = 0, planes = 0;
    bool strength = false;
    float **list[LIT + 2 * TS_PLANES + 9];
    enum pell_result res = PELL_ERR_NOMEM;

    if (!atlases)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < st->bodies->count; i++) {
        const struct ts_atlas *a = st->body[i].atlas;
        if (!a)
            continue;
        atlases[count++] = a;
        size = a->size > size ? a->size : size;
        cells = (size_t) a->blocks * (size_t) a->height > cells ? (size_t) a->blocks * (size_t) a->height : cells;
        strength |= scaled_strength(st, (int32_t) i);
    }
    for (int i = 0; i < (through ? 4 : 3); i++)
        list[planes++] = &st->light[i];
    for (int i = 0; i < (seven ? 6 : through ? 4 : 3); i++) {
        list[planes++] = &st->now[i];
        list[planes++] = &st->half[i];
    }
    for (int i = 0; i < 3; i++)
        list[planes++] = &st->sum[i];
    for (int i = 0; i < 3 && through && st->knobs.soften; i++)
        list[planes++] = &st->behind[i];
    if (strength)
        list[planes++] = &st->strength;
    if (strength || !st->knobs.stretch) {
        list[planes++] = &st->scaled[0];
        list[planes++] = &st->scaled[1];
    }
    size = (size + 15) / 16 * 16 + 48;
    st->memory = pell_calloc(st->ctx, size * planes + 1, sizeof(float));
    st->cells = pell_calloc(st->ctx, cells + 1, sizeof(*st->cells));
    if (!st->memory || !st->cells)
        goto fail;
    for (size_t i = 0; i < planes; i++)
        *list[i] = st->memory + i * size + TS_MARGIN;
    if (through)
        PELL_TRY(ts_tsm_allocate(st->ctx, atlases, count, st->knobs.tsm == TS_TSM_MAP ? st->knobs.tsm_size : 0, &st->tsm));
    res = PELL_OK;

fail:
    pell_free(st->ctx, atlases);
    return res;
}

static enum pell_result ts_create(struct pell_renderer *r, const struct pell_frame *shape, const void *knobs, void **state)
{
    struct pell_context *ctx = pell_renderer_context(r);
    struct ts_state *st = pell_zalloc(ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->r = r;
    st->ctx = ctx;
    st->pool = pell_renderer_pool(r);
    st->kernels = pell_ts_kernels_tables[pell_simd_best()];
    st->knobs = *(const struct ts_knobs *) knobs;
    PELL_TRY(pell_renderer_bodies(r, &st->bodies));
    st->num_profiles = shape->num_materials;
    st->body = pell_calloc(ctx, st->bodies->count + 1, sizeof(*st->body));
    st->profiles = pell_calloc(ctx, shape->num_materials, sizeof(*st->profiles));
    if (!st->body || !st->profiles)
        return PELL_ERR_NOMEM;
    PELL_TRY(make_atlases(st, shape));
    return make_planes(st);

fail:
    return res;
}

/* --- Passes over rows and lists -------------------------------------------------------------------------------------------------- */

struct pass {
    struct ts_state *st;
    const struct ts_body *body;
    uint64_t lights;      /* whose light is looked for */
    const uint8_t *faces; /* of them, where it is one of a known direction; NULL: unknown */
    int level;
    float *const *planes; /* of borders to be filled */
    int count, far;
    float *const *now; /* what is blurred next: st->light at first, st->now later */
    bool down;
    bool strength; /* keep it, too */
    bool scaled;   /* by strength */
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    _Atomic int64_t rays, pixels;
};

static void rows(struct pass *p, int height, void (*task)(void *arg, int band, int worker))
{
    pell_pool_run(p->st->pool, (height + ROWS - 1) / ROWS, task, p);
}

static void note_time(struct ts_state *st, const char *name, int64_t pixels, int64_t bytes, int64_t rays)
{
    const double now = pell_seconds();
    size_t i = 0;

    while (i < st->num_times && st->times[i].name != name)
        i++;
    if (i < TIMES) {
        struct pell_pass_time *t = &st->times[i];
        if (i == st->num_times) {
            *t = (struct pell_pass_time){ .name = name };
            st->num_times++;
        }
        t->seconds += now - st->clock;
        t->pixels += pixels;
        t->bytes += bytes;
        t->rays += rays;
    }
    st->clock = now;
}

struct texels {
    struct pell_points points;
    float ambient[16];
    ptrdiff_t at[16];
    uint32_t part; /* of the samples of lights with extent */
    int samples;
    int count;
};

static int64_t light_texels(const struct pass *p, struct texels *k)
{
    const struct ts_state *st = p->st;
    struct pell_points_light light;

    if (k->count == 0)
        return 0;
    for (int i = k->count; i < 16; i++)
        k->points.mesh[i] = PELL_NO_HIT;
    pell_renderer_light_of(st->r, p->lights, k->ambient, &k->points, st->knobs.mix, (float) p->body->atlas->mm_per_texel,
                           k->part * (uint32_t) k->samples, k->samples, &light);
    for (int i = 0; i < k->count; i++) {
        for (int c = 0; c < 3; c++)
            st->light[c][k->at[i]] = light.irradiance[c][i];
        if (p->strength)
            st->strength[k->at[i]] = light.strength[i];
    }
    k->count = 0;
    return light.rays;
}

/* Light that enters at the texels of charts, 16 at a time. Lights with extent have a pattern of samples for each number of the multisample:
 * on fine maps texels of a square of 2 x 2 share them out. */
static void light_rows(void *arg, int band, int worker)
{
    struct pass *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->body->atlas;
    const int side = ts_sky_side(a) > 1 ? 2 : 1, samples = pell_renderer_samples(st->r), parts = side == 1 ? 1 : samples < 4 ? samples : 4;
    struct texels list[4];
    uint8_t texels[TS_TILE * TS_BLOCK];
    int64_t rays = 0;

    (void) worker;
    for (int i = 0; i < parts; i++) {
        list[i].part = (uint32_t) i;
        list[i].samples = samples / parts;
        list[i].count = 0;
    }
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int c = 0; c < 3; c++)
                memset(st->light[c] + y * a->stride + a->runs[r].from * TS_BLOCK, 0,
                       (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK * sizeof(float));
    for (int y0 = band * ROWS; y0 < (band + 1) * ROWS && y0 < a->height; y0 += TS_TILE)
        for (int block = 0; block < a->blocks; block++) {
            const int count = ts_block_texels(a, y0, block, texels);
            for (int t = 0; t < count; t++) {
                const int x = block * TS_BLOCK + texels[t] % TS_BLOCK, y = y0 + texels[t] / TS_BLOCK;
                const ptrdiff_t i = y * a->stride + x;
                struct texels *k = &list[ts_sky_part(side, x, y) % (uint32_t) parts];
                if (p->faces && p->faces[a->source[i]] & TS_FACE_DARK)
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

/* All that a border reads lies inside charts: other borders may be filled by another thread just now. */
static inline void fill_border(const struct ts_atlas *a, const struct ts_fill *b, float *const *planes, int count)
{
    const float x = (float) b->x * (1.0f / TS_WHOLE), y = (float) b->y * (1.0f / TS_WHOLE);
    const float both = x * y, right = x - both, up = y - both, least = 1.0f - x - up;

    for (int c = 0; c < count; c++) {
        const float *from = planes[c] + b->from, *above = from + a->stride;
        planes[c][b->at] = least * from[0] + right * from[1] + up * above[0] + both * above[1];
    }
}

static inline void mend_border(const struct ts_atlas *a, const struct ts_fill *b, float *const *planes, int count)
{
    float sum[TS_PLANES] = { 0 };

    for (const struct ts_part *part = a->parts + b->from; part < a->parts + b->from + b->parts; part++)
        for (int c = 0; c < count; c++)
            sum[c] += part->weight * planes[c][part->at];
    for (int c = 0; c < count; c++)
        planes[c][b->at] = sum[c];
}

static inline void fill_square(const struct pass *p, size_t square, int count)
{
    const struct ts_atlas *a = p->body->atlas;
    float *planes[TS_PLANES];

    for (int c = 0; c < count; c++)
        planes[c] = p->planes[c];
    for (size_t i = a->first_border[square]; i < a->first_mended[square] && a->fills[i].far <= p->far; i++) {
        for (int c = 0; c < count; c++) {
            __builtin_prefetch(planes[c] + a->fills[i + TS_AHEAD].from);
            __builtin_prefetch(planes[c] + a->fills[i + TS_AHEAD].at, 1);
        }
        fill_border(a, &a->fills[i], planes, count);
    }
    for (size_t i = a->first_mended[square]; i < a->first_border[square + 1] && a->fills[i].far <= p->far; i++)
        mend_border(a, &a->fills[i], planes, count);
}

static void fill_borders(void *arg, int chunk, int worker)
{
    const struct pass *p = arg;
    const struct ts_atlas *a = p->body->atlas;
    const size_t end = (size_t) (chunk + 1) * SQUARES < a->num_squares ? (size_t) (chunk + 1) * SQUARES : a->num_squares;

    (void) worker;
    for (size_t s = (size_t) chunk * SQUARES; s < end; s++)
        if (p->count == 4)
            fill_square(p, s, 4);
        else if (p->count == 3)
            fill_square(p, s, 3);
        else
            fill_square(p, s, p->count);
}

/* `far`: of borders those that are no further from charts. */
static void fill(struct pass *p, float *const *planes, int count, int far)
{
    p->planes = planes;
    p->count = count;
    p->far = far;
    pell_pool_run(p->st->pool, (int) ((p->body->atlas->num_squares + SQUARES - 1) / SQUARES), fill_borders, p);
}

static void blur_rows(void *arg, int band, int worker)
{
    const struct pass *p = arg;
    const struct ts_atlas *a = p->body->atlas;

    (void) worker;
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
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
    const struct pass *p = arg;
    struct ts_state *st = p->st;
    const struct ts_atlas *a = p->body->atlas;

    (void) worker;
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++) {
            const ptrdiff_t at = y * a->stride + a->runs[r].from * TS_BLOCK;
            const size_t n = (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK;
            for (int c = 0; c < st->work.planes - 2; c++)
                if (c < p->count)
                    memcpy(st->now[c] + at, p->now[c] + at, n * sizeof(float));
                else
                    memset(st->now[c] + at, 0, n * sizeof(float));
            for (ptrdiff_t i = at; i < at + (ptrdiff_t) n; i++) {
                const float lx = st->work.length[0][i], ly = st->work.length[1][i], lean = st->knobs.stretch ? a->lean[i] * lx : 0.0f;
                st->now[4][i] = lx > 0.0f ? 1.0f / lx : 0.0f;
                st->now[5][i] = lx > 0.0f ? 1.0f / sqrtf(ly * ly + lean * lean) : 0.0f;
            }
        }
}

/* --- What comes through ---------------------------------------------------------------------------------------------------------- */

static void thin_out(void *arg, int chunk, int worker)
{
    const struct pass *p = arg;
    struct ts_state *st = p->st;
    const struct ts_profile *profile = p->body->profile;
    const size_t end = (size_t) (chunk + 1) * CHUNK < st->tsm.count ? (size_t) (chunk + 1) * CHUNK : st->tsm.count;
    const bool linear = st->knobs.fade == TS_FADE_LINEAR;
    const float reach = FADE * (float) sqrt(profile->variance[p->level]), falloff = -0.5f / (float) profile->variance[p->level];

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        struct ts_through_texel *t = &st->tsm.texels[i];
        const float alpha = p->now[3][t->at], strength = p->scaled ? st->strength[t->at] : 1.0f;
        /* Of A's light the blurs bring exp(-s^2/(2 v)) along the surface, where the straight way brings exp(-m^2/(2 v)). */
        float near = linear ? fminf(t->apart / reach, 1.0f) : -expm1f(fmaxf(t->apart * t->apart - t->m * t->m, 0.0f) * falloff);
        near += t->round ? 0.0f : (1.0f - near) * t->opposed;
        t->share[0] = t->share[1] = t->share[2] = 0.0f;
        if (!(alpha > 0.0f) || !(strength > 0.0f))
            continue;
        ts_profile_through(profile, p->level, fmaxf(-logf(alpha), 0.0f) * (float) profile->widest / strength, t->opposed, t->share);
        for (int c = 0; c < 3; c++)
            t->share[c] *= near;
    }
}

static void add_through(void *arg, int chunk, int worker)
{
    const struct pass *p = arg;
    struct ts_state *st = p->st;
    const size_t end = (size_t) (chunk + 1) * CHUNK < st->tsm.count ? (size_t) (chunk + 1) * CHUNK : st->tsm.count;
    const float *const planes[3] = { p->now[0], p->now[1], p->now[2] };
    float *const *out = st->knobs.soften ? st->behind : st->sum;

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        const struct ts_through_texel *t = &st->tsm.texels[i];
        float rgb[3];
        if (!(t->share[0] > 0.0f || t->share[1] > 0.0f || t->share[2] > 0.0f))
            continue;
        ts_read(p->body->atlas, &t->from, planes, 3, rgb);
        if (t->part > 0.0f) {
            float also[3];
            ts_read(p->body->atlas, &t->also, planes, 3, also);
            for (int c = 0; c < 3; c++)
                rgb[c] += t->part * (also[c] - rgb[c]);
        }
        for (int c = 0; c < 3; c++)
            out[c][t->at] += t->share[c] * rgb[c];
    }
}

/* --- The chain ------------------------------------------------------------------------------------------------------------------- */

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
static void reach_of(const struct pass *p, const struct blur *b, int *blurred, int *filled)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;
    float reach[2], aside;

    *blurred = *filled = TS_FAR - 1;
    w.before = (float) b->before;
    w.after = (float) b->after;
    for (int k = 0; k < 2; k++)
        reach[k] = floorf(st->kernels->reach(&w, st->least[k]));
    aside = ceilf(reach[1] * st->lean);
    if (w.planes > 4 || !(reach[0] + reach[1] + aside + 1.0f < (float) TS_FAR))
        return;
    *blurred = (int) fmaxf(reach[1], aside);
    *filled = (int) fmaxf(reach[1], aside + reach[0]);
}

/* Along and down, from p->now to st->now; adds the result to the sum, weighted. Borders must hold what the blur needs. */
static void blur_planes(struct pass *p, const struct blur *b, int64_t *texels)
{
    struct ts_state *st = p->st;
    struct ts_work *w = &st->work;
    const struct ts_atlas *a = p->body->atlas;
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
        rows(p, a->height, blur_rows);
    }
    p->now = st->now;
    *texels = 2 * a->inner + (int64_t) a->within[blurred] + (int64_t) a->within[filled];
}

/* Fills the borders of p->now so far as the next blur needs it, and so that it can be read anywhere in charts. */
static void fill_for(struct pass *p, const struct blur *next, int planes)
{
    int blurred, filled = 1;

    if (next)
        reach_of(p, next, &blurred, &filled);
    fill(p, p->now, planes, filled > 1 ? filled : 1);
}

/* Before the first blur: what is blurred is in `from`. */
static void start(struct pass *p, float *const *from, int planes)
{
    struct ts_state *st = p->st;

    st->work.planes = st->knobs.kernel == TS_KERNEL_SEVEN ? 6 : planes;
    p->now = from;
    if (st->work.planes == 6) {
        p->count = planes;
        rows(p, p->body->atlas->height, start_rows);
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
static bool reaches(const struct pass *p, const struct blur *b)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;

    w.before = (float) b->before;
    w.after = (float) b->after;
    return w.planes > 4 || st->kernels->reach(&w, st->least[0]) > 0.0f || st->kernels->reach(&w, st->least[1]) > 0.0f;
}

static int list_levels(const struct pass *p, bool local, struct level *out)
{
    const struct ts_profile *profile = p->body->profile;
    const double finest = 1.0 / (p->body->atlas->mm_per_texel * p->body->atlas->mm_per_texel);
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
        out[count] = (struct level){ i, false, { before, profile->variance[i], local && !none && !still ? weight : NULL } };
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
    const struct pass *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->body->atlas;

    (void) worker;
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int c = 0; c < 3; c++) {
                const ptrdiff_t at = y * a->stride + a->runs[r].from * TS_BLOCK;
                const float *from = p->now[c] + at;
                float *restrict sum = st->sum[c] + at;
                for (int i = 0; i < (a->runs[r].to - a->runs[r].from) * TS_BLOCK; i++)
                    sum[i] += st->work.weight[c] * from[i];
            }
}

/* Blurs what is in st->light; `through`: and its alpha, and adds what comes through; `local`: adds what does not. */
static void chain(struct pass *p, bool local, bool through)
{
    struct ts_state *st = p->st;
    const int planes = through ? 4 : 3, chunks = (int) ((st->tsm.count + CHUNK - 1) / CHUNK);
    struct level levels[TS_LEVELS];
    int number = 0, count;

    start(p, st->light, planes);
    count = list_levels(p, local, levels);
    fill_for(p, next_blur(levels, 0, count), planes);
    for (int i = 0; i < count; i++) {
        const struct blur *b = &levels[i].blur;
        int64_t texels = 0;
        p->level = levels[i].number;
        if (through)
            pell_pool_run(st->pool, chunks, thin_out, p);
        if (levels[i].blurs) {
            blur_planes(p, b, &texels);
            if (through || i + 1 < count)
                fill_for(p, next_blur(levels, i + 1, count), planes);
            note_time(st, level_name(number++), texels, 8 * texels * st->work.planes, 0);
        } else if (b->weight) {
            for (int c = 0; c < 3; c++)
                st->work.weight[c] = (float) b->weight[c];
            rows(p, p->body->atlas->height, sum_rows);
            note_time(st, "unblurred", p->body->atlas->inner, 36 * p->body->atlas->inner, 0);
        }
        if (through) {
            pell_pool_run(st->pool, chunks, add_through, p);
            note_time(st, "through", (int64_t) st->tsm.count, (int64_t) st->tsm.count * 80, 0);
        }
    }
}

/* What comes through is at least as smooth as the way is long. */
static void soften(struct pass *p)
{
    static const double whole[3] = { 1.0, 1.0, 1.0 };
    struct ts_state *st = p->st;
    const struct blur blur = { 0.0, SOFT * SOFT * p->body->profile->widest * p->body->profile->widest, whole };
    int64_t texels;

    start(p, st->behind, 3);
    fill_for(p, &blur, 3);
    blur_planes(p, &blur, &texels);
    note_time(st, "soften", texels, 8 * texels * st->work.planes, 0);
}

static bool has_sky(const struct pell_scene *scene, uint64_t lights)
{
    for (size_t i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].type == PELL_LIGHT_ENVIRONMENT && (lights == 0 || (lights >> (i < 63 ? i : 63) & 1)))
            return true;
    return false;
}

/* Between chains: what they work in holds what of the sky is seen. */
static void look_for_light(struct pass *p, uint64_t lights, const uint8_t *faces)
{
    struct ts_state *st = p->st;
    const struct ts_atlas *a = p->body->atlas;

    if (!p->strength && has_sky(pell_renderer_scene(st->r), lights)) {
        const struct ts_sky_params sky = {
            .r = st->r,
            .atlas = a,
            .seed = pell_renderer_seed(st->r),
            .seen = st->half[0],
            .spare = st->half[1],
        };
        const int64_t rays = ts_sky_look(&sky);
        note_time(st, "map sky", a->inner, a->inner * 24, rays);
    }
    p->lights = lights;
    p->faces = faces;
    atomic_store(&p->rays, 0);
    rows(p, a->height, light_rows);
    note_time(st, "map light", a->inner, a->inner * 24, atomic_load(&p->rays));
}

/* Lengths over strength: what scatters less far lies further apart. Without `stretch` all texels are as long as their mean. */
static void scale_lengths(struct pass *p, bool strength)
{
    struct ts_state *st = p->st;
    const struct ts_atlas *a = p->body->atlas;
    float *const plane[1] = { st->strength };

    if (strength) {
        p->strength = true;
        look_for_light(p, 0, NULL);
        p->strength = false;
        fill(p, plane, 1, TS_FAR - 1);
    }
    for (int y = 0; y < a->height; y++)
        for (int b = 0; b < a->blocks; b++) {
            struct ts_cell *cell = &st->cells[(ptrdiff_t) y * a->blocks + b];
            *cell = a->cells[(ptrdiff_t) y * a->blocks + b];
            cell->lean = st->knobs.stretch ? cell->lean : 0.0f;
            cell->least[0] = cell->least[1] = cell->most[0] = cell->most[1] = 0.0f;
            for (int i = 0; i < 2 * TS_BLOCK; i++) {
                const ptrdiff_t at = y * a->stride + b * TS_BLOCK + i / 2;
                const int k = i % 2;
                const float s = strength ? fmaxf(st->strength[at], STRENGTH_LEAST) : 1.0f;
                const bool is = a->key[at] > 0.0f;
                const float length = !is ? 0.0f : (st->knobs.stretch ? a->length[k][at] : (float) a->mm_per_texel) / s;
                st->scaled[k][at] = length;
                if (!is)
                    continue;
                cell->least[k] = cell->most[k] > 0.0f ? fminf(cell->least[k], length) : length;
                cell->most[k] = fmaxf(cell->most[k], length);
            }
        }
    for (int k = 0; k < 2; k++)
        st->work.length[k] = st->scaled[k];
    st->work.cells = st->cells;
}

/* What is added to begins with nothing. Planes are any body's: of another nothing may be seen in the rest. */
static void clear_rows(void *arg, int band, int worker)
{
    const struct pass *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->body->atlas;
    float *const added[6] = { st->sum[0], st->sum[1], st->sum[2], st->behind[0], st->behind[1], st->behind[2] };
    const ptrdiff_t from = band * ROWS * a->stride - (band == 0 ? TS_MARGIN : 0);
    const ptrdiff_t to = (band + 1) * ROWS < a->height ? (band + 1) * ROWS * a->stride : (ptrdiff_t) a->size - TS_MARGIN;

    (void) worker;
    for (int c = 0; c < 6; c++)
        for (int y = band * ROWS; added[c] && y < (band + 1) * ROWS && y < a->height; y++)
            for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
                memset(added[c] + y * a->stride + a->runs[r].from * TS_BLOCK, 0,
                       (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK * sizeof(float));
    for (int c = 0; c < TS_PLANES && st->bodies->count > 1; c++)
        if (st->now[c]) {
            memset(st->now[c] + from, 0, (size_t) (to - from) * sizeof(float));
            memset(st->half[c] + from, 0, (size_t) (to - from) * sizeof(float));
        }
    for (int c = 0; c < LIT && st->bodies->count > 1; c++)
        if (st->light[c])
            memset(st->light[c] + from, 0, (size_t) (to - from) * sizeof(float));
}

/* What blurs reach hangs on the shortest texels. */
static void find_least(struct ts_state *st, const struct ts_atlas *a)
{
    st->least[0] = st->least[1] = INFINITY;
    st->lean = 0.0f;
    for (ptrdiff_t i = 0; i < (ptrdiff_t) a->blocks * a->height; i++) {
        const struct ts_cell *cell = &st->work.cells[i];
        if (!(cell->most[0] > 0.0f))
            continue;
        for (int k = 0; k < 2; k++)
            st->least[k] = fminf(st->least[k], cell->least[k]);
        st->lean = fmaxf(st->lean, fabsf(cell->lean));
    }
}

static void store_rows(void *arg, int band, int worker)
{
    const struct pass *p = arg;
    const struct ts_atlas *a = p->body->atlas;

    (void) worker;
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int b = a->runs[r].from; b < a->runs[r].to; b++) {
                const ptrdiff_t first = y * a->stride + b * TS_BLOCK;
                if (a->cells[(ptrdiff_t) y * a->blocks + b].near > READ_FAR)
                    continue;
                for (ptrdiff_t at = first; at < first + TS_BLOCK; at++) {
                    float *out = p->body->map + 4 * at;
                    for (int c = 0; c < 3; c++)
                        out[c] = p->st->sum[c][at];
                    out[3] = a->key[at];
                }
            }
}

static enum pell_result light_body(struct ts_state *st, size_t number)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    struct ts_body *body = &st->body[number];
    const struct ts_atlas *a = body->atlas;
    struct pass p = { .st = st, .body = body };
    uint64_t rest = 0;
    int shining = 0;
    bool local = true, comes_through = false;
    enum pell_result res;

    st->clock = pell_seconds();
    rows(&p, a->height, clear_rows);
    st->work = (struct ts_work){
        .width = a->width,
        .height = a->height,
        .blocks = a->blocks,
        .stride = a->stride,
        .key = a->key,
        .cells = a->cells,
        .length = { a->length[0], a->length[1] },
        .tilt = { a->tilt[0], a->tilt[1] },
        .tilts = st->knobs.stretch,
        .grid = st->knobs.kernel == TS_KERNEL_DENSE ? GRID_VARIANCE : 0.0f,
    };
    p.scaled = scaled_strength(st, (int32_t) number);
    if (p.scaled || !st->knobs.stretch)
        scale_lengths(&p, p.scaled);
    if (st->knobs.tsm != TS_TSM_OFF)
        ts_tsm_start(a, &st->tsm);
    find_least(st, a);
    note_time(st, "start", 0, 0, 0);
    if (st->knobs.lights == TS_LIGHTS_SUM)
        look_for_light(&p, 0, NULL);
    for (size_t i = 0; i < scene->num_lights; i++) {
        const uint64_t bit = (uint64_t) 1 << (i < 63 ? i : 63);
        struct ts_tsm_params t = {
            .r = st->r,
            .bodies = st->bodies,
            .body = (int32_t) number,
            .atlas = a,
            .light = &scene->lights[i],
            .fan = pell_renderer_fan(st->r, i),
            .form = st->knobs.tsm,
            .size = st->knobs.tsm_size,
            .thickest = body->profile->thickest,
            .falloff = body->profile->widest,
        };
        int64_t rays = 0;
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        rest |= bit;
        if (scene->lights[i].type == PELL_LIGHT_ENVIRONMENT || st->knobs.tsm == TS_TSM_OFF || shining == LIGHTS_MOST || i >= 63)
            continue;
        shining++;
        ts_tsm_face(&t, &st->tsm);
        PELL_TRY(ts_tsm_make(&t, st->light[3], &st->tsm, &rays));
        note_time(st, "tsm", a->inner, a->inner * 40, rays);
        if (st->tsm.count == 0)
            continue;
        if (st->knobs.lights == TS_LIGHTS_OWN) {
            const float *const lit[3] = { st->light[0], st->light[1], st->light[2] };
            rest &= ~bit;
            look_for_light(&p, bit, st->tsm.faces);
            rays = 0;
            PELL_TRY(ts_tsm_light(&t, lit, st->light[3], &st->tsm, &rays));
            note_time(st, "tsm", 0, 0, rays);
        }
        chain(&p, local, true);
        comes_through = true;
        local = st->knobs.lights == TS_LIGHTS_OWN;
    }
    st->tsm.count = 0;
    if (st->knobs.lights == TS_LIGHTS_OWN && rest)
        look_for_light(&p, rest, NULL);
    if (local && rest)
        chain(&p, true, false);
    if (comes_through && st->knobs.soften)
        soften(&p);
    fill(&p, st->sum, 3, READ_FAR);
    rows(&p, a->height, store_rows);
    note_time(st, "start", a->inner, a->inner * 28, 0);
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

/* --- Pixels ---------------------------------------------------------------------------------------------------------------------- */

/* Where the four texels around say nothing: the nearest ones that do, of the chart or else of any. */
static void look_around(const struct ts_atlas *a, const float *map, const struct ts_place *p, float rgb[3])
{
    const int px = (int) (p->at % a->stride), py = (int) (p->at / a->stride);

    for (int any = 0; any < 2; any++)
        for (int reach = 1; reach <= 4; reach++) {
            float sum[3] = { 0 }, n = 0.0f;
            for (int y = py - reach + 1; y <= py + reach; y++)
                for (int x = px - reach + 1; x <= px + reach; x++) {
                    const float *t = map + 4 * (y * a->stride + x);
                    if (x < 0 || y < 0 || x >= a->width || y >= a->height || !(any ? t[3] > 0.0f : t[3] == p->key))
                        continue;
                    for (int c = 0; c < 3; c++)
                        sum[c] += t[c];
                    n += 1.0f;
                }
            if (n > 0.0f) {
                for (int c = 0; c < 3; c++)
                    rgb[c] = sum[c] / n;
                return;
            }
        }
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
}

static void read_map(const struct ts_body *body, uint32_t triangle, float u, float v, float rgb[3])
{
    const struct ts_atlas *a = body->atlas;
    const struct ts_place p = ts_atlas_place(a, triangle, u, v);
    const float w[4] = { (1.0f - p.fx) * (1.0f - p.fy), p.fx * (1.0f - p.fy), (1.0f - p.fx) * p.fy, p.fx * p.fy };
    const float *t;
    float sum = 0.0f;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (p.at < 0)
        return;
    t = body->map + 4 * (ptrdiff_t) p.at;
    for (int i = 0; i < 4; i++) {
        const float *at = t + 4 * (i % 2 + i / 2 * a->stride);
        if (at[3] != p.key)
            continue;
        sum += w[i];
        for (int c = 0; c < 3; c++)
            rgb[c] += w[i] * at[c];
    }
    if (!(sum > 1e-6f)) {
        look_around(a, body->map, &p, rgb);
        return;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] /= sum;
}

static void gather_rows(void *arg, int band, int worker)
{
    struct pass *p = arg;
    struct ts_state *st = p->st;
    const struct pell_frame *in = p->in;
    int64_t pixels = 0;

    (void) worker;
    for (int y = in->rect.y0 + band * ROWS; y < in->rect.y0 + (band + 1) * ROWS && y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t at = y * in->stride + x;
            const uint32_t mesh = in->material[at] ? in->mesh[at] : PELL_NO_HIT;
            const int32_t number = mesh < st->bodies->num_meshes ? st->bodies->of_mesh[mesh] : -1;
            const struct ts_body *body = number >= 0 ? &st->body[number] : NULL;
            float rgb[3] = { 0 };
            if (!in->material[at])
                continue;
            pixels++;
            if (body && body->atlas) {
                read_map(body, body->atlas->first[mesh] + in->triangle[at], in->barycentric[0][at], in->barycentric[1][at], rgb);
                if (st->knobs.first == TS_FIRST_UNBLURRED)
                    for (int i = 0, done = 0; i < body->profile->count && !done; i++) {
                        const double *weight = body->profile->weight[i];
                        done = weight[0] > 0.0 || weight[1] > 0.0 || weight[2] > 0.0;
                        for (int c = 0; c < 3; c++)
                            rgb[c] += (float) weight[c] * in->irradiance[c][at];
                    }
            }
            for (int c = 0; c < 3; c++)
                p->out->light[c][at] = rgb[c];
        }
    atomic_fetch_add_explicit(&p->pixels, pixels, memory_order_relaxed);
}

/* Lights may come and go while the map stays: once for each number of them that is too many. */
static void warn_of_lights(struct ts_state *st)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    size_t lights = 0;

    for (size_t i = 0; i < scene->num_lights; i++)
        lights += scene->lights[i].type != PELL_LIGHT_ENVIRONMENT;
    if (lights > LIGHTS_MOST && lights != st->warned && st->knobs.tsm != TS_TSM_OFF)
        pell_warn(st->ctx, "texture-space", "leave out the dimmest", "%zu lights, the first %d of them shine through thin parts", lights,
                  LIGHTS_MOST);
    st->warned = lights;
}

static enum pell_result ts_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct ts_state *st = state;
    struct pass p = { .st = st, .in = in, .out = out };
    enum pell_result res;

    st->num_times = 0;
    if (st->lit != pell_renderer_lights(st->r)) {
        st->lit = 0;
        warn_of_lights(st);
        for (size_t i = 0; i < st->bodies->count; i++)
            if (st->body[i].atlas)
                PELL_TRY(light_body(st, i));
        st->lit = pell_renderer_lights(st->r);
    }
    st->clock = pell_seconds();
    rows(&p, in->rect.y1 - in->rect.y0, gather_rows);
    note_time(st, "gather", atomic_load(&p.pixels), atomic_load(&p.pixels) * (4 * 16 + 16 + 12), 0);
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

static size_t ts_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct ts_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        list[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

const struct pell_method_engine pell_ts_cpu = { .create = ts_create, .render = ts_render, .destroy = ts_destroy, .times = ts_times };
