/* SPDX-License-Identifier: MIT
 *
 * forward.h - light that is scattered forward while crossing a solid, from the point where it enters to where it exits.
 *
 * Similarity theory treats the fraction exp(-sigma_t' r) of a beam as unscattered. With a Henyey-Greenstein phase function, all of it
 * except exp(-sigma_t r) was scattered, by small angles. If scattering is weak relative to absorption, this is most of the light that a
 * solid transmits, and the only part that diffusion misses.
 *
 * After a distance r along a beam, the direction has the mean cosine exp(-t), t = sigma_s' r, and the position, seen from the origin, that
 * of exp(-t/3). Paths that turn are longer and lose more: the beam is weaker by x/sinh(x) and narrower by 3 (x - tanh(x))/x^3, x = r
 * sqrt(sigma_a sigma_s'), if angles are small (a random walk with a quadratic killing rate is an oscillator). The decay rate in the limit
 * is known for any angle, so x is r (kappa - sigma_a). Hence, w the direction in which the power W enters, v the vector to a point,
 *
 *     K(r) = min(exp(-sigma_t' r), exp(-sigma_a r) x/sinh(x)) - exp(-sigma_t r)
 *     flux across v per area = W K(r) p(w.v/r; exp(-t (x - tanh(x))/x^3))/r^2
 *
 * and there it continues about v by p(; exp(-t/4)), so that the exiting light depends on the view direction. p is Henyey and Greenstein's
 * function, whose moments exp(-l t) a beam has, with a peak no narrower than the spacing of surface samples, and zero from 90 degrees on:
 * light scattered that far belongs to the diffuse part.
 *
 * A beam wider than its spread has radiance in place of flux. It is weaker by 1/cosh(x) and turns by t tanh(x)/x, since its paths may end
 * anywhere. The scattered part has the mean cosine g1, that of all light minus the unscattered part:
 *
 *     radiance = E (exp(-sigma_a r)/cosh(x) - exp(-sigma_t r)) p(c; g1)/n
 *     g1 = (exp(-t tanh(x)/x) - exp(-s))/(1 - exp(-s)),   s = sigma_s r
 *
 * c the cosine to the beam, E its irradiance where it enters and n the cosine to the normal there; p without the cut at
 * 90 degrees. Up to one mean free path this is all the light that a slab transmits: no fraction of it exits diffusely.
 */
#ifndef PELL_FORWARD_H
#define PELL_FORWARD_H

#include "math/scalar.h"
#include "optics/medium/opposed.h"

#include <pellucid/medium.h>

#include <math.h>

#define PELL_FORWARD_NARROW 0.8f    /* mean cosine above which a lobe has a peak in addition to its tail */
#define PELL_FORWARD_EXIT 0.25f     /* fraction of t by which exiting light scatters about v */
#define PELL_FORWARD_ASIDE 0.7f     /* cosine below which a lobe fades, to 0 at right angles */
#define PELL_FORWARD_NONE 0.6f      /* decay rate of diffuse light up to which forward scattering is not added, */
#define PELL_FORWARD_ALL 0.95f      /* and above which it is fully added */
#define PELL_FORWARD_FAR 25.0f      /* optical thickness beyond which nothing is transmitted */
#define PELL_FORWARD_SHARPEST 50.0f /* largest peak of exiting light */
enum { PELL_FORWARD_STEPS = 40 };   /* entries of a table by thickness */

struct pell_forward {
    float sigma_t_reduced[3], sigma_a[3], sigma_s_reduced[3]; /* 1/mm */
    float sigma_t[3];                                         /* 0: no forward scattering in this channel */
    float spread[3];                                          /* 1/mm: kappa - sigma_a, kappa the decay rate of beams with depth */
    /* sr: radiant exitance over the radiance of uniform light inside, pi (1 - Fdr) */
    float exitance;
    float thickest; /* mm: slabs in the table are thickest (i/(PELL_FORWARD_STEPS - 1))^2 thick */
    /* Fraction of the light that these slabs transmit that is not in broad beams and exits diffusely. */
    float diffuse[PELL_FORWARD_STEPS][3];
};

/* False if no channel scatters forward. */
bool pell_forward_make(const struct pell_medium *medium, struct pell_forward *out);

/* Weight of forward-scattered light as a beam of its own, in addition to diffuse light, [0, 1], by the decay rate in mean free paths: with
 * strong scattering, diffusion covers all of it. */
static inline float pell_forward_weight(float exponent)
{
    return smooth_ramp(PELL_FORWARD_NONE, PELL_FORWARD_ALL, exponent);
}

/* The same for a channel, by the decay rate of its diffuse light. */
static inline float pell_forward_separation(const struct pell_forward *f, const struct pell_opposed *diffuse, int k)
{
    return f->sigma_t[k] > 0.0f ? pell_forward_weight(diffuse->kappa[k] * diffuse->depth[k]) : 0.0f;
}

/* Henyey-Greenstein phase function of the cosine c, 1/sr. */
static inline float pell_forward_phase(float g, float c)
{
    const float base = 1.0f + g * (g - 2.0f * c);

    return (1.0f - g * g) / (12.5663706f * base * sqrtf(base));
}

