/* SPDX-License-Identifier: MIT
 *
 * dof.h - depth of field: post-process blur of one multisample.
 *
 * Each of the n multisamples is rendered through its own point of the lens (pell_view_through), and represents 1/n of the lens area around
 * that point. The blur by this part of the lens is computed from the sample's image: each pixel's light is spread over its circle of
 * confusion,
 *
 *     radius = radius of the part x focal_px x |1/z - 1/focus|,  with radius of the part = lens radius / sqrt(n),
 *
 * and where discs of different depths overlap, nearer ones are composited over farther ones by their coverage of the pixel. Objects in
 * focus do not bleed into what is in front of or behind them. Background hidden by a near object is missing in the sample's image; it is
 * assumed to be like the visible background inside the disc. With more samples the discs, and with them this error, are smaller.
 *
 * Discs are antialiased over one pixel. Their radius is limited to PELL_DOF_MOST pixels, and so that of the whole lens to sqrt(n) times as
 * many.
 */
#ifndef PELL_DOF_H
#define PELL_DOF_H

#include "render/surface/stage.h"
#include "shared/lens.h"

#define PELL_DOF_MOST PELL_LENS_MOST
#define PELL_DOF_PLANES 6 /* scratch planes: the sample's R, G, B and alpha, then two private ones */

struct pell_dof_params {
    const struct pell_surface *surface; /* depth and material of the pixels */
    struct pell_rect rect;              /* rectangle of the composite: only its pixels are read and written */
    float scale;                        /* px mm: radius of the part of the lens x focal_px */
    float focus;                        /* mm */
    bool first;                         /* overwrite instead of adding */
};

/* Adds the blurred planes 0 to 3 of `scratch`, which are premultiplied by the last of them, to `out`. `tiles` has a float per 16 x 16
 * pixels of the image. Allocates nothing. The result does not depend on the number of threads, to the bit. Returns the radius of the
 * widest visible disc, px, before clipping. */
float pell_dof_render(struct pell_pool *pool, const struct pell_dof_params *params, float *const scratch[PELL_DOF_PLANES], float *tiles,
                      float *const out[4]);

/* Weight of a fully covered pixel of a disc, so that discs sum to one: by radius, PELL_LENS_STEPS entries per pixel. */
void pell_dof_table(float table[PELL_LENS_TABLE]);

/* Number of floats in `tiles`. */
static inline size_t pell_dof_tiles(int width, int height)
{
    return (size_t) ((width + PELL_DOF_MOST - 1) / PELL_DOF_MOST) * (size_t) ((height + PELL_DOF_MOST - 1) / PELL_DOF_MOST);
}

#endif
