/* SPDX-License-Identifier: MIT
 * lanes.c - see lanes.h; compiled once per SIMD level. */
#include "render/composite/lanes.h"

#include <string.h>

/* base^e for e in [0, 1]; the general power only where some material asks for it. */
static void power(const struct pell_composite_row *row, const float *base, const float *e, float *out)
{
    for (int i = 0; !row->any_texture && i < LANES; i++)
        out[i] = 1.0f;
    if (!row->any_texture)
        return;
    for (int i = 0; i < LANES; i++) {
        const float b = base[i] > 0.0f ? base[i] : 0.0f, root = sqrtf(b);
        out[i] = e[i] <= 0.0f ? 1.0f : e[i] >= 1.0f ? b : root;
    }
    for (int i = 0; row->any_power && i < LANES; i++)
        if (e[i] > 0.0f && e[i] < 1.0f && e[i] != 0.5f)
            out[i] = base[i] > 0.0f ? powf(base[i], e[i]) : 0.0f;
}

/* mu = n . w_o of each lane. */
static void view_cosines(const struct pell_composite_row *row, int x, size_t at, float *mu)
{
    const struct pell_view *v = row->p->view;
    const struct pell_surface *s = row->p->surface;
    const float inverse = v->orthographic ? 0.0f : 1.0f / v->focal_px;
    const float left = 0.5f + v->shift_x - 0.5f * (float) v->width;
    const float py = (0.5f * (float) v->height - (float) row->y - 0.5f - v->shift_y) * inverse;
    const struct pell_vec3 start = vec3_mad(v->forward, py, v->up);
    const float *nx = s->ns[0] + at, *ny = s->ns[1] + at, *nz = s->ns[2] + at;

    for (int i = 0; i < LANES; i++) {
        const float px = ((float) (x + i) + left) * inverse;
        const float dx = start.x + px * v->right.x, dy = start.y + px * v->right.y, dz = start.z + px * v->right.z;
        const float c = -(nx[i] * dx + ny[i] * dy + nz[i] * dz) / sqrtf(dx * dx + dy * dy + dz * dz);
        mu[i] = c > 0.0f ? c < 1.0f ? c : 1.0f : 0.0f;
    }
}

/* Factor from radiant exitance to radiance toward the eye: T / (pi n). */
static void exit_factors(const struct pell_composite_row *row, const struct pell_composite_material *const *m, const float *mu, size_t at,
                         float *factor)
{
    const struct pell_surface *s = row->p->surface;
    const bool published = row->p->published;
    const float *roughness = s->roughness + at, *r = s->specular[0] + at, *g = s->specular[1] + at, *b = s->specular[2] + at;
    const float *restrict t = row->albedo, *restrict mean = row->mean, shared = published ? 0.0f : 1.0f;
    float f0[LANES], fx[LANES], fy[LANES];
    int model[LANES], near[LANES], even[LANES];

    for (int i = 0; i < LANES; i++) {
        f0[i] = m[i]->f0;
        model[i] = m[i]->model;
    }
    for (int i = 0; i < LANES; i++) { /* where between the tables' entries, written out so that the compiler sees gathers from one base */
        float y = (roughness[i] - PELL_ROUGHNESS_MIN) * ((PELL_ALBEDO_ROUGHNESS - 1) / (1.0f - PELL_ROUGHNESS_MIN));
        const float xx = sqrtf(mu[i]) * (PELL_ALBEDO_MU - 1);
        int j, k;
        y = y > 0.0f ? y : 0.0f;
        y = y < PELL_ALBEDO_ROUGHNESS - 1 ? y : PELL_ALBEDO_ROUGHNESS - 1;
        j = (int) y;
        j = j < PELL_ALBEDO_ROUGHNESS - 2 ? j : PELL_ALBEDO_ROUGHNESS - 2;
        k = (int) xx;
        k = k < PELL_ALBEDO_MU - 2 ? k : PELL_ALBEDO_MU - 2;
        fy[i] = y - (float) j;
        fx[i] = xx - (float) k;
        near[i] = 2 * ((model[i] * PELL_ALBEDO_MU + k) * PELL_ALBEDO_ROUGHNESS + j);
        even[i] = 2 * (model[i] * PELL_ALBEDO_ROUGHNESS + j);
    }
    for (int i = 0; i < LANES; i++) {
        const float rho_s = (r[i] + g[i] + b[i]) * (1.0f / 3.0f);
        const int p = near[i], q = p + 2 * PELL_ALBEDO_ROUGHNESS, n = even[i];
        const float s0 = t[p] + fy[i] * (t[p + 2] - t[p]), s1 = t[q] + fy[i] * (t[q + 2] - t[q]);
        const float b0 = t[p + 1] + fy[i] * (t[p + 3] - t[p + 1]), b1 = t[q + 1] + fy[i] * (t[q + 3] - t[q + 1]);
        float albedo = f0[i] * (s0 + fx[i] * (s1 - s0)) + b0 + fx[i] * (b1 - b0);
        float average = f0[i] * (mean[n] + fy[i] * (mean[n + 2] - mean[n])) + mean[n + 1] + fy[i] * (mean[n + 3] - mean[n + 1]);
        albedo = albedo < 1.0f ? albedo : 1.0f;
        average = average < 1.0f ? average : 1.0f;
        average = 1.0f - shared * rho_s * average;
        factor[i] = (1.0f - rho_s * albedo) / (PELL_PI_F * (average > 1e-6f ? average : 1e30f));
    }
    for (int i = 0; row->any_smooth && i < LANES; i++)
        if (m[i]->smooth)
            factor[i] = pell_boundary_lookup(m[i]->boundary, mu[i]) / (PELL_PI_F * (published ? 1.0f : m[i]->boundary_mean));
}

