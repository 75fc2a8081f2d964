/* SPDX-License-Identifier: MIT
 * errors.c - mean errors under noise, as derived in docs/adr/0015-errors-under-noise.md: products of halves, a denominator that is
 * independent of the pixel's own noise, standard errors, and the Z-test. Rows and bands are added in a fixed order, so that results do not
 * depend on the timing of threads. */
#include "compare/errors.h"

#include <string.h>

#define RELATIVE_MAX 1e6f /* bound of the map where the reference is black */

enum {
    SCALES = 4,
    REACH = PELL_ERRORS_REACH, /* half width of the widest window, pixels */
    BLOCK = PELL_ERRORS_BAND,  /* pixels along a side of a block of the Z-test */
    BLOCK_PIXELS = 64,         /* noisy pixels: blocks with fewer are not tested */
    PLANES = 7,                /* reference and variance of three channels, and the number of pixels */
    SIDES = 2,                 /* inside and outside of the mask */
    TESTS_OF_BLOCKS = 6,       /* for each channel the sum of squares and the maximum */
    TESTS_OF_MEANS = 3,
};

static const int reach_of[SCALES] = { 1, 2, 4, REACH };

#define SMOOTH 0.02 /* relative variance of the smoothed reference below which no wider window is tried */

/* Sums of one row. */
struct sums {
    double square, relative, noise, relative_noise, absolute, difference[3], reference[3], test[3];
    double difference_variance[3];                   /* variance of the sum of d, from both images */
    double square_variance[3], relative_variance[3]; /* see add_error_variance */
};

/* Sums over the Z-test's pixels. */
struct block {
    double difference[3], variance[3], square[3]; /* square: of variances */
    int64_t pixels;
};

/* Results of one band of blocks. */
struct band {
    struct block all;
    int64_t values, beyond, blocks;
    double squares[3], largest[3]; /* of the blocks' z-values */
};

struct pell_errors {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct pell_compare_input *in;
    const struct pell_compare_part *part; /* NULL: errors of all the light */
    struct pell_comparison *out;
    int first;          /* first row of the planes */
    int y0;             /* first row of the current band */
    bool noisy;         /* the variance of the reference is known */
    struct sums *sums;  /* [row][region] */
    struct band *bands; /* [band][region] */
    double **work;      /* per worker: sums of columns, bases, their variances */
};

/* --- The denominator ------------------------------------------------------------------------------------------------------------ */

/* The reference smoothed over neighbouring pixels, and its variance. */
struct base {
    double value[3], variance[3];
    bool chosen;
};

static void add_columns(const struct pell_errors *job, int y, double *columns)
{
    const struct pell_compare_input *in = job->in;
    const size_t w = (size_t) in->width;

    if (y < 0 || y >= in->height)
        return;
    for (size_t x = 0; x < w; x++) {
        const size_t at = pell_pixel_at(in, job->first, (int) x, y);
        struct pell_pixel p;
        double *to = columns + (pell_inside(in, at) ? 0 : PLANES * w) + x;
        pell_pixel_read(in, at, &p);
        if (p.bad_test || p.bad_reference)
            continue;
        for (size_t c = 0; c < 3; c++) {
            to[c * w] += p.reference[c];
            to[(3 + c) * w] += p.variance[c];
        }
        to[6 * w] += 1.0;
    }
}

/* The mean of the pixels around a pixel on the same side of the mask, excluding the pixel: the denominator is independent of its noise.
 * Without any noise it is the pixel itself. */
static void choose_base(const struct pell_errors *job, const struct pell_pixel *p, size_t x, const double *columns, int scale, double floor,
                        struct base *b)
{
    const size_t w = (size_t) job->in->width, reach = (size_t) reach_of[scale];
    const size_t first = x > reach ? x - reach : 0, last = x + reach < w ? x + reach : w - 1;
    double sum[PLANES] = { 0.0 };

