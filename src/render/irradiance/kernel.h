/* SPDX-License-Identifier: MIT
 *
 * kernel.h - private to src/render/irradiance: 16 pixels in SIMD lanes, and the arithmetic on them; kernel.c is compiled once per SIMD
 * level. Lanes without a pixel repeat another; masks say which lanes are valid.
 */
#ifndef PELL_IRRADIANCE_KERNEL_H
#define PELL_IRRADIANCE_KERNEL_H

#include "base/simd.h"
#include "math/sampling.h"
#include "render/irradiance/stage.h"
#include "visibility/rays.h"

/* Threshold, in epsilon, from which a terminator offset is used: above the rounding error of a flat surface. With a whole epsilon, points
 * next to an edge, where the smooth surface touches the triangle, would be dark: hairlines along edges. */
#define TERMINATOR_LIFTED (1.0f / 64.0f)

struct pell_lanes {
    _Alignas(64) float px[16], py[16], pz[16]; /* position */
    float ox[16], oy[16], oz[16];              /* offset from the surface to the viewer's side: origin of shadow rays */
    float gx[16], gy[16], gz[16];              /* geometric normal */
    float nx[16], ny[16], nz[16];              /* shading normal */
    float vx[16], vy[16], vz[16];              /* toward the camera */
    float nv[16], gn[16];                      /* n.v, ng.n */
    float epsilon[16];
    float terminator_offset[16];  /* see struct pell_surface */
    float rho[16], fd[16];        /* rho_s and F0 of the dielectric, for light that enters */
    float tint[3][16], f0[3][16]; /* of the highlight */
    float width2[16];             /* squared lobe width */
    float roughness_fraction[16]; /* interpolation weight in roughness */
    int32_t albedo_at[16];        /* flat index into tables->albedo */
    int32_t boundary_at[16];      /* smooth boundary: flat index into tables->boundaries, in floats */
    int32_t model[16];            /* lobe: enum pell_specular_model */
    int32_t smooth[16];           /* -1 or 0 */
    int32_t transmits[16];        /* -1: light may be transmitted from the far side */
    int32_t scatters_forward[16]; /* -1: the medium scatters forward */
    int32_t opaque[16];
    float albedo[3][16];       /* factor of entering light */
    float transmission[3][16]; /* factor of transmitted light, with any_thin; equals albedo in lanes that are not thin sheets */
    int32_t thin[16];          /* with any_thin: -1: a thin sheet, whose far side is lit as well */
    float roughness[16];
    float slope_variance[16]; /* see struct pell_surface */
    int32_t valid[16];
    uint32_t hash[2][16];    /* random, the same for a block of pixels */
    uint32_t curve[16];      /* index in the block, see pell_pixel_curve */
    uint32_t first[16];      /* random */
    uint32_t pattern[2][16]; /* XORed with the sequence for samples of lights: pell_lane_pattern */
    float shift[3][16];      /* mean free path over radius of curvature, refracted (curvature/stage.h) */
    float inverse_eta2[16], enter_base[3][16], enter_slope[3][16], enter_mean[3][16]; /* see render/angle.h */
    float pass_base[3][16], pass_slope[3][16], pass_per_mm[3][16]; /* for light from the depth; 1 and 0 at points without a view */
    float pass[3][16];                                             /* the factor toward the camera */
    float single_eta2[16], single_albedo[3][16], single_g[3][16];  /* see render/single.h */
    int any_smooth, any_transmits, any_thin, any_single;
    int any_direction;     /* directions of the entering light are required */
    int light_bits;        /* bits of a light's sample count per frame */
    uint32_t pattern_mask; /* of `pattern`, to decorrelate samples of an environment's lights between pixels (pell_lights.together) */
    unsigned models;       /* bit 1 << model for each model in use */
};

/* One sample of one light, as seen from each lane. */
struct pell_aim {
    _Alignas(64) float lx[16], ly[16], lz[16]; /* unit, from the point to the light */
    float sx[16], sy[16], sz[16];              /* sample position; unused for directional lights */
    uint32_t at[2][16];                        /* for rect and disc lights: position on the light, as fractions of 2^32 */
    float distance[16];
    float intensity[3][16]; /* irradiance on a facing surface = intensity falloff */
    float falloff[16];
    float gl[16], nl[16];        /* ng.l, n.l */
    float solid_angle[16];       /* of the sample, sr */
    int32_t front[16], back[16]; /* -1: light may reach this side */
    int any_front, any_back;
};

/* Input of lanes. */
struct pell_lane_input {
    const struct pell_view *view;
    const struct pell_surface *surface;
    uint32_t seed;
    int light_bits;                    /* bits of a light's sample count per frame */
    const struct pell_material *plain; /* the material of all lanes, if translucent, without metal and uniform (pell_surface_is_uniform);
                                        * else NULL */
    /* Points in space, mm: lane i is at position[k][index[i]] and viewed along its geometric normal; `depth` is then the largest
     * coordinate that it was computed from. NULL: positions follow from the view and the depth */
    const float *const *position;
    const struct pell_material *const *uniform; /* otherwise: material of each untextured lane, whose planes are undefined; NULL: none */
};

/* Lane i uses the run of 2^bits elements of the sequence that its pixel's index on the curve selects, starting at a random one. The
 * sequence is linear over XOR, so the run is that of index 0, XORed with this. */
