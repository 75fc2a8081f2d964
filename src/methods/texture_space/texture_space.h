/* SPDX-License-Identifier: MIT
 *
 * texture_space.h - what the files of this method share. Its only symbol for others is pell_method_texture_space.
 */
#ifndef PELL_TEXTURE_SPACE_H
#define PELL_TEXTURE_SPACE_H

#include "methods/texture_space/formulas.h"
#include "methods/texture_space/kernels.h"
#include "render/services.h"
#include "scene/triangle.h"

#include <pellucid/method.h>

enum ts_as { TS_BEST, TS_PAPER };
enum { TS_SIZE_LEAST = 16, TS_SIZE_MOST = 1024 }; /* texels; the most that are not asked for */
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
    int size; /* texels; 0: as the picture needs */
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
    float mix; /* negative: each material's own */
};

/* --- atlas/: a solid's surface laid out flat ------------------------------------------------------------------------------------- */

struct ts_triangle {
    uint32_t mesh, triangle;
};

/* A place that texels are read at: the four around it, by the texel of the lower left one. */
struct ts_place {
    int32_t at;   /* index of the texel; -1: none */
    float key;    /* of its chart */
    float fx, fy; /* [0, 1] */
};

/* A texel beside its chart, which stands for a point of another: what is there is the mean of four texels there. */
struct ts_border {
    int32_t at, from;     /* the texel that is filled; the lower left one of the four */
    float weight[4];      /* that sum to one; 0 for those that are not the chart's own */
    int32_t far;          /* texels, along the longer axis, from the inside of a chart; under TS_FAR */
    int32_t first, parts; /* in place of the four: of the atlas's parts; 0 parts: the four */
};

/* What each blur needs of it, packed: all of them are read before each one. */
struct ts_fill {
    int32_t at, from; /* the texel; the lower left one of four; with parts the first of these */
    uint16_t x, y;    /* of TS_WHOLE: where between the four */
    uint8_t far, parts;
};
#define TS_WHOLE 65535.0f
enum { TS_AHEAD = 12 }; /* how many are asked for before they are needed; so many lie behind the last one */

/* One of the texels inside charts whose weighted sum a border beside a seam is: of its own chart, and of the others around its place. */
struct ts_part {
    int32_t at;
    float weight;
};

/* What a border is of the triangle that it stands for: steps along x and along y there, whichever way its own chart lies. */
struct ts_turn {
    uint32_t triangle;
    int32_t at;
    float u[2], v[2]; /* barycentrics for a texel along x, along y */
};

struct ts_run {
    int16_t from, to; /* blocks */
};

