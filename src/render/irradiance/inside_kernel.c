/* SPDX-License-Identifier: MIT
 * inside_kernel.c - see inside_kernel.h. */
#include "render/irradiance/inside_kernel.h"

#include "math/scalar.h"
#include "render/irradiance/device_data.h"
#include "render/irradiance/lanes.h"
#include "shared/curvature.h"

#include <string.h>

/* Light that is scattered once goes less far than diffusion's gain says. Thin parts keep the same share of it as of all. */
static void gain_of_once(const struct pell_lanes *restrict l, float (*restrict gain)[N])
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++)
            gain[c][i] = pell_curvature_once(l->shift[c][i], l->single_eta2[i]);
}

static void bend(const struct pell_irradiance_params *p, const struct pell_curvature_effects *restrict e, struct pell_lanes *restrict l,
                 struct pell_gains *restrict gains)
{
    const float(*all)[N] = pell_irradiance_gain(p, e);
    const bool flat = p->flat;

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            gains->all[c][i] = flat ? 1.0f : all[c][i];
            gains->between[c][i] = flat ? 1.0f : e->opposed_local[c][i];
            gains->once[c][i] = 1.0f;
            l->shift[c][i] = e->shift[c][i];
        }
    if (!l->any_single)
        return;
    gain_of_once(l, gains->once);
    for (int c = 0; c < 3 && p->local; c++)
        for (int i = 0; i < N; i++) {
            const float kept = gains->once[c][i] * e->local[c][i] / e->gain[c][i];
            gains->once[c][i] = e->gain[c][i] > 0.0f ? kept : gains->once[c][i];
        }
    for (int c = 0; c < 3 && p->whole; c++)
        for (int i = 0; i < N; i++)
            gains->once[c][i] *= e->returned[c][i];
}

/* Takes the gains of one channel over. */
static void take_over(const struct pell_irradiance_params *p, const float *restrict thick, const float *restrict solved,
                      const float *restrict gain, const float *restrict between, float *restrict all)
{
    if (p->between)
        for (int i = 0; i < N; i++)
            all[i] += thick[i] * (between[i] - all[i]);
    if (!p->whole)
        for (int i = 0; i < N; i++)
            all[i] = gain[i] + (1.0f - solved[i]) * all[i];
}

static void look(const struct pell_irradiance_params *p, const struct pell_indirect_insides *restrict q, bool entering,
                 const struct pell_lanes *restrict l, struct pell_gains *restrict gains, struct pell_inside *restrict in,
                 int32_t *restrict straight)
{
    _Alignas(64) float x[N], y[N], z[N], rest[N], bends[N];

    for (int i = 0; i < N; i++) { /* the view along the surface */
        x[i] = l->vx[i] - l->nv[i] * l->nx[i];
        y[i] = l->vy[i] - l->nv[i] * l->ny[i];
        z[i] = l->vz[i] - l->nv[i] * l->nz[i];
        bends[i] = pell_tilts(l->inverse_eta2[i]);
        rest[i] = 0.0f;
    }
    for (int c = 0; c < 3; c++) {
        take_over(p, q->thick[c], q->solved[c], q->gain[c], gains->between[c], gains->all[c]);
        for (int i = 0; i < N; i++) {
            const float aside = x[i] * q->tilt[c][0][i] + y[i] * q->tilt[c][1][i] + z[i] * q->tilt[c][2][i];
            const float leaves = (1.0f + q->deep[c][i] * (l->pass[c][i] - 1.0f)) * pell_tilted_by(bends[i], aside);
            const float kept = (1.0f - q->thick[c][i]) * (1.0f - q->solved[c][i]);
            in->through[c][i] = leaves * q->through[c][i];
            in->light[c][i] = leaves * q->light[c][i];
            rest[i] = larger(rest[i], kept);
        }
        memcpy(in->solved[c], q->solved[c], sizeof(in->solved[c]));
        memcpy(in->thick[c], q->thick[c], sizeof(in->thick[c]));
    }
    memset(in->beam, 0, sizeof(in->beam));
    if (entering) {
        memset(in->through, 0, sizeof(in->through));
        memset(in->light, 0, sizeof(in->light));
    }
    for (int i = 0; i < N; i++)
        straight[i] = -(int32_t) (rest[i] > PELL_LIT_STRAIGHT_LEAST);
}

static void scale(const struct pell_gains *restrict gains, struct pell_sums *restrict sums)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            sums->irradiance[c][i] *= gains->all[c][i];
            sums->single[c][i] *= gains->once[c][i];
        }
}

static void add(const struct pell_inside *restrict in, struct pell_sums *restrict sums)
{
    _Alignas(64) float all[N] = { 0.0f }, kept[N] = { 0.0f };

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float straight = sums->transmitted[c][i], other = straight * (1.0f - in->thick[c][i]) + in->through[c][i];
            all[i] += straight;
            kept[i] += straight * (1.0f - in->thick[c][i]) * (1.0f - in->solved[c][i]);
            sums->transmitted[c][i] = in->light[c][i] + in->beam[c][i] + (1.0f - in->solved[c][i]) * other;
        }
    for (int i = 0; i < N; i++) {
        const float left = all[i] > 0.0f ? kept[i] / all[i] : 0.0f;
        sums->straight[i] *= left;
        sums->way[i] *= left;
    }
}

extern const struct pell_inside_kernels PELL_SIMD(pell_inside_kernels);
const struct pell_inside_kernels PELL_SIMD(pell_inside_kernels) = { bend, look, scale, add };
