/* SPDX-License-Identifier: MIT
 * opposed.c - see opposed.h. */
#include "optics/medium/opposed.h"

#include "math/vec.h"
#include "optics/medium/dipole.h"

#define STEPS 256
#define SLAB_STEPS 48
#define DEEP 10.0 /* optical thickness of the slab that calibrates the amount: only the exponential matters there */

/* The decay rate with depth in a medium that scatters isotropically, per mean free path (Case and Zweifel 1967): 1 = albedo
 * artanh(kappa)/kappa. */
static double depth_exponent(double albedo)
{
    double low = 0.0, high = 1.0;

    for (int i = 0; i < 60; i++) {
        const double k = 0.5 * (low + high);
        if (albedo * atanh(k) < k)
            low = k;
        else
            high = k;
    }
    return 0.5 * (low + high);
}

/* Two points on a sphere or spherical cavity, d mm apart. */
static struct pell_opposed_pair on_sphere(double curvature, double radius, double d)
{
    const float side = (float) (copysign(0.5, curvature) * d * d / radius);

    return (struct pell_opposed_pair) { (float) (d * d), -side, side, (float) (1.0 - 0.5 * d * d / (radius * radius)),
                                        (float) copysign(1.0 / radius, curvature) };
}

/* The radius: for spheres unchanged; for cavities at least the diffusion limit. */
static double radius_of(const struct pell_opposed *o, int channel, double curvature)
{
    const double smallest = (double) PELL_OPPOSED_MIN_RADIUS * ((double) o->depth[channel] + (double) o->beyond[channel]);

    return curvature > 0.0 ? 1.0 / curvature : fmax(-1.0 / curvature, smallest);
}

double pell_opposed_across(const struct pell_opposed *o, int channel, double curvature)
{
    const double radius = curvature > 0.0 ? radius_of(o, channel, curvature) : 0.0;
    double sum = 0.0;

    for (int i = 0; i < STEPS && radius > 0.0; i++) {
        const double d = 2.0 * radius * (i + 0.5) / STEPS;
        const struct pell_opposed_pair pair = on_sphere(curvature, radius, d);
        float through[3];
        pell_opposed_split(o, &pair, through);
        sum += 2.0 * PELL_PI * d * (double) (pell_opposed_unseen(pair.facing) * through[channel]) * 2.0 * radius / STEPS;
    }
    return sum;
}

/* Integrates over the tangent of the angle from the normal, whose square is x^2/(1 - x)^2. */
double pell_opposed_slab(const struct pell_opposed *o, int channel, double d)
{
    double sum = 0.0;

    for (int i = 0; i < SLAB_STEPS; i++) {
        const double x = (i + 0.5) / SLAB_STEPS, y = 1.0 - x, r = d * x / y;
        const struct pell_opposed_pair pair = {
            .distance2 = (float) (r * r + d * d), .from = (float) -d, .to = (float) d, .facing = -1.0f
        };
        float through[3];
        pell_opposed_split_of(o, &pair, (const bool[3]) { channel == 0, channel == 1, channel == 2 }, through);
        sum += 2.0 * PELL_PI * r * (double) through[channel] * d / (y * y * SLAB_STEPS);
    }
    return sum;
}

double pell_opposed_gain(const struct pell_opposed *o, int channel, const struct pell_profile *profile, double curvature, double gain)
{
    const double radius = curvature != 0.0 ? radius_of(o, channel, curvature) : 0.0;
    double plain = 0.0, modified = 0.0;

    if (curvature == 0.0 || !(o->amount[channel] > 0.0f))
        return gain;
    for (int i = 0; i < STEPS; i++) {
        const double x = (i + 0.5) / STEPS, d = 2.0 * radius * x * x * x, area = d * x * x;
        const struct pell_opposed_pair pair = on_sphere(curvature, radius, d);
        float R[3] = { 0.0f }, through[3];
        R[channel] = (float) pell_profile_eval(profile, d);
        plain += area * (double) R[channel];
        pell_opposed_apply(o, &pair, (const float[3]) { 1.0f, 1.0f, 1.0f }, R, through);
        modified += area * (double) (R[channel] + through[channel]);
    }
    return modified > 0.0 ? gain * plain / modified : gain;
}

bool pell_opposed_make(const struct pell_medium *medium, struct pell_opposed *out)
{
    *out = (struct pell_opposed) { { 0.0f } };
    for (int c = 0; c < 3; c++) {
        const double sigma_t = medium->sigma_a[c] + medium->sigma_s_reduced[c], albedo = medium->sigma_s_reduced[c] / sigma_t;
        struct pell_slab slab;
        double kappa, beyond, transmitted;
        if (!(sigma_t > 0.0) || !pell_slab_make(medium, c, &slab)) {
            *out = (struct pell_opposed) { { 0.0f } };
            return false;
        }
        slab.sigma_t = slab.sigma_t_reduced; /* light that similarity treats as unscattered passes through (forward.h) and is no source */
        kappa = fmax(depth_exponent(albedo), 1e-6);
        beyond = 2.0 / 3.0 * pell_boundary_A(medium->eta, PELL_FRESNEL_EXACT, 0.0);
        transmitted = pell_slab_at(&slab, DEEP / sigma_t).transmitted;
        out->kappa[c] = (float) (kappa * sigma_t);
        out->beyond[c] = (float) (beyond / sigma_t);
        out->depth[c] = (float) (1.0 / sigma_t);
        out->amount[c] = (float) (transmitted * sinh(kappa * (DEEP + 2.0 * beyond)) / sinh(kappa * (1.0 + beyond)));
    }
    return true;
}
