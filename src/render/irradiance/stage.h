/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "irradiance": irradiance, transmitted light and specular reflection at each pixel, summed over all lights.
 *
 *     E(x) = albedo^m Sum over lights of L_i T(n . w_i) max(n . w_i, 0) V        T: rho_dt, or Fresnel's F_t of a smooth boundary
 *     M_t(x) = albedo^m Sum over lights of table(d) E(A)                         A: where the light enters the solid, see transmission.c
 *
 * Shadow rays are exact. The mix exponent m is the material's or the plan's; albedo is the base colour where the colour comes from the
 * texture, else 1. Opaque materials have m = 1 and the albedo base colour x (1 - metallic). A thin sheet reflects the fraction 1 - T of
 * that; it transmits T E of its far side, with the transmission colour.
 *
 * Where diffusion in the solid is solved (indirect/stage.h), its exitance is added to M_t, and the light that it accounts for is
 * subtracted from E. The method adds what is finer; such E may be negative.
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
    float *irradiance[3];     /* W/m^2, light that enters, times albedo^m, less `entered` */
    float *entered[3];        /* W/m^2, the part of it that the exitance of solved diffusion in `transmitted` accounts for. May be NULL */
    float *transmitted[3];    /* W/m^2, radiant exitance of transmitted light; 0 where there is none */
    float *path;              /* path length and fraction of the part of `transmitted` that went straight through the solid:
                            * pell_spread_pack(). May be NULL */
    float *specular[3];       /* W/(m^2 sr), including emission */
    float *single[3];         /* W/(m^2 sr), single scattering; written with `separate` */
    float *hidden[3];         /* W/(m^2 sr), with `shared`: highlights of area lights that shadows removed; -1 where the surface emits; */
    float *lost[3];           /* W/m^2: the same for `irradiance`, of surfaces that are opaque or blur it by less than half a pixel */
    float *shifted[3];        /* W/m^2, with `directions`: part of the entering light that the shift of curvature/stage.h moved there, */
    float *single_surplus[3]; /* part that accounts for the single scattering of diffuse light (pell_angle.enter_mean), */
    float *direction_in[3];   /* mean refracted direction of the rest, */
    float *diffuse;           /* fraction of the rest that is diffuse, all channels together */
    int64_t shadow_rays;      /* on the CPU */
    int64_t device_rays;      /* on the device, for direct light, */
    int64_t through_rays;     /* and for transmission */
};

struct pell_indirect;
struct pell_light_device;
struct pell_unscattered;

struct pell_irradiance_params {
    struct pell_light_device *device; /* computes direct light (device.h); holds these lights and has room. NULL: the CPU does */
    const struct pell_rays *rays;
    const struct pell_scene *scene;
    const struct pell_view *view;
    const struct pell_surface *surface;
    const struct pell_specular_tables *tables;           /* from pell_specular_tables_create */
    const struct pell_thickness_table *const *thickness; /* per scene material, entries may be NULL; NULL: no transmission */
    const struct pell_angle *angle;                      /* per scene material; NULL: no factors */
    const struct pell_separate_single *separate;         /* per scene material; NULL: the profile includes single scattering */
    float mix;                                           /* the plan's; negative: each material's own */
    const float *ambient;                                /* for pell_irradiance_points: visibility of the environment's smooth part at
                                                          * the points; NULL: found by rays */
    uint64_t lights;                                     /* as in struct pell_points_params */
    bool smooth;                                         /* smooth boundary: Fresnel's F_t replaces rho_dt */
    const struct pell_curvature *curvature;              /* scales light that enters translucent surfaces, whose hits are then required.
                                                          * NULL: no scaling */
    bool local;                                          /* with `curvature`: as in struct pell_curvature_effects for methods that add
                                                          * transmitted light */
    bool opposed;                                        /* the same for methods that correct the profile between faces at an angle */
    bool flat;                                           /* no scaling by curvature */
    const struct pell_indirect *indirect;                /* indirect light (indirect/stage.h); requires the surface's hits. NULL: none */
    const struct pell_indirect *solid_light;             /* light inside solids, which replaces straight transmission. NULL: none */
    const struct pell_unscattered *unscattered;          /* media that pass light into their shadows. NULL: none */
    bool whole_solid;                                    /* `solid_light` scales the method's result */
    bool transmits;                                      /* the method adds transmission through thin parts: indirect light is
                                                          * transmitted, too */
    bool between_faces;                                  /* with `local`: `solid_light` includes transport between faces */
    bool directions;                                     /* lighting->shifted, single_surplus, direction_in and diffuse are required */
    bool shared;                                         /* lighting->hidden and lost are required */
    const float (*radius)[3];                            /* with `shared`: mean radius of the profile per scene material, mm; NULL:
                                                          * nothing spreads light */
    uint32_t sample;                                     /* index of the multisample: varies the sample patterns */
    uint32_t seed;
};

