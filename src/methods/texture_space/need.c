/* SPDX-License-Identifier: MIT
 *
 * need.c - the texels that an image needs: those its pixels read, and those that blurs, borders and transmission reach from there. Culling
 * of invisible surface, as Jimenez and Gutierrez 2008 recommend for texture space, per texel instead of per chart.
 *
 * A map of incident light is stage 1 of a chain; each blur adds two stages, along rows and down columns. A texel is needed up to a stage:
 * the farther it is from the visible texels, the fewer stages. The set grows from the last stage to the first.
 */
#include "methods/texture_space/state.h"

#include "math/sampling.h"

#include <stdatomic.h>
#include <string.h>

enum { SEEN_NOT, SEEN_MISSING, SEEN_MADE };
enum { AROUND = 4 };       /* texels: search radius of read_map.c */
enum { SEEN_DIVISOR = 4 }; /* if more than 1/SEEN_DIVISOR of a solid is visible, culling costs more than it saves */
enum { STRIP = 128 };      /* columns per task */

/* --- Texels read by pixels ------------------------------------------------------------------------------------------------------- */

static void see_texel(struct ts_solid *solid, ptrdiff_t at)
{
    _Atomic uint8_t *seen = &solid->seen[at];

    if (atomic_load_explicit(seen, memory_order_relaxed) == SEEN_MADE)
        return;
    atomic_store_explicit(seen, SEEN_MISSING, memory_order_relaxed);
    atomic_store_explicit(&solid->missing, true, memory_order_relaxed);
}

/* The texels that read_map.c reads for a surface point. */
static void see_point(struct ts_state *st, uint32_t mesh, uint32_t triangle, float u, float v)
{
    const int32_t index = mesh < st->solids->num_meshes ? st->solids->of_mesh[mesh] : -1;
    struct ts_solid *solid = index >= 0 ? &st->solid[index] : NULL;
    const struct ts_atlas *a = solid ? solid->atlas : NULL;
    struct ts_bilinear p;
    float sum = 0.0f;

    if (!a || solid->made == TS_MADE_COMPLETE)
        return;
    p = ts_atlas_locate(a, a->first[mesh] + triangle, u, v);
    if (p.at < 0)
        return;
    for (int i = 0; i < 4; i++) {
        const ptrdiff_t at = p.at + i % 2 + i / 2 * a->stride;
        if (a->key[at] != p.key)
            continue;
        sum += (i % 2 ? p.fx : 1.0f - p.fx) * (i / 2 ? p.fy : 1.0f - p.fy);
        see_texel(solid, at);
    }
    if (sum > 1e-6f)
        return;
    for (ptrdiff_t y = p.at / a->stride - AROUND; y <= p.at / a->stride + AROUND; y++)
        for (ptrdiff_t x = p.at % a->stride - AROUND; x <= p.at % a->stride + AROUND; x++)
            if (x >= 0 && y >= 0 && x < a->width && y < a->height && a->key[y * a->stride + x] > 0.0f)
                see_texel(solid, y * a->stride + x);
}

struct seeing {
    struct ts_state *st;
    const struct pell_frame *in;
    struct pell_view view;
    struct pell_rect rect;
};

static void see_rows(void *arg, int band, int worker)
{
    const struct seeing *p = arg;
    const struct pell_frame *in = p->in;

    (void) worker;
    for (int y = in->rect.y0 + band * TS_ROWS; y < in->rect.y0 + (band + 1) * TS_ROWS && y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t at = y * in->shape.stride + x;
            if (in->material[at])
                see_point(p->st, in->mesh[at], in->triangle[at], in->barycentric[0][at], in->barycentric[1][at]);
        }
}

/* The same for a later sample of the multisample, by rays. */
static void trace_rows(void *arg, int band, int worker)
{
    const struct seeing *p = arg;
    _Alignas(64) int valid[16];
    struct pell_ray_hit16 hit;

    (void) worker;
    for (int y = p->rect.y0 + band * TS_ROWS; y < p->rect.y0 + (band + 1) * TS_ROWS && y < p->rect.y1; y++)
        for (int x = p->rect.x0; x < p->rect.x1; x += 16) {
            pell_view_closest16(&p->view, p->st->services->rays, x, p->rect.x1, y, PELL_RAY_ALL, valid, &hit);
            for (int i = 0; i < 16; i++)
                if (valid[i] && hit.hit.mesh[i] != PELL_NO_HIT)
                    see_point(p->st, hit.hit.mesh[i], hit.hit.triangle[i], hit.hit.u[i], hit.hit.v[i]);
        }
}

