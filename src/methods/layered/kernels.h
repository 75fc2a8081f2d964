/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the march below 16 pixels at once, and what it works on.
 *
 * Below a pixel's point P light is looked for at N places M = P + x v, x = (i + 1/2) L/N along the ray of the camera below the surface. The
 * own surface of a place is the one it is seen through (near: its depth is x rate), or, where the solid is thin, the one that the ray
 * leaves through (far: its depth is (exit - x) exit_rate), whichever is nearer. A light's path to M enters at K, cos_K from the normal
 * there:
 *
 *     by planes   n_M = normalize((1 - t) n_P + t n_SP), Q_M = P + t h n_P, |KM| = |(Q_M - M) . n_M| / max(n_M . w, 0.05)   (9), (10)
 *     by nodes    rays from a few places of the march, what they find is interpolated between them
 *
 * The path counts layers by the distance to the nearer of both surfaces: from K down as far as s* from M, then below the own surface of M.
 * With s* = 0, which it is for light from in front, this is (12).
 */
#ifndef PELL_LAYERED_KERNELS_H
#define PELL_LAYERED_KERNELS_H

#include "shared/phase.h"
#include "transport/surface_color.h"
#include "visibility/rays.h"

#include <pellucid/scene.h>

enum {
    LAYERED_LANES = 16,
    LAYERED_RAYED = 5,  /* rays of a light's sample to a pixel's march */
    LAYERED_NODES = 16, /* the same of refracted paths; at most so many */
    LAYERED_GROUP = 8,  /* lights' samples in one march */
    LAYERED_LEVELS = 16,
    LAYERED_THICKNESSES = 10,
};
#define LAYERED_FAR 1e30f        /* mm: no bottom, no exit */
#define LAYERED_GRAZING 0.05f    /* cosines are this at least */
#define LAYERED_HORIZON 0.4f     /* cosine at P up to which rays are asked, too */
#define LAYERED_ROUNDING 1.2e-5f /* of coordinates: how far off the surface rays start */

/* --- A material ----------------------------------------------------------------------------------------------------------------- */

struct layered_layer {
    float depth;       /* mm to its bottom; painted: of the number 1 in its tile */
    float mean;        /* the same, the mean over its map */
    int pack, channel; /* -1: even */
    float sigma_s[3], sigma_t[3];
    float halves[3], most_halves; /* 1/mm: how often light is halved, sigma_t/ln 2; the largest of them */
    float per_number, middle;     /* painted: mm of a filtered number, see look_up in march.h */
    struct pell_phase_terms phase[3];
    bool one_phase; /* of all three channels */
};

/* Depths of up to 4 layers whose maps are looked up alike: 4 pairs of numbers of 16 bits a texel, its own and that of the texel below, so
 * that four neighbours are one fetch of 32 bytes. Numbers are signed: the depth 0 is -32768, the largest 32767. */
struct layered_pack {
    const struct pell_texture_map *map; /* of the first of them */
    int layer[4], count;                /* -1: none */
    uint16_t *texels;                   /* owned; all levels, each with a border of one texel that wraps as the texture does */
    int levels;
    struct layered_level {
        int32_t offset, stride, width, height; /* texels */
    } level[LAYERED_LEVELS];
};

struct layered_medium {
    int count, packs, colors; /* packs of depths; 1: behind them that of the colour of light that enters, 0: it is the same all over */
    struct layered_layer *layer;
    struct layered_pack *pack;
    struct pell_tint tint; /* of the boundary */
    float eta;
    float deepest; /* mm that a march goes down: the deepest bottom, or where the last layer lets nothing through */
    float first;   /* 1/mm: sigma_t of the first layer, the smallest of its channels */
    int substrate; /* enum pell_substrate */
    float rest[3]; /* 1/mm, as halves: of paths below the deepest layer that go on to another surface */
    bool bottomless;
    /* Where steps begin and end, shares of a march: of one to the deepest bottom; then of those that end at another surface, at 1, 1/2, 1/4
     * ... of that. Owned, one block. */
    float *edges[1 + LAYERED_THICKNESSES];
};

/* --- A packet: 16 pixels of one material ---------------------------------------------------------------------------------------- */

