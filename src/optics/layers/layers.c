/* SPDX-License-Identifier: MIT
 *
 * layers.c - solves stacks by the Hankel transform: closed forms at logarithmic frequencies, one inverse transform (d'Eon et al. 2007, eqs.
 * (3) to (5); Donner and Jensen 2005, section 3). */
#include "optics/layers/kernels.h"

#include "base/simd.h"
#include "math/hankel.h"
#include "math/vec.h"
#include "optics/profile/nodes.h"
#include "optics/profile/shape.h"

#include <math.h>

PELL_SIMD_TABLES(struct pell_layers_kernels, pell_layers_kernels);

#define STEP 0.2     /* of log s: exp(-pi^2/(2 STEP)) = 2e-11 */
#define OVERSAMPLE 4 /* radii per frequency: the step of eight-point interpolation */
#define TOP 45.0     /* R^ falls as exp(-reach s): nothing is left at s = TOP/reach */
#define NEAR 0.02    /* below this fraction of the reach R(r) is its Taylor series */
#define FIRST 0.002  /* a profile's first node: R is constant inside it */

/* 2 pi R(r_j) on a logarithmic grid, and R^'s moments for r -> 0. */
struct spectrum {
    int count; /* radii */
    double log_r0, step, near;
    double moment[PELL_STACK_PARTS][4];
    double value[PELL_STACK_PARTS][PELL_HANKEL_FINE_MAX];
};

static void solve(const struct pell_slabs *slabs, const bool wanted[PELL_STACK_PARTS], struct spectrum *out)
{
    const struct pell_layers_kernels *kernels = pell_layers_kernels_tables[pell_simd_best()];
    const bool half_space = isinf(slabs->slab[slabs->count - 1].d);
    const double reach = half_space ? slabs->reach_r : fmin(slabs->reach_r, slabs->reach_t), top = TOP / reach;
    const double scale = fmin(fmax(slabs->scale, 10.0 * reach), 1e12 * reach);
    double s[PELL_HANKEL_MAX], sum[4][PELL_HANKEL_MAX], next[4][PELL_HANKEL_MAX];
    double *const a[4] = { sum[0], sum[1], sum[2], sum[3] }, *const b[4] = { next[0], next[1], next[2], next[3] };
    struct pell_hankel plan;
    int n = 128;

    while (n < PELL_HANKEL_MAX && n * STEP < log(top * scale) + 16.0)
        n *= 2;
    for (int i = 0; i < n; i++)
        s[i] = top * exp(-STEP * i);
    kernels->response(&slabs->slab[0], s, n, a);
    for (int i = 1; i < slabs->count; i++) {
        kernels->response(&slabs->slab[i], s, n, b);
        kernels->add(n, a, b);
    }
    const double sigma = slabs->slab[0].sigma_tr;
    for (int i = 0; i < n && slabs->widen > 0.0; i++) {
        const double fall = exp(-slabs->widen * (sqrt(sigma * sigma + s[i] * s[i]) - sigma));
        sum[PELL_STACK_T_PLUS][i] *= fall;
        sum[PELL_STACK_T_MINUS][i] *= fall;
    }

    pell_hankel_init(&plan, n, OVERSAMPLE, STEP, 0.5 * NEAR * TOP);
    out->count = n * OVERSAMPLE;
    out->step = STEP / OVERSAMPLE;
    out->log_r0 = log(0.5 * NEAR * reach);
    out->near = NEAR * reach;
    const double low = 1e-5 / scale; /* below it the transform is faded to 0: its light is spread over 1e5 lengths */
    for (int part = 0; part < PELL_STACK_PARTS; part++) {
        if (!wanted[part])
            continue;
        double *f = sum[part];
        for (int k = 0; k < 4; k++)
            out->moment[part][k] = 0.0;
        for (int i = 0; i < n; i++) {
            const double x = s[i] / low;
            f[i] *= s[i] * (x * x / (1.0 + x * x));
            double term = f[i] * s[i] * STEP / (2.0 * PELL_PI);
            for (int k = 0; k < 4; k++) {
                out->moment[part][k] += term;
                term *= s[i] * s[i];
            }
        }
        pell_hankel_apply(&plan, f, out->value[part]);
        /* The period's aliases of r -> 0, at r exp(-n STEP) and beyond, add a constant. */
        const double image = out->moment[part][0] / expm1(n * STEP);
        for (int j = 0; j < out->count; j++)
            out->value[part][j] = out->value[part][j] * exp(-out->log_r0 - out->step * j) / (2.0 * PELL_PI) - image;
    }
}