/* Rays for later samples cost less than they save if there are no more of them than texels. */
static bool traces_ahead(const struct ts_state *st, const struct pell_frame *in)
{
    const int64_t pixels = (int64_t) (in->rect.x1 - in->rect.x0) * (in->rect.y1 - in->rect.y0);
    int64_t texels = 0;

    for (size_t i = 0; i < st->solids->count; i++)
        texels += st->solid[i].atlas ? st->solid[i].atlas->inner : 0;
    return (in->num_samples - 1) * pixels <= texels;
}

bool ts_need_enabled(const struct ts_state *st, const struct pell_frame *in)
{
    return st->knobs.cull && st->run->culls && st->knobs.kernel == TS_KERNEL_DENSE && !st->reused && !st->services->observer &&
           (in->num_samples <= 1 || traces_ahead(st, in));
}

void ts_need_mark_visible(struct ts_state *st, const struct pell_frame *in)
{
    struct seeing p = { .st = st, .in = in, .rect = in->rect };

    ts_rows(st, in->rect.y1 - in->rect.y0, see_rows, &p);
}

void ts_need_mark_later(struct ts_state *st, const struct pell_frame *in)
{
    struct seeing p = { .st = st, .in = in, .rect = in->rect };

    p.rect.x0 -= p.rect.x0 > 0;
    p.rect.y0 -= p.rect.y0 > 0;
    p.rect.x1 += p.rect.x1 < in->shape.width;
    p.rect.y1 += p.rect.y1 < in->shape.height;
    for (int i = in->sample + 1; i < in->num_samples; i++) {
        p.view = *in->view;
        pell_golden_grid(i, in->num_samples, &p.view.shift_x, &p.view.shift_y);
        ts_rows(st, p.rect.y1 - p.rect.y0, trace_rows, &p);
    }
}

bool ts_need_pays(const struct ts_solid *solid)
{
    const struct ts_atlas *a = solid->atlas;
    int64_t count = 0;

    for (ptrdiff_t i = 0; i < a->height * a->stride; i++)
        count += a->source[i] != UINT32_MAX && atomic_load_explicit(&solid->seen[i], memory_order_relaxed) != SEEN_NOT;
    return SEEN_DIVISOR * count < a->inner;
}

void ts_need_discard(struct ts_solid *solid)
{
    solid->made = TS_MADE_NOT;
    atomic_store(&solid->missing, false);
    for (size_t i = 0; solid->atlas && i < solid->atlas->size; i++)
        atomic_store_explicit(&solid->seen[(ptrdiff_t) i - TS_MARGIN], SEEN_NOT, memory_order_relaxed);
}

/* --- Dependencies ---------------------------------------------------------------------------------------------------------------- */

/* The source texels of a border are needed where the border is. */
static void need_sources(const struct ts_atlas *a, uint8_t *stage, uint8_t from, uint8_t value)
{
    for (size_t s = 0; s < a->num_squares; s++) {
        for (size_t i = a->first_border[s]; i < a->first_with_sources[s]; i++) {
            const struct ts_fill *f = &a->fills[i];
            if (stage[f->at] < from)
                continue;
            for (int k = 0; k < 4; k++) {
                uint8_t *t = &stage[f->from + k % 2 + k / 2 * a->stride];
                *t = *t > value ? *t : value;
            }
        }
        for (size_t i = a->first_with_sources[s]; i < a->first_border[s + 1]; i++) {
            const struct ts_fill *f = &a->fills[i];
            for (int k = 0; stage[f->at] >= from && k < f->sources; k++) {
                uint8_t *t = &stage[a->sources[f->from + k].at];
                *t = *t > value ? *t : value;
            }
        }
    }
}

/* Sets that grow by the reach of a blur. */
struct growing {
    struct ts_state *st;
    const struct ts_atlas *atlas;
    const struct ts_blur *blur;
    int from, to; /* texels needed at stage `from` make the texels within reach needed at stage `to` */
    bool down;
};

static int reach_at(const struct growing *p, ptrdiff_t cell, int axis)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;
    const float length = st->work.cells[cell].least[axis];
    float reach;

    if (!(length > 0.0f))
        return 0;
    w.before = (float) p->blur->before;
    w.after = (float) p->blur->after;
    reach = st->kernels->reach(&w, length);
    return reach > 0.0f ? reach < 255.0f ? reach > 1.0f ? (int) reach : 1 : 255 : 0;
}