/* Where a pack is looked up: texture coordinates at x = 0 and their rise per mm along the ray; per mm in space; the level. */
struct layered_place {
    _Alignas(64) float u[2][16], v[2][16], du[2][16], dv[2][16]; /* [0]: of the near surface, [1]: of the far one */
    float gu[3][16], gv[3][16];
    int32_t offset[16], stride[16];
    float width[16], height[16];
};

/* What a pixel's triangle says, at its corners; rows of struct layered_packet in their order. */
struct layered_triangle {
    float corner[3][3], normal[3][3], plane[3][4];
    float uv[PELL_LAYERS_MOST + 1][3][2]; /* of packs */
};

struct layered_packet {
    _Alignas(64) float corner[3][3][16], normal[3][3][16], plane[3][4][16]; /* of the triangle's corners; plane: n_SP, h */
    float u[16], v[16];                                                     /* barycentric */
    float camera[3][16];                                                    /* unit, toward the camera */
    float spacing[16];                                                      /* mm that a pixel covers */
    float p[3][16], n[3][16], facet[3][16], s[3][16], h[16], w[3][16];      /* P, n_P, the triangle's normal, n_SP, h, the way inward */
    float rate[16], length[16], gain[16];
    float exit[16], exit_rate[16], exit_normal[3][16];
    float color[3][16];    /* below the deepest layer: albedo / pi */
    float enters[3][16];   /* of m->colors: the factor that is not in the picture */
    int32_t ends_deep[16]; /* -1: the march ends at the deepest layer's bottom */
    int32_t at[16];        /* pixels */
    int count;
    bool thin, shows_bottom; /* some lane's far surface counts; some lane has a color */
    float light[3][16];      /* out: radiance */
    /* out, where `trace` is not NULL: |KM| of every sample of the first light, [sample][16] */
    float *trace;
    float *uv;                   /* raw texture coordinates of the corners: [pack][3][2][16] */
    struct layered_place *place; /* of packs */
};

/* A light's sample as 16 pixels see it. */
struct layered_light {
    bool away;
    _Alignas(64) float to[3][16]; /* the place; away: the unit direction */
    float power[3][16];           /* irradiance across the beam; else that times squared mm. 0: none */
    float planes[16];             /* share of the path by planes, [0, 1]; the rest is by nodes */
    float seen[16];               /* by planes: 1, or 0 in shadow */
    bool any_planes, any_nodes;
    /* Of nodes: |KM|, cosine at K, how much of the beam is there (with 1/d^2), the way to the light inside. */
    float km[LAYERED_NODES][16], cosine[LAYERED_NODES][16], beam[LAYERED_NODES][16], way[LAYERED_NODES][3][16];
    float tint[LAYERED_NODES][3][16]; /* of m->colors: of light that enters at K */
    float *depth;                     /* of layers at K: [node][layer][16]; owned by the worker */
};

struct layered_work {
    int samples;
    bool exponential;        /* else the plain sum: each sample in one layer */
    bool refracts, absolute; /* absolute: the paper's |n_M . w| for light from below, too */
    bool rest;               /* what is left of a path below its layers is the last layer's */
    int nodes;
    float node[LAYERED_NODES]; /* t of each */
    float most_halves;         /* a march ends where all light is halved more often on its way; INFINITY: never */
};

struct layered_kernels {
    /* Rows of the lanes whose `of` is -1. */
    void (*fill)(const struct layered_triangle *t, int packs, const int32_t *of, struct layered_packet *p);
    /* Fills everything from the triangle: up to `length` by depth alone, without an exit. */
    void (*start)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p);
    /* The camera's rays inside the solid, from P on. */
    void (*leave)(const struct layered_packet *p, float size, struct pell_ray16 *rays, int32_t *valid);
    /* How much of each lane's path goes by planes (`path`: enum layered_path), and rays from P to the light, which is `seen` if nothing is
     * in their way. Returns how many are valid. */
    int (*see)(const struct layered_packet *p, int path, bool shadows, struct layered_light *source, struct pell_ray16 *rays,
               int32_t *valid);
    /* Adds the light of `count` lights, at most LAYERED_GROUP, to p->light. */
    void (*march)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                  const struct layered_light *sources, int count);
};

#endif
