/* SPDX-License-Identifier: MIT
 * inside_kernel.c - see inside_kernel.h. */
#include "render/irradiance/inside_kernel.h"

#include "math/scalar.h"
#include "render/irradiance/device_data.h"
#include "render/irradiance/lanes.h"
#include "shared/curvature.h"

#include <string.h>

/* Single-scattered light travels less far, so diffusion's gain is too large for it. In thin parts both lose the same fraction. */
static void single_gain(const struct pell_lanes *restrict l, float (*restrict gain)[N])
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++)
            gain[c][i] = pell_curvature_single(l->shift[c][i], l->single_eta2[i]);
}

static void apply_curvature(const struct pell_irradiance_params *p, const struct pell_curvature_effects *restrict e,
                            struct pell_lanes *restrict l, struct pell_gains *restrict gains)
{
    const float(*all)[N] = pell_irradiance_gain(p, e);
    const bool flat = p->flat;

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            gains->all[c][i] = flat ? 1.0f : all[c][i];
            gains->between[c][i] = flat ? 1.0f : e->opposed_local[c][i];
            gains->single[c][i] = 1.0f;
            l->shift[c][i] = e->shift[c][i];
        }
    if (!l->any_single)
        return;
    single_gain(l, gains->single);
    for (int c = 0; c < 3 && p->local; c++)
        for (int i = 0; i < N; i++) {
            const float kept = gains->single[c][i] * e->local[c][i] / e->gain[c][i];
            gains->single[c][i] = e->gain[c][i] > 0.0f ? kept : gains->single[c][i];
        }
    for (int c = 0; c < 3 && p->whole_solid; c++)
        for (int i = 0; i < N; i++)
            gains->single[c][i] *= e->returned[c][i];
}

/* Replaces the gains of one channel. */
static void replace_gains(const struct pell_irradiance_params *p, const float *restrict sum_weight, const float *restrict solved,
                          const float *restrict between, float *restrict all)
{
    if (p->between_faces)
        for (int i = 0; i < N; i++)
            all[i] += sum_weight[i] * (between[i] - all[i]);
    if (!p->whole_solid)
        for (int i = 0; i < N; i++)
            all[i] = solved[i] + (1.0f - solved[i]) * all[i];
}

static void apply_solids(const struct pell_irradiance_params *p, const struct pell_indirect_insides *restrict q, bool entering_only,
                         const struct pell_lanes *restrict l, struct pell_gains *restrict gains, struct pell_inside *restrict in,
                         int32_t *restrict straight)
{
    _Alignas(64) float x[N], y[N], z[N], most_straight[N], gradient_scale[N];

    for (int i = 0; i < N; i++) { /* tangential component of the view direction */
        x[i] = l->vx[i] - l->nv[i] * l->nx[i];
        y[i] = l->vy[i] - l->nv[i] * l->ny[i];
        z[i] = l->vz[i] - l->nv[i] * l->nz[i];
        gradient_scale[i] = pell_gradient_scale(l->inverse_eta2[i]);
        most_straight[i] = 0.0f;
    }
    for (int c = 0; c < 3; c++) {
        replace_gains(p, q->sum_weight[c], q->solved[c], gains->between[c], gains->all[c]);
        for (int i = 0; i < N; i++) {
            const float lateral = x[i] * q->tilt[c][0][i] + y[i] * q->tilt[c][1][i] + z[i] * q->tilt[c][2][i];
            const float exit_factor = (1.0f + q->deep[c][i] * (l->pass[c][i] - 1.0f)) * pell_gradient_exit_by(gradient_scale[i], lateral);
            const float kept = (1.0f - q->sum_weight[c][i]) * (1.0f - q->solved[c][i]);
            in->transmitted[c][i] = exit_factor * q->transmitted[c][i];
            in->light[c][i] = exit_factor * q->light[c][i];
            most_straight[i] = larger(most_straight[i], kept);
        }
        memcpy(in->solved[c], q->solved[c], sizeof(in->solved[c]));
        memcpy(in->entered[c], q->entered[c], sizeof(in->entered[c]));
        memcpy(in->sum_weight[c], q->sum_weight[c], sizeof(in->sum_weight[c]));
    }
    memset(in->beam, 0, sizeof(in->beam));
    if (p->whole_solid || !pell_irradiance_requests_indirect(p)) /* subtracted once */
        memset(in->entered, 0, sizeof(in->entered));
    if (entering_only) {
        memset(in->transmitted, 0, sizeof(in->transmitted));
        memset(in->light, 0, sizeof(in->light));
    }
    for (int i = 0; i < N; i++)
        straight[i] = -(int32_t) (most_straight[i] > PELL_LIT_STRAIGHT_LEAST);
}

static void scale_sums(const struct pell_gains *restrict gains, struct pell_sums *restrict sums)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            sums->irradiance[c][i] *= gains->all[c][i];
            sums->single[c][i] *= gains->single[c][i];
            sums->shifted[c][i] *= gains->all[c][i];
            sums->single_surplus[c][i] *= gains->all[c][i];
        }
}

static void add_transmitted(const struct pell_inside *restrict in, struct pell_sums *restrict sums)
{
    _Alignas(64) float all[N] = { 0.0f }, kept[N] = { 0.0f };

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float straight = sums->transmitted[c][i], other = straight * (1.0f - in->sum_weight[c][i]) + in->transmitted[c][i];
            all[i] += straight;
            kept[i] += straight * (1.0f - in->sum_weight[c][i]) * (1.0f - in->solved[c][i]);
            sums->transmitted[c][i] = in->beam[c][i] + (1.0f - in->solved[c][i]) * other;
            sums->solved[c][i] = in->light[c][i];
            sums->entered[c][i] = in->entered[c][i];
        }
    for (int i = 0; i < N; i++) {
        const float left = all[i] > 0.0f ? kept[i] / all[i] : 0.0f;
        sums->straight[i] *= left;
        sums->path[i] *= left;
    }
}

extern const struct pell_inside_kernels PELL_SIMD(pell_inside_kernels);
const struct pell_inside_kernels PELL_SIMD(pell_inside_kernels) = { apply_curvature, apply_solids, scale_sums, add_transmitted };
