/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "indirect": light that leaves a surface and enters another: at another point of the same solid, at another object, or at
 * the ground.
 *
 *     E_i(x) = Int T(w.n) L(x, w) (w.n) dw,   L(x, w) = T_out(w) / (pi n_out) M(y),   M(y) = rho(y) (E(y) + E_i(y))
 *
 * y is the nearest hit of the ray from x along w. This is radiosity (Goral et al. 1984) on samples of the surfaces: each gathers over rays,
 * and the sample at the end of each ray is kept as a link, so that a change of lights only costs a sum over the links. The light that
 * samples receive is interpolated to knots, which are the vertices of the meshes and of large triangles that are subdivided, and from knots
 * to any point of a triangle, as in irradiance caching (Ward et al. 1988).
 *
 * A bounce is a path segment outside the solids from surface to surface, as counted by the knob bounces of path-trace: after n of them E +
 * E_i has the first n + 1 terms of the series.
 *
 * A thin sheet also sends on the light that its other side receives, and so do thin parts of a solid, by the R and T of a slab.
 *
 * rho is the total diffuse reflectance: light leaves where it entered, not spread by the profile. Light that a translucent surface reflects
 * without letting it in is followed to where it enters next (specular.c), with one reflection per segment. Highlights of opaque materials
 * light nothing.
 */
#ifndef PELL_INDIRECT_H
#define PELL_INDIRECT_H

#include "lights/specular_tables.h"
#include "optics/medium/forward.h"
#include "optics/medium/opposed.h"
#include "render/angle.h"
#include "render/services.h"
#include "render/surface/stage.h"

struct pell_indirect;

struct pell_indirect_params {
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_specular_tables *tables;
    bool smooth;                              /* smooth boundary of translucent materials: Fresnel's F_t replaces rho_dt */
    int samples;                              /* approximate count for all surfaces */
    uint32_t seed;                            /* for the directions of rays */
    bool solids_only;                         /* only for pell_indirect_solve_solids: no links */
    const struct pell_indirect *samples_from; /* of the same scene and `samples`: its samples are borrowed; NULL: none */
};

/* Creates samples and links, which do not depend on lights. *out is NULL where no surface can light another. Borrows what `params`
 * points to. The result does not depend on the number of threads, to the bit. */
PELL_NODISCARD enum pell_result pell_indirect_create(struct pell_context *ctx, struct pell_pool *pool,
                                                     const struct pell_indirect_params *params, struct pell_indirect **out);
void pell_indirect_destroy(struct pell_indirect **indirect);

/* Direct light at points: pell_services.light_points and its first argument. */
struct pell_indirect_lights {
    int64_t (*light_points)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                            const struct pell_surface_light *out);
    void *engine;
};

/* `total`: per scene material, the total reflectance of its profile. `bounces` >= 1: how often light leaves a surface and enters
 * another. */
PELL_NODISCARD enum pell_result pell_indirect_solve(struct pell_indirect *indirect, struct pell_pool *pool,
                                                    const struct pell_indirect_lights *lights, const float (*total)[3], int bounces);

/* Fraction of indirect light in the light that translucent surfaces receive, [0, 1]. 0 for NULL. */
float pell_indirect_diffuse(const struct pell_indirect *indirect);

/* Transport through a material, for params.solids_only; per scene material. */
struct pell_indirect_solid {
    struct pell_opposed opposed;        /* amount 0: no transmission */
    struct pell_forward forward;        /* forward scattering, if `beams` */
    float returned[3];                  /* fraction of uniform light that a half-space returns: limits the transmission to a point */
    float white[3];                     /* factor where light leaves */
    float refracted;                    /* mean cosine of diffuse light after refraction */
    float slope[3];                     /* surplus that oblique incidence returns: 1 + slope (1 - m) (render/angle.h) */
    const struct pell_profile *profile; /* for R, G and B */
    bool whole_solid;                   /* the method integrates over the whole solid, corrected by `opposed` */
    bool beams;
    bool between_faces; /* transport between faces is summed where diffusion is not solved */
};
/* Computes the light inside the solids, from entry to exit: by diffusion where the samples are dense enough (Decision 37), else by a sum
 * between faces of different orientation (optics/medium/opposed.h), except with `whole_solid`. `mix`: as in struct pell_plan, for light
 * that enters coloured surfaces. */
PELL_NODISCARD enum pell_result pell_indirect_solve_solids(struct pell_indirect *indirect, struct pell_pool *pool,
                                                           const struct pell_indirect_lights *lights,
                                                           const struct pell_indirect_solid *solid, float mix);

