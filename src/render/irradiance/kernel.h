/* SPDX-License-Identifier: MIT
 *
 * kernel.h - private to src/render/irradiance: 16 pixels in lanes, and the arithmetic on them, built once per SIMD level (shade.c).
 * Lanes that hold no pixel repeat one that does; masks say which count.
 */
#ifndef PELL_SHADE_H
#define PELL_SHADE_H

#include "base/simd.h"
#include "math/sampling.h"
#include "render/irradiance/stage.h"
#include "visibility/rays.h"

/* A point is on a smooth surface over its triangle from this share of epsilon on: more than rounding makes of a flat one. Were it all of
 * epsilon, points beside an edge, where the surface comes down to the triangle, would be dark: hairlines along edges. */
#define TERMINATOR_LIFTED (1.0f / 64.0f)

struct pell_lanes {
    _Alignas(64) float px[16], py[16], pz[16]; /* the point */
    float ox[16], oy[16], oz[16];              /* lifted off the surface on the viewer's side */
    float gx[16], gy[16], gz[16];              /* geometric normal */
    float nx[16], ny[16], nz[16];              /* shading normal */
    float vx[16], vy[16], vz[16];              /* toward the camera */
    float nv[16], gn[16];                      /* n.v, ng.n */
    float epsilon[16];
    float terminator_offset[16];  /* see struct pell_surface */
    float rho[16], fd[16];        /* rho_s, F0 of the dielectric: what enters */
    float tint[3][16], f0[3][16]; /* the highlight */
    float width2[16];             /* of the lobe */
    float fraction[16];           /* of the roughness */
    int32_t albedo_at[16];        /* into tables->albedo, flat */
    int32_t boundary_at[16];      /* smooth: into tables->boundaries, flat, in floats */
    int32_t model[16];            /* of the lobe: enum pell_specular_model */
    int32_t smooth[16];           /* -1 or 0 */
    int32_t deep[16];             /* -1: light may be transmitted from the far side */
    int32_t clear[16];            /* -1: the medium passes light forward */
    int32_t opaque[16];
    float albedo[3][16];  /* of the colour that enters */
    float through[3][16]; /* that of `transmitted`: with any_thin, which is albedo itself where a lane is no thin sheet */
    int32_t thin[16];     /* -1: a thin sheet, whose far side is lit, too; with any_thin */
    float roughness[16];
    float turned[16]; /* see struct pell_surface */
    int32_t valid[16];
    uint32_t hash[2][16];    /* random, the same for all of a block of pixels */
    uint32_t curve[16];      /* place in the block, see pell_pixel_curve */
    uint32_t first[16];      /* random */
    uint32_t pattern[2][16]; /* what the sequence's numbers are XORed with for samples of lights: pell_lane_pattern */
    float shift[3][16];      /* mean free path over radius of curvature, refracted (curvature/stage.h) */
    float inverse_eta2[16], enter_base[3][16], enter_slope[3][16], enter_mean[3][16]; /* see render/angle.h */
    float pass_base[3][16], pass_slope[3][16], pass_thick[3][16]; /* of light from the depth; 1 and 0 at points that have no view */
    float pass[3][16];
    float single_eta2[16], single_albedo[3][16], single_g[3][16]; /* see render/single.h */
    int any_smooth, any_deep, any_thin, any_single;
    int any_way;     /* the directions in which light goes on are asked for */
    int light_bits;  /* of the number of a light's samples of a frame */
    uint32_t apart;  /* of pattern: what makes samples of an environment's lights differ from pixel to pixel (pell_lights.together) */
    unsigned models; /* bit 1 << model of each that some lane has */
};

/* One sample of one light, seen from each lane. */
struct pell_aim {
    _Alignas(64) float lx[16], ly[16], lz[16]; /* unit, from the point to the light */
    float sx[16], sy[16], sz[16];              /* the far end; directional: unused */
    uint32_t at[2][16];                        /* of rect and disc, of the face: fractions of 2^32 */
    float distance[16];
    float intensity[3][16]; /* irradiance on a facing surface = intensity falloff */
    float falloff[16];
    float gl[16], nl[16];        /* ng.l, n.l */
    float spread[16];            /* solid angle that the sample stands for, sr */
    int32_t front[16], back[16]; /* -1: light may reach this side */
    int any_front, any_back;
};

/* Where lanes are read from. */
struct pell_lane_input {
    const struct pell_view *view;
    const struct pell_surface *surface;
    uint32_t seed;
    int light_bits;                    /* bits of the number of a light's samples of a frame */
    const struct pell_material *plain; /* of all lanes where it is translucent, no metal and even (surface.h); else NULL */
    const float *const *place; /* points in space, mm: lane i is at place[k][index[i]] and seen from along its geometric normal; `depth` is
                                * then the largest coordinate that it was made of. NULL: the view and the depth say where lanes are */
    const struct pell_material *const *some; /* else: of each lane that is plain, whose planes may hold anything; NULL: none is */
};

