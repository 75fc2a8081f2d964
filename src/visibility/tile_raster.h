/* SPDX-License-Identifier: MIT
 *
 * tile_raster.h - primary visibility without rays: the scene's triangles are rasterised into tiles, and the nearest is kept.
 *
 * All primary rays start in one point, or have one direction. Each triangle is therefore transformed to the camera once, and tested only by
 * the pixels in its bounds: some nanoseconds per triangle, where a ray takes tens. The results are those of exact rays: a pixel's centre is
 * tested against planes through the camera and a side that two adjacent triangles share to the last bit, so there are no gaps between them;
 * and the nearest triangle is then intersected with the pixel's own ray.
 *
 * Threads    pell_raster_draw from one at a time; tiles can then be read from many.
 */
#ifndef PELL_RASTER_H
#define PELL_RASTER_H

#include "base/simd.h"
#include "visibility/rays.h"

#define PELL_RASTER_TILE 32 /* pixels per side */
#define PELL_RASTER_BLOCK 4 /* pixels per side; a tile consists of rows of blocks */
#define PELL_RASTER_BLOCKS (PELL_RASTER_TILE / PELL_RASTER_BLOCK)

/* The ray of pixel (x, y) has the slopes (x + left) / focal and (top - y) / focal relative to the axis; orthographic: its origin, in mm. */
struct pell_raster_view {
    struct pell_vec3 origin, forward, right, up; /* unit, orthogonal */
    bool orthographic;
    float focal, left, top;
};

struct pell_raster;

/* For images of a given size. The scene is borrowed; its meshes must not change while the raster exists. *out is NULL, with PELL_OK, if
 * rays are better or memory is short: a surface has alpha cutouts, or there are over one and a half triangles per pixel. */
PELL_NODISCARD enum pell_result pell_raster_create(struct pell_context *ctx, const struct pell_scene *scene, int width, int height,
                                                   struct pell_raster **out);
void pell_raster_destroy(struct pell_raster **raster);

/* Rasterises the scene for a camera. False: rays must be used, because they are faster for fewer than `pixels` of an image with so many
 * triangles, or because a triangle is too large, too near or not finite. Allocates nothing. */
bool pell_raster_draw(struct pell_raster *raster, struct pell_pool *pool, const struct pell_raster_view *view, int64_t pixels);

/* Per pixel of a tile: the triangle, -1: none; block by block, and within a block the four rows one after the other. Pixels outside of the
 * image are undefined. */
struct pell_raster_tile {
    _Alignas(64) float near[PELL_RASTER_TILE * PELL_RASTER_TILE]; /* larger is nearer */
    int32_t triangle[PELL_RASTER_TILE * PELL_RASTER_TILE];
};

int pell_raster_columns(const struct pell_raster *raster); /* number of tiles per row */
int pell_raster_tiles(const struct pell_raster *raster);

/* False: the tile is empty, and *out is unchanged. */
bool pell_raster_tile(const struct pell_raster *raster, int number, struct pell_raster_tile *tile);

/* Vertices of the triangles that 16 rays hit. */
struct pell_corners {
    _Alignas(64) uint32_t vertex[3][16]; /* of the mesh */
    float position[3][3][16];            /* [corner][axis], mm */
};

/* Intersects the triangles of a block with their pixels' rays in the packet: sets hits and tfar of lanes whose triangle is not -1. There
 * must be at least one; the other lanes get the vertices of the first, and PELL_NO_HIT as mesh. */
void pell_raster_intersect16(const struct pell_raster *raster, const int32_t *triangle, struct pell_ray_hit16 *packet,
                             struct pell_corners *corners);

/* --- Private to tile_raster.c and tile_raster_kernel.c ------------------------------------------------------------------------ */

#define PELL_RASTER_CHUNKS 32    /* number of work items for triangles; enough to keep some threads busy */
#define PELL_RASTER_BACK 0x8000u /* bit of a span's y0: back-facing; closed objects hide these */

/* The tiles that overlap a triangle's bounds; x0 > x1: none. */
struct pell_raster_span {
    uint16_t x0, x1, y0, y1;
};

/* A vertex in camera space, along right, up and forward, and next to it in world space, because they are read together. */
struct pell_raster_vertex {
    _Alignas(32) float camera[4]; /* the fourth is unused */
    float scene[4];
};
_Static_assert(sizeof(struct pell_raster_vertex) == 32, "two in a cache line");

struct pell_raster_triangle {
    uint32_t vertex[3], mesh;
};

struct pell_raster_kernels {
    void (*vertices)(const struct pell_raster_view *view, const float *position, size_t count, struct pell_raster_vertex *out);
    /* Computes the spans of triangles from `first` to `end`; false: one is not finite, or can't be drawn. */
    bool (*spans)(const struct pell_raster *raster, size_t first, size_t end, struct pell_raster_span *out);
    void (*tile)(const struct pell_raster *raster, int number, struct pell_raster_tile *tile);
    void (*intersect)(const struct pell_raster *raster, const int32_t *triangle, struct pell_ray_hit16 *packet,
                      struct pell_corners *corners);
};

struct pell_raster {
    struct pell_context *ctx;
    const struct pell_raster_kernels *kernels;
    const struct pell_scene *scene;
    int width, height, columns, rows; /* pixels; tiles */
    struct pell_raster_view view;
    float *slope_x, *slope_y; /* per column and row of pixels, in whole tiles */
    size_t num_vertices, num_triangles;
    struct pell_raster_vertex *vertices;
    struct pell_raster_triangle *triangles;
    uint32_t *first_triangle; /* by mesh */
    uint32_t *first_vertex;
    struct pell_raster_span *spans; /* by triangle */
    uint32_t *counts;               /* [chunk][2 tile + back]: number of entries, then the start of a chunk's part in the list */
    uint32_t *first;                /* [2 tile + back], and the end of the last: start of a list in `entries` */
    uint32_t *entries;
    size_t capacity;
    atomic_bool failed;
};

#endif
