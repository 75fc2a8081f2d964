/* SPDX-License-Identifier: MIT
 *
 * gaussians.c - solves stacks with Gaussians as basis functions, d'Eon, Luebke, Enderton 2007, section 4: each response is a polynomial of
 * one narrow Gaussian (eqs. (14), (15)), convolutions are products, and the series over bounces between layers (eqs. (3), (4)) ends by the
 * Kubelka-Munk total (eq. (13)). Powers beyond the first block are kept in octaves: a value between two powers is distributed to both,
 * preserving energy and second moment. */
#include "optics/layers/kernels.h"

#include "base/simd.h"
#include "math/nnls.h"
#include "math/vec.h"
#include "optics/profile/nodes.h"
#include "optics/profile/shape.h"

#include <math.h>
#include <string.h>

PELL_SIMD_TABLES(struct pell_layers_kernels, pell_layers_kernels);

#define SHARPER 16.0 /* d'Eon's bound min(l, d - l)^2/4 allows one Gaussian for the narrowest source; ours is smaller by this factor */

struct algebra {
    const struct pell_layers_kernels *kernels;
    int block, octaves, count; /* elements of a polynomial */
    double narrow, energy_loss;
    double *variance, *step; /* of each element: j 2^p v, and its interval on the axis */
    double *upper[4], *sum[4], *x, *y, *z;
    int terms;
};

#define POLYNOMIALS 13

static int block_of(const struct pell_stack_gaussians_params *params)
{
    return params && params->block ? params->block : 32;
}

static size_t elements(int block)
{
    return (size_t) block + 1 + (size_t) PELL_STACK_OCTAVES * (size_t) block / 2;
}

size_t pell_stack_workspace_size(const struct pell_stack_gaussians_params *params)
{
    const int block = block_of(params);
    return block >= 8 && block <= PELL_STACK_BLOCK_MAX ? POLYNOMIALS * elements(block) * sizeof(double) : 0;
}

/* Weights of the trapezoidal rule on the axis; where the step doubles, with the Euler-Maclaurin correction, by finite differences. */
static void make_axis(struct algebra *g)
{
    const int m = g->block, half = m / 2;
    double step = g->narrow;

    for (int j = 0; j <= m; j++) {
        g->variance[j] = j * step;
        g->step[j] = step;
    }
    for (int p = 1, i = m + 1; p <= g->octaves; p++, i += half) {
        step *= 2.0;
        for (int j = 0; j < half; j++) {
            g->variance[i + j] = (half + 1 + j) * step;
            g->step[i + j] = step;
        }
        g->step[i - 1] = 0.75 * step;
        g->step[i] += step / 32.0;
        g->step[i - 3] -= step / 32.0;
    }
}

/* The fewest octaves that hold all but 1e-9 of the slabs' response. */
static int octaves_for(const struct pell_slabs *slabs, double narrow, int block)
{
    double longest = 0.0;
    for (int i = 0; i < slabs->count; i++) {
        const struct pell_multipole_slab *y = &slabs->slab[i];
        const double L = y->d + y->zb[0] + y->zb[1];
        /* exp(-(sigma^2 + (pi/L)^2) v/2) = 1e-12; its powers, as light crosses layers repeatedly, have longer tails */
        const double rate = 0.5 * (y->sigma_tr * y->sigma_tr + (isinf(L) ? 0.0 : PELL_PI * PELL_PI / (L * L)));
        longest = fmax(longest, rate > 0.0 ? 28.0 / rate : INFINITY);
    }
    int p = 2;
    while (p < PELL_STACK_OCTAVES && block * narrow * exp2(p) < 2.0 * longest)
        p++;
    return p;
}

static double sum_of(const double *w, int n)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        sum += w[i];
    return sum;
}

/* Scales weights to a given sum. */
static void scale_to_sum(const struct algebra *g, double *w, double total)
{
    const double sum = sum_of(w, g->count);
    if (!(sum > 0.0)) {
        memset(w, 0, (size_t) g->count * sizeof(*w));
        w[0] = total;
        return;
    }
    for (int i = 0; i < g->count; i++) {
        w[i] *= total / sum;
        if (fabs(w[i]) < 1e-14 * total) /* below rounding errors; also avoids denormals in products */
            w[i] = 0.0;
    }
}

