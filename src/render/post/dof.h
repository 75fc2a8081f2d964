/* SPDX-License-Identifier: MIT
 *
 * dof.h - depth of field, the share of it that is left to one multisample.
 *
 * Each of the n multisamples is seen through its own point of the lens (pell_view_through), and stands for the n-th part of the lens about
 * that point. What this part blurs is made here from the sample's picture: each pixel's light is spread over the disc of its depth,
 *
 *     radius = radius of the part x focal_px x |1/z - 1/focus|,  of the lens' radius / sqrt(n),
 *
 * and where discs of different depths meet, the nearer ones lie over the farther ones, by as much of the pixel as they cover. Sharp objects
 * do not bleed, whatever is behind or before them. What a near object hides is not in the sample's picture and is taken to be like what is
 * seen beside it, within the disc; with more samples the discs are smaller, and so is this guess.
 *
 * Discs end softly, within a pixel. Their radius is cut at PELL_DOF_MOST pixels: a hundred times that of one of 64 samples.
 */
#ifndef PELL_DOF_H
#define PELL_DOF_H

#include "render/surface/stage.h"
#include "shared/lens.h"

#define PELL_DOF_MOST PELL_LENS_MOST
#define PELL_DOF_PLANES 6 /* of scratch: the sample's R, G, B and alpha, then two of dof's own */

struct pell_dof_params {
    const struct pell_surface *surface; /* its depth and material */
    struct pell_rect rect;              /* of the composite: only read and written there */
    float scale;                        /* px mm: radius of the part of the lens x focal_px */
    float focus;                        /* mm */
    bool first;                         /* overwrite instead of adding */
};

/* Adds the blurred planes 0 to 3 of `scratch`, which are premultiplied by the last of them, to `out`. `tiles` has a float per 16 x 16
 * pixels of the image. Allocates nothing. The result does not depend on the number of threads, to the bit. Returns the radius of the
 * widest visible disc, px, before clipping. */
float pell_dof_render(struct pell_pool *pool, const struct pell_dof_params *params, float *const scratch[PELL_DOF_PLANES], float *tiles,
                      float *const out[4]);

/* Normalization of a disc, so that discs sum to one: by radius, PELL_LENS_STEPS entries per pixel. */
void pell_dof_table(float table[PELL_LENS_TABLE]);

/* Floats of `tiles`. */
static inline size_t pell_dof_tiles(int width, int height)
{
    return (size_t) ((width + PELL_DOF_MOST - 1) / PELL_DOF_MOST) * (size_t) ((height + PELL_DOF_MOST - 1) / PELL_DOF_MOST);
}

#endif
