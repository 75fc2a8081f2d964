/* SPDX-License-Identifier: MIT
 *
 * kernel.h - the inner loop of the composite over 16 pixels of a row, compiled once per SIMD level; only cpu.c and kernel.c include it.
 */
#ifndef PELL_COMPOSITE_KERNEL_H
#define PELL_COMPOSITE_KERNEL_H

#include "base/simd.h"
#include "lights/specular_tables.h"
#include "render/composite/stage.h"

#define LANES 16

/* Material values of a pixel. */
struct pell_composite_material {
    float f0, boundary_mean;
    const float *boundary; /* transmittance table of a smooth boundary, if `smooth` */
    int model;
    bool smooth;
    float out_exponent; /* exponent of the base colour for light that leaves: 1 - m; 0 where the texture gives no colour */
    float in_exponent;  /* exponent included in the irradiance: m, or 1 */
    float in_metal;     /* 1 where the irradiance includes 1 - metallic, too */
    float scatters;     /* 1: exitance is the method's; 0: total times irradiance */
    float thin;         /* 1: a sheet, whose transmitted light comes from the stage with every method */
    float total[3];
    float inverse_eta2, exit_base[3], exit_slope[3]; /* see render/angle.h */
    float metered[3];                                /* see pell_meter_fraction */
    bool uniform;                                    /* see pell_surface_is_uniform */
    float roughness, rho_s;                          /* with `uniform` */
};

struct pell_composite_row {
    const struct pell_composite_params *p;
    const struct pell_composite_material *materials;
    const float *albedo, *mean;  /* specular tables: [model][mu][roughness][2], [model][roughness][2] */
    bool any_smooth;             /* some material has a smooth boundary */
    bool any_texture, any_power; /* some exponent is not 0; some is not 0, 1/2 or 1 */
    int y;
};

/* Radiance of 16 pixels in its three parts; inactive lanes are 0. */
struct pell_composite_lanes {
    float on[LANES]; /* 1 or 0 */
    float multiple[3][LANES], transmission[3][LANES], specular[3][LANES];
    float arriving[LANES]; /* luminance of the irradiance without albedo */
};

/* The specular tables sliced at the last roughness of a whole block; initially zero. */
struct pell_composite_cut {
    const struct pell_composite_material *material;
    float roughness, mean, albedo[PELL_ALBEDO_MU];
};

/* Sums of a row, per lane: luminance of arriving light, and covered pixels. */
struct pell_composite_meter {
    _Alignas(64) double arriving[LANES], covered[LANES];
};

struct pell_composite_kernels {
    /* Returns false if no pixel from x (a multiple of 16) on is covered; `lanes` is unchanged then. */
    bool (*shade)(const struct pell_composite_row *row, int x, struct pell_composite_cut *cut, struct pell_composite_lanes *lanes);
    /* Adds the parts and `single` to the first `count` pixels of color and alpha, or with `first` writes them there; adds to the meter. */
    void (*add)(const struct pell_composite_lanes *lanes, const float single[3][LANES], float weight, bool first, int count,
                float *const color[3], float *alpha, struct pell_composite_meter *meter);
};

/* Adds weighted values to the first `count` pixels of a plane, or with `first` writes them there. */
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