    for (size_t k = 0; k < PLANES; k++)
        for (size_t i = first; i <= last; i++)
            sum[k] += columns[k * w + i];
    if (scale == 0 && !(sum[3] + sum[4] + sum[5] > 0.0)) {
        b->chosen = true;
        return;
    }
    sum[6] -= 1.0;
    if (!(sum[6] > 0.0))
        return;
    b->chosen = true;
    for (int c = 0; c < 3; c++) {
        b->value[c] = (sum[c] - p->reference[c]) / sum[6];
        b->variance[c] = fmax(sum[3 + c] - p->variance[c], 0.0) / (sum[6] * sum[6]);
        b->chosen = b->chosen && b->variance[c] <= SMOOTH * (b->value[c] * b->value[c] + floor * floor);
    }
}

static void find_bases(const struct pell_errors *job, int y, double *columns, struct base *bases)
{
    const struct pell_compare_input *in = job->in;
    const size_t w = (size_t) in->width;
    bool undecided = job->noisy;
    int added = -1; /* rows on each side that the columns contain */

    for (size_t x = 0; x < w; x++) {
        struct pell_pixel p;
        pell_pixel_read(in, pell_pixel_at(in, job->first, (int) x, y), &p);
        bases[x].chosen = !job->noisy || p.bad_test || p.bad_reference;
        for (int c = 0; c < 3; c++) {
            bases[x].value[c] = p.reference[c];
            bases[x].variance[c] = p.variance[c];
        }
    }
    if (undecided)
        memset(columns, 0, SIDES * PLANES * w * sizeof(*columns));
    for (int scale = 0; scale < SCALES && undecided; scale++) {
        while (added < reach_of[scale]) {
            added++;
            add_columns(job, y - added, columns);
            if (added > 0)
                add_columns(job, y + added, columns);
        }
        undecided = false;
        for (size_t x = 0; x < w; x++) {
            const size_t at = pell_pixel_at(in, job->first, (int) x, y);
            const bool in_mask = pell_inside(in, at);
            struct pell_pixel p;
            if (bases[x].chosen)
                continue;
            pell_pixel_read(in, at, &p);
            choose_base(job, &p, x, columns + (in_mask ? 0 : PLANES * w), scale, in_mask ? job->out->masked.floor : job->out->whole.floor,
                        &bases[x]);
            undecided = undecided || !bases[x].chosen;
        }
    }
}

/* 1/(b^2 + e^2) for the b that `value` estimates with `variance`, corrected for the bias f''/2 x variance of the reciprocal. */
static double weight(double value, double variance, double floor)
{
    const double denominator = value * value + floor * floor;
    const double bias = fmax(3.0 * value * value - floor * floor, 0.0) / denominator * (variance / denominator);

    return denominator > 0.0 && isfinite(bias) ? 1.0 / (denominator * (1.0 + bias)) : 0.0;
}

/* --- Reading pixels ------------------------------------------------------------------------------------------------------------- */

static void read_error(const struct pell_errors *job, size_t at, struct pell_pixel *p)
{
    const struct pell_compare_part *part = job->part;

    pell_pixel_read(job->in, at, p);
    for (int c = 0; part && !p->bad_test && !p->bad_reference && c < 3; c++) {
        const double b1 = part->reference[c][at], b2 = part->half[0] ? part->half[c][at] : b1;
        p->difference[c] = part->test[c][at] - 0.5 * (b1 + b2);
        p->half[c] = 0.5 * (b1 - b2);
        p->variance[c] = part->half[0] ? p->half[c] * p->half[c] : part->variance[0] ? (double) part->variance[c][at] : 0.0;
        p->reported[c] = p->test_reported[c] = 0.0;
    }
}

/* --- Sums over rows ------------------------------------------------------------------------------------------------------------- */

/* Variance of Sum w (d^2 - v) over the channels of a pixel, which may share their noise. With halves: 4 (Sum w d h)^2 with the h of a
 * neighbour, so that it depends on no higher moment of the noise. With a variance alone, for normal noise: 4 (Sum w d s)^2 - 2 (Sum w v)^2
 * in sums, and at least that of independent channels. */