/* Light inside a solid, at a point of a triangle. */
struct pell_indirect_inside {
    float sum_weight[3];  /* [0, 1]: weight of `transmitted`, as opposed to a slab's T, which is better where a part is thin compared to
                            * the distance between samples */
    float transmitted[3]; /* radiant exitance from faces of different orientation, W/m^2, without the local albedo, times `sum_weight` */
    float solved[3];  /* [0, 1]: weight of the solved diffusion below, which replaces `transmitted`, T, and, except with `whole_solid`, the
                       * effect of curvature */
    float gain[3];    /* with `whole_solid`: factor of the method's result, times `solved`; */
    float light[3];   /* radiant exitance that is added, W/m^2, with albedo^m where light entered (with `whole_solid` times `solved`); */
    float tilt[3][3]; /* of the light that leaves, see tilt.c; */
    float deep[3];    /* [0, 1]: fraction that leaves as from thick parts; */
    union {
        float entered[3]; /* without `whole_solid`: irradiance, times albedo^m, that `light` accounts for */
        float thin[3];    /* with it: what is added to the factor 1 - `solved` of the method's result in thin round parts */
    };
};
/* Forward-scattered light at such a point. */
struct pell_indirect_beam {
    float light[3];        /* its radiance, in units of the exitance of uniform light, W/m^2 without the local albedo; excludes light that
                      * entered nearby, see pell_indirect_far_weight */
    float direction[3][3]; /* mean of its directions, times `light` */
    float spacing;         /* distance between samples, mm; 0: no light */
    float cosine[3];       /* mean cosine between the directions before and after scattering, times `light` */
};
/* The same for 16 points. */
struct pell_indirect_insides {
    _Alignas(64) float sum_weight[3][16], transmitted[3][16], solved[3][16], gain[3][16], light[3][16], tilt[3][3][16], deep[3][16];
    union {
        float entered[3][16], thin[3][16];
    };
    float none[2][16];
    float beam[3][16], direction[3][3][16], spacing[16], cosine[3][16];
    bool beams; /* false: the arrays above are not written */
};
/* Interpolates at 16 points, given by mesh, triangle, u and v of `at`; 0 where `active` is 0. */
void pell_indirect_lookup16(const struct pell_indirect *indirect, const struct pell_points16 *at, const int32_t *active,
                            struct pell_indirect_insides *out);

/* Forward-scattered light of one of the 16 points and of a channel that leaves toward the camera, whose refracted direction `inside` is
 * unit. */
static inline float pell_beam_toward(const struct pell_indirect_insides *q, int i, int c, const float inside[3])
{
    const float over = q->beam[c][i] > 0.0f ? 1.0f / q->beam[c][i] : 0.0f;
    const float mean[3] = { over * q->direction[c][0][i], over * q->direction[c][1][i], over * q->direction[c][2][i] };

    return q->beam[c][i] > 0.0f ? q->beam[c][i] * pell_forward_toward(mean, over * q->cosine[c][i], inside) : 0.0f;
}

/* Forward scattering of a material. */
struct pell_indirect_forward {
    struct pell_forward model;
    float separation[3];     /* fraction of it that diffuse light does not contain; */
    float exitance_scale[3]; /* factor from radiance inside to the units of struct pell_indirect_beam */
    bool active;
};
/* NULL: the material does not scatter forward. */
const struct pell_indirect_forward *pell_indirect_forward(const struct pell_indirect *indirect, size_t material);

#define PELL_INDIRECT_NEAR 2.0f   /* distances of samples: light that entered nearer is not summed, */
#define PELL_INDIRECT_BEYOND 4.0f /* and light from farther away is fully summed */
/* Weight of forward-scattered light that entered `distance` mm away in the sum over samples. Where nearby light entered is resolved too
 * coarsely there, so rays find it (irradiance/transmission.c). */
static inline float pell_indirect_far_weight(float distance, float spacing)
{
    return smooth_ramp(PELL_INDIRECT_NEAR * spacing, PELL_INDIRECT_BEYOND * spacing, distance);
}

/* Whether any material scatters forward: pell_indirect_words does not include that light. */
bool pell_indirect_has_beams(const struct pell_indirect *indirect);

/* With `whole_solid`: scales `exitance`, the result of a method at the translucent pixels. `angle`: per scene material; NULL: light
 * from the depth leaves as it does from half-spaces. */
void pell_indirect_correct(const struct pell_indirect *indirect, struct pell_pool *pool, const struct pell_view *view,
                           const struct pell_angle *angle, const struct pell_surface *surface, float *const exitance[3]);

/* Indirect light that enters at points of triangles (mesh, triangle, u and v of `at`), without the local albedo: W/m^2. `back`: not 0
 * for the side from which the triangle's corners run clockwise; translucent materials have no light there. `behind`: radiant exitance,
 * by a slab's T, of indirect light that enters on the other side of a thin part; may be NULL. The fourth component of both is 0. Light
 * is 0 for invalid meshes and triangles. */
void pell_indirect_at(const struct pell_indirect *indirect, const struct pell_points16 *at, const int32_t *back, float rgb[4][16],
                      float behind[4][16]);

/* Packs the data that pell_indirect_at or, with params.solids_only, pell_indirect_lookup16 reads into 32-bit words for a device. Returns
 * their number; with `out` NULL nothing is written. Layout: offsets of roots, cells and values, number of mesh knots and of all knots;
 * per mesh first_knot, first_back and first_root; a root per triangle; cells of child and three knots; values of 6 floats (light, then
 * transmitted light) or of 32 (struct pell_indirect_inside and 2 floats of padding). */
enum { PELL_INDIRECT_HEAD = 8 };
size_t pell_indirect_words(const struct pell_indirect *indirect, uint32_t *out);

#endif
