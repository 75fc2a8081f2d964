/* SPDX-License-Identifier: MIT
 *
 * internal.h - declarations shared by the parts of the atlas; private to this folder. atlas.c calls the other files in order; rasterize.c
 * and borders.c call walk.c; borders.c uses metrics of rasterize.c and the connectivity of charts.c.
 */
#ifndef METHODS_TEXTURE_SPACE_ATLAS_INTERNAL_H
#define METHODS_TEXTURE_SPACE_ATLAS_INTERNAL_H

#include "methods/texture_space/texture_space.h"

#include "scene/mesh/topology.h"

#define NONE UINT32_MAX
#define COVERED_PLANAR 0.6 /* upper bound of the fraction of the map that planar charts cover */
#define BAND 16            /* rows per task */
#define TAPS_SIGMAS 3      /* approximate width of a border in standard deviations */
#define MAX_TILT 0.25f     /* upper bound of the relative change of a tap's weight over one standard deviation */

struct ts_hinge;

/* An atlas under construction. */
struct ts_atlas_build {
    struct pell_context *ctx;
    const struct ts_atlas_params *p;
    struct ts_atlas *a;
    struct pell_topology topology;
    uint32_t *meshes;
    size_t num_meshes;
    double *area;           /* per triangle, mm^2 */
    struct ts_hinge *hinge; /* per half-edge; for walks */
    double total_area;
    bool *buried;                       /* per texel: removed from its chart; NULL: none */
    struct pell_vec3 *texel_position;   /* position of each texel, mm */
    struct ts_bilinear *border_source;  /* where each border texel reads */
    struct ts_orientation *orientation; /* and its orientation there */
    int64_t claimed, twice;             /* texels covered by at least one, and by several triangles */
};

static inline void corner_points(const struct ts_atlas *a, uint32_t t, struct pell_vec3 p[3])
{
    pell_triangle_corners(&a->scene->meshes[a->triangles[t].mesh], a->triangles[t].triangle, p);
}

/* Limits a tilt to [-most, most]; NaN becomes 0. */
static inline float clamp_tilt(float tilt, float most)
{
    return tilt > -most ? tilt < most ? tilt : most : tilt < 0.0f ? -most : 0.0f;
}

/* update.c: hash of all vertex positions. */
uint64_t ts_atlas_positions(const struct ts_atlas *a);
/* update.c: the same compensation as curvature.c, from the change of lengths across lines, which needs no positions. */
void ts_atlas_tilt_by_lengths(struct ts_atlas *a, struct pell_pool *pool);

/* mm^2; 0 if not finite. */
static inline double area_of(const struct ts_atlas *a, uint32_t t)
{
    struct pell_vec3 p[3];
    double e[2][3], n[3], area;

    corner_points(a, t, p);
    for (int k = 0; k < 2; k++) {
        e[k][0] = (double) p[k + 1].x - (double) p[0].x;
        e[k][1] = (double) p[k + 1].y - (double) p[0].y;
        e[k][2] = (double) p[k + 1].z - (double) p[0].z;
    }
    for (int k = 0; k < 3; k++)
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
    area = 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    return area > 0.0 && area < INFINITY ? area : 0.0;
}

static inline double flat_area(const float c[6])
{
    return 0.5 * ((double) (c[2] - c[0]) * (double) (c[5] - c[1]) - (double) (c[4] - c[0]) * (double) (c[3] - c[1]));
}

/* Whether the twin has the opposite direction, as between two triangles of the same orientation. */
static inline bool opposed(const struct ts_atlas_build *b, uint32_t half, uint32_t twin)
{
    return pell_half_start(&b->topology, half) == pell_half_end(&b->topology, twin);
}

/* A planar chart. */
struct ts_flat_chart {
    struct pell_vec3 axis;
    double area;            /* mm^2, while it grows */
    uint32_t count;         /* triangles */
    double low[2], high[2]; /* mm */
    double x, y;            /* texels */
    int32_t number;
};

/* Barycentrics of a point in a triangle's layout: coefficients of 1, x and y. */
struct ts_flat {
    double u[3], v[3];
};

static inline bool flatten(const float c[6], struct ts_flat *f)
{
    const double ux = (double) c[2] - (double) c[0], uy = (double) c[3] - (double) c[1];
    const double vx = (double) c[4] - (double) c[0], vy = (double) c[5] - (double) c[1], det = ux * vy - uy * vx;

    if (!(fabs(det) > 1e-12))
        return false;
    f->u[1] = vy / det;
    f->u[2] = -vx / det;
    f->v[1] = -uy / det;
    f->v[2] = ux / det;
    f->u[0] = -(f->u[1] * (double) c[0] + f->u[2] * (double) c[1]);
    f->v[0] = -(f->v[1] * (double) c[0] + f->v[2] * (double) c[1]);
    return true;
}

/* Clips [x0, x1] to the texels of a row that a triangle may cover, plus one on either side, so that slivers cost their covered texels and
 * not their bounding boxes. */
static inline void row_of(const struct ts_flat *f, double y, int *x0, int *x1)
{
    const double at[3][2] = { { f->u[0] + f->u[2] * y, f->u[1] },
                              { f->v[0] + f->v[2] * y, f->v[1] },
                              { 1.0 - f->u[0] - f->v[0] - (f->u[2] + f->v[2]) * y, -f->u[1] - f->v[1] } };
    double low = *x0, high = *x1;

    for (int k = 0; k < 3; k++) {
        if (fabs(at[k][1]) < 1e-12)
            continue;
        if (at[k][1] > 0.0)
            low = fmax(low, floor(-at[k][0] / at[k][1] - 1.5));
        else
            high = fmin(high, ceil(-at[k][0] / at[k][1] + 0.5));
    }
    *x0 = low < *x1 + 1.0 ? (int) low : *x1 + 1;
    *x1 = high > -1.0 ? (int) high : -1;
}

