/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the loops of the stack solvers, compiled once per level of base/simd.h. */
#include "optics/layers/kernels.h"

#include "base/simd.h"
#include "math/vec.h"
#include "optics/profile/lanes.h"

#include <math.h>
#include <string.h>

static void response(const struct pell_multipole_slab *y, const double *s, int n, double *const f[4])
{
    double *restrict rp = f[PELL_STACK_R_PLUS], *restrict tp = f[PELL_STACK_T_PLUS];
    double *restrict rm = f[PELL_STACK_R_MINUS], *restrict tm = f[PELL_STACK_T_MINUS];
    const double sigma2 = y->sigma_tr * y->sigma_tr, half = 0.5 * y->albedo, l = y->l, z0 = 2.0 * y->zb[0], z1 = 2.0 * y->zb[1];

    if (isinf(y->d)) {
        for (int i = 0; i < n; i++) {
            const double kappa = sqrt(sigma2 + s[i] * s[i]);
            rp[i] = half * lanes_exp(l * kappa) * (1.0 + lanes_exp(z0 * kappa));
            tp[i] = rm[i] = tm[i] = 0.0;
        }
        return;
    }
    const double gap = y->d - l, L2 = 2.0 * y->d + z0 + z1;
    const double rp_a = 2.0 * gap + z1, rm_a = 2.0 * gap + z0, tp_a = 2.0 * l + z0, tm_a = 2.0 * l + z1;
    const double leave = half * (y->straight ? exp(-gap * y->sigma_tr) : 1.0), decay = y->straight ? 0.0 : fabs(gap);
    const double s0 = y->scale[0], s1 = y->scale[1], max_growth = gap < 0.0 ? y->growth_max : 708.0;
    for (int i = 0; i < n; i++) {
        const double kappa = sqrt(sigma2 + s[i] * s[i]), reach = decay * kappa, g = lanes_exp(reach < max_growth ? reach : max_growth);
        const double enter = half * lanes_exp(l * kappa), transmittance = leave * (gap < 0.0 ? 1.0 / g : g);
        const double e0 = 1.0 + lanes_exp(z0 * kappa), e1 = 1.0 + lanes_exp(z1 * kappa), series = 1.0 / lanes_absorbed(L2 * kappa);
        rp[i] = s0 * enter * e0 * series * lanes_absorbed(fabs(rp_a) * kappa);
        rm[i] = s1 * enter * e1 * series * lanes_absorbed(fabs(rm_a) * kappa);
        tp[i] = s0 * transmittance * e1 * series * lanes_absorbed(tp_a * kappa);
        tm[i] = s1 * transmittance * e0 * series * lanes_absorbed(tm_a * kappa);
    }
    for (int side = 0; side < 2; side++) {
        if (!y->clear[side])
            continue;
        for (int i = 0; i < n; i++) {
            f[side ? PELL_STACK_R_MINUS : PELL_STACK_R_PLUS][i] = 0.0;
            f[side ? PELL_STACK_T_MINUS : PELL_STACK_T_PLUS][i] = y->transmittance[side];
        }
    }
}

static void add(int n, double *const a[4], double *const b[4])
{
    double *restrict arp = a[PELL_STACK_R_PLUS], *restrict atp = a[PELL_STACK_T_PLUS];
    double *restrict arm = a[PELL_STACK_R_MINUS], *restrict atm = a[PELL_STACK_T_MINUS];
    const double *restrict brp = b[PELL_STACK_R_PLUS], *restrict btp = b[PELL_STACK_T_PLUS];
    const double *restrict brm = b[PELL_STACK_R_MINUS], *restrict btm = b[PELL_STACK_T_MINUS];

    for (int i = 0; i < n; i++) {
        const double series = 1.0 / (1.0 - brp[i] * arm[i]);
        const double rp = arp[i] + atp[i] * brp[i] * atm[i] * series, rm = brm[i] + btm[i] * arm[i] * btp[i] * series;
        const double tp = atp[i] * btp[i] * series, tm = btm[i] * atm[i] * series;
        arp[i] = rp;
        arm[i] = rm;
        atp[i] = tp;
        atm[i] = tm;
    }
}

/* albedo exp(-sigma^2 v/2)/(2 v sqrt(2 pi v)) Sum_n (2 n L + a) exp(-(2 n L + a)^2/(2 v)) for narrow Gaussians; the same by Poisson's
 * sum, Sum_n mode_n exp(-((n pi/L)^2 + sigma^2) v/2), for wide ones. Either has an error under 1e-11 of its largest term at the change. */