struct ts_atlas {
    struct pell_context *ctx;
    const struct pell_scene *scene; /* borrowed */
    uint32_t num_triangles;
    struct ts_triangle *triangles; /* numbered through the solid's meshes */
    uint32_t *first;               /* per scene mesh: its first triangle's number; UINT32_MAX: not of this solid */
    float (*corners)[6];           /* per triangle: x, y of its corners, in texels; a texel's middle is at + 1/2 */
    int32_t *chart;                /* per triangle: 1, 2, ...; 0: it has no area */
    uint32_t *twin;                /* per half-edge 3 t + k, from corner k to the next: the one across, or UINT32_MAX */
    bool apart;                    /* the file's charts, moved apart */
    const char *wrong;             /* constant text: what was wrong with its texture coordinates; NULL: nothing, or charts=planar */
    bool without;                  /* it has none */
    int num_charts;
    /* Texels: plane[y * stride + x], with TS_MARGIN texels without chart left and right. */
    int width, height, blocks;
    ptrdiff_t stride;
    size_t size;      /* floats of a plane */
    float *key;       /* chart, 0: none; origin at texel (0, 0), as all planes */
    uint32_t *source; /* per texel of a chart: the triangle; UINT32_MAX: none */
    float *bary[2];
    float *length[2];          /* mm from texel to texel along x, and at right angles to that; 0 without chart */
    struct ts_metric *metric;  /* per triangle, while it is updated */
    float *skew;               /* texels along x in a step along y: 0 where the layout's axes are at right angles on the surface */
    float *tilt[2];            /* what taps weigh more per texel along x, and at right angles: it makes up for how these lines bend */
    int64_t inner;             /* texels of charts, borders apart */
    int64_t buried;            /* texels that were taken out of charts, as they are inside of another part */
    struct ts_border *borders; /* while they are made */
    struct ts_fill *fills;     /* of them, by squares of TS_BLOCK; in each those with parts last, else those nearest to charts first */
    size_t num_borders;
    struct ts_part *parts;
    struct ts_turn *turns; /* of borders, row by row */
    size_t *first_turn;    /* per row, height + 1 */
    size_t *first_border;  /* of each square, and the end of the last one */
    size_t *first_mended;  /* the first with parts of each square */
    size_t num_squares;
    size_t within[TS_FAR];      /* borders no further than that */
    struct ts_run *runs;        /* blocks that hold anything, row by row */
    int *first_run;             /* per row, height + 1 */
    struct ts_cell *cells;      /* per block of a row */
    double mm_per_texel;        /* mean */
    double overlap, degenerate; /* shares that speak against a layout */
    int border;                 /* texels */
    uint64_t print;             /* of the triangles and texture coordinates, not of where they are */
    uint64_t positions;         /* of where they are: what lengths were measured at */
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

/* What a layout is of: equal numbers have equal layouts, wherever their vertices are. */
uint64_t ts_atlas_print(const struct pell_scene *scene, const struct pell_solids *solids, size_t solid);
/* Takes the layout for a scene of the same print: only what depends on positions is made anew, and nothing where these are the same. False,
 * and the atlas as it was, where a triangle that had no area has one now, or the other way round. */
bool ts_atlas_update(struct ts_atlas *atlas, struct pell_pool *pool, const struct pell_scene *scene);
PELL_NODISCARD enum pell_result ts_atlas_make(struct pell_context *ctx, const struct ts_atlas_params *params, struct ts_atlas **out);
void ts_atlas_destroy(struct ts_atlas **atlas);
/* Where a point of a triangle (number and barycentrics) lies. */
struct ts_place ts_atlas_place(const struct ts_atlas *a, uint32_t triangle, float u, float v);
/* Mean of the four texels that are of the place's chart, weighted by nearness; false: there is none. `planes` begin at texel (0, 0). */
static inline bool ts_read(const struct ts_atlas *a, const struct ts_place *p, const float *const *planes, int count, float *out)
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

/* A point of a triangle, its geometric normal, and the largest of its coordinates, which floats are as fine as. */
static inline void ts_point_of(const struct ts_atlas *a, uint32_t triangle, float u, float v, struct pell_vec3 *at,
                               struct pell_vec3 *normal, float *largest)
{
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[triangle].mesh];
    struct pell_vec3 p[3];

    pell_triangle_corners(m, a->triangles[triangle].triangle, p);
    *at = vec3_mad(vec3_mad(p[0], u, vec3_sub(p[1], p[0])), v, vec3_sub(p[2], p[0]));
    *normal = vec3_normalize(pell_triangle_cross(p));
    *largest = fmaxf(fabsf(at->x), fmaxf(fabsf(at->y), fabsf(at->z)));
}

/* The texels of charts in four rows of a block, tile by tile of 4 x 4, so that packets are made of neighbours: dx + TS_BLOCK dy of each.
 * Returns how many there are, 64 at most. */
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

/* --- ambient_visibility.c: how much of the sky texels see
 * ------------------------------------------------------------------------------------------- */

struct ts_ambient_params {
    const struct pell_services *services;
    const struct ts_atlas *atlas;
    uint32_t seed;
    const uint8_t *need; /* per block of a row: 0: none of its texels is asked for; NULL: all are */
    float *seen, *spare; /* planes: share of the sky about a texel's geometric normal that is seen, by its cosine; and one to work in */
};

/* Texels of a square that share a pattern of samples, along a side; and which part of it a texel has, under side^2. */
int ts_ambient_side(const struct ts_atlas *a);
uint32_t ts_ambient_part(int side, int x, int y);
/* At texels of charts. Returns the rays that it took. Allocates nothing. */
int64_t ts_ambient_look(const struct ts_ambient_params *params);

/* --- profile.c: the Gaussians of a material ------------------------------------------------------------------------------------------ */

