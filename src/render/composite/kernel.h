/* SPDX-License-Identifier: MIT
 *
 * kernel.h - the inner loop of the composite over 16 pixels of a row, built once per SIMD level; only composite.c includes it.
 */
#ifndef PELL_COMPOSITE_LANES_H
#define PELL_COMPOSITE_LANES_H

#include "base/simd.h"
#include "lights/specular_tables.h"
#include "render/composite/stage.h"

#define LANES 16

/* What a pixel needs of its material. */
struct pell_composite_material {
    float f0, boundary_mean;
    const float *boundary; /* transmittance table of a smooth boundary, where `smooth` */
    int model;
    bool smooth;
    float out_exponent; /* of the base colour on the way out: 1 - m; 0 where the texture gives no colour */
    float in_exponent;  /* that the irradiance holds: m, or 1 */
    float in_metal;     /* 1 where the irradiance holds 1 - metallic, too */
    float scatters;     /* 1: exitance is the method's; 0: total times irradiance */
    float thin;         /* 1: a sheet, whose transmitted light is the stage's with every method */
    float total[3];
    float inverse_eta2, leave_base[3], leave_slope[3]; /* see render/angle.h */
    float metered[3];                                  /* see pell_metered */
    bool uniform;                                      /* see pell_surface_is_uniform */
    float roughness, rho_s;                            /* then */
};

struct pell_composite_row {
    const struct pell_composite_params *p;
    const struct pell_composite_material *materials;
    const float *albedo, *mean;  /* of the specular tables: [model][mu][roughness][2], [model][roughness][2] */
    bool any_smooth;             /* some material has a smooth boundary */
    bool any_texture, any_power; /* some exponent is not 0; some is not 0, 1/2 or 1 */
    int y;
};

/* Radiance of 16 pixels in its three parts; lanes that are off hold 0. */
struct pell_composite_lanes {
    float on[LANES]; /* 1 or 0 */
    float multiple[3][LANES], transmission[3][LANES], specular[3][LANES];
    float arriving[LANES]; /* luminance of the irradiance without albedo */
};

/* The specular tables cut at the last roughness that a whole block had; all zeros at first. */
struct pell_composite_cut {
    const struct pell_composite_material *material;
    float roughness, mean, albedo[PELL_ALBEDO_MU];
};

/* Of a row, by lane: luminance of what arrives, and covered pixels. */
struct pell_composite_meter {
    _Alignas(64) double met[LANES], covered[LANES];
};

struct pell_composite_kernels {
    /* False if no pixel from x (a multiple of 16) on is covered; `lanes` is left alone then. */
    bool (*shade)(const struct pell_composite_row *row, int x, struct pell_composite_cut *cut, struct pell_composite_lanes *lanes);
    /* Adds the parts, `single` among them, to the first `count` pixels of color and alpha, or writes them there, and meters. */
    void (*add)(const struct pell_composite_lanes *lanes, const float single[3][LANES], float weight, bool first, int count,
                float *const color[3], float *alpha, struct pell_composite_meter *meter);
};

/* Adds values to the first `count` pixels of a plane, or writes them there. */
static inline __attribute__((always_inline)) void pell_composite_put(const float *restrict values, float weight, bool first, int count,
                                                                     float *restrict plane)
{
    if (first)
        for (int i = 0; i < count; i++)
            plane[i] = weight * values[i];
    else
        for (int i = 0; i < count; i++)
            plane[i] += weight * values[i];
}

PELL_SIMD_TABLES(struct pell_composite_kernels, pell_composite_kernels);

#endif
