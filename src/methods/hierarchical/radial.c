/* SPDX-License-Identifier: MIT
 * radial.c - see hierarchical.h. */
#include "methods/hierarchical/hierarchical.h"

#include "base/base.h"
#include "math/vec.h"
#include "optics/profile/white.h"

#include <string.h>

#define RADII 2048 /* number of radii, with equal fractions of the light, for integrals */

double hierarchical_radial_length(const struct pell_frame_material *m)
{
    double least = INFINITY;

    for (int c = 0; c < 3; c++)
        if (pell_profile_total(&m->profile[c]) > 0.0)
            least = fmin(least, pell_profile_sample(&m->profile[c], 0.25));
    return least > 1e-9 && least < INFINITY ? least : 1e-9;
}

void hierarchical_radial_finish(struct hierarchical_radial *r)
{
    if (r->node)
        pell_free(r->ctx, r->node);
    r->node = NULL;
}

/* Light returned within the window (1 - r^2/reach^2)^2 under uniform irradiance on a plane, and the mean of R over a disc, for each
 * strength. */
static void make_near(const struct pell_profile *p, int channel, double scale, double reach, double disc, struct hierarchical_radial *r)
{
    static const double least = 1.0 / 1024.0;
    const double total = scale * pell_profile_total(p);

    for (int i = 0; i < HI_STRENGTHS; i++) {
        const double s = fmax((double) i / (HI_STRENGTHS - 1), least);
        r->window[i][channel] = 0.0f;
        r->core[i][channel] = (float) (total * pell_profile_cdf(p, disc / s) / (PELL_PI * disc * disc));
    }
    for (int k = 0; k < RADII && total > 0.0; k++) {
        const double radius = pell_profile_sample(p, (k + 0.5) / RADII);
        for (int i = 0; i < HI_STRENGTHS; i++) {
            const double s = fmax((double) i / (HI_STRENGTHS - 1), least), t = 1.0 - radius * s * radius * s / (reach * reach);
            if (t > 0.0)
                r->window[i][channel] += (float) (total * t * t / RADII);
        }
    }
}

enum pell_result hierarchical_radial_fit(struct pell_context *ctx, const struct pell_frame_material *m, int gaussians,
                                         struct pell_profile out[3])
{
    const struct pell_fit_params params = { .count = gaussians };
    struct pell_gaussians g;

    memcpy(out, m->profile, 3 * sizeof(*out));
    if (gaussians == 0 || m->gaussians.count > 0)
        return PELL_OK;
    if (pell_fit_profiles(m->profile, &params, &g, NULL) != PELL_OK)
        goto fail;
    for (int c = 0; c < 3 && g.count > 0; c++)
        if (pell_profile_from_gaussians(&g, c, &out[c]) != PELL_OK)
            goto fail;
    return PELL_OK;

fail:
    return pell_error(ctx, PELL_ERR_INVALID, m->name, "change its coefficients, or use fewer Gaussians",
                      "no sum of %d Gaussians fits this material's profile", gaussians);
}

enum pell_result hierarchical_radial_make(struct pell_context *ctx, const struct pell_profile profile[3], bool white, double low,
                                          double high, double reach, double disc, struct hierarchical_radial *r)
{
    r->ctx = ctx;
    r->first = pell_float_bits((float) fmax(low * low, 1e-30)) >> HI_SHIFT;
    r->count = (pell_float_bits((float) fmin(high * high, 1e30)) >> HI_SHIFT) + 1 - r->first;
    r->node = pell_calloc(ctx, (size_t) r->count + 2, sizeof(*r->node));
    if (!r->node)
        return PELL_ERR_NOMEM;
    for (int c = 0; c < 3; c++) {
        const struct pell_profile *p = &profile[c];
        const double scale = pell_profile_scale(p, white);
        r->total[c] = scale * pell_profile_total(p);
        make_near(p, c, scale, reach, disc, r);
        for (int i = 0; i <= r->count; i++)
            r->node[i][c] = (float) (scale * pell_profile_eval(p, sqrt((double) pell_bits_float((r->first + i) << HI_SHIFT))));
    }
    return PELL_OK;
}
