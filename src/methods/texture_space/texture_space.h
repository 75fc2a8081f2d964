/* SPDX-License-Identifier: MIT
 *
 * texture_space.h - declarations shared by the files of this method. Its only external symbol is pell_method_texture_space.
 */
#ifndef PELL_TEXTURE_SPACE_H
#define PELL_TEXTURE_SPACE_H

#include "methods/texture_space/formulas.h"
#include "methods/texture_space/kernels.h"
#include "render/services.h"
#include "scene/triangle.h"

#include <pellucid/method.h>

enum ts_as { TS_BEST, TS_PAPER };
enum { TS_SIZE_MIN = 16, TS_SIZE_MAX = 1024 }; /* texels; the largest automatic size */
enum ts_charts { TS_CHARTS_AUTO, TS_CHARTS_UV, TS_CHARTS_PLANAR };
enum ts_kernel { TS_KERNEL_DENSE, TS_KERNEL_SEVEN, TS_KERNEL_JITTERED };
enum ts_first { TS_FIRST_BLURRED, TS_FIRST_UNBLURRED };
enum ts_thickness { TS_THICKNESS_FACES, TS_THICKNESS_PRINTED };
enum ts_form { TS_TSM_RAY, TS_TSM_MAP, TS_TSM_OFF };
enum ts_transmission { TS_TRANSMISSION_SLAB, TS_TRANSMISSION_GAUSSIAN };
enum ts_fade { TS_FADE_OVERLAP, TS_FADE_LINEAR };
enum ts_lights { TS_LIGHTS_OWN, TS_LIGHTS_SUM };

struct ts_knobs {
    int as;   /* enum ts_as */
    int size; /* texels; 0: by the image's resolution */
    int gaussians;
    int charts; /* enum ts_charts */
    int border; /* texels */
    int kernel; /* enum ts_kernel */
    bool stretch;
    int first;        /* enum ts_first */
    int tsm;          /* enum ts_form */
    int tsm_size;     /* px */
    int transmission; /* enum ts_transmission */
    int thickness;    /* enum ts_thickness */
    int fade;         /* enum ts_fade */
    bool soften;
    int lights; /* enum ts_lights */
    bool strength;
    bool cull;
    float mix; /* negative: the material's own */
};

/* --- atlas/: parametrisation of a solid's surface -------------------------------------------------------------------------------- */

struct ts_triangle {
    uint32_t mesh, triangle;
};

/* A bilinear lookup: four texels, given by the lower left one. */
struct ts_bilinear {
    int32_t at;   /* texel index; -1: none */
    float key;    /* of its chart */
    float fx, fy; /* [0, 1] */
};

/* A border texel next to a chart: its value is the mean of four texels of an adjacent chart. */
struct ts_border {
    int32_t at, from;       /* the border texel; the lower left one of the four */
    float weight[4];        /* sum to one; 0 for texels outside of the source chart */
    int32_t far;            /* texels, along the longer axis, from the inside of a chart; below TS_FAR */
    int32_t first, sources; /* replace the four texels: range in the atlas's sources; sources 0: the four are used */
};

/* Packed border data that every blur reads. */
struct ts_fill {
    int32_t at, from; /* the texel; the lower left one of four; with sources the first source */
    uint16_t x, y;    /* position between the four, scaled by TS_WHOLE */
    uint8_t far, sources;
};
#define TS_WHOLE 65535.0f
enum { TS_PREFETCH = 12 }; /* prefetch distance; the list has as many entries of padding at its end */

/* A chart texel in the weighted sum of a border texel at a seam: of its own chart, or of the others around its location. */
struct ts_source {
    int32_t at;
    float weight;
};

/* Orientation of a border texel in its source triangle: its steps along x and y, independent of the layout of the source chart. */
struct ts_orientation {
    uint32_t triangle;
    int32_t at;
    float u[2], v[2]; /* barycentrics per texel along x, along y */
};

struct ts_run {
    int16_t from, to; /* blocks */
};