static void add_error_variance(const struct pell_errors *job, const struct pell_pixel *p, const double half[3], const double w[3],
                               double variance[3])
{
    double linear = 0.0, noise = 0.0;

    for (int c = 0; c < 3; c++) {
        const double d = p->difference[c];
        linear += w[c] * d * (job->in->half[0] ? half[c] : sqrt(p->variance[c]));
        noise += w[c] * p->variance[c];
        variance[2] += 2.0 * w[c] * p->variance[c] * w[c] * p->variance[c];
    }
    variance[0] += 4.0 * linear * linear;
    variance[1] += 2.0 * noise * noise;
}

/* Half the difference of the halves of the next pixel in the row, on the same side of the mask; else of the previous one, or of the pixel
 * itself. */
static void read_neighbor(const struct pell_errors *job, int x, int y, const struct pell_pixel *own, double half[3])
{
    const struct pell_compare_input *in = job->in;
    const size_t row = pell_pixel_at(in, job->first, 0, y);
    const bool side = pell_inside(in, row + (size_t) x);

    memcpy(half, own->half, 3 * sizeof(*half));
    for (int step = 1; step >= -1; step -= 2) {
        struct pell_pixel p;
        if (x + step < 0 || x + step >= in->width || pell_inside(in, row + (size_t) (x + step)) != side)
            continue;
        read_error(job, row + (size_t) (x + step), &p);
        if (p.bad_test || p.bad_reference)
            continue;
        memcpy(half, p.half, 3 * sizeof(*half));
        return;
    }
}

static void add_pixel(const struct pell_errors *job, const struct pell_pixel *p, const double half[3], const struct base *b, double floor,
                      struct sums *s)
{
    static const double ones[3] = { 1.0, 1.0, 1.0 };
    double w[3];

    for (int c = 0; c < 3; c++) {
        const double d = p->difference[c], error = d * d - p->variance[c];
        w[c] = weight(b->value[c], job->noisy ? b->variance[c] : 0.0, floor);
        s->square += error;
        s->noise += p->variance[c];
        s->relative += error * w[c];
        s->relative_noise += p->variance[c] * w[c];
        s->absolute += fabs(d);
        s->difference[c] += d;
        s->reference[c] += p->reference[c];
        s->test[c] += p->test[c];
        s->difference_variance[c] += p->variance[c] + p->test_reported[c];
    }
    if (job->noisy) {
        add_error_variance(job, p, half, ones, s->square_variance);
        add_error_variance(job, p, half, w, s->relative_variance);
    }
}

static void sum_row(void *arg, int index, int worker)
{
    const struct pell_errors *job = arg;
    const struct pell_compare_input *in = job->in;
    const int y = job->y0 + index;
    struct sums *sums = job->sums + (size_t) y * PELL_REGIONS;
    double *columns = job->work[worker];
    struct base *bases = (struct base *) (void *) (columns + SIDES * PLANES * (size_t) in->width);
    float *relative = job->out->relative ? job->out->relative + (size_t) y * (size_t) in->width : NULL;
    const double floor = job->out->masked.floor > 0.0 ? job->out->masked.floor : job->out->whole.floor;

    memset(sums, 0, PELL_REGIONS * sizeof(*sums));
    find_bases(job, y, columns, bases);
    for (int x = 0; x < in->width; x++) {
        const size_t at = pell_pixel_at(in, job->first, x, y);
        struct pell_pixel p;
        double half[3] = { 0.0 };

        read_error(job, at, &p);
        if (relative) {
            const double denominator = fmax(fabs(pell_luminance_of(p.reference)) + floor, 1e-300);
            const double ratio = pell_luminance_of(p.difference) / denominator;
            relative[x] = ratio < (double) RELATIVE_MAX ? ratio > -(double) RELATIVE_MAX ? (float) ratio : -RELATIVE_MAX : RELATIVE_MAX;
        }
        if (p.bad_test || p.bad_reference)
            continue;
        if (in->half[0])
            read_neighbor(job, x, y, &p, half);
        add_pixel(job, &p, half, &bases[x], job->out->whole.floor, &sums[PELL_WHOLE]);
        if (pell_inside(in, at))
            add_pixel(job, &p, half, &bases[x], job->out->masked.floor, &sums[PELL_MASKED]);
    }
}

