/* SPDX-License-Identifier: MIT
 *
 * solids.h - the translucent objects of a scene as references see them: whole surfaces, seen or not.
 *
 * A solid is what light moves about in below the surface: all triangles of one object (struct pell_mesh.object) whose materials scatter by
 * one profile. So light goes from a material to another of the same object only where both have the same medium and model (or Gaussians,
 * or table; layers of its own are one material's alone), and never from one object to another, however near.
 */
#ifndef PELL_SOLIDS_H
#define PELL_SOLIDS_H

#include "math/sampling.h"
#include "math/vec.h"
#include "visibility/rays.h"

#include <pellucid/frame.h>

struct pell_solid {
    int object;
    size_t material; /* index of a frame material: the first of them */
    bool layered;    /* it has layers of its own, and is the only one */
    size_t num_triangles;
    struct pell_solid_triangle {
        uint32_t mesh, triangle;
    } * triangles;      /* along a space-filling curve */
    double *area_after; /* mm^2: of the triangles up to and with this one */
    double area;        /* mm^2 */
};

struct pell_solids {
    struct pell_context *ctx;
    struct pell_solid *solids;
    size_t count;
    int32_t *of_mesh; /* -1: in no solid */
    size_t num_meshes;
};

/* `frame_index`: per scene material + 1 the frame's material + 1, or 0, as the renderer keeps it. Triangles without area are left out. */
PELL_NODISCARD enum pell_result pell_solids_create(struct pell_context *ctx, const struct pell_scene *scene, const uint16_t *frame_index,
                                                   const struct pell_frame_material *materials, struct pell_solids **out);
void pell_solids_destroy(struct pell_solids **solids);

/* Whether a material scatters as its coefficients say, and not by Gaussians or a profile from a file. `m`: the frame's of it. */
static inline bool pell_scatters_by_medium(const struct pell_material *material, const struct pell_frame_material *m)
{
    return m->gaussians.count == 0 && !material->profile;
}

/* The same of a solid's material. */
static inline bool pell_solid_has_medium(const struct pell_scene *scene, const struct pell_solid *solid,
                                         const struct pell_frame_material *m)
{
    return solid->num_triangles > 0 && pell_scatters_by_medium(&scene->materials[scene->meshes[solid->triangles[0].mesh].material], m);
}

/* The triangle at `area` mm^2, in [0, area), along the curve; *f, in [0, 1): how far into it. */
struct pell_solid_triangle pell_solid_at(const struct pell_solid *solid, double area, double *f);

/* Which solids up to 16 pixels of a frame, in->...[at[i]], are on: short rays along their normals ask. Those that find nothing: the
 * first solid of the frame's material, or -1. */
void pell_solids_find(const struct pell_solids *solids, const struct pell_rays *rays, const struct pell_frame *in, const ptrdiff_t *at,
                      int count, int32_t out[16]);

#endif
