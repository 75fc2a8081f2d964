/* SPDX-License-Identifier: MIT
 * medium.c - what fills a body: coefficients as they are, not reduced, with the phase function that the material knows. */
#include "methods/path_trace/path.h"

#include "render/medium.h"

#include <string.h>

static void set_coefficients(const struct pell_material_layer *l, struct pt_coefficients *out)
{
    out->hg = true;
    out->gray = true;
    out->clear = true;
    for (int c = 0; c < 3; c++) {
        const double s = pell_medium_scattering(&l->medium, c);
        out->sigma_s[c] = (float) s;
        out->sigma_t[c] = (float) (s + l->medium.sigma_a[c]);
        out->phase[c] = l->phase[c];
        out->g[c] = (float) out->phase[c].g[0];
        out->hg = out->hg && out->phase[c].kind == PELL_PHASE_HENYEY_GREENSTEIN;
        out->clear = out->clear && out->sigma_t[c] == 0.0f;
    }
    for (int c = 1; c < 3; c++)
        out->gray = out->gray && out->sigma_s[c] == out->sigma_s[0] && out->sigma_t[c] == out->sigma_t[0] &&
                    memcmp(&out->phase[c], &out->phase[0], sizeof(out->phase[0])) == 0;
}

enum pell_result pt_medium_make(struct pell_context *ctx, const struct pell_material *m, struct pt_medium *out)
{
    struct pell_material_layers layers;
    double depth = 0.0;
    enum pell_result res;

    memset(out, 0, sizeof(*out));
    PELL_TRY(pell_medium_layers(ctx, "path-trace", m, &layers));
    out->layers = layers.count;
    out->eta = (float) layers.item[0].medium.eta;
    for (int i = 0; i < out->layers; i++) {
        set_coefficients(&layers.item[i], &out->layer[i]);
        out->depth[i] = (float) (depth += layers.item[i].thickness_mm);
    }
    out->slowest = INFINITY;
    for (int i = 0; i < out->layers; i++)
        for (int c = 0; c < 3; c++) {
            out->largest[c] = fmaxf(out->largest[c], out->layer[i].sigma_t[c]);
            out->slowest = fminf(out->slowest, out->layer[i].sigma_t[c]);
        }

fail:
    return res;
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