/* Metric of a triangle in the layout: mm per texel along x, and perpendicular to it, where a step along y also moves `skew` texels along
 * x. */
struct ts_metric {
    float length[2], skew;
};

static inline struct pell_vec3 position_of(const struct ts_atlas *a, uint32_t triangle, float u, float v)
{
    struct pell_vec3 at, normal;
    float largest;

    ts_point_of(a, triangle, u, v, &at, &normal, &largest);
    return at;
}

/* --- walk.c ---------------------------------------------------------------------------------------------------------------------- */

/* A triangle in the frame of one of its edges: the edge's length, and the third corner, along the edge and perpendicular to it, from the
 * edge's first corner, mm. */
struct ts_hinge {
    float length, x, y;
};

/* Measures all triangles. Call before walks. */
PELL_NODISCARD enum pell_result ts_atlas_unfold(struct ts_atlas_build *b);
/* Walks straight over the surface from a point along `dir` (mm, in the triangle's plane), turning around edges; `dir` becomes the direction
 * at the end. False: the surface ends. */
bool ts_atlas_walk(const struct ts_atlas_build *b, uint32_t *triangle, double bary[2], struct pell_vec3 *dir);

/* --- charts.c: segmentation into charts, and corner positions -------------------------------------------------------------------- */

/* Whether all meshes have this set of texture coordinates. */
bool ts_atlas_has_set(const struct ts_atlas_build *b, int set);
/* The layout given by one set of texture coordinates, scaled to fit. Returns NULL, or the layout's defect. */
const char *ts_atlas_lay_out_file(struct ts_atlas_build *b, int set);
/* Separates charts that overlap in the mesh's texture coordinates, as mirrored halves, repeated tiles and objects with a common texture do,
 * and gives them equal texel density. They are numbered. */
PELL_NODISCARD enum pell_result ts_atlas_separate(struct ts_atlas_build *b);
/* Grows planar charts over the surface, each projected along its axis. `order` has room for all triangles. */
PELL_NODISCARD enum pell_result ts_atlas_lay_out_planar(struct ts_atlas_build *b, uint32_t *order);
/* Numbers charts by connectivity in the layout. `todo` has room for all triangles. */
void ts_atlas_number_charts(struct ts_atlas_build *b, uint32_t *todo);
/* Whether two triangles that share an edge are also adjacent in the layout. */
bool ts_atlas_joined(const struct ts_atlas_build *b, uint32_t half);

/* --- pack.c ---------------------------------------------------------------------------------------------------------------------- */

/* Sets the atlas's size and each chart's position in it; `scale`: texels per mm. Afterwards charts are ordered by number. Fails with
 * PELL_ERR_UNSUPPORTED if they fit in no map. */
PELL_NODISCARD enum pell_result ts_atlas_pack(struct ts_atlas_build *b, struct ts_flat_chart *charts, size_t count, double *scale);

/* --- rasterize.c: planes of texels ----------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result ts_atlas_make_planes(struct ts_atlas_build *b);
/* Texels whose centres are in a triangle; of several triangles the first one owns them. */
void ts_atlas_rasterize(struct ts_atlas_build *b);
/* A triangle that covers no texel centre gets the texel that contains it. */
void ts_atlas_rescue(struct ts_atlas_build *b);
/* The metric of a triangle, by the derivatives of its u and v along x and y; and in its own layout. */
struct ts_metric ts_atlas_metric_along(const struct ts_atlas *a, uint32_t t, const double u[2], const double v[2]);
struct ts_metric ts_atlas_metric_of(const struct ts_atlas *a, uint32_t t, const struct ts_flat *f);
void ts_atlas_set_metric(struct ts_atlas *a, ptrdiff_t at, const struct ts_metric *m);

/* buried.c: removes texels inside another part of the solid from their charts. */
PELL_NODISCARD enum pell_result ts_atlas_drop_buried(struct ts_atlas_build *b);

/* --- borders.c, in call order ---------------------------------------------------------------------------------------------------- */

/* Finds, for each texel next to a chart, the nearest edge where the chart ends but the surface continues, and the surface point beyond
 * it. */
PELL_NODISCARD enum pell_result ts_atlas_find_borders(struct ts_atlas_build *b);
PELL_NODISCARD enum pell_result ts_atlas_fix_seams(struct ts_atlas_build *b);
/* Distance of each texel from the inside of a chart, along the longer axis, below TS_FAR: a pass from either end of the map. */
void ts_atlas_measure_far(const struct ts_atlas *a, uint8_t *far);
PELL_NODISCARD enum pell_result ts_atlas_sort_borders(struct ts_atlas_build *b, const uint8_t *far);
PELL_NODISCARD enum pell_result ts_atlas_find_runs(struct ts_atlas_build *b, const uint8_t *far);

/* Lengths and skew of the block that begins at a texel. */
void ts_atlas_measure_cell(const struct ts_atlas *a, ptrdiff_t first, struct ts_cell *cell);

/* --- curvature.c ----------------------------------------------------------------------------------------------------------------- */

/* Tilts the weights of the blurs' taps by the curvature of lines of texels. Needs positions, metrics and cells. */
void ts_atlas_tilt(struct ts_atlas_build *b);

#endif
