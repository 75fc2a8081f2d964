/* SPDX-License-Identifier: MIT
 *
 * film.c - sums of samples. They are exact: samples are rounded to integer multiples of a fixed unit, which are added without rounding. An
 * image therefore depends only on which samples it contains, not on who computed them nor on the order in which they, or partial sums, were
 * added: threads, ranks, jobs of an array (docs/adr/0019-exact-sums.md).
 */
#include "methods/path_trace/path_trace.h"

#define LARGEST 0x1p31 /* units per sample: a sum holds 2^30 such samples */

/* --- Exact sums --------------------------------------------------------------------------------------------------------------------- */

static double luminance(const double rgb[3])
{
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

static void add_sum(struct pt_sum *to, const struct pt_sum *x)
{
    to->low += x->low;
    to->high = (int64_t) ((uint64_t) to->high + (uint64_t) x->high + (to->low < x->low));
}

/* For numbers that are not negative: saturates at the largest, whatever the order. */
static void add_square(struct pt_sum *to, const struct pt_sum *x)
{
    add_sum(to, x);
    if (to->high < 0)
        *to = (struct pt_sum) { UINT64_MAX, INT64_MAX };
}

/* |x| is below 2^63; bits below 2^-64 are dropped. */
static struct pt_sum sum_of(double x)
{
    const double size = fabs(x);
    const uint64_t high = (uint64_t) size, low = (uint64_t) ((size - (double) high) * 0x1p64); /* both exact */

    if (x >= 0.0)
        return (struct pt_sum) { low, (int64_t) high };
    return (struct pt_sum) { 0 - low, (int64_t) (0 - high - (low > 0)) };
}

double pt_sum_value(const struct pt_sum *sum, int exponent)
{
    return ldexp((double) sum->high + (double) sum->low * 0x1p-64, exponent);
}

/* A sum and its rounding error. */
struct wide {
    double value, error;
};

/* D. E. Knuth, The Art of Computer Programming, volume 2, theorem 4.2.2 B. */
static struct wide add_wide(double a, double b)
{
    const double sum = a + b, of_b = sum - a;

    return (struct wide) { sum, (a - (sum - of_b)) + (b - of_b) };
}

static struct wide wide_of(const struct pt_sum *s)
{
    const struct wide high = add_wide((double) (s->high >> 32) * 0x1p32, (double) (s->high & 0xffffffff));
    const struct wide low = add_wide((double) (s->low >> 32) * 0x1p-32, (double) (s->low & 0xffffffff) * 0x1p-64);
    const struct wide both = add_wide(high.value, low.value);

    return add_wide(both.value, both.error + (high.error + low.error));
}

/* squares - sum^2/n, which is small if the samples are nearly equal: computed with twice the digits of a double. */
static double spread_of(const struct pt_sum *squares, struct wide sum, double n)
{
    const struct wide q = wide_of(squares);
    const double square = sum.value * sum.value, square_error = fma(sum.value, sum.value, -square) + 2.0 * sum.value * sum.error;
    const double quotient = square / n, quotient_error = (fma(-quotient, n, square) + square_error) / n;
    const struct wide difference = add_wide(q.value, -quotient);

    return fmax(difference.value + (difference.error + (q.error - quotient_error)), 0.0);
}

/* --- Pixels ------------------------------------------------------------------------------------------------------------------------- */

static const double *component(const struct pt_light *light, int k)
{
    return k == PT_MULTIPLE ? light->multiple : k == PT_SINGLE ? light->single : light->surface;
}

bool pt_pixel_add(struct pt_pixel *p, int exponent, const struct pt_light *light, bool traced)
{
    const double scale = ldexp(1.0, -exponent);
    double x[PT_COMPONENTS][3], all[4];
    bool finite = true;

    for (int k = 0; k < PT_COMPONENTS; k++)
        for (int c = 0; c < 3; c++) {
            x[k][c] = component(light, k)[c] * scale;
            finite = finite && fabs(x[k][c]) < LARGEST / 4.0; /* so is the sum of the three */
        }
    p->count++;
    if (!finite)
        return false;
    for (int c = 0; c < 3; c++)
        all[c] = x[PT_MULTIPLE][c] + x[PT_SINGLE][c] + (traced ? x[PT_SURFACE][c] : 0.0);
    all[3] = luminance(all);
    for (int k = 0; k < PT_COMPONENTS; k++)
        for (int c = 0; c < 3; c++) {
            const struct pt_sum one = sum_of(x[k][c]);
            add_sum(&p->sum[k][c], &one);
        }
    for (int c = 0; c < 4; c++) {
        const struct pt_sum one = sum_of(all[c] * all[c]);
        add_square(&p->squares[c], &one);
    }
    return true;
}

void pt_pixel_merge(struct pt_pixel *p, const struct pt_pixel *other)
{
    for (int k = 0; k < PT_COMPONENTS; k++)
        for (int c = 0; c < 3; c++)
            add_sum(&p->sum[k][c], &other->sum[k][c]);
    for (int c = 0; c < 4; c++)
        add_square(&p->squares[c], &other->squares[c]);
    p->count += other->count;
}

void pt_pixel_measure(const struct pt_pixel *p, int exponent, bool traced, double mean[4], double error[4])
{
    const double n = p->count;
    struct wide sums[4];

    for (int c = 0; c < 3; c++) {
        struct pt_sum sum = p->sum[PT_MULTIPLE][c];
        add_sum(&sum, &p->sum[PT_SINGLE][c]);
        if (traced)
            add_sum(&sum, &p->sum[PT_SURFACE][c]);
        sums[c] = wide_of(&sum);
        mean[c] = n > 0.0 ? ldexp(sums[c].value / n, exponent) : 0.0;
    }
    sums[3] = (struct wide) { luminance((double[]) { sums[0].value, sums[1].value, sums[2].value }), 0.0 };
    mean[3] = n > 0.0 ? ldexp(sums[3].value / n, exponent) : 0.0;
    for (int c = 0; c < 4; c++)
        error[c] = n > 1.0 ? ldexp(sqrt(spread_of(&p->squares[c], sums[c], n) / (n * (n - 1.0))), exponent) : 0.0;
}

double pt_film_error(const struct pt_film *film, bool traced)
{
    double mean[4], error[4], total = 0.0, square = 0.0;

    for (size_t i = 0; i < film->count; i++) {
        if (film->pixels[i].count < 2)
            return (double) INFINITY;
        pt_pixel_measure(&film->pixels[i], film->exponent, traced, mean, error);
        total += mean[3];
    }
    if (!(total > 0.0))
        return 0.0;
    total /= (double) film->count;
    for (size_t i = 0; i < film->count; i++) {
        double relative;
        pt_pixel_measure(&film->pixels[i], film->exponent, traced, mean, error);
        relative = error[3] / fmax(fmax(mean[3], 0.01 * total), 1e-300); /* 0.01 of the smallest number is 0 */
        square += relative * relative;
    }
    return sqrt(square / (double) film->count);
}

/* --- Spans of samples per tile -------------------------------------------------------------------------------------------------------- */

enum pell_result pt_film_create(struct pell_context *ctx, const uint8_t *pixels, size_t tiles, struct pt_film *film)
{
    size_t count = 0;

    memset(film, 0, sizeof(*film));
    film->tiles = tiles;
    film->starts = pell_alloc_array(ctx, tiles + 1, sizeof(*film->starts));
    film->num_spans = pell_calloc(ctx, tiles, sizeof(*film->num_spans));
    if (!film->starts || !film->num_spans)
        goto fail;
    for (size_t i = 0; i < tiles; i++) {
        film->starts[i] = (uint32_t) count;
        count += pixels[i];
    }
    film->starts[tiles] = (uint32_t) count;
    film->count = film->capacity = count;
    /* Zeroed by the system: untouched tiles need no memory. */
    film->pixels = count > 0 ? pell_calloc(ctx, count, sizeof(*film->pixels)) : NULL;
    if (count > 0 && !film->pixels)
        goto fail;
    if (pt_film_reserve(ctx, film, 1) == PELL_OK)
        return PELL_OK;

fail:
    pt_film_free(ctx, film);
    return PELL_ERR_NOMEM;
}

void pt_film_free(struct pell_context *ctx, struct pt_film *film)
{
    pell_free(ctx, film->pixels);
    pell_free(ctx, film->starts);
    pell_free(ctx, film->num_spans);
    pell_free(ctx, film->spans);
    memset(film, 0, sizeof(*film));
}

enum pell_result pt_film_reserve(struct pell_context *ctx, struct pt_film *film, uint32_t more)
{
    uint32_t most = 0, room = film->span_capacity;
    struct pt_span *grown;

    for (size_t i = 0; i < film->tiles; i++)
        most = film->num_spans[i] > most ? film->num_spans[i] : most;
    if (most + more <= film->span_capacity)
        return PELL_OK;
    if (most + more > PT_SPANS)
        return pell_error(ctx, PELL_ERR_NOMEM, "path-trace", "merge files of neighbouring samples first",
                          "a tile has %u separate runs of samples, at most %d are possible", most, PT_SPANS);
    room = 2 * room > most + more ? 2 * room : most + more;
    room = room > PT_SPANS ? PT_SPANS : room;
    grown = pell_alloc_array(ctx, film->tiles * room, sizeof(*grown));
    if (!grown)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < film->tiles; i++)
        memcpy(grown + i * room, film->spans ? film->spans + i * film->span_capacity : grown, film->num_spans[i] * sizeof(*grown));
    pell_free(ctx, film->spans);
    film->spans = grown;
    film->span_capacity = room;
    return PELL_OK;
}

