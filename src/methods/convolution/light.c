/* SPDX-License-Identifier: MIT
 *
 * light.c - light to planes: of pixels, and of what lies behind them.
 */
#include "methods/convolution/state.h"

#include "base/pool.h"
#include "math/vec.h"

#include <limits.h>
#include <string.h>

static float clamp(float x, float low, float high)
{
    return x < low ? low : x > high ? high : x;
}

/* A place in a table over leans. */
struct row {
    int low;
    float part;
};

static inline struct row row_of(float lean, int rows)
{
    const float s = (lean > 0.0f ? lean : 0.0f) * (float) ((rows - 1) / 0.994987437);
    const int low = s < (float) (rows - 2) ? (int) s : rows - 2;

    return (struct row){ low, clamp(s - (float) low, 0.0f, 1.0f) };
}

static inline float mix(float low, float high, float part)
{
    return low + part * (high - low);
}

/* What a pixel should get over what it gets, on the mean over places: `own` lean nearby, and another one farther away. */
static inline float lean_factor(const struct conv_response *r, struct row own, struct row far)
{
    const struct conv_lean *n = r->lean + own.low, *f = r->lean + far.low;

    return (mix(n[0].true_near, n[1].true_near, own.part) + mix(f[0].true_far, f[1].true_far, far.part)) /
           (mix(n[0].near, n[1].near, own.part) + mix(f[0].far, f[1].far, far.part));
}

/* Pixels of a plane are not as wide as those at the depth itself, t between two planes whose pixels are p and q mm wide. */
static float width_factor(const struct convolution_knobs *k, float t, float p, float q, float facing)
{
    float share = (1.0f - t) / (p * p) + t / (q * q);

    if (p == q)
        return 1.0f;
    if (k->restore == CONV_RESPONSE) {
        const float own = (1.0f - t) * (1.0f - t) + t * t, all = 1.0f / (facing * facing), other = all > own ? all - own : 0.0f;
        share = ((1.0f - t) * (1.0f - t) / (p * p) + t * t / (q * q) + other / (p * q)) / (own + other);
    }
    return 1.0f / ((p + t * (q - p)) * sqrtf(share));
}

/* What light weighs where it enters and where it leaves, of each channel: areas in pixels of the middle, and what splitting and gathering
 * give back of a flat surface's light. By its place among the planes: half of the factor where light enters, half where it leaves; by its
 * lean, on the mean over places: all where it enters, as a pixel that leans alone has no neighbours that give it more. What is near knows
 * the pixel's own lean, what is farther that over some distance, `far`. `leaves` may be NULL. */
static void weigh(const struct convolution_state *st, float place, float area, float lean, float far, float enters[3], float leaves[3])
{
    const struct conv_job *j = &st->job;
    const struct conv_layout *lay = &j->layout;
    const int plane = (int) place, next = plane + 1 < lay->planes ? plane + 1 : plane;
    const float t = place - (float) plane, u = t * (CONV_PHASES - 1), pixels = clamp(area / (lay->unit * lay->unit), 1e-4f, 1e5f);
    const struct row at = row_of(lean, CONV_LEANS), own_at = row_of(lean, CONV_FINE), far_at = row_of(far, CONV_FINE);
    const int b = u < CONV_PHASES - 2 ? (int) u : CONV_PHASES - 2;
    const float fu = u - (float) b, sideways = lean < 0.0f ? 1.0f - lean : 1.0f;
    float wide = width_factor(&st->knobs, t, lay->pixel[plane], lay->pixel[next], 1.0f);

    for (int c = 0; c < 3; c++) {
        const struct conv_response *r = &j->set->response[c][j->set->num_responses > 1 ? plane : 0];
        const float *low = r->place[at.low] + b, *high = r->place[at.low + 1] + b;
        const float by_place = mix(mix(low[0], low[1], fu), mix(high[0], high[1], fu), at.part);
        enters[c] = pixels;
        if (leaves)
            leaves[c] = 1.0f;
        if (st->knobs.restore == CONV_LOST || j->divide)
            continue;
        if (st->knobs.restore == CONV_RESPONSE)
            wide = width_factor(&st->knobs, t, lay->pixel[plane], lay->pixel[next], mix(r->place[0][b], r->place[0][b + 1], fu));
        enters[c] *= by_place * lean_factor(r, own_at, far_at) * sideways * wide;
        if (leaves)
            leaves[c] = by_place * wide;
    }
}

/* Of a pixel, over the distance with half of the light inside, of all channels together; no more than its own. */
static float far_lean(const struct convolution_state *st, int x, int y)
{
    const struct conv_job *j = &st->job;
    const float own = st->sources.front.lean[y * st->sources.front.stride + x];
    const float per_mm = j->in->focal_px / (j->in->orthographic ? 1.0f : j->in->depth[y * j->in->stride + x]);

    return own > 0.0f ? fminf(own, convolution_lean_over(&st->sources, x, y, (int) clamp(j->median * per_mm + 0.5f, 1.0f, 65536.0f))) : own;
}