/* Clips weights to >= 0 and keeps their sum; returns the sum of the removed negative ones relative to the positive. */
static double clip(double *w, int n)
{
    const double total = sum_of(w, n);
    double positive = 0.0;
    for (int i = 0; i < n; i++) {
        w[i] = fmax(w[i], 0.0);
        positive += w[i];
    }
    if (!(total > 0.0) || !(positive > 0.0)) {
        memset(w, 0, (size_t) n * sizeof(*w));
        return positive > 0.0 ? 1.0 : 0.0;
    }
    for (int i = 0; i < n; i++)
        w[i] *= total / positive;
    return (positive - total) / positive;
}

/* Sum of the absolute weights. */
static double magnitude(const double *w, int n)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        sum += fabs(w[i]);
    return sum;
}

/* Adds the poles of one response, by the exact mixture. */
static void by_mixture(struct algebra *g, const struct pell_multipole_slab *y, double depth, double zb, double L, double *w)
{
    struct pell_mixture m = { .albedo = y->albedo, .sigma2 = y->sigma_tr * y->sigma_tr, .a = { depth, depth + 2.0 * zb }, .L = L };

    for (int n = 1; n <= 5 && !isinf(L); n++) {
        const double theta = n * PELL_PI / L;
        m.mode[n - 1] = y->albedo / L * theta * cos(zb * theta) * sin((zb + depth) * theta);
    }
    w[0] = 0.0;
    g->kernels->mixture(&m, g->variance + 1, g->count - 1, w + 1);
    for (int i = 1; i < g->count; i++)
        w[i] *= g->step[i];
}

/* Adds a Gaussian of the given variance on the axis. */
static void deposit(const struct algebra *g, double variance, double weight, double *w)
{
    int low = 0, high = g->count - 1;
    if (variance >= g->variance[high]) {
        w[high] += weight;
        return;
    }
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        *(variance < g->variance[middle] ? &high : &low) = middle;
    }
    const double fraction = (variance - g->variance[low]) / (g->variance[high] - g->variance[low]);
    w[low] += (1.0 - fraction) * weight;
    w[high] += fraction * weight;
}

static void deposit_pole(const struct algebra *g, double z, const struct pell_multipole_slab *y, double *w)
{
    double variance[4], weight[4];
    if (pell_pole_appendix_a(z, y->sigma_tr, PELL_APPENDIX_A_BEST_ENERGY, variance, weight) == PELL_OK)
        for (int k = 0; k < 4; k++)
            deposit(g, variance[k], y->albedo * weight[k], w);
}

/* The same by the closed-form fits of appendix A, signed, image by image. */
static void by_appendix_a(const struct algebra *g, const struct pell_multipole_slab *y, double depth, double zb, double L, double *w)
{
    const double a[2] = { depth, depth + 2.0 * zb };

    memset(w, 0, (size_t) g->count * sizeof(*w));
    for (int k = 0; k < 2; k++)
        if (a[k] > 0.0)
            deposit_pole(g, a[k], y, w);
    if (isinf(L))
        return;
    for (int n = 1; n <= 200; n++) {
        for (int k = 0; k < 2; k++) {
            deposit_pole(g, 2.0 * n * L + a[k], y, w);
            deposit_pole(g, -2.0 * n * L + a[k], y, w);
        }
        if (exp(-y->sigma_tr * 2.0 * n * L) < 1e-6)
            break;
    }
}

/* Computes the polynomials of a slab, one per part. */
static void make_slab(struct algebra *g, const struct pell_multipole_slab *y, bool analytic, double *const out[4])
{
    const struct pell_response total = pell_slab_response(y, 0.0);
    const double L = y->d + y->zb[0] + y->zb[1];

    for (int side = 0; side < 2; side++) {
        const int r = side ? PELL_STACK_R_MINUS : PELL_STACK_R_PLUS, t = side ? PELL_STACK_T_MINUS : PELL_STACK_T_PLUS;
        memset(out[r], 0, (size_t) g->count * sizeof(double));
        memset(out[t], 0, (size_t) g->count * sizeof(double));
        if (side == 1 && isinf(y->d))
            continue;
        if (y->clear[side]) {
            out[t][0] = total.t[side];
            continue;
        }
        if (analytic)
            by_appendix_a(g, y, y->l, y->zb[side], L, out[r]);
        else
            by_mixture(g, y, y->l, y->zb[side], L, out[r]);
        scale_to_sum(g, out[r], total.r[side]);
        if (isinf(y->d))
            continue;
        const double depth = y->d - y->l, far = y->zb[1 - side];
        if (side == 1 && y->zb[0] == y->zb[1]) {
            memcpy(out[t], out[PELL_STACK_T_PLUS], (size_t) g->count * sizeof(double));
            continue;
        }
        if (analytic)
            by_appendix_a(g, y, depth, far, L, out[t]);
        else
            by_mixture(g, y, depth, far, L, out[t]);
        if (depth <= 0.0) {
            /* The growing factor exp(-depth kappa): that fraction of light is transmitted unscattered, with its value at s = 0; the rest
             * are images. */
            const double straight = fmin(total.t[side], 0.5 * y->albedo * exp(-depth * y->sigma_tr) * y->scale[side]);
            scale_to_sum(g, out[t], total.t[side] - straight);
            out[t][0] += straight;
        } else {
            scale_to_sum(g, out[t], total.t[side]);
        }
    }
}