static void mixture(const struct pell_mixture *m, const double *variance, int n, double *restrict w)
{
    const double change = isinf(m->L) ? INFINITY : 0.3 * m->L * m->L;
    int narrow = 0;

    while (narrow < n && variance[narrow] < change)
        narrow++;
    const int first = m->a[0] < 0.0;
    for (int i = 0; i < narrow; i++) {
        const double v = variance[i], inverse = 0.5 / v;
        double sum = 0.0;
        for (int k = first; k < 2; k++)
            sum += m->a[k] * lanes_exp(m->a[k] * m->a[k] * inverse);
        w[i] = m->albedo * sum * lanes_exp(0.5 * m->sigma2 * v) * inverse / sqrt(2.0 * PELL_PI * v);
    }
    if (!isinf(m->L)) {
        int from = 0; /* images are under exp(-40) of anything before */
        const double nearest = fmin(2.0 * m->L - m->a[1], 2.0 * m->L - fabs(m->a[0]));
        while (from < narrow && nearest * nearest > 160.0 * variance[from])
            from++;
        for (int i = from; i < narrow; i++) {
            const double v = variance[i], inverse = 0.5 / v;
            double sum = 0.0;
            for (int k = 0; k < 2; k++)
                for (int image = -2; image <= 1; image++) {
                    const double z = 2.0 * image * m->L + m->a[k];
                    sum += image == 0 ? 0.0 : z * lanes_exp(z * z * inverse);
                }
            w[i] += m->albedo * sum * lanes_exp(0.5 * m->sigma2 * v) * inverse / sqrt(2.0 * PELL_PI * v);
        }
        const double theta = PELL_PI / m->L, rate = 0.5 * theta * theta;
        for (int i = narrow; i < n; i++) {
            const double v = variance[i], p = lanes_exp(rate * v), p2 = p * p, p4 = p2 * p2, p8 = p4 * p4;
            const double sum =
                p * (m->mode[0] + p2 * p * (m->mode[1] + p4 * p * (m->mode[2] + p4 * p2 * p * (m->mode[3] + p8 * p * m->mode[4]))));
            const double extra =
                first ? m->albedo * m->a[0] * lanes_exp(0.5 * m->a[0] * m->a[0] / v) * 0.5 / (v * sqrt(2.0 * PELL_PI * v)) : 0.0;
            w[i] = lanes_exp(0.5 * m->sigma2 * v) * (sum - extra);
        }
    }
}

/* to[0..n) += factor from[0..n) */
LANES_INLINE void axpy(double *restrict to, const double *restrict from, double factor, int n)
{
    for (int i = 0; i < n; i++)
        to[i] += factor * from[i];
}

static bool empty(const double *a, int n)
{
    for (int i = 0; i < n; i++)
        if (a[i] != 0.0)
            return false;
    return true;
}

/* Halves the resolution: an odd element is split between its neighbours, so that sum and first moment are preserved. */
LANES_INLINE void halve(double *a, int m)
{
    double to[PELL_STACK_BLOCK_MAX / 2 + 1];
    to[0] = a[0] + 0.5 * a[1];
    for (int j = 1; j < m / 2; j++)
        to[j] = a[2 * j] + 0.5 * (a[2 * j - 1] + a[2 * j + 1]);
    to[m / 2] = a[m] + 0.5 * a[m - 1];
    memcpy(a, to, (size_t) (m / 2 + 1) * sizeof(*a));
}

LANES_INLINE void multiply_by(const int m, int octaves, const double *a, const double *b, double *restrict out)
{
    double A[PELL_STACK_BLOCK_MAX + 1], B[PELL_STACK_BLOCK_MAX + 1], product[2 * PELL_STACK_BLOCK_MAX + 2];
    double carry[PELL_STACK_BLOCK_MAX + 1] = { 0 };
    const int half = m / 2;

    for (int p = 0; p <= octaves; p++) {
        double *to = p == 0 ? out : out + m + 1 + (p - 1) * half; /* element j of the level is to[j - first] */
        const int first = p == 0 ? 0 : half + 1;
        const double *pa = p == 0 ? a : a + m + 1 + (p - 1) * half, *pb = p == 0 ? b : b + m + 1 + (p - 1) * half;

        if (p > 0) {
            halve(A, m);
            halve(B, m);
        }
        memcpy(A + first, pa, (size_t) (m + 1 - first) * sizeof(*A));
        memcpy(B + first, pb, (size_t) (m + 1 - first) * sizeof(*B));
        memset(product, 0, (size_t) (2 * m + 2) * sizeof(*product));
        /* Pairs of which at least one is in this octave; pairs of lower ones are done. */
        if (p == 0 || !empty(pa, m + 1 - first))
            for (int i = first; i <= m; i++)
                if (A[i] != 0.0)
                    axpy(product + i, B, A[i], m + 1);
        if (p > 0 && !empty(pb, half))
            for (int i = 0; i <= half; i++)
                if (A[i] != 0.0)
                    axpy(product + i + half + 1, B + half + 1, A[i], half);
        for (int j = first; j <= m; j++)
            to[j - first] = product[j] + carry[j];
        /* The overflow moves to the next octave's grid, whose element m/2 is this one's m. */
        to[m - first] += 0.5 * product[m + 1];
        for (int j = half + 1; j <= m; j++)
            carry[j] = product[2 * j] + 0.5 * (product[2 * j - 1] + product[2 * j + 1]);
        if (p == octaves)
            for (int j = half + 1; j <= m; j++)
                to[m - first] += carry[j];
    }
}

static void multiply(int m, int octaves, const double *a, const double *b, double *restrict out)
{
    switch (m) {
    case 16: multiply_by(16, octaves, a, b, out); break;
    case 32: multiply_by(32, octaves, a, b, out); break;
    case 64: multiply_by(64, octaves, a, b, out); break;
    default: multiply_by(m, octaves, a, b, out);
    }
}

extern const struct pell_layers_kernels PELL_SIMD(pell_layers_kernels);
const struct pell_layers_kernels PELL_SIMD(pell_layers_kernels) = { response, add, mixture, multiply };
