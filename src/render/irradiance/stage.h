/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "irradiance": irradiance, transmitted light and specular reflection at each pixel, summed over all lights.
 *
 *     E(x) = albedo^m Sum over lights of L_i T(n . w_i) max(n . w_i, 0) V        T: rho_dt, or Fresnel's F_t of a smooth boundary
 *     through(x) = albedo^m Sum over lights of table(d) E(A)                     A: where the light enters the solid, see below
 *
 * Shadow rays are exact. The mix exponent m is the material's or the plan's; albedo is the base colour where colour comes from the
 * texture, else 1. Opaque materials: m = 1 and albedo the base colour x (1 - metallic). A thin
 * sheet reflects 1 - T of that; `through` is T E of its far side, by the transmitted colour.
 */
#ifndef PELL_IRRADIANCE_H
#define PELL_IRRADIANCE_H

#include "lights/lights.h"
#include "lights/specular_tables.h"
#include "render/angle.h"
#include "render/curvature/stage.h"
#include "render/services.h"
#include "render/single.h"
#include "render/surface/stage.h"

#include <pellucid/render.h>

struct pell_lighting {
    float *irradiance[3];  /* W/m^2, entered, with albedo^m */
    float *transmitted[3]; /* W/m^2, radiant exitance of transmitted light; 0 where there is none */
    float *way;            /* how far of `transmitted` what went straight through the solid did, and its share: pell_spread_pack(). May be
                            * NULL */
    float *specular[3];    /* W/(m^2 sr), with what the surface itself emits */
    float *single[3];      /* W/(m^2 sr), scattered once; written with `apart` */
    float *hidden[3];      /* W/(m^2 sr), with `shared`: what shadows took of the highlights of lights with a face; -1 where the surface
                            * itself emits; */
    float *lost[3];        /* W/m^2: and of `irradiance`, of opaque surfaces; methods blur that of others anyway */
    float *aside[3];       /* W/m^2, with `ways`: what of the light that enters was moved there by the shift of curvature/stage.h, */
    float *once[3];        /* what stands for the single scattering of diffuse light (pell_angle.enter_mean), */
    float *way_in[3];      /* the mean refracted direction of the rest, */
    float *diffuse;        /* and how much of that is diffuse light, of all channels together */
    int64_t shadow_rays;   /* by the cpu */
    int64_t device_rays;   /* by the device, for direct light, */
    int64_t through_rays;  /* and for what is transmitted */
};

struct pell_indirect;
struct pell_light_device;

struct pell_irradiance_params {
    struct pell_light_device *device; /* finds direct light (device.h); has these lights and room. NULL: the cpu does */
    const struct pell_rays *rays;
    const struct pell_scene *scene;
    const struct pell_view *view;
    const struct pell_surface *surface;
    const struct pell_specular_tables *tables;           /* of pell_specular_tables_create */
    const struct pell_thickness_table *const *thickness; /* per scene material, entries may be NULL; NULL: no transmission */
    const struct pell_angle *angle;                      /* per scene material; NULL: no factors */
    const struct pell_single_apart *apart;               /* per scene material; NULL: the profile has what is scattered once */
    float mix;                                           /* plan's; negative: each material's own */
    const float *ambient;                                /* of pell_irradiance_points: visibility of the environment's smooth rest at
                                                               * the points; NULL: found by rays */
    uint64_t lights;                                     /* as in struct pell_points_params */
    bool smooth;                                         /* boundary: Fresnel's F_t in place of rho_dt */
    const struct pell_curvature *curvature;              /* scales what enters translucent surfaces, which have their hits then. NULL:
                                                               * nothing is scaled */
    bool local;                                          /* with `curvature`: as struct pell_curvature_effects has it for methods that add
                                                               * transmitted light */
    bool opposed;                                        /* the same for methods that turn the profile between faces at an angle */
    bool flat;                                           /* what curvature scales light by is left out */
    const struct pell_indirect *indirect;                /* light that left a surface and enters again (indirect/stage.h); the surface
                                                               * has its hits then. NULL: none */
    const struct pell_indirect *through;                 /* light that goes through solids, in place of what is transmitted straight. NULL:
                                                               * none */
    bool whole;                                          /* `through` scales what the method finds, not what enters */
    bool passed;                                         /* the method adds what thin parts let through: `indirect`'s is, too */
    bool between;                                        /* with `local`: `through` has what goes between faces */
    bool ways;                                           /* lighting->aside, once, way_in and diffuse are wanted */
    bool shared;                                         /* lighting->hidden and lost are wanted */
    uint32_t sample;                                     /* number of the multisample: varies the sample patterns */
    uint32_t seed;
};

/* By what curvature scales the light that enters, of R, G and B at 16 points. */
static inline const float (*pell_irradiance_gain(const struct pell_irradiance_params *p, const struct pell_curvature_effects *e))[16]
{
    return p->local ? e->local : p->opposed ? e->opposed : e->gain;
}

/* Allocates nothing; the same bits for any number of threads. */
PELL_NODISCARD enum pell_result pell_irradiance_render(struct pell_pool *pool, struct pell_lights *lights,
                                                       const struct pell_irradiance_params *params, struct pell_lighting *out);

/* --- points.c: light that enters anywhere --------------------------------------------------------------------------------------- */

/* What pell_irradiance_render gives at pixels, at any points (pell_services_light_points): the same lights, tables and formulas.
 * params->surface is any surface that was allocated, its view is not read; `what` comes in place of params' sample and lights. */
int64_t pell_irradiance_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                               const struct pell_points_params *what, const struct pell_surface_points *in, size_t n,
                               const struct pell_surface_light *out);

/* The same with params->device, for at most 16 points: first they are sent to its batch, which is run (device.h, without highlights and by
 * `params` with the lights of `what`), then their light is taken by the slot that they were given. The cpu adds what the device does not
 * find. */
uint32_t pell_irradiance_send_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                     const struct pell_points_params *what, const struct pell_surface_points *in, size_t n);
int64_t pell_irradiance_take_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                    const struct pell_points_params *what, const struct pell_surface_points *in, size_t n, uint32_t slot,
                                    const struct pell_surface_light *out);

/* --- cpu.c, for points.c ------------------------------------------------------------------------------------------------------------- */

/* Up to 16 points in space: params->surface has 4 x 4 pixels with a stride of 4 and is as pell_surface_look leaves it, with material 0
 * where no point is. */
struct pell_lit_place {
    const float *place[3];  /* mm */
    const uint32_t *number; /* names their patterns */
    uint32_t slot, sample;  /* with params->device: what pell_irradiance_send said, and which of its samples this is */
};

/* Their light. Fills `albedo` and out->irradiance where a point is; its other planes hold anything then. */
void pell_irradiance_at(const struct pell_lights *lights, const struct pell_irradiance_params *params, const struct pell_lit_place *at,
                        struct pell_lighting *out, float albedo[3][PELL_LANES]);
/* Sends them to the batch of params->device, for `samples` multisamples from params->sample on. */
uint32_t pell_irradiance_send(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                              const struct pell_lit_place *at, int samples);

#endif
