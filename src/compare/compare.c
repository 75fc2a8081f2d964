/* SPDX-License-Identifier: MIT
 * compare.c - see pellucid/compare.h: a pass over the reference for exposure, errors (errors.c), then FLIP and SSIM over tiles. Sums of
 * rows and tiles are added in a fixed order, so that results do not depend on the timing of threads. */
#include "compare/rows.h"

#include "compare/errors.h"
#include "compare/tile.h"
#include "shared/tone.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define KEY 0.18         /* luminance of middle grey (Reinhard et al. 2002), as in the metering of `render` */
#define BRIGHTEST 1e15   /* images are clamped to this if products could overflow */
#define EXPOSURES_MAX 64 /* of HDR-FLIP; a wider range uses larger steps */
#define BAND_PIXELS (1 << 19)

static const char *const tonemaps[] = { PELL_CURVE_REINHARD, "aces", PELL_CURVE_LINEAR, PELL_CURVE_FILMIC, NULL }; /* all of `render` */

#define AT(field) offsetof(struct pell_compare_params, field)
/* clang-format off */
static const struct pell_knob compare_knobs[] = {
    { "ppd", PELL_KNOB_FLOAT, "1", AT(ppd), { 67.0206432765 }, 1, 400, NULL,
      "pixels per degree of the viewer, for FLIP; the default is 3840 pixels over 0.7 m, seen from 0.7 m" },
    { "exposure", PELL_KNOB_FLOAT, "1", AT(exposure), { 0 }, 0, 1e12, NULL,
      "factor from radiance to display, for SSIM and FLIP; 0: metered from the reference" },
    { "white", PELL_KNOB_FLOAT, "1", AT(white), { 0 }, 0, 1e12, NULL,
      "luminance after exposure that becomes display white; 0: the largest of the reference" },
    { "tonemap", PELL_KNOB_ENUM, "1", AT(tonemap), { PELL_COMPARE_REINHARD }, 0, 0, tonemaps,
      "curve from exposed radiance to the display, for SSIM and FLIP: those of `render`, or aces, that of HDR-FLIP" },
    { "exposures", PELL_KNOB_INT, "1", AT(exposures), { 0 }, 0, EXPOSURES_MAX, NULL,
      "number of exposures of HDR-FLIP; 0: one per stop, as published" },
    { "floor", PELL_KNOB_FLOAT, "1", AT(floor), { 0.01 }, 1e-6, 1, NULL,
      "added to the denominator of relative errors, as a fraction of the reference's mean luminance" },
    { "threads", PELL_KNOB_INT, "1", AT(threads), { 0 }, 0, 256, NULL, "number of threads; 0: one per core" },
    { 0 },
};
/* clang-format on */
#undef AT

const struct pell_knob *pell_compare_knobs(void)
{
    return compare_knobs;
}

/* Results of one row. */
struct survey {
    int64_t bad_test, bad_reference, bad_variance, pixels[PELL_REGIONS], metered;
    double luminance[PELL_REGIONS]; /* sums of |Y| */
    double log_sum, brightest;      /* over metered pixels */
};

struct tile_sums {
    double flip, flip_hdr, ssim[4], inner_ssim[4];
    int64_t pixels, inner; /* inner: pixels whose window lies inside the image */
};

/* Maps of a tile: four of SSIM, FLIP, HDR-FLIP. */
enum { MAP_SSIM, MAP_FLIP = 4, MAP_FLIP_HDR, TILE_MAPS };

struct job {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct pell_compare_rows *rows; /* NULL: all rows are in memory */
    struct pell_compare_input in;
    int first;  /* first row of the planes of `in` */
    int y0, y1; /* the band */
    const struct pell_compare_params *params;
    struct pell_comparison *out;
    struct pell_errors *errors;
    const struct pell_tile_kernels *kernels;
    struct pell_flip_filters filters;
    float window[PELL_SSIM_RADIUS + 1];
    struct pell_tone tone;
    double hdr_step;
    int pad, across, down, first_tile;
    size_t light_floats; /* size of one padded plane */
    float *luminance;    /* luminance of the reference in the band; NaN for a bad pixel */
    struct order *order; /* order statistics of all luminances; NULL for display images */
    struct survey *surveys;
    struct tile_sums *tile_sums; /* [tile][region] */
    float **workspaces;          /* of the workers: six planes, the scratch, TILE_MAPS maps */
};