struct ts_atlas {
    struct pell_context *ctx;
    const struct pell_scene *scene; /* borrowed */
    uint32_t num_triangles;
    struct ts_triangle *triangles; /* indexed through the solid's meshes */
    uint32_t *first;               /* per scene mesh: index of its first triangle; UINT32_MAX: not of this solid */
    float (*corners)[6];           /* per triangle: x, y of its corners, in texels; texel centres are at + 1/2 */
    int32_t *chart;                /* per triangle: 1, 2, ...; 0: no area */
    uint32_t *twin;                /* per half-edge 3 t + k, from corner k to the next: the opposite one, or UINT32_MAX */
    bool charts_separated;         /* the mesh's charts, separated */
    const char *defect;            /* constant text: the defect of its texture coordinates; NULL: none, or charts=planar */
    bool lacks_uv;                 /* the mesh has no texture coordinates */
    int num_charts;
    /* Texels: plane[y * stride + x], with TS_MARGIN empty texels on the left and right. */
    int width, height, blocks;
    ptrdiff_t stride;
    size_t size;      /* floats of a plane */
    float *key;       /* chart, 0: none; origin at texel (0, 0), as all planes */
    uint32_t *source; /* per chart texel: the triangle; UINT32_MAX: none */
    float *bary[2];
    float *length[2];          /* mm from texel to texel along x, and perpendicular to it; 0 outside of charts */
    struct ts_metric *metric;  /* per triangle, during an update */
    float *skew;               /* texels along x per texel along y; 0 where the layout's axes are perpendicular on the surface */
    float *tilt[2];            /* relative change of a tap's weight per texel along x, and perpendicular: compensates for geodesic
                                * curvature */
    int64_t inner;             /* chart texels without borders */
    int64_t buried;            /* texels removed from charts because they are inside another part */
    struct ts_border *borders; /* during construction */
    struct ts_fill *fills;     /* packed borders, by squares of TS_BLOCK; in each square those with sources are last, the others sorted by
                                * distance from charts */
    size_t num_borders;
    struct ts_source *sources;
    struct ts_orientation *orientations; /* of borders, row by row */
    size_t *first_orientation;           /* per row, height + 1 entries */
    size_t *first_border;                /* per square, plus the end of the last one */
    size_t *first_with_sources;          /* per square: the first border with sources */
    size_t num_squares;
    size_t within[TS_FAR];      /* number of borders within this distance */
    struct ts_run *runs;        /* non-empty blocks, row by row */
    int *first_run;             /* per row, height + 1 entries */
    struct ts_cell *cells;      /* per block of a row */
    double mm_per_texel;        /* mean */
    double overlap, degenerate; /* fractions that may disqualify a layout */
    int border;                 /* texels */
    uint64_t hash;              /* hash of the triangles and texture coordinates, not of positions */
    uint64_t positions;         /* hash of the positions that lengths were measured at */
};

struct ts_atlas_params {
    struct pell_pool *pool;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_solids *solids;
    size_t solid;
    const char *name; /* for messages */
    int size, border, charts;
};

/* Hash of a layout's inputs: equal hashes have equal layouts, at any vertex positions. */
uint64_t ts_atlas_hash(const struct pell_scene *scene, const struct pell_solids *solids, size_t solid);
/* Adapts the layout to a scene with the same hash: recomputes only what depends on positions, and nothing if these are equal. False, with
 * the atlas unchanged, if a triangle has lost or gained its area. */
bool ts_atlas_update(struct ts_atlas *atlas, struct pell_pool *pool, const struct pell_scene *scene);
PELL_NODISCARD enum pell_result ts_atlas_make(struct pell_context *ctx, const struct ts_atlas_params *params, struct ts_atlas **out);
void ts_atlas_destroy(struct ts_atlas **atlas);
/* Bilinear lookup at a point of a triangle (index and barycentrics). */
struct ts_bilinear ts_atlas_locate(const struct ts_atlas *a, uint32_t triangle, float u, float v);
/* Bilinear mean of those of the four texels that are in the lookup's chart; false: none is. `planes` begin at texel (0, 0). */
static inline bool ts_read(const struct ts_atlas *a, const struct ts_bilinear *p, const float *const *planes, int count, float *out)
{
    const ptrdiff_t at[4] = { p->at, p->at + 1, p->at + a->stride, p->at + a->stride + 1 };
    const float w[4] = { (1.0f - p->fx) * (1.0f - p->fy), p->fx * (1.0f - p->fy), (1.0f - p->fx) * p->fy, p->fx * p->fy };
    float sum = 0.0f;

    for (int c = 0; c < count; c++)
        out[c] = 0.0f;
    if (p->at < 0)
        return false;
    for (int i = 0; i < 4; i++)
        if (a->key[at[i]] == p->key && w[i] > 0.0f) {
            sum += w[i];
            for (int c = 0; c < count; c++)
                out[c] += w[i] * planes[c][at[i]];
        }
    if (!(sum > 0.0f))
        return false;
    for (int c = 0; c < count; c++)
        out[c] /= sum;
    return true;
}

