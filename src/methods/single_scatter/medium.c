/* SPDX-License-Identifier: MIT
 * medium.c - see single_scatter.h. */
#include "methods/single_scatter/single_scatter.h"

#include "scene/triangle.h"

#include <string.h>

#define BLACK 1e9 /* 1/mm: extinction of what is below layers that end */

static void set_layer(const struct pell_layer_medium *from, double bottom, struct single_layer *to)
{
    to->bottom = bottom;
    memcpy(to->sigma_s, from->sigma_s, sizeof(to->sigma_s));
    memcpy(to->sigma_t, from->sigma_t, sizeof(to->sigma_t));
    memcpy(to->phase, from->phase, sizeof(to->phase));
}

/* Layers of no thickness are left out, but where something is painted: there numbers are those of the medium layers. */
static void fill(const struct pell_medium_layers *medium_layers, bool painted, struct single_medium *out)
{
    double above = 0.0;

    out->eta = medium_layers->eta;
    for (int i = 0; i < medium_layers->count && above < (double) INFINITY; i++) {
        const bool endless = i + 1 == medium_layers->count && medium_layers->substrate == PELL_SUBSTRATE_LAST;
        const double bottom = endless ? (double) INFINITY : medium_layers->item[i].depth;
        if (!painted && !(bottom > above))
            continue;
        set_layer(&medium_layers->item[i], bottom, &out->layer[out->layers++]);
        above = painted ? 0.0 : bottom;
    }
    if (medium_layers->substrate == PELL_SUBSTRATE_LAST || above == (double) INFINITY)
        return;
    out->layer[out->layers] = (struct single_layer) { .bottom = (double) INFINITY };
    for (int c = 0; c < 3; c++)
        out->layer[out->layers].sigma_t[c] = BLACK;
    out->layers++;
}

enum pell_result single_medium_make(struct pell_context *ctx, const struct pell_material *m, struct single_medium *out)
{
    struct pell_medium_layers *medium_layers = pell_zalloc(ctx, sizeof(*medium_layers));
    enum pell_result res = PELL_ERR_NOMEM;
    bool painted;

    memset(out, 0, sizeof(*out));
    if (!medium_layers)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_medium_layers_make(ctx, "single-scatter", m, medium_layers));
    painted = medium_layers->painted && !(medium_layers->count == 1 && medium_layers->substrate == PELL_SUBSTRATE_LAST);
    res = PELL_ERR_NOMEM;
    out->layer = pell_calloc(ctx, (size_t) medium_layers->count + 1, sizeof(*out->layer));
    if (painted)
        out->painting = pell_zalloc(ctx, sizeof(*out->painting));
    if (!out->layer || (painted && !out->painting))
        goto fail;
    fill(medium_layers, painted, out);
    if (painted)
        out->painting->medium_layers = *medium_layers;
    res = PELL_OK;

fail:
    pell_free(ctx, medium_layers);
    return res;
}

void single_medium_finish(struct pell_context *ctx, struct single_medium *medium)
{
    pell_free(ctx, medium->layer);
    pell_free(ctx, medium->painting);
    memset(medium, 0, sizeof(*medium));
}

void single_medium_place(struct single_medium *medium, const struct pell_scene *scene, const struct pell_rays *rays,
                         const struct pell_solids *solids, int solid)
{
    struct single_painting *p = medium->painting;
    double area = 0.0, painted[PELL_UV_SETS] = { 0 };

    if (!p)
        return;
    p->rays = rays;
    p->meshes = scene->meshes;
    p->of_mesh = solids->of_mesh;
    p->texel = (double) INFINITY;
    for (size_t t = 0; t < solids->solids[solid].num_triangles; t++) {
        const struct pell_solid_triangle *at = &solids->solids[solid].triangles[t];
        const struct pell_mesh *m = &scene->meshes[at->mesh];
        const uint32_t *index = m->index + 3 * (size_t) at->triangle;
        struct pell_vec3 corner[3];
        pell_triangle_corners(m, at->triangle, corner);
        area += 0.5 * (double) vec3_length(pell_triangle_cross(corner));
        for (int k = 0; k < PELL_UV_SETS; k++) {
            const float *uv = m->uv[k], *x = uv ? uv + 2 * (size_t) index[0] : NULL;
            if (uv) {
                const float *y = uv + 2 * (size_t) index[1], *z = uv + 2 * (size_t) index[2];
                painted[k] += 0.5 * fabs((double) (y[0] - x[0]) * (double) (z[1] - x[1]) - (double) (y[1] - x[1]) * (double) (z[0] - x[0]));
            }
        }
    }
    for (int i = 0; i < p->medium_layers.count; i++) {
        const struct pell_texture_map *map = p->medium_layers.item[i].map;
        const float *m = map ? map->matrix : NULL;
        if (map && painted[map->uv] > 0.0) {
            const double texels = fabs((double) m[0] * (double) m[4] - (double) m[1] * (double) m[3]) * painted[map->uv] *
                                  (double) map->texture->image.width * (double) map->texture->image.height;
            p->texel = fmin(p->texel, texels > 0.0 ? sqrt(area / texels) : (double) INFINITY);
        }
    }
}

/* --- Ways --------------------------------------------------------------------------------------------------------------------- */

/* Where the last channel is gone, in a layer that the way enters at `start`. */
static double far_of(const struct single_way *way, const struct single_medium *m, int layer, double start)
{
    const double *sigma = m->layer[layer].sigma_t;
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        const double left = SINGLE_OPAQUE - (way->count > 0 ? way->stretch[way->count - 1].depth[c] : 0.0);
        if (left > 0.0)
            far = fmax(far, sigma[c] > 0.0 ? start + left / sigma[c] : INFINITY);
    }
    return far;
}