static void add_sums(struct sums *all, const struct sums *s)
{
    const double *from = (const double *) s;
    double *to = (double *) all;

    for (size_t i = 0; i < sizeof(*s) / sizeof(double); i++)
        to[i] += from[i];
}

static double standard_error_of(const struct pell_errors *job, const double variance[3])
{
    const double of_variance = fmax(variance[0] - variance[1], variance[2]), v = job->in->half[0] ? variance[0] : of_variance;
    return isfinite(v) ? sqrt(v) : (double) INFINITY;
}

static void finish_sums(const struct pell_errors *job, int region, struct pell_metrics *m)
{
    struct sums all = { 0 };
    const double n = 3.0 * (double) m->pixels;

    m->mse_error = m->rel_mse_error = job->noisy ? 0.0 : (double) NAN;
    for (int c = 0; c < 3; c++)
        m->bias_error[c] = m->rel_bias_error[c] = m->mse_error;
    if (m->pixels == 0)
        return;
    for (int y = 0; y < job->in->height; y++)
        add_sums(&all, &job->sums[y * PELL_REGIONS + region]);
    m->noise_mse = all.noise / n;
    m->noise_rel_mse = all.relative_noise / n;
    m->mse = all.square / n;
    m->rel_mse = all.relative / n;
    if (!(m->floor > 0.0))
        m->rel_mse = m->mse > 0.0 ? (double) INFINITY : 0.0;
    m->mae = all.absolute / n;
    for (int c = 0; c < 3; c++) {
        m->bias[c] = all.difference[c] / (double) m->pixels;
        m->rel_bias[c] = all.reference[c] != 0.0 ? all.difference[c] / all.reference[c] : 0.0;
        if (job->noisy) {
            m->bias_error[c] = sqrt(all.difference_variance[c]) / (double) m->pixels;
            /* the noise of a part is nearly independent of the noise of the whole */
            const double slope = job->part ? 1.0 : fabs(all.test[c] / all.reference[c]);
            m->rel_bias_error[c] = all.reference[c] != 0.0 ? sqrt(all.difference_variance[c]) * slope / fabs(all.reference[c]) : 0.0;
        }
    }
    if (job->noisy) {
        m->mse_error = standard_error_of(job, all.square_variance) / n;
        m->rel_mse_error = standard_error_of(job, all.relative_variance) / n;
    }
}

/* --- The Z-test ------------------------------------------------------------------------------------------------------------------- */

/* Converts a quotient whose variance was estimated with few degrees of freedom to the standard normal number of the same probability (D. L.
 * Wallace, "Bounds on Normal Approximations to Student's and the Chi-Square Distributions", 1959, to first order). With halves each square
 * has one degree. */
static double z_of(const struct pell_errors *job, const struct block *b, int c)
{
    const double t = b->difference[c] / sqrt(b->variance[c]);
    const double freedom = job->in->half[0] ? 3.0 * b->variance[c] * b->variance[c] / b->square[c] : (double) INFINITY;
    const double z = isfinite(freedom) ? t * (1.0 - 0.25 / freedom) / sqrt(1.0 + 0.5 * t * t / freedom) : t;

    return b->variance[c] > 0.0 && isfinite(z) ? z : 0.0;
}

static void add_tested(const struct pell_errors *job, const struct pell_pixel *p, struct block *block, struct band *band)
{
    bool any = false;

    for (int c = 0; c < 3; c++) {
        const double d = p->difference[c], v = p->variance[c] + p->test_reported[c], variance = p->reported[c] + p->test_reported[c];
        if (job->in->variance[0] && variance > 0.0) {
            band->values++;
            band->beyond += d * d > 9.0 * variance;
        }
        if (!(v > 0.0))
            continue;
        block->difference[c] += d;
        block->variance[c] += v;
        block->square[c] += v * v;
        any = true;
    }
    block->pixels += any;
}