static bool shade(const struct pell_composite_row *row, int x, struct pell_composite_lanes *result)
{
    static const float luminance[3] = { 0.2126f, 0.7152f, 0.0722f };
    const struct pell_composite_params *p = row->p;
    const struct pell_surface *s = p->surface;
    const size_t at = (size_t) ((ptrdiff_t) row->y * s->stride + x);
    const struct pell_composite_material *m[LANES];
    float mu[LANES], factor[LANES], out_exponent[LANES], in_exponent[LANES], scatters[LANES], metal[LANES], finished[LANES], behind[LANES];
    float on[LANES], arriving[LANES]; /* results are local until they are whole: nothing else can point at them */
    int any = 0;

    for (int i = 0; i < LANES; i++) {
        const int id = x + i < s->width ? s->material[at + (size_t) i] : 0;
        any |= id;
        on[i] = id ? 1.0f : 0.0f;
        m[i] = &row->materials[id ? id - 1 : 0];
    }
    if (!any)
        return false;
    for (int i = 0; i < LANES; i++) {
        out_exponent[i] = m[i]->out_exponent;
        in_exponent[i] = m[i]->in_exponent;
        scatters[i] = m[i]->scatters;
        metal[i] = m[i]->in_metal;
        arriving[i] = 0.0f;
    }
    view_cosines(row, x, at, mu);
    exit_factors(row, m, mu, at, factor);
    for (int i = 0; i < LANES; i++) {
        metal[i] = 1.0f - metal[i] * s->metallic[at + (size_t) i];
        finished[i] = p->radiance ? scatters[i] : 0.0f; /* a picture already, with its specular part */
        behind[i] = p->radiance ? 0.0f : scatters[i] * on[i];
    }

    for (int c = 0; c < 3; c++) {
        const float *e = p->lighting->irradiance[c] + at, *through = p->lighting->through[c] + at, *spec = p->lighting->specular[c] + at;
        const float *light = p->exitance ? p->exitance[c] + at : e, *base = s->base[c] + at;
        float out[LANES], in[LANES], total[LANES], multiple[LANES], transmission[LANES], specular[LANES];

        power(row, base, out_exponent, out);
        power(row, base, in_exponent, in);
        for (int i = 0; i < LANES; i++)
            total[i] = m[i]->total[c];
        for (int i = 0; i < LANES; i++) {
            const float a = in[i] * metal[i], k = finished[i] > 0.0f ? 1.0f : factor[i] * out[i];
            /* All is read, then chosen: what is off may be no number and must not be multiplied away. */
            const float moved = light[i], still = total[i] * e[i], back = k * through[i], shine = spec[i];
            const float front = k * (scatters[i] > 0.0f ? moved : still), met = luminance[c] * e[i] / (a > 0.02f ? a : 0.02f);
            multiple[i] = on[i] > 0.0f ? front : 0.0f;
            transmission[i] = behind[i] > 0.0f ? back : 0.0f;
            specular[i] = on[i] > finished[i] ? shine : 0.0f;
            arriving[i] += on[i] > 0.0f ? met : 0.0f;
        }
        memcpy(result->multiple[c], multiple, sizeof(multiple));
        memcpy(result->transmission[c], transmission, sizeof(transmission));
        memcpy(result->specular[c], specular, sizeof(specular));
    }
    memcpy(result->on, on, sizeof(on));
    memcpy(result->arriving, arriving, sizeof(arriving));
    return true;
}

const struct pell_composite_kernels PELL_SIMD(pell_composite_kernels) = { shade };