/* --- The survey --------------------------------------------------------------------------------------------------------------- */

/* Luminance of the reference; NaN for a bad pixel. */
static float luminance_of(const struct pell_pixel *p)
{
    const double l = pell_luminance_of(p->reference);
    return p->bad_test || p->bad_reference ? NAN : (float) (l < BRIGHTEST ? l : BRIGHTEST);
}

static void survey_row(void *arg, int index, int worker)
{
    const struct job *job = arg;
    const struct pell_compare_input *in = &job->in;
    const int y = job->y0 + index;
    struct survey *s = &job->surveys[y];
    (void) worker;

    memset(s, 0, sizeof(*s));
    for (int x = 0; x < in->width; x++) {
        const size_t at = pell_pixel_at(in, job->first, x, y);
        struct pell_pixel p;
        double l;

        pell_pixel_read(in, at, &p);
        s->bad_test += p.bad_test;
        s->bad_reference += p.bad_reference;
        s->bad_variance += p.bad_variance;
        l = pell_luminance_of(p.reference);
        job->luminance[(size_t) index * (size_t) in->width + (size_t) x] = luminance_of(&p);
        if (p.bad_test || p.bad_reference)
            continue;
        for (int region = 0; region < PELL_REGIONS; region++)
            if (region == PELL_WHOLE || pell_inside(in, at)) {
                s->pixels[region]++;
                s->luminance[region] += fabs(l);
            }
        if (pell_inside(in, at) && l > 1e-30) {
            s->log_sum += log(l);
            s->metered++;
            s->brightest = l > s->brightest ? l : s->brightest;
        }
    }
}

static void luminance_row(void *arg, int index, int worker)
{
    const struct job *job = arg;
    (void) worker;

    for (int x = 0; x < job->in.width; x++) {
        struct pell_pixel p;
        pell_pixel_read(&job->in, pell_pixel_at(&job->in, job->first, x, job->y0 + index), &p);
        job->luminance[(size_t) index * (size_t) job->in.width + (size_t) x] = luminance_of(&p);
    }
}

/* Makes the band from row `y0` available, with `reach` rows around it, and sets job->y0 and y1. */
static enum pell_result take_band(struct job *job, int y0, int reach)
{
    const int height = job->in.height, band = pell_compare_band(job->in.width);
    int low, high;

    if (pell_cancelled(job->ctx))
        return PELL_ERR_CANCELLED;
    job->y0 = y0;
    job->y1 = height - y0 < band ? height : y0 + band;
    low = y0 < reach ? 0 : y0 - reach;
    high = height - job->y1 < reach ? height : job->y1 + reach;
    if (!job->rows)
        return PELL_OK;
    job->first = low;
    return job->rows->move(job->rows->user, low, high - low, &job->in);
}

/* --- Exposures of HDR-FLIP: the median of all luminances by a radix search, so that none need to be stored ----------------------- */

enum { DIGITS = 1 << 16 };

/* A rank among all values; the ranks searched for are the middle ones of all, and of the non-black ones. */
struct rank {
    uint64_t rank;  /* from 0; among values with the same upper digit once that is known */
    uint32_t upper; /* digit */
    int first;      /* first rank with the same upper digit; they share counts of lower digits */
    float value;
};

struct order {
    uint64_t finite, bright, upper[DIGITS], lower[4][DIGITS];
    float largest;
    struct rank ranks[4];
};

/* Maps floats to integers of the same order. */
static uint32_t digits_of(float v)
{
    uint32_t bits;

    memcpy(&bits, &v, sizeof(bits));
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

static float value_of(uint32_t digits)
{
    const uint32_t bits = digits & 0x80000000u ? digits & 0x7fffffffu : ~digits;
    float v;

    memcpy(&v, &bits, sizeof(v));
    return v;
}

static void count_upper(struct order *o, const float *l, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (isnan(l[i]))
            continue;
        o->finite++;
        o->bright += l[i] > 1e-30f;
        o->largest = l[i] > o->largest ? l[i] : o->largest;
        o->upper[digits_of(l[i]) >> 16]++;
    }
}

