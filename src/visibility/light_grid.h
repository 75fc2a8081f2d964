/* SPDX-License-Identifier: MIT
 *
 * light_grid.h - visibility from a fixed point: shadow rays between a point light and the surface.
 *
 * All shadow rays of a light without extent end in it, so a ray corresponds to a point of the light's projection, and the triangles that it
 * may hit are those that cover this point. A light grid is that projection, divided into cells, each with the triangles that overlap it (an
 * irregular z-buffer): every ray is tested against every triangle of its cell that begins before the ray's end, exactly and watertight
 * between triangles that share an edge. A packet of neighbours reads a few cells and some dozen triangles: less than half the time of
 * traversing a hierarchy of boxes from a surface inside the smallest of them (a bust of 118,000 triangles, 300,000 pixels: 22 ms on one
 * thread against 8).
 *
 * Threads    queries are safe from many threads.
 */
#ifndef PELL_LIGHT_GRID_H
#define PELL_LIGHT_GRID_H

#include "base/simd.h"
#include "visibility/rays.h"

struct pell_light_grid;

/* `apex` in mm; copies the current scene. *out is NULL, with PELL_OK, if a light grid is not applicable or would be slow: geometry is
 * beside, behind or around the apex, or so far from it that floats do not resolve triangles, a surface has alpha cutouts, there are many
 * triangles or triangles of very different sizes, or memory is short. */
PELL_NODISCARD enum pell_result pell_light_grid_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_vec3 apex,
                                                       struct pell_light_grid **out);
void pell_light_grid_destroy(struct pell_light_grid **grid);

/* For lanes of `mask` (-1 or 0; 64-byte aligned, as are the points): visible = mask if nothing is between the apex and the point; geometry
 * at the point, within rounding errors, or within 1/10000 of the distance next to the apex is ignored. False: the points are too far from
 * each other, or not all in front of the apex, and `visible` is undefined. */
bool pell_light_grid_visible16(const struct pell_light_grid *grid, const int32_t *mask, const float *x, const float *y, const float *z,
                               int32_t *visible);

/* Like pell_rays_closest16 for rays that start at ox, oy, oz and end at the apex at t = 1: direction, tnear and mask are ignored. Sets tfar
 * and the hit of lanes that hit something before their tfar, and the mesh of all. False as above. */
bool pell_light_grid_closest16(const struct pell_light_grid *grid, const int32_t *mask, struct pell_ray_hit16 *packet);

/* --- Private to light_grid.c and light_grid_kernel.c -------------------------------------------------------------------------- */

/* Of an entry's triangle: flag bits above its index. A packet that covers several cells tests a triangle only in the first of them. */
#define PELL_LIGHT_GRID_LEFT (1u << 30) /* its bounds begin in this column */
#define PELL_LIGHT_GRID_LOW (1u << 31)  /* its bounds begin in this row */
#define PELL_LIGHT_GRID_INDEX (PELL_LIGHT_GRID_LEFT - 1)

/* A triangle a, b, c relative to the apex, oriented so that the normal points away from it. */
struct pell_light_grid_triangle {
    _Alignas(64) float edge[3][3]; /* (a - b) x (a + b) and so on: normals of the planes through the apex and a side, inward; those of two
                                    * triangles at their common side are exact negatives of each other */
    float corner[3], normal[3];    /* a in world space, so that a distant apex costs no precision; not unit */
    float plane;                   /* normal . (a - apex), > 0 */
};

struct pell_light_grid_source {
    uint32_t mesh, triangle;
    float orientation; /* -1: its orientation was flipped */
};

struct pell_light_grid_entry {
    uint32_t triangle; /* index and flags */
    float depth;       /* smallest depth */
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
    float max_thickness;           /* mm along the axis, maximum over triangles */
    float left, low, inv_x, inv_y; /* column = (x/z - left) inv_x */
    float margin_x, margin_y;      /* cells, around a triangle */
    int columns, rows;
    uint32_t *first;                       /* index of each cell's first entry, and the end of the last one */
    struct pell_light_grid_entry *entries; /* nearest first */
    struct pell_light_grid_triangle *triangles;
    struct pell_light_grid_source *sources; /* by triangle: its place in the scene */
};

#endif
