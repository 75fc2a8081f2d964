/* SPDX-License-Identifier: MIT
 * medium.c - see single_scatter.h. */
#include "methods/single_scatter/single_scatter.h"

#include <string.h>

static void set_layer(const struct pell_medium *m, const struct pell_phase *phase, double bottom, struct ss_layer *out)
{
    out->bottom = bottom;
    for (int c = 0; c < 3; c++) {
        out->sigma_s[c] = m->sigma_s_reduced[c] / (1.0 - m->g[c]);
        out->sigma_t[c] = out->sigma_s[c] + m->sigma_a[c];
        out->phase[c] = phase ? phase[c] : (struct pell_phase){ PELL_PHASE_HENYEY_GREENSTEIN, { m->g[c], 0.0 }, 0.0 };
    }
}

enum pell_result ss_medium_make(struct pell_context *ctx, const struct pell_material *m, struct ss_medium *out)
{
    const struct pell_material_entry *e = m->preset && !m->profile ? pell_material_find(m->preset) : NULL;
    double bottom = 0.0;

    memset(out, 0, sizeof(*out));
    if (e && (e->kind != PELL_MATERIAL_LAYERS || memcmp(&e->gaussians, &m->gaussians, sizeof(e->gaussians)) != 0))
        e = NULL;
    if (m->profile || (m->gaussians.count > 0 && !e))
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, m->name, "give it a medium: coefficients, or a built-in material that has some",
                          "only a profile is known of this material, and single-scatter needs its coefficients");
    if (!e) {
        out->eta = m->medium.eta;
        out->layers = 1;
        set_layer(&m->medium, NULL, INFINITY, &out->layer[0]);
        return PELL_OK;
    }
    out->eta = e->layers.item[0].medium.eta;
    out->layers = e->layers.count;
    for (int i = 0; i < out->layers; i++) {
        const struct pell_material_layer *l = &e->layers.item[i];
        bottom += l->thickness_mm;
        set_layer(&l->medium, l->phase, i + 1 < out->layers ? bottom : INFINITY, &out->layer[i]);
        if (fabs(l->medium.eta - out->eta) > 1e-3)
            pell_warn(ctx, m->name, NULL,
                      "the index of layer %s, %g, is taken for %g, the first layer's: single-scatter refracts at the surface alone",
                      l->name, l->medium.eta, out->eta);
    }
    return PELL_OK;
}

/* --- Ways --------------------------------------------------------------------------------------------------------------------- */

/* Ends the way there, or where no light comes from any more: then false. */
static bool add(struct ss_way *way, const struct ss_medium *m, int layer, double start, double end)
{
    const double *sigma = m->layer[layer].sigma_t;
    struct ss_stretch *s = &way->stretch[way->count];
    double far = 0.0; /* where the last channel is gone */

    s->layer = layer;
    for (int c = 0; c < 3; c++) {
        const double before = way->count > 0 ? s[-1].depth[c] : 0.0, left = SS_OPAQUE - before;
        if (left > 0.0)
            far = fmax(far, sigma[c] > 0.0 ? start + left / sigma[c] : INFINITY);
    }
    s->end = fmin(end, fmax(far, start));
    for (int c = 0; c < 3; c++)
        s->depth[c] = (way->count > 0 ? s[-1].depth[c] : 0.0) + (sigma[c] > 0.0 ? sigma[c] * (s->end - start) : 0.0);
    way->count++;
    return far > end;
}

static int layer_at(const struct ss_medium *m, double below)
{
    int layer = 0;

    while (layer + 1 < m->layers && below >= m->layer[layer].bottom)
        layer++;
    return layer;
}

void ss_way_make(const struct pell_connector *connector, int body, const struct ss_medium *m, struct pell_vec3 x, struct pell_vec3 w,
                 double length, struct ss_way *out)
{
    double at = 0.0, start = 0.0, thinnest = INFINITY, deepest, least, below;
    int layer;

    out->count = 0;
    if (m->layers == 1) {
        add(out, m, 0, 0.0, length);
        return;
    }
    for (int i = 0; i + 1 < m->layers; i++)
        thinnest = fmin(thinnest, m->layer[i].bottom - (i > 0 ? m->layer[i - 1].bottom : 0.0));
    deepest = m->layer[m->layers - 2].bottom;
    below = pell_connector_distance(connector, body, x, 4.0 * deepest);
    layer = layer_at(m, below);
    least = 1e-4 * thinnest;
    for (int step = 1; at < length; step++) {
        double gap = INFINITY;
        int next;
        if (layer + 1 < m->layers)
            gap = m->layer[layer].bottom - below;
        if (layer > 0)
            gap = fmin(gap, below - m->layer[layer - 1].bottom);
        if (step % 512 == 0)
            least *= 2.0; /* along a boundary */
        at = fmin(at + fmax(gap, least), length);
        if (!(at < length))
            break;
        below = pell_connector_distance(connector, body, vec3_mad(x, (float) at, w), 4.0 * deepest);
        next = layer_at(m, below);
        if (next == layer || out->count + 1 == SS_STRETCHES)
            continue;
        if (!add(out, m, layer, start, at))
            return;
        start = at;
        layer = next;
    }
    add(out, m, layer, start, length);
}

int ss_way_at(const struct ss_way *way, const struct ss_medium *m, double s, double depth[3])
{
    int i = 0;

    while (i + 1 < way->count && s > way->stretch[i].end)
        i++;
    for (int c = 0; c < 3; c++) {
        const double start = i > 0 ? way->stretch[i - 1].end : 0.0, before = i > 0 ? way->stretch[i - 1].depth[c] : 0.0;
        depth[c] = before + m->layer[way->stretch[i].layer].sigma_t[c] * fmax(s - start, 0.0);
    }
    return i;
}

double ss_way_find(const struct ss_way *way, const struct ss_medium *m, int c, double depth)
{
    double start, before, sigma;
    int i = 0;

    while (i + 1 < way->count && depth > way->stretch[i].depth[c])
        i++;
    start = i > 0 ? way->stretch[i - 1].end : 0.0;
    before = i > 0 ? way->stretch[i - 1].depth[c] : 0.0;
    sigma = m->layer[way->stretch[i].layer].sigma_t[c];
    return sigma > 0.0 ? fmin(start + (depth - before) / sigma, way->stretch[i].end) : way->stretch[i].end;
}
