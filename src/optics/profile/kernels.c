/* SPDX-License-Identifier: MIT
 *
 * kernels.c - loops over radii, written to be vectorised. Radii are copied in blocks, so that r and R may be the same array. */
#include "optics/profile/kernels.h"

#include "base/simd.h"
#include "optics/profile/lanes.h"

#define BLOCK 64

/* A closed form at each radius; inlined, so that the form and its parameters are known in the loop. */
LANES_INLINE void each(double (*form)(const double *parameter, double r), const struct pell_profile *p, const double *r, double *restrict R,
                       size_t count)
{
    double parameter[5], block[BLOCK];
    memcpy(parameter, p->parameter, sizeof(parameter));
    for (size_t from = 0; from < count; from += BLOCK) {
        const size_t n = count - from < BLOCK ? count - from : BLOCK;
        memcpy(block, r + from, n * sizeof(*r));
        for (size_t i = 0; i < n; i++)
            block[i] = form(parameter, block[i]);
        memcpy(R + from, block, n * sizeof(*R));
    }
}

static void pair(const struct pell_profile *p, const double *r, double *restrict R, size_t count)
{
    each(lanes_pair, p, r, R, count);
}

static void burley(const struct pell_profile *p, const double *r, double *restrict R, size_t count)
{
    each(lanes_burley, p, r, R, count);
}

static void gaussians(const struct pell_profile *p, const double *r, double *restrict R, size_t count)
{
    double parameter[PELL_PROFILE_PARAMETERS], block[BLOCK], sum[BLOCK];
    const int gaussian_count = (int) p->parameter[0];
    memcpy(parameter, p->parameter, sizeof(parameter));
    for (size_t from = 0; from < count; from += BLOCK) {
        const size_t n = count - from < BLOCK ? count - from : BLOCK;
        for (size_t i = 0; i < n; i++) {
            const double a = lanes_radius(r[from + i]);
            block[i] = a * a;
            sum[i] = 0.0;
        }
        for (int k = 0; k < gaussian_count; k++) {
            const double rate = parameter[1 + 2 * k], scale = parameter[2 + 2 * k];
            for (size_t i = 0; i < n; i++)
                sum[i] += scale * lanes_exp(block[i] * rate);
        }
        memcpy(R + from, sum, n * sizeof(*R));
    }
}

/* Interleaves the searches of a block, as each waits for memory at every step. */
static void nodes(const struct pell_profile *p, const double *r, double *restrict R, size_t count)
{
    const double first = p->r[0], last = p->r[p->count - 1];
    const int64_t end = p->count - 2;
    double block[BLOCK], value[BLOCK];
    int64_t at[BLOCK];

    for (size_t from = 0; from < count; from += BLOCK) {
        const size_t n = count - from < BLOCK ? count - from : BLOCK;
        double most = 0.0;
        for (size_t i = 0; i < n; i++) {
            const double x = lanes_radius(r[from + i]), above = x > first ? x : first;
            most = x > most ? x : most;
            block[i] = x;
            value[i] = above < last ? above : last;
            at[i] = 0;
        }
        for (int64_t half = PELL_PROFILE_NODES / 2; half > 0; half /= 2)
            for (size_t i = 0; i < n; i++)
                at[i] = p->r[at[i] + half] <= value[i] ? at[i] + half : at[i];
        for (size_t i = 0; i < n; i++)
            value[i] = lanes_cubic(p, at[i] < end ? at[i] : end, value[i]);
        if (most > last)
            for (size_t i = 0; i < n; i++) {
                const double tail = lanes_tail(p, block[i] > last ? block[i] : last);
                value[i] = block[i] > last ? tail : value[i];
            }
        memcpy(R + from, value, n * sizeof(*R));
    }
}

static void beam_multiple(const struct pell_beam *beam, double r, double *restrict term, int count)
{
    for (int i = 0; i < count; i++) {
        const double z = beam->depth[i], near = 2.0 * (sqrt(r * r + z * z) + z);
        const double pair[] = {
            [PAIR_SIGMA] = beam->sigma_tr, [PAIR_ZR] = z, [PAIR_ZV] = z + beam->reach, [PAIR_A] = beam->a, [PAIR_B] = beam->b
        };
        term[i] = beam->weight[i] * lanes_absorbed(near) * lanes_pair(pair, r);
    }
}

/* Depths begin at the critical angle, r sqrt(eta^2 - 1), where light can exit. */
static void beam_single(const struct pell_beam *beam, double r, double *restrict term, int count)
{
    const double eta = 1.0 / beam->eta, g = beam->g;
    const double first = beam->eta > 1.0 ? r * sqrt((beam->eta - 1.0) * (beam->eta + 1.0)) : 0.0;

    for (int i = 0; i < count; i++) {
        const double z = first + beam->depth[i], d = sqrt(r * r + z * z), c = z / d;
        const double cos2 = 1.0 - (r / d) * (r / d) / (eta * eta), cos_t = sqrt(cos2 > 0.0 ? cos2 : 0.0);
        const double rs = (c - eta * cos_t) / (c + eta * cos_t), rp = (eta * c - cos_t) / (eta * c + cos_t);
        const double q = (1.0 + g) * (1.0 + g) - 2.0 * g * r * r / (d * (d + z)); /* 1 + g^2 + 2 g c */
        term[i] = beam->weight[i] * lanes_exp(first + d) * (1.0 - 0.5 * (rs * rs + rp * rp)) * c / (d * d * q * sqrt(q));
    }
}

extern const struct pell_profile_kernels PELL_SIMD(pell_profile_kernels);

const struct pell_profile_kernels PELL_SIMD(pell_profile_kernels) = {
    {
        [PELL_PROFILE_KIND_POLES] = pair,
        [PELL_PROFILE_KIND_BURLEY] = burley,
        [PELL_PROFILE_KIND_GAUSSIANS] = gaussians,
        [PELL_PROFILE_KIND_NODES] = nodes,
    },
    beam_multiple,
    beam_single,
};
