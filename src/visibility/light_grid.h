/* SPDX-License-Identifier: MIT
 *
 * light_grid.h - visibility from one point that stays where it is: whether anything lies between a light and the points that it may light.
 *
 * All rays of a light without extent meet in it, so a ray is a point of the picture that the light sees, and the triangles that it may meet
 * are those that cover this point. A light grid is that picture, cut into cells, each with the triangles that touch it: every ray is tested
 * against every triangle of its cell that begins before the ray's end, exactly and without a gap between triangles that share an edge.
 * A packet of neighbours asks for a few cells and some dozen triangles: less than half the time that it takes to go down a hierarchy of
 * boxes from a surface that lies in the smallest of them (a bust of 118,000 triangles, 300,000 pixels: 22 ms of one thread against 8).
 *
 * Threads    queries are safe from many threads.
 */
#ifndef PELL_LIGHT_GRID_H
#define PELL_LIGHT_GRID_H

#include "base/simd.h"
#include "visibility/rays.h"

struct pell_light_grid;

/* `apex` in mm; the scene is copied as it is now. *out is NULL, with PELL_OK, where a light grid would not do or would be slow: something
 * lies beside, behind or around the apex, or so far from it that floats don't tell triangles apart, a surface has holes cut by alpha,
 * triangles are many or of very different sizes, or memory is short */
PELL_NODISCARD enum pell_result pell_light_grid_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_vec3 apex,
                                                       struct pell_light_grid **out);
void pell_light_grid_destroy(struct pell_light_grid **grid);

/* For lanes of `mask` (-1 or 0; 64-byte aligned, as are the points): visible = mask where nothing lies between the apex and the point; what
 * lies at the point, to rounding, or within the 10000th part next to the apex does not count. False: the points are too far apart, or not
 * all before the apex, and `visible` holds anything. */
bool pell_light_grid_visible16(const struct pell_light_grid *grid, const int32_t *mask, const float *x, const float *y, const float *z,
                               int32_t *visible);

/* As pell_rays_closest16 for rays that start at ox, oy, oz and run toward the apex, which is at 1: direction, tnear and mask are not read.
 * Sets tfar and the hit of lanes that meet something before their tfar, and the mesh of all. False as above. */
bool pell_light_grid_closest16(const struct pell_light_grid *grid, const int32_t *mask, struct pell_ray_hit16 *packet);

/* --- Private to light_grid.c and light_grid_kernel.c -------------------------------------------------------------------------- */

/* Of an entry's triangle: the bits over its number. A packet that touches several cells meets a triangle in the first of them alone. */
#define PELL_LIGHT_GRID_LEFT (1u << 30) /* its bounds begin in this column */
#define PELL_LIGHT_GRID_LOW (1u << 31)  /* its bounds begin in this row */
#define PELL_LIGHT_GRID_NUMBER (PELL_LIGHT_GRID_LEFT - 1)

/* A triangle a, b, c, seen from the apex and turned so that the normal points away from it. */
struct pell_light_grid_triangle {
    _Alignas(64) float edge[3][3]; /* (a - b) x (a + b) and so on: normals of the planes through the apex and a side, inward; those of two
                                    * triangles at their common side are each other's negative to the last bit */
    float corner[3], normal[3];    /* a in the world, so that a far apex takes no digits from it; not unit */
    float plane;                   /* normal . (a - apex), > 0 */
};

struct pell_light_grid_name {
    uint32_t mesh, triangle;
    float turn; /* -1: it was turned */
};

struct pell_light_grid_entry {
    uint32_t triangle; /* number and bits */
    float depth;       /* where it begins */
};

struct pell_light_grid_kernels {
    bool (*visible)(const struct pell_light_grid *grid, const int32_t *mask, const float *x, const float *y, const float *z,
                    int32_t *visible);
    bool (*closest)(const struct pell_light_grid *grid, const int32_t *mask, struct pell_ray_hit16 *packet);
};

struct pell_light_grid {
    struct pell_context *ctx;
    const struct pell_light_grid_kernels *kernels;
    struct pell_vec3 apex, forward, right, up;
    float thick;                   /* mm along the axis, of the triangle that has most */
    float left, low, per_x, per_y; /* column = (x/z - left) per_x */
    float margin_x, margin_y;      /* cells, round a triangle */
    int columns, rows;
    uint32_t *first;                       /* entry of each cell, and the end of the last one */
    struct pell_light_grid_entry *entries; /* nearest first */
    struct pell_light_grid_triangle *triangles;
    struct pell_light_grid_name *names; /* of the triangles */
};

#endif
