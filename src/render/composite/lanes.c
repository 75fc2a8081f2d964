/* SPDX-License-Identifier: MIT
 * lanes.c - see lanes.h; compiled once per SIMD level. */
#include "render/composite/lanes.h"

/* base^e for e in [0, 1]; the general power only where some material asks for it. */
static void power(const struct pell_composite_row *row, const float *base, const float *e, float *out)
{
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
    const float left = 0.5f + v->shift_x - 0.5f * (float) v->width, py = (0.5f * (float) v->height - (float) row->y - 0.5f - v->shift_y) * inverse;
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
    float f0[LANES];
    int model[LANES];

    for (int i = 0; i < LANES; i++) {
        f0[i] = m[i]->f0;
        model[i] = m[i]->model;
    }
    for (int i = 0; i < LANES; i++) {
        const float rho_s = (r[i] + g[i] + b[i]) * (1.0f / 3.0f);
        float fraction, scale, bias, albedo, mean, t;
        const float *n;
        int j;

        pell_roughness_position(roughness[i], &j, &fraction);
        pell_albedo_pair(row->albedo + 2 * ((size_t) model[i] * PELL_ALBEDO_MU * PELL_ALBEDO_ROUGHNESS + (size_t) j), fraction, mu[i], &scale, &bias);
        n = row->mean + 2 * ((size_t) model[i] * PELL_ALBEDO_ROUGHNESS + (size_t) j);
        albedo = f0[i] * scale + bias;
        mean = f0[i] * (n[0] + fraction * (n[2] - n[0])) + n[1] + fraction * (n[3] - n[1]);
        albedo = albedo < 1.0f ? albedo : 1.0f;
        mean = mean < 1.0f ? mean : 1.0f;
        t = 1.0f - rho_s * albedo;
        mean = published ? 1.0f : 1.0f - rho_s * mean;
        factor[i] = mean > 1e-6f ? t / (PELL_PI_F * mean) : 0.0f;
    }
    for (int i = 0; row->any_smooth && i < LANES; i++)
        if (m[i]->smooth)
            factor[i] = pell_boundary_lookup(m[i]->boundary, mu[i]) / (PELL_PI_F * (published ? 1.0f : m[i]->boundary_mean));
}

static bool shade(const struct pell_composite_row *row, int x, struct pell_composite_lanes *lanes)
{
    static const float luminance[3] = { 0.2126f, 0.7152f, 0.0722f };
    const struct pell_composite_params *p = row->p;
    const struct pell_surface *s = p->surface;
    const size_t at = (size_t) ((ptrdiff_t) row->y * s->stride + x);
    const struct pell_composite_material *m[LANES];
    float mu[LANES], factor[LANES], out_exponent[LANES], in_exponent[LANES], scatters[LANES], metal[LANES];
    int any = 0;

    for (int i = 0; i < LANES; i++) {
        const int id = x + i < s->width ? s->material[at + (size_t) i] : 0;
        any |= id;
        lanes->on[i] = id ? 1.0f : 0.0f;
        m[i] = &row->materials[id ? id - 1 : 0];
    }
    if (!any)
        return false;
    for (int i = 0; i < LANES; i++) {
        out_exponent[i] = m[i]->out_exponent;
        in_exponent[i] = m[i]->in_exponent;
        scatters[i] = m[i]->scatters;
        metal[i] = m[i]->in_metal;
        lanes->arriving[i] = 0.0f;
    }
    view_cosines(row, x, at, mu);
    exit_factors(row, m, mu, at, factor);
    for (int i = 0; i < LANES; i++)
        metal[i] = 1.0f - metal[i] * s->metallic[at + (size_t) i];

    for (int c = 0; c < 3; c++) {
        const float *e = p->lighting->irradiance[c] + at, *through = p->lighting->through[c] + at, *spec = p->lighting->specular[c] + at;
        const float *light = p->exitance ? p->exitance[c] + at : e, *base = s->base[c] + at;
        float out[LANES], in[LANES], total[LANES];

        power(row, base, out_exponent, out);
        power(row, base, in_exponent, in);
        for (int i = 0; i < LANES; i++)
            total[i] = m[i]->total[c];
        for (int i = 0; i < LANES; i++) {
            const float a = in[i] * metal[i], still = total[i] * e[i];
            const bool scattered = scatters[i] > 0.0f;
            const float exitance = scattered ? light[i] : still, behind = scattered ? through[i] : 0.0f;
            const bool done = scattered && p->radiance; /* a finished picture, with its specular part */
            const float k = done ? 1.0f : factor[i] * out[i];
            const bool on = lanes->on[i] > 0.0f;
            lanes->multiple[c][i] = on ? k * exitance : 0.0f;
            lanes->transmission[c][i] = on && !done ? k * behind : 0.0f;
            lanes->specular[c][i] = on && !done ? spec[i] : 0.0f;
            lanes->arriving[i] += on ? luminance[c] * e[i] / (a > 0.02f ? a : 0.02f) : 0.0f;
        }
    }
    return true;
}

const struct pell_composite_kernels PELL_SIMD(pell_composite_kernels) = { shade };
