/* SPDX-License-Identifier: MIT
 *
 * collocation.h - collocation points on the surface of a solid, chosen among its samples so that each represents about the same area, and
 * clusters of these points.
 */
#ifndef INDIRECT_COLLOCATION_H
#define INDIRECT_COLLOCATION_H

#include "base/pool.h"
#include "math/vec.h"
#include "transport/light_tree.h"

#define COLLOCATION_MAX 8192
#define COLLOCATION_NONE UINT32_MAX

struct collocation_point {
    struct pell_vec3 position, normal;
    float area;       /* mm^2, total of its samples */
    float curvature;  /* 1/mm, area-weighted mean of its samples */
    float distance2;  /* scratch: squared distance, with a penalty for the normal, of the sample nearest to the centroid */
    uint32_t nearest; /* index of that sample */
    int32_t cell[3];  /* cell of the hash grid */
    uint32_t next;    /* next point in the same bucket, or COLLOCATION_NONE */
    uint32_t cluster;
};

/* Adjacent points with similar normals, which are treated as one from far away. */
struct cluster {
    struct pell_vec3 position, normal; /* area-weighted means */
    float area, radius, curvature;     /* radius: of a sphere around all points, mm; curvature: area-weighted mean */
    uint32_t first, end;               /* range of points */
};

struct collocation_points {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct pell_surface_sample *sample;
    size_t num_samples;
    uint32_t *point_of; /* point that each sample belongs to, or COLLOCATION_NONE */
    float step;         /* approximate distance between points, mm */
    struct collocation_point *point;
    struct cluster *cluster;
    uint32_t count, num_clusters;
    struct collocation_point *sorted;
    uint32_t *bucket;
};

/* `samples` are borrowed. */
PELL_NODISCARD enum pell_result indirect_collocation_create(struct pell_context *ctx, struct pell_pool *pool,
                                                            const struct pell_surface_sample *samples, size_t num_samples,
                                                            struct collocation_points *out);
void indirect_collocation_finish(struct collocation_points *p);
/* Chooses the points again, `step` mm apart. The result does not depend on the number of threads. */
PELL_NODISCARD enum pell_result indirect_collocation_choose(struct collocation_points *p, float step);

#endif
