/* SPDX-License-Identifier: MIT
 *
 * tile_raster.h - what a camera sees at every pixel of a picture, without rays: the scene's triangles drawn into tiles, the nearest kept.
 *
 * All rays of a camera start in one point, or run one way. So each triangle is brought before the camera once, and asked only by the pixels
 * that its bounds hold: some nanoseconds a triangle, where a ray takes tens. The answers are those of exact rays: a pixel's middle is
 * tested against planes through the camera and a side that two triangles at this side share to the last bit, so that nothing shows between
 * them; and what is nearest is then met anew by the pixel's own ray.
 *
 * Threads    pell_raster_draw from one at a time; tiles are then asked for from many.
 */
#ifndef PELL_RASTER_H
#define PELL_RASTER_H

#include "base/simd.h"
#include "visibility/rays.h"

#define PELL_RASTER_TILE 32 /* pixels a side */
#define PELL_RASTER_BLOCK 4 /* pixels a side; a tile is made of blocks, rows of them one after the other */
#define PELL_RASTER_BLOCKS (PELL_RASTER_TILE / PELL_RASTER_BLOCK)

/* Pixel (x, y) looks through slopes (x + left) / focal and (top - y) / focal of the axis; orthographic: starts there, in mm. */
struct pell_raster_view {
    struct pell_vec3 origin, forward, right, up; /* unit, orthogonal */
    bool orthographic;
    float focal, left, top;
};

struct pell_raster;

/* For pictures of a size. The scene is borrowed; its meshes may not change while the raster lives. *out is NULL, with PELL_OK, where rays
 * do better or memory is short: alpha cuts holes into a surface, or there are over one and a half triangles a pixel. */
PELL_NODISCARD enum pell_result pell_raster_create(struct pell_context *ctx, const struct pell_scene *scene, int width, int height,
                                                   struct pell_raster **out);
void pell_raster_destroy(struct pell_raster **raster);

/* Brings the scene before a camera. False: rays have to be asked, which are quicker for fewer than `pixels` of a picture with so many
 * triangles, or something is too large, too near or no number. Allocates nothing. */
bool pell_raster_draw(struct pell_raster *raster, struct pell_pool *pool, const struct pell_raster_view *view, int64_t pixels);

/* Of a tile's pixels: the triangle, -1 where there is none; block by block, and the four rows of a block one after the other. Pixels beside
 * the picture hold anything. */
struct pell_raster_tile {
    _Alignas(64) float near[PELL_RASTER_TILE * PELL_RASTER_TILE]; /* the larger the nearer */
    int32_t triangle[PELL_RASTER_TILE * PELL_RASTER_TILE];
};

int pell_raster_columns(const struct pell_raster *raster); /* of tiles */
int pell_raster_tiles(const struct pell_raster *raster);

/* False: nothing is in the tile, which is left as it was. */
bool pell_raster_tile(const struct pell_raster *raster, int number, struct pell_raster_tile *tile);

/* Corners of the triangles that 16 rays meet. */
struct pell_corners {
    _Alignas(64) uint32_t vertex[3][16]; /* of the mesh */
    float position[3][3][16];            /* [corner][axis], mm */
};

/* Meets the triangles of a block with their pixels' rays, which the packet holds: hits of lanes whose triangle is not -1, and tfar. One of
 * them at least; the others get the corners of the first, and PELL_NO_HIT for a mesh. */
void pell_raster_intersect16(const struct pell_raster *raster, const int32_t *triangle, struct pell_ray_hit16 *packet,
                             struct pell_corners *corners);

/* --- Private to tile_raster.c and tile_raster_kernel.c ------------------------------------------------------------------------ */

#define PELL_RASTER_CHUNKS 32    /* that triangles are handed out in; as many as keep some threads busy */
#define PELL_RASTER_BACK 0x8000u /* of a span's y0: turned away from the camera; closed objects hide these */

/* The tiles that a triangle's bounds touch; x0 > x1: none. */
struct pell_raster_span {
    uint16_t x0, x1, y0, y1;
};

/* A vertex before the camera, along right, up and forward, and beside it where it is in the scene: who asks for one asks for the other. */
struct pell_raster_vertex {
    _Alignas(32) float camera[4]; /* the fourth: nothing */
    float scene[4];
};
_Static_assert(sizeof(struct pell_raster_vertex) == 32, "two in a cache line");

struct pell_raster_triangle {
    uint32_t vertex[3], mesh;
};

struct pell_raster_kernels {
    void (*vertices)(const struct pell_raster_view *view, const float *position, size_t count, struct pell_raster_vertex *out);
    /* Finds the spans of triangles from `first` to `end`; false: one is no number, or can't be drawn. */
    bool (*spans)(const struct pell_raster *raster, size_t first, size_t end, struct pell_raster_span *out);
    void (*tile)(const struct pell_raster *raster, int number, struct pell_raster_tile *tile);
    void (*meet)(const struct pell_raster *raster, const int32_t *triangle, struct pell_ray_hit16 *packet, struct pell_corners *corners);
};

struct pell_raster {
    struct pell_context *ctx;
    const struct pell_raster_kernels *kernels;
    const struct pell_scene *scene;
    int width, height, columns, rows; /* pixels; tiles */
    struct pell_raster_view view;
    float *slope_x, *slope_y; /* of columns and rows of pixels, whole tiles */
    size_t num_vertices, num_triangles;
    struct pell_raster_vertex *vertices;
    struct pell_raster_triangle *triangles;
    uint32_t *first_triangle; /* of a mesh */
    uint32_t *first_vertex;
    struct pell_raster_span *spans; /* of triangles */
    uint32_t *counts;               /* [chunk][2 tile + back]: entries, then where a chunk's begin in the list */
    uint32_t *first;                /* [2 tile + back], and the end of the last: where a list begins in `entries` */
    uint32_t *entries;
    size_t capacity;
    atomic_bool fails;
};

#endif