/* A point of a triangle, its geometric normal, and its largest coordinate, which determines the rounding error. */
static inline void ts_point_of(const struct ts_atlas *a, uint32_t triangle, float u, float v, struct pell_vec3 *at,
                               struct pell_vec3 *normal, float *largest)
{
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[triangle].mesh];
    struct pell_vec3 p[3];

    pell_triangle_corners(m, a->triangles[triangle].triangle, p);
    *at = vec3_mad(vec3_mad(p[0], u, vec3_sub(p[1], p[0])), v, vec3_sub(p[2], p[0]));
    *normal = vec3_normalize(pell_triangle_cross(p));
    *largest = vec3_max_abs(*at);
}

/* Offsets of the chart texels in four rows of a block, by tiles of 4 x 4 for coherent packets: dx + TS_BLOCK dy of each. Returns their
 * number, at most 64. */
enum { TS_TILE = 4 };
static inline int ts_block_texels(const struct ts_atlas *a, int y0, int block, uint8_t list[TS_TILE * TS_BLOCK])
{
    const ptrdiff_t first = y0 * a->stride + block * TS_BLOCK;
    const int rows = a->height - y0 < TS_TILE ? a->height - y0 : TS_TILE;
    int count = 0, near = TS_FAR;

    for (int dy = 0; dy < rows; dy++)
        near = a->cells[(ptrdiff_t) (y0 + dy) * a->blocks + block].near < near ? a->cells[(ptrdiff_t) (y0 + dy) * a->blocks + block].near
                                                                               : near;
    for (int x0 = 0; near == 0 && x0 < TS_BLOCK; x0 += TS_TILE)
        for (int dy = 0; dy < rows; dy++)
            for (int dx = x0; dx < x0 + TS_TILE; dx++)
                if (a->source[first + dy * a->stride + dx] != UINT32_MAX)
                    list[count++] = (uint8_t) (dx + TS_BLOCK * dy);
    return count;
}

/* --- ambient_visibility.c: visibility of the environment at texels -------------------------------------------------------------------- */

struct ts_ambient_params {
    const struct pell_services *services;
    const struct ts_atlas *atlas;
    uint32_t seed;
    const uint8_t *need; /* per block of a row: 0: no texel is needed; NULL: all are needed */
    float *seen, *spare; /* planes: cosine-weighted visible fraction of the hemisphere about the texel's geometric normal; and a scratch
                          * plane */
};

/* Side of the squares of texels that share a pattern of samples; and the part of it that a texel traces, below side^2. */
int ts_ambient_side(const struct ts_atlas *a);
uint32_t ts_ambient_part(int side, int x, int y);
/* Computes the visible fraction at chart texels. Returns the number of rays. Allocates nothing. */
int64_t ts_ambient_trace(const struct ts_ambient_params *params);

/* --- profile.c: the Gaussians of a material ------------------------------------------------------------------------------------------ */

struct ts_profile {
    int count;
    double variance[TS_LEVELS];  /* mm^2, increasing */
    double weight[TS_LEVELS][3]; /* 0: inserted only for the ratio of variances */
    int gaussian[TS_LEVELS];     /* from 1: the material's Gaussian, or the one that this level was inserted before */
    int inserted[TS_LEVELS];     /* from 1: its index among the levels inserted there; 0: the Gaussian itself */
    int added;                   /* number of inserted Gaussians without weight */
    double widest;               /* sqrt of the last variance, mm */
    struct ts_tap taps[TS_TAPS]; /* of kernel=jittered-13 */
    double thickest;             /* mm: thicker parts transmit nothing */
    bool slab;                   /* a table exists */
    /* Fraction of level i in the transmission through a slab d = thickest (row/(TS_THICK - 1))^2 mm thick. */
    float (*fraction)[TS_LEVELS][3];
};