static void end_block(const struct pell_errors *job, const struct block *block, struct band *band)
{
    for (int c = 0; c < 3; c++) {
        band->all.difference[c] += block->difference[c];
        band->all.variance[c] += block->variance[c];
        band->all.square[c] += block->square[c];
    }
    band->all.pixels += block->pixels;
    if (block->pixels < BLOCK_PIXELS)
        return;
    band->blocks++;
    for (int c = 0; c < 3; c++) {
        const double z = z_of(job, block, c);
        band->squares[c] += z * z;
        band->largest[c] = fmax(band->largest[c], fabs(z));
    }
}

static void test_band(void *arg, int index, int worker)
{
    const struct pell_errors *job = arg;
    const struct pell_compare_input *in = job->in;
    const int y0 = job->y0 + index * BLOCK;
    struct band *bands = job->bands + (size_t) (y0 / BLOCK) * PELL_REGIONS;
    const int y1 = y0 + BLOCK < in->height ? y0 + BLOCK : in->height;
    (void) worker;

    memset(bands, 0, PELL_REGIONS * sizeof(*bands));
    for (int x0 = 0; x0 < in->width; x0 += BLOCK) {
        struct block blocks[PELL_REGIONS] = { { .pixels = 0 }, { .pixels = 0 } };
        for (int y = y0; y < y1; y++)
            for (int x = x0; x < x0 + BLOCK && x < in->width; x++) {
                const size_t at = pell_pixel_at(in, job->first, x, y);
                struct pell_pixel p;
                read_error(job, at, &p);
                for (int region = 0; region < PELL_REGIONS && !p.bad_test && !p.bad_reference; region++)
                    if (region == PELL_WHOLE || pell_inside(in, at))
                        add_tested(job, &p, &blocks[region], &bands[region]);
            }
        for (int region = 0; region < PELL_REGIONS; region++)
            end_block(job, &blocks[region], &bands[region]);
    }
}

/* Probability of |z| or more under the null hypothesis. */
static double p_value(double z)
{
    return erfc(fabs(z) * 0.70710678118654752);
}

/* The same for a sum of `count` squares: E. B. Wilson and M. M. Hilferty, "The Distribution of Chi-Square", PNAS 17, 1931. */
static double p_value_of_squares(double sum, double count)
{
    const double variance = 2.0 / (9.0 * count), z = (cbrt(sum / count) - (1.0 - variance)) / sqrt(variance);
    return 0.5 * erfc(z * 0.70710678118654752);
}

static void finish_test(const struct pell_errors *job, int region, struct pell_agreement *a)
{
    const int count = (job->in->height + BLOCK - 1) / BLOCK;
    struct band all = { .values = 0 };
    double min_p = 1.0;

    *a = (struct pell_agreement) { .beyond_3 = (double) NAN, .p = (double) NAN };
    for (int i = 0; i < count; i++) {
        const struct band *b = &job->bands[i * PELL_REGIONS + region];
        all.values += b->values;
        all.beyond += b->beyond;
        all.blocks += b->blocks;
        all.all.pixels += b->all.pixels;
        for (int c = 0; c < 3; c++) {
            all.all.difference[c] += b->all.difference[c];
            all.all.variance[c] += b->all.variance[c];
            all.all.square[c] += b->all.square[c];
            all.squares[c] += b->squares[c];
            all.largest[c] = fmax(all.largest[c], b->largest[c]);
        }
    }
    a->pixels = all.all.pixels;
    a->blocks = all.blocks;
    if (all.values > 0)
        a->beyond_3 = (double) all.beyond / (double) all.values;
    if (all.all.pixels == 0)
        return;
    for (int c = 0; c < 3; c++) {
        const double blocks = (double) all.blocks;
        min_p = fmin(min_p, p_value(z_of(job, &all.all, c)));
        if (all.blocks > 0) {
            min_p = fmin(min_p, p_value_of_squares(all.squares[c], blocks));
            min_p = fmin(min_p, -expm1(blocks * log1p(-fmin(p_value(all.largest[c]), 1.0 - 1e-16))));
        }
    }
    a->p = fmin(1.0, min_p * (all.blocks > 0 ? TESTS_OF_MEANS + TESTS_OF_BLOCKS : TESTS_OF_MEANS)); /* Bonferroni */
}

