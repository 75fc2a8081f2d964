/* SPDX-License-Identifier: MIT
 * inside_kernel.c - see inside_kernel.h. */
#include "render/irradiance/inside_kernel.h"

#include "math/scalar.h"
#include "render/irradiance/lanes.h"

#define LEAST_STRAIGHT 1e-4f /* share of transmitted light for which rays are sent: more than what rounding leaves of none */

/* What a ball returns of even light by single scattering, over a half-space: 1/(1 - mean free path over radius), within 5 % for radii of 5
 * and more mean free paths. Less than diffusion's gain, as such light goes less far. Thin parts keep the same share of it as of all. */
static void gain_of_once(const struct pell_lanes *restrict l, float (*restrict gain)[N])
{
    _Alignas(64) float inverse_eta[N];

    for (int i = 0; i < N; i++)
        inverse_eta[i] = sqrtf(l->single_eta2[i]);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float bend = l->shift[c][i] / inverse_eta[i];
            gain[c][i] = 1.0f / (1.0f - (inverse_eta[i] > 0.0f ? smaller(bend, 0.25f) : 0.0f));
        }
}

static void bend(const struct pell_irradiance_params *p, const struct pell_curvature_effects *restrict e, struct pell_lanes *restrict l,
                 struct pell_gains *restrict gains)
{
    const float(*all)[N] = pell_irradiance_gain(p, e);

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            gains->all[c][i] = p->flat ? 1.0f : all[c][i];
            gains->between[c][i] = p->flat ? 1.0f : e->opposed_local[c][i];
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
}

static void look(const struct pell_irradiance_params *p, const struct pell_indirect_insides *restrict q, bool entering,
                 const struct pell_lanes *restrict l, struct pell_gains *restrict gains, struct pell_inside *restrict in,
                 int32_t *restrict straight)
{
    _Alignas(64) float x[N], y[N], z[N];

    for (int i = 0; i < N; i++) { /* the view along the surface */
        x[i] = l->vx[i] - l->nv[i] * l->nx[i];
        y[i] = l->vy[i] - l->nv[i] * l->ny[i];
        z[i] = l->vz[i] - l->nv[i] * l->nz[i];
        straight[i] = 0;
    }
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float aside = x[i] * q->tilt[c][0][i] + y[i] * q->tilt[c][1][i] + z[i] * q->tilt[c][2][i];
            const float leaves = (1.0f + q->deep[c][i] * (l->pass[c][i] - 1.0f)) * pell_tilted(l->inverse_eta2[i], aside);
            const float thick = q->thick[c][i], solved = q->solved[c][i];
            float all = gains->all[c][i];
            all += p->between ? thick * (gains->between[c][i] - all) : 0.0f;
            gains->all[c][i] = p->whole ? all : q->gain[c][i] + (1.0f - solved) * all;
            in->through[c][i] = entering ? 0.0f : leaves * q->through[c][i];
            in->solved[c][i] = solved;
            in->light[c][i] = entering ? 0.0f : leaves * q->light[c][i];
            in->thick[c][i] = thick;
            straight[i] |= -(int32_t) ((1.0f - thick) * (1.0f - solved) > LEAST_STRAIGHT);
        }
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
            sums->transmitted[c][i] = in->light[c][i] + (1.0f - in->solved[c][i]) * other;
        }
    for (int i = 0; i < N; i++)
        sums->way[i] *= all[i] > 0.0f ? kept[i] / all[i] : 0.0f;
}

extern const struct pell_inside_kernels PELL_SIMD(pell_inside_kernels);
const struct pell_inside_kernels PELL_SIMD(pell_inside_kernels) = { bend, look, scale, add };
