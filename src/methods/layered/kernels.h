/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the march below 16 pixels at once, and its data.
 *
 * Single scattering below a pixel's point P is evaluated at N points M = P + x v, x = (i + 1/2) L/N, on the refracted camera ray. The
 * reference surface of M is the one where the camera ray enters (near: depth x rate) or, where the solid is thin, the one where it leaves
 * (far: depth (exit - x) exit_rate), whichever is nearer. The path from a light to M enters at K, where it makes an angle of cosine cos_K
 * with the normal:
 *
 *     by planes   n_M = normalize((1 - t) n_P + t n_SP), Q_M = P + t h n_P, |KM| = |(Q_M - M) . n_M| / max(n_M . w, 0.05)   (9), (10)
 *     by nodes    rays traced from a few points of the march (nodes), interpolated between them
 *
 * Depths of layers along the path are measured from the nearer of both surfaces: from K until s* from M, then from the reference surface of
 * M. With s* = 0, as for light from the camera's side, this is (12).
 */
#ifndef PELL_LAYERED_KERNELS_H
#define PELL_LAYERED_KERNELS_H

#include "shared/phase.h"
#include "transport/surface_color.h"
#include "visibility/rays.h"

#include <pellucid/scene.h>

enum {
    LAYERED_LANES = 16,
    LAYERED_RAY_NODES = 5,  /* nodes where rays are traced toward each light sample */
    LAYERED_MAX_NODES = 16, /* nodes with refraction=exact; the maximum */
    LAYERED_GROUP = 8,      /* light samples per call of the march */
    LAYERED_LEVELS = 16,
    LAYERED_THICKNESSES = 10,
};
#define LAYERED_FAR 1e30f          /* mm: no bottom, no exit */
#define LAYERED_GRAZING 0.05f      /* lower bound of cosines */
#define LAYERED_HORIZON 0.4f       /* below this cosine at P the path is blended with traced nodes */
#define LAYERED_RAY_OFFSET 1.2e-5f /* relative offset of a ray's origin from the surface */

/* --- A material ----------------------------------------------------------------------------------------------------------------- */

struct layered_layer {
    float depth;       /* mm to its bottom; with a map: at the map's value 1 */
    float mean;        /* mm, mean over its map */
    int pack, channel; /* -1: the same depth everywhere */
    float sigma_s[3], sigma_t[3];
    float sigma_t2[3], max_tau2; /* 1/mm: sigma_t/ln 2, so that transmittance is 2^-x; the largest channel */
    float depth_scale, middle;   /* with a map: mm per filtered texel value, see look_up in march.h */
    struct pell_phase_terms phase[3];
    bool one_phase; /* the three channels share one phase function */
};

/* Depths of up to 4 layers whose maps have the same lookup: 4 pairs of 16-bit values per texel, its own and that of the texel below, so
 * that a bilinear fetch reads 32 contiguous bytes. Values are signed: depth 0 is -32768, the largest 32767. */
struct layered_pack {
    const struct pell_texture_map *map; /* the map of the first layer in it */
    int layer[4], count;                /* -1: none */
    uint16_t *texels;                   /* owned; all mip levels, each with a border of one texel that follows the wrap mode */
    int levels;
    struct layered_level {
        int32_t offset, stride, width, height; /* texels */
    } level[LAYERED_LEVELS];
};

struct layered_medium {
    int count, packs, colors; /* packs of depths; colors 1: one more pack holds the colour of the entering light, 0: it is uniform */
    struct layered_layer *layer;
    struct layered_pack *pack;
    struct pell_tint tint; /* of the boundary */
    float eta;
    float deepest; /* mm: largest depth of a march: the deepest bottom, or where the last layer is opaque */
    float first;   /* 1/mm: sigma_t of the first layer, its smallest channel */
    int substrate; /* enum pell_substrate */
    float rest[3]; /* 1/mm, base 2 like the layers: extinction below the deepest layer, for paths that reach another surface */
    bool bottomless;
    /* Boundaries of the steps as fractions of the march: [0] down to the deepest bottom; the others for marches that end at another surface
     * after 1, 1/2, 1/4 ... of that depth. Owned, one block. */
    float *edges[1 + LAYERED_THICKNESSES];
};

/* --- A packet: 16 pixels of one material ---------------------------------------------------------------------------------------- */

