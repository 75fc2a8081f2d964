/* SPDX-License-Identifier: MIT
 *
 * layered.h - what the files of this method share. Its only symbol for others is pell_method_layered.
 */
#ifndef PELL_LAYERED_H
#define PELL_LAYERED_H

#include "base/pool.h"
#include "methods/layered/kernels.h"
#include "transport/medium_layers.h"

#include <pellucid/method.h>

enum layered_as { LAYERED_BEST, LAYERED_PAPER };
enum layered_steps { LAYERED_BY_LIGHT, LAYERED_EQUAL };
enum layered_march { LAYERED_EXPONENTIAL, LAYERED_SUM };
enum layered_refraction { LAYERED_PLANAR, LAYERED_NONE, LAYERED_EXACT };
enum layered_path { LAYERED_PLANES_RAYS, LAYERED_PLANES, LAYERED_RAYS };
enum layered_planes { LAYERED_BY_AREA, LAYERED_BY_VERTEX, LAYERED_TANGENT };
enum layered_under { LAYERED_AS_MATERIAL, LAYERED_STOP, LAYERED_LAST, LAYERED_COLOR };

struct layered_knobs {
    int as; /* enum layered_as */
    int samples;
    int steps; /* enum layered_steps */
    float tolerance;
    int march;      /* enum layered_march */
    int refraction; /* enum layered_refraction */
    int path;       /* enum layered_path */
    int planes;     /* enum layered_planes */
    float epsilon;
    int sources;
    int under; /* enum layered_under */
    bool shadows;
    bool multiple;
    float diffuse;
};

/* --- medium.c: a material's layers as the march reads them ---------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result layered_medium_make(struct pell_context *ctx, const struct pell_medium_layers *medium_layers,
                                                    const char *name, int under, struct layered_medium *out);
/* The tint of the material's boundary, after the above. */
PELL_NODISCARD enum pell_result layered_medium_color(struct pell_context *ctx, const struct pell_material *material,
                                                     struct layered_medium *m);
/* `count` steps of a march, after all of the above. */
PELL_NODISCARD enum pell_result layered_medium_steps(struct pell_context *ctx, int count, bool equal, struct layered_medium *m);
void layered_medium_finish(struct pell_context *ctx, struct layered_medium *m);

/* --- plane_grid.c: the least-squares plane of each vertex --------------------------------------------------------------------------- */

/* Vertices of one solid - the meshes of one object that have the same material - and what else stands for its surface. */
struct layered_cloud {
    struct pell_context *ctx;
    struct pell_pool *pool;
    size_t count, fitted;     /* points; the first of them are vertices, which get planes */
    float *position, *normal; /* xyz */
    float *weight;            /* > 0 */
    float radius;             /* mm: of the neighbourhood, (8) */
    const uint8_t *keep;      /* 1: of a vertex whose plane is there; NULL: of none */
};

/* plane[i] = the unit normal n_SP, and h: where the plane meets the vertex's normal, mm. Fewer than 6 neighbours, or neighbours that are no
 * surface: the radius is doubled once, then the vertex's own plane stays. */
PELL_NODISCARD enum pell_result layered_planes_fit(const struct layered_cloud *cloud, float (*plane)[4]);

extern const struct pell_method_engine layered_cpu;

#endif
