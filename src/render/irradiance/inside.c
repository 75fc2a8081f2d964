/* SPDX-License-Identifier: MIT
 *
 * inside.c - effects of a solid's shape, and of the light inside it, on the light of a packet: gains of entering light, and transmission.
 */
#include "render/irradiance/internal.h"

#include "shared/spread.h"

#include <string.h>

void pell_find_points(const struct job *job, struct packet *k)
{
    const struct pell_surface *s = job->p->surface;

    for (int i = 0; i < PELL_LANES; i++) {
        const int32_t at = k->index[i];
        k->points.mesh[i] = s->mesh[at];
        k->points.triangle[i] = s->triangle[at];
        k->points.u[i] = s->barycentric[0][at];
        k->points.v[i] = s->barycentric[1][at];
    }
}

/* Adds forward-scattered light toward the camera, and marks the lanes that search for forward-scattered light from nearby. */
static void add_beams(const struct job *job, const struct pell_indirect_insides *q, struct packet *k, struct pell_inside *inside)
{
    const struct pell_lanes *l = &k->lanes;

    for (int i = 0; i < PELL_LANES; i++) {
        const float v[3] = { l->vx[i], l->vy[i], l->vz[i] }, n[3] = { l->nx[i], l->ny[i], l->nz[i] };
        if (!(q->spacing[i] > 0.0f))
            continue;
        k->forward_model[i] = pell_indirect_forward(job->p->solid_light, k->material[i]);
        k->any_forward |= k->forward_model[i] != NULL;
        k->spacing[i] = q->spacing[i];
        pell_angle_inside(l->inverse_eta2[i], v, n, k->toward[i]);
        for (int c = 0; c < 3; c++)
            inside->beam[c][i] = pell_beam_toward(q, i, c, k->toward[i]);
    }
}

void pell_prepare_inside(const struct job *job, struct packet *k, struct pell_gains *gains, struct pell_inside *inside)
{
    _Alignas(64) int32_t translucent[PELL_LANES];

    for (int i = 0; i < PELL_LANES; i++) {
        translucent[i] = ~k->lanes.opaque[i];
        k->straight[i] = -1;
        k->flat[i] = 1.0f;
        k->forward_model[i] = NULL;
    }
    k->any_forward = false;
    memset(k->forward, 0, sizeof(k->forward));
    if (job->p->curvature || job->p->solid_light || job->p->indirect)
        pell_find_points(job, k);
    if (job->p->curvature) {
        struct pell_curvature_effects effects;
        pell_curvature_effects_at(job->p->curvature, &k->points, translucent, &effects);
        job->inside->apply_curvature(job->p, &effects, &k->lanes, gains);
        for (int i = 0; i < PELL_LANES; i++)
            k->flat[i] = pell_spread_path_fraction(effects.flat[i]);
    }
    if (job->p->solid_light) {
        struct pell_indirect_insides found;
        for (int i = 0; i < PELL_LANES; i++)
            translucent[i] = k->far_side ? 0 : translucent[i];
        pell_indirect_lookup16(job->p->solid_light, &k->points, translucent, &found);
        job->inside->apply_solids(job->p, &found, job->entering_only, &k->lanes, gains, inside, k->straight);
        if (found.beams && !job->entering_only)
            add_beams(job, &found, k, inside);
    }
}

void pell_scale_lanes(const struct job *job, const struct pell_gains *gains, struct packet *k)
{
    job->inside->scale_sums(gains, &k->sums);
}

void pell_add_inside(const struct job *job, struct pell_inside *inside, struct packet *k)
{
    for (int c = 0; c < 3 && k->any_forward; c++)
        for (int i = 0; i < PELL_LANES; i++)
            inside->beam[c][i] += k->forward[c][i];
    job->inside->add_transmitted(inside, &k->sums);
}
