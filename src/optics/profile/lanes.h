/* SPDX-License-Identifier: MIT
 *
 * lanes.h - R(r) of each kind at one radius, using only additions, multiplications, divisions, roots and selections, so that a loop over
 * radii vectorises at any width and all builds give the same bits.
 *
 * Radii are |r|, at most 1e150; NaN is treated as 1e150. exp and expm1 come with a relative error below 4e-16, and are 0 and -1 where the
 * argument is under -708.
 */
#ifndef PELL_PROFILE_LANES_H
#define PELL_PROFILE_LANES_H

#include <pellucid/profile.h>

#include <math.h>
#include <string.h>

#define LANES_INLINE static inline __attribute__((always_inline))
#define LANES_RADIUS_MAX 1e150 /* squares stay finite */

LANES_INLINE double lanes_radius(double r)
{
    const double a = r < 0.0 ? -r : r;
    return a < LANES_RADIUS_MAX ? a : LANES_RADIUS_MAX;
}

/* exp(-x) = scale (1 + q) for 0 <= x <= 708: x = n ln 2 + rest with |rest| <= ln 2/2, and q = expm1 of the rest by its Taylor series,
 * whose first term left out is 4e-18. */
struct lanes_power {
    double scale, q;
};

LANES_INLINE struct lanes_power lanes_power(double x)
{
    const double magic = 6755399441055744.0; /* 1.5 2^52: the sum's last bits hold the rounded integer */
    const double t = -x * 1.4426950408889634 + magic, n = t - magic;
    const double y =
        (-x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10; /* ln 2 in two parts, the first exact times n */
    const double y2 = y * y;
    /* Pairs of terms, each a step of Horner's rule in y^2. */
    double q = y * (1.0 / 6227020800.0) + 1.0 / 479001600.0;
    q = q * y2 + (y * (1.0 / 39916800.0) + 1.0 / 3628800.0);
    q = q * y2 + (y * (1.0 / 362880.0) + 1.0 / 40320.0);
    q = q * y2 + (y * (1.0 / 5040.0) + 1.0 / 720.0);
    q = q * y2 + (y * (1.0 / 120.0) + 1.0 / 24.0);
    q = q * y2 + (y * (1.0 / 6.0) + 0.5);
    q = q * y2 + y;
    uint64_t bits;
    double scale;
    memcpy(&bits, &t, sizeof(bits));
    bits = (bits + 1023) << 52; /* what is above the integer falls off the top */
    memcpy(&scale, &bits, sizeof(scale));
    return (struct lanes_power) { scale, q };
}

/* exp(-x), x >= 0. */
LANES_INLINE double lanes_exp(double x)
{
    const double at = x < 708.0 ? x : 708.0;
    const struct lanes_power p = lanes_power(at);
    const double e = p.scale + p.scale * p.q;
    return x < 708.0 ? e : 0.0;
}

/* 1 - exp(-x), x >= 0. */
LANES_INLINE double lanes_absorbed(double x)
{
    const double at = x < 708.0 ? x : 708.0;
    const struct lanes_power p = lanes_power(at);
    return (1.0 - p.scale) - p.scale * p.q;
}

/* --- A pair of poles ------------------------------------------------------------------------------------------------------------ */

/* a (z_r (1 + s d_r) exp(-s d_r)/d_r^3 + the same of z_v) + b (exp(-s d_r)/d_r - exp(-s d_v)/d_v), 0 < z_r < z_v. */
enum { PAIR_SIGMA, PAIR_ZR, PAIR_ZV, PAIR_A, PAIR_B };

/* The flux is written relative to the real pole's, with d_v - d_r = (z_v^2 - z_r^2)/(d_v + d_r), to avoid cancellation far out. */
LANES_INLINE double lanes_pair(const double *p, double r_mm)
{
    const double s = p[PAIR_SIGMA], zr = p[PAIR_ZR], zv = p[PAIR_ZV], r = lanes_radius(r_mm), r2 = r * r;
    const double dr = sqrt(r2 + zr * zr), dv = sqrt(r2 + zv * zv), both = 1.0 / (dr * dv);
    const double ir = both * dv, iv = both * dr, difference = (zv - zr) * (zv + zr) / (dv + dr);
    const double e = lanes_exp(s * dr), lost = lanes_absorbed(s * difference);
    const double flux = zr * (1.0 + s * dr) * ir * ir * ir + (1.0 - lost) * (zv * (1.0 + s * dv)) * iv * iv * iv;
    const double fluence = both * difference + lost * iv;
    return e * (p[PAIR_A] * flux + p[PAIR_B] * fluence);
}

/* --- Normalised diffusion ------------------------------------------------------------------------------------------------------- */

/* total (exp(-r/d) + exp(-r/(3 d)))/(8 pi d r): parameters 1/d and total/(8 pi d). It is singular at 0; radii are at least 1e-6 d, which
 * moves 5e-7 of the light. */
enum { BURLEY_INVERSE, BURLEY_SCALE, BURLEY_NEAR };

LANES_INLINE double lanes_burley(const double *p, double r_mm)
{
    const double from = lanes_radius(r_mm), r = from > p[BURLEY_NEAR] ? from : p[BURLEY_NEAR];
    const double e = lanes_exp(r * p[BURLEY_INVERSE] * (1.0 / 3.0));
    return p[BURLEY_SCALE] * (e * e * e + e) / r;
}

/* --- Gaussians ------------------------------------------------------------------------------------------------------------------ */

/* Parameters: count, then for each 1/(2 v) and w/(2 pi v). */
LANES_INLINE double lanes_gaussians(const double *p, int count, double r_mm)
{
    const double r = lanes_radius(r_mm), r2 = r * r;
    double sum = 0.0;
    for (int i = 0; i < count; i++)
        sum += p[2 + 2 * i] * lanes_exp(r2 * p[1 + 2 * i]);
    return sum;
}

/* --- Nodes ---------------------------------------------------------------------------------------------------------------------- */

/* Beyond the last node: parameters q and s of q (1 + s r) exp(-s r)/r^3, the far field of any diffusion; q = 0 for none. */
enum { NODES_TAIL, NODES_SIGMA };

/* The last node at or before x, excluding the last node; unused radii after the last node are infinite. */
LANES_INLINE int64_t lanes_find(const struct pell_profile *p, double x)
{
    const int64_t end = p->count - 2;
    int64_t at = 0;
    for (int64_t half = PELL_PROFILE_NODES / 2; half > 0; half /= 2)
        at = p->r[at + half] <= x ? at + half : at;
    return at < end ? at : end;
}

/* The cubic behind node i at x. */
LANES_INLINE double lanes_cubic(const struct pell_profile *p, int64_t i, double x)
{
    const double h = p->r[i + 1] - p->r[i], t = (x - p->r[i]) / h, rise = p->value[i + 1] - p->value[i];
    const double m0 = h * p->slope[i], m1 = h * p->slope[i + 1];
    const double v = p->value[i] + t * (m0 + t * ((3.0 * rise - (m0 + m0 + m1)) + t * ((m0 + m1) - (rise + rise))));
    return v > 0.0 ? v : 0.0;
}

/* Up to the last node. */
LANES_INLINE double lanes_nodes(const struct pell_profile *p, double r_mm)
{
    const double from = lanes_radius(r_mm), first = p->r[0], last = p->r[p->count - 1];
    const double above = from > first ? from : first, x = above < last ? above : last;
    return lanes_cubic(p, lanes_find(p, x), x);
}

LANES_INLINE double lanes_tail(const struct pell_profile *p, double r_mm)
{
    const double r = lanes_radius(r_mm), s = p->parameter[NODES_SIGMA], i = 1.0 / r;
    return p->parameter[NODES_TAIL] * (1.0 + s * r) * lanes_exp(s * r) * (i * i) * i;
}

#endif