/* Ends the way there, or where no light comes from any more: then false. */
static bool add(struct single_way *way, const struct single_medium *m, int layer, double start, double end)
{
    const double *sigma = m->layer[layer].sigma_t, far = far_of(way, m, layer, start);
    struct single_stretch *s = &way->stretch[way->count];

    s->layer = layer;
    s->end = fmin(end, fmax(far, start));
    for (int c = 0; c < 3; c++)
        s->depth[c] = (way->count > 0 ? s[-1].depth[c] : 0.0) + (sigma[c] > 0.0 ? sigma[c] * (s->end - start) : 0.0);
    way->count++;
    return far > end;
}

/* --- Painted layers ----------------------------------------------------------------------------------------------------------- */

/* The layer at x. *gap: a way in which it may go on, or is sure to (*sure). */
static int painted_at(const struct single_medium *m, int solid, struct pell_vec3 x, double *gap, bool *sure)
{
    const struct single_painting *p = m->painting;
    const int last = m->layers - 1;
    const double deepest = p->medium_layers.deepest;
    struct pell_nearest n;
    float depth[PELL_LAYERS_MOST];
    int layer;

    *sure = true;
    *gap = deepest;
    if (!pell_rays_closest_point(p->rays, x, (float) (2.0 * deepest), p->of_mesh, solid, &n))
        return last;
    *gap = n.distance - deepest;
    if (*gap > 0.0)
        return last;
    *sure = false;
    *gap = (double) INFINITY;
    pell_medium_layers_depths(&p->medium_layers, &p->meshes[n.mesh], n.triangle, n.u, n.v, depth);
    for (int i = 0; i < p->medium_layers.count; i++)
        *gap = fmin(*gap, fabs((double) depth[i] - n.distance));
    layer = pell_medium_layers_at(&p->medium_layers, depth, (float) n.distance);
    return layer < 0 ? last : layer;
}

/* Bottoms go up and down at any rate, so a distance to them is no bound: a step is 0.7 of it, at most two texels or a 64th of the
 * deepest. Where the layer is another at its end, the first crossing is looked for by halving. */
static void make_painted(const struct single_medium *m, int solid, struct pell_vec3 x, struct pell_vec3 w, double length,
                         struct single_way *out)
{
    const double deepest = m->painting->medium_layers.deepest, fine = 1e-5 * deepest + 1e-9;
    const double most = fmax(fmin(2.0 * m->painting->texel, deepest), deepest / 64.0);
    double at = 0.0, start = 0.0, gap, least = 4e-3 * deepest, end;
    bool sure;
    int layer = painted_at(m, solid, x, &gap, &sure);

    end = fmin(length, far_of(out, m, layer, start));
    for (int step = 1; at < end; step++) {
        double to;
        int next;
        if (step % 512 == 0)
            least *= 2.0;
        to = fmin(at + fmax(sure ? gap : fmin(0.7 * gap, most), least), end);
        if (!(to < end))
            to = end;
        next = painted_at(m, solid, vec3_mad(x, (float) to, w), &gap, &sure);
        if (next == layer || out->count + 1 == SINGLE_STRETCHES) {
            at = to;
            continue;
        }
        for (double low = at; to - low > fine;) {
            const double middle = 0.5 * (low + to);
            const int there = painted_at(m, solid, vec3_mad(x, (float) middle, w), &gap, &sure);
            if (!(middle > low && middle < to))
                break;
            if (there == layer) {
                low = middle;
            } else {
                to = middle;
                next = there;
            }
        }
        if (!add(out, m, layer, start, to))
            return;
        at = start = to;
        layer = next;
        gap = 0.0;
        sure = false;
        end = fmin(length, far_of(out, m, layer, start));
    }
    add(out, m, layer, start, length);
}

/* --- Even layers -------------------------------------------------------------------------------------------------------------- */

static int layer_at(const struct single_medium *m, double below)
{
    int layer = 0;

    while (layer + 1 < m->layers && below >= m->layer[layer].bottom)
        layer++;
    return layer;
}

void single_way_make(const struct pell_connector *connector, int solid, const struct single_medium *m, struct pell_vec3 x,
                     struct pell_vec3 w, double length, struct single_way *out)
{
    double at = 0.0, start = 0.0, thinnest = INFINITY, deepest, least, below;
    int layer;

    out->count = 0;
    if (m->layers == 1) {
        add(out, m, 0, 0.0, length);
        return;
    }
    if (m->painting) {
        make_painted(m, solid, x, w, length, out);
        return;
    }
    for (int i = 0; i + 1 < m->layers; i++)
        thinnest = fmin(thinnest, m->layer[i].bottom - (i > 0 ? m->layer[i - 1].bottom : 0.0));
    deepest = m->layer[m->layers - 2].bottom;
    below = pell_connector_distance(connector, solid, x, 4.0 * deepest);
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
        below = pell_connector_distance(connector, solid, vec3_mad(x, (float) at, w), 4.0 * deepest);
        next = layer_at(m, below);
        if (next == layer || out->count + 1 == SINGLE_STRETCHES)
            continue;
        if (!add(out, m, layer, start, at))
            return;
        start = at;
        layer = next;
    }
    add(out, m, layer, start, length);
}

int single_way_at(const struct single_way *way, const struct single_medium *m, double s, double depth[3])
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

double single_way_find(const struct single_way *way, const struct single_medium *m, int c, double depth)
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