/* Lane i takes the run of 2^bits numbers of the sequence that its pixel's place on the curve says, from a random one on. The sequence is
 * linear over XOR, so the run is that of place 0, XORed with this. */
static inline void pell_lane_pattern(const struct pell_lanes *p, int i, int bits, uint32_t salt, uint32_t *u, uint32_t *v)
{
    const uint32_t start = p->curve[i] << bits | (p->first[i] & ((1u << bits) - 1));

    *u = p->hash[0][i] ^ salt ^ pell_sobol0(start);
    *v = p->hash[1][i] ^ pell_hash(salt) ^ pell_sobol1(start);
}

struct pell_sums {
    _Alignas(64) float irradiance[3][16], specular[3][16], transmitted[3][16];
    float straight[16];      /* of `transmitted`, all channels together, what went straight, */
    float way[16];           /* and that times the mm */
    float unshadowed[3][16]; /* of an environment's lights that are in its smooth table, too */
    float single[3][16];     /* scattered once, below the surface */
    float hidden[3][16];     /* what `specular` would hold more of lights with a face, if nothing were in their way, */
    float lost[3][16];       /* and `irradiance` */
    float aside[3][16];      /* with lanes.any_way: what `shift` adds to `irradiance`, */
    float once[3][16];       /* what in it stands for single scattering, */
    float way_in[3][16];     /* the refracted directions of the rest that has one, times its channels' sum, */
    float known[16];         /* and that sum */
};

/* Whether light comes from a face, so that its shadows have noise. */
static inline bool pell_light_has_face(const struct pell_light_data *light)
{
    return light->type == PELL_LIGHT_DATA_RECT || light->type == PELL_LIGHT_DATA_DISC;
}

/* Whether light is in its environment's smooth table, too. */
static inline bool pell_light_in_table(const struct pell_light_data *light)
{
    return light->environment >= 0 && !(light->flags & PELL_LIGHT_DATA_COMPACT);
}

/* The highlight of one light. */
struct pell_gloss {
    _Alignas(64) float open[3][16], hidden[3][16]; /* by points of its face that rays reach, and that they do not */
    float whole[3][16];                            /* by points and directions of the lobe, nothing in the way */
    float odds[16];                                /* pell_gloss_odds */
    float seen[16], all[16];                       /* points that rays reach; that face the surface */
};

/* The start of the tables, for gathers. */
struct pell_shade_tables {
    const float *albedo, *boundary;
};

struct pell_shade_kernels {
    /* Clears the sums and fills the lanes from the surface's planes at index[i], pixel (x[i], y[i]). fd, model, opaque, albedo_at (of
     * roughness 0), boundary_at, smooth, deep and valid are there already. */
    void (*load)(const struct pell_lane_input *input, const int32_t *index, const int32_t *x, const int32_t *y, struct pell_lanes *lanes,
                 struct pell_sums *sums);
    /* Directions, distances, intensities and masks; `u0`, `u1`: the sample's Sobol numbers. Without the projected image. */
    void (*aim)(const struct pell_light_data *light, const struct pell_lanes *lanes, uint32_t u0, uint32_t u1, struct pell_aim *aim);
    /* Adds the light of the front lanes whose `visible` is -1, what `unshadowed` adds where the light is in a table, and all lanes'
     * highlights to `gloss`, if that is not NULL. */
    void (*front)(const struct pell_light_data *light, const struct pell_shade_tables *tables, const struct pell_lanes *lanes,
                  const struct pell_aim *aim, const int32_t *visible, struct pell_gloss *gloss, struct pell_sums *sums);
    void (*begin_highlights)(const struct pell_light_data *light, const struct pell_lanes *lanes, struct pell_gloss *gloss);
    /* Adds the highlight of a light all of whose samples are in `gloss`. `sample`: the frame's. */
    void (*end_highlights)(const struct pell_light_data *light, const struct pell_lanes *lanes, uint32_t sample, struct pell_gloss *gloss,
                           struct pell_sums *sums);
    /* Adds what enters without regard to visibility to sums->unshadowed. */
    void (*unshadowed)(const struct pell_shade_tables *tables, const struct pell_lanes *lanes, const struct pell_aim *aim,
                       struct pell_sums *sums);
    /* Writes the sums of `count` lanes, with albedo, to the planes. */
    void (*store)(const struct pell_shade_tables *tables, const struct pell_lanes *lanes, const struct pell_sums *sums,
                  const int32_t *index, int count, struct pell_lighting *out);
    /* Rays of the front lanes. */
    void (*shadow_rays)(const struct pell_light_data *light, const struct pell_lanes *lanes, const struct pell_aim *aim,
                        struct pell_ray16 *rays);
};

PELL_SIMD_TABLES(struct pell_shade_kernels, pell_shade_kernels);

#endif
