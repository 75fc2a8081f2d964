/* SPDX-License-Identifier: MIT
 *
 * internal.h - declarations shared by the files of this stage. Private to the folder.
 */
#ifndef RENDER_INDIRECT_INTERNAL_H
#define RENDER_INDIRECT_INTERNAL_H

#include "render/indirect/blend_kernel.h"
#include "render/indirect/profile_sum.h"
#include "render/indirect/stage.h"

#include "math/sampling.h"
#include "math/vec.h"
#include "scene/material_maps.h"
#include "shared/subdivision.h"
#include "transport/light_tree.h"

#define INDIRECT_RAYS 64 /* per sample */
#define INDIRECT_NONE UINT32_MAX
#define INDIRECT_RAY_OFFSET 1.0e-4f /* of the largest coordinate: offset of ray origins from the surface */

/* A surface point that receives light and sends it on to others. */
struct indirect_sample {
    uint32_t mesh, triangle;
    float u, v;                        /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    struct pell_vec3 position, normal; /* mm; geometric normal, on the sample's side */
    struct pell_vec3 smooth;           /* interpolated vertex normals, on the same side */
    float spacing;                     /* distance between samples, mm */
    uint32_t medium;                   /* its material, or an earlier one with the same medium (pell_scene_same_media) */
    bool back;                         /* on the side from which the triangle's corners run clockwise */
};

/* A part of a triangle that was subdivided recursively (shared/subdivision.h). */
struct indirect_cell {
    uint32_t child;   /* first child and pattern; 0: no children */
    uint32_t knot[3]; /* knots at its corners */
};

/* A knot that is not a vertex of a mesh. */
struct indirect_knot {
    uint32_t mesh, triangle;
    float u, v;
};

struct indirect_mesh {
    uint32_t first_knot; /* knot of vertex 0 */
    uint32_t first_back; /* value of vertex 0 on the back side, if the material is opaque */
    uint32_t first_root; /* roots[first_root + triangle] is the cell of the triangle, or INDIRECT_NONE. INDIRECT_NONE: no triangle is
                          * subdivided */
};

/* A light path to a sample: the factor by which its light leaves there and enters here, in steps of 1/INDIRECT_STEPS. */
#define INDIRECT_STEPS 180.0f
#define INDIRECT_SAMPLES_MOST (1u << 24)
struct indirect_link {
    uint32_t sample : 24, factor : 8; /* factor 0: no sample */
};

/* A light path to a sample by a reflection where a ray ends, with its weight. */
#define INDIRECT_SPECULAR_LINKS 16
struct indirect_specular_link {
    uint32_t sample;
    float factor;
};

/* Samples near a knot, and their weights, which sum to 1. */
#define INDIRECT_NEAR 10
struct indirect_near {
    uint32_t sample[INDIRECT_NEAR];
    float weight[INDIRECT_NEAR]; /* 0 after the last */
};

/* Result of diffusion.c at a point, for R, G and B. */
struct indirect_solid_light {
    float solved[3];   /* [0, 1]: confidence of the values below */
    float entered[3];  /* W/m^2: entering light that `light` accounts for; 0 for methods that integrate over the whole solid, */
    float gain[3];     /* which have a factor of their result instead; */
    float light[3];    /* W/m^2: radiant exitance that is added; */
    float exitance[3]; /* total radiant exitance, */
    float deep[3];     /* and fraction of it that comes from the depth */
};

/* Values that points interpolate from knots; two cache lines. */
#define INDIRECT_INSIDE 32
union indirect_inside {
    struct pell_indirect_inside value;
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

    uint32_t *same; /* per material: pell_scene_same_media */
    struct indirect_sample *samples;
    size_t num_samples;
    struct indirect_link *links;                   /* [sample][INDIRECT_RAYS] */
    struct indirect_specular_link *specular_links; /* [sample][INDIRECT_SPECULAR_LINKS]; NULL: nothing is translucent */

    struct indirect_near *near; /* of each value */

    uint32_t *part; /* with p.solids_only, per sample: the separate solid of its object (parts.c), or INDIRECT_NONE; NULL: each object is
                     * one solid */

    /* Depends on the lights. */
    float (*direct)[3], (*albedo)[3]; /* per sample: light that enters; rho times the base colour */
    uint32_t *opposite;      /* per sample: the sample on the other side of a sheet, or of the solid, or INDIRECT_NONE. NULL: there are no
                            * sheets or solids */
    float (*transmitted)[3]; /* per sample: fraction of the light that arrives at the opposite sample and leaves here. NULL like opposite */
    float (*passed)[3];      /* the same for solids, without the albedo here */
    float (*gathered)[3], (*leaving)[3];
    float (*reflected)[3], (*previous)[3]; /* light that enters after one reflection; light that left one bounce ago. NULL like
                                            * specular_links */
    float (*area)[3];                      /* mm^2, per sample: area over which photons that land around it are distributed */
    float (*value)[4];                     /* per value, with a fourth component 0; NULL with p.solids_only */
    float (*behind)[4];                    /* per value: light from the other side of a solid that leaves here, without the albedo, and 0.
                                          * NULL like opposite */
    union indirect_inside *inside;         /* per value; NULL without p.solids_only */
    struct pell_indirect_beam *beam;       /* per value; NULL: no material scatters forward */
    struct pell_indirect_forward *forward; /* per scene material; NULL like beam */
};

