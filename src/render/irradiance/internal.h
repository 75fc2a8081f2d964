/* SPDX-License-Identifier: MIT
 *
 * internal.h - declarations shared by the files of the stage: the job of one call, and its packets of 16 points. Private to the folder.
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
    bool entering_only;    /* only entering light is required: no highlights */
    struct pell_rect rect; /* in whole tiles */
    int columns;
    int first_tile;              /* of the current batch */
    uint32_t *slots;             /* per packet of the batch: first of its points on the device, in order of tiles; NULL: no device */
    bool transmission_by_device; /* the device computes transmission, too */
    _Atomic int64_t rays, device_rays, through_rays;
};

/* 16 pixels and their sums. */
struct packet {
    struct pell_lanes lanes;
    struct pell_sums sums;
    struct pell_aim aim;
    struct pell_points16 points; /* for the lookup of curvature, light inside solids and indirect light */
    _Alignas(64) int32_t index[16];
    uint32_t material[16];
    int32_t straight[16];                                  /* -1: lanes with straight transmission */
    float flat[16];                                        /* fraction of its path length by which straight light spreads:
                                                            * pell_spread_path_fraction */
    float ambient[16];                                     /* visibility of the environment's smooth part */
    const struct pell_indirect_forward *forward_model[16]; /* NULL: no forward scattering in this lane; */
    float forward[3][16];                                  /* forward-scattered light from nearby, */
    float toward[16][3], spacing[16];                      /* refracted direction toward the camera; see struct pell_indirect_beam */
    bool any_forward;
    int count;
    int64_t cached_material;                 /* material whose values all lanes hold; -1: none */
    bool one_material;                       /* all lanes have one material */
    bool textured;                           /* some lane's texture may colour entering light */
    bool far_side;                           /* for the far sides of thin sheets */
    bool lit_by_device;                      /* the device computed direct light, */
    bool transmission_by_device;             /* and transmission */
    uint32_t slot;                           /* slot of the first lane there */
    int64_t rays, device_rays, through_rays; /* on the CPU; on the device, for direct light and for transmission */
};

static inline bool pell_any_environment(const struct job *job)
{
    bool any = false;

    for (size_t e = 0; e < job->lights->num_environments; e++)
        any |= pell_irradiance_requests(job->p, job->lights->environments[e].light);
    return any;
}

/* Whether highlights are required. */
static inline bool shows_highlights(const struct job *job, const struct packet *k)
{
    return !job->entering_only && !k->far_side;
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

/* Fills the lanes of a packet whose count, indices and materials are set; (x, y) seed the sample patterns; `position`: see struct
 * pell_lane_input. */
void pell_load_packet(const struct job *job, struct packet *k, const int32_t *x, const int32_t *y, const float *const *position);
/* Turns the lanes to the far sides of thin sheets. */
void pell_turn_packet(struct packet *k);

/* --- device_light.c: direct light from the device ------------------------------------------------------------------------------------- */

/* Writes the packet's points to the batch, followed by those of the far sides of thin sheets, repeated for each of `samples`
 * multisamples from the job's on. Returns the slot of the first. */
uint32_t pell_send_packet(const struct job *job, struct packet *k, int samples);
/* Points of a packet for one multisample. */
static inline uint32_t pell_packet_points(const struct packet *k)
{
    return k->lanes.any_thin ? 2 * PELL_LANES : PELL_LANES;
}
/* Reads the light of point, spot, area and directional lights; and that of environment e's lights, with the visibility of its smooth
 * part if the packet does not have it. */
void pell_read_lights(const struct job *job, struct packet *k);
void pell_read_environment(const struct job *job, struct packet *k, size_t e, struct pell_sums *sums);
/* Reads the transmission through thin parts. */
void pell_read_transmitted(const struct job *job, struct packet *k);
/* Reads the exit of lane i's inward ray: the transmitted fraction of the environments' smooth part at that normal, and the distance m in
 * mm. Returns false if there is none. */
bool pell_read_exit(const struct job *job, const struct packet *k, int i, float fraction[3], float *m, struct pell_vec3 *normal);

/* --- shadow.c -------------------------------------------------------------------------------------------------------------------- */

/* Sets visible = mask where rays are not occluded. `coherent`: the rays have similar directions. */
void pell_trace_occlusion(const struct job *job, struct packet *k, const int32_t *mask, bool coherent, struct pell_ray16 *rays,
                          int32_t *visible);
/* The same for points that a light may reach, by the light's grid. Returns false if the light has none, or the points are not
 * neighbours. */
bool pell_query_light_grid(const struct pell_light_source *source, struct packet *k, const int32_t *mask, const float *x, const float *y,
                           const float *z, int32_t *visible);
/* Follows occluded rays through media: the fraction of the light that passes. Returns false if there is none, with `through` undefined. */
bool pell_follow_shadow(const struct job *job, struct packet *k, const int32_t *occluded, const struct pell_ray16 *rays, bool ambient,
                        float through[3][PELL_LANES]);
/* Adds what media pass of the light of the front lanes that are not visible. */
void pell_pass_shadow(const struct job *job, const struct pell_light_data *data, const int32_t *visible, struct packet *k,
                      struct pell_sums *sums);
/* Fraction of cosine-distributed directions about the normal from which light arrives: unoccluded, or what passes media. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, uint32_t salt, struct pell_sky *sky,
                             float fraction[PELL_LANES]);

/* --- transmission.c -------------------------------------------------------------------------------------------------------------- */

/* Adds the transmission of a light behind the lanes of aim->back through thin parts. `source`: the light; for directional lights that
 * differ per lane, the first. */
void pell_transmit_light(const struct job *job, const struct pell_light_source *source, struct pell_aim *aim, struct packet *k);
/* Adds the forward-scattered light from nearby of such a light to k->forward, in the lanes of aim->back. */
void pell_transmit_forward(const struct job *job, const struct pell_light_source *source, const struct pell_aim *aim, struct packet *k);
/* Adds the transmission of the environments' smooth part: a ray along the inward normal finds A, ambient visibility there its shadow. */
void pell_transmit_environment(const struct job *job, struct packet *k);
/* The same where the device computed A and its shadow. */
void pell_read_environment_transmitted(const struct job *job, struct packet *k);

/* --- inside.c -------------------------------------------------------------------------------------------------------------------- */

/* Fills k->points for a surface with its hits. */
void pell_find_points(const struct job *job, struct packet *k);
/* Before lights are added: sets the lanes' shift for curvature, and the lanes with straight transmission, which is not used where the
 * light in the solid was solved with better accuracy. */
void pell_prepare_inside(const struct job *job, struct packet *k, struct pell_gains *gains, struct pell_inside *inside);
/* Afterwards: scales entering light for curvature, and adds the transport through solids. */
void pell_scale_lanes(const struct job *job, const struct pell_gains *gains, struct packet *k);
void pell_add_inside(const struct job *job, struct pell_inside *inside, struct packet *k);

#endif
