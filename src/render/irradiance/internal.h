/* SPDX-License-Identifier: MIT
 *
 * internal.h - what the parts of the stage share: the job of one call, and the packets of 16 points that it is made of. Private to the
 * folder.
 */
#ifndef RENDER_IRRADIANCE_INTERNAL_H
#define RENDER_IRRADIANCE_INTERNAL_H

#include "render/irradiance/kernel.h"
#include "scene/material_maps.h"

struct job {
    const struct pell_irradiance_params *p;
    const struct pell_lights *lights;
    const struct pell_shade_kernels *kernels;
    struct pell_shade_tables tables;
    struct pell_lighting *out;
    bool entering;         /* only what enters is asked for: no highlights */
    struct pell_rect rect; /* whole tiles */
    int columns;
    _Atomic int64_t rays;
};

/* 16 pixels and what is summed for them. */
struct packet {
    struct pell_lanes lanes;
    struct pell_sums sums;
    struct pell_aim aim;
    _Alignas(64) int32_t index[16];
    uint32_t material[16];
    int32_t straight[16]; /* lanes for which transmitted light is sought straight through */
    float flat[16];       /* share of the variance of a slab with which straight light spreads: struct pell_curvature_effect */
    float ambient[16];    /* visibility of the environment's smooth rest */
    int count;
    int64_t held;  /* the material whose traits all lanes have; -1: none */
    bool single;   /* one material */
    bool textured; /* the colour of some lane's texture may enter */
    bool behind;   /* the far sides of thin sheets */
    int64_t rays;
};

/* Whether light that is mirrored is asked for. */
static inline bool shows_highlights(const struct job *job, const struct packet *k)
{
    return !job->entering && !k->behind;
}

static inline float max0(float x)
{
    return x > 0.0f ? x : 0.0f;
}

static inline int count_lanes(const int32_t *mask)
{
    int n = 0;
    for (int i = 0; i < PELL_LANES; i++)
        n -= mask[i];
    return n;
}

static inline struct pell_env_query lane_query(const struct job *job, const struct packet *k, int i)
{
    const size_t material = k->material[i];
    return (struct pell_env_query) {
        .model = (enum pell_specular_model) job->p->tables->model[material],
        .roughness = k->lanes.roughness[i],
        .f0 = k->lanes.fd[i],
        .rho_s = k->lanes.rho[i],
        .smooth = k->lanes.smooth[i] ? job->lights->eta_slot[material] : -1,
    };
}

/* --- shadow.c -------------------------------------------------------------------------------------------------------------------- */

/* visible = mask where nothing is in the way. */
void pell_trace_occlusion(const struct job *job, struct packet *k, const int32_t *mask, struct pell_ray16 *rays, int32_t *visible);
/* The same for points that a light may reach, where the light has a grid and the points are neighbours; else false. */
bool pell_ask_light_grid(const struct pell_light_source *source, struct packet *k, const int32_t *mask, const float *x, const float *y,
                         const float *z, int32_t *visible);
/* Share of cosine-distributed directions about the normal that see nothing. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, const struct pell_vec3 *origin,
                             const struct pell_vec3 *normal, uint32_t salt, float *share);

/* --- transmission.c -------------------------------------------------------------------------------------------------------------- */

/* Adds what a light behind the lanes of k->aim.back sends through thin parts. */
void pell_transmit_light(const struct job *job, const struct pell_light_source *source, struct packet *k);
/* The same of the environments' low-frequency remainder: a ray along the inward normal finds A, ambient visibility there its shadow. */
void pell_transmit_environment(const struct job *job, struct packet *k);

/* --- inside.c -------------------------------------------------------------------------------------------------------------------- */

/* Factors of all light that enters, for the methods, and of what is scattered once below the surface. */
struct gains {
    float all[3][PELL_LANES], once[3][PELL_LANES];
    float between[3][PELL_LANES]; /* `all` where what goes between faces is added */
};

/* What is known of light inside of the solids; 0 where nothing is. */
struct inside {
    float thick[3][PELL_LANES]; /* share of transmitted light that is `through`, and not sought straight */
    float through[3][PELL_LANES], solved[3][PELL_LANES], light[3][PELL_LANES];
};

/* What curvature does to light that enters: to that of a direction before the lights are added up, and to all of it afterwards. */
void pell_bend_gains(const struct job *job, struct packet *k, struct gains *gains);
void pell_scale_lanes(const struct gains *gains, struct packet *k);
/* Takes `gains` over where light in the solid was solved, before what goes straight is looked for where that is better. */
void pell_look_inside(const struct job *job, struct packet *k, struct gains *gains, struct inside *in);
void pell_add_inside(const struct inside *in, struct packet *k);

#endif