static void count_lower(struct order *o, const float *l, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const uint32_t digits = digits_of(l[i]);
        for (int k = 0; k < 4; k++)
            if (!isnan(l[i]) && o->ranks[k].first == k && o->ranks[k].upper == digits >> 16)
                o->lower[k][digits & (DIGITS - 1)]++;
    }
}

/* The digit of rank *rank, which becomes the rank among the values with that digit. */
static uint32_t find_digit(const uint64_t *counts, uint64_t *rank)
{
    uint32_t digit = 0;

    while (digit < DIGITS - 1 && *rank >= counts[digit])
        *rank -= counts[digit++];
    return digit;
}

/* Ranks 0 and 1: the middle two of all, or twice the middle one; 2 and 3: of the non-black ones. */
static void find_upper(struct order *o)
{
    const uint64_t dark = o->finite - o->bright;

    for (int k = 0; k < 4; k++) {
        const uint64_t count = k < 2 ? o->finite : o->bright;
        struct rank *r = &o->ranks[k];
        r->rank = (k < 2 ? 0 : dark) + count / 2 - (k % 2 && count % 2 == 0 ? 1 : 0);
        r->upper = find_digit(o->upper, &r->rank);
        r->first = 0;
        while (o->ranks[r->first].upper != r->upper)
            r->first++;
    }
}

static void find_lower(struct order *o)
{
    for (int k = 0; k < 4; k++) {
        struct rank *r = &o->ranks[k];
        r->value = value_of(r->upper << 16 | find_digit(o->lower[r->first], &r->rank));
    }
}

static double median_of(const struct rank *two)
{
    return 0.5 * ((double) two[0].value + (double) two[1].value);
}

static enum pell_result find_exposures(struct job *job)
{
    struct pell_comparison *out = job->out;
    struct order *o = job->order;
    enum pell_result res;
    double median;

    if (!(o->largest > 1e-30f)) { /* a black image: one exposure of 0 stops */
        out->hdr_exposures = 1;
        return PELL_OK;
    }
    find_upper(o);
    for (int y = 0; y < job->in.height; y = job->y1) {
        if ((res = take_band(job, y, 0)) != PELL_OK)
            return res;
        pell_pool_run(job->pool, job->y1 - y, luminance_row, job);
        count_lower(o, job->luminance, (size_t) (job->y1 - y) * (size_t) job->in.width);
    }
    find_lower(o);
    median = median_of(o->ranks);
    if (!(median > 1e-30)) {
        median = median_of(o->ranks + 2);
        out->hdr_above_black = true;
    }
    pell_flip_exposures((double) o->largest, median, &out->hdr_start, &out->hdr_stop, &out->hdr_exposures);
    if (job->params->exposures > 0)
        out->hdr_exposures = job->params->exposures;
    if (out->hdr_exposures > EXPOSURES_MAX)
        out->hdr_exposures = EXPOSURES_MAX;
    job->hdr_step = (out->hdr_stop - out->hdr_start) / (out->hdr_exposures > 1 ? out->hdr_exposures - 1 : 1);
    return PELL_OK;
}

/* Chooses the tone mapping of linear images. */
static void choose_tone(struct job *job, const struct survey *all)
{
    const struct pell_compare_params *p = job->params;
    double exposure = p->exposure, white = p->white;

    job->tone.curve = p->tonemap;
    if (job->in.display) {
        job->tone = (struct pell_tone) { PELL_COMPARE_LINEAR, 1.0f, 0.0f };
        job->out->exposure = job->out->white = 1.0f;
        return;
    }
    if (!(exposure > 0.0))
        exposure = all->metered > 0 ? KEY / exp(all->log_sum / (double) all->metered) : 1.0;
    exposure = exposure < 1e30 ? exposure : 1e30;
    if (!(white > 0.0))
        white = fmax(exposure * fmin(all->brightest, BRIGHTEST), 1.0);
    white = white < 1e15 ? white : 1e15;
    job->tone.exposure = job->out->exposure = (float) exposure;
    job->out->white = (float) white;
    job->tone.white_scale = (float) (1.0 / (white * white));
}

