/* SPDX-License-Identifier: MIT
 *
 * layered.h - declarations shared by the files of this method. Its only external symbol is pell_method_layered.
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
    int light_samples;
    int under; /* enum layered_under */
    bool shadows;
    bool multiple;
    float diffuse;
};

/* --- medium.c: a material's layers in the form the march reads ------------------------------------------------------------------ */

PELL_NODISCARD enum pell_result layered_medium_make(struct pell_context *ctx, const struct pell_medium_layers *medium_layers,
                                                    const char *name, int under, struct layered_medium *out);
/* Adds the tint of the material's boundary. Call after layered_medium_make. */
PELL_NODISCARD enum pell_result layered_medium_color(struct pell_context *ctx, const struct pell_material *material,
                                                     struct layered_medium *m);
/* Divides a march into `count` steps. Call last. */
PELL_NODISCARD enum pell_result layered_medium_steps(struct pell_context *ctx, int count, bool equal, struct layered_medium *m);
void layered_medium_finish(struct pell_context *ctx, struct layered_medium *m);

/* --- plane_grid.c: the least-squares plane of each vertex --------------------------------------------------------------------------- */

/* Points that represent the surface of one solid (the meshes of one object with the same material): its vertices and samples of large
 * triangles. */
struct layered_cloud {
    struct pell_context *ctx;
    struct pell_pool *pool;
    size_t count, fitted;     /* number of points; the first `fitted` are vertices and get planes */
    float *position, *normal; /* xyz */
    float *weight;            /* > 0 */
    float radius;             /* mm: radius of the neighbourhood, (8) */
    const uint8_t *keep;      /* 1: the vertex already has a plane; NULL: none has */
};

/* plane[i] = unit normal n_SP and h, the signed distance in mm along the vertex normal to the plane. With fewer than 6 neighbours, or
 * neighbours that do not resemble a surface, the radius is doubled once; after that the vertex keeps its tangent plane. */
PELL_NODISCARD enum pell_result layered_planes_fit(const struct layered_cloud *cloud, float (*plane)[4]);

extern const struct pell_method_engine layered_cpu;

#endif
