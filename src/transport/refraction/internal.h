/* SPDX-License-Identifier: MIT
 *
 * internal.h - what the files of connect.h share: connect_tree.c builds the hierarchy and measures distances in it, connect_solve.c
 * finds where light refracts in one triangle, connect.c asks both and what is in the way.
 */
#ifndef PELL_CONNECT_PARTS_H
#define PELL_CONNECT_PARTS_H

#include "math/scalar.h"
#include "transport/refraction/connect.h"
#include "transport/refraction/bvh_kernel.h"

#define FAR 1e15 /* mm: no place is beyond */

struct facet {
    float p[3][3], n[3][3];
    uint32_t mesh, triangle;
    bool planar; /* the normals are the triangle's own */
};

struct tree {
    struct facet *facets;
    struct pell_connect_node *nodes;
    size_t num_facets, num_nodes;
    double rounding; /* mm */
};

struct pell_connector {
    struct pell_context *ctx;
    const struct pell_rays *rays;
    const struct pell_bodies *bodies;
    const struct pell_scene *scene;
    struct tree *trees; /* one a body */
    const struct pell_connect_kernels *kernels;
    bool flat;
};

/* --- Vectors of double -------------------------------------------------------------------------------------------------------- */

struct vec {
    double x, y, z;
};

static inline struct vec load(const float *p)
{
    return (struct vec){ (double) p[0], (double) p[1], (double) p[2] };
}

static inline struct vec widen(struct pell_vec3 a)
{
    return (struct vec){ (double) a.x, (double) a.y, (double) a.z };
}

static inline struct pell_vec3 narrow(struct vec a)
{
    return vec3((float) a.x, (float) a.y, (float) a.z);
}

static inline struct vec sub(struct vec a, struct vec b)
{
    return (struct vec){ a.x - b.x, a.y - b.y, a.z - b.z };
}

static inline struct vec mad(struct vec a, double s, struct vec b)
{
    return (struct vec){ a.x + s * b.x, a.y + s * b.y, a.z + s * b.z };
}

static inline struct vec scale(struct vec a, double s)
{
    return (struct vec){ a.x * s, a.y * s, a.z * s };
}

static inline double dot(struct vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vec cross(struct vec a, struct vec b)
{
    return (struct vec){ a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

/* A number, and one that Embree takes. */
static inline bool is_place(struct vec a)
{
    return fabs(a.x) < FAR && fabs(a.y) < FAR && fabs(a.z) < FAR;
}

/* --- connect_tree.c ----------------------------------------------------------------------------------------------------------- */

void pell_connect_fill_facet(const struct pell_mesh *m, uint32_t mesh, uint32_t triangle, bool flat, struct facet *f);
PELL_NODISCARD enum pell_result pell_connect_build_tree(struct pell_connector *c, size_t body);

/* --- connect_solve.c: paths through one triangle ------------------------------------------------------------------------------ */

/* A path that refracts; whether anything is in its way is not asked yet. */
struct path {
    const struct facet *facet;
    double u, v;
    struct vec at, normal, inside, outside; /* as in a connection */
    double inside_mm, outside_mm, spread, cos_o;
    double facing_in, facing_out; /* cosines of both parts with the triangle's own normal */
    double size;                  /* of the triangle */
};

struct query {
    double eta, grazing; /* grazing: the largest |k| */
    double reach;
    struct vec x, place; /* or direction */
    bool away;           /* a direction */
    struct path paths[PELL_CONNECTIONS];
    int count;
};

/* Adds the paths that refract in the triangle, by its own normal or by the interpolated ones. */
void pell_connect_solve(struct query *q, const struct facet *f);

#endif