/* y := y/(1 - x), with x and z overwritten: y (1 + x)(1 + x^2)(1 + x^4)..., until the remaining terms sum to less than energy_loss. */
static void bounce(struct algebra *g, double **y, int count)
{
    const double ratio = sum_of(g->x, g->count);
    double ratio_power = ratio, largest = 0.0; /* ratio^terms */
    int terms = 1;

    for (int k = 0; k < count; k++)
        largest = fmax(largest, sum_of(y[k], g->count));
    while (largest * ratio_power / (1.0 - ratio) > g->energy_loss && terms < (1 << 20)) {
        for (int k = 0; k < count; k++) {
            g->kernels->multiply(g->block, g->octaves, g->x, y[k], g->z);
            for (int i = 0; i < g->count; i++)
                y[k][i] += g->z[i];
        }
        terms *= 2;
        ratio_power *= ratio_power;
        if (largest * ratio_power / (1.0 - ratio) > g->energy_loss) {
            g->kernels->multiply(g->block, g->octaves, g->x, g->x, g->z);
            double *swap = g->x;
            g->x = g->z;
            g->z = swap;
        }
    }
    g->terms = terms > g->terms ? terms : g->terms;
}

static void swap(double **a, double **b)
{
    double *t = *a;
    *a = *b;
    *b = t;
}

/* Whether |A^ B^| < 1 at all frequencies (d'Eon et al. state the condition for profiles; it applies to their transforms). */
static bool converges(const struct algebra *g, const double *a, const double *b)
{
    const double bound = magnitude(a, g->count) * magnitude(b, g->count);

    if (bound < 0.99)
        return true;
    if (!(bound < 10.0))
        return false;
    const double low = 0.01 / g->variance[g->count - 1], high = 10.0 / g->variance[1]; /* s^2/2 */
    for (int k = 0; k < 48; k++) {
        const double q = low * pow(high / low, k / 47.0);
        double at_a = 0.0, at_b = 0.0;
        for (int i = 0; i < g->count && q * g->variance[i] < 40.0; i++) {
            const double e = exp(-q * g->variance[i]);
            at_a += a[i] * e;
            at_b += b[i] * e;
        }
        if (!(fabs(at_a * at_b) < 0.99))
            return false;
    }
    return true;
}

/* g->sum := g->upper on top of g->sum. */
static void combine(struct algebra *g, bool reflectance_only)
{
    void (*multiply)(int, int, const double *, const double *, double *restrict) = g->kernels->multiply;
    const int m = g->block, p = g->octaves, n = g->count;
    double **a = g->upper, **b = g->sum;
    enum { RP = PELL_STACK_R_PLUS, TP = PELL_STACK_T_PLUS, RM = PELL_STACK_R_MINUS, TM = PELL_STACK_T_MINUS };

    /* Weights of both signs are fine while the series converges; otherwise they are clipped to >= 0. */
    if (!converges(g, b[RP], a[RM])) {
        clip(b[RP], n);
        clip(a[RM], n);
    }
    multiply(m, p, b[RP], a[RM], g->x); /* one reflection between the two */
    if (reflectance_only) {
        multiply(m, p, a[TP], a[TM], g->y);
        multiply(m, p, g->y, b[RP], g->z);
        swap(&b[RP], &g->z);
        bounce(g, &b[RP], 1);
        for (int i = 0; i < n; i++)
            b[RP][i] += a[RP][i];
        return;
    }
    /* u = T1+ S, w = T2- S with S the series; then R+ = R1+ + u T1- R2+, T+ = u T2+, R- = R2- + w T2+ R1-, T- = w T1-. */
    double *series[2] = { a[TP], b[TM] };
    bounce(g, series, 2);
    multiply(m, p, series[0], b[RP], g->y);
    multiply(m, p, g->y, a[TM], b[RP]);
    for (int i = 0; i < n; i++)
        b[RP][i] += a[RP][i];
    multiply(m, p, series[1], a[RM], g->y);
    multiply(m, p, g->y, b[TP], g->z);
    for (int i = 0; i < n; i++)
        b[RM][i] += g->z[i];
    multiply(m, p, series[0], b[TP], g->y);
    swap(&b[TP], &g->y);
    multiply(m, p, series[1], a[TM], g->y);
    swap(&b[TM], &g->y);
}