/* A point of a triangle, and the interpolated normal of its vertices, not unit. */
struct indirect_point {
    struct pell_vec3 position, normal;
};
static inline struct indirect_point indirect_point_at(const struct pell_mesh *mesh, uint32_t triangle, float u, float v)
{
    const uint32_t *index = mesh->index + 3 * (size_t) triangle;
    const float w[3] = { 1.0f - u - v, u, v };
    struct indirect_point p = { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };

    for (int k = 0; k < 3; k++) {
        p.position = vec3_mad(p.position, w[k], vec3_load(mesh->position + 3 * (size_t) index[k]));
        p.normal = vec3_mad(p.normal, w[k], vec3_load(mesh->normal + 3 * (size_t) index[k]));
    }
    return p;
}

/* Whether a mesh is visible to rays. */
static inline bool indirect_shown(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    bool cut;
    return mesh->num_triangles > 0 && pell_rays_show(scene, mesh, &cut);
}

/* Offset of ray origins at `p`, mm. */
static inline float indirect_ray_offset(struct pell_vec3 p, float spacing)
{
    return INDIRECT_RAY_OFFSET * fmaxf(vec3_max_abs(p), spacing);
}

/* --- spacing.c: distance between samples ---------------------------------------------------------------------------------------------- */

#define INDIRECT_BOXES 64

/* Bounding boxes of objects, and the distance between samples on each. */
struct indirect_spacing {
    struct indirect_box {
        struct pell_vec3 low, high;
        float spacing;
    } box[INDIRECT_BOXES];
    int count;
    float scale;
};

void indirect_spacing_make(const struct pell_scene *scene, struct indirect_spacing *out);
/* mm, > 0. The spacing of the nearest object, growing with the distance from it. */
float indirect_spacing_at(const struct indirect_spacing *s, struct pell_vec3 p);

/* --- cells.c: subdivision of large triangles into cells; samples and knots ------------------------------------------------------------ */

/* Creates meshes, roots, cells, extra and samples. The caller frees them with the rest. */
PELL_NODISCARD enum pell_result indirect_cells_make(struct pell_indirect *in, struct indirect_spacing *spacing);
/* Finds the knots around a point of a triangle, and the point's barycentric coordinates between them. */
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
        const uint32_t word = in->cells[cell].child;
        const struct pell_child_cell q = pell_child_cell_at(word >> PELL_CELL_PATTERN_SHIFT, w[0], w[1], w[2]);
        w[0] = q.w0;
        w[1] = q.w1;
        w[2] = q.w2;
        cell = (word & PELL_CELL_CHILD_MASK) + (uint32_t) q.child;
    }
    for (int i = 0; i < 3; i++) {
        knot[i] = in->cells[cell].knot[i];
        weight[i] = w[i];
    }
}

/* Index of a knot's value on one side of a mesh. */
static inline size_t indirect_value_of(const struct pell_indirect *in, uint32_t mesh, uint32_t knot, bool back)
{
    if (!back)
        return knot;
    return knot < in->num_mesh_knots ? in->meshes[mesh].first_back + (size_t) (knot - in->meshes[mesh].first_knot)
                                     : in->num_knots + (knot - in->num_mesh_knots);
}

/* --- buried.c: removal of samples inside solids --------------------------------------------------------------------------------------- */

/* Traces rays from the translucent ones of the 16 samples from `first` on, along or against their normals. valid: 0 for other samples. */
void indirect_along_normals16(const struct pell_indirect *in, size_t first, bool inward, int valid[16], struct pell_ray_hit16 *r);
/* Removes samples that are inside a solid. */
PELL_NODISCARD enum pell_result indirect_drop_buried(struct pell_indirect *in, struct pell_pool *pool);

/* --- neighbours.c: the samples around each knot --------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_near_make(struct pell_indirect *in, struct pell_pool *pool,
                                                   const struct indirect_spacing *spacing);

/* --- specular.c: light that is reflected without entering ----------------------------------------------------------------------------- */

