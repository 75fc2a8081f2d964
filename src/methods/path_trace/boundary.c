/* SPDX-License-Identifier: MIT
 * boundary.c - dielectric boundaries: Fresnel equations, and GGX microfacets that reflect and refract (Walter et al. 2007, "Microfacet
 * Models for Refraction through Rough Surfaces"), sampled by visible normals (Heitz 2018, JCGT 7(4)).
 *
 * A facet reflects the Fresnel fraction of the light; masking on the way out (Smith's G_1 of the outgoing side) is the energy that the
 * single-bounce model loses. It is not dropped: a compensation lobe returns it, which depends on neither facet nor azimuth and has the
 * directional distribution of the loss (Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks", here for both sides of a
 * dielectric). The fraction of the lobe that is transmitted makes both directions reciprocal: b_0 W_0 = b_1 W_1 eta^2, W the mean loss of a
 * side. Every boundary therefore conserves energy and passes the white furnace test. */
#include "shared/boundary.h"
#include "methods/path_trace/path.h"

#include <string.h>

#define ROUGH_SAMPLES 32 /* squared: samples per entry of the table */

float pt_fresnel(float eta, float cos_i, float *cos_t)
{
    const struct pell_refraction r = pell_refract(eta, cos_i);

    *cos_t = r.cos_t;
    return r.reflectance;
}

/* --- Microfacets, in a frame whose z axis is the normal ---------------------------------------------------------------------------- */

/* Smith's G_1 of a direction on its own side; z: its cosine, > 0. */
static float masking(float alpha, float z)
{
    const float z2 = z * z;

    return 2.0f * z / (z + sqrtf(alpha * alpha * (1.0f - z2) + z2));
}

/* Distribution of normals, per sr; z: the cosine of the normal. */
static float ggx_distribution(float alpha, float z)
{
    const float a2 = alpha * alpha, d = (a2 - 1.0f) * z * z + 1.0f;

    return a2 / (PELL_PI_F * d * d);
}

/* Samples a visible normal as seen from o. */
static struct pell_vec3 sample_visible_normal(float alpha, struct pell_vec3 o, float u, float v)
{
    const struct pell_vec3 h = vec3_normalize(vec3(alpha * o.x, alpha * o.y, o.z));
    const float length = h.x * h.x + h.y * h.y, r = sqrtf(u), phi = 2.0f * PELL_PI_F * v;
    const struct pell_vec3 t1 = length > 1e-12f ? vec3_mul(vec3(-h.y, h.x, 0.0f), 1.0f / sqrtf(length)) : vec3(1.0f, 0.0f, 0.0f);
    const struct pell_vec3 t2 = vec3_cross(h, t1);
    const float a = r * cosf(phi), s = 0.5f * (1.0f + h.z), b0 = r * sinf(phi), top = 1.0f - a * a;
    const float b = (1.0f - s) * sqrtf(top > 0.0f ? top : 0.0f) + s * b0, rest = 1.0f - a * a - b * b;
    const struct pell_vec3 m = vec3_add(vec3_add(vec3_mul(t1, a), vec3_mul(t2, b)), vec3_mul(h, sqrtf(rest > 0.0f ? rest : 0.0f)));

    return vec3_normalize(vec3(alpha * m.x, alpha * m.y, m.z > 1e-6f ? m.z : 1e-6f));
}

static struct pell_vec3 reflect(struct pell_vec3 o, struct pell_vec3 m, float c)
{
    return vec3_sub(vec3_mul(m, 2.0f * c), o);
}

/* eta = n_transmitted / n_o, c = o.m. */
static struct pell_vec3 refract(struct pell_vec3 o, struct pell_vec3 m, float eta, float c, float cos_t)
{
    return vec3_mad(vec3_mul(o, -1.0f / eta), c / eta - cos_t, m);
}

/* Index on the other side over that on this side. */
static float relative_eta(const struct pt_rough *r, int side)
{
    return side == 0 ? r->eta : 1.0f / r->eta;
}

/* --- Albedo tables -------------------------------------------------------------------------------------------------------------------- */

