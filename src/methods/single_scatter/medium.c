/* SPDX-License-Identifier: MIT
 * medium.c - see single_scatter.h. */
#include "methods/single_scatter/single_scatter.h"

#include "scene/triangle.h"

#include <string.h>

#define BLACK 1e9 /* 1/mm: extinction of a black substrate below the layers */

static void set_layer(const struct pell_layer_medium *from, double bottom, struct single_layer *to)
{
    to->bottom = bottom;
    memcpy(to->sigma_s, from->sigma_s, sizeof(to->sigma_s));
    memcpy(to->sigma_t, from->sigma_t, sizeof(to->sigma_t));
    memcpy(to->phase, from->phase, sizeof(to->phase));
}

/* Layers of zero thickness are left out, except in media with depth maps, where indices must be those of the medium layers. */
static void fill(const struct pell_medium_layers *medium_layers, bool has_maps, struct single_medium *out)
{
    double above = 0.0;

    out->eta = medium_layers->eta;
    for (int i = 0; i < medium_layers->count && above < (double) INFINITY; i++) {
        const bool endless = i + 1 == medium_layers->count && medium_layers->substrate == PELL_SUBSTRATE_LAST;
        const double bottom = endless ? (double) INFINITY : medium_layers->item[i].depth;
        if (!has_maps && !(bottom > above))
            continue;
        set_layer(&medium_layers->item[i], bottom, &out->layer[out->layers++]);
        above = has_maps ? 0.0 : bottom;
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
    bool has_maps;

    memset(out, 0, sizeof(*out));
    if (!medium_layers)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_medium_layers_make(ctx, "single-scatter", m, medium_layers));
    has_maps = medium_layers->has_maps && !(medium_layers->count == 1 && medium_layers->substrate == PELL_SUBSTRATE_LAST);
    res = PELL_ERR_NOMEM;
    out->layer = pell_calloc(ctx, (size_t) medium_layers->count + 1, sizeof(*out->layer));
    if (has_maps)
        out->maps = pell_zalloc(ctx, sizeof(*out->maps));
    if (!out->layer || (has_maps && !out->maps))
        goto fail;
    fill(medium_layers, has_maps, out);
    if (has_maps)
        out->maps->medium_layers = *medium_layers;
    res = PELL_OK;

fail:
    pell_free(ctx, medium_layers);
    return res;
}

void single_medium_finish(struct pell_context *ctx, struct single_medium *medium)
{
    pell_free(ctx, medium->layer);
    pell_free(ctx, medium->maps);
    memset(medium, 0, sizeof(*medium));
}

void single_medium_attach(struct single_medium *medium, const struct pell_scene *scene, const struct pell_rays *rays,
                          const struct pell_solids *solids, int solid)
{
    struct single_layer_maps *p = medium->maps;
    double area = 0.0, uv_area[PELL_UV_SETS] = { 0 };

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
            const float *uv = m->uv[k], *a = uv ? uv + 2 * (size_t) index[0] : NULL;
            if (uv) {
                const float *b = uv + 2 * (size_t) index[1], *c = uv + 2 * (size_t) index[2];
                uv_area[k] += 0.5 * fabs((double) (b[0] - a[0]) * (double) (c[1] - a[1]) - (double) (b[1] - a[1]) * (double) (c[0] - a[0]));
            }
        }
    }
    for (int i = 0; i < p->medium_layers.count; i++) {
        const struct pell_texture_map *map = p->medium_layers.item[i].map;
        const float *m = map ? map->matrix : NULL;
        if (map && uv_area[map->uv] > 0.0) {
            const double texels = fabs((double) m[0] * (double) m[4] - (double) m[1] * (double) m[3]) * uv_area[map->uv] *
                                  (double) map->texture->image.width * (double) map->texture->image.height;
            p->texel = fmin(p->texel, texels > 0.0 ? sqrt(area / texels) : (double) INFINITY);
        }
    }
}

/* --- Segments of a ray -------------------------------------------------------------------------------------------------------- */

/* Distance where the last channel becomes opaque, in a layer that the ray enters at `start`. */
static double opaque_distance(const struct single_segments *segments, const struct single_medium *m, int layer, double start)
{
    const double *sigma = m->layer[layer].sigma_t;
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        const double left = SINGLE_OPAQUE - (segments->count > 0 ? segments->segment[segments->count - 1].depth[c] : 0.0);
        if (left > 0.0)
            far = fmax(far, sigma[c] > 0.0 ? start + left / sigma[c] : INFINITY);
    }
    return far;
}

/* Ends the segment at `end`, or where the ray becomes opaque, and returns false then. */
static bool add_segment(struct single_segments *segments, const struct single_medium *m, int layer, double start, double end)
{
    const double *sigma = m->layer[layer].sigma_t, far = opaque_distance(segments, m, layer, start);
    struct single_segment *s = &segments->segment[segments->count];

    s->layer = layer;
    s->end = fmin(end, fmax(far, start));
    for (int c = 0; c < 3; c++)
        s->depth[c] = (segments->count > 0 ? s[-1].depth[c] : 0.0) + (sigma[c] > 0.0 ? sigma[c] * (s->end - start) : 0.0);
    segments->count++;
    return far > end;
}