/* p with the mean cosine g at the cosine c, 1/sr. The peak is proportional to exp(peak c). */
static inline float pell_forward_lobe_within(float narrow, float g, float peak, float c)
{
    const float wide = g < narrow ? g : narrow, tail = (1.0f - g * g) / (1.0f - wide * wide);
    const float fade = smooth_ramp(0.0f, PELL_FORWARD_ASIDE, c);
    const float sharp = tail < 1.0f ? (1.0f - tail) * peak * 0.159154943f * expf(peak * (c - 1.0f)) : 0.0f;

    return fade * (tail * pell_forward_phase(wide, c) + sharp);
}

/* The same with a peak above PELL_FORWARD_NARROW. */
static inline float pell_forward_lobe(float g, float peak, float c)
{
    return pell_forward_lobe_within(PELL_FORWARD_NARROW, g, peak, c);
}

/* flux: 1/mm^2, perpendicular to the vector of squared length `d2` to a point at the cosine c to a beam, whose light starts within the mean
 * cosine `wide` of it; cosine: mean of the directions there, relative to the vector. */
static inline void pell_forward_at(const struct pell_forward *f, float d2, float c, float wide, float peak, float flux[3], float cosine[3])
{
    const float r2 = d2 > 1e-20f ? d2 : 1e-20f, r = sqrtf(r2);

    for (int k = 0; k < 3; k++) {
        const float x = f->spread[k] * r, t = f->sigma_s_reduced[k] * r, depth = f->sigma_t_reduced[k] * r;
        float weaker = 1.0f, narrower = 1.0f / 3.0f, scattered;
        flux[k] = cosine[k] = 0.0f;
        if (!(f->sigma_t[k] > 0.0f && depth < PELL_FORWARD_FAR))
            continue;
        if (x > 0.1f) {
            const float e = expf(-x), e2 = e * e;
            weaker = 2.0f * x * e / (1.0f - e2);
            narrower = (x - (1.0f - e2) / (1.0f + e2)) / (x * x * x);
        }
        weaker *= expf(t);
        scattered = expf(-depth) * (weaker < 1.0f ? weaker : 1.0f) - expf(-f->sigma_t[k] * r);
        if (scattered > 0.0f) {
            flux[k] = scattered * pell_forward_lobe(wide * expf(-t * narrower), peak, c) / r2;
            cosine[k] = expf(-PELL_FORWARD_EXIT * t);
        }
    }
}

/* The scattered part of a broad beam after r mm, and the mean cosine of its directions. */
static inline float pell_forward_broad(const struct pell_forward *f, int k, float r, float *cosine)
{
    const float x = f->spread[k] * r, e = expf(-x), e2 = e * e, s = (f->sigma_t[k] - f->sigma_a[k]) * r, straight = expf(-s);
    const float angle_tau = f->sigma_s_reduced[k] * r * (x > 0.1f ? (1.0f - e2) / ((1.0f + e2) * x) : 1.0f);
    const float scattered = expf(-f->sigma_a[k] * r) * 2.0f * e / (1.0f + e2) - expf(-f->sigma_t[k] * r);

    *cosine =
        s > 1e-3f ? (expf(-angle_tau) - straight) / (1.0f - straight) : 1.0f - f->sigma_s_reduced[k] / (f->sigma_t[k] - f->sigma_a[k]);
    return f->sigma_t[k] > 0.0f && scattered > 0.0f ? scattered : 0.0f;
}

/* The fraction of a slab's transmittance that exits diffusely. separation: pell_forward_separation. */
static inline float pell_forward_diffuse(const struct pell_forward *f, int k, float d, float separation)
{
    const float x = sqrtf(d / f->thickest) * (PELL_FORWARD_STEPS - 1);
    const int i = x < PELL_FORWARD_STEPS - 2 ? (int) x : PELL_FORWARD_STEPS - 2;
    const float t = x - (float) i, diffuse = f->diffuse[i][k] + (t < 1.0f ? t : 1.0f) * (f->diffuse[i + 1][k] - f->diffuse[i][k]);

    return 1.0f - separation * (1.0f - diffuse);
}

/* p towards the unit vector `inside`, for light whose mean direction is `mean`, of the length of its mean cosine; `neighbour_cosine`: mean
 * cosine of the angle to neighbouring paths, which limits how narrow the Henyey-Greenstein peak is. */
static inline float pell_forward_toward(const float mean[3], float neighbour_cosine, const float inside[3])
{
    const float g = sqrtf(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
    const float c = mean[0] * inside[0] + mean[1] * inside[1] + mean[2] * inside[2], wide = 1.0f - g;
    const float excess = neighbour_cosine > g ? 1.0f - g / neighbour_cosine : 0.0f, narrow = 1.0f - sqrtf(excess);

    return pell_forward_lobe_within(narrow < PELL_FORWARD_NARROW ? narrow : PELL_FORWARD_NARROW, g,
                                    PELL_FORWARD_SHARPEST * wide > 1.0f ? 1.0f / wide : PELL_FORWARD_SHARPEST, g > 1e-6f ? c / g : 0.0f);
}

#endif