enum pell_result pell_stack_gaussians(const struct pell_stack *stack, int channel, const struct pell_stack_gaussians_params *params,
                                      void *workspace, size_t workspace_size, struct pell_stack_sets *out)
{
    if (!stack || !workspace || !out)
        return PELL_ERR_INVALID;

    const struct pell_stack_gaussians_params none = { 0 }, *q = params ? params : &none;
    struct pell_slabs slabs;
    struct algebra g = { .block = block_of(params), .energy_loss = q->energy_loss > 0.0 ? q->energy_loss : 1e-6 };
    const enum pell_result res = pell_slabs_prepare(stack, channel, &slabs);

    if (res != PELL_OK)
        return res;
    if (g.block < 8 || g.block > PELL_STACK_BLOCK_MAX || g.block % 2 || !(q->variance >= 0.0 && q->variance <= 1e12) ||
        !(q->energy_loss >= 0.0 && q->energy_loss <= 0.1) || !(g.energy_loss >= 1e-15) ||
        workspace_size < pell_stack_workspace_size(params) || !workspace)
        return PELL_ERR_INVALID;

    const bool half_space = isinf(slabs.slab[slabs.count - 1].d), reflectance_only = q->reflectance_only || half_space;
    g.kernels = pell_layers_kernels_tables[pell_simd_best()];
    g.narrow = q->variance > 0.0 ? q->variance : slabs.shortest * slabs.shortest / (4.0 * SHARPER);
    if (!(g.narrow >= 1e-14))
        g.narrow = 1e-14;
    g.octaves = octaves_for(&slabs, g.narrow, g.block);
    g.count = g.block + 1 + g.octaves * g.block / 2;

    double *memory = workspace,
           **const array[POLYNOMIALS] = { &g.variance, &g.step,   &g.upper[0], &g.upper[1], &g.upper[2], &g.upper[3], &g.sum[0],
                                          &g.sum[1],   &g.sum[2], &g.sum[3],   &g.x,        &g.y,        &g.z };
    for (int i = 0; i < POLYNOMIALS; i++, memory += elements(g.block))
        *array[i] = memory;
    make_axis(&g);

    make_slab(&g, &slabs.slab[slabs.count - 1], q->analytic, g.sum);
    for (int i = slabs.count - 2; i >= 0; i--) {
        make_slab(&g, &slabs.slab[i], q->analytic, g.upper);
        combine(&g, reflectance_only);
    }

    out->narrow = g.narrow;
    out->terms = g.terms;
    out->flags = slabs.flags;
    out->clipped = 0.0;
    /* A delta can't be evaluated: it gets the narrow Gaussian's width. */
    out->count = g.count - 1;
    memcpy(out->variance, g.variance + 1, (size_t) out->count * sizeof(double));
    for (int part = 0; part < PELL_STACK_PARTS; part++) {
        const bool computed = !reflectance_only || part == PELL_STACK_R_PLUS;
        for (int i = 0; i < out->count; i++)
            out->weight[part][i] = computed ? g.sum[part][i + 1] : 0.0;
        if (computed && g.sum[part][0] != 0.0) {
            out->weight[part][0] += g.sum[part][0];
            out->flags |= PELL_STACK_WIDENED;
        }
        if (computed && !q->analytic)
            out->clipped = fmax(out->clipped, clip(out->weight[part], out->count));
    }
    return PELL_OK;
}

static bool usable(const struct pell_stack_sets *s, enum pell_stack_part part)
{
    return (int) part >= 0 && part < PELL_STACK_PARTS && s->count >= 1 && s->count <= PELL_STACK_SET_MAX;
}

