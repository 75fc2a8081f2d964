/* SPDX-License-Identifier: MIT
 *
 * kernel.c - profiles as taps, separable kernels and lookup tables. */
#include <pellucid/kernel.h>

#include "math/vec.h"

#include <math.h>
#include <string.h>

/* --- One blur for each Gaussian ------------------------------------------------------------------------------------------------ */

/* Weights exp(-(i step)^2/(2 width^2)) of sum 1 for i = -half..half, in units of the standard deviation; their variance. */
static double taps(int half, double step, double width, double *weight)
{
    double sum = 0.0, moment = 0.0;

    for (int i = -half; i <= half; i++) {
        const double x = i * step / width;
        weight[i + half] = exp(-0.5 * x * x);
        sum += weight[i + half];
        moment += weight[i + half] * (i * step) * (i * step);
    }
    for (int i = 0; i <= 2 * half; i++)
        weight[i] /= sum;
    return moment / sum;
}

enum pell_result pell_kernel_gaussian_taps(double variance_mm2, int count, double *offset_mm, double *weight)
{
    if (!offset_mm || !weight)
        return PELL_ERR_INVALID;

    if (count < 3 || count > PELL_KERNEL_TAPS_MAX || count % 2 == 0 || !(variance_mm2 >= 1e-200) || !(variance_mm2 <= 1e200))
        return PELL_ERR_INVALID;
    /* Truncation and spacing errors balance at a reach of sqrt(2 pi half); it is less here, as images have little energy at the frequencies
     * that the gaps miss. The width then compensates for the truncation. */
    const int half = count / 2;
    const double step = 0.62 * sqrt(2.0 * PELL_PI * half) / half;
    double narrow = 0.05, wide = 100.0;
    for (int i = 0; i < 60; i++) {
        const double width = sqrt(narrow * wide);
        if (taps(half, step, width, weight) < 1.0)
            narrow = width;
        else
            wide = width;
    }
    const double scale = sqrt(variance_mm2 / taps(half, step, sqrt(narrow * wide), weight));
    for (int i = -half; i <= half; i++)
        offset_mm[i + half] = i * step * scale;
    return PELL_OK;
}

enum pell_result pell_kernel_chain_make(const struct pell_gaussians *g, struct pell_kernel_chain *out)
{
    if (!g || !out)
        return PELL_ERR_INVALID;

    double sum[3] = { 0.0 };

    memset(out, 0, sizeof(*out));
    if (g->count < 0 || g->count > PELL_GAUSSIANS_MAX)
        return PELL_ERR_INVALID;
    for (int i = 0; i < g->count; i++) {
        const double before = i > 0 ? g->variance[i - 1] : 0.0;
        bool valid = g->variance[i] >= before && isfinite(g->variance[i]);
        for (int c = 0; c < 3; c++)
            valid = valid && g->weight[i][c] >= 0.0 && isfinite(g->weight[i][c]);
        if (!valid) {
            memset(out, 0, sizeof(*out));
            return PELL_ERR_INVALID;
        }
        out->step_mm2[i] = g->variance[i] - before;
        for (int c = 0; c < 3; c++) {
            sum[c] += g->weight[i][c];
            out->blend[i][c] = sum[c] > 0.0 ? g->weight[i][c] / sum[c] : 0.0;
        }
    }
    out->count = g->count;
    memcpy(out->total, sum, sizeof(sum));
    return PELL_OK;
}

/* --- Separable kernels --------------------------------------------------------------------------------------------------------- */

#define CELLS 96 /* per half axis; edges at the cubes of equal steps */
#define BLOCK 6  /* vectors iterated to find the first three */

/* R over the quadrant, times the roots of the cells' areas: a symmetric matrix whose eigenvectors are the factors. */
struct quadrant {
    double edge[CELLS + 1], width[CELLS];
    double m[CELLS][CELLS];
    double square; /* sum of the squares of all elements */
    double light;  /* in the square of four quadrants */
};