/* Whether this light of the scene is requested. */
static inline bool pell_irradiance_requests(const struct pell_irradiance_params *p, int light)
{
    return p->lights == 0 || (p->lights & pell_light_bit((size_t) light));
}

/* The same for indirect light. Exactly one of disjoint sets of lights has it. */
static inline bool pell_irradiance_requests_indirect(const struct pell_irradiance_params *p)
{
    return p->lights == 0 || (p->lights & PELL_LIGHT_INDIRECT);
}

/* Factors of entering light by curvature, for R, G and B at 16 points. */
static inline const float (*pell_irradiance_gain(const struct pell_irradiance_params *p, const struct pell_curvature_effects *e))[16]
{
    return p->local ? e->local : p->opposed ? e->opposed : e->gain;
}

/* Allocates nothing. The result does not depend on the number of threads, to the bit. */
PELL_NODISCARD enum pell_result pell_irradiance_render(struct pell_pool *pool, struct pell_lights *lights,
                                                       const struct pell_irradiance_params *params, struct pell_lighting *out);

/* --- points.c: irradiance at arbitrary points ----------------------------------------------------------------------------------------- */

/* Computes what pell_irradiance_render does at pixels for arbitrary points (pell_services_light_points): same lights, tables and
 * formulas. params->surface is any allocated surface, whose planes are not read; `what` replaces the lights, sample, `local`, `flat` and
 * `opposed` of `params`. */
int64_t pell_irradiance_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                               const struct pell_points_params *what, const struct pell_surface_points *in, size_t n,
                               const struct pell_surface_light *out);

/* The same with params->device, for at most 16 points. First the points are sent to the device's batch, which is run (device.h, without
 * highlights, by `params` with the lights of `what`); then their light is read by the slot returned here. The CPU adds what the device
 * does not compute. */
uint32_t pell_irradiance_send_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                     const struct pell_points_params *what, const struct pell_surface_points *in, size_t n);
int64_t pell_irradiance_take_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                    const struct pell_points_params *what, const struct pell_surface_points *in, size_t n, uint32_t slot,
                                    const struct pell_surface_light *out);

/* --- cpu.c, for points.c ------------------------------------------------------------------------------------------------------------- */

/* Up to 16 points in space: params->surface has 4 x 4 pixels with a stride of 4, filled by pell_surface_look, with material 0 where
 * there is no point. */
struct pell_irradiance_packet {
    const float *position[3]; /* mm */
    const uint32_t *seed;     /* seeds of their sample patterns */
    uint32_t slot, sample;    /* with params->device: the slot from pell_irradiance_send, and the index among its samples */
};

/* Computes their light. Writes `albedo` and out->irradiance at points; other planes of `out` are undefined afterwards. */
void pell_irradiance_at(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                        const struct pell_irradiance_packet *at, struct pell_lighting *out, float albedo[3][PELL_LANES]);
/* Sends the points to the batch of params->device, for `samples` multisamples from params->sample on. */
uint32_t pell_irradiance_send(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                              const struct pell_irradiance_packet *at, int samples);

#endif
