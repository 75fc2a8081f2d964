/* SPDX-License-Identifier: MIT
 *
 * errors.h - one pixel of a pair of images, and the errors that are means over pixels.
 */
#ifndef PELL_COMPARE_ERRORS_H
#define PELL_COMPARE_ERRORS_H

#include "base/pool.h"

#include <pellucid/compare.h>

#include <math.h>

enum { PELL_MASKED, PELL_WHOLE, PELL_REGIONS };

struct pell_pixel {
    double test[3], reference[3];         /* reference: the mean of its halves */
    double difference[3];                 /* test - reference */
    double half[3];                       /* half the difference of the halves; its square is an estimate of `variance` */
    double variance[3];                   /* variance of the reference, as subtracted from errors; 0: not known */
    double reported[3], test_reported[3]; /* variances reported by the renderers; 0: not known */
    bool bad_test, bad_reference;
    bool bad_variance; /* the only flaw of the reference */
};

static inline bool pell_bad_variance(double v)
{
    return !isfinite(v) || v < 0.0;
}

/* Replaces values that are not finite by the reference's, or 0. */
static inline void pell_pixel_read(const struct pell_compare_input *in, size_t at, struct pell_pixel *p)
{
    bool finite = true, valid = true;

    p->bad_test = false;
    for (int c = 0; c < 3; c++) {
        const double b1 = in->reference[c][at], b2 = in->half[0] ? in->half[c][at] : b1;
        p->test[c] = in->test[c][at];
        p->reference[c] = 0.5 * (b1 + b2);
        p->half[c] = 0.5 * (b1 - b2);
        p->reported[c] = in->variance[0] ? in->variance[c][at] : 0.0;
        p->test_reported[c] = in->test_variance[0] ? in->test_variance[c][at] : 0.0;
        p->variance[c] = in->half[0] ? p->half[c] * p->half[c] : p->reported[c];
        p->bad_test |= !isfinite(p->test[c]) || pell_bad_variance(p->test_reported[c]);
        finite = finite && isfinite(p->reference[c]);
        valid = valid && !pell_bad_variance(p->reported[c]);
    }
    p->bad_reference = !finite || !valid;
    p->bad_variance = finite && !valid;
    for (int c = 0; c < 3 && (p->bad_test || p->bad_reference); c++) {
        p->reference[c] = p->bad_reference ? 0.0 : p->reference[c];
        p->test[c] = p->reference[c];
        p->half[c] = p->variance[c] = p->reported[c] = p->test_reported[c] = 0.0;
    }
    for (int c = 0; c < 3; c++)
        p->difference[c] = p->test[c] - p->reference[c];
}

static inline double pell_luminance_of(const double rgb[3])
{
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* Index of a pixel in planes that begin with row `first`. */
static inline size_t pell_pixel_at(const struct pell_compare_input *in, int first, int x, int y)
{
    return (size_t) (y - first) * (size_t) in->stride + (size_t) x;
}

static inline bool pell_inside(const struct pell_compare_input *in, size_t at)
{
    return !in->mask || in->mask[at] > 0.5f;
}

/* Rows above and below a row that its errors depend on, and rows per band. */
#define PELL_ERRORS_REACH 8
#define PELL_ERRORS_BAND 16

/* From `pixels` and `floor` of out's metrics: mse to rel_bias, their standard errors, the agreement, and the map `relative`. Between begin
 * and end all rows are added, in bands whose first row is a multiple of PELL_ERRORS_BAND and whose last one is, or is the image's last.
 * `in` may point to other planes each time: they begin with row `first`, and hold the rows of the band with PELL_ERRORS_REACH around. */
struct pell_errors;
PELL_NODISCARD enum pell_result pell_errors_begin(struct pell_context *ctx, struct pell_pool *pool, const struct pell_compare_input *in,
                                                  struct pell_comparison *out, struct pell_errors **errors);
void pell_errors_add(struct pell_errors *errors, const struct pell_compare_input *in, int first, int y0, int y1);
/* Sets out's metrics if `good`, and releases `*errors`, which may be NULL. */
void pell_errors_end(struct pell_errors **errors, bool good);

/* A part of the light of both images: planes as in struct pell_compare_input, finite where those are. */
struct pell_compare_part {
    const float *test[3], *reference[3], *half[3], *variance[3];
};

/* Errors of a part, relative to the whole reference: sets mse to rel_bias and their standard errors of `out`, whose `pixels` and `floor`
 * are those that pell_compare gave for the masked pixels of `in`. */
PELL_NODISCARD enum pell_result pell_errors_of_part(struct pell_context *ctx, int threads, const struct pell_compare_input *in,
                                                    const struct pell_compare_part *part, struct pell_metrics *out);

#endif