static void sum_surveys(struct job *job)
{
    struct survey all = { 0 };
    struct pell_metrics *const metrics[PELL_REGIONS] = { &job->out->masked, &job->out->whole };

    for (int y = 0; y < job->in.height; y++) {
        const struct survey *s = &job->surveys[y];
        all.bad_test += s->bad_test;
        all.bad_reference += s->bad_reference;
        all.bad_variance += s->bad_variance;
        all.metered += s->metered;
        all.log_sum += s->log_sum;
        all.brightest = fmax(all.brightest, s->brightest);
        for (int region = 0; region < PELL_REGIONS; region++) {
            all.pixels[region] += s->pixels[region];
            all.luminance[region] += s->luminance[region];
        }
    }
    job->out->bad_test = all.bad_test;
    job->out->bad_reference = all.bad_reference;
    job->out->bad_variance = all.bad_variance;
    for (int region = 0; region < PELL_REGIONS; region++) {
        metrics[region]->pixels = all.pixels[region];
        if (all.pixels[region] > 0)
            metrics[region]->floor = (double) job->params->floor * (all.luminance[region] / (double) all.pixels[region]);
    }
    choose_tone(job, &all);
}

/* --- Tiles -------------------------------------------------------------------------------------------------------------------- */

static int clamp_to(int v, int count)
{
    return v < 0 ? 0 : v < count ? v : count - 1;
}

static float clamp_light(double v)
{
    return (float) (v < BRIGHTEST ? v > -BRIGHTEST ? v : -BRIGHTEST : BRIGHTEST);
}

/* Loads the pixels of a tile and of its padding; beyond the image's edge the edge pixels are repeated. */
static void load_tile(const struct job *job, const struct pell_tile *tile, int x0, int y0, float *planes)
{
    const struct pell_compare_input *in = &job->in;

    for (int i = 0; i < tile->rows; i++) {
        const size_t line = pell_pixel_at(in, job->first, 0, clamp_to(y0 + i - tile->pad, in->height));
        for (int j = 0; j < tile->row; j++) {
            const size_t at = line + (size_t) clamp_to(x0 + j - tile->pad, in->width), to = (size_t) i * (size_t) tile->row + (size_t) j;
            struct pell_pixel p;
            pell_pixel_read(in, at, &p);
            for (int c = 0; c < 3; c++) {
                planes[(size_t) c * job->light_floats + to] = clamp_light(p.test[c]);
                planes[(size_t) (3 + c) * job->light_floats + to] = clamp_light(p.reference[c]);
            }
        }
    }
}

static void hdr_flip(const struct job *job, const struct pell_tile *tile, float *error, float *largest)
{
    memset(largest, 0, PELL_TILE_WIDTH * PELL_TILE_HEIGHT * sizeof(*largest));
    for (int k = 0; k < job->out->hdr_exposures; k++) {
        const double exposure = exp2(job->out->hdr_start + k * job->hdr_step);
        const struct pell_tone tone = { PELL_COMPARE_ACES, (float) (exposure < 1e30 ? exposure : 1e30), 0.0f };
        job->kernels->flip(tile, &job->filters, &tone, error);
        for (int i = 0; i < tile->height * PELL_TILE_WIDTH; i++)
            largest[i] = error[i] > largest[i] ? error[i] : largest[i];
    }
}

static void add_tile(const struct job *job, const struct pell_tile *tile, int x0, int y0, float *const map[TILE_MAPS],
                     struct tile_sums *sums)
{
    const struct pell_compare_input *in = &job->in;

