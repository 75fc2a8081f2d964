/* SPDX-License-Identifier: MIT
 * frame_material.c - checks and profiles of a frame's materials. */
#include "render/frame_material.h"

enum pell_result pell_frame_material_check(struct pell_context *ctx, const char *name, const struct pell_frame_material *m)
{
    const struct pell_gaussians *g = &m->gaussians;
    struct pell_medium_fault fault;

    if (g->count < 0 || g->count > PELL_GAUSSIANS_MAX)
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "gaussians.count = %d, must be in [0, %d]", g->count, PELL_GAUSSIANS_MAX);
    for (int k = 0; k < g->count; k++) {
        const double v = g->variance[k], *w = g->weight[k];
        if (!(v > 0.0 && v < 1e12) || (k > 0 && v <= g->variance[k - 1]))
            return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "variance[%d] = %g mm^2, must be positive, under 1e12 and rising", k, v);
        for (int c = 0; c < 3; c++)
            if (!(w[c] >= 0.0 && w[c] <= 1.0))
                return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "weight[%d][%d] = %g, must be in [0, 1]", k, c, w[c]);
    }
    if (!(m->strength >= 0.0f && m->strength <= 1.0f))
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "strength = %g, must be in [0, 1]", (double) m->strength);
    if (!m->profile && g->count == 0 && !pell_medium_valid(&m->medium, &fault))
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "%s = %g, must be in [%g, %g]", fault.field, fault.value, fault.min,
                          fault.max);
    return PELL_OK;
}

enum pell_result pell_frame_material_profile(struct pell_context *ctx, const char *name, const struct pell_frame_material *m,
                                             enum pell_profile_model model, struct pell_profile *out)
{
    for (int c = 0; c < 3; c++) {
        const enum pell_result res = m->gaussians.count > 0 ? pell_profile_from_gaussians(&m->gaussians, c, &out[c])
                                                            : pell_profile_make(model, &m->medium, c, NULL, &out[c]);
        if (res != PELL_OK)
            return pell_error(ctx, res, name, "choose another profile", "has no profile %s",
                              pell_profile_model_at(model) ? pell_profile_model_at(model)->name : "of that model");
    }
    return PELL_OK;
}