/* Taps stay in their texel's chart: those of a row. */
static inline void raise_chart(uint8_t *stage, const float *keys, float key, int from, int to, int value)
{
    for (int x = from; x <= to; x++)
        stage[x] = keys[x] != key || stage[x] > value ? stage[x] : (uint8_t) value;
}

/* Reach down columns, and the chart; where columns of several charts pass, any chart: 0. */
static inline void reach_down(uint8_t *wide, float *keys, float key, int from, int to, int reach)
{
    for (int x = from; x <= to; x++) {
        keys[x] = wide[x] > 0 && keys[x] != key ? 0.0f : key;
        wide[x] = wide[x] > reach ? wide[x] : (uint8_t) reach;
    }
}

/* Along rows: the set itself, or for skewed columns the reach of each texel down, wherever to the side that may be. */
static void grow_rows(void *arg, int band, int worker)
{
    const struct growing *p = arg;
    const struct ts_need *need = &p->st->need;
    const struct ts_atlas *a = p->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++) {
        const uint8_t *stage = need->stage + y * a->stride;
        uint8_t *out = (p->down ? need->wide : need->stage) + y * a->stride;
        const float *key = a->key + y * a->stride;
        if (p->down)
            memset(out, 0, (size_t) a->width);
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int b = a->runs[r].from; b < a->runs[r].to; b++) {
                const ptrdiff_t cell = (ptrdiff_t) y * a->blocks + b;
                const int end = (b + 1) * TS_BLOCK;
                int reach = -1, aside = 0;
                for (int x = b * TS_BLOCK; x < end; x++) {
                    const int first = x;
                    int low, high;
                    if (stage[x] < p->from)
                        continue;
                    while (x + 1 < end && stage[x + 1] >= p->from && key[x + 1] == key[first])
                        x++;
                    if (reach < 0) {
                        reach = reach_at(p, cell, p->down);
                        aside = p->down ? (int) (fabsf(p->st->work.cells[cell].skew) * (float) reach + 0.5f) : reach;
                    }
                    low = first > aside ? first - aside : 0;
                    high = x + aside < a->width ? x + aside : a->width - 1;
                    if (p->down)
                        reach_down(out, need->wide_key + y * a->stride, key[first], low, high, reach);
                    else
                        raise_chart(out, key, key[first], low, high, p->to);
                }
            }
    }
}

/* Down columns, one pass from each end of the map: `remaining` rows of reach remaining. */
static void grow_columns(void *arg, int strip, int worker)
{
    const struct growing *p = arg;
    const struct ts_atlas *a = p->atlas;
    const int x0 = strip * STRIP, n = a->width - x0 < STRIP ? a->width - x0 : STRIP;
    uint8_t remaining[STRIP];
    float key[STRIP] = { 0 }; /* chart that the reach belongs to */

    (void) worker;
    for (int back = 0; back < 2; back++) {
        memset(remaining, 0, sizeof(remaining));
        for (int j = 0; j < a->height; j++) {
            const ptrdiff_t row = (back ? a->height - 1 - j : j) * a->stride + x0;
            uint8_t *stage = p->st->need.stage + row;
            const uint8_t *wide = p->st->need.wide + row;
            const float *chart_key = a->key + row, *wide_key = p->st->need.wide_key + row;
            for (int i = 0; i < n; i++) {
                const uint8_t less = remaining[i] > 0 ? remaining[i] - 1 : 0;
                key[i] = wide[i] == 0 ? key[i] : remaining[i] == 0 || key[i] == wide_key[i] ? wide_key[i] : 0.0f;
                if ((remaining[i] > 0 || wide[i] > 0) && stage[i] < p->to && (key[i] == 0.0f || key[i] == chart_key[i]))
                    stage[i] = (uint8_t) p->to;
                remaining[i] = less > wide[i] ? less : wide[i];
            }
        }
    }
}

static void sum_up_cells(void *arg, int band, int worker)
{
    const struct growing *p = arg;
    const struct ts_need *need = &p->st->need;
    const struct ts_atlas *a = p->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int b = 0; b < a->blocks; b++) {
            const uint8_t *stage = need->stage + y * a->stride + b * TS_BLOCK;
            uint8_t most = 0;
            for (int i = 0; i < TS_BLOCK; i++)
                most = stage[i] > most ? stage[i] : most;
            need->cell[(ptrdiff_t) y * a->blocks + b] = most;
        }
}