static bool quadrant_make(const struct pell_profile *p, double extent, struct quadrant *q)
{
    double x[CELLS], r[CELLS], value[CELLS];

    for (int i = 0; i <= CELLS; i++) {
        const double t = (double) i / CELLS;
        q->edge[i] = extent * t * t * t;
    }
    for (int i = 0; i < CELLS; i++) {
        q->width[i] = q->edge[i + 1] - q->edge[i];
        x[i] = 0.5 * (q->edge[i] + q->edge[i + 1]);
    }
    q->square = q->light = 0.0;
    for (int i = 0; i < CELLS; i++) {
        for (int j = 0; j <= i; j++)
            r[j] = hypot(x[i], x[j]);
        pell_profile_eval_many(p, r, value, (size_t) i + 1);
        for (int j = 0; j <= i; j++) {
            const double area = q->width[i] * q->width[j], m = sqrt(area) * value[j];
            q->m[i][j] = q->m[j][i] = m;
            q->square += (j < i ? 2.0 : 1.0) * m * m;
            q->light += (j < i ? 2.0 : 1.0) * 4.0 * area * value[j];
        }
    }
    return isfinite(q->square) && q->square > 0.0;
}

/* Makes the rows of v orthonormal. */
static void orthonormalise(double v[BLOCK][CELLS])
{
    for (int a = 0; a < BLOCK; a++) {
        double size = 0.0;
        for (int pass = 0; pass < 2; pass++)
            for (int b = 0; b < a; b++) {
                double c = 0.0;
                for (int i = 0; i < CELLS; i++)
                    c += v[a][i] * v[b][i];
                for (int i = 0; i < CELLS; i++)
                    v[a][i] -= c * v[b][i];
            }
        for (int i = 0; i < CELLS; i++)
            size += v[a][i] * v[a][i];
        size = sqrt(size);
        for (int i = 0; i < CELLS; i++)
            v[a][i] = size > 0.0 ? v[a][i] / size : 0.0;
    }
}

/* Jacobi rotations of a small symmetric matrix; columns of `vector` become its eigenvectors. */
static void jacobi(double m[BLOCK][BLOCK], double vector[BLOCK][BLOCK])
{
    for (int i = 0; i < BLOCK; i++)
        for (int j = 0; j < BLOCK; j++)
            vector[i][j] = i == j ? 1.0 : 0.0;
    for (int sweep = 0; sweep < 30; sweep++)
        for (int a = 0; a < BLOCK; a++)
            for (int b = a + 1; b < BLOCK; b++) {
                if (m[a][b] == 0.0)
                    continue;
                const double angle = 0.5 * atan2(2.0 * m[a][b], m[a][a] - m[b][b]), c = cos(angle), s = sin(angle);
                for (int i = 0; i < BLOCK; i++) {
                    const double x = m[i][a], y = m[i][b];
                    m[i][a] = c * x + s * y;
                    m[i][b] = c * y - s * x;
                }
                for (int i = 0; i < BLOCK; i++) {
                    const double x = m[a][i], y = m[b][i];
                    m[a][i] = c * x + s * y;
                    m[b][i] = c * y - s * x;
                    const double u = vector[i][a], w = vector[i][b];
                    vector[i][a] = c * u + s * w;
                    vector[i][b] = c * w - s * u;
                }
            }
}

/* The eigenvectors of the `rank` eigenvalues of largest magnitude, by block power iteration. */
static void principal(const struct quadrant *q, int rank, double value[PELL_KERNEL_RANK_MAX], double vector[PELL_KERNEL_RANK_MAX][CELLS])
{
    double v[BLOCK][CELLS], w[BLOCK][CELLS], projected[BLOCK][BLOCK], rotation[BLOCK][BLOCK];

    for (int a = 0; a < BLOCK; a++)
        for (int i = 0; i < CELLS; i++)
            v[a][i] = cos(PELL_PI * a * (i + 0.5) / CELLS);
    for (int round = 0; round < 40; round++) {
        orthonormalise(v);
        for (int a = 0; a < BLOCK; a++)
            for (int i = 0; i < CELLS; i++) {
                w[a][i] = 0.0;
                for (int j = 0; j < CELLS; j++)
                    w[a][i] += q->m[i][j] * v[a][j];
            }
        if (round < 39)
            memcpy(v, w, sizeof(v));
    }
    for (int a = 0; a < BLOCK; a++)
        for (int b = 0; b < BLOCK; b++) {
            projected[a][b] = 0.0;
            for (int i = 0; i < CELLS; i++)
                projected[a][b] += 0.5 * (v[a][i] * w[b][i] + v[b][i] * w[a][i]);
        }
    jacobi(projected, rotation);
    for (int k = 0; k < rank; k++) {
        int best = k;
        for (int a = 0; a < BLOCK; a++) { /* find the k-th in magnitude by counting larger ones */
            int larger = 0;
            for (int b = 0; b < BLOCK; b++)
                larger += fabs(projected[b][b]) > fabs(projected[a][a]) || (fabs(projected[b][b]) == fabs(projected[a][a]) && b < a);
            if (larger == k)
                best = a;
        }
        value[k] = projected[best][best];
        for (int i = 0; i < CELLS; i++) {
            vector[k][i] = 0.0;
            for (int a = 0; a < BLOCK; a++)
                vector[k][i] += rotation[a][best] * v[a][i];
        }
    }
}

