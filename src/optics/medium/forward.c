/* SPDX-License-Identifier: MIT
 * forward.c - see forward.h. */
#include "optics/medium/forward.h"

#include "math/vec.h"

#include <pellucid/layers.h>

#define MOMENTS 200 /* enough for the exponential of g = 0.98 */

/* The decay rate of a beam with depth. Moments of its radiance obey k ((l + 1) psi_(l+1) + l psi_(l-1)) = (2 l + 1) h psi_l, h = sigma_a +
 * sigma_s (1 - g^l) (Case and Zweifel 1967), so that 1/k is the largest eigenvalue of a symmetric matrix with two diagonals: the smallest x
 * for which no pivot of x - matrix is negative. */
static double beam_exponent(double sigma_a, double sigma_s, double g)
{
    double square[MOMENTS], before = sigma_a, power = g, low = 0.0, high = 1.0 / sigma_a;

    for (int l = 1; l < MOMENTS; l++, power *= g) {
        const double h = sigma_a + sigma_s * (1.0 - power);
        square[l] = (double) l * l / ((4.0 * l * l - 1.0) * h * before);
        before = h;
    }
    for (int i = 0; i < 60; i++) {
        const double x = 0.5 * (low + high);
        double pivot = x;
        for (int l = 1; l < MOMENTS && pivot > 0.0; l++)
            pivot = x - square[l] / pivot;
        if (pivot > 0.0)
            high = x;
        else
            low = x;
    }
    return 1.0 / high;
}

/* The fraction of a slab's transmittance, at normal incidence, that broad beams do not account for. */
static void make_diffuse(const struct pell_medium *medium, struct pell_forward *f)
{
    const double enters = 1.0 - pell_fresnel(medium->eta, 1.0);
    double smallest = INFINITY;

    for (int c = 0; c < 3; c++)
        smallest = f->sigma_t_reduced[c] > 0.0f ? fmin(smallest, (double) f->sigma_t_reduced[c]) : smallest;
    f->thickest = (float) ((double) PELL_FORWARD_FAR / smallest);
    for (int c = 0; c < 3; c++) {
        struct pell_slab slab;
        const bool known = f->sigma_t[c] > 0.0f && pell_slab_make(medium, c, &slab);
        for (int i = 0; i < PELL_FORWARD_STEPS; i++) {
            const double x = (double) i / (PELL_FORWARD_STEPS - 1), d = (double) f->thickest * x * x;
            const double T = known ? pell_slab_at(&slab, d).transmitted : 0.0;
            float cosine;
            f->diffuse[i][c] = T > 0.0 ? (float) fmax(1.0 - enters * (double) pell_forward_broad(f, c, (float) d, &cosine) / T, 0.0)
                               : known ? 0.0f
                                       : 1.0f;
        }
    }
}

bool pell_forward_make(const struct pell_medium *medium, struct pell_forward *out)
{
    bool any = false;

    *out = (struct pell_forward) { .exitance = 0.0f };
    if (!pell_medium_valid(medium, NULL))
        return false;
    /* pi/eta^2 times the fraction of uniform light that enters; by reciprocity */
    out->exitance = (float) (PELL_PI * (1.0 - pell_fresnel_diffuse(medium->eta, PELL_FRESNEL_EXACT)));
    for (int c = 0; c < 3; c++) {
        const double a = medium->sigma_a[c], reduced = medium->sigma_s_reduced[c], g = medium->g[c], sigma_s = reduced / (1.0 - g);
        if (!(a > 0.0 && reduced > 0.0 && g > 0.0))
            continue;
        out->sigma_t_reduced[c] = (float) (a + reduced);
        out->sigma_t[c] = (float) (a + sigma_s);
        out->sigma_a[c] = (float) a;
        out->sigma_s_reduced[c] = (float) reduced;
        out->spread[c] = (float) fmax(beam_exponent(a, sigma_s, g) - a, 0.0);
        any = true;
    }
    if (any)
        make_diffuse(medium, out);
    return any;
}
