/* SPDX-License-Identifier: MIT
 *
 * solids.h - the translucent objects of a scene for methods that need whole surfaces, visible or not.
 *
 * A solid is a volume in which light propagates below the surface: all triangles of one assembly (pell_mesh_assembly) whose materials
 * have the same profile. Light therefore crosses between materials of the same assembly only if both have the same medium and model (or
 * Gaussians, or table; layers belong to one material), and never between assemblies, however close.
 */
#ifndef PELL_SOLIDS_H
#define PELL_SOLIDS_H

#include "math/sampling.h"
#include "math/vec.h"
#include "visibility/rays.h"

#include <pellucid/frame.h>

struct pell_solid {
    int object;
    size_t material; /* index of its first frame material */
    bool layered;    /* it has layers of its own, and is the only solid with them */
    size_t num_triangles;
    struct pell_solid_triangle {
        uint32_t mesh, triangle;
    } * triangles;      /* along a space-filling curve */
    double *area_after; /* mm^2: cumulative, including this triangle */
    double area;        /* mm^2 */
};

struct pell_solids {
    struct pell_context *ctx;
    struct pell_solid *solids;
    size_t count;
    int32_t *of_mesh; /* -1: none */
    size_t num_meshes;
};

/* `frame_index`: for each scene material + 1 the frame's material + 1, or 0, as the renderer keeps it. Degenerate triangles are left
 * out. */
PELL_NODISCARD enum pell_result pell_solids_create(struct pell_context *ctx, const struct pell_scene *scene, const uint16_t *frame_index,
                                                   const struct pell_frame_material *materials, struct pell_solids **out);
void pell_solids_destroy(struct pell_solids **solids);

/* Whether a material scatters by its coefficients, and not by Gaussians or a tabulated profile. `m`: the frame's version of it. */
static inline bool pell_scatters_by_medium(const struct pell_material *material, const struct pell_frame_material *m)
{
    return m->gaussians.count == 0 && !material->profile;
}

/* The same for a solid's material. */
static inline bool pell_solid_has_medium(const struct pell_scene *scene, const struct pell_solid *solid,
                                         const struct pell_frame_material *m)
{
    return solid->num_triangles > 0 && pell_scatters_by_medium(&scene->materials[scene->meshes[solid->triangles[0].mesh].material], m);
}

/* The triangle at `area` mm^2, in [0, area), along the curve; *f, in [0, 1): position within it. */
struct pell_solid_triangle pell_solid_at(const struct pell_solid *solid, double area, double *f);

/* The solids of up to 16 pixels of a frame, in->...[at[i]], found by short rays along their normals. Without a hit: the first solid of the
 * frame's material, or -1. */
void pell_solids_find(const struct pell_solids *solids, const struct pell_rays *rays, const struct pell_frame *in, const ptrdiff_t *at,
                      int count, int32_t out[16]);

#endif
