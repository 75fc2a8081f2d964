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

#endif
