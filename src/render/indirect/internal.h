/* SPDX-License-Identifier: MIT
 *
 * internal.h - what the files of this stage share. Private to the folder.
 */
#ifndef RENDER_INDIRECT_INTERNAL_H
#define RENDER_INDIRECT_INTERNAL_H

#include "render/indirect/blend_kernel.h"
#include "render/indirect/stage.h"
#include "render/indirect/whole.h"

#include "math/sampling.h"
#include "math/vec.h"
#include "scene/material_maps.h"
#include "transport/light_tree.h"

#define INDIRECT_RAYS 96 /* of a sample */
#define INDIRECT_NONE UINT32_MAX
#define INDIRECT_CLEAR 1.0e-4f /* of the largest coordinate: how far from the surface rays start */

/* A place of a surface that gathers light, and that lights others. */
struct indirect_sample {
    uint32_t mesh, triangle;
    float u, v;                        /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    struct pell_vec3 position, normal; /* mm; of the triangle, on its side */
    struct pell_vec3 smooth;           /* the vertices' normals, interpolated, on its side */
    float spacing;                     /* mm to the next samples */
    uint32_t material;                 /* of the scene */
    bool back;                         /* on the side from which the triangle's corners run clockwise */
};

/* A triangle that was cut into four, again and again. A leaf has no children. */
struct indirect_cell {
    uint32_t child;   /* first of four: at corners 0, 1, 2, and the middle one. 0: none */
    uint32_t knot[3]; /* at its corners */
};

/* A knot that is no vertex of a mesh. */
struct indirect_knot {
    uint32_t mesh, triangle;
    float u, v;
};

struct indirect_mesh {
    uint32_t first_knot; /* of vertex 0 */
    uint32_t first_back; /* the same of the back sides, where its material is opaque */
    uint32_t first_root; /* roots[first_root + triangle]: cell of the triangle, or INDIRECT_NONE. INDIRECT_NONE: no triangle is cut */
};

/* What light can go along: to which sample, and the exit factor there in steps of 1/INDIRECT_STEPS. */
#define INDIRECT_STEPS 180.0f
#define INDIRECT_SAMPLES_MOST (1u << 24)
struct indirect_link {
    uint32_t sample : 24, factor : 8; /* factor 0: to nowhere */
};

/* To which sample light comes by a reflection where a ray ends, and its share. */
#define INDIRECT_MIRRORED 32
struct indirect_mirror {
    uint32_t sample;
    float factor;
};

/* Samples near a knot, and their weights, which sum to 1. */
#define INDIRECT_NEAR 10
struct indirect_near {
    uint32_t sample[INDIRECT_NEAR];
    float weight[INDIRECT_NEAR]; /* 0 behind the last */
};

/* What solid.c finds at a place, of R, G and B. */
struct indirect_solid_light {
    float solved[3]; /* [0, 1]: how far the rest holds */
    float gain[3];   /* factor of what a method finds that spreads light by the profile, */
    float light[3];  /* and what is added to it, W/m^2; */
    float all[3];    /* and all that leaves, */
    float deep[3];   /* and how much of what is scaled, or added, comes from the depth */
};

/* At a value, what points blend; two lines of a cache. */
#define INDIRECT_INSIDE 28
union indirect_inside {
    struct pell_indirect_inside of;
    float all[32];
};
_Static_assert(sizeof(struct pell_indirect_inside) <= INDIRECT_INSIDE * sizeof(float), "all of it");
_Static_assert(offsetof(struct pell_indirect_insides, beam) == INDIRECT_INSIDE * sizeof(float[16]), "the same, of 16 points");
#define INDIRECT_BEAM 16
_Static_assert(sizeof(struct pell_indirect_beam) == INDIRECT_BEAM * sizeof(float), "all of it");

struct pell_indirect {
    struct pell_context *ctx;
    const struct indirect_blend_kernels *kernels;
    struct pell_indirect_params p;

    float diffuse; /* pell_indirect_diffuse */
    struct indirect_mesh *meshes;
    uint32_t *roots;
    struct indirect_cell *cells;
    struct indirect_knot *extra; /* knots behind those of the meshes */
    size_t num_roots, num_cells, num_extra, num_mesh_knots, num_knots;
    size_t num_values; /* knots, then the back sides of extra knots, then those of opaque meshes' vertices */

    struct indirect_sample *samples;
    size_t num_samples;
    struct indirect_link *links;      /* [sample][INDIRECT_RAYS] */
    struct indirect_mirror *mirrored; /* [sample][INDIRECT_MIRRORED]; NULL: nothing is translucent */
    float (*enter)[INDIRECT_RAYS];    /* per scene material: T of each ray's direction */

    struct indirect_near *near; /* of each value */

