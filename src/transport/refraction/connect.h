/* SPDX-License-Identifier: MIT
 *
 * connect.h - refractive connections between a point outside and a point inside of a solid through its smooth boundary: all surface points
 * where a path refracts from one to the other (Walter et al. 2009, "Single Scattering in Refractive Media with Triangle Mesh Boundaries").
 *
 * The surface must be closed with its triangles counter-clockwise seen from outside; elsewhere connections are missing, but none is wrong.
 * Rays pass through alpha cutouts, which are no holes in the boundary.
 */
#ifndef PELL_CONNECT_H
#define PELL_CONNECT_H

#include "transport/solids.h"

struct pell_connector;

/* `flat`: refract by geometric normals, else by interpolated vertex normals. Arguments must outlive the connector. About 260 bytes per
 * triangle. */
PELL_NODISCARD enum pell_result pell_connector_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                      const struct pell_rays *rays, const struct pell_solids *solids, bool flat,
                                                      struct pell_connector **out);
void pell_connector_destroy(struct pell_connector **connector);

struct pell_connection {
    uint32_t mesh, triangle;
    float u, v;               /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    struct pell_vec3 at;      /* on the surface, mm */
    struct pell_vec3 normal;  /* refracting normal: unit, outward */
    struct pell_vec3 inside;  /* unit, from x to `at` */
    struct pell_vec3 outside; /* unit, from `at` to the light */
    double inside_mm;
    double outside_mm; /* INFINITY: distant */
    double transmit;   /* 1 - F */
    /* Spread of a beam. Position: sr at the light per mm^2 at x perpendicular to `inside`. Direction: mm^2 perpendicular to `outside` per
     * mm^2 at x perpendicular to `inside`. A point light's intensity, or a directional light's irradiance, times spread times transmit is
     * therefore the beam's irradiance at x before extinction. Finite, but unbounded where x approaches a caustic. */
    double spread;
};

/* Maximum number of candidates of a query before visibility tests; further ones are dropped, farthest first. Where light is focused, flat
 * triangles produce as many paths as the concentration factor: some points in a coarse ball have over 16, few over 64. */
#define PELL_CONNECTIONS 256

/* A query for connections through the surface of a solid. */
struct pell_connection_query {
    int solid;
    double eta;             /* its index relative to outside */
    struct pell_vec3 x;     /* inside */
    struct pell_vec3 light; /* outside: position of the light */
    bool distant;           /* `light` is the unit direction towards it */
    double reach;           /* mm: maximum of inside_mm */
};

/* Finds all connections, at most `max`, nearest first, whose two segments are unoccluded: the one outside by any surface, the one inside by
 * the solid's surface and others. Returns their number. `rays` (may be NULL): incremented by the rays traced. None for an invalid solid, an
 * index outside of [PELL_ETA_MIN, PELL_ETA_MAX], or NaN. Thread-safe. */
int pell_connect(const struct pell_connector *connector, const struct pell_connection_query *query, struct pell_connection *out, int max,
                 int64_t *rays);

/* Rounding error of ray hits on a solid's surface, mm: closer hits are ignored. 0 for an invalid solid. */
double pell_connector_rounding(const struct pell_connector *connector, int solid);

/* Distance, mm, from x to the nearest triangle of a solid, at most `most`. `most` for an invalid solid. Thread-safe. */
double pell_connector_distance(const struct pell_connector *connector, int solid, struct pell_vec3 x, double most);

#endif