/* Variance below which the given fraction of a set's light lies; of its magnitude if weights of both signs make the sum non-monotonic. */
static double quantile(const struct pell_stack_sets *s, enum pell_stack_part part, double fraction)
{
    const double *w = s->weight[part], total = magnitude(w, s->count);
    double sum = 0.0;
    for (int i = 0; i < s->count; i++)
        if ((sum += fabs(w[i])) >= fraction * total)
            return s->variance[i];
    return s->variance[s->count - 1];
}

enum pell_result pell_stack_sets_profile(const struct pell_stack_sets *s, enum pell_stack_part part, struct pell_profile *out)
{
    if (!s || !out)
        return PELL_ERR_INVALID;

    *out = (struct pell_profile) { 0 };
    if (!usable(s, part))
        return PELL_ERR_INVALID;
    const double *w = s->weight[part], total = sum_of(w, s->count);
    if (!(total > 0.0))
        return PELL_OK;
    const double first = 0.004 * sqrt(quantile(s, part, 1e-4)), last = 7.0 * sqrt(quantile(s, part, 1.0 - 1e-9));
    const double step = log(last / first) / (PELL_PROFILE_NODES - 1);
    int count = 0;
    for (int j = 0; j < PELL_PROFILE_NODES; j++) {
        const double r = first * exp(step * j);
        double sum = 0.0;
        for (int i = 0; i < s->count; i++) {
            const double x = 0.5 * r * r / s->variance[i];
            if (w[i] != 0.0 && x < 700.0)
                sum += w[i] * exp(-x) / (2.0 * PELL_PI * s->variance[i]);
        }
        out->r[count] = r;
        out->value[count++] = fmax(0.0, sum); /* signed weights may sum to a negative value far out */
    }
    pell_profile_nodes_make(out, count, PELL_NODES_LOG, -1.0);
    if (out->total > 0.0)
        pell_profile_nodes_scale(out, total / out->total);
    out->total = total;
    pell_profile_drop_traces(out);
    return PELL_OK;
}

/* weight of the second moment's equation relative to those of the norm; the remaining error is corrected at the end */
#define MOMENT_WEIGHT 1e3

/* Corrects the second moment by moving weight between the two positive weights that are farthest apart; their sum is unchanged. */
static void correct_moment(const double *target, int count, double moment, double *weight)
{
    int first = -1, last = -1;
    double actual = 0.0;

    for (int i = 0; i < count; i++) {
        actual += weight[i] * target[i];
        if (weight[i] > 0.0) {
            first = first < 0 ? i : first;
            last = i;
        }
    }
    if (first == last)
        return;
    double step = (moment - actual) / (target[last] - target[first]);
    step = fmin(fmax(step, -weight[last]), weight[first]);
    weight[last] += step;
    weight[first] -= step;
}

/* Least squares of a set by Gaussians of given variances in the norm of error (10), Int r (.)^2 dr: weights >= 0 with the set's total and
 * second moment. Returns the part of the set's squared norm that they capture (larger is better). With b the inner products of set and
 * Gaussians and H those of the Gaussians, |set - w|^2 = |set|^2 - 2 w b + w H w; H = C C^T makes that a small least-squares problem. */
static double project(const double *variance, const double *w, int n, const double *target, int count, double weight[PELL_GAUSSIANS_MAX])
{
    const double total = sum_of(w, n);
    struct pell_nnls problem = { .count = count, .fixed_sum = true, .sum = total };
    struct pell_nnls_solution solution;
    double H[PELL_GAUSSIANS_MAX][PELL_GAUSSIANS_MAX], C[PELL_GAUSSIANS_MAX][PELL_GAUSSIANS_MAX] = { { 0 } };
    double b[PELL_GAUSSIANS_MAX], row[PELL_GAUSSIANS_MAX], captured = 0.0;

    /* Half the second moment. Signed weights may have none above 0, which weights >= 0 can't match. */
    const double moment = 0.5 * pell_gaussian_set_moment(variance, w, (size_t) n);
    /* All scaled by the variances, so that H's diagonal is 1/2. The moment's equation has the size of the set's norm. */
    const double size = moment > 0.0 ? MOMENT_WEIGHT * total / sqrt(moment / total) : 0.0;
    for (int i = 0; i < count; i++) {
        row[i] = size > 0.0 ? size * target[i] * sqrt(target[i]) / moment : 0.0;
        b[i] = 0.0;
        for (int j = 0; j < n; j++)
            b[i] += w[j] / (target[i] + variance[j]);
        b[i] *= sqrt(target[i]);
        double rhs = b[i] + row[i] * size;
        for (int j = 0; j <= i; j++) {
            H[i][j] = H[j][i] = sqrt(target[i] * target[j]) / (target[i] + target[j]);
            double sum = H[i][j] * (i == j ? 1.0 + 1e-14 : 1.0) + row[i] * row[j];
            for (int k = 0; k < j; k++)
                sum -= C[i][k] * C[j][k];
            C[i][j] = i == j ? sqrt(fmax(sum, 1e-16)) : sum / C[j][j];
        }
        for (int k = 0; k < i; k++)
            rhs -= C[i][k] * problem.rhs[k];
        problem.rhs[i] = rhs / C[i][i];
    }
    for (int j = 0; j < count; j++)
        for (int i = 0; i <= j; i++)
            problem.column[j][i] = C[j][i] / sqrt(target[j]);
    pell_nnls_factor(&problem, &solution);
    pell_nnls_solve(&problem, &solution);
    memcpy(weight, solution.w, (size_t) count * sizeof(*weight));
    if (moment > 0.0)
        correct_moment(target, count, moment, weight);
    for (int i = 0; i < count; i++) {
        const double u = weight[i] / sqrt(target[i]);
        captured += 2.0 * u * b[i];
        for (int j = 0; j < count; j++)
            captured -= u * H[i][j] * weight[j] / sqrt(target[j]);
    }
    return captured;
}