uint32_t pt_film_missing(const struct pt_film *film, size_t tile, uint32_t from, uint32_t *end)
{
    const struct pt_span *span = film->spans + tile * film->span_capacity;
    const uint32_t count = film->num_spans[tile];
    uint32_t i = 0;

    while (i < count && span[i].end <= from)
        i++;
    if (i < count && span[i].first <= from)
        from = span[i++].end;
    *end = i < count ? span[i].first : UINT32_MAX;
    return from;
}

void pt_film_cover(struct pt_film *film, size_t tile, struct pt_span add)
{
    struct pt_span *span = film->spans + tile * film->span_capacity;
    uint32_t count = film->num_spans[tile], i = 0;

    while (i < count && span[i].end < add.first)
        i++;
    if (i < count && span[i].end == add.first) {
        span[i].end = add.end;
        if (i + 1 < count && span[i + 1].first == add.end) {
            span[i].end = span[i + 1].end;
            count--;
            memmove(span + i + 1, span + i + 2, (count - i - 1) * sizeof(*span));
        }
    } else if (i < count && span[i].first == add.end) {
        span[i].first = add.first;
    } else {
        memmove(span + i + 1, span + i, (count - i) * sizeof(*span));
        span[i] = add;
        count++;
    }
    film->num_spans[tile] = (uint16_t) count;
}