/* Lagrange interpolation through the eight nearest radii, in log r. */
static double interpolate(const struct spectrum *p, int part, double r)
{
    static const double weight[8] = { -1.0, 7.0, -21.0, 35.0, -35.0, 21.0, -7.0, 1.0 };

    if (r < p->near) {
        const double *m = p->moment[part], x = 0.25 * r * r; /* J0(t) = Sum (-t^2/4)^k/k!^2 */
        return m[0] - x * (m[1] - x * (m[2] - x * m[3] / 9.0) / 4.0);
    }
    const double u = (log(r) - p->log_r0) / p->step;
    if (u > p->count - 5)
        return 0.0;
    const int first = (int) u < 3 ? 0 : (int) u - 3;
    double numerator = 0.0, denominator = 0.0;
    for (int k = 0; k < 8; k++) {
        const double t = u - (first + k);
        if (t == 0.0)
            return p->value[part][first + k];
        numerator += weight[k] / t * p->value[part][first + k];
        denominator += weight[k] / t;
    }
    return numerator / denominator;
}

enum pell_result pell_stack_hankel(const struct pell_stack *stack, int channel, const double *r_mm, size_t count,
                                   double *const out[PELL_STACK_PARTS], unsigned *flags)
{
    if (!stack || (!r_mm && count) || !out)
        return PELL_ERR_INVALID;

    struct pell_slabs slabs;
    struct spectrum spectrum;
    bool wanted[PELL_STACK_PARTS];
    enum pell_result res = pell_slabs_prepare(stack, channel, &slabs);

    if (flags)
        *flags = slabs.flags;
    for (size_t i = 0; res == PELL_OK && i < count; i++)
        if (!(r_mm[i] >= 0.0 && r_mm[i] <= 1e100))
            res = PELL_ERR_INVALID;
    for (int part = 0; part < PELL_STACK_PARTS; part++) {
        wanted[part] = out[part] != NULL;
        for (size_t i = 0; res != PELL_OK && wanted[part] && i < count; i++)
            out[part][i] = 0.0;
    }
    if (res != PELL_OK)
        return res;
    solve(&slabs, wanted, &spectrum);
    for (int part = 0; part < PELL_STACK_PARTS; part++)
        for (size_t i = 0; wanted[part] && i < count; i++)
            out[part][i] = interpolate(&spectrum, part, r_mm[i]);
    return PELL_OK;
}

enum pell_result pell_stack_profile(const struct pell_stack *stack, int channel, enum pell_stack_part part, struct pell_profile *out,
                                    unsigned *flags)
{
    if (!stack || !out)
        return PELL_ERR_INVALID;

    struct pell_slabs slabs;
    struct spectrum spectrum;
    bool wanted[PELL_STACK_PARTS] = { false };
    double total[PELL_STACK_PARTS];
    const enum pell_result res = pell_slabs_prepare(stack, channel, &slabs);

    *out = (struct pell_profile) { 0 };
    if (flags)
        *flags = slabs.flags;
    if (res != PELL_OK)
        return res;
    if ((int) part < 0 || part >= PELL_STACK_PARTS)
        return PELL_ERR_INVALID;
    const struct pell_response f = pell_slabs_response(&slabs, 0.0);
    pell_response_store(&f, total);
    wanted[part] = true;
    solve(&slabs, wanted, &spectrum);

    /* Nodes extend to where r^2 R, the light near a radius, vanishes, or only the transform's error is left. */
    const double *value = spectrum.value[part], noise = 4e-12 * spectrum.moment[part][0];
    double peak = 0.0;
    int last = 0;
    for (int j = 0; j < spectrum.count - 5; j++) {
        const double r = exp(spectrum.log_r0 + spectrum.step * j);
        if (!(value[j] > noise) || r * r * value[j] < 1e-9 * peak)
            break;
        peak = fmax(peak, r * r * value[j]);
        last = j;
    }
    if (!(total[part] > 0.0) || last < 8)
        return PELL_OK; /* no light, a profile of 0 */
    const double first = spectrum.near * FIRST / NEAR;
    const double step = (spectrum.log_r0 + spectrum.step * last - log(first)) / (PELL_PROFILE_NODES - 1);
    for (int j = 0; j < PELL_PROFILE_NODES; j++) {
        out->r[j] = first * exp(step * j);
        out->value[j] = fmax(0.0, interpolate(&spectrum, part, out->r[j]));
    }
    double sigma = -1.0; /* beyond the last node: a half-space's far field */
    if (isinf(slabs.slab[slabs.count - 1].d))
        sigma = slabs.slab[slabs.count - 1].sigma_tr;
    pell_profile_nodes_make(out, PELL_PROFILE_NODES, PELL_NODES_LOG, sigma);
    if (out->total > 0.0)
        pell_profile_nodes_scale(out, total[part] / out->total);
    out->total = total[part];
    pell_profile_drop_traces(out);
    return PELL_OK;
}