/* --- All of it ------------------------------------------------------------------------------------------------------------------ */

/* Allocates for all rows; `job` is released by `end`, also on failure. */
static enum pell_result begin(struct pell_errors *job)
{
    const struct pell_compare_input *in = job->in;
    const size_t threads = (size_t) pell_pool_threads(job->pool), bands = (size_t) (in->height + BLOCK - 1) / BLOCK;

    job->noisy = in->half[0] || in->variance[0];
    if (!(job->sums = pell_alloc_array(job->ctx, (size_t) in->height * PELL_REGIONS, sizeof(*job->sums))) ||
        !(job->bands = pell_calloc(job->ctx, bands * PELL_REGIONS, sizeof(*job->bands))) ||
        !(job->work = pell_calloc(job->ctx, threads, sizeof(*job->work))))
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < threads; i++)
        if (!(job->work[i] = pell_alloc_array(job->ctx, (size_t) in->width, SIDES * PLANES * sizeof(double) + sizeof(struct base))))
            return PELL_ERR_NOMEM;
    return PELL_OK;
}

void pell_errors_add(struct pell_errors *job, const struct pell_compare_input *in, int first, int y0, int y1)
{
    job->in = in;
    job->first = first;
    job->y0 = y0;
    pell_pool_run(job->pool, y1 - y0, sum_row, job);
    if (job->noisy)
        pell_pool_run(job->pool, (y1 - y0 + BLOCK - 1) / BLOCK, test_band, job);
}

static void end(struct pell_errors *job, bool good)
{
    struct pell_metrics *const metrics[PELL_REGIONS] = { &job->out->masked, &job->out->whole };

    for (int region = 0; region < PELL_REGIONS && good; region++) {
        finish_sums(job, region, metrics[region]);
        finish_test(job, region, &metrics[region]->agreement);
    }
    for (int i = 0; job->work && i < pell_pool_threads(job->pool); i++)
        pell_free(job->ctx, job->work[i]);
    pell_free(job->ctx, job->work);
    pell_free(job->ctx, job->bands);
    pell_free(job->ctx, job->sums);
}

enum pell_result pell_errors_begin(struct pell_context *ctx, struct pell_pool *pool, const struct pell_compare_input *in,
                                   struct pell_comparison *out, struct pell_errors **errors)
{
    struct pell_errors *job = *errors = pell_calloc(ctx, 1, sizeof(*job));

    if (!job)
        return PELL_ERR_NOMEM;
    *job = (struct pell_errors) { .ctx = ctx, .pool = pool, .in = in, .out = out };
    return begin(job);
}

void pell_errors_end(struct pell_errors **errors, bool good)
{
    struct pell_errors *job = *errors;

    *errors = NULL;
    if (!job)
        return;
    end(job, good);
    pell_free(job->ctx, job);
}

enum pell_result pell_errors_of_part(struct pell_context *ctx, int threads, const struct pell_compare_input *in,
                                     const struct pell_compare_part *part, struct pell_metrics *out)
{
    struct pell_comparison both = { .masked = { .pixels = out->pixels, .floor = out->floor } };
    struct pell_errors job = { .ctx = ctx, .in = in, .part = part, .out = &both };
    enum pell_result res;

    PELL_TRY(pell_pool_create(ctx, threads, &job.pool));
    res = begin(&job);
    if (res == PELL_OK)
        pell_errors_add(&job, in, 0, 0, in->height);
    end(&job, res == PELL_OK);
    if (res == PELL_OK)
        *out = both.masked;
fail:
    pell_pool_destroy(&job.pool);
    return res;
}

bool pell_metric_resolved(double value, double standard_error)
{
    return !(standard_error > 0.0) || value > PELL_RESOLVED * standard_error;
}