/* Transmittance T in a direction, and its mean over a diffuse hemisphere. */
float indirect_transmittance(const struct pell_indirect *in, uint32_t material, float mu, float *mean);
/* Reflects light along w at a surface of normal n, both unit. Returns the reflected fraction: 0 at opaque surfaces, whose reflection is
 * diffuse, and from inside. */
float indirect_reflect(const struct pell_indirect *in, uint32_t material, struct pell_vec3 n, struct pell_vec3 w, uint32_t hash,
                       struct pell_vec3 *out);
/* Allocates the buffers if a material is translucent. indirect_specular_light computes `reflected` from the scene's lights. */
PELL_NODISCARD enum pell_result indirect_specular_make(struct pell_indirect *in);
PELL_NODISCARD enum pell_result indirect_specular_light(struct pell_indirect *in, struct pell_pool *pool);

/* --- diffusion.c: diffusion in the actual solid --------------------------------------------------------------------------------------- */

/* Samples of one solid. */
struct indirect_solid {
    const struct pell_surface_sample *samples; /* power without the scale for curvature, with albedo^m */
    const float (*source)[3]; /* part of their power that goes into the depth: unscaled, and without the surplus that oblique incidence
                               * returns; */
    const float (*single)[3]; /* and the part that accounts for single scattering; NULL: none */
    const float *slope;       /* that surplus for R, G and B, see struct pell_indirect_solid */
    const float *thickness;   /* mm, below each sample; INFINITY: the solid has no opposite side there */
    size_t count;
    const struct pell_profile *profile;    /* for R, G and B */
    const struct pell_opposed *opposed;    /* model of transmission between faces */
    const struct profile_sum *profile_sum; /* result of methods that integrate over the whole solid; NULL: the method does not */
    float spacing;                         /* distance between samples, mm */
};
/* Writes out[i] for sample i; `solved` is 0 where the samples are too coarse for a channel's light. */
PELL_NODISCARD enum pell_result indirect_diffusion_solve(struct pell_context *ctx, struct pell_pool *pool,
                                                         const struct indirect_solid *solid, struct indirect_solid_light *out);

/* --- forward.c: forward-scattered light ----------------------------------------------------------------------------------------------- */

struct indirect_forward {
    const struct pell_indirect *in;
    const struct pell_forward *model;
    const uint32_t *list;   /* sample indices of one solid */
    const float *thickness; /* mm, for all samples */
    size_t count;
};
/* Takes ownership of `samples`, which hold the light that enters at those of the list. */
PELL_NODISCARD enum pell_result indirect_forward_send(struct pell_pool *pool, const struct indirect_forward *of,
                                                      struct pell_surface_sample *samples, struct pell_indirect_beam *out);

/* Returns the sample nearest to a point of a triangle, among those around it, or INDIRECT_NONE. */
uint32_t indirect_sample_at(const struct pell_indirect *in, uint32_t mesh, uint32_t triangle, float u, float v, bool back,
                            struct pell_vec3 at);

/* --- parts.c: separate solids of one object ------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_parts_make(struct pell_indirect *in, struct pell_pool *pool);
/* Whether a solid contains another object, as flesh contains bones: diffusion is not solved around it, and the methods' own paths end
 * there. */
bool indirect_contains_another(const struct pell_indirect *in, const struct indirect_sample *of);

/* --- round_parts.c: thin round parts ------------------------------------------------------------------------------------------------- */

/* The shape at a sample, see struct pell_surface_light. */
struct indirect_round {
    float gain[3], uniform[3];
    float weight[3]; /* [0, 1]: `small`, where samples are dense enough */
};
struct indirect_round_parts {
    const struct pell_surface_sample *sample; /* of the stage, */
    const struct indirect_round *round;
    const uint32_t *list; /* and those of an object and medium */
    size_t count;
    float spacing;       /* mm between samples */
    float (*surplus)[3]; /* output, where a sample is in such a part: factor of the method's result, less 1 */
};
PELL_NODISCARD enum pell_result indirect_round_parts_scale(struct pell_context *ctx, struct pell_pool *pool,
                                                           const struct pell_indirect_solid *as, const struct indirect_round_parts *of);

/* --- opposite.c: samples on the other side -------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_opposite_make(struct pell_indirect *in, struct pell_pool *pool);

/* --- links.c: visibility between samples ---------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result indirect_links_make(struct pell_indirect *in, struct pell_pool *pool);

/* --- tilt.c: directional distribution of light that leaves a solid -------------------------------------------------------------------- */

/* Finds the tilt at a value from the radiant exitance at the samples around it, and the fraction of it that comes from the depth.
 * `along_surface`: [0, 1], fraction of the squared gradient that is along the surface. */
void indirect_tilt(const struct pell_indirect *in, const struct indirect_near *near, const struct pell_opposed *opposed,
                   const float (*light)[3], const float deep[3], float tilt[3][3], float along_surface[3]);

#endif