/* Albedo of single bounces for light from mu. */
static float single_albedo(const struct pt_rough *r, int side, float mu)
{
    const float eta = relative_eta(r, side);
    const struct pell_vec3 o = vec3(sqrtf(1.0f - mu * mu), 0.0f, mu);
    double sum = 0.0;

    for (int i = 0; i < ROUGH_SAMPLES; i++)
        for (int k = 0; k < ROUGH_SAMPLES; k++) {
            const struct pell_vec3 m =
                sample_visible_normal(r->alpha, o, ((float) i + 0.5f) / ROUGH_SAMPLES, ((float) k + 0.5f) / ROUGH_SAMPLES);
            const float c = vec3_dot(o, m);
            struct pell_vec3 a, b;
            float cos_t, f;
            if (!(c > 0.0f))
                continue;
            f = pt_fresnel(eta, c, &cos_t);
            a = reflect(o, m, c);
            sum += a.z > 0.0f ? (double) (f * masking(r->alpha, a.z)) : 0.0;
            b = refract(o, m, eta, c, cos_t);
            sum += f < 1.0f && b.z < 0.0f ? (double) ((1.0f - f) * masking(r->alpha, -b.z)) : 0.0;
        }
    return (float) (sum / (ROUGH_SAMPLES * ROUGH_SAMPLES));
}

void pt_rough_make(float alpha, float eta, struct pt_rough *out)
{
    double mean[2] = { 0.0, 0.0 }, both;

    memset(out, 0, sizeof(*out));
    out->alpha = alpha;
    out->eta = eta;
    for (int side = 0; side < 2; side++) {
        double sum = 0.0;
        for (int i = 0; i <= PT_ROUGH_CELLS; i++)
            out->albedo[side][i] = single_albedo(out, side, i > 0 ? (float) i / PT_ROUGH_CELLS : 1e-3f);
        for (int i = 0; i < PT_ROUGH_CELLS; i++) {
            const double loss = fmax(1.0 - 0.5 * (double) (out->albedo[side][i] + out->albedo[side][i + 1]), 1e-6);
            const double width = (2.0 * i + 1.0) / (PT_ROUGH_CELLS * PT_ROUGH_CELLS); /* in mu^2 */
            out->lobe[side][i] = (float) loss;
            mean[side] += loss * width;
        }
        for (int i = 0; i < PT_ROUGH_CELLS; i++) {
            sum += (double) out->lobe[side][i] / mean[side] * (2.0 * i + 1.0) / (PT_ROUGH_CELLS * PT_ROUGH_CELLS);
            out->lobe[side][i] = (float) ((double) out->lobe[side][i] / mean[side]);
            out->lobe_cumulative[side][i] = (float) sum;
        }
        out->lobe_cumulative[side][PT_ROUGH_CELLS - 1] = 1.0f;
    }
    both = mean[0] + mean[1] * (double) eta * (double) eta;
    out->lobe_transmission[0] = (float) (mean[1] * (double) eta * (double) eta / both);
    out->lobe_transmission[1] = (float) (mean[0] / both);
}

static float albedo_at(const struct pt_rough *r, int side, float mu)
{
    const float x = (mu < 1.0f ? mu : 1.0f) * PT_ROUGH_CELLS;
    const int i = x < PT_ROUGH_CELLS - 1 ? (int) x : PT_ROUGH_CELLS - 1;
    const float e = r->albedo[side][i] + (x - (float) i) * (r->albedo[side][i + 1] - r->albedo[side][i]);

    return e < 1.0f ? e : 1.0f;
}

/* --- Sampling ------------------------------------------------------------------------------------------------------------------------- */

/* A direction of the compensation lobe, on the side `side`; z > 0. */
static struct pell_vec3 sample_lobe(const struct pt_rough *r, int side, float u, float v)
{
    const float *sum = r->lobe_cumulative[side];
    float before, width, mu2, sine;
    int i = 0;

    while (i < PT_ROUGH_CELLS - 1 && sum[i] <= u)
        i++;
    before = i > 0 ? sum[i - 1] : 0.0f;
    width = sum[i] - before;
    mu2 = (float) (i * i) + (float) (2 * i + 1) * (width > 0.0f ? (u - before) / width : 0.5f);
    mu2 = fminf(fmaxf(mu2 * (1.0f / (PT_ROUGH_CELLS * PT_ROUGH_CELLS)), 1e-8f), 1.0f);
    sine = sqrtf(1.0f - mu2);
    return vec3(sine * cosf(2.0f * PELL_PI_F * v), sine * sinf(2.0f * PELL_PI_F * v), sqrtf(mu2));
}

static struct pell_vec3 to_local(struct pell_vec3 w, struct pell_vec3 t, struct pell_vec3 b, struct pell_vec3 n)
{
    return vec3(vec3_dot(w, t), vec3_dot(w, b), vec3_dot(w, n));
}

struct pell_vec3 pt_rough_sample(const struct pt_rough *r, const struct pt_shading_frame *at, struct pt_sampler *s, bool *transmitted)
{
    const float eta = relative_eta(r, at->side);
    struct pell_vec3 t, b, o, m, w;
    float c, f, cos_t, u, v;
    bool kept;

