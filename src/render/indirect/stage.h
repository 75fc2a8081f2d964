/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "indirect": light that leaves a surface and enters again, at another place of the same solid, at another object, at the
 * ground.
 *
 *     E_i(x) = Int T(w.n) L(x, w) (w.n) dw,   L(x, w) = T_out(w) / (pi n_out) M(y),   M(y) = rho(y) (E(y) + E_i(y))
 *
 * y is what the ray from x along w meets. Radiosity (Goral et al. 1984) on samples of the surfaces: each gathers over rays, and where each
 * ray ends is kept, as a link to the sample there, so that lights may change at the cost of a sum over the links. What the samples receive
 * is interpolated to knots, the vertices of the meshes and of large triangles that are cut into smaller ones, and from knots to any point
 * of a triangle, as in irradiance caching (Ward et al. 1988).
 *
 * A bounce is a way through the open from a surface to a surface, as the knob bounces of path-trace counts them: after n of them E + E_i
 * has the first n + 1 terms of the series.
 *
 * A thin sheet sends on, beside what it reflects, what its other side received, and so do thin parts of a solid, by a slab's R and T.
 *
 * rho is the total diffuse reflectance: light leaves where it entered, not spread by the profile. What a translucent surface reflects
 * without letting it in goes on, too, and enters where it lands (mirror.c); one reflection on each way. Highlights of opaque
 * materials light nothing.
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
    bool smooth;                      /* boundary of translucent materials: Fresnel's F_t in place of rho_dt */
    int samples;                      /* of all surfaces, about */
    uint32_t seed;                    /* of the rays' directions */
    bool through;                     /* for pell_indirect_send_through alone: no links */
    const struct pell_indirect *like; /* one of the same scene and `samples`, whose samples it borrows; NULL: none */
};

/* Samples and links: what does not depend on lights. *out is NULL where no surface can light another. Borrows what `params` points to. The
 * same bits for any number of threads. */
PELL_NODISCARD enum pell_result pell_indirect_create(struct pell_context *ctx, struct pell_pool *pool,
                                                     const struct pell_indirect_params *params, struct pell_indirect **out);
void pell_indirect_destroy(struct pell_indirect **indirect);

/* Light that the scene's lights send to points, without indirect light: pell_services.light_points and its first argument. */
struct pell_indirect_lights {
    int64_t (*light_points)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                            const struct pell_surface_light *out);
    void *engine;
};

/* `total`: per scene material, the total reflectance of its profile. `bounces` >= 1: how often light leaves and enters again. */
PELL_NODISCARD enum pell_result pell_indirect_solve(struct pell_indirect *indirect, struct pell_pool *pool,
                                                    const struct pell_indirect_lights *lights, const float (*total)[3], int bounces);

/* Share of the light that translucent surfaces get which others sent, [0, 1]. 0 of NULL. */
float pell_indirect_diffuse(const struct pell_indirect *indirect);

/* What lets light through in place of the above, with params.through; per scene material. */
struct pell_indirect_solid {
    struct pell_opposed law;            /* amount 0: nothing goes through */
    struct pell_forward forward;        /* what is scattered forward, where `beams` */
    float returned[3];                  /* of light that enters a half-space: no more of even light goes through to a place */
    float white[3];                     /* what it is multiplied by where it leaves */
    float refracted;                    /* mean cosine of diffuse light behind the boundary */
    float slope[3];                     /* what of light that enters is returned more for its angle: 1 + slope (1 - m) (render/angle.h) */
    const struct pell_profile *profile; /* of R, G and B, as the method spreads light by over the faces that it sees, */
    bool around;                        /* or along all the surface, */
    bool all;                           /* or over the whole solid, turned by `law` */
    bool beams;
    bool between; /* what goes between faces is summed where it is not solved */
};
/* Light inside of the solids, from where it enters to where it leaves: solved where the samples are near enough to each other
 * (Decision 37), else what goes between faces that look elsewhere (optics/medium/opposed.h), but with `all`. */
PELL_NODISCARD enum pell_result pell_indirect_send_through(struct pell_indirect *indirect, struct pell_pool *pool,
                                                           const struct pell_indirect_lights *lights,
                                                           const struct pell_indirect_solid *solid);