enum pell_result pell_stack_reduce(const struct pell_stack_sets *const channel[3], enum pell_stack_part part, int count,
                                   struct pell_gaussians *out)
{
    if (!channel || !out)
        return PELL_ERR_INVALID;

    enum { TRIES = 6 };
    static const double low_fractions[TRIES] = { 0.005, 0.02, 0.05, 0.09, 0.15, 0.22 };
    static const double high_fractions[TRIES] = { 0.995, 0.98, 0.94, 0.88, 0.8, 0.7 };
    double low[TRIES], high[TRIES], narrow = INFINITY, wide = 0.0, captured_first[3] = { 0 }, best = -INFINITY;
    bool has_light[3];

    *out = (struct pell_gaussians) { 0 };
    if (count < 2 || count > PELL_GAUSSIANS_MAX)
        return PELL_ERR_INVALID;
    for (int c = 0; c < 3; c++)
        if (!usable(channel[c], part))
            return PELL_ERR_INVALID;
    for (int k = 0; k < TRIES; k++) {
        low[k] = INFINITY;
        high[k] = 0.0;
    }
    for (int c = 0; c < 3; c++) {
        const double *w = channel[c]->weight[part], total = sum_of(w, channel[c]->count);
        has_light[c] = total > 0.0;
        for (int k = 0; k < TRIES && has_light[c]; k++) {
            low[k] = fmin(low[k], quantile(channel[c], part, low_fractions[k]));
            high[k] = fmax(high[k], quantile(channel[c], part, high_fractions[k]));
        }
        if (has_light[c]) { /* the mean variance must lie between the first and the last, or no weights >= 0 have it */
            const double moment = pell_gaussian_set_moment(channel[c]->variance, w, (size_t) channel[c]->count);
            const double mean = moment > 0.0 ? 0.5 * moment / total : quantile(channel[c], part, 0.5);
            narrow = fmin(narrow, 0.8 * mean);
            wide = fmax(wide, 1.25 * mean);
        }
    }
    if (!has_light[0] && !has_light[1] && !has_light[2])
        return PELL_OK;
    for (int a = 0; a < TRIES; a++)
        for (int b = 0; b < TRIES; b++) {
            struct pell_gaussians g = { .count = count };
            const double bottom = fmin(low[a], narrow), top = fmax(high[b], wide);
            double captured = 0.0;
            for (int i = 0; i < count; i++)
                g.variance[i] = bottom * pow(top / bottom, i / (count - 1.0));
            for (int c = 0; c < 3; c++) {
                double weight[PELL_GAUSSIANS_MAX];
                if (!has_light[c])
                    continue;
                const double h = project(channel[c]->variance, channel[c]->weight[part], channel[c]->count, g.variance, count, weight);
                if (!(captured_first[c] > 0.0))
                    captured_first[c] = fabs(h);
                captured += h / captured_first[c];
                for (int i = 0; i < count; i++)
                    g.weight[i][c] = weight[i];
            }
            if (captured > best) {
                best = captured;
                *out = g;
            }
        }
    return PELL_OK;
}
