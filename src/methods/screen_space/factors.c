/* SPDX-License-Identifier: MIT
 * factors.c - see factors.h. */
#include "methods/screen_space/factors.h"
#include "methods/screen_space/chain.h"

#include "base/base.h"
#include "math/vec.h"
#include "methods/thickness.h"

#include <math.h>
#include <string.h>

enum { TAPS = PELL_KERNEL_TAPS_MAX, HALF = TAPS / 2, EDGES = HALF + 2 };
#define SPREAD 3.0
#define PEAK 0.1     /* fraction of a channel's light nearest to the entry point, for profiles with a singularity there */
#define INSIDE 0.995 /* fraction of the widest channel's light within the extent */

/* The integral of a factor from the centre to the edges between taps, and the coordinates of those: sqrt(x/extent). */
struct edges {
    double coord[EDGES], integral[EDGES];
};

static void find_edges(const struct pell_separable *s, int term, int channel, double divisor, struct edges *e)
{
    double sum = 0.5 * s->weight[term][HALF][channel];

    e->coord[0] = e->integral[0] = 0.0;
    for (int i = 0; i <= HALF; i++) {
        const double at = s->offset_mm[HALF + i], next = i < HALF ? s->offset_mm[HALF + i + 1] : 2.0 * s->extent_mm - at;
        if (i > 0)
            sum += s->weight[term][HALF + i][channel];
        e->coord[i + 1] = sqrt(0.5 * (at + next) / s->extent_mm);
        e->integral[i + 1] = sum / divisor;
    }
}

static double slope(const struct edges *e, int i)
{
    const int low = i - 1, high = i < EDGES - 1 ? i + 1 : i;

    if (i == 0) /* the integral of a finite factor is linear in x, so flat in sqrt(x) */
        return 0.0;
    return (e->integral[high] - e->integral[low]) / (e->coord[high] - e->coord[low]);
}

/* Between the edges by cubics. */
static double between(const struct edges *e, double coord)
{
    double width, t;
    int k = 0;

    while (k < EDGES - 2 && coord > e->coord[k + 1])
        k++;
    width = e->coord[k + 1] - e->coord[k];
    t = fmin((coord - e->coord[k]) / width, 1.0);
    return (1.0 + 2.0 * t) * (1.0 - t) * (1.0 - t) * e->integral[k] + t * t * (3.0 - 2.0 * t) * e->integral[k + 1] +
           width * (t * (1.0 - t) * (1.0 - t) * slope(e, k) - t * t * (1.0 - t) * slope(e, k + 1));
}

/* The cubics through both ends of each interval, and its thirds. */
static void fill(const struct edges *e, int channel, struct screen_factor *f)
{
    for (int k = 0; k < SCREEN_FACTOR_PARTS; k++) {
        double y[4];
        for (int i = 0; i < 4; i++)
            y[i] = between(e, (k + i / 3.0) / SCREEN_FACTOR_PARTS);
        f->cubic[channel][0][k] = (float) y[0];
        f->cubic[channel][1][k] = (float) (-5.5 * y[0] + 9.0 * y[1] - 4.5 * y[2] + y[3]);
        f->cubic[channel][2][k] = (float) (9.0 * y[0] - 22.5 * y[1] + 18.0 * y[2] - 4.5 * y[3]);
        f->cubic[channel][3][k] = (float) (-4.5 * y[0] + 13.5 * y[1] - 13.5 * y[2] + 4.5 * y[3]);
    }
}

static void make(const struct pell_separable *s, int channel, struct screen_factor *terms)
{
    const double root = sqrt(s->total[channel]);

    for (int k = 0; k < s->rank; k++) {
        struct edges e;
        if (!(root > 0.0)) { /* no light scatters: all of it stays */
            terms[k].integral[channel] = terms[k].sign[channel] = k == 0 ? 1.0f : 0.0f;
            continue;
        }
        find_edges(s, k, channel, root, &e);
        fill(&e, channel, &terms[k]);
        terms[k].integral[channel] = (float) (2.0 * e.integral[EDGES - 1]);
        terms[k].sign[channel] = (float) s->sign[k][channel];
    }
}

/* sqrt(Int (R - kernel)^2 / Int R^2) over the square of the extent, including the total. */
static double energy_error(const struct pell_profile *p, const struct screen_factor *terms, int rank, int channel, double extent)
{
    enum { CELLS = 128, ROWS = 4, STEPS = CELLS * ROWS };
    const double square = extent / ((double) STEPS * STEPS);
    double value[PELL_KERNEL_RANK_MAX][CELLS], middle[CELLS], width[CELLS], error2 = 0.0, norm2 = 0.0;

    for (int i = 0; i < CELLS; i++) {
        const int row = ROWS * i + ROWS / 2;
        middle[i] = square * row * row;
        width[i] = square * 2.0 * ROWS * row;
        for (int k = 0; k < rank; k++)
            value[k][i] = ((double) pell_ss_factor_integral(&terms[k], channel, (float) (row + 1) / STEPS) -
                           (double) pell_ss_factor_integral(&terms[k], channel, (float) (row - 1) / STEPS)) /
                          (square * 4.0 * row);
    }
    for (int i = 0; i < CELLS; i++)
        for (int j = 0; j <= i; j++) {
            const double area = width[i] * width[j] * (j < i ? 2.0 : 1.0), expected = pell_profile_eval(p, hypot(middle[i], middle[j]));
            double actual = 0.0;
            for (int k = 0; k < rank; k++)
                actual += (double) terms[k].sign[channel] * value[k][i] * value[k][j];
            actual *= pell_profile_total(p);
            error2 += area * (actual - expected) * (actual - expected);
            norm2 += area * expected * expected;
        }
    return norm2 > 0.0 ? sqrt(error2 / norm2) : 0.0;
}

