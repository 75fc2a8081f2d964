/* SPDX-License-Identifier: MIT
 *
 * medium.h - what light walks through below a surface, for methods that follow it: coefficients that are not reduced, phase functions.
 */
#ifndef PELL_RENDER_MEDIUM_H
#define PELL_RENDER_MEDIUM_H

#include <pellucid/scene.h>

/* The layers of a material from its surface down, the last without a bottom (thickness INFINITY): those of the built-in stack that it still
 * is, else one, with Henyey and Greenstein's phase function by its g. PELL_ERR_UNSUPPORTED, logged, where only a profile is known (a table,
 * Gaussians, layers of a material file). Warns of layers whose index is not the first one's: `method`, who asks, refracts at the surface
 * alone. Thread-safe. */
PELL_NODISCARD enum pell_result pell_medium_layers(struct pell_context *ctx, const char *method, const struct pell_material *m,
                                                   struct pell_material_layers *out);

/* 1/mm: sigma_s = sigma_s' / (1 - g). */
static inline double pell_medium_scattering(const struct pell_medium *m, int channel)
{
    return m->sigma_s_reduced[channel] / (1.0 - m->g[channel]);
}

#endif