    for (int i = 0; i < tile->height; i++)
        for (int j = 0; j < tile->width; j++) {
            const int x = x0 + j, y = y0 + i;
            const size_t at = pell_pixel_at(in, job->first, x, y);
            const int to = i * PELL_TILE_WIDTH + j;
            const bool inner =
                x >= PELL_SSIM_RADIUS && x < in->width - PELL_SSIM_RADIUS && y >= PELL_SSIM_RADIUS && y < in->height - PELL_SSIM_RADIUS;
            struct pell_pixel p;
            pell_pixel_read(in, at, &p);
            for (int region = 0; region < PELL_REGIONS; region++) {
                struct tile_sums *s = &sums[region];
                if (p.bad_test || p.bad_reference || (region == PELL_MASKED && !pell_inside(in, at)))
                    continue;
                s->pixels++;
                s->inner += inner;
                s->flip += (double) map[MAP_FLIP][to];
                s->flip_hdr += in->display ? 0.0 : (double) map[MAP_FLIP_HDR][to];
                for (int c = 0; c < 4; c++) {
                    const double v = map[MAP_SSIM + c][to];
                    s->ssim[c] += v;
                    s->inner_ssim[c] += inner ? v : 0.0;
                }
            }
        }
}

static void store(const struct job *job, const struct pell_tile *tile, int x0, int y0, const float *from, float *to)
{
    for (int i = 0; to && i < tile->height; i++)
        memcpy(to + (size_t) (y0 + i) * (size_t) job->in.width + (size_t) x0, from + i * PELL_TILE_WIDTH,
               (size_t) tile->width * sizeof(*to));
}

static void compare_tile(void *arg, int offset, int worker)
{
    const struct job *job = arg;
    const int index = job->first_tile + offset, x0 = index % job->across * PELL_TILE_WIDTH, y0 = index / job->across * PELL_TILE_HEIGHT;
    const int width = job->in.width - x0, height = job->in.height - y0;
    float *planes = job->workspaces[worker], *maps = planes + 6 * job->light_floats + pell_tile_scratch(job->pad);
    float *map[TILE_MAPS];
    struct pell_tile tile = {
        .width = width < PELL_TILE_WIDTH ? width : PELL_TILE_WIDTH,
        .height = height < PELL_TILE_HEIGHT ? height : PELL_TILE_HEIGHT,
        .pad = job->pad,
        .row = pell_tile_row(job->pad),
        .scratch = planes + 6 * job->light_floats,
    };
    struct tile_sums *sums = job->tile_sums + (size_t) index * PELL_REGIONS;

    tile.rows = tile.height + 2 * job->pad;
    for (int p = 0; p < 2; p++)
        for (int c = 0; c < 3; c++)
            tile.light[p][c] = planes + (size_t) (3 * p + c) * job->light_floats;
    for (int i = 0; i < TILE_MAPS; i++)
        map[i] = maps + i * PELL_TILE_WIDTH * PELL_TILE_HEIGHT;
    load_tile(job, &tile, x0, y0, planes);
    job->kernels->flip(&tile, &job->filters, &job->tone, map[MAP_FLIP]);
    store(job, &tile, x0, y0, map[MAP_FLIP], job->out->flip);
    if (!job->in.display) {
        hdr_flip(job, &tile, map[0], map[MAP_FLIP_HDR]);
        store(job, &tile, x0, y0, map[MAP_FLIP_HDR], job->out->flip_hdr);
    }
    job->kernels->ssim(&tile, job->window, &job->tone, map);
    store(job, &tile, x0, y0, map[0], job->out->ssim);
    memset(sums, 0, PELL_REGIONS * sizeof(*sums));
    add_tile(job, &tile, x0, y0, map, sums);
}

static void finish_tiles(const struct job *job, int region, struct pell_metrics *m)
{
    struct tile_sums all = { 0 };

    if (m->pixels == 0)
        return;
    for (int i = 0; i < job->across * job->down; i++) {
        const struct tile_sums *s = &job->tile_sums[i * PELL_REGIONS + region];
        all.flip += s->flip;
        all.flip_hdr += s->flip_hdr;
        all.inner += s->inner;
        for (int c = 0; c < 4; c++) {
            all.ssim[c] += s->ssim[c];
            all.inner_ssim[c] += s->inner_ssim[c];
        }
    }
    m->flip = all.flip / (double) m->pixels;
    m->flip_hdr = all.flip_hdr / (double) m->pixels;
    for (int c = 0; c < 4; c++)
        *(c ? &m->ssim_rgb[c - 1] : &m->ssim) = all.inner > 0 ? all.inner_ssim[c] / (double) all.inner : all.ssim[c] / (double) m->pixels;
}