static float reaches(const struct conv_job *j, int channel, float distance)
{
    const float s = sqrtf(distance / j->widest) * CONV_DISTANCES, *table = j->arrives_over[channel];
    const int i = s < CONV_DISTANCES - 1 ? (int) s : CONV_DISTANCES - 1;

    return table[i] + clamp(s - (float) i, 0.0f, 1.0f) * (table[i + 1] - table[i]);
}

/* What light behind weighs. Kept apart, as much of it as is missing at the pixel before it goes to that pixel's place. */
static void weigh_behind(const struct convolution_state *st, size_t i, int x, int y)
{
    const struct conv_job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const float q = b->place[i], lean = b->lean[i];
    const bool before = x < j->extent.rect.x1 && f->group[y * f->stride + x] == j->group + 1;
    float enters[3], close[3];

    for (int c = 0; c < 3; c++)
        b->close[c][i] = 0.0f;
    if (!j->behind) {
        weigh(st, q, b->area[i], lean, lean, enters, NULL);
    } else { /* kernels that begin at some distance know nothing of leans */
        const float none = lean < 0.0f ? lean : 0.0f;
        weigh(st, q, b->area[i], none, none, enters, NULL);
    }
    if (j->behind && before && j->layout.planes > 1) {
        const float p = f->place[y * f->stride + x], distance = b->depth[i] - j->in->depth[y * j->in->stride + x];
        weigh(st, q, b->area[i], lean, fminf(lean, far_lean(st, x, y)), close, NULL);
        for (int c = 0; c < 3; c++) {
            float there = 0.0f, share;
            for (int to = (int) p; to < j->layout.planes && to <= (int) p + 1; to++)
                for (int from = (int) q; from < j->layout.planes && from <= (int) q + 1; from++)
                    there += (1.0f - fabsf(p - (float) to)) * (1.0f - fabsf(q - (float) from)) * j->arrives[c][from][to];
            share = (reaches(j, c, fmaxf(distance, 0.0f)) - there) / fmaxf(1.0f - there, 1e-6f);
            share = clamp(share, 0.0f, 1.0f);
            b->close[c][i] = share * close[c];
            enters[c] *= 1.0f - share;
        }
    }
    for (int c = 0; c < 3; c++)
        b->enters[c][i] = enters[c];
}

static void weigh_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const int y = j->extent.rect.y0 + index;
    float enters[3], leaves[3];

    (void) worker;
    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++) {
        const ptrdiff_t i = y * f->stride + x;
        if (f->group[i] != j->group + 1)
            continue;
        weigh(st, f->place[i], f->area[i], f->lean[i], far_lean(st, x, y), enters, leaves);
        for (int c = 0; c < 3; c++) {
            f->enters[c][i] = enters[c];
            f->leaves[c][i] = leaves[c];
        }
    }
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++) {
        const size_t row = ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width;
        for (int x = j->x0 / b->step; x <= (j->extent.rect.x1 - 1) / b->step; x++)
            if (b->group[row + (size_t) x] == j->group + 1)
                weigh_behind(st, row + (size_t) x, x * b->step > j->extent.rect.x0 ? x * b->step : j->extent.rect.x0, y);
    }
}

/* Shares of the light that go from plane to plane, and as far as light behind is. */
static void measure_arrivals(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const struct conv_layout *lay = &j->layout;

    j->widest = fmaxf(lay->depth[lay->planes - 1] - lay->depth[0], 1e-20f);
    for (int c = 0; c < 3; c++) {
        const struct conv_radial *r = &j->radial[c];
        const float per = r->total > 0.0f ? 1.0f / r->total : 0.0f;
        for (int from = 0; from < lay->planes; from++)
            for (int to = 0; to < lay->planes; to++) {
                const float h = from == to ? fmaxf(lay->behind[c][to], 0.0f) : fabsf(lay->depth[to] - lay->depth[from]);
                j->arrives[c][from][to] = per * (float) convolution_radial_beyond(r, (double) h);
            }
        for (int i = 0; i <= CONV_DISTANCES; i++)
            j->arrives_over[c][i] =
                per * (float) convolution_radial_beyond(r, (double) j->widest * i * i / (CONV_DISTANCES * CONV_DISTANCES));
    }
}

void convolution_weigh(struct convolution_state *st)
{
    const struct conv_radial *r = st->job.radial;

    st->job.median = powf(r[0].median2, 1.0f / 6.0f) * powf(r[1].median2, 1.0f / 6.0f) * powf(r[2].median2, 1.0f / 6.0f);
    if (st->job.behind)
        measure_arrivals(st);
    pell_pool_run(st->pool, st->job.extent.rect.y1 - st->job.extent.rect.y0, weigh_row, st);
}

/* Adds light at pixel i of the images that a band marks as its own. */
static inline void add_light(const struct convolution_state *st, unsigned char *marks, ptrdiff_t i, float place, float light, bool front)
{
    const struct conv_job *j = &st->job;
    const int plane = (int) place, first = front || !j->behind ? plane : plane + j->layout.planes + j->between;
    const float t = place - (float) plane, share = st->knobs.split == CONV_HALF ? 0.5f : t;
    float *image = st->images + (size_t) first * st->image_size + i;

    marks[first] = 1;
    if (j->layout.planes == 1) {
        image[0] += light;
        return;
    }
    image[0] += (1.0f - share) * light;
    image[st->image_size] += share * light;
    marks[first + 1] = 1;
    if (j->between && front) {
        const int between = j->layout.planes + plane;
        st->images[(size_t) between * st->image_size + (size_t) i] += sqrtf(2.0f * t * (1.0f - t)) * light;
        marks[between] = 1;
    }
}