/* --- Layers with depth maps --------------------------------------------------------------------------------------------------- */

/* Index of the layer at x. *gap: distance to the nearest boundary, a bound if *sure. */
static int mapped_layer_at(const struct single_medium *m, int solid, struct pell_vec3 x, double *gap, bool *sure)
{
    const struct single_layer_maps *p = m->maps;
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

/* Mapped depths have no Lipschitz bound, so the distance to them is not a safe step: a step is 0.7 of it, at most two texels or 1/64 of the
 * deepest. If the layer differs at the end of the step, bisection finds the first crossing. */
static void make_mapped(const struct single_medium *m, int solid, struct pell_vec3 x, struct pell_vec3 w, double length,
                        struct single_segments *out)
{
    const double deepest = m->maps->medium_layers.deepest, fine = 1e-5 * deepest + 1e-9;
    const double most = fmax(fmin(2.0 * m->maps->texel, deepest), deepest / 64.0);
    double at = 0.0, start = 0.0, gap, least = 4e-3 * deepest, end;
    bool sure;
    int layer = mapped_layer_at(m, solid, x, &gap, &sure);

    end = fmin(length, opaque_distance(out, m, layer, start));
    for (int step = 1; at < end; step++) {
        double to;
        int next;
        if (step % 512 == 0)
            least *= 2.0;
        to = fmin(at + fmax(sure ? gap : fmin(0.7 * gap, most), least), end);
        if (!(to < end))
            to = end;
        next = mapped_layer_at(m, solid, vec3_mad(x, (float) to, w), &gap, &sure);
        if (next == layer || out->count + 1 == SINGLE_MAX_SEGMENTS) {
            at = to;
            continue;
        }
        for (double low = at; to - low > fine;) {
            const double middle = 0.5 * (low + to);
            const int found = mapped_layer_at(m, solid, vec3_mad(x, (float) middle, w), &gap, &sure);
            if (!(middle > low && middle < to))
                break;
            if (found == layer) {
                low = middle;
            } else {
                to = middle;
                next = found;
            }
        }
        if (!add_segment(out, m, layer, start, to))
            return;
        at = start = to;
        layer = next;
        gap = 0.0;
        sure = false;
        end = fmin(length, opaque_distance(out, m, layer, start));
    }
    add_segment(out, m, layer, start, length);
}

/* --- Layers of uniform depth -------------------------------------------------------------------------------------------------- */

static int layer_at(const struct single_medium *m, double below)
{
    int layer = 0;

    while (layer + 1 < m->layers && below >= m->layer[layer].bottom)
        layer++;
    return layer;
}

void single_segments_make(const struct pell_connector *connector, int solid, const struct single_medium *m, struct pell_vec3 x,
                          struct pell_vec3 w, double length, struct single_segments *out)
{
    double at = 0.0, start = 0.0, thinnest = INFINITY, deepest, least, below;
    int layer;

    out->count = 0;
    if (m->layers == 1) {
        add_segment(out, m, 0, 0.0, length);
        return;
    }
    if (m->maps) {
        make_mapped(m, solid, x, w, length, out);
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
            least *= 2.0; /* the ray runs along a boundary */
        at = fmin(at + fmax(gap, least), length);
        if (!(at < length))
            break;
        below = pell_connector_distance(connector, solid, vec3_mad(x, (float) at, w), 4.0 * deepest);
        next = layer_at(m, below);
        if (next == layer || out->count + 1 == SINGLE_MAX_SEGMENTS)
            continue;
        if (!add_segment(out, m, layer, start, at))
            return;
        start = at;
        layer = next;
    }
    add_segment(out, m, layer, start, length);
}

int single_segments_at(const struct single_segments *segments, const struct single_medium *m, double s, double depth[3])
{
    int i = 0;

    while (i + 1 < segments->count && s > segments->segment[i].end)
        i++;
    for (int c = 0; c < 3; c++) {
        const double start = i > 0 ? segments->segment[i - 1].end : 0.0, before = i > 0 ? segments->segment[i - 1].depth[c] : 0.0;
        depth[c] = before + m->layer[segments->segment[i].layer].sigma_t[c] * fmax(s - start, 0.0);
    }
    return i;
}

double single_segments_find(const struct single_segments *segments, const struct single_medium *m, int c, double depth)
{
    double start, before, sigma;
    int i = 0;

    while (i + 1 < segments->count && depth > segments->segment[i].depth[c])
        i++;
    start = i > 0 ? segments->segment[i - 1].end : 0.0;
    before = i > 0 ? segments->segment[i - 1].depth[c] : 0.0;
    sigma = m->layer[segments->segment[i].layer].sigma_t[c];
    return sigma > 0.0 ? fmin(start + (depth - before) / sigma, segments->segment[i].end) : segments->segment[i].end;
}
