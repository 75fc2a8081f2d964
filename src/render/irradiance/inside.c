/* SPDX-License-Identifier: MIT
 *
 * inside.c - what the shape of a solid and the light inside of it do to the light of a packet: factors of what enters, and what is
 * transmitted. */
#include "render/irradiance/internal.h"

#include "math/scalar.h"
#include "render/curvature/stage.h"
#include "render/indirect/stage.h"

#define LEAST_STRAIGHT 1e-4f /* share of transmitted light for which rays are sent: more than what rounding leaves of none */

/* What a ball returns of even light by single scattering, over a half-space: 1/(1 - mean free path over radius), within 5 % for radii of 5
 * and more mean free paths. Less than diffusion's gain, as such light goes less far. Thin parts keep the same share of it as of all. */
static void gain_of_once(const struct pell_lanes *l, float gain[3][PELL_LANES])
{
    float inverse_eta[PELL_LANES];

    for (int i = 0; i < PELL_LANES; i++)
        inverse_eta[i] = sqrtf(l->single_eta2[i]);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++) {
            const float bend = inverse_eta[i] > 0.0f ? l->shift[c][i] / inverse_eta[i] : 0.0f;
            gain[c][i] = 1.0f / (1.0f - smaller(bend, 0.25f));
        }
}

static void bend_gains(const struct job *job, struct packet *k, struct gains *gains)
{
    const struct pell_surface *s = job->p->surface;
    float kept[3][PELL_LANES], of[3][PELL_LANES]; /* in thin parts: the share kept is one over the other */

    for (int i = 0; i < PELL_LANES; i++) {
        const int32_t at = k->index[i];
        struct pell_curvature_effect e = { .gain = { 1.0f, 1.0f, 1.0f },
                                           .local = { 1.0f, 1.0f, 1.0f },
                                           .opposed = { 1.0f, 1.0f, 1.0f },
                                           .opposed_local = { 1.0f, 1.0f, 1.0f } };
        if (!k->lanes.opaque[i])
            pell_curvature_effect_at(job->p->curvature, s->mesh[at], s->triangle[at], s->barycentric[0][at], s->barycentric[1][at], &e);
        k->flat[i] = e.flat;
        for (int c = 0; c < 3; c++) {
            gains->all[c][i] = job->p->flat ? 1.0f : pell_irradiance_gain(job->p, &e)[c];
            gains->between[c][i] = job->p->flat ? 1.0f : e.opposed_local[c];
            kept[c][i] = job->p->local && e.gain[c] > 0.0f ? e.local[c] : 1.0f;
            of[c][i] = job->p->local && e.gain[c] > 0.0f ? e.gain[c] : 1.0f;
            gains->once[c][i] = 1.0f;
            k->lanes.shift[c][i] = e.shift[c];
        }
    }
    if (!k->lanes.any_single)
        return;
    gain_of_once(&k->lanes, gains->once);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++)
            gains->once[c][i] = gains->once[c][i] * kept[c][i] / of[c][i];
}

void pell_scale_lanes(const struct gains *gains, struct packet *k)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < k->count; i++) {
            k->sums.irradiance[c][i] *= gains->all[c][i];
            k->sums.single[c][i] *= gains->once[c][i];
        }
}

static float tilted(const struct pell_lanes *l, int i, const float tilt[3])
{
    const struct pell_vec3 v = vec3(l->vx[i], l->vy[i], l->vz[i]), n = vec3(l->nx[i], l->ny[i], l->nz[i]);

    return pell_tilted(l->inverse_eta2[i], vec3_dot(vec3_mad(v, -l->nv[i], n), vec3_load(tilt)));
}

/* Takes `gains` over where light in the solid was solved. */
static void look_inside(const struct job *job, struct packet *k, struct gains *gains, struct inside *in)
{
    const struct pell_surface *s = job->p->surface;

    for (int i = 0; i < PELL_LANES; i++) {
        const int32_t at = k->index[i];
        struct pell_indirect_inside q = { .thick = { 0.0f } };
        if (!k->behind && !k->lanes.opaque[i])
            pell_indirect_look(job->p->through, s->mesh[at], s->triangle[at], s->barycentric[0][at], s->barycentric[1][at], &q);
        k->straight[i] = 0;
        for (int c = 0; c < 3; c++) {
            if (job->p->between)
                gains->all[c][i] += q.thick[c] * (gains->between[c][i] - gains->all[c][i]);
            if (!job->p->whole)
                gains->all[c][i] = q.gain[c] + (1.0f - q.solved[c]) * gains->all[c][i];
            const float leaves = (1.0f + q.deep[c] * (k->lanes.pass[c][i] - 1.0f)) * tilted(&k->lanes, i, q.tilt[c]);
            in->through[c][i] = job->entering ? 0.0f : leaves * q.through[c];
            in->solved[c][i] = q.solved[c];
            in->light[c][i] = job->entering ? 0.0f : leaves * q.light[c];
            in->thick[c][i] = q.thick[c];
            k->straight[i] |= -(int32_t) ((1.0f - q.thick[c]) * (1.0f - q.solved[c]) > LEAST_STRAIGHT);
        }
    }
}

void pell_prepare_side(const struct job *job, struct packet *k, struct gains *gains, struct inside *inside)
{
    for (int i = 0; i < PELL_LANES; i++) {
        k->straight[i] = -1;
        k->flat[i] = 1.0f;
    }
    if (job->p->curvature)
        bend_gains(job, k, gains);
    if (job->p->through)
        look_inside(job, k, gains, inside);
}

void pell_add_inside(const struct inside *in, struct packet *k)
{
    for (int i = 0; i < k->count; i++) {
        float all = 0.0f, kept = 0.0f;
        for (int c = 0; c < 3; c++) {
            all += k->sums.transmitted[c][i];
            kept += k->sums.transmitted[c][i] * (1.0f - in->thick[c][i]) * (1.0f - in->solved[c][i]);
        }
        k->sums.way[i] *= all > 0.0f ? kept / all : 0.0f;
    }
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++) {
            const float straight = k->sums.transmitted[c][i], other = straight * (1.0f - in->thick[c][i]) + in->through[c][i];
            k->sums.transmitted[c][i] = in->light[c][i] + (1.0f - in->solved[c][i]) * other;
        }
}