/* `local`: whether the maps exclude transmitted light (struct pell_points_params). `forward`: the engine adds what clear media pass
 * forward. */
PELL_NODISCARD enum pell_result ts_profile_make(struct pell_context *ctx, const struct pell_frame_material *m, const struct ts_knobs *knobs,
                                                bool local, bool forward, struct ts_profile *out);
void ts_profile_finish(struct pell_context *ctx, struct ts_profile *p);
/* Transmission of level `i` through d mm; `opposed`: how far the surfaces face in opposite directions, [0, 1]: 1 in a slab;
 * at 0 nothing is transmitted. */
void ts_profile_transmission(const struct ts_profile *p, int i, float d, float opposed, float fraction[3]);

/* --- translucent_shadow_map.c: entry points of transmitted light ------------------------------------------------------------------- */

struct ts_transmitted_texel {
    int32_t at;                /* the texel C */
    struct ts_bilinear from;   /* A */
    struct ts_bilinear second; /* a second entry point, whose light has this weight, [0, 1] */
    float second_weight;
    float m;                /* mm from C to A, straight */
    float surface_distance; /* mm from C to A along the surface in one chart, else straight, too */
    struct pell_vec3 normal;
    float cosine;       /* between the normal at A and the direction of the ray */
    float opposed;      /* how far the normals at A and C oppose, [0, 1] */
    bool along_surface; /* `surface_distance` is along the surface */
    float remaining[3]; /* fraction that the engine does not add already, as diffusion in the solid */
    float fraction[3];  /* transmission weight at the current level */
};

struct ts_tsm {
    struct ts_transmitted_texel *texels; /* capacity for all texels */
    size_t count;
    int *num;              /* per TS_TILE rows: number of chart texels */
    int *first, *count_of; /* per TS_TILE rows, during construction */
    uint8_t *faces;        /* per triangle: enum ts_face */
    void *map;
};

enum ts_face {
    TS_FACE_AWAY = 1, /* faces away from the light */
    TS_FACE_DARK = 2, /* so do its vertex normals: no light enters */
};

struct ts_tsm_params {
    const struct pell_services *services;
    const struct pell_solids *solids;
    int32_t solid;
    const struct ts_atlas *atlas;
    const struct pell_light *light;
    const struct pell_light_grid *grid; /* visibility from the light; NULL: rays are traced */
    int form, size;                     /* enum ts_form; of the map, px */
    bool printed;                       /* the paper's formula for thickness */
    bool at_once;                       /* ts_tsm_light will not be called */
    const uint8_t *need;                /* per texel: 0: its light is not needed; NULL: all are needed */
    double thickest;                    /* mm */
    double falloff;                     /* mm: alpha is exp(-d/falloff) */
};

/* Allocates for any of these atlases. Call the finish function even after a failure. `map_size` 0: no map. */
PELL_NODISCARD enum pell_result ts_tsm_allocate(struct pell_context *ctx, const struct ts_atlas *const *atlases, size_t count, int map_size,
                                                struct ts_tsm *out);
void ts_tsm_finish(struct pell_context *ctx, struct ts_tsm *tsm);
/* Call before the first light of an atlas. */
void ts_tsm_start(const struct ts_atlas *a, struct ts_tsm *tsm);
/* Determines which triangles face away from the light. Call before ts_tsm_make. */
void ts_tsm_face(const struct ts_tsm_params *params, struct ts_tsm *tsm);
/* Fills `alpha` at all chart texels (0: no transmission) and lists those that receive transmitted light: texels that face away from the
 * light, or with `at_once` are in its shadow. Allocates nothing. */
PELL_NODISCARD enum pell_result ts_tsm_make(const struct ts_tsm_params *params, float *alpha, struct ts_tsm *out, int64_t *rays);
/* Refines the list once the irradiance of this light alone is known: rays that end in shadow continue to a lit surface, and texels that
 * face the light but are shadowed by the solid itself join the list. Call after ts_tsm_make. */
PELL_NODISCARD enum pell_result ts_tsm_light(const struct ts_tsm_params *params, const float *const lit[3], float *alpha,
                                             struct ts_tsm *out, int64_t *rays);

extern const struct pell_method_engine pell_ts_cpu;
extern const struct pell_method_engine pell_ts_vulkan; /* only in builds with Vulkan */

#endif