/* Profiles with a singularity at r = 0 (single scattering goes like 1/r) have all of their square norm there, and the best kernel in that
 * norm is a delta function: its light is kept, but not resolved. */
static bool flatten_peak(struct pell_profile *p)
{
    enum { INNER = 24, ROWS = 256 };
    const double q = pell_profile_sample(p, PEAK), end = pell_profile_sample(p, INSIDE);
    const double mean = pell_profile_total(p) * PEAK / (PELL_PI * q * q);
    double r[ROWS], R[ROWS], rise;

    if (!(q > 0.0) || !(end > q) || pell_profile_eval(p, 0.02 * q) < 2.0 * mean)
        return true;
    for (int i = 0; i < ROWS; i++)
        r[i] = i < INNER ? q * i / INNER : q * pow(end / q, (double) (i - INNER) / (ROWS - 1 - INNER));
    pell_profile_eval_many(p, r, R, ROWS);
    rise = 3.0 * fmax(mean / R[INNER] - 1.0, 0.0);
    for (int i = 0; i < INNER; i++) {
        const double fall = 1.0 - r[i] * r[i] / (q * q);
        R[i] = R[INNER] * (1.0 + rise * fall * fall);
    }
    return pell_profile_from_table(r, R, ROWS, p, NULL) == PELL_OK;
}

static bool find_profiles(const struct screen_chain *chain, const struct pell_frame_material *m, size_t index, struct pell_profile p[3])
{
    const bool published = chain->knobs.profile == SCREEN_PROFILE_PUBLISHED && pell_ss_published(m);

    for (int c = 0; c < 3; c++) {
        if (!published)
            p[c] = m->profile[c];
        else if (pell_profile_from_gaussians(&chain->profiles[index], c, &p[c]) != PELL_OK)
            return false;
        if (pell_profile_total(&p[c]) > 0.0 && !flatten_peak(&p[c]))
            return false;
    }
    return true;
}

static double radius_of(const struct pell_profile p[3])
{
    double radius = 0.0;

    for (int c = 0; c < 3; c++)
        if (pell_profile_total(&p[c]) > 0.0)
            radius = fmax(radius, pell_profile_sample(&p[c], INSIDE));
    return radius;
}

enum pell_result pell_ss_factors_make(const struct screen_chain *chain, const struct pell_frame_shape *shape, struct screen_factors *out)
{
    const size_t n = shape->num_materials;
    struct pell_profile *profiles = pell_alloc(chain->ctx, 3 * sizeof(*profiles));
    enum pell_result res = PELL_ERR_NOMEM;

    out->rank = chain->knobs.rank;
    out->extent_mm = pell_calloc(chain->ctx, n + 1, sizeof(*out->extent_mm));
    out->factor = pell_calloc(chain->ctx, (n + 1) * (size_t) out->rank, sizeof(*out->factor));
    if (!profiles || !out->extent_mm || !out->factor)
        goto fail;
    for (size_t i = 0; i < n; i++) {
        const struct pell_frame_material *m = &shape->materials[i];
        const size_t first = pell_first_alike(shape, i);
        struct screen_factor *terms = &out->factor[(i + 1) * (size_t) out->rank];
        struct pell_separable_params params = { .taps = TAPS, .rank = out->rank, .spread = SPREAD };
        struct pell_separable s;
        double error[3];

        if (first < i) {
            out->extent_mm[i + 1] = out->extent_mm[first + 1];
            memcpy(terms, &out->factor[(first + 1) * (size_t) out->rank], (size_t) out->rank * sizeof(*terms));
            continue;
        }
        memset(&s, 0, sizeof(s));
        s.rank = out->rank;
        if (!find_profiles(chain, m, i, profiles) ||
            ((params.extent_mm = radius_of(profiles)) > 0.0 && pell_separable_make(profiles, &params, &s) != PELL_OK)) {
            res = pell_error(chain->ctx, PELL_ERR_INVALID, m->name, "change its coefficients, or use kernel=gaussians",
                             "no separable kernel fits this material's profile");
            goto fail;
        }
        out->extent_mm[i + 1] = (float) s.extent_mm;
        for (int c = 0; c < 3; c++) {
            make(&s, c, terms);
            error[c] = 100.0 * energy_error(&profiles[c], terms, s.rank, c, s.extent_mm);
        }
        pell_info(chain->ctx, m->name, "separable kernel of rank %d: energy error %.2f %.2f %.2f %%", s.rank, error[0], error[1], error[2]);
    }
    res = PELL_OK;

fail:
    pell_free(chain->ctx, profiles);
    return res;
}

void pell_ss_factors_finish(struct pell_context *ctx, struct screen_factors *f)
{
    pell_free(ctx, f->factor);
    pell_free(ctx, f->extent_mm);
}