/* Texture lookup of a pack: texture coordinates at x = 0, their derivatives per mm along the ray and per mm in space, and the mip level. */
struct layered_lookup {
    _Alignas(64) float u[2][16], v[2][16], du[2][16], dv[2][16]; /* [0]: near surface, [1]: far surface */
    float gu[3][16], gv[3][16];
    int32_t offset[16], stride[16];
    float width[16], height[16];
};

/* Vertex data of a pixel's triangle; the rows have the order of struct layered_packet. */
struct layered_triangle {
    float corner[3][3], normal[3][3], plane[3][4];
    float uv[PELL_LAYERS_MOST + 1][3][2]; /* by pack */
};

struct layered_packet {
    _Alignas(64) float corner[3][3][16], normal[3][3][16], plane[3][4][16]; /* of the triangle's vertices; plane: n_SP, h */
    float u[16], v[16];                                                     /* barycentric */
    float camera[3][16];                                                    /* unit, toward the camera */
    float spacing[16];                                                      /* mm per pixel at P */
    float p[3][16], n[3][16], facet[3][16], s[3][16], h[16], w[3][16];      /* P, n_P, facet normal, n_SP, h, refracted ray */
    float rate[16], length[16], gain[16];
    float exit[16], exit_rate[16], exit_normal[3][16];
    float color[3][16];      /* substrate below the deepest layer: albedo / pi */
    float entry_tint[3][16]; /* if m->colors: the part of the entry tint that is not in the pack */
    int32_t ends_deep[16];   /* -1: the march ends at the deepest layer's bottom */
    int32_t at[16];          /* indices of the pixels */
    int count;
    bool thin, shows_substrate; /* some lane has a far surface nearby; some lane shows the substrate */
    float light[3][16];         /* output: radiance */
    /* Output unless NULL: |KM| of each sample of the first light, [sample][16]. */
    float *trace;
    float *uv;                     /* raw texture coordinates of the corners: [pack][3][2][16] */
    struct layered_lookup *lookup; /* by pack */
};

/* A light sample as seen from 16 pixels. */
struct layered_light {
    bool distant;
    _Alignas(64) float to[3][16]; /* position; distant: unit direction */
    float power[3][16];           /* irradiance perpendicular to the beam; not distant: times mm^2. 0: no light */
    float planes[16];             /* weight of the path by planes, [0, 1]; the rest is by nodes */
    float seen[16];               /* by planes: visibility, 0 or 1 */
    bool any_planes, any_nodes;
    /* At each node: |KM|, cosine at K, visibility of the beam (with 1/d^2), the direction to the light inside. */
    float km[LAYERED_MAX_NODES][16], cosine[LAYERED_MAX_NODES][16], beam[LAYERED_MAX_NODES][16], dir[LAYERED_MAX_NODES][3][16];
    float tint[LAYERED_MAX_NODES][3][16]; /* if m->colors: tint of the light that enters at K */
    float *depth;                         /* depths of the layers at K: [node][layer][16]; owned by the worker */
};

struct layered_work {
    int samples;
    bool exponential;        /* else a plain sum: each sample counts for one layer */
    bool refracts, absolute; /* absolute: the paper's |n_M . w|, also for light from below */
    bool rest;               /* the part of a path below the layers has the extinction of the last layer */
    int nodes;
    float node[LAYERED_MAX_NODES]; /* t of each node */
    float max_tau2;                /* ends a march where every channel's optical depth, base 2, exceeds this; INFINITY: never */
};

struct layered_kernels {
    /* Copies vertex data to the lanes where `of` is -1. */
    void (*fill)(const struct layered_triangle *t, int packs, const int32_t *of, struct layered_packet *p);
    /* Initialises the packet from its triangles; `length` follows from the depth of the layers alone, and no exit is set. */
    void (*start)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p);
    /* Camera rays inside the solid, from P on. */
    void (*exit_rays)(const struct layered_packet *p, float size, struct pell_ray16 *rays, int32_t *valid);
    /* Sets the weight of the path by planes for each lane (`path`: enum layered_path) and makes shadow rays from P to the light; visibility
     * starts as 1. Returns the number of valid rays. */
    int (*light_rays)(const struct layered_packet *p, int path, bool shadows, struct layered_light *source, struct pell_ray16 *rays,
                      int32_t *valid);
    /* Adds the in-scattered light of `count` light samples, at most LAYERED_GROUP, to p->light. */
    void (*march)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                  const struct layered_light *sources, int count);
};

#endif