/* The first sample of a tile that both films have; UINT32_MAX: none. */
static uint32_t common(const struct pt_film *a, const struct pt_film *b, size_t tile)
{
    for (uint32_t i = 0; i < b->num_spans[tile]; i++) {
        const struct pt_span *span = &b->spans[tile * b->span_capacity + i];
        uint32_t end, from = pt_film_missing(a, tile, span->first, &end);
        if (from > span->first)
            return span->first;
        if (end < span->end)
            return end;
    }
    return UINT32_MAX;
}

enum pell_result pt_film_merge(struct pell_context *ctx, struct pt_film *film, const struct pt_film *from, size_t *tile, uint32_t *sample)
{
    enum pell_result res;

    for (*tile = 0; *tile < film->tiles; ++*tile)
        if ((*sample = common(film, from, *tile)) != UINT32_MAX)
            return PELL_ERR_INVALID;
    res = pt_film_reserve(ctx, film, from->span_capacity);
    if (res != PELL_OK)
        return res;
    for (size_t t = 0; t < film->tiles; t++) {
        for (uint32_t i = 0; i < from->num_spans[t]; i++)
            pt_film_cover(film, t, from->spans[t * from->span_capacity + i]);
        for (uint32_t i = film->starts[t]; from->num_spans[t] > 0 && i < film->starts[t + 1]; i++)
            pt_pixel_merge(&film->pixels[i], &from->pixels[i]);
    }
    return PELL_OK;
}

bool pt_film_holds(const struct pt_film *film, const struct pt_film *part)
{
    for (size_t t = 0; t < part->tiles; t++)
        for (uint32_t i = 0; i < part->num_spans[t]; i++) {
            const struct pt_span *span = &part->spans[t * part->span_capacity + i];
            uint32_t end;
            if (pt_film_missing(film, t, span->first, &end) < span->end)
                return false;
        }
    return true;
}
