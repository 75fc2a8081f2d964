/* SPDX-License-Identifier: MIT
 * medium.c - what fills a body: coefficients as they are, not reduced, with the phase function that the material knows. */
#include "methods/path_trace/path.h"

#include <string.h>

static void set_coefficients(const struct pell_medium *m, const struct pell_phase phase[3], struct pt_coefficients *out)
{
    out->hg = true;
    out->gray = true;
    out->clear = true;
    for (int c = 0; c < 3; c++) {
        const double s = m->sigma_s_reduced[c] / (1.0 - m->g[c]);
        out->sigma_s[c] = (float) s;
        out->sigma_t[c] = (float) (s + m->sigma_a[c]);
        out->phase[c] = phase ? phase[c] : (struct pell_phase){ PELL_PHASE_HENYEY_GREENSTEIN, { m->g[c], 0.0 }, 0.0 };
        out->g[c] = (float) out->phase[c].g[0];
        out->hg = out->hg && out->phase[c].kind == PELL_PHASE_HENYEY_GREENSTEIN;
        out->clear = out->clear && out->sigma_t[c] == 0.0f;
    }
    for (int c = 1; c < 3; c++)
        out->gray = out->gray && out->sigma_s[c] == out->sigma_s[0] && out->sigma_t[c] == out->sigma_t[0] &&
                    memcmp(&out->phase[c], &out->phase[0], sizeof(out->phase[0])) == 0;
}

static const struct pell_material_entry *stack_of(const struct pell_material *m)
{
    const struct pell_material_entry *e = m->preset ? pell_material_find(m->preset) : NULL;

    return e && e->kind == PELL_MATERIAL_LAYERS && memcmp(&e->gaussians, &m->gaussians, sizeof(e->gaussians)) == 0 ? e : NULL;
}

enum pell_result pt_medium_make(struct pell_context *ctx, const struct pell_material *m, struct pt_medium *out)
{
    const struct pell_material_entry *e = m->profile ? NULL : stack_of(m);

    memset(out, 0, sizeof(*out));
    if (m->profile || (m->gaussians.count > 0 && !e))
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, m->name, "give it a medium: coefficients, or a preset that has some",
                          "has a profile but no medium, which path-trace walks through");
    if (e) {
        double depth = 0.0;
        out->layers = e->layers.count < PT_LAYERS ? e->layers.count : PT_LAYERS;
        out->eta = (float) e->layers.item[0].medium.eta;
        for (int i = 0; i < out->layers; i++) {
            const struct pell_material_layer *l = &e->layers.item[i];
            set_coefficients(&l->medium, l->phase, &out->layer[i]);
            depth += l->thickness_mm;
            out->depth[i] = i + 1 < out->layers ? (float) depth : INFINITY;
            if (fabs(l->medium.eta - (double) out->eta) > 1e-3)
                pell_warn(ctx, m->name, NULL,
                          "the index of layer %s, %g, is taken for %g, the first layer's: path-trace refracts at the surface alone",
                          l->name, l->medium.eta, (double) out->eta);
        }
    } else {
        out->layers = 1;
        out->eta = (float) m->medium.eta;
        out->depth[0] = INFINITY;
        set_coefficients(&m->medium, NULL, &out->layer[0]);
    }
    out->slowest = INFINITY;
    for (int i = 0; i < out->layers; i++)
        for (int c = 0; c < 3; c++) {
            out->largest[c] = fmaxf(out->largest[c], out->layer[i].sigma_t[c]);
            out->slowest = fminf(out->slowest, out->layer[i].sigma_t[c]);
        }
    return PELL_OK;
}

/* --- Phase functions ------------------------------------------------------------------------------------------------------------------ */

/* Henyey and Greenstein, c the cosine of the angle by which light turns. */
static float hg(float g, float c)
{
    const float d = (1.0f - g) * (1.0f - g) + 2.0f * g * (1.0f - c), e = d > 1e-12f ? d : 1e-12f;

    return (1.0f - g * g) / (4.0f * PELL_PI_F * e * sqrtf(e));
}

static float hg_cosine(float g, float u)
{
    float s;

    if (fabsf(g) < 1e-3f) /* the formula cancels: its first orders in g */
        return 2.0f * u - 1.0f + 1.5f * g * (1.0f - (2.0f * u - 1.0f) * (2.0f * u - 1.0f));
    s = (1.0f - g * g) / (1.0f - g + 2.0f * g * u);
    return (1.0f + g * g - s * s) / (2.0f * g);
}

void pt_phase_values(const struct pt_coefficients *m, struct pell_vec3 w, struct pell_vec3 v, float out[3])
{
    const float cosine = vec3_dot(w, v);

    if (m->hg) {
        out[0] = hg(m->g[0], cosine);
        out[1] = m->g[1] == m->g[0] ? out[0] : hg(m->g[1], cosine);
        out[2] = m->g[2] == m->g[0] ? out[0] : hg(m->g[2], cosine);
        return;
    }
    for (int c = 0; c < 3; c++)
        out[c] = (float) pell_phase_value(&m->phase[c], -(double) cosine);
}

float pt_phase_sample(const struct pt_coefficients *m, struct pell_vec3 w, struct pt_sampler *s, float beta[3], struct pell_vec3 *out)
{
    const float sum = beta[0] + beta[1] + beta[2];
    float cosine, sine, phi, values[3], mixed;
    struct pell_vec3 t, b;
    int c = 0;

    if (!m->gray) { /* the channel by what it carries */
        float u = pt_random(s) * sum;
        while (c < 2 && u >= beta[c])
            u -= beta[c++];
    }
    cosine = m->hg ? hg_cosine(m->g[c], pt_random(s)) : (float) -pell_phase_sample_cosine(&m->phase[c], (double) pt_random(s));
    cosine = fminf(fmaxf(cosine, -1.0f), 1.0f);
    phi = 2.0f * PELL_PI_F * pt_random(s);
    sine = sqrtf(1.0f - cosine * cosine);
    vec3_basis(w, &t, &b);
    *out = vec3_normalize(vec3_add(vec3_add(vec3_mul(t, sine * cosf(phi)), vec3_mul(b, sine * sinf(phi))), vec3_mul(w, cosine)));
    pt_phase_values(m, w, *out, values);
    if (m->gray)
        return values[0];
    mixed = (beta[0] * values[0] + beta[1] * values[1] + beta[2] * values[2]) / sum;
    for (int i = 0; i < 3; i++)
        beta[i] *= mixed > 0.0f ? values[i] / mixed : 1.0f;
    return mixed;
}
