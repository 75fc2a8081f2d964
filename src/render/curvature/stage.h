/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "curvature": factor by which a convex surface of a translucent object returns more light than its profile says, and a
 * concave one less (pell_curvature_gain in pellucid/profile.h). Entering light is scaled by it.
 *
 * Mean curvature is measured on the mesh as half of the sum of length times dihedral angle over its edges (Cohen-Steiner and Morvan 2003),
 * per area, both averaged over the distance that light travels in the material, so that bumps smaller than the blur have no effect.
 * Vertices store their value; triangles larger than that distance are evaluated at each point.
 */
#ifndef PELL_CURVATURE_H
#define PELL_CURVATURE_H

#include "base/pool.h"
#include "render/services.h"
#include "scene/scene.h"
#include "visibility/rays.h"

struct pell_curvature;

/* A material's medium, and its profiles for R, G and B. */
struct pell_curvature_medium {
    const struct pell_medium *medium; /* NULL: no gain */
    const struct pell_profile *profile;
};
/* `media`: per scene material. *out is NULL where no material has a gain, or nothing is curved. Borrows `scene`; its `rays` find thin
 * parts, NULL: nothing is thin. The result does not depend on the number of threads, to the bit. */
PELL_NODISCARD enum pell_result pell_curvature_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                      const struct pell_rays *rays, const struct pell_curvature_medium *media,
                                                      struct pell_curvature **out);
void pell_curvature_destroy(struct pell_curvature **curvature);

/* Shape around a point of a triangle; 0 for opaque materials and invalid triangles. */
struct pell_curvature_shape {
    float mean;     /* curvature, 1/mm, positive where it is convex */
    float thinness; /* 1/mm: degree to which the faces oppose, over the thickness under the point; for a ball half its curvature */
};
struct pell_curvature_shape pell_curvature_at(const struct pell_curvature *curvature, uint32_t mesh, uint32_t triangle, float u, float v);

/* Effects of the shape on light that enters at 16 points. gain: factor for methods that gather light at every distance through the
 * solid. local: the same for methods that spread all light around its entry and add transmission through thin parts by a slab's T: the
 * total return of a ball of this curvature, times that of a slab thinner than the ball, minus T. Under uniform light the sum is exact
 * diffusion in a ball and in a slab. opposed: `gain` for methods that correct the profile between faces at an angle
 * (optics/medium/opposed.h). opposed_local: `local` for methods that add transport between faces. shift: light that arrives at the
 * cosine mu is first scattered one mean free path further along its refracted direction, away from its entry. On a curved surface this
 * moves light from steep to grazing incidence: mu becomes mu + shift (1 - 3 mu^2), which over a ball has the same sum. sheet and round:
 * the part of a slab's T by which `local` is smaller, over the return of a half-space, to the degree that the part is flat, and round.
 * returned: fraction of a half-space's return that leaves on the same side of a flat thin part; 1 for other parts. crossed: ratio of a
 * slab's transmission to that of optics/medium/opposed.h in such a part; 1 for other parts. uniform: the total return of uniform light,
 * `local` plus T, over that of a half-space. small: where it is known from flights, as in small.h, since a part is too small for
 * diffusion; 1 there, 0 in large parts. */
struct pell_curvature_effects {
    _Alignas(64) float gain[3][16], local[3][16], opposed[3][16],
        opposed_local[3][16], shift[3][16], sheet[3][16], round[3][16], returned[3][16], crossed[3][16], uniform[3][16], small[3][16];
    float flat[16]; /* 1: a sheet; 0: as round as a ball or a cylinder, or not thin */
};
/* Computes the effects at points of triangles: mesh, triangle, u and v of `at`. No effect where `active` is 0. */
void pell_curvature_effects_at(const struct pell_curvature *curvature, const struct pell_points16 *at, const int32_t *active,
                               struct pell_curvature_effects *out);

/* Packs the data of these functions into 32-bit words for a device. Returns their number; `out` NULL: they are not written.
 *   Head: capacity of the grid, its first word, 2 words unused. Per mesh, first words of: its patch (PELL_CURVATURE_NONE: none), the shapes
 *   at its vertices (mean, thinness), flags of the triangles that are larger than the distance of averaging (a word each;
 *   PELL_CURVATURE_NONE: none is), its material's response. Grid: nodes of patch + 1 (0: free), node_index ((x * 1024 + y) * 1024 + z),
 *   area, turn, thin; a node is found from pell_curvature_slot() & (capacity - 1) on. Patch: low corner, step, its index. Response: step,
 *   limit, path of R, G and B; then tables of PELL_CURVATURE_GAINS entries: gain, opposed, across, all; slab, through, ball and small,
 *   4 floats each. */
enum { PELL_CURVATURE_HEAD = 4, PELL_CURVATURE_OF_MESH = 4, PELL_CURVATURE_NODE = 5 };
#define PELL_CURVATURE_NONE UINT32_MAX
size_t pell_curvature_words(const struct pell_curvature *curvature, uint32_t *out);

#endif