/* What it is at a point of a triangle. */
struct pell_indirect_inside {
    float thick[3];   /* [0, 1]: how far `through` stands for all that gets through. Where a part is thin beside the distance of samples a
                       * slab's T is better */
    float through[3]; /* radiant exitance between faces that look elsewhere, W/m^2 without its albedo, times `thick` */
    float solved[3];  /* [0, 1]: how far what follows holds, in place of `through`, of T, and of what curvature does but with `all` */
    float gain[3];    /* factor of what enters there, or with `all` of what the method finds, times `solved`; */
    float light[3];   /* and radiant exitance that is added, W/m^2 without its albedo, times `solved` */
    float tilt[3][3]; /* of the light from the depth, see find_tilt in through.c; */
    float deep[3];    /* [0, 1]: how far it leaves as from parts that are thick */
};
/* Light there that was scattered forward. */
struct pell_indirect_beam {
    float light[3];  /* its radiance, times what light that leaves evenly has exitance for, W/m^2 without its albedo; without what entered
                      * near, see pell_indirect_far */
    float way[3][3]; /* and the mean of its directions, times that */
    float spacing;   /* mm between samples there; 0: there is none */
    float turned[3]; /* and the mean cosine of what goes on to the way that it came by, times that */
};
/* The same at 16 points. */
struct pell_indirect_insides {
    _Alignas(64) float thick[3][16], through[3][16], solved[3][16], gain[3][16], light[3][16], tilt[3][3][16], deep[3][16], none[16];
    float beam[3][16], way[3][3][16], spacing[16], turned[3][16];
    bool beams; /* else these are not written */
};
/* At points of triangles: mesh, triangle, u and v of `at`; nothing where `ask` is 0. */
void pell_indirect_look(const struct pell_indirect *indirect, const struct pell_points16 *at, const int32_t *ask,
                        struct pell_indirect_insides *out);

/* Light of one of the 16 points, and of a channel, that was scattered forward, as it leaves toward the camera, whose refracted direction is
 * `inside`, unit. */
static inline float pell_beam_toward(const struct pell_indirect_insides *q, int i, int c, const float inside[3])
{
    const float over = q->beam[c][i] > 0.0f ? 1.0f / q->beam[c][i] : 0.0f;
    const float mean[3] = { over * q->way[c][0][i], over * q->way[c][1][i], over * q->way[c][2][i] };

    return q->beam[c][i] > 0.0f ? q->beam[c][i] * pell_forward_toward(mean, over * q->turned[c][i], inside) : 0.0f;
}

/* What is scattered forward through a material. */
struct pell_indirect_ahead {
    struct pell_forward law;
    float apart[3]; /* how far it is apart from diffuse light; */
    float share[3]; /* radiance inside is multiplied by that for what struct pell_indirect_beam holds */
    bool is;
};
/* NULL: nothing is. */
const struct pell_indirect_ahead *pell_indirect_ahead(const struct pell_indirect *indirect, size_t material);

#define PELL_INDIRECT_NEAR 2.0f   /* times the distance of samples: light that entered nearer is not summed, */
#define PELL_INDIRECT_BEYOND 4.0f /* and farther all of it */
/* How far the sum over samples has light that was scattered forward and entered `distance` mm away. Where it entered is not known as
 * well as that for what is near: rays look for it (irradiance/transmission.c). */
static inline float pell_indirect_far(float distance, float spacing)
{
    return smooth_ramp(PELL_INDIRECT_NEAR * spacing, PELL_INDIRECT_BEYOND * spacing, distance);
}

/* Whether anything in it is scattered forward: pell_indirect_words has none of that. */
bool pell_indirect_has_beams(const struct pell_indirect *indirect);

/* With `all`: scales `exitance`, what a method found at the surface's translucent pixels. `angle`: per scene material; NULL: light from the
 * depth leaves as it does from half-spaces. */
void pell_indirect_correct(const struct pell_indirect *indirect, struct pell_pool *pool, const struct pell_view *view,
                           const struct pell_angle *angle, const struct pell_surface *surface, float *const exitance[3]);

/* Indirect light that enters at points of triangles (mesh, triangle, u and v of `at`), without its albedo: W/m^2. `back`: not 0 at the side
 * from which the triangle's corners run clockwise; translucent materials have none. `behind`: radiant exitance, by a slab's T, of indirect
 * light that enters across a thin part of the solid; may be NULL. The fourth of both is 0. A mesh or triangle that there is not has no
 * light. */
void pell_indirect_at(const struct pell_indirect *indirect, const struct pell_points16 *at, const int32_t *back, float rgb[4][16],
                      float behind[4][16]);

/* What pell_indirect_at or, with params.through, pell_indirect_look reads, for a device: words of 32 bits. Returns how many; `out` NULL:
 * they are not written.
 *   first words of roots, cells and values, numbers of the meshes' knots and of all; of each mesh first_knot, first_back and first_root; a
 *   root for each triangle; cells of child and three knots; values of 6 floats (light, and that from behind), or of 32
 *   (struct pell_indirect_inside and 5 of no meaning). */
enum { PELL_INDIRECT_HEAD = 8 };
size_t pell_indirect_words(const struct pell_indirect *indirect, uint32_t *out);

#endif
