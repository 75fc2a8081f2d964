/* SPDX-License-Identifier: MIT
 * medium.c - the medium of a solid: unreduced coefficients with the material's phase function. */
#include "methods/path_trace/path.h"

#include "transport/equivalent_medium.h"

#include <string.h>

static void set_coefficients(const struct pell_layer_medium *l, struct pt_coefficients *out)
{
    out->hg = true;
    out->gray = true;
    out->clear = true;
    for (int c = 0; c < 3; c++) {
        out->sigma_s[c] = (float) l->sigma_s[c];
        out->sigma_t[c] = (float) l->sigma_t[c];
        out->phase[c] = l->phase[c];
        out->mean_free_path[c] = out->sigma_t[c] > 0.0f ? 1.0f / out->sigma_t[c] : INFINITY;
        out->g[c] = (float) out->phase[c].g[0];
        out->hg = out->hg && out->phase[c].kind == PELL_PHASE_HENYEY_GREENSTEIN;
        out->clear = out->clear && out->sigma_t[c] == 0.0f;
    }
    out->alike = true;
    for (int c = 1; c < 3; c++)
        out->alike = out->alike && memcmp(&out->phase[c], &out->phase[0], sizeof(out->phase[0])) == 0;
    out->isotropic = out->hg && out->alike && out->g[0] == 0.0f;
    for (int c = 1; c < 3; c++)
        out->gray = out->gray && out->sigma_s[c] == out->sigma_s[0] && out->sigma_t[c] == out->sigma_t[0] && out->alike;
}

/* Layers of zero thickness are left out, except in media with depth maps, where indices must be those of the medium layers. */
static void fill(const struct pell_medium_layers *medium_layers, struct pt_medium *out)
{
    float above = 0.0f;

    out->ends = medium_layers->substrate != PELL_SUBSTRATE_LAST;
    for (int i = 0; i < medium_layers->count && above < INFINITY; i++) {
        const bool endless = i + 1 == medium_layers->count && !out->ends;
        const float bottom = endless ? INFINITY : (float) medium_layers->item[i].depth;
        if (!out->maps && !(bottom > above))
            continue;
        set_coefficients(&medium_layers->item[i], &out->layer[out->layers]);
        out->depth[out->layers++] = bottom;
        out->deepest = fmaxf(out->deepest, bottom < INFINITY ? bottom : above);
        above = out->maps ? 0.0f : bottom;
    }
    out->ends = out->ends && !(above == INFINITY);
    if (out->maps)
        out->deepest = (float) medium_layers->deepest;
    if (out->layers == 0) { /* only the substrate remains */
        set_coefficients(&medium_layers->item[0], &out->layer[0]);
        out->layers = 1;
    }
    out->homogeneous = out->layers == 1 && !out->ends;
}

/* A material with only a diffusion profile is traced as the equivalent homogeneous medium, which returns the same light over the same
 * distances. This is reported. */
static enum pell_result make_layers(struct pell_context *ctx, const struct pell_material *m, struct pell_medium_layers *out)
{
    struct pell_medium_fault fault = { 0 };
    struct pell_material medium = *m;

    if (!pell_has_profile_only(m))
        return pell_medium_layers_make(ctx, "path-trace", m, out);
    if (pell_equivalent_medium(m, &medium.medium, &fault) != PELL_OK)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, m->name, "give it coefficients or layers (for skin: skin1, skin-2layer)",
                          "has a profile but no medium, and none is equivalent: %s is %g, allowed: [%g, %g]",
                          fault.field ? fault.field : "color", fault.value, fault.min, fault.max);
    pell_warn(
        ctx, m->name, "for the medium itself give it coefficients or layers (for skin: skin1, skin-2layer)",
        "has a profile but no medium: path-trace takes the homogeneous one with the same reflectance and mean distance, sigma_a %.3g, "
        "%.3g, %.3g and sigma_s' %.3g, %.3g, %.3g per mm",
        medium.medium.sigma_a[0], medium.medium.sigma_a[1], medium.medium.sigma_a[2], medium.medium.sigma_s_reduced[0],
        medium.medium.sigma_s_reduced[1], medium.medium.sigma_s_reduced[2]);
    medium.profile = NULL;
    medium.gaussians.count = 0;
    return pell_medium_layers_make(ctx, "path-trace", &medium, out);
}