/* Int_a^b of a factor that is constant in each cell, 0 <= a <= b. */
static double integrate(const struct quadrant *q, const double *vector, double a, double b)
{
    double sum = 0.0;
    for (int i = 0; i < CELLS; i++) {
        const double low = fmax(a, q->edge[i]), high = fmin(b, q->edge[i + 1]);
        if (high > low)
            sum += (high - low) * vector[i] / sqrt(q->width[i]);
    }
    return sum;
}

static bool separate(const struct pell_profile *p, int c, struct pell_separable *out)
{
    const int half = out->taps / 2;
    const double total = pell_profile_total(p);
    double value[PELL_KERNEL_RANK_MAX], vector[PELL_KERNEL_RANK_MAX][CELLS], captured = 0.0, sum = 0.0;
    struct quadrant q;

    if (!quadrant_make(p, out->extent_mm, &q))
        return false;
    principal(&q, out->rank, value, vector);
    for (int k = 0; k < out->rank; k++) {
        double weight_sum = 0.0;
        captured += value[k] * value[k];
        out->sign[k][c] = value[k] < 0.0 ? -1.0 : 1.0;
        for (int i = 0; i <= half; i++) {
            const double at = out->offset_mm[half + i];
            const double low = i > 0 ? 0.5 * (at + out->offset_mm[half + i - 1]) : 0.0;
            const double high = i < half ? 0.5 * (at + out->offset_mm[half + i + 1]) : out->extent_mm;
            const double weight = sqrt(fabs(value[k])) * (i > 0 ? 1.0 : 2.0) * integrate(&q, vector[k], low, high);
            out->weight[k][half + i][c] = out->weight[k][half - i][c] = weight;
            weight_sum += i > 0 ? 2.0 * weight : weight;
        }
        sum += out->sign[k][c] * weight_sum * weight_sum;
    }
    if (!(sum > 0.0))
        return false;
    for (int k = 0; k < out->rank; k++)
        for (int i = 0; i < out->taps; i++)
            out->weight[k][i][c] *= sqrt(total / sum);
    out->total[c] = total;
    out->outside[c] = fmin(fmax(1.0 - q.light / total, 0.0), 1.0);
    out->error[c] = sqrt(fmax(0.0, 1.0 - captured / q.square));
    return true;
}

enum pell_result pell_separable_make(const struct pell_profile profiles[3], const struct pell_separable_params *params,
                                     struct pell_separable *out)
{
    if (!profiles || !out)
        return PELL_ERR_INVALID;

    const struct pell_separable_params none = { 0 }, *p = params ? params : &none;
    const double spread = p->spread == 0.0 ? 2.0 : p->spread;
    double extent = p->extent_mm;

    memset(out, 0, sizeof(*out));
    out->taps = p->taps == 0 ? 25 : p->taps;
    out->rank = p->rank == 0 ? 1 : p->rank;
    for (int c = 0; c < 3; c++)
        if (p->extent_mm == 0.0)
            extent = fmax(extent, pell_profile_total(&profiles[c]) > 0.0 ? pell_profile_sample(&profiles[c], 0.98) : 0.0);
    if (out->taps < 3 || out->taps > PELL_KERNEL_TAPS_MAX || out->taps % 2 == 0 || out->rank < 1 || out->rank > PELL_KERNEL_RANK_MAX ||
        !(spread >= 1.0) || !(spread <= 4.0) || !(extent >= 1e-100) || !(extent <= 1e100))
        goto invalid;
    out->extent_mm = extent;
    for (int i = 0, half = out->taps / 2; i <= half; i++) {
        /* half a step short of the extent, where the last tap's cell ends */
        const double t = (double) i / (half + 0.5);
        out->offset_mm[half + i] = extent * pow(t, spread);
        out->offset_mm[half - i] = -out->offset_mm[half + i];
    }
    bool light = false;
    for (int c = 0; c < 3; c++)
        if (pell_profile_total(&profiles[c]) > 0.0) {
            if (!separate(&profiles[c], c, out))
                goto invalid;
            light = true;
        }
    if (light)
        return PELL_OK;
invalid:
    memset(out, 0, sizeof(*out));
    return PELL_ERR_INVALID;
}