    uint32_t *part; /* with p.through, of samples: the solid of its object (apart.c), or INDIRECT_NONE; NULL: each object is one */

    /* Of the lights. */
    float (*direct)[3], (*albedo)[3]; /* of samples: light that enters; rho times the base colour */
    uint32_t *across;    /* of samples: that on the other side of a sheet, or of the solid, or INDIRECT_NONE; NULL: nothing is either */
    float (*through)[3]; /* of samples: the share of what meets the one across that leaves here. NULL as across */
    float (*passed)[3];  /* the same of solids, without the albedo here */
    float (*gathered)[3], (*leaving)[3];
    float (*reflected)[3], (*before)[3]; /* light that enters after one reflection; what left a bounce ago. NULL as mirrored */
    float (*area)[3];                    /* mm^2, of samples: of the light that lands around them */
    float (*value)[4];                   /* of values, and 0; NULL: p.through */
    float (*behind)[4];                  /* of values: light of solids' other sides that leaves here, without the albedo, and 0. NULL as
                                          * across */
    union indirect_inside *inside;       /* of values; NULL: not p.through */
    struct pell_indirect_beam *beam;     /* of values; NULL: nothing is scattered forward */
    struct pell_indirect_ahead *ahead;   /* per scene material; NULL as beam */
};

/* A barycentric point of a triangle and the interpolated normal of its vertices, not unit. */
struct indirect_place {
    struct pell_vec3 position, normal;
};
static inline struct indirect_place indirect_place_at(const struct pell_mesh *mesh, uint32_t triangle, float u, float v)
{
    const uint32_t *index = mesh->index + 3 * (size_t) triangle;
    const float w[3] = { 1.0f - u - v, u, v };
    struct indirect_place p = { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };

    for (int k = 0; k < 3; k++) {
        p.position = vec3_mad(p.position, w[k], vec3_load(mesh->position + 3 * (size_t) index[k]));
        p.normal = vec3_mad(p.normal, w[k], vec3_load(mesh->normal + 3 * (size_t) index[k]));
    }
    return p;
}

/* Whether a mesh takes part. */
static inline bool indirect_shown(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    bool cut;
    return mesh->num_triangles > 0 && pell_rays_show(scene, mesh, &cut);
}

/* How far from `p` rays start, mm. */
static inline float indirect_clearance(struct pell_vec3 p, float spacing)
{
    return INDIRECT_CLEAR * fmaxf(fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z))), spacing);
}

/* --- spacing.c: how far samples lie apart ------------------------------------------------------------------------------------------- */

#define INDIRECT_BOXES 64

/* Boxes of objects, and the distance of samples on each. */
struct indirect_spacing {
    struct indirect_box {
        struct pell_vec3 low, high;
        float spacing;
    } box[INDIRECT_BOXES];
    int count;
    float scale;
};

void indirect_spacing_make(const struct pell_scene *scene, struct indirect_spacing *out);
/* mm, > 0. As fine as the nearest object asks for, coarser the farther it is. */
float indirect_spacing_at(const struct indirect_spacing *s, struct pell_vec3 p);

/* --- cells.c: large triangles cut into cells, samples and knots --------------------------------------------------------------------- */

/* Fills meshes, roots, cells, extra and samples. The caller frees them with the rest. */
PELL_NODISCARD enum pell_result indirect_cells_make(struct pell_indirect *in, struct indirect_spacing *spacing);
/* The knots around a point of a triangle, and the point's barycentric coordinates between them. */
static inline void indirect_find(const struct pell_indirect *in, uint32_t mesh, uint32_t triangle, float u, float v, uint32_t knot[3],
                                 float weight[3])
{
    const struct indirect_mesh *m = &in->meshes[mesh];
    const uint32_t *index = in->p.scene->meshes[mesh].index + 3 * (size_t) triangle;
    uint32_t cell = in->roots[m->first_root + triangle];
    float w[3] = { 1.0f - u - v, u, v };

    if (cell == INDIRECT_NONE) {
        for (int i = 0; i < 3; i++) {
            knot[i] = m->first_knot + index[i];
            weight[i] = w[i];
        }
        return;
    }
    while (in->cells[cell].child) {
        const int at = w[0] >= 0.5f ? 0 : w[1] >= 0.5f ? 1 : w[2] >= 0.5f ? 2 : 3;
        for (int i = 0; i < 3; i++)
            w[i] = at == 3 ? 1.0f - 2.0f * w[i] : i == at ? 2.0f * w[i] - 1.0f : 2.0f * w[i];
        cell = in->cells[cell].child + (uint32_t) at;
    }
    for (int i = 0; i < 3; i++) {
        knot[i] = in->cells[cell].knot[i];
        weight[i] = w[i];
    }
}