enum pell_result pt_medium_make(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_material *m,
                                struct pt_medium *out)
{
    struct pell_medium_layers *medium_layers = pell_zalloc(ctx, sizeof(*medium_layers));
    enum pell_result res = PELL_ERR_NOMEM;

    memset(out, 0, sizeof(*out));
    if (!medium_layers)
        return PELL_ERR_NOMEM;
    PELL_TRY(make_layers(ctx, m, medium_layers));
    res = PELL_ERR_NOMEM;
    out->layer = pell_calloc(ctx, (size_t) medium_layers->count, sizeof(*out->layer));
    out->depth = pell_calloc(ctx, (size_t) medium_layers->count, sizeof(*out->depth));
    if (medium_layers->has_maps && !(medium_layers->count == 1 && medium_layers->substrate == PELL_SUBSTRATE_LAST)) {
        out->maps = pell_zalloc(ctx, sizeof(*out->maps));
        if (!out->maps)
            goto fail;
        out->maps->medium_layers = *medium_layers;
        out->maps->meshes = scene->meshes;
    }
    if (!out->layer || !out->depth)
        goto fail;
    fill(medium_layers, out);
    out->floor = out->ends && medium_layers->substrate == PELL_SUBSTRATE_SURFACE_COLOR;
    out->eta = (float) medium_layers->eta;
    out->min_sigma_t = INFINITY;
    for (int i = 0; i < out->layers; i++)
        for (int c = 0; c < 3; c++) {
            out->max_sigma_t[c] = fmaxf(out->max_sigma_t[c], out->layer[i].sigma_t[c]);
            out->min_sigma_t = fminf(out->min_sigma_t, out->layer[i].sigma_t[c]);
        }
    res = PELL_OK;

fail:
    pell_free(ctx, medium_layers);
    return res;
}

void pt_medium_finish(struct pell_context *ctx, struct pt_medium *medium)
{
    pell_free(ctx, medium->layer);
    pell_free(ctx, medium->depth);
    pell_free(ctx, medium->maps);
    memset(medium, 0, sizeof(*medium));
}

/* --- Phase functions ------------------------------------------------------------------------------------------------------------------ */

void pt_phase_values(const struct pt_coefficients *m, struct pell_vec3 w, struct pell_vec3 v, float out[3])
{
    const float cosine = vec3_dot(w, v);

    if (m->isotropic) {
        out[0] = out[1] = out[2] = 1.0f / (4.0f * PELL_PI_F);
        return;
    }
    if (m->hg) {
        out[0] = pt_hg(m->g[0], cosine);
        out[1] = m->g[1] == m->g[0] ? out[0] : pt_hg(m->g[1], cosine);
        out[2] = m->g[2] == m->g[0] ? out[0] : pt_hg(m->g[2], cosine);
        return;
    }
    for (int c = 0; c < 3; c++)
        out[c] = (float) pell_phase_value(&m->phase[c], -(double) cosine);
}

float pt_phase_sample(const struct pt_coefficients *m, struct pell_vec3 w, struct pt_sampler *s, float beta[3], struct pell_vec3 *out)
{
    const int c = m->alike ? 0 : pt_sample_channel(beta, pt_random(s)); /* channel chosen by throughput */
    const float u = pt_random(s), v = pt_random(s), sum = beta[0] + beta[1] + beta[2];
    float cosine, to[3], values[3], density, scale;

    if (m->isotropic) {
        pt_uniform_sphere(u, v, to);
        *out = vec3_load(to);
        return 1.0f / (4.0f * PELL_PI_F);
    }
    cosine = m->hg ? pt_hg_cosine(m->g[c], u) : (float) -pell_phase_sample_cosine(&m->phase[c], (double) u);
    pt_rotate((const float[3]) { w.x, w.y, w.z }, fminf(fmaxf(cosine, -1.0f), 1.0f), v, to);
    *out = vec3_load(to);
    pt_phase_values(m, w, *out, values);
    if (m->alike)
        return values[0];
    density = beta[0] * values[0] + beta[1] * values[1] + beta[2] * values[2];
    scale = density > 0.0f ? sum / density : 0.0f;
    for (int i = 0; i < 3; i++)
        beta[i] *= density > 0.0f ? values[i] * scale : 1.0f;
    return density / sum;
}
