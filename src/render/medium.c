/* SPDX-License-Identifier: MIT
 * medium.c - see medium.h. */
#include "render/medium.h"

#include "base/base.h"

#include <math.h>
#include <string.h>

/* A scene keeps of a stack what it reflects, and its name: it is the built-in one as long as that is the same. */
static const struct pell_material_entry *stack_of(const struct pell_material *m)
{
    const struct pell_material_entry *e = m->preset && !m->profile ? pell_material_find(m->preset) : NULL;

    return e && e->kind == PELL_MATERIAL_LAYERS && memcmp(&e->gaussians, &m->gaussians, sizeof(e->gaussians)) == 0 ? e : NULL;
}

enum pell_result pell_medium_layers(struct pell_context *ctx, const char *method, const struct pell_material *m,
                                    struct pell_material_layers *out)
{
    const struct pell_material_entry *e = stack_of(m);

    if (e) {
        *out = e->layers;
        out->item[out->count - 1].thickness_mm = (double) INFINITY;
        for (int i = 1; i < out->count; i++)
            if (fabs(out->item[i].medium.eta - out->item[0].medium.eta) > 1e-3)
                pell_warn(ctx, m->name, NULL,
                          "the index of layer %s, %g, is taken for %g, the first layer's: %s refracts at the surface alone",
                          out->item[i].name, out->item[i].medium.eta, out->item[0].medium.eta, method);
        return PELL_OK;
    }
    if (m->profile || m->gaussians.count > 0)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, m->name, "give it a medium: coefficients, or a built-in material that has some",
                          "has a profile but no medium: %s walks by coefficients", method);
    memset(out, 0, sizeof(*out));
    out->count = 1;
    out->item[0].thickness_mm = (double) INFINITY;
    out->item[0].medium = m->medium;
    for (int c = 0; c < 3; c++)
        out->item[0].phase[c] = (struct pell_phase){ PELL_PHASE_HENYEY_GREENSTEIN, { m->medium.g[c], 0.0 }, 0.0 };
    return PELL_OK;
}
