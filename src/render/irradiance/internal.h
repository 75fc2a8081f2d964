/* SPDX-License-Identifier: MIT
 *
 * internal.h - what the parts of the stage share: the job of one call, and the packets of 16 points that it is made of. Private to the
 * folder.
 */
#ifndef RENDER_IRRADIANCE_INTERNAL_H
#define RENDER_IRRADIANCE_INTERNAL_H

#include "render/irradiance/device_data.h"
#include "render/irradiance/inside_kernel.h"
#include "render/irradiance/sky_kernel.h"
#include "scene/material_maps.h"

struct job {
    const struct pell_irradiance_params *p;
    const struct pell_lights *lights;
    const struct pell_shade_kernels *kernels;
    const struct pell_inside_kernels *inside;
    const struct pell_sky_kernels *sky;
    struct pell_shade_tables tables;
    struct pell_lighting *out;
    bool entering;         /* only what enters is asked for: no highlights */
    struct pell_rect rect; /* whole tiles */
    int columns;
    int first_tile;  /* of the batch that is made */
    uint32_t *slots; /* of the batch's packets: first of their points on the device, in order of tiles; NULL: no device */
    bool passed;     /* what is transmitted is found on the device, too */
    _Atomic int64_t rays, device_rays, through_rays;
};

/* 16 pixels and what is summed for them. */
struct packet {
    struct pell_lanes lanes;
    struct pell_sums sums;
    struct pell_aim aim;
    struct pell_points16 points; /* where curvature, or light inside of solids or from other surfaces, is looked for */
    _Alignas(64) int32_t index[16];
    uint32_t material[16];
    int32_t straight[16];                                  /* lanes for which transmitted light is sought straight through */
    float flat[16];                                        /* part of its way that straight light spreads by: pell_spread_part */
    float ambient[16];                                     /* visibility of the environment's smooth rest */
    const struct pell_indirect_forward *forward_model[16]; /* NULL: the lane passes no light forward; */
    float forward[3][16];                                  /* what it passes that comes from near, */
    float toward[16][3], spacing[16];                      /* toward the refracted view; see struct pell_indirect_beam */
    bool any_forward;
    int count;
    int64_t held;                            /* the material whose traits all lanes have; -1: none */
    bool single;                             /* one material */
    bool textured;                           /* the colour of some lane's texture may enter */
    bool behind;                             /* the far sides of thin sheets */
    bool given;                              /* direct light was found on the device, */
    bool passed;                             /* and so was what is transmitted */
    uint32_t slot;                           /* there, of the first lane */
    int64_t rays, device_rays, through_rays; /* by the cpu; by the device, for direct light and for what is transmitted */
};

/* Whether the caller asked for this light of the scene. */
static inline bool pell_light_counts(const struct job *job, int light)
{
    return job->p->lights == 0 || (job->p->lights & pell_light_bit((size_t) light));
}

static inline bool pell_any_environment(const struct job *job)
{
    bool any = false;

    for (size_t e = 0; e < job->lights->num_environments; e++)
        any |= pell_light_counts(job, job->lights->environments[e].light);
    return any;
}

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

/* --- load.c ---------------------------------------------------------------------------------------------------------------------- */

/* Fills the lanes of a packet that has its count, indices and materials; (x, y) name the patterns of samples; `place`: see struct
 * pell_lane_input. */
void pell_load_packet(const struct job *job, struct packet *k, const int32_t *x, const int32_t *y, const float *const *place);
/* Turns to the far sides of thin sheets. */
void pell_turn_packet(struct packet *k);

/* --- given.c: direct light from the device ----------------------------------------------------------------------------------------- */

/* Writes the packet's points to the batch, those of the far sides of thin sheets behind them, and all once more for each further of
 * `samples` multisamples from the job's on. Returns the slot of the first. */
uint32_t pell_send_packet(const struct job *job, struct packet *k, int samples);
/* Points of a packet for one multisample. */
static inline uint32_t pell_packet_points(const struct packet *k)
{
    return k->lanes.any_thin ? 2 * PELL_LANES : PELL_LANES;
}
/* What the lights that are no environment's gave; and those of environment e, with the visibility of its smooth rest, where the packet does
 * not have it. */
void pell_take_lights(const struct job *job, struct packet *k);
void pell_take_environment(const struct job *job, struct packet *k, size_t e, struct pell_sums *sums);
/* What lights send through thin parts. */
void pell_take_transmitted(const struct job *job, struct packet *k);
/* Where lane i is seen straight through: the share of the environments' smooth rest at that normal that gets through, m mm. False: none. */
bool pell_take_exit(const struct job *job, const struct packet *k, int i, float share[3], float *m, struct pell_vec3 *normal);

/* --- shadow.c -------------------------------------------------------------------------------------------------------------------- */

/* visible = mask where nothing is in the way. `coherent`: the rays go much the same way. */
void pell_trace_occlusion(const struct job *job, struct packet *k, const int32_t *mask, bool coherent, struct pell_ray16 *rays,
                          int32_t *visible);
/* The same for points that a light may reach, where the light has a grid and the points are neighbours; else false. */
bool pell_ask_light_grid(const struct pell_light_source *source, struct packet *k, const int32_t *mask, const float *x, const float *y,
                         const float *z, int32_t *visible);
/* Share of cosine-distributed directions about the normal that see nothing. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, uint32_t salt, struct pell_sky *sky,
                             float share[PELL_LANES]);

/* --- transmission.c -------------------------------------------------------------------------------------------------------------- */

/* Adds what a light behind the lanes of aim->back sends through thin parts. `source`: the light, or of directional ones, each seen from
 * other lanes, the first. */
void pell_transmit_light(const struct job *job, const struct pell_light_source *source, struct pell_aim *aim, struct packet *k);
/* Adds to k->forward what such a light sends forward through the lanes of aim->back, from near. */
void pell_transmit_forward(const struct job *job, const struct pell_light_source *source, const struct pell_aim *aim, struct packet *k);
/* The same of the environments' low-frequency remainder: a ray along the inward normal finds A, ambient visibility there its shadow. */
void pell_transmit_environment(const struct job *job, struct packet *k);
/* The same where the device has found A and its shadow. */
void pell_take_environment_transmitted(const struct job *job, struct packet *k);

/* --- inside.c -------------------------------------------------------------------------------------------------------------------- */

/* Fills in k->points, of surfaces that have their hits. */
void pell_find_points(const struct job *job, struct packet *k);
/* Before the lights are added up: what curvature does to light of a direction (lanes' shift), and for which lanes transmitted light is
 * sought straight through: not where light in the solid was solved, and that is better. */
void pell_prepare_side(const struct job *job, struct packet *k, struct pell_gains *gains, struct pell_inside *inside);
/* Afterwards: what curvature does to all that enters, and what goes through solids otherwise. */
void pell_scale_lanes(const struct job *job, const struct pell_gains *gains, struct packet *k);
void pell_add_inside(const struct job *job, struct pell_inside *inside, struct packet *k);

#endif
