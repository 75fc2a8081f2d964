/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "curvature": by how much more a convex, and less a hollow, surface of a translucent object returns than its profile says
 * (pell_curvature_gain in pellucid/profile.h). Light that enters is scaled by it.
 *
 * Mean curvature is a measure of the mesh, half of the sum of length times dihedral angle over its edges (Cohen-Steiner and Morvan 2003),
 * per area, both averaged over the distance that light goes in the material: bumps that light blurs away count for nothing. A vertex keeps
 * its value; triangles that are larger than the distance ask at each point.
 */
#ifndef PELL_CURVATURE_H
#define PELL_CURVATURE_H

#include "base/pool.h"
#include "render/services.h"
#include "scene/scene.h"
#include "visibility/rays.h"

struct pell_curvature;

/* `media`: per scene material, of R, G and B, and their profiles; NULL where there is no gain. *out is NULL where no material has one, or
 * nothing is curved. Borrows `scene`; `rays` of it find thin parts, NULL: nothing is thin. The same bits for any number of threads. */
struct pell_curvature_medium {
    const struct pell_medium *medium;
    const struct pell_profile *profile;
};
PELL_NODISCARD enum pell_result pell_curvature_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                      const struct pell_rays *rays, const struct pell_curvature_medium *media,
                                                      struct pell_curvature **out);
void pell_curvature_destroy(struct pell_curvature **curvature);

/* The shape around a point of a triangle; 0 for opaque materials, and where there is no such triangle. */
struct pell_curvature_shape {
    float mean;     /* curvature, 1/mm, positive where it is convex */
    float thinness; /* 1/mm: over the thickness under the point, times how far the faces oppose; over a ball half its curvature */
};
struct pell_curvature_shape pell_curvature_at(const struct pell_curvature *curvature, uint32_t mesh, uint32_t triangle, float u, float v);

/* What it does to light that enters at 16 points. `gain`: factor of all of it, for methods that look for light at every distance through
 * the solid. `local`: the same for methods that spread all light around the place where it enters and add what thin parts let through by a
 * slab's T: what a ball of this curvature returns in all, times what a slab does that is thinner than the ball, less that T. Under even
 * light both add up to exact diffusion in a ball and in a slab. `opposed`: `gain` for methods that turn the profile between faces at an
 * angle (optics/medium/opposed.h), `opposed_local`: `local` for those that add what goes from face to face. `shift`: light that falls
 * along the cosine mu is scattered first one mean free path on along its refracted direction, beside the place where it enters. On a
 * curved surface more of it arrives where it grazes than where it falls steeply: in place of mu enters mu + shift (1 - 3 mu^2), which
 * over a ball is as much. `sheet` and `round`: the slab's T that `local` is less by, over what a half-space returns, as far as the part is
 * flat, and as far as it is round. `returned`: of what a half-space returns, the share that leaves on the same side of a part
 * that is flat and thin; 1 of others. `crossed`: of what goes through such a part by optics/medium/opposed.h, the share that a slab lets
 * through; 1 of others. */
struct pell_curvature_effects {
    _Alignas(64) float gain[3][16], local[3][16], opposed[3][16],
        opposed_local[3][16], shift[3][16], sheet[3][16], round[3][16], returned[3][16], crossed[3][16];
    float flat[16]; /* 1: a sheet; 0: as round as a ball or a cylinder, or not thin */
};
/* At points of triangles: mesh, triangle, u and v of `at`. Nothing happens to light where `ask` is 0. */
void pell_curvature_effects_at(const struct pell_curvature *curvature, const struct pell_points16 *at, const int32_t *ask,
                               struct pell_curvature_effects *out);

/* The same for a device: what it knows as words of 32 bits. Returns how many; `out` NULL: they are not written.
 *   room of the grid, its first word, 2 words unused; of each mesh: its patch (PELL_CURVATURE_NONE: nothing is known of it), what its
 *   vertices keep (mean, thinness), whether triangles are larger than the distance of averaging (a word each; PELL_CURVATURE_NONE: none
 *   is), its material's law: first words.
 *   Grid: `room` nodes of patch + 1 (0: free), place ((x * 1024 + y) * 1024 + z), area, turn, thin; a node is found from
 *   pell_curvature_slot() & (room - 1) on. Patch: low corner, step, its number. Law: step, limit, path of R, G and B; then tables of
 *   PELL_CURVATURE_GAINS entries: gain, opposed, across, all; slab, through, ball and small, 4 floats each. */
enum { PELL_CURVATURE_HEAD = 4, PELL_CURVATURE_OF_MESH = 4, PELL_CURVATURE_NODE = 5 };
#define PELL_CURVATURE_NONE UINT32_MAX
size_t pell_curvature_words(const struct pell_curvature *curvature, uint32_t *out);

#endif
