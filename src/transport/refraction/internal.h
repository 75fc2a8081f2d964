/* SPDX-License-Identifier: MIT
 *
 * internal.h - shared by the files of connect.h: bvh.c builds the hierarchy and measures distances in it, solve.c finds refracting points
 * in one triangle, connect.c calls both and tests visibility.
 */
#ifndef PELL_REFRACTION_INTERNAL_H
#define PELL_REFRACTION_INTERNAL_H

#include "math/scalar.h"
#include "transport/refraction/bvh_kernel.h"
#include "transport/refraction/connect.h"

#define FAR 1e15 /* mm: upper bound of coordinates */

/* A piece of a triangle by the barycentric coordinates of its corners: multiples of 2^-depth. */
struct piece {
    float uv[3][2];
    int depth; /* number of bisections */
};

#define PELL_CONNECT_PIECES 64 /* denominator of a facet's barycentric coordinates: at most 6 bisections */

/* A triangle, or a piece of a sliver. */
struct facet {
    float p[3][3], n[3][3]; /* of the triangle */
    uint32_t mesh, triangle;
    uint8_t corner[3][2]; /* of the piece, barycentric */
    bool planar;          /* the vertex normals equal the geometric normal */
};

static inline struct piece facet_piece(const struct facet *f)
{
    struct piece p = { .depth = 0 };

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 2; k++)
            p.uv[i][k] = (float) f->corner[i][k] * (1.0f / PELL_CONNECT_PIECES);
    return p;
}

/* Longest side over height: more elongated pieces of curved triangles are bisected. */
#define PELL_CONNECT_SLIVER 3.0

static inline struct pell_dvec3 facet_corner(const float corner[3][3], const float uv[2])
{
    const struct pell_dvec3 a = dvec3_load(corner[0]), b = dvec3_load(corner[1]), c = dvec3_load(corner[2]);

    return dvec3_mad(dvec3_mad(a, (double) uv[0], dvec3_sub(b, a)), (double) uv[1], dvec3_sub(c, a));
}

struct tree {
    struct facet *facets;
    struct pell_connect_node *nodes;
    size_t num_facets, num_nodes;
    double rounding; /* mm */
};

struct pell_connector {
    struct pell_context *ctx;
    const struct pell_rays *rays;
    const struct pell_solids *solids;
    const struct pell_scene *scene;
    struct tree *trees; /* one per solid */
    const struct pell_connect_kernels *kernels;
    bool flat;
};

/* Whether a number is finite and in the range that Embree accepts. */
static inline bool is_point(struct pell_dvec3 a)
{
    return fabs(a.x) < FAR && fabs(a.y) < FAR && fabs(a.z) < FAR;
}

/* --- bvh.c ----------------------------------------------------------------------------------------------------------- */

void pell_connect_fill_facet(const struct pell_mesh *m, uint32_t mesh, uint32_t triangle, bool flat, struct facet *f);
PELL_NODISCARD enum pell_result pell_connect_build_tree(struct pell_connector *c, size_t solid);

/* --- solve.c: paths through one triangle ------------------------------------------------------------------------------ */

/* A refracted path before its visibility test. */
struct path {
    const struct facet *facet;
    double u, v;
    struct pell_dvec3 at, normal, inside, outside; /* as in a connection */
    double inside_mm, outside_mm, spread, cos_o;
    double facing_in, facing_out; /* cosines of both segments with the geometric normal */
    double size;                  /* of the triangle */
};

struct query {
    double eta, grazing; /* grazing: the largest |k| */
    double reach;
    struct pell_dvec3 x, light; /* or direction */
    bool distant;               /* `light` is a direction */
    struct path paths[PELL_CONNECTIONS];
    int count;
};

/* Adds the paths that refract in the triangle, by its geometric normal or the interpolated ones. */
void pell_connect_solve(struct query *q, const struct facet *f);

#endif