/* --- All of it ---------------------------------------------------------------------------------------------------------------- */

static enum pell_result check(struct pell_context *ctx, const struct pell_compare_input *in, const struct pell_compare_params *params)
{
    const int64_t limit = pell_context_limits(ctx)->image_pixels;

    if (in->width < 1 || in->height < 1 || in->width > limit / in->height || in->stride < in->width)
        return pell_error(ctx, PELL_ERR_INVALID, "compare", PELL_RAISE_LIMIT("image-pixels"),
                          "the images are %d x %d pixels, %lld from row to row; must be 1 x 1 to %lld pixels", in->width, in->height,
                          (long long) in->stride, (long long) limit);
    return pell_knobs_check(ctx, pell_compare_knobs(), "compare", params);
}

int pell_compare_band(int width)
{
    const int rows = BAND_PIXELS / width / PELL_TILE_HEIGHT;
    return (rows > 1 ? rows : 1) * PELL_TILE_HEIGHT;
}

_Static_assert(PELL_TILE_HEIGHT % PELL_ERRORS_BAND == 0 && PELL_COMPARE_REACH >= PELL_FLIP_RADIUS_MAX, "bands hold whole tiles and blocks");

static enum pell_result prepare(struct job *job)
{
    struct pell_context *ctx = job->ctx;
    struct pell_comparison *out = job->out;
    const size_t all = (size_t) job->in.width * (size_t) job->in.height, rows = (size_t) job->in.height;
    const size_t threads = (size_t) pell_pool_threads(job->pool), band = (size_t) pell_compare_band(job->in.width);
    float **const maps[] = { &out->relative, &out->ssim, &out->flip, &out->flip_hdr };

    pell_flip_prepare((double) job->params->ppd, &job->filters);
    pell_ssim_window(job->window);
    job->kernels = pell_tile_tables[pell_simd_best()];
    job->pad = job->filters.radius > PELL_SSIM_RADIUS ? job->filters.radius : PELL_SSIM_RADIUS;
    job->light_floats = (size_t) pell_tile_row(job->pad) * (size_t) (PELL_TILE_HEIGHT + 2 * job->pad);
    job->across = (job->in.width + PELL_TILE_WIDTH - 1) / PELL_TILE_WIDTH;
    job->down = (job->in.height + PELL_TILE_HEIGHT - 1) / PELL_TILE_HEIGHT;
    for (size_t i = 0; i < PELL_COUNT(maps) && !job->in.figures_only; i++)
        if (!(*maps[i] = pell_calloc(ctx, all, sizeof(float))))
            return PELL_ERR_NOMEM;
    if (!job->in.display && !(job->order = pell_calloc(ctx, 1, sizeof(*job->order))))
        return PELL_ERR_NOMEM;
    if (!(job->luminance = pell_alloc_array(ctx, band < rows ? band : rows, (size_t) job->in.width * sizeof(float))) ||
        !(job->surveys = pell_alloc_array(ctx, rows, sizeof(*job->surveys))) ||
        !(job->tile_sums = pell_alloc_array(ctx, (size_t) job->across * (size_t) job->down * PELL_REGIONS, sizeof(*job->tile_sums))) ||
        !(job->workspaces = pell_calloc(ctx, threads, sizeof(*job->workspaces))))
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < threads; i++)
        if (!(job->workspaces[i] = pell_alloc_array(
                  ctx, 6 * job->light_floats + pell_tile_scratch(job->pad) + TILE_MAPS * PELL_TILE_WIDTH * PELL_TILE_HEIGHT,
                  sizeof(float))))
            return PELL_ERR_NOMEM;
    return PELL_OK;
}

static enum pell_result survey(struct job *job)
{
    enum pell_result res;

