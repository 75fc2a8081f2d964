/* SPDX-License-Identifier: MIT
 *
 * connect.h - light of a place outside that reaches a point inside a solid through its smooth boundary: every place on the surface where
 * the ray refracts from one to the other (Walter et al. 2009, "Single Scattering in Refractive Media with Triangle Mesh Boundaries").
 *
 * The surface is closed and its triangles go counter-clockwise seen from outside; where it is not so, connections are missing, and none is
 * wrong. Alpha masks let rays through and are no holes in the boundary.
 */
#ifndef PELL_CONNECT_H
#define PELL_CONNECT_H

#include "transport/solids.h"

struct pell_connector;

/* `flat`: refract by the triangles' own normals, else by the vertices' normals interpolated. Arguments must outlive the connector. Some 260
 * bytes a triangle. */
PELL_NODISCARD enum pell_result pell_connector_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                      const struct pell_rays *rays, const struct pell_solids *solids, bool flat,
                                                      struct pell_connector **out);
void pell_connector_destroy(struct pell_connector **connector);

struct pell_connection {
    uint32_t mesh, triangle;
    float u, v;               /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    struct pell_vec3 at;      /* on the surface, mm */
    struct pell_vec3 normal;  /* that refracts: unit, outward */
    struct pell_vec3 inside;  /* unit, from x to `at` */
    struct pell_vec3 outside; /* unit, from `at` to the place */
    double inside_mm;
    double outside_mm; /* INFINITY: a direction */
    double transmit;   /* 1 - F */
    /* What a bundle of rays becomes. A place: sr at the place per mm^2 at x perpendicular to `inside`. A direction: mm^2 perpendicular to
     * `outside` per mm^2 at x perpendicular to `inside`. So a point's intensity, or a direction's irradiance, times spread times transmit
     * is the beam's irradiance at x before extinction. Finite; beyond bounds where x nears a caustic. */
    double spread;
};

/* Candidates that a query weighs before it asks what is in the way; more are left out, farthest first. Where light is focused, flat
 * triangles make as many paths as it is concentrated there: some places of a coarse ball have over 16, few over 64. */
#define PELL_CONNECTIONS 256

/* What is to be connected through the surface of a solid. */
struct pell_connection_query {
    int solid;
    double eta;             /* its index relative to outside */
    struct pell_vec3 x;     /* inside */
    struct pell_vec3 place; /* outside */
    bool away;              /* `place` is the unit direction towards it */
    double reach;           /* mm: of inside_mm */
};

/* All connections, at most `max` of them, nearest first. Neither part is in the way of anything: the outside part of no surface at all, the
 * inside part of no surface. Returns how many. `rays` (may be NULL): + rays traced. None for a solid that is not there, an index outside
 * [PELL_ETA_MIN, PELL_ETA_MAX], or what is no number. Thread-safe. */
int pell_connect(const struct pell_connector *connector, const struct pell_connection_query *query, struct pell_connection *out, int max,
                 int64_t *rays);

/* mm of rounding in where rays meet a solid's surface: nothing nearer to it is in the way. 0 for a solid that is not there. */
double pell_connector_rounding(const struct pell_connector *connector, int solid);

/* Distance, mm, from x to the nearest triangle of a solid, at most `most`. `most` for a solid that is not there. Thread-safe. */
double pell_connector_distance(const struct pell_connector *connector, int solid, struct pell_vec3 x, double most);

#endif