static inline void widen(struct pell_rect *lit, int x, int y)
{
    lit->x0 = x < lit->x0 ? x : lit->x0;
    lit->x1 = x >= lit->x1 ? x + 1 : lit->x1;
    lit->y0 = y < lit->y0 ? y : lit->y0;
    lit->y1 = y + 1;
}

static void spread_front(const struct convolution_state *st, unsigned char *marks, struct pell_rect *lit, int y)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const uint16_t own = (uint16_t) (j->group + 1);

    for (int py = j->y0 + y * st->step; py < j->y0 + (y + 1) * st->step; py++) {
        const float *light = j->in->irradiance[j->channel] + py * j->in->stride, *enters = f->enters[j->channel] + py * f->stride;
        const float *place = f->place + py * f->stride;
        const uint16_t *group = f->group + py * f->stride;
        for (int x = rect->x0; py >= rect->y0 && py < rect->y1 && x < rect->x1; x++) {
            const float e = group[x] != own ? 0.0f : j->even ? enters[x] : enters[x] * light[x];
            if (e == 0.0f)
                continue;
            add_light(st, marks, y * j->stride + (x - j->x0) / st->step, place[x], e, true);
            widen(lit, (x - j->x0) / st->step, y);
        }
    }
}

static void spread_behind(const struct convolution_state *st, unsigned char *marks, struct pell_rect *lit, int y)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const int first = (j->y0 + y * st->step) / b->step, last = (j->y0 + (y + 1) * st->step - 1) / b->step;
    const int across = b->step > st->step ? b->step / st->step : 1;     /* pixels of the images that a cell covers, each way */
    const int top = rect->y0 / b->step, end = (rect->y1 - 1) / b->step; /* others were not placed */

    for (int k = 0; k < b->layers; k++)
        for (int cy = first > top ? first : top; cy <= last && cy <= end; cy++)
            for (int cx = j->x0 / b->step; cx <= (rect->x1 - 1) / b->step; cx++) {
                const size_t i = ((size_t) k * (size_t) b->height + (size_t) cy) * (size_t) b->width + (size_t) cx;
                const int px = cx * b->step > rect->x0 ? cx * b->step : rect->x0, py = cy * b->step > rect->y0 ? cy * b->step : rect->y0;
                float light, e, close;
                if (b->group[i] != j->group + 1)
                    continue;
                light = (j->even ? 1.0f : b->light[j->channel][i]) / (float) (across * across);
                e = light * b->enters[j->channel][i];
                close = light * b->close[j->channel][i];
                if (e == 0.0f && close == 0.0f)
                    continue;
                for (int n = 0; n < across; n++) {
                    const int x = (cx * b->step - j->x0) / st->step + n;
                    if (x >= j->layout.width)
                        break;
                    if (e != 0.0f)
                        add_light(st, marks, y * j->stride + x, b->place[i], e, false);
                    if (close != 0.0f)
                        add_light(st, marks, y * j->stride + x, f->place[py * f->stride + px], close, true);
                    widen(lit, x, y);
                }
            }
}

static void spread_band(void *arg, int band, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const int y1 = (band + 1) * CONV_BAND < j->layout.height ? (band + 1) * CONV_BAND : j->layout.height;
    unsigned char *marks = st->occupied + band * st->num_images;

    (void) worker;
    for (int i = 0; i < j->layout.planes + j->between + j->behind; i++)
        memset(conv_image(st, i) + band * CONV_BAND * j->stride, 0, (size_t) (y1 - band * CONV_BAND) * (size_t) j->stride * sizeof(float));
    memset(marks, 0, (size_t) st->num_images);
    st->lit[band] = (struct pell_rect){ INT_MAX, INT_MAX, 0, 0 };
    for (int y = band * CONV_BAND; y < y1; y++) {
        spread_front(st, marks, &st->lit[band], y);
        spread_behind(st, marks, &st->lit[band], y);
    }
}

void convolution_spread(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const int across = convolution_cut(j->layout.across, j->layout.width), down = convolution_cut(j->layout.down, j->layout.height);
    struct pell_rect all = { INT_MAX, INT_MAX, 0, 0 };

    pell_pool_run(st->pool, j->bands, spread_band, st);
    for (int i = 0; i < j->bands; i++)
        if (st->lit[i].x0 < st->lit[i].x1) {
            widen(&all, st->lit[i].x0, st->lit[i].y0);
            widen(&all, st->lit[i].x1 - 1, st->lit[i].y1 - 1);
        }
    j->reached = (struct pell_rect){ 0 };
    if (all.x0 < all.x1)
        j->reached = (struct pell_rect){ all.x0 - across, all.y0 - down, all.x1 + across, all.y1 + down };
}