    vec3_basis(at->ns, &t, &b);
    o = to_local(at->o, t, b, at->ns);
    u = pt_random(s);
    v = pt_random(s);
    m = sample_visible_normal(r->alpha, o, u, v);
    c = vec3_dot(o, m);
    f = pt_fresnel(eta, c, &cos_t);
    u = pt_random(s);
    v = pt_random(s);
    *transmitted = u >= f;
    w = *transmitted ? refract(o, m, eta, c, cos_t) : reflect(o, m, c);
    w.z = *transmitted ? -w.z : w.z; /* z > 0 from here on */
    kept = c > 0.0f && w.z > 1e-7f && v < masking(r->alpha, w.z);
    if (!kept) {
        const float fraction = r->lobe_transmission[at->side];
        u = pt_random(s);
        v = pt_random(s);
        *transmitted = u < fraction;
        u = *transmitted ? u / fraction : (u - fraction) / (1.0f - fraction);
        w = sample_lobe(r, *transmitted ? 1 - at->side : at->side, fminf(u, 0.99999994f), v);
    }
    w.z = *transmitted ? -w.z : w.z;
    w = vec3_normalize(vec3_add(vec3_add(vec3_mul(t, w.x), vec3_mul(b, w.y)), vec3_mul(at->ns, w.z)));
    return pt_to_side(w, at->ng, !*transmitted);
}

/* The same for the shading normal only; local directions. */
static float density(const struct pt_rough *r, int side, struct pell_vec3 o, struct pell_vec3 w, bool transmitted)
{
    const float eta = relative_eta(r, side), up = transmitted ? -w.z : w.z;
    struct pell_vec3 h;
    float single = 0.0f, c, cw, f, cos_t, mu, rest, fraction;
    int cell;

    if (!(up > 1e-7f && o.z > 0.0f))
        return 0.0f;
    h = transmitted ? vec3_mul(vec3_mad(o, eta, w), -1.0f) : vec3_add(o, w);
    h = vec3_normalize(h.z < 0.0f ? vec3_mul(h, -1.0f) : h);
    c = vec3_dot(o, h);
    cw = vec3_dot(w, h);
    if (c > 0.0f && (cw < 0.0f) == transmitted && h.z > 0.0f) {
        f = pt_fresnel(eta, c, &cos_t);
        single = masking(r->alpha, o.z) * ggx_distribution(r->alpha, h.z) / o.z * masking(r->alpha, up);
        if (transmitted) {
            const float d = c + eta * cw;
            single *= d * d > 0.0f ? (1.0f - f) * c * eta * eta * -cw / (d * d) : 0.0f;
        } else {
            single *= 0.25f * f;
        }
    }
    mu = up < 1.0f ? up : 1.0f;
    cell = (int) (mu * PT_ROUGH_CELLS);
    cell = cell < PT_ROUGH_CELLS - 1 ? cell : PT_ROUGH_CELLS - 1;
    rest = 1.0f - albedo_at(r, side, o.z);
    fraction = transmitted ? r->lobe_transmission[side] : 1.0f - r->lobe_transmission[side];
    return single + rest * fraction * r->lobe[transmitted ? 1 - side : side][cell] * mu / PELL_PI_F;
}

float pt_rough_density(const struct pt_rough *r, const struct pt_shading_frame *at, struct pell_vec3 w)
{
    const float c = vec3_dot(w, at->ng);
    const struct pell_vec3 mirrored = vec3_mad(w, -2.0f * c, at->ng);
    const bool transmitted = c < 0.0f;
    struct pell_vec3 t, b, o;

    vec3_basis(at->ns, &t, &b);
    o = to_local(at->o, t, b, at->ns);
    return density(r, at->side, o, to_local(w, t, b, at->ns), transmitted) +
           (vec3_dot(at->ns, at->ng) < 0.999999f ? density(r, at->side, o, to_local(mirrored, t, b, at->ns), transmitted) : 0.0f);
}

bool pt_smooth(const struct pt_shading_frame *at, float eta, float u, struct pell_vec3 *w, float *fresnel, bool *wrong)
{
    const float c = vec3_dot(at->o, at->ns);
    float cos_t;
    bool transmitted;
    struct pell_vec3 to;

    *fresnel = pt_fresnel(eta, c, &cos_t);
    transmitted = u >= *fresnel;
    to = vec3_normalize(transmitted ? refract(at->o, at->ns, eta, c, cos_t) : reflect(at->o, at->ns, c));
    *w = pt_to_side(to, at->ng, !transmitted);
    *wrong = (vec3_dot(to, at->ng) > 0.0f) == transmitted;
    return transmitted;
}
