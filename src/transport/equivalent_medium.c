/* SPDX-License-Identifier: MIT
 * equivalent_medium.c - see equivalent_medium.h. */
#include "transport/equivalent_medium.h"

#include "image/color.h"
#include "transport/medium_layers.h"

#include <math.h>
#include <pellucid/inversion.h>

#define MAX_ALBEDO 0.999 /* upper bound of the albedo: at 1 the mean distance diverges */

bool pell_has_profile_only(const struct pell_material *m)
{
    return !m->opaque && !pell_medium_layers_known(m) && (m->profile || m->gaussians.count > 0);
}

/* Mean of a colour texture, linear. */
static void mean_of(const struct pell_image *image, double rgb[3])
{
    float texel[4];

    rgb[0] = rgb[1] = rgb[2] = 0.0;
    for (int y = 0; y < image->height; y++)
        for (int x = 0; x < image->width; x++) {
            pell_image_texel(image, x, y, texel);
            for (int c = 0; c < 3; c++)
                rgb[c] += (double) texel[c];
        }
    for (int c = 0; c < 3; c++)
        rgb[c] /= (double) image->width * (double) image->height;
}

enum pell_result pell_equivalent_medium(const struct pell_material *m, struct pell_medium *out, struct pell_medium_fault *fault)
{
    struct pell_color_and_radius target = { .eta = m->medium.eta, .kind = PELL_SCATTER_RADIUS_MEAN };
    double texture[3] = { 1.0, 1.0, 1.0 };

    *out = (struct pell_medium) { 0 };
    if (m->color_from == PELL_COLOR_FROM_TEXTURE && m->base_color_map.texture)
        mean_of(&m->base_color_map.texture->image, texture);
    for (int c = 0; c < 3; c++) {
        struct pell_profile own;
        const struct pell_profile *profile = m->profile ? &m->profile[c] : &own;
        if (!m->profile) {
            const enum pell_result res = pell_profile_from_gaussians(&m->gaussians, c, &own);
            if (res != PELL_OK)
                return res;
        }
        target.color[c] = m->color_from == PELL_COLOR_FROM_TEXTURE ? (double) m->base_color[c] * texture[c] : pell_profile_total(profile);
        target.color[c] = fmin(fmax(target.color[c], 0.0), MAX_ALBEDO);
        target.radius[c] = pell_profile_mean_radius(profile);
        if (!(target.radius[c] > 0.0)) { /* a channel without light has no scattering distance: it absorbs within a micrometre */
            target.color[c] = 0.0;
            target.radius[c] = 1e-3;
        }
    }
    return pell_medium_from_color_and_radius(&target, PELL_PROFILE_MONTE_CARLO, NULL, out, fault);
}