    for (int y = 0; y < job->in.height; y = job->y1) {
        if ((res = take_band(job, y, 0)) != PELL_OK)
            return res;
        pell_pool_run(job->pool, job->y1 - y, survey_row, job);
        if (job->order)
            count_upper(job->order, job->luminance, (size_t) (job->y1 - y) * (size_t) job->in.width);
    }
    sum_surveys(job);
    return job->order ? find_exposures(job) : PELL_OK;
}

static enum pell_result compare_bands(struct job *job)
{
    const int reach = job->pad > PELL_ERRORS_REACH ? job->pad : PELL_ERRORS_REACH, batch = 4 * pell_pool_threads(job->pool);
    const int tiles = job->across * job->down;
    enum pell_result res;

    for (int y = 0; y < job->in.height; y = job->y1) {
        int last;
        if ((res = take_band(job, y, reach)) != PELL_OK)
            return res;
        pell_errors_add(job->errors, &job->in, job->first, y, job->y1);
        last = (job->y1 + PELL_TILE_HEIGHT - 1) / PELL_TILE_HEIGHT * job->across;
        for (job->first_tile = y / PELL_TILE_HEIGHT * job->across; job->first_tile < last; job->first_tile += batch) {
            if (pell_cancelled(job->ctx))
                return PELL_ERR_CANCELLED;
            pell_progress(job->ctx, "compare", (double) job->first_tile / tiles);
            pell_pool_run(job->pool, last - job->first_tile < batch ? last - job->first_tile : batch, compare_tile, job);
        }
    }
    return pell_cancelled(job->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static enum pell_result work(struct job *job)
{
    struct pell_metrics *const metrics[PELL_REGIONS] = { &job->out->masked, &job->out->whole };
    enum pell_result res;

    PELL_TRY(survey(job));
    PELL_TRY(pell_errors_begin(job->ctx, job->pool, &job->in, job->out, &job->errors));
    PELL_TRY(compare_bands(job));
    for (int region = 0; region < PELL_REGIONS; region++)
        finish_tiles(job, region, metrics[region]);
    pell_progress(job->ctx, "compare", 1.0);
fail:
    pell_errors_end(&job->errors, res == PELL_OK);
    return res;
}

enum pell_result pell_compare_by_rows(struct pell_context *ctx, const struct pell_compare_input *input,
                                      const struct pell_compare_rows *rows, const struct pell_compare_params *params,
                                      struct pell_comparison *out)
{
    struct job job = { .ctx = ctx, .rows = rows, .in = *input, .params = params, .out = out };
    const double begin = pell_seconds();
    enum pell_result res;

    memset(out, 0, sizeof(*out));
    PELL_TRY(check(ctx, input, params));
    PELL_TRY(pell_pool_create(ctx, params->threads, &job.pool));
    out->width = input->width;
    out->height = input->height;
    PELL_TRY(prepare(&job));
    PELL_TRY(work(&job));
    out->seconds = pell_seconds() - begin;
fail:
    for (int i = 0; job.workspaces && i < pell_pool_threads(job.pool); i++)
        pell_free(ctx, job.workspaces[i]);
    pell_free(ctx, job.workspaces);
    pell_free(ctx, job.tile_sums);
    pell_free(ctx, job.surveys);
    pell_free(ctx, job.order);
    pell_free(ctx, job.luminance);
    pell_pool_destroy(&job.pool);
    if (res != PELL_OK)
        pell_comparison_finish(ctx, out);
    return res;
}

enum pell_result pell_compare(struct pell_context *ctx, const struct pell_compare_input *input, const struct pell_compare_params *params,
                              struct pell_comparison *out)
{
    if (!ctx || !input || !out)
        return pell_null(ctx, "pell_compare");

    return pell_compare_by_rows(ctx, input, NULL, params, out);
}

void pell_comparison_finish(struct pell_context *ctx, struct pell_comparison *comparison)
{
    pell_free(ctx, comparison->relative);
    pell_free(ctx, comparison->ssim);
    pell_free(ctx, comparison->flip);
    pell_free(ctx, comparison->flip_hdr);
    memset(comparison, 0, sizeof(*comparison));
}