/* --- Lookup tables ------------------------------------------------------------------------------------------------------------- */

/* Light between two radii; differences of the fraction inside lose precision far out, where R is smooth. */
static double ring(const struct pell_profile *p, double inner, double outer)
{
    const double fraction = pell_profile_cdf(p, outer) - pell_profile_cdf(p, inner);
    if (fraction > 1e-6)
        return pell_profile_total(p) * fraction;
    return pell_profile_eval(p, 0.5 * (inner + outer)) * PELL_PI * (outer - inner) * (outer + inner);
}

static enum pell_result rings(const struct pell_profile *p, double r_max_mm, float *texel, size_t count, bool per_area)
{
    if (!(r_max_mm >= 1e-30) || !(r_max_mm <= 1e30) || count < 1 || count > 1u << 24)
        return PELL_ERR_INVALID;
    for (size_t i = 0; i < count; i++) {
        const double inner = r_max_mm * ((double) i / (double) count), outer = r_max_mm * ((double) (i + 1) / (double) count);
        const double light = pell_profile_total(p) > 0.0 ? ring(p, inner, outer) : 0.0;
        texel[i] = (float) (per_area ? light / (PELL_PI * (outer - inner) * (outer + inner)) : light);
    }
    return PELL_OK;
}

enum pell_result pell_kernel_table_value(const struct pell_profile *profile, double r_max_mm, float *texel, size_t count)
{
    if (!profile || !texel)
        return PELL_ERR_INVALID;

    return rings(profile, r_max_mm, texel, count, true);
}

enum pell_result pell_kernel_table_ring(const struct pell_profile *profile, double r_max_mm, float *texel, size_t count)
{
    if (!profile || !texel)
        return PELL_ERR_INVALID;

    return rings(profile, r_max_mm, texel, count, false);
}

enum pell_result pell_kernel_table_radius(const struct pell_profile *profile, float *texel, size_t count)
{
    if (!profile || !texel)
        return PELL_ERR_INVALID;

    if (count < 1 || count > 1u << 24)
        return PELL_ERR_INVALID;
    for (size_t i = 0; i < count; i++)
        texel[i] = (float) pell_profile_sample(profile, ((double) i + 0.5) / (double) count);
    return PELL_OK;
}

#define ARC 256 /* nodes of half a great circle, dense where the profile is high */

enum pell_result pell_kernel_table_sphere(const struct pell_profile *profile, double curvature_max, float *texel, size_t width,
                                          size_t height)
{
    if (!profile || !texel)
        return PELL_ERR_INVALID;

    const double total = pell_profile_total(profile);

    if (!(curvature_max >= 1e-30) || !(curvature_max <= 1e30) || width < 1 || height < 1 || width > 16384 || height > 16384)
        return PELL_ERR_INVALID;
    const double reach = total > 0.0 ? 8.0 * pell_profile_sample(profile, 0.999) : 1.0;
    for (size_t j = 0; j < height; j++) {
        const double radius = (double) height / (curvature_max * ((double) j + 0.5)), chord = reach / (2.0 * radius);
        const double end = chord < 1.0 ? 2.0 * asin(chord) : PELL_PI;
        double r[ARC], weight[ARC], cosine[ARC], sine[ARC], sum = 0.0;
        for (int k = 0; k < ARC; k++) {
            const double t = (k + 0.5) / ARC, x = end * t * t * t;
            r[k] = 2.0 * radius * sin(0.5 * x);
            cosine[k] = cos(x);
            sine[k] = sin(x);
        }
        pell_profile_eval_many(profile, r, weight, ARC);
        for (int k = 0; k < ARC; k++) {
            const double t = (k + 0.5) / ARC;
            weight[k] *= t * t;
            sum += 2.0 * weight[k];
        }
        for (size_t i = 0; i < width; i++) {
            const double c = -1.0 + 2.0 * ((double) i + 0.5) / (double) width, s = sqrt(1.0 - c * c);
            double lit = 0.0;
            for (int k = 0; k < ARC; k++)
                lit += weight[k] * (fmax(c * cosine[k] - s * sine[k], 0.0) + fmax(c * cosine[k] + s * sine[k], 0.0));
            texel[j * width + i] = (float) (sum > 0.0 ? total * lit / sum : 0.0);
        }
    }
    return PELL_OK;
}