struct ts_profile {
    int count;
    double variance[TS_LEVELS];  /* mm^2, rising */
    double weight[TS_LEVELS][3]; /* 0: only for the ratio */
    int added;                   /* that have no weight */
    double widest;               /* sqrt of the last variance, mm */
    struct ts_tap taps[TS_TAPS]; /* of kernel=jittered-13 */
    double thickest;             /* mm: beyond it nothing is transmitted */
    bool slab;                   /* a table is there */
    /* Share of level i of the transmission through a slab d = thickest (row/(TS_THICK - 1))^2 mm thick. */
    float (*share)[TS_LEVELS][3];
};

/* `local`: as the maps hold light (struct pell_points_params). `forward`: the engine has what clear media pass forward. */
PELL_NODISCARD enum pell_result ts_profile_make(struct pell_context *ctx, const struct pell_frame_material *m, const struct ts_knobs *knobs,
                                                bool local, bool forward, struct ts_profile *out);
void ts_profile_finish(struct pell_context *ctx, struct ts_profile *p);
/* What level `i` brings from behind through d mm; `opposed`: how far the two surfaces face apart, [0, 1]: 1 is a slab, 0 none. */
void ts_profile_transmission(const struct ts_profile *p, int i, float d, float opposed, float share[3]);

/* --- translucent_shadow_map.c: where transmitted light enters --- */

struct ts_transmitted_texel {
    int32_t at;           /* the texel C */
    struct ts_place from; /* A */
    struct ts_place also; /* another A, whose light is `part` of it, [0, 1] */
    float part;
    float m;     /* mm from C to A, straight */
    float apart; /* the same along the surface in one chart, else straight, too */
    struct pell_vec3 normal;
    float cosine;   /* between the normal at A and the way there */
    float opposed;  /* how far the normals at A and C oppose, [0, 1] */
    bool round;     /* `apart` is along the surface */
    float left[3];  /* that the engine does not add, as diffusion in the solid */
    float share[3]; /* of the level that is being made */
};

struct ts_tsm {
    struct ts_transmitted_texel *texels; /* room for all */
    size_t count;
    int *num;              /* per TS_TILE rows: texels of charts */
    int *first, *count_of; /* per TS_TILE rows, while it is made */
    uint8_t *faces;        /* per triangle: enum ts_face */
    void *map;
};

enum ts_face {
    TS_FACE_AWAY = 1, /* from the light */
    TS_FACE_DARK = 2, /* its normals do, too: no light enters */
};

struct ts_tsm_params {
    const struct pell_services *services;
    const struct pell_solids *solids;
    int32_t solid;
    const struct ts_atlas *atlas;
    const struct pell_light *light;
    const struct pell_light_grid *grid; /* what it sees; NULL: ask the rays */
    int form, size;                     /* enum ts_form; of the map, px */
    bool printed;                       /* the paper's thickness */
    bool at_once;                       /* ts_tsm_light will not be called */
    const uint8_t *need;                /* per texel: 0: its light is not asked for; NULL: all are */
    double thickest;                    /* mm */
    double falloff;                     /* mm: alpha is exp(-d/falloff) */
};

/* Room for any of these atlases. Finish it also after a failure. `map_size` 0: none. */
PELL_NODISCARD enum pell_result ts_tsm_allocate(struct pell_context *ctx, const struct ts_atlas *const *atlases, size_t count, int map_size,
                                                struct ts_tsm *out);
void ts_tsm_finish(struct pell_context *ctx, struct ts_tsm *tsm);
/* Before the first light of an atlas. */
void ts_tsm_start(const struct ts_atlas *a, struct ts_tsm *tsm);
/* Which triangles face away from the light. Before ts_tsm_make. */
void ts_tsm_face(const struct ts_tsm_params *params, struct ts_tsm *tsm);
/* Fills `alpha` at all texels of charts (0: no transmission) and lists those that face away from the light, or with `at_once` are in its
 * shadow, and receive transmitted light. Allocates nothing. */
PELL_NODISCARD enum pell_result ts_tsm_make(const struct ts_tsm_params *params, float *alpha, struct ts_tsm *out, int64_t *rays);
/* The same with what enters of that light alone known: ways that end in the dark go on to where there is light, and those of texels that
 * face it in the solid's own shadow join the list. After ts_tsm_make. */
PELL_NODISCARD enum pell_result ts_tsm_light(const struct ts_tsm_params *params, const float *const lit[3], float *alpha,
                                             struct ts_tsm *out, int64_t *rays);

extern const struct pell_method_engine pell_ts_cpu;
extern const struct pell_method_engine pell_ts_vulkan; /* of builds that have Vulkan */

#endif