/* Number of a knot's value on one side of a mesh. */
static inline size_t indirect_value_of(const struct pell_indirect *in, uint32_t mesh, uint32_t knot, bool back)
{
    if (!back)
        return knot;
    return knot < in->num_mesh_knots ? in->meshes[mesh].first_back + (size_t) (knot - in->meshes[mesh].first_knot)
                                     : in->num_knots + (knot - in->num_mesh_knots);
}

/* --- buried.c: samples inside the solid ----------------------------------------------------------------------------------------------- */

/* Rays from the translucent ones of the samples from `first` on, along or against their normals; valid: 0 of others. */
void indirect_along_normals16(const struct pell_indirect *in, size_t first, bool inward, int valid[16], struct pell_ray_hit16 *r);
/* Leaves them out. */
PELL_NODISCARD enum pell_result indirect_drop_buried(struct pell_indirect *in, struct pell_pool *pool);

/* --- near.c: the samples around each knot ------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_near_make(struct pell_indirect *in, struct pell_pool *pool,
                                                   const struct indirect_spacing *spacing);

/* --- mirror.c: light that is reflected without entering ------------------------------------------------------------------------------ */

/* T of a direction, and its mean over a diffuse hemisphere. */
float indirect_transmittance(const struct pell_indirect *in, uint32_t material, float mu, float *mean);
/* Where light along w goes on from a surface of normal n, both unit, and the share that does: 0 at opaque surfaces, which send all back
 * evenly, and from inside. */
float indirect_reflect(const struct pell_indirect *in, uint32_t material, struct pell_vec3 n, struct pell_vec3 w, uint32_t hash,
                       struct pell_vec3 *out);
/* Makes room for it where something is translucent; then `reflected`, by the scene's lights. */
PELL_NODISCARD enum pell_result indirect_mirror_make(struct pell_indirect *in);
PELL_NODISCARD enum pell_result indirect_mirror_light(struct pell_indirect *in, struct pell_pool *pool);

/* --- solid.c: diffusion in the solid that there is ---------------------------------------------------------------------------------- */

/* Samples of one solid and material. */
struct indirect_solid {
    const struct pell_lit_place *samples; /* their power not scaled by curvature */
    const float (*source)[3]; /* of their power, what goes into the depth: as it falls there, without what its angle returns more; */
    const float (*once)[3];   /* and what stands for single scattering; NULL: nothing does */
    const float *slope;       /* of R, G and B: that, see struct pell_indirect_solid */
    const float *thickness;   /* mm below each; INFINITY: nothing is opposite */
    size_t count;
    const struct pell_profile *profile; /* of R, G and B */
    const struct pell_opposed *law;     /* how light goes through */
    const struct whole *whole;          /* what the method finds that asks the whole solid; NULL: it sees some faces */
    bool around;                        /* without `whole`: or all, along the surface */
    float spacing;                      /* mm between samples */
};
/* out[i] <- of sample i; solved 0 where the samples are too coarse for a channel's light. */
PELL_NODISCARD enum pell_result indirect_solid_solve(struct pell_context *ctx, struct pell_pool *pool, const struct indirect_solid *solid,
                                                     struct indirect_solid_light *out);

/* --- forward.c: light that is scattered forward --------------------------------------------------------------------------------------- */

struct indirect_forward {
    const struct pell_indirect *in;
    const struct pell_forward *law;
    const uint32_t *list;   /* samples of one solid */
    const float *thickness; /* mm, of all samples */
    size_t count;
};
/* Takes over `samples`, with what enters at those of the list. */
PELL_NODISCARD enum pell_result indirect_forward_send(struct pell_pool *pool, const struct indirect_forward *of,
                                                      struct pell_lit_place *samples, struct pell_indirect_beam *out);

/* The sample nearest to a point of a triangle, of those around; INDIRECT_NONE where there is none. */
uint32_t indirect_sample_at(const struct pell_indirect *in, uint32_t mesh, uint32_t triangle, float u, float v, bool back,
                            struct pell_vec3 at);

/* --- apart.c: solids of one object ---------------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_apart_make(struct pell_indirect *in, struct pell_pool *pool);

/* --- across.c: the samples on the other side ------------------------------------------------------------------------------------------ */

PELL_NODISCARD enum pell_result indirect_across_make(struct pell_indirect *in, struct pell_pool *pool);

/* --- links.c: what each sample sees -------------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_links_make(struct pell_indirect *in, struct pell_pool *pool);

/* --- tilt.c ----------------------------------------------------------------------------------------------------------------- */

/* Of a value, from the light in the depth at the samples around it. `aside`: [0, 1], the share of its growth, of squares, along the
 * surface. */
void indirect_tilt(const struct pell_indirect *in, const struct indirect_near *near, const struct pell_opposed *law,
                   const float (*light)[3], float tilt[3][3], float aside[3]);

#endif