static inline void pell_lane_pattern(const struct pell_lanes *p, int i, int bits, uint32_t salt, uint32_t *u, uint32_t *v)
{
    const uint32_t start = p->curve[i] << bits | (p->first[i] & ((1u << bits) - 1));

    *u = p->hash[0][i] ^ salt ^ pell_sobol0(start);
    *v = p->hash[1][i] ^ pell_hash(salt) ^ pell_sobol1(start);
}

struct pell_sums {
    _Alignas(64) float irradiance[3][16], specular[3][16], transmitted[3][16];
    float entered[3][16];        /* part of `irradiance` that `solved` accounts for, with albedo^m, */
    float solved[3][16];         /* and its radiant exitance */
    float straight[16];          /* part of `transmitted` that went straight, sum of all channels, */
    float path[16];              /* and the same times its path length, mm */
    float unshadowed[3][16];     /* of an environment's lights that are in its smooth table as well */
    float single[3][16];         /* single scattering below the surface */
    float hidden[3][16];         /* highlights of area lights that are occluded, */
    float lost[3][16];           /* and their occluded irradiance */
    float shifted[3][16];        /* with lanes.any_direction: part of `irradiance` that `shift` adds, */
    float single_surplus[3][16]; /* part that accounts for single scattering, */
    float direction_in[3][16];   /* sum of refracted directions of the directional rest, weighted by the sum of channels, */
    float direction_weight[16];  /* and that sum of weights */
};

/* Whether a light is an area light, whose shadows are noisy. */
static inline bool pell_light_is_area(const struct pell_light_data *light)
{
    return light->type == PELL_LIGHT_DATA_RECT || light->type == PELL_LIGHT_DATA_DISC;
}

/* Whether a light is in its environment's smooth table as well. */
static inline bool pell_light_in_table(const struct pell_light_data *light)
{
    return light->environment >= 0 && !(light->flags & PELL_LIGHT_DATA_COMPACT);
}

/* Samples of the highlight of one light. */
struct pell_gloss {
    _Alignas(64) float visible[3][16], occluded[3][16]; /* by points of the light, with their MIS weights */
    float odds[16];                                     /* pell_gloss_odds */
    bool any_odds;
    float direction_factor[2][16]; /* of the current direction of the lobe, for F0 and for 1 - F0; 0 where it misses the light; */
    float mirrored[2][16], mirrored_occluded[2][16]; /* the sums of these factors */
};

/* Tables as flat arrays, for gathers. */
struct pell_shade_tables {
    const float *albedo, *boundary;
};

struct pell_shade_kernels {
    /* Clears the sums and fills the lanes from the surface's planes at index[i], pixel (x[i], y[i]). fd, model, opaque, albedo_at (for
     * roughness 0), boundary_at, smooth, transmits and valid must be set. */
    void (*load)(const struct pell_lane_input *input, const int32_t *index, const int32_t *x, const int32_t *y, struct pell_lanes *lanes,
                 struct pell_sums *sums);
    /* Samples a light: directions, distances, intensities and masks; `u0`, `u1`: the sample's Sobol numbers. Without the projected
     * image. */
    void (*aim)(const struct pell_light_data *light, const struct pell_lanes *lanes, uint32_t u0, uint32_t u1, struct pell_aim *aim);
    /* Adds the light of the front lanes with `visible` -1, and what `unshadowed` adds if the light is in a table. Adds all lanes'
     * highlights to `gloss` if that is not NULL. */
    void (*front)(const struct pell_light_data *light, const struct pell_shade_tables *tables, const struct pell_lanes *lanes,
                  const struct pell_aim *aim, const int32_t *visible, struct pell_gloss *gloss, struct pell_sums *sums);
    /* Adds the fraction `through` of the light of those front lanes with `mask` -1, which `front` found occluded. */
    void (*pass)(const struct pell_light_data *light, const struct pell_shade_tables *tables, const struct pell_lanes *lanes,
                 const struct pell_aim *aim, const int32_t *mask, const float (*through)[16], struct pell_sums *sums);
    void (*begin_highlights)(const struct pell_light_data *light, const struct pell_lanes *lanes, struct pell_gloss *gloss);
    /* Makes the rays in direction `n` of the lobe, and `mask`: the lanes whose rays hit the light. Returns false if there are none. */
    bool (*reflect)(const struct pell_light_data *light, const struct pell_lanes *lanes, uint32_t n, struct pell_gloss *gloss,
                    int32_t *mask, struct pell_ray16 *rays);
    void (*reflected)(const int32_t *visible, struct pell_gloss *gloss);
    /* Adds the highlight of a light after all of its samples were added to `gloss`. */
    void (*end_highlights)(const struct pell_light_data *light, const struct pell_lanes *lanes, const struct pell_gloss *gloss,
                           struct pell_sums *sums);
    /* Adds entering light without occlusion to sums->unshadowed. */
    void (*unshadowed)(const struct pell_shade_tables *tables, const struct pell_lanes *lanes, const struct pell_aim *aim,
                       struct pell_sums *sums);
    /* Writes the sums of `count` lanes, times albedo, to the planes. */
    void (*store)(const struct pell_shade_tables *tables, const struct pell_lanes *lanes, const struct pell_sums *sums,
                  const int32_t *index, int count, struct pell_lighting *out);
    /* Makes the shadow rays of the front lanes. */
    void (*shadow_rays)(const struct pell_light_data *light, const struct pell_lanes *lanes, const struct pell_aim *aim,
                        struct pell_ray16 *rays);
};

PELL_SIMD_TABLES(struct pell_shade_kernels, pell_shade_kernels);

#endif