/* From the texels needed after the last of some blurs to those needed before the first. */
static void grow(struct ts_state *st, const struct ts_atlas *a, const struct ts_blur *blurs, int count)
{
    struct growing p = { .st = st, .atlas = a };

    for (int i = count - 1; i >= 0; i--) {
        p.blur = &blurs[i];
        p.from = TS_NEED_DOWN(i);
        p.to = TS_NEED_ALONG(i);
        p.down = true;
        ts_rows(st, a->height, grow_rows, &p);
        pell_pool_run(st->pool, (a->width + STRIP - 1) / STRIP, grow_columns, &p);
        p.from = TS_NEED_ALONG(i);
        p.to = TS_NEED_BEFORE(i);
        p.down = false;
        ts_rows(st, a->height, grow_rows, &p);
        need_sources(a, st->need.stage, TS_NEED_BEFORE(i), TS_NEED_BEFORE(i));
    }
    ts_rows(st, a->height, sum_up_cells, &p);
}

static void set_stages(const struct ts_state *st, const struct ts_atlas *a, const uint8_t *base, int count)
{
    uint8_t *stage = st->need.stage;

    for (ptrdiff_t i = -TS_MARGIN; i < (ptrdiff_t) a->size - TS_MARGIN; i++)
        stage[i] = base[i] ? (uint8_t) TS_NEED_BEFORE(count) : 0;
}

static void need_location(const struct ts_atlas *a, const struct ts_bilinear *p, uint8_t *stage, uint8_t value)
{
    for (int i = 0; p->at >= 0 && i < 4; i++) {
        const ptrdiff_t at = p->at + i % 2 + i / 2 * a->stride;
        if (a->key[at] == p->key)
            stage[at] = value;
    }
}

void ts_need_begin(struct ts_state *st, struct ts_solid *solid)
{
    const struct ts_atlas *a = solid->atlas;
    struct ts_blur soft;
    uint8_t *shown = st->need.shown;

    for (ptrdiff_t i = -TS_MARGIN; i < (ptrdiff_t) a->size - TS_MARGIN; i++)
        shown[i] = atomic_load_explicit(&solid->seen[i], memory_order_relaxed) != SEEN_NOT;
    need_sources(a, shown, 1, 1);
    for (ptrdiff_t i = -TS_MARGIN; i < (ptrdiff_t) a->size - TS_MARGIN; i++)
        if (shown[i])
            atomic_store_explicit(&solid->seen[i], SEEN_MADE, memory_order_relaxed);
    if (st->knobs.tsm != TS_TSM_OFF && st->knobs.soften) {
        soft = ts_soft_blur(solid);
        set_stages(st, a, shown, 1);
        grow(st, a, &soft, 1);
        for (ptrdiff_t i = -TS_MARGIN; i < (ptrdiff_t) a->size - TS_MARGIN; i++)
            st->need.transmitted[i] = st->need.stage[i] > 0;
    } else {
        memcpy(st->need.transmitted - TS_MARGIN, shown - TS_MARGIN, a->size);
    }
}

void ts_need_soft(struct ts_state *st, const struct ts_solid *solid)
{
    const struct ts_blur soft = ts_soft_blur(solid);

    set_stages(st, solid->atlas, st->need.shown, 1);
    grow(st, solid->atlas, &soft, 1);
}

void ts_need_chain(struct ts_state *st, const struct ts_solid *solid, bool transmission)
{
    const struct ts_atlas *a = solid->atlas;
    struct ts_blur blurs[TS_LEVELS];
    const int count = ts_chain_blurs(st, solid, blurs);
    uint8_t *stage = st->need.stage;

    set_stages(st, a, transmission ? st->need.transmitted : st->need.shown, count);
    for (size_t i = 0; transmission && i < st->tsm.count; i++) {
        const struct ts_transmitted_texel *t = &st->tsm.texels[i];
        if (!st->need.transmitted[t->at])
            continue;
        need_location(a, &t->from, stage, (uint8_t) TS_NEED_BEFORE(count));
        if (t->second_weight > 0.0f)
            need_location(a, &t->second, stage, (uint8_t) TS_NEED_BEFORE(count));
    }
    need_sources(a, stage, (uint8_t) TS_NEED_BEFORE(count), (uint8_t) TS_NEED_BEFORE(count));
    grow(st, a, blurs, count);
}
