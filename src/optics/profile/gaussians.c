/* SPDX-License-Identifier: MIT
 *
 * gaussians.c - a sum of Gaussians as a profile; all in closed form. */
#include <pellucid/gaussians.h>

#include "math/vec.h"
#include "optics/profile/lanes.h"
#include "optics/profile/shape.h"

_Static_assert(PELL_PROFILE_PARAMETERS >= 1 + 2 * PELL_GAUSSIANS_MAX, "a profile holds every sum");

/* Term i has the flux w = 2 pi (w/(2 pi v)) / (2/(2 v)), and falls as exp(-rate r^2). */
static double term(const struct pell_profile *p, int i, double *rate)
{
    *rate = p->parameter[1 + 2 * i];
    return PELL_PI * p->parameter[2 + 2 * i] / *rate;
}

static double inside(const struct pell_profile *p, double r)
{
    double sum = 0.0, rate;
    for (int i = 0; i < (int) p->parameter[0]; i++)
        sum -= term(p, i, &rate) * expm1(-r * r * rate);
    return sum;
}

static double outside(const struct pell_profile *p, double r)
{
    double sum = 0.0, rate;
    for (int i = 0; i < (int) p->parameter[0]; i++)
        sum += term(p, i, &rate) * exp(-r * r * rate);
    return sum;
}

static double transform(const struct pell_profile *p, double s)
{
    double sum = 0.0, rate;
    for (int i = 0; i < (int) p->parameter[0]; i++)
        sum += term(p, i, &rate) * exp(-0.25 * s * s / rate);
    return sum;
}

static double scale(const struct pell_profile *p)
{
    return 1.0 / sqrt(p->parameter[1]);
}

const struct pell_profile_shape pell_profile_gaussians = { inside, outside, transform, scale };

enum pell_result pell_profile_from_gaussians(const struct pell_gaussians *g, int channel, struct pell_profile *out)
{
    if (!g || !out)
        return PELL_ERR_INVALID;

    int count = 0;
    double total = 0.0;

    memset(out, 0, sizeof(*out));
    if (channel < 0 || channel > 2 || g->count < 0 || g->count > PELL_GAUSSIANS_MAX)
        return PELL_ERR_INVALID;
    for (int i = 0; i < g->count; i++) {
        const double v = g->variance[i], w = g->weight[i][channel];
        if (!(v >= PELL_GAUSSIANS_VARIANCE_MIN && v <= PELL_GAUSSIANS_VARIANCE_MAX) || !(w >= 0.0 && w <= 1.0)) {
            memset(out, 0, sizeof(*out));
            return PELL_ERR_INVALID;
        }
        if (w == 0.0)
            continue;
        out->parameter[1 + 2 * count] = 0.5 / v;
        out->parameter[2 + 2 * count] = w / (2.0 * PELL_PI * v);
        total += w;
        count++;
    }
    if (total > 1.0 + PELL_PROFILE_TOTAL_SLACK) {
        memset(out, 0, sizeof(*out));
        return PELL_ERR_INVALID;
    }
    out->kind = PELL_PROFILE_KIND_GAUSSIANS;
    out->parameter[0] = count;
    out->total = fmin(1.0, total);
    pell_profile_drop_traces(out);
    return PELL_OK;
}
