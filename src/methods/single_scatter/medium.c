/* SPDX-License-Identifier: MIT
 * medium.c - see single_scatter.h. */
#include "methods/single_scatter/single_scatter.h"

#include "render/medium.h"

#include <string.h>

enum pell_result ss_medium_make(struct pell_context *ctx, const struct pell_material *m, struct ss_medium *out)
{
    struct pell_material_layers layers;
    double bottom = 0.0;
    enum pell_result res;

    memset(out, 0, sizeof(*out));
    PELL_TRY(pell_medium_layers(ctx, "single-scatter", m, &layers));
    out->eta = layers.item[0].medium.eta;
    out->layers = layers.count;
    for (int i = 0; i < out->layers; i++) {
        const struct pell_material_layer *from = &layers.item[i];
        struct ss_layer *to = &out->layer[i];
        to->bottom = bottom += from->thickness_mm;
        for (int c = 0; c < 3; c++) {
            to->sigma_s[c] = pell_medium_scattering(&from->medium, c);
            to->sigma_t[c] = to->sigma_s[c] + from->medium.sigma_a[c];
            to->phase[c] = from->phase[c];
        }
    }

fail:
    return res;
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
